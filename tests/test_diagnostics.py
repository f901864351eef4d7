"""Energies and momenta against NumPy; what is not finite is noticed."""

import numpy as np
import pytest

from sandbox import DivergedError, SceneError
from tests.conftest import falling_point, make_scene
from tests.forces.test_springs import random_network


@pytest.mark.parametrize("dimension", [2, 3])
def test_energies_and_momenta_are_what_numpy_says(simulate, dimension):
    scene = random_network(dimension, 3.0).model_copy(update={"gravity": (1.0, -9.81, 0.5)[:dimension]})
    simulation = simulate(scene)
    simulation.advance(0.01)
    x, v = simulation.positions(), simulation.velocities()
    shape = scene.bodies[0].shape
    m = np.array(shape.masses)[:, None]
    a, b = np.array(shape.springs).T
    stretch = np.linalg.norm(x[b] - x[a], axis=1) - shape.rest_lengths
    energy = simulation.energy()
    assert energy.kinetic == pytest.approx(0.5 * (m * v**2).sum())
    assert energy.elastic == pytest.approx(0.5 * 70.0 * (stretch**2).sum())
    assert energy.gravity == pytest.approx(-(m * x * scene.gravity).sum())
    assert energy.gas == 0.0
    assert energy.total == pytest.approx(energy.kinetic + energy.elastic + energy.gravity)
    assert simulation.momentum() == pytest.approx((m * v).sum(axis=0))
    turn = x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0] if dimension == 2 else np.cross(x, v)
    spin = (m[:, 0] * turn).sum() if dimension == 2 else (m * turn).sum(axis=0)
    assert simulation.angular_momentum() == pytest.approx(np.atleast_1d(spin))
    measured = simulation.measure()
    assert measured.max_strain == pytest.approx((np.abs(stretch) / shape.rest_lengths).max())
    assert measured.max_speed == pytest.approx(np.linalg.norm(v, axis=1).max())


@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_number_that_is_not_finite_is_noticed(simulate, precision, value):
    """Also with fast math, where the compiler would fold x != x away."""
    simulation = simulate(random_network(2, 0.0), precision=precision)
    assert simulation.measure().finite
    state = simulation.state
    state.v[state.slot, 7][1] = value
    simulation._measurement = None
    assert not simulation.measure().finite
    state.v[state.slot, 7][1] = 0.0
    state.x[state.slot, 9][0] = value
    simulation._measurement = None
    assert not simulation.measure().finite


def test_speed_bound_stops_a_scene_without_springs(simulate):
    simulation = simulate(falling_point(gravity=[0.0, -9.81], diagnostics={"max_speed": 5.0}))
    with pytest.raises(DivergedError, match=r"body 'point', particle 0: .*speed 5 m/s; dt was 0.001 s, and nothing .*"):
        simulation.advance(2.0)
    assert 0.4 < simulation.time < 5.0 / 9.81 + 0.01


def test_a_scene_that_starts_out_of_bounds_is_wrong_input(simulate):
    with pytest.raises(SceneError, match="max_speed: a body starts at 7 m/s"):
        simulate(falling_point(velocity=(0.0, 7.0), diagnostics={"max_speed": 5.0}))
    pair = {"kind": "custom", "points": [[0, 0], [3, 0]], "springs": [[0, 1]], "rest_lengths": [0.1]}
    scene = make_scene(dimension=2, bodies=[{"name": "p", "shape": pair, "material": {"stiffness": 1.0}}])
    with pytest.raises(SceneError, match="body 'p', spring 0"):
        simulate(scene)


def test_penetration_is_measured(simulate):
    ground = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 2.0]}
    simulation = simulate(falling_point(position=(0.0, -0.25), radius=0.05, colliders=[ground]))
    assert simulation.measure().max_penetration == pytest.approx(0.3)
    simulation.advance(0.01)
    assert simulation.measure().max_penetration == pytest.approx(0.0, abs=1e-9)
