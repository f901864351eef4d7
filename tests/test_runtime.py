"""Taichi is started anew without anything of the old one being left."""

import gc

import pytest
import taichi as ti

from sandbox import Simulation, runtime
from tests.conftest import falling_point


@pytest.fixture
def uncollected():
    """Garbage stays until it is asked for."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def test_no_array_outlives_its_taichi(uncollected):
    """One that is collected later would take an array of the new one with it, and crash whatever uses that."""
    with Simulation(falling_point()) as simulation:
        simulation.show(size=(32, 16))
    # In a circle, as a traceback holds what it went through.
    circle = [ti.ndarray(ti.f32, 4)]
    circle.append(circle)
    del circle
    runtime.start(precision="f32")
    runtime.start(precision="f64")
    assert not [one for one in gc.get_objects() if isinstance(one, ti.lang._ndarray.Ndarray)]
