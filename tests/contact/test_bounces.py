"""Restitution: a bounce without loss gives back what it took, and no bounce ever more, whatever the step."""

import math

import numpy as np
import pytest

from tests.conftest import falling_point, make_scene

FLOOR = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0]}


def _pair(restitution, height=0.5, **solver):
    """Two masses on an undamped spring of 30 kN/m that fall onto a floor, upright."""
    shape = {"kind": "custom", "points": [[0.0, 0.0], [0.0, 0.3]], "springs": [[0, 1]], "masses": [1.0, 1.0]}
    return make_scene(
        dimension=2,
        duration=2.0,
        gravity=[0.0, -9.81],
        solver={"precision": "f64", **solver},
        diagnostics={"ledger": True},
        bodies=[{"name": "pair", "position": [0.0, height], "shape": shape, "material": {"stiffness": 3e4}}],
        colliders=[{**FLOOR, "restitution": restitution}],
    )


def _extremes(simulation, seconds):
    """Largest and least total energy, over the first [1]."""
    start = simulation.energy().total
    energies = []
    for _ in range(round(seconds / 0.05)):
        simulation.advance(0.05)
        energies.append(simulation.energy().total)
    return max(energies) / start, min(energies) / start


@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet"])
def test_no_loss_is_no_loss_at_the_automatic_step(simulate, integrator):
    simulation = simulate(_pair(1.0, integrator=integrator))
    most, least = _extremes(simulation, 2.0)
    assert most < 1.02
    assert least > 0.98
    work = simulation.measure().work
    assert abs(work["collision"]) < 0.01 * simulation.energy().total


@pytest.mark.parametrize("dt", [1.3e-4, 7e-4, 2e-3, 4e-3])
@pytest.mark.parametrize("restitution", [0.6, 1.0])
def test_no_step_makes_energy(simulate, restitution, dt):
    # Verlet keeps v^2 + w^2 x^2 (1 - w^2 h^2 / 4), so that a vibration of w^2 = 2 k / m shows up to so much more.
    most, _ = _extremes(simulate(_pair(restitution, dt=dt, integrator="velocity_verlet")), 2.0)
    assert most < 1.02 / (1.0 - 2.0 * 3e4 * dt**2 / 4.0)


@pytest.mark.parametrize(("integrator", "dt"), [("symplectic_euler", 4e-3), ("velocity_verlet", 4e-3), ("rk4", 4e-3)])
def test_a_point_bounces_for_ever_at_any_step(simulate, integrator, dt):
    """By the velocity at the meeting, a bounce off a floor in uniform gravity is exact: no height is lost or won."""
    solver = {"integrator": integrator, "dt": dt, "precision": "f64"}
    scene = falling_point(gravity=[0.0, -9.81], solver=solver, colliders=[{**FLOOR, "restitution": 1.0}])
    simulation = simulate(scene)
    period = 2.0 * math.sqrt(2.0 / 9.81)
    tops = []
    for bounce in range(1, 16):
        simulation.advance(bounce * period - simulation.time)
        tops.append(float(simulation.positions()[0, 1]))
    # At its top it has hardly any speed: half a millisecond off shows as a micrometre.
    assert np.array(tops) == pytest.approx(np.ones(len(tops)), abs=2e-2)
    assert simulation.energy().total == pytest.approx(9.81, rel=5e-3)


def test_damping_and_loss_ask_for_no_shorter_steps(simulate):
    plain = simulate(_pair(0.0)).dt
    assert simulate(_pair(0.6)).dt == plain
    assert simulate(_pair(1.0)).dt < 0.05 * plain
