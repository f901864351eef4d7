"""The ladder of integrators, measured: what each scheme does to energy, phase and stiffness, and what it costs.

    python benchmarks/ladder.py [oscillator] [stiffness] [iterations] [cost] [stiff] [--out FOLDER]

Without names all parts run, some minutes. Tables go to standard output, curves (PNG) into FOLDER.

oscillator   1,000 periods of one oscillator: energy, and phase against the exact solution, for steps of a period
stiffness    a hanging chain and a cantilever: how stiff they seem, against dt and iterations
iterations   how far xpbd and vbd are from the implicit Euler solution after so many iterations
cost         jelly of 10^3, 20^3 and 40^3 particles: a step, and a simulated second at each scheme's own step
stiff        error against wall time on a steel-like tower and on a soft body: where implicit pays, and where not
"""

import argparse
import math
import statistics
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from sandbox.errors import DivergedError
from sandbox.scene.assemble import assemble
from sandbox.scene.load import load_scene, scene_from_data
from sandbox.scene.model import IntegratorName, Scene
from sandbox.simulation import Simulation
from sandbox.trade.trial import with_solver
from sandbox.warning_log import StabilityWarning

SCHEMES = [str(name) for name in IntegratorName]
EXPLICIT = ("explicit_euler", "symplectic_euler", "velocity_verlet", "midpoint", "heun", "rk4")
ITERATIVE = ("xpbd", "vbd")
OMEGA = 1000.0
"""Angular frequency of the oscillator [rad/s]."""
LOOK = dict(zip(SCHEMES, ("#999999", "#0072b2", "#56b4e9", "#e69f00", "#d55e00", "#000000", "#009e73", "#117733",
                          "#cc79a7", "#882255"), strict=True))  # fmt: skip

# -- scenes -------------------------------------------------------------------------------------------


def scene(**parts: Any) -> Scene:
    """A scene from plain data."""
    return scene_from_data(parts, None, source="ladder")


def oscillator() -> Scene:
    """Mass 1 on a spring of 1e6 N/m: OMEGA. Many steps a picture, so that what is looked at costs nothing."""
    shape = {"kind": "custom", "points": [[0, 0], [1.1, 0]], "springs": [[0, 1]], "rest_lengths": [1.0],
             "masses": [1.0, 1.0], "pinned": [0]}  # fmt: skip
    return scene(dimension=2, bodies=[{"name": "pair", "shape": shape, "material": {"stiffness": OMEGA**2}}])


def chain() -> Scene:
    """20 masses of 50 g on springs of 5,000 N/m, hung from one end, in thick air to come to rest."""
    points = [[0.0, -0.1 * k] for k in range(21)]
    shape = {"kind": "custom", "points": points, "springs": [[k, k + 1] for k in range(20)], "masses": [0.05] * 21,
             "pinned": [0]}  # fmt: skip
    body = {"name": "chain", "shape": shape, "material": {"stiffness": 5000.0}}
    return scene(dimension=2, gravity=[0.0, -9.81], drag=4.0, duration=6.0, bodies=[body])


def cantilever() -> Scene:
    """A beam of rubber, clamped at its left end."""
    body = {
        "name": "beam",
        "position": [0.0, 0.0],
        "shape": {"kind": "box", "size": [1.0, 0.2], "cells": [20, 4]},
        "material": {"youngs_modulus": 1e6, "damping_ratio": 0.05, "density": 200.0},
        "pin": {"region": {"min": [-0.51, -0.2], "max": [-0.49, 0.2]}},
    }
    return scene(dimension=2, gravity=[0.0, -9.81], drag=8.0, duration=3.0, bodies=[body])


def jelly(side: int) -> Scene:
    """The preset with so many particles along each edge."""
    return load_scene("jelly", overrides={"bodies.0.shape.cells": [side - 1] * 3})


def tower() -> Scene:
    """A water tower of steel: 500 tonnes on a slender truss whose joints weigh 40 kg, swaying for most of a period."""
    shape = {"kind": "tower", "levels": 10, "bays": 1, "height": 12.0, "width": 1.2, "thickness": 0.04}
    steel = {"youngs_modulus": 2e11, "density": 7800.0}
    truss = assemble(scene(dimension=3, bodies=[{"name": "truss", "shape": shape, "material": steel}]))
    points = truss.scene_order(truss.positions)
    masses = truss.scene_order(truss.masses[:, None])[:, 0]
    top, foot = (np.isclose(points[:, 1], level) for level in (points[:, 1].max(), points[:, 1].min()))
    body = {
        "name": "tower",
        "shape": {
            "kind": "custom",
            "points": points.tolist(),
            "springs": truss.order[truss.springs].tolist(),
            "masses": np.where(top, 500e3 / top.sum(), masses).tolist(),
            "pinned": np.flatnonzero(foot).tolist(),
            # The shape in which it sways, nearly: members keep still.
            "velocities": [[0.1 * float(h) ** 2, 0.0, 0.0] for h in (points[:, 1] - points[:, 1].min()) / 12.0],
        },
        "material": {"stiffness": float(np.median(truss.spring_set.stiffness)), "damping_ratio": 0.02},
    }
    return scene(dimension=3, duration=4.0, bodies=[body])


def soft() -> Scene:
    """A soft block that wobbles on its clamped foot."""
    body = {
        "name": "block",
        "shape": {"kind": "box", "size": [0.4, 0.6], "cells": [8, 12]},
        "velocity": [0.6, 0.3],
        "material": {"youngs_modulus": 2e3, "damping_ratio": 0.02, "density": 100.0},
        "pin": {"region": {"min": [-0.3, -0.31], "max": [0.3, -0.29]}},
    }
    return scene(dimension=2, gravity=[0.0, -1.0], duration=0.5, bodies=[body])


# -- measuring ----------------------------------------------------------------------------------------


def simulation_of(base: Scene, scheme: str, precision: str = "f64", **solver: Any) -> Simulation:
    """A simulation of a scene with other solver settings."""
    altered = with_solver(base, integrator=IntegratorName(scheme), **solver)
    simulation = Simulation(altered, precision=precision)
    simulation.explains_failures = False
    return simulation


def rule(title: str) -> None:
    """A heading."""
    print(f"\n{title}\n{'-' * len(title)}", flush=True)


def measure_oscillator(out: Path) -> None:
    """Energy over 1,000 periods, phase, and damping."""
    rule("One oscillator, f64, 1,000 periods: energy at the end over that of the start; phase error a period [turns]")
    steps_a_period = (12, 25, 50, 100)
    print(f"{'steps a period':18}" + "".join(f"{n:>24}" for n in steps_a_period))
    curves: dict[str, tuple[list[float], list[float]]] = {}
    for scheme in SCHEMES:
        iterations = {"xpbd": 1, "vbd": 1}.get(scheme)
        simulation = simulation_of(oscillator(), scheme, dt=1e-4, tolerance=1e-11, iterations=iterations)
        line = f"{scheme:18}"
        for count in steps_a_period:
            dt = 2.0 * math.pi / OMEGA / count
            energies, phase = _oscillate(simulation, dt, count)
            if count == 50:
                curves[scheme] = ([*range(len(energies))], energies)
            line += f"{energies[-1]:>14.3g}{phase:>10.2g}"
        print(line, flush=True)
        simulation.close()
    _plot_energy(curves, out)


def _oscillate(simulation: Simulation, dt: float, count: int) -> tuple[list[float], float]:
    """Relative energy every 10 periods, nan after a blow-up; phase error a period from the first 5 [turns]."""
    simulation.restore()
    simulation.dt = dt
    start = simulation.energy().total
    energies, phase = [1.0], math.nan
    try:
        simulation.advance(5 * count * dt)
        x, v = simulation.positions()[1, 0] - 1.0, simulation.velocities()[1, 0]
        phase = math.atan2(-v / OMEGA, x) / (2.0 * math.pi) / 5.0
        simulation.restore()
        for _ in range(100):
            simulation.advance(10 * count * dt)
            energies.append(simulation.energy().total / start)
    except DivergedError:
        energies.append(math.inf)
    return energies, phase


def _plot_energy(curves: dict[str, tuple[list[float], list[float]]], out: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.0), layout="constrained")
    axis = figure.subplots()
    for scheme, (periods, energies) in curves.items():
        axis.plot([10 * p for p in periods], np.clip(energies, 1e-6, 1e3), color=LOOK[scheme], label=scheme)
    axis.set(xlabel="periods", ylabel="energy, of that at the start", yscale="log", ylim=(1e-4, 1e2))
    axis.grid(alpha=0.3)
    figure.legend(loc="outside right center", fontsize=8, frameon=False)
    figure.savefig(out / "ladder_energy.png", dpi=130)


def measure_stiffness(out: Path) -> None:
    """Effective stiffness of a hanging chain and a cantilever."""
    weight, k, count = 0.05 * 9.81, 5000.0, 20
    exact = weight * count * (count + 1) / (2.0 * k)
    _stiffness_table("Hanging chain, f64: stiffness over the true one", chain(), 6.0,
                     lambda s: exact / (-2.0 - s.positions()[:, 1].min()))  # fmt: skip
    reference = simulation_of(cantilever(), "velocity_verlet")
    reference.advance(3.0)
    sag = -reference.positions()[:, 1].min()
    reference.close()
    _stiffness_table("Cantilever, f64: stiffness over that of velocity_verlet at its own step", cantilever(), 3.0,
                     lambda s: (sag - 0.1) / (-s.positions()[:, 1].min() - 0.1))  # fmt: skip


def _stiffness_table(title: str, base: Scene, span: float, stiffness: Callable[[Simulation], float]) -> None:
    rule(title)
    steps = (1 / 60, 1 / 240, 1 / 1000, 1 / 4000)
    print(f"{'':18}{'iterations':>11}" + "".join(f"{f'dt 1/{round(1 / dt)}':>12}" for dt in steps))
    for scheme in SCHEMES:
        for iterations in (1, 5, 20, 100) if scheme in ITERATIVE else (None,):
            simulation = simulation_of(base, scheme, dt=1e-3, iterations=iterations)
            line = f"{scheme:18}{'' if iterations is None else iterations:>11}"
            for dt in steps:
                line += f"{_settled(simulation, dt, span, stiffness):>12}"
            print(line, flush=True)
            simulation.close()


def _settled(simulation: Simulation, dt: float, span: float, stiffness: Callable[[Simulation], float]) -> str:
    simulation.restore()
    simulation.dt = dt
    if dt > simulation.stable_dt():
        return "over limit"
    simulation.advance(span)
    return f"{stiffness(simulation):.4f}"


def measure_iterations(out: Path) -> None:
    """Distance of xpbd and vbd from implicit Euler's own solution."""
    rule("Soft block, f64, dt = 1/60, 12 steps: largest distance from the implicit Euler solution [m]")
    base, dt, steps = soft(), 1 / 60, 12
    exact = simulation_of(base, "implicit_euler", dt=dt, tolerance=1e-12, iterations=100)
    exact.advance(steps * dt)
    target = exact.positions()
    exact.close()
    counts = (1, 3, 10, 30, 100, 300, 1000)
    print(f"{'iterations':18}" + "".join(f"{n:>11}" for n in counts))
    for scheme, chebyshev in (("xpbd", 0.0), ("vbd", 0.0), ("vbd", 0.95)):
        line = f"{scheme + (' + Chebyshev' if chebyshev else ''):18}"
        for count in counts:
            simulation = simulation_of(base, scheme, dt=dt, iterations=count, chebyshev=chebyshev)
            try:
                simulation.advance(steps * dt)
                line += f"{np.abs(simulation.positions() - target).max():>11.2g}"
            except DivergedError:
                line += f"{'-':>11}"
            simulation.close()
        print(line, flush=True)


def measure_cost(out: Path) -> None:
    """Milliseconds a step and a simulated second, and iterations."""
    for side in (10, 20, 40):
        rule(f"jelly of {side}^3 particles, f32, falling")
        print(f"{'':18}{'own dt [ms]':>12}{'ms a step':>12}{'ms a simulated s':>18}{'iterations a step':>19}")
        for scheme in SCHEMES:
            simulation = simulation_of(jelly(side), scheme, precision="f32", dt="auto", accuracy=0.5)
            print(f"{scheme:18}" + _cost_line(simulation), flush=True)
            simulation.close()


def _cost_line(simulation: Simulation) -> str:
    dt = simulation.dt
    steps = max(2, round((0.03 if simulation.particle_count < 10_000 else 0.01) / dt))
    try:
        simulation.advance({1_000: 0.5, 8_000: 0.1}.get(simulation.particle_count, 2.0 * dt))
        times = []
        for _ in range(5):
            start = time.perf_counter()
            simulation.advance(steps * dt)
            times.append((time.perf_counter() - start) / steps)
    except DivergedError:
        return f"{1e3 * dt:>12.3f}{'blows up':>12}"
    step = statistics.median(times)
    report = simulation.solver_report()
    text = ", ".join(f"{name} {value:.3g}" for name, value in report.items() if "mean" in name or name == "sweeps")
    return f"{1e3 * dt:>12.3f}{1e3 * step:>12.3f}{1e3 * step / dt:>18.0f}  {text}"


def measure_stiff(out: Path) -> None:
    """Error against time on a stiff and on a soft scene."""
    for title, base in (("water tower", tower()), ("soft block", soft())):
        rule(f"{title}, f64, {base.duration:g} s: error of positions (of the motion) and wall time [s], by step")
        points = _trade(base)
        _plot_trade(points, title, out)
        best = {}
        for family, names in (("explicit", EXPLICIT), ("implicit", SCHEMES[6:])):
            met = [(wall, scheme, dt) for scheme, dt, error, wall in points if scheme in names and error <= 0.01]
            if met:
                best[family] = min(met)
                print(
                    f"cheapest {family} at 1 %: {best[family][1]}, dt {best[family][2]:.3g} s, {best[family][0]:.3g} s"
                )
        if len(best) == 2:
            print(f"explicit / implicit: {best['explicit'][0] / best['implicit'][0]:.2f}")


def _trade(base: Scene) -> list[tuple[str, float, float, float]]:
    """Scheme, step [s], error [1] and wall time [s] of every setting that held."""
    span = base.duration
    fine = simulation_of(base, "rk4", dt="auto")
    begun, limit = fine.positions(), fine.stable_dt()
    fine.dt = 0.2 * min(limit, 1e-3)
    fine.advance(span)
    target = fine.positions()
    scale = float(np.linalg.norm(target - begun, axis=1).max())
    fine.close()
    points = []
    for scheme in SCHEMES:
        # The impulses need not be truer than the step is.
        simulation = simulation_of(
            base, scheme, dt="auto", tolerance=0.01, iterations=50 if scheme in ITERATIVE else None
        )
        longest = min(simulation.stable_dt(), span / 4.0)
        for shorter in range(16 if scheme in EXPLICIT else 20):
            dt = span / math.ceil(span / (0.95 * longest / 2 ** (0.5 * shorter)))
            simulation.restore()
            simulation.dt = dt
            try:
                simulation.advance(span)
                simulation.restore()
                simulation.dt = dt
                start = time.perf_counter()
                simulation.advance(span)
                wall = time.perf_counter() - start
            except DivergedError:
                continue
            error = float(np.linalg.norm(simulation.positions() - target, axis=1).max()) / scale
            points.append((scheme, dt, error, wall))
            print(f"{scheme:18} dt {dt:9.3g}  error {error:9.2g}  {wall:9.3g} s", flush=True)
            if error < 2e-3 or wall > 5.0:
                break
        simulation.close()
    return points


def _plot_trade(points: list[tuple[str, float, float, float]], title: str, out: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.0), layout="constrained")
    axis = figure.subplots()
    for scheme in SCHEMES:
        own = sorted((wall, error) for name, _, error, wall in points if name == scheme)
        if own:
            axis.plot(*zip(*own, strict=True), "o-", markersize=4, color=LOOK[scheme], label=scheme)
    axis.axhline(0.01, color="black", linewidth=0.8, linestyle=":")
    axis.set(xlabel="wall time [s]", ylabel="error, of the motion", xscale="log", yscale="log", title=title)
    axis.grid(alpha=0.3, which="both")
    figure.legend(loc="outside right center", fontsize=8, frameon=False)
    figure.savefig(out / f"ladder_{title.replace(' ', '_').replace('-', '_')}.png", dpi=130)


PARTS = {
    "oscillator": measure_oscillator,
    "stiffness": measure_stiffness,
    "iterations": measure_iterations,
    "cost": measure_cost,
    "stiff": measure_stiff,
}


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser()
    options.add_argument("parts", nargs="*", choices=[*PARTS, []])
    options.add_argument("--out", type=Path, default=Path("outputs") / "ladder")
    chosen = options.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore", StabilityWarning)
    for part in chosen.parts or PARTS:
        PARTS[part](chosen.out)


if __name__ == "__main__":
    main()
