"""Explicit Runge-Kutta schemes: exact discrete solutions, orders, drag, bits, books."""

import math

import numpy as np
import pytest

from sandbox.integrators.runge_kutta import step_tableau
from sandbox.integrators.schemes import SCHEMES, RungeKuttaScheme
from sandbox.scene.model import IntegratorName
from tests import analytical
from tests.conftest import falling_point, make_scene, oscillator

OMEGA = math.sqrt(1000.0)
ORDERS = {"explicit_euler": 1, "midpoint": 2, "heun": 2, "rk4": 4}


@pytest.mark.filterwarnings("ignore::sandbox.warning_log.StabilityWarning")
@pytest.mark.parametrize("zeta", [0.0, 0.1])
@pytest.mark.parametrize("integrator", ORDERS)
def test_matches_the_exact_discrete_solution(simulate, integrator, zeta):
    """A step multiplies (x, v) by R(h A), with R the scheme's polynomial and A the oscillator's matrix."""
    dt, steps = 4e-3, 60
    simulation = simulate(oscillator(integrator, dt, zeta))
    simulation.advance(steps * dt)
    x, v = analytical.runge_kutta(SCHEMES[IntegratorName(integrator)].growth, OMEGA, zeta, dt, 0.5, steps)
    scale = max(1.0, abs(x), abs(v) / OMEGA)
    assert simulation.positions()[1, 0] - 1.0 == pytest.approx(x, abs=1e-12 * scale)
    assert simulation.velocities()[1, 0] == pytest.approx(v, abs=1e-12 * OMEGA * scale)


def test_amplitudes_grow_as_the_formulas_say():
    """Amplitude squared a step: 1 + w^2 h^2 (explicit Euler), 1 + (w h)^4 / 4 (midpoint, Heun)."""
    z = 0.3j
    for name, squared in (("explicit_euler", 1 + 0.3**2), ("midpoint", 1 + 0.3**4 / 4), ("heun", 1 + 0.3**4 / 4)):
        growth = SCHEMES[IntegratorName(name)].growth
        assert abs(np.polyval(growth[::-1], z)) ** 2 == pytest.approx(squared, rel=1e-14)
    assert SCHEMES[IntegratorName.RK4].growth == pytest.approx((1, 1, 1 / 2, 1 / 6, 1 / 24))


@pytest.mark.parametrize(
    ("order", "coupling", "weights", "complaint"),
    [
        (1, ((),), (0.9,), "not of order 1"),
        (2, ((), (0.4,)), (0.0, 1.0), "not of order 2"),
        (4, ((), (0.5,), (0.5, 0.0), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6), "not of order"),
        (1, ((0.5,),), (1.0,), "uses the stages before it"),
    ],
)
def test_wrong_tableaux_are_refused(order, coupling, weights, complaint):
    with pytest.raises(ValueError, match=complaint):
        RungeKuttaScheme(order=order, coupling=coupling, weights=weights)


def rope(integrator: str):
    """Swings from one end, with damping, gravity and drag."""
    body = {
        "name": "rope",
        "shape": {"kind": "rope", "from": [0, 0], "to": [1, 0], "segments": 6},
        "material": {"stiffness": 400.0, "damping_ratio": 0.05, "mass": 1.0},
        "pin": {"indices": [0]},
    }
    solver = {"integrator": integrator, "precision": "f64"}
    return make_scene(dimension=2, gravity=[0.0, -9.81], drag=0.5, solver=solver, bodies=[body])


def ring(integrator: str):
    """A gas balloon in 2D, squeezed by its own spin and swell."""
    body = {
        "name": "ring",
        "shape": {"kind": "ring", "radius": 0.5, "segments": 12},
        "material": {"stiffness": 300.0, "damping_ratio": 0.02, "mass": 1.0},
        "pressure": {"gauge_pressure": 60.0, "ambient": 100.0},
        "angular_velocity": 2.0,
    }
    return make_scene(dimension=2, solver={"integrator": integrator, "precision": "f64"}, bodies=[body])


@pytest.mark.parametrize(("scene", "fourth"), [(rope, [50, 100, 200]), (ring, [400, 800, 1600])])
def test_orders_on_a_swinging_rope_and_a_pressure_ring(simulate, scene, fourth):
    """Every explicit scheme, splitting ones too, against rk4 with steps so short that they do not count."""

    def end(simulation, count: int) -> np.ndarray:
        simulation.restore()
        simulation.dt = 0.4 / count
        simulation.advance(0.4)
        return simulation.positions()

    reference = end(simulate(scene("rk4")), 10_000)
    for integrator, order in {**ORDERS, "symplectic_euler": 1, "velocity_verlet": 2}.items():
        simulation = simulate(scene(integrator))
        counts = {1: [400, 800, 1600], 2: [400, 800, 1600], 4: fourth}[order]
        errors = [float(np.abs(end(simulation, count) - reference).max()) for count in counts]
        fitted = analytical.fitted_order([0.4 / n for n in counts], errors)
        assert fitted == pytest.approx(order, abs=0.2), integrator


@pytest.mark.parametrize("gamma", [30.0, 1e6])
@pytest.mark.parametrize("integrator", ORDERS)
def test_drag_is_exact_under_a_constant_force(simulate, integrator, gamma):
    """v' = -gamma v - g has v(t) = (v0 + g / gamma) exp(-gamma t) - g / gamma, whatever the step."""
    time = 0.6
    scene = falling_point(
        (3.0, 2.0), drag=gamma, gravity=[0.0, -9.81], solver={"integrator": integrator, "dt": 0.1, "precision": "f64"}
    )
    simulation = simulate(scene)
    simulation.advance(time)
    decay, end = math.exp(-gamma * time), 9.81 / gamma
    assert simulation.velocities()[0] == pytest.approx([3.0 * decay, (2.0 + end) * decay - end], rel=1e-12)


def test_the_tableau_without_drag_is_the_scheme_itself():
    scheme = SCHEMES[IntegratorName.RK4]
    drift, kick, decay, moment, weight = step_tableau(scheme, 0.1, 0.0)
    assert drift.tolist() == kick.tolist()
    assert decay.tolist() == [1.0] * 4 and moment == pytest.approx([0.0, 0.05, 0.05, 0.1])
    assert drift[-1] == pytest.approx(weight) and weight.sum() == pytest.approx(0.1)


def test_threads_agree_to_the_bit_and_serial_and_parallel_to_rounding(simulate):
    """Which of the two is taken depends on the scene alone; processors may fuse multiplications otherwise in each."""
    ends = []
    for serial, threads in ((True, 1), (False, 1), (False, 2)):
        simulation = simulate(rope("rk4"), serial=serial, threads=threads)
        simulation.dt = 2e-3
        simulation.advance(0.1)
        ends.append(np.concatenate([simulation.positions(), simulation.velocities()]))
        simulation.suspend()
    assert ends[1].tobytes() == ends[2].tobytes()
    assert np.abs(ends[0] - ends[1]).max() < 1e-13


def test_books_close_at_the_scheme_s_order(simulate):
    """What the ledger leaves over with rk4 is far below what explicit Euler leaves, and falls with the fourth power."""

    def left(integrator: str, dt: float) -> float:
        scene = rope(integrator).model_copy(
            update={"diagnostics": rope(integrator).diagnostics.model_copy(update={"ledger": True})}
        )
        simulation = simulate(scene)
        simulation.dt = dt
        before = simulation.energy().total
        simulation.advance(0.4)
        after = simulation.measure()
        simulation.suspend()
        return abs(after.energy.total - before - sum(after.work.values()))

    coarse, fine = left("rk4", 4e-3), left("rk4", 2e-3)
    assert fine < 1e-5 and coarse / fine == pytest.approx(16.0, rel=0.35)
    assert left("explicit_euler", 4e-3) > 100.0 * coarse


@pytest.mark.parametrize("integrator", ["explicit_euler", "rk4"])
def test_a_ball_rebounds_to_the_height_of_its_restitution(simulate, integrator):
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "restitution": 0.5}
    scene = falling_point(
        gravity=[0.0, -9.81],
        colliders=[floor],
        solver={"integrator": integrator, "dt": 1e-4, "precision": "f64"},
    )
    simulation = simulate(scene)
    fall = math.sqrt(2.0 / 9.81)
    simulation.advance(1.5 * fall)
    assert simulation.positions()[0, 1] == pytest.approx(0.25, rel=2e-3)
