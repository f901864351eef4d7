"""The map of stability: stiffness x damping x mass ratio x step, predicted boundary over measured growth.

Panels are laid out by mass ratio and damping ratio; within one, stiffness runs to the right and the step up.
One simulation serves the whole map: its springs and masses are written anew for every point.
"""

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from sandbox import limits
from sandbox.integrators.schemes import SCHEMES
from sandbox.pipeline import network_of
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Body, Scene
from sandbox.simulation import Simulation
from sandbox.trade.growth import Disturbance
from sandbox.trade.stability import LONGEST, provoked
from sandbox.trade.trial import with_solver

STIFFNESS = (0.01, 0.1, 1.0, 10.0, 100.0)
"""Factors of the scene's own stiffness [1]."""
DAMPING = (0.01, 0.1, 0.5, 2.0)
"""Damping ratios of springs [1]."""
MASS_RATIOS = (1.0, 10.0, 1000.0)
"""Mass of every second particle over that of the others [1]."""
STEPS = (0.4, 0.6, 0.8, 0.9, 0.96, 1.04, 1.1, 1.25, 1.6, 2.5)
"""Steps in limits of the plainest panel's scheme [1]."""
_STEPS_TAKEN = 250
"""Steps over which a disturbance is watched."""


@dataclass(frozen=True)
class MapPoint:
    """One measurement."""

    scheme: str
    mass_ratio: float
    damping_ratio: float
    stiffness: float
    """Factor of the scene's own [1]."""
    dt: float
    """[s]"""
    predicted: float
    """Predicted limit there [s]; infinite where there is none."""
    growth: float
    """Factor by which a disturbance grew [1]; infinite where it blew up."""
    stable: bool


def stability_map(
    scene: Scene,
    arch: str = "cpu",
    threads: int | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> list[MapPoint]:
    """Measure the map of a scene with its own scheme, in double precision, around its start. Some minutes."""
    name = scene.solver.integrator
    plain = scene.model_copy(update={"gravity": None, "bodies": tuple(map(_damped, scene.bodies))})
    points: list[MapPoint] = []
    cells = [(m, z, k) for m in MASS_RATIOS for z in DAMPING for k in STIFFNESS]
    with provoked(with_solver(plain, dt=1e-4, adapt=None), arch, threads) as simulation:
        base = simulation.assembly
        for number, (mass_ratio, damping_ratio, stiffness) in enumerate(cells):
            altered = alter(base, mass_ratio, damping_ratio, stiffness)
            points += _measure(simulation, altered, str(name), (mass_ratio, damping_ratio, stiffness))
            progress((number + 1) / len(cells))
    return points


def _damped(body: Body) -> Body:
    """The body with some damping: a scene without any would have none compiled."""
    if body.material.damping or body.material.damping_ratio:
        return body
    return body.model_copy(update={"material": body.material.model_copy(update={"damping_ratio": 0.1})})


def alter(assembly: Assembly, mass_ratio: float, damping_ratio: float, stiffness: float) -> Assembly:
    """The same bodies with other springs and masses; the total mass stays."""
    heavier = np.where(np.arange(assembly.particle_count) % 2 == 1, mass_ratio, 1.0)
    masses = assembly.masses * heavier * (assembly.masses.sum() / (assembly.masses * heavier).sum())
    inverse = np.where(assembly.inverse_masses > 0.0, 1.0 / masses, 0.0)
    springs = assembly.spring_set
    k = stiffness * springs.stiffness
    light = inverse[springs.ends].sum(axis=1)
    reduced = np.divide(1.0, light, out=np.zeros_like(light), where=light > 0.0)
    c = 2.0 * damping_ratio * np.sqrt(k * reduced)
    return replace(assembly, masses=masses, inverse_masses=inverse, spring_set=replace(springs, stiffness=k, damping=c))


def _measure(
    simulation: Simulation, altered: Assembly, scheme: str, cell: tuple[float, float, float]
) -> list[MapPoint]:
    """All steps of one cell of the map."""
    simulation.retune(altered)
    mass_ratio, damping_ratio, stiffness = cell
    kind = SCHEMES[altered.scene.solver.integrator]
    network, positions = network_of(altered), altered.positions
    horizon, limit = math.inf, limits.limit(kind, network, positions, 1.0)
    for _ in range(3):  # the limit of some schemes depends on how long it has to hold
        horizon = _STEPS_TAKEN * min(limit.step, LONGEST)
        limit = limits.limit(kind, network, positions, horizon)
    disturbance = Disturbance(simulation, limit)
    points = []
    for factor in STEPS:
        dt = factor * min(limit.step, LONGEST)
        growth = disturbance.growth(dt, horizon)
        points.append(
            MapPoint(scheme, mass_ratio, damping_ratio, stiffness, dt, limit.step, growth, growth <= limit.growth)
        )
    return points


def write_csv(points: Sequence[MapPoint], path: Path) -> None:
    """The map as a table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(MapPoint)])
        writer.writeheader()
        writer.writerows(asdict(point) for point in points)


def draw(points: Sequence[MapPoint], path: Path, title: str) -> None:
    """The map as a picture (PNG)."""
    from matplotlib.figure import Figure

    ratios, dampings = sorted({p.mass_ratio for p in points}), sorted({p.damping_ratio for p in points})
    figure = Figure(figsize=(3.0 * len(dampings) + 1.2, 2.5 * len(ratios) + 0.8), layout="constrained")
    axes = figure.subplots(len(ratios), len(dampings), sharex=True, sharey="row", squeeze=False)
    for row, mass_ratio in enumerate(ratios):
        for column, damping_ratio in enumerate(dampings):
            panel = [p for p in points if (p.mass_ratio, p.damping_ratio) == (mass_ratio, damping_ratio)]
            axis = axes[row, column]
            _draw_panel(axis, panel)
            if row == 0:
                axis.set_title(f"damping ratio {damping_ratio:g}", fontsize=9)
            if column == 0:
                axis.set_ylabel(f"mass ratio {mass_ratio:g}\nstep [s]", fontsize=9)
            if row == len(ratios) - 1:
                axis.set_xlabel("stiffness, of the scene's own", fontsize=9)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    figure.suptitle(f"{title}: {points[0].scheme}", parse_math=False)
    figure.savefig(path, dpi=130)


def _draw_panel(plot: Any, panel: Sequence[MapPoint]) -> None:
    for stable, colour, marker, label in ((True, "#0072b2", "o", "stays small"), (False, "#d55e00", "x", "grows")):
        chosen = [p for p in panel if p.stable == stable]
        plot.scatter(
            [p.stiffness for p in chosen], [p.dt for p in chosen], s=18, color=colour, marker=marker, label=label
        )
    line = sorted({(p.stiffness, p.predicted) for p in panel if math.isfinite(p.predicted)})
    plot.plot(*zip(*line, strict=True), color="black", linewidth=1.2, label="predicted limit")
    plot.set_xscale("log")
    plot.set_yscale("log")
    plot.grid(alpha=0.3)
    plot.tick_params(labelsize=8)
