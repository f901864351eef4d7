"""What presses on a surface: dampers must not see it sink in, whatever the scheme takes for velocities in a step."""

import numpy as np
import pytest

from tests.conftest import make_scene

FRAMES, FRAME = 10, 0.04


def landing(integrator: str, steps: int):
    """A damped square that lands on its corner and comes to lie, in so many steps a picture."""
    body = {
        "name": "box",
        "shape": {"kind": "box", "size": [0.3, 0.3], "cells": [4, 4]},
        "position": [0.0, 0.25],
        "rotation": 0.3,
        "velocity": [1.0, 0.0],
        "material": {"youngs_modulus": 2e4, "damping_ratio": 0.1, "density": 100.0},
    }
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.3}
    solver = {"integrator": integrator, "dt": FRAME / steps, "precision": "f64"}
    return make_scene(dimension=2, gravity=[0.0, -9.81], solver=solver, bodies=[body], colliders=[floor])


@pytest.fixture(scope="module")
def exact():
    """Positions of symplectic Euler, which has no velocity into the surface anywhere, in very short steps."""
    from sandbox import Simulation

    with Simulation(landing("symplectic_euler", 2500)) as simulation:
        simulation.advance(FRAMES * FRAME)
        return simulation.positions()


@pytest.mark.parametrize("integrator", ["velocity_verlet", "midpoint", "heun", "rk4"])
def test_a_landing_is_of_the_accuracy_of_free_motion(simulate, exact, integrator):
    simulation = simulate(landing(integrator, 100))
    simulation.advance(FRAMES * FRAME)
    assert np.sqrt(((simulation.positions() - exact) ** 2).sum(axis=1).mean()) < 9e-5  # of the size of 0.3 m: 3e-4
