"""Energy over 100,000 periods of one oscillator: kept by Verlet and the midpoint rule, lost by implicit Euler."""

import math

import pytest

from tests.conftest import make_scene

OMEGA = 1000.0
PERIODS, STEPS = 100_000, 12


def stiff_pair(integrator: str, **solver: object):
    """Mass 1 on a spring of 1e6 N/m, stretched by a tenth: many steps a picture."""
    shape = {
        "kind": "custom",
        "points": [[0.0, 0.0], [1.1, 0.0]],
        "springs": [[0, 1]],
        "rest_lengths": [1.0],
        "masses": [1.0, 1.0],
        "pinned": [0],
    }
    body = {"name": "pair", "shape": shape, "material": {"stiffness": OMEGA**2}}
    dt = 2.0 * math.pi / OMEGA / STEPS
    return make_scene(
        dimension=2, solver={"integrator": integrator, "dt": dt, "precision": "f64", **solver}, bodies=[body]
    )


def state(simulation) -> tuple[float, float]:
    return simulation.positions()[1, 0] - 1.0, simulation.velocities()[1, 0]


@pytest.mark.parametrize("integrator", ["velocity_verlet", "implicit_midpoint"])
def test_no_drift_of_energy_in_a_hundred_thousand_periods(simulate, integrator):
    """Of what the scheme keeps: v^2 + w^2 x^2 (1 - w^2 h^2 / 4) for Verlet, the energy for the midpoint rule."""
    simulation = simulate(stiff_pair(integrator, tolerance=1e-12))
    turn = OMEGA * simulation.dt
    share = 1.0 - turn**2 / 4.0 if integrator == "velocity_verlet" else 1.0
    kept = []
    for _ in range(5):
        x, v = state(simulation)
        kept.append(v**2 + OMEGA**2 * x**2 * share)
        simulation.advance(PERIODS // 5 * STEPS * simulation.dt)
    x, v = state(simulation)
    kept.append(v**2 + OMEGA**2 * x**2 * share)
    assert simulation.time == pytest.approx(PERIODS * 2.0 * math.pi / OMEGA)
    assert max(kept) / min(kept) - 1.0 < 1e-8


def test_implicit_euler_loses_what_the_formula_says(simulate):
    """Energy falls by 1 / (1 + w^2 h^2) a step. Hairer, Lubich and Wanner, Acta Numerica 2003."""
    simulation = simulate(stiff_pair("implicit_euler", tolerance=1e-12))
    turn = OMEGA * simulation.dt
    start = simulation.energy().total
    simulation.advance(10 * STEPS * simulation.dt)
    expected = start * (1.0 + turn**2) ** (-10 * STEPS)
    assert simulation.energy().total == pytest.approx(expected, rel=1e-9)
