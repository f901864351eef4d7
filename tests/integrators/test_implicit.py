"""Implicit Euler and the implicit midpoint rule: exact discrete solutions, orders, statics, conservation."""

import math

import numpy as np
import pytest

from sandbox.balance import EnergyBalance
from tests import analytical
from tests.conftest import falling_point, make_scene, oscillator
from tests.test_ledger import SMOOTH

OMEGA = math.sqrt(1000.0)
SCHEMES = ("implicit_euler", "implicit_midpoint")
ORDER = {"implicit_euler": 1, "implicit_midpoint": 2}


def report(simulation):
    return simulation._pipeline.stepper.report()


def exact(integrator: str, dt: float, steps: int) -> complex:
    """x + i v / omega of x'' = -omega^2 x after ``steps`` steps from x = 0.5: Hairer, Lubich, Wanner 2003.

    Euler: amplitude 1 / sqrt(1 + w^2 h^2), phase atan(w h); midpoint: amplitude kept, tan(phase / 2) = w h / 2.
    """
    z = 1j * OMEGA * dt
    return 0.5 * (1.0 / (1.0 + z) if integrator == "implicit_euler" else (1.0 - z / 2.0) / (1.0 + z / 2.0)) ** steps


@pytest.mark.parametrize("serial", [True, False])
@pytest.mark.parametrize("integrator", SCHEMES)
def test_matches_the_exact_discrete_solution(simulate, integrator, serial):
    simulation = simulate(oscillator(integrator, 1.0), serial=serial)
    for dt, steps in ((1e-3, 200), (1.0 / 60.0, 50), (0.1, 20)):
        simulation.restore()
        simulation.dt = dt
        simulation.advance(steps * dt)
        state = exact(integrator, dt, steps)
        assert simulation.positions()[1, 0] - 1.0 == pytest.approx(state.real, abs=1e-12)
        assert simulation.velocities()[1, 0] == pytest.approx(OMEGA * state.imag, abs=1e-12 * OMEGA)
    assert simulation.positions()[0].tolist() == [0.0, 0.0]
    assert report(simulation)["newton_most"] == 1.0  # linear: one direction is enough


def test_midpoint_keeps_the_energy_of_a_linear_spring(simulate):
    simulation = simulate(oscillator("implicit_midpoint", 0.02))
    before = simulation.energy().total
    simulation.advance(3000 * 0.02)  # 300 periods
    assert simulation.energy().total == pytest.approx(before, rel=1e-11)


ROPE = {
    "gravity": [0.0, -9.81],
    "drag": 0.5,
    "bodies": [
        {
            "name": "rope",
            "shape": {"kind": "rope", "from": [0, 0], "to": [1, 0], "segments": 6},
            "material": {"stiffness": 400.0, "damping_ratio": 0.05, "mass": 1.0},
            "pin": {"indices": [0]},
        }
    ],
}
RING = {
    "bodies": [
        {
            "name": "ring",
            "angular_velocity": 2.0,
            "shape": {"kind": "ring", "radius": 0.5, "segments": 16},
            "material": {"stiffness": 500.0, "damping": 0.5, "mass": 2.0},
            "pressure": {"gauge_pressure": 300.0, "ambient": 1000.0},
            "pin": {"indices": [0]},
        }
    ],
}


@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize(("parts", "seconds"), [(ROPE, 0.3), (RING, 0.03)], ids=["rope", "ring"])
def test_order_of_convergence_on_nonlinear_bodies(simulate, integrator, parts, seconds):
    """Against Runge and Kutta's scheme of order 4 with a fine step."""
    positions = []
    for name, steps in (("rk4", [4000]), (integrator, [100, 200, 400])):
        solver = {"integrator": name, "dt": 1e-4, "precision": "f64", "tolerance": 1e-9}
        simulation = simulate(make_scene(dimension=2, solver=solver, **parts))
        for count in steps:
            simulation.restore()
            simulation.dt = seconds / count
            simulation.advance(seconds)
            positions.append(simulation.positions())
        simulation.close()
    errors = [float(np.abs(found - positions[0]).max()) for found in positions[1:]]
    assert analytical.fitted_order([seconds / n for n in steps], errors) == pytest.approx(ORDER[integrator], abs=0.2)


@pytest.mark.parametrize("integrator", SCHEMES)
def test_free_fall_and_drag_are_exact_for_the_scheme(simulate, integrator):
    g, h, n = 9.81, 0.05, 10
    solver = {"integrator": integrator, "dt": h, "precision": "f64"}
    simulation = simulate(falling_point(velocity=(1.0, 2.0), gravity=[0.0, -g], solver=solver))
    simulation.advance(n * h)
    lag = 1.0 / n if integrator == "implicit_euler" else 0.0
    fall = 0.5 * g * (n * h) ** 2 * (1.0 + lag)
    assert simulation.positions()[0] == pytest.approx([n * h, 1.0 + 2.0 * n * h - fall], abs=1e-12)
    simulation.close()
    gamma = 2.0
    simulation = simulate(falling_point(velocity=(3.0, 0.0), gravity=[0.0, -g], drag=gamma, solver=solver))
    simulation.advance(n * h)
    kept = 1.0 / (1.0 + gamma * h) if lag else (1.0 - gamma * h / 2.0) / (1.0 + gamma * h / 2.0)
    expected = [3.0 * kept**n, -g / gamma * (1.0 - kept**n)]
    assert simulation.velocities()[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("tension_only", [False, True])
def test_hanging_chain_stretches_as_statics_says(simulate, tension_only):
    """At 1/60 s, with springs that no explicit scheme could take; a rope that is thrown up hangs down in the end."""
    count, mass, stiffness = 8, 0.5, 2e6
    points = [[0.0, -0.1 * k] for k in range(count + 1)]
    shape = {
        "kind": "custom", "points": points, "springs": [[k, k + 1] for k in range(count)],
        "masses": [mass] * (count + 1), "pinned": [0], "velocities": [[0.0, 5.0 * tension_only * k] for k in range(9)],
    }  # fmt: skip
    material = {"stiffness": stiffness, "damping_ratio": 0.2, "tension_only": tension_only}
    solver = {"integrator": "implicit_euler", "dt": 1.0 / 60.0, "precision": "f64"}
    body = {"name": "chain", "shape": shape, "material": material}
    scene = make_scene(dimension=2, gravity=[0.0, -9.81], drag=1.0, solver=solver, bodies=[body])
    simulation = simulate(scene)
    simulation.advance(0.1)
    if tension_only:
        # Slack parts fly freely: the last mass is where its throw brought it.
        assert simulation.positions()[-1, 1] > -0.1 * count + 1.0
    simulation.advance(25.0)
    stretch = -simulation.positions()[-1, 1] - 0.1 * count
    expected = analytical.chain_stretch(count, mass, 9.81, stiffness)
    assert stretch == pytest.approx(expected, rel=2e-3 if tension_only else 1e-6)
    assert report(simulation)["unfinished"] < 0.02


@pytest.mark.parametrize(
    ("integrator", "name", "steps", "part"),
    [
        ("implicit_euler", "damped rope with drag", (4e-4, 1e-4), 0.05),
        ("implicit_midpoint", "gas ring in wind", (2e-3, 5e-4), 0.001),
        ("implicit_midpoint", "carried and yielding", (2e-3,), 0.002),
    ],
)
def test_the_ledger_closes_but_for_the_error_of_the_scheme(simulate, integrator, name, steps, part):
    """What is left over shrinks with the scheme's order; flow, which is done once a step, is of first order."""
    solver = {"integrator": integrator, "dt": 1e-3, "precision": "f64", "tolerance": 1e-8}
    simulation = simulate(make_scene(dimension=2, solver=solver, diagnostics={"ledger": True}, **SMOOTH[name]))
    left = []
    for dt in steps:
        simulation.restore()
        simulation.dt = dt
        balance = EnergyBalance(simulation.measure())
        for _ in range(10):
            simulation.advance(0.05)
            balance.add(simulation.measure())
        left.append(balance.unexplained)
    assert abs(left[-1]) < part * balance.moved
    if integrator == "implicit_euler":
        assert max(left) < 0.0  # it damps by itself
    if len(steps) > 1:
        slope = math.log(left[0] / left[-1]) / math.log(steps[0] / steps[-1])
        assert slope == pytest.approx(ORDER[integrator], abs=0.3)


def block(precision: str, cells: int = 7, **solver):
    body = {
        "name": "block",
        "shape": {"kind": "box", "size": [1.0, 1.0, 1.0], "cells": [cells] * 3},
        "position": [0.0, 0.62, 0.0],
        "rotation": [10.0, 20.0, 30.0],
        "material": {"youngs_modulus": 1e5, "damping_ratio": 0.05},
    }
    floor = {"kind": "half_space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "friction": 0.5}
    solver = {"integrator": "implicit_euler", "dt": 1.0 / 120.0, "precision": precision, **solver}
    return make_scene(dimension=3, gravity=[0.0, -9.81, 0.0], solver=solver, bodies=[body], colliders=[floor])


def test_threads_change_no_bit_and_both_paths_agree(simulate):
    """A block of lattice that lands: 512 particles are several blocks of every sum, and slices of eight."""
    found = []
    for options in ({"threads": 1, "serial": False}, {"threads": 2, "serial": False}, {"threads": 2, "serial": True}):
        simulation = simulate(block("f64"), **options)
        simulation.advance(0.15)
        found.append(np.concatenate([simulation.positions(), simulation.velocities()]))
        simulation.close()
    assert np.array_equal(found[0], found[1])
    assert np.abs(found[0] - found[2]).max() < 1e-7


def test_rest_is_remembered_and_continues_bit_for_bit(simulate, tmp_path):
    simulation = simulate(block("f32", cells=3))
    simulation.advance(0.3)
    assert (simulation._pipeline.stepper.resting[0].mode.to_numpy() > 0).any()
    simulation.save(tmp_path / "half.npz")
    simulation.advance(0.1)
    resumed = type(simulation).load(tmp_path / "half.npz")
    resumed.advance(0.1)
    assert np.array_equal(simulation.positions(), resumed.positions())
    resumed.suspend()


def test_pinned_particles_stay_and_carried_ones_go_along(simulate):
    scene = {key: value for key, value in SMOOTH["carried and yielding"].items() if key != "bodies"}
    rope = SMOOTH["carried and yielding"]["bodies"][0] | {"pin": {"indices": [8]}}
    for integrator in SCHEMES:
        solver = {"integrator": integrator, "dt": 1.0 / 60.0, "precision": "f64"}
        simulation = simulate(make_scene(dimension=2, solver=solver, bodies=[rope], **scene))
        start = simulation.positions()
        simulation.advance(0.5)
        # The hand went by (0.4, 0.2) and turned by a right angle: its particle is 0.5 below it at first.
        assert simulation.positions()[0] == pytest.approx([0.4 + 0.5, 0.7], abs=1e-12)
        assert simulation.positions()[8].tolist() == start[8].tolist()
        assert simulation.velocities()[8].tolist() == [0.0, 0.0]
        simulation.close()
