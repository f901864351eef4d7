"""One oscillator against the exact discrete solution, in f64, and the schemes' orders and limits."""

import math

import numpy as np
import pytest

from sandbox import DivergedError
from sandbox.warning_log import StabilityWarning
from tests import analytical
from tests.conftest import make_scene, oscillator

OMEGA = math.sqrt(1000.0)
SCHEMES = ("symplectic_euler", "velocity_verlet")
EXACT = {"symplectic_euler": analytical.symplectic_euler, "velocity_verlet": analytical.velocity_verlet}
LIMIT = {"symplectic_euler": analytical.symplectic_euler_limit, "velocity_verlet": analytical.velocity_verlet_limit}


@pytest.mark.parametrize("dt", [1e-3, 4e-3, 0.05])
@pytest.mark.parametrize("integrator", SCHEMES)
def test_matches_the_exact_discrete_solution(simulate, integrator, dt):
    simulation = simulate(oscillator(integrator, dt))
    steps = 200
    simulation.advance(steps * dt)
    x, v = EXACT[integrator](OMEGA, dt, 0.5, steps)
    assert simulation.positions()[1, 0] - 1.0 == pytest.approx(x, abs=1e-12)
    assert simulation.velocities()[1, 0] == pytest.approx(v, abs=1e-12 * OMEGA)
    assert simulation.positions()[0].tolist() == [0.0, 0.0]


def test_verlet_conserves_its_modified_energy(simulate):
    dt = 1e-2
    simulation = simulate(oscillator("velocity_verlet", dt))
    energies = []
    for _ in range(50):
        simulation.advance(20 * dt)
        x, v = simulation.positions()[1, 0] - 1.0, simulation.velocities()[1, 0]
        energies.append(v**2 + OMEGA**2 * x**2 * (1.0 - (OMEGA * dt) ** 2 / 4.0))
    assert np.ptp(energies) < 1e-11 * energies[0]


@pytest.mark.parametrize("zeta", [0.0, 0.1])
@pytest.mark.parametrize(("integrator", "order"), [("symplectic_euler", 1), ("velocity_verlet", 2)])
def test_order_of_convergence_on_the_oscillator(simulate, integrator, order, zeta):
    time, steps = 0.25, [40, 80, 160, 320]
    exact = analytical.damped_oscillator(OMEGA, zeta, 0.5, time)
    errors = []
    simulation = simulate(oscillator(integrator, 1e-3, zeta))
    for count in steps:
        simulation.restore()
        simulation.dt = time / count
        simulation.advance(time)
        errors.append(abs(simulation.positions()[1, 0] - 1.0 - exact))
    assert analytical.fitted_order([time / n for n in steps], errors) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.05])
@pytest.mark.parametrize(("integrator", "order"), [("symplectic_euler", 1), ("velocity_verlet", 2)])
def test_order_of_convergence_on_a_nonlinear_chain(simulate, integrator, order, damping_ratio):
    """A rope that swings from one end, with gravity and drag: large rotations, against a fine reference."""

    rope = {
        "name": "rope",
        "shape": {"kind": "rope", "from": [0, 0], "to": [1, 0], "segments": 6},
        "material": {"stiffness": 400.0, "damping_ratio": damping_ratio, "mass": 1.0},
        "pin": {"indices": [0]},
    }
    solver = {"integrator": integrator, "precision": "f64"}
    simulation = simulate(make_scene(dimension=2, gravity=[0.0, -9.81], drag=0.5, solver=solver, bodies=[rope]))

    def positions(steps: int) -> np.ndarray:
        simulation.restore()
        simulation.dt = 0.5 / steps
        simulation.advance(0.5)
        return simulation.positions()

    reference = positions(100_000)
    # The reference has an error of its own, of the same order: at most 1/60 of the finest below.
    steps = [200, 400, 800, 1600]
    errors = [float(np.abs(positions(count) - reference).max()) for count in steps]
    assert analytical.fitted_order([0.5 / n for n in steps], errors) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize("zeta", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("integrator", SCHEMES)
def test_stable_dt_is_the_limit_of_the_scheme(simulate, integrator, zeta):
    limit = LIMIT[integrator](zeta) / OMEGA
    simulation = simulate(oscillator(integrator, "auto", zeta, start=1.001))
    assert simulation.stable_dt() == pytest.approx(limit, rel=1e-3)

    simulation.dt = 0.99 * limit
    simulation.advance(2000 * simulation.dt)
    assert abs(simulation.positions()[1, 0] - 1.0) < 0.05

    simulation.restore()
    simulation.dt = 1.01 * limit
    try:
        simulation.advance(2000 * simulation.dt)
    except DivergedError:
        return
    # With damping it may flip to and fro at a large amplitude instead of leaving the bounds.
    assert abs(simulation.positions()[1, 0] - 1.0) > 0.05


def test_a_blow_up_names_the_spring_and_both_steps_and_keeps_the_last_good_state(simulate):
    simulation = simulate(oscillator("velocity_verlet", "auto"))
    simulation.dt = 0.07
    with pytest.raises(DivergedError, match="body 'pair', spring 0") as caught:
        simulation.advance(10.0)
    message = str(caught.value)
    assert "omega dt = 2.2" in message and "dt was 0.06" in message and "stable is 0.06325 s" in message
    assert caught.value.stable_dt == pytest.approx(2.0 / OMEGA, rel=1e-3)
    assert simulation.time < caught.value.time <= simulation.time + 0.1
    assert np.isfinite(simulation.positions()).all()
    assert simulation.measure().max_strain <= simulation.scene.diagnostics.max_strain
    # The state is usable: with a stable step it goes on.
    simulation.dt = 1e-3
    simulation.advance(0.5)


def test_a_fixed_step_above_the_limit_is_a_warning_with_both_numbers(simulate):
    with pytest.warns(StabilityWarning, match=r"solver.dt = 0.1 s is above the stability limit 0.06325 s"):
        simulate(oscillator("symplectic_euler", 0.1))


def test_auto_takes_the_safe_fraction_of_the_limit(simulate):
    stiff = oscillator("symplectic_euler", "auto")
    body = stiff.bodies[0]
    material = body.material.model_copy(update={"stiffness": 1e7})
    stiff = stiff.model_copy(update={"bodies": (body.model_copy(update={"material": material}),)})
    simulation = simulate(stiff)
    assert simulation.dt == pytest.approx(0.8 * 2.0 / math.sqrt(1e7), rel=1e-3)


def test_time_is_divided_into_equal_steps(simulate):
    simulation = simulate(oscillator("symplectic_euler", 3e-3))
    simulation.advance(0.01)  # 4 steps of 2.5 ms
    x, _ = analytical.symplectic_euler(OMEGA, 2.5e-3, 0.5, 4)
    assert simulation.time == pytest.approx(0.01)
    assert simulation.positions()[1, 0] - 1.0 == pytest.approx(x, abs=1e-13)
    assert simulation._divide(10 * 3e-3) == (10, 3e-3)


@pytest.mark.parametrize("seconds", [-1.0, math.nan, math.inf])
def test_advance_refuses_what_is_no_time(simulate, seconds):
    with pytest.raises(ValueError, match="must be a time"):
        simulate(oscillator("symplectic_euler", 1e-3)).advance(seconds)
