"""Taichi is started anew without anything of the old one being left."""

import contextlib
import gc

import numpy as np
import pytest
import taichi as ti

from sandbox import Simulation, runtime
from sandbox.render import create_renderer
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


@pytest.mark.parametrize("where", ["pipeline.Diagnostics", "pipeline.build_stepper", "state.ParticleState.load"])
def test_an_allocation_that_failed_leaves_nothing_behind(where, simulate, monkeypatch):
    """Another simulation goes on to the same bits, and the next one works: also where a field has no place yet."""
    alone, beside = simulate(falling_point()), simulate(falling_point())
    alone.advance(0.1)
    beside.advance(0.05)

    def fails(*_, **__):
        ti.Vector.field(2, ti.f64)
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(f"sandbox.{where}", fails)
        with pytest.raises(MemoryError):
            simulate(falling_point())
    beside.advance(0.05)
    assert np.array_equal(beside.positions(), alone.positions())
    again = simulate(falling_point())
    again.advance(0.1)
    assert np.array_equal(again.positions(), alone.positions())


def program():
    return ti.lang.impl.get_runtime().prog


def once_around():
    """A simulation that is made, drawn and closed again: what Taichi was when it began."""
    with Simulation(falling_point()) as simulation:
        begun = program()
        simulation.show(size=(32, 16))
        simulation.advance(0.01)
    return begun


def test_what_a_closed_simulation_compiled_is_forgotten():
    """Taichi would keep some megabytes for every simulation of a sweep, for good."""
    runtime.stop()
    assert once_around() is not once_around()


def test_what_somebody_holds_stays(simulate):
    """Fields and arrays of others, open simulations, open renderers: the next simulation takes nothing away."""
    begun = once_around()
    array = ti.ndarray(ti.f32, 5)
    assert once_around() is begun
    del array
    open_one = simulate(falling_point())
    begun, state = program(), open_one.state
    assert once_around() is begun and open_one.state is state
    open_one.close()
    begun = once_around()
    with contextlib.closing(create_renderer("taichi", open_one.assembly.appearance, open_one.scene.render)):
        assert once_around() is begun
    assert once_around() is not begun
    field = ti.field(ti.f32, 5)
    field.fill(3.0)  # which kernels remember, and so it stays for as long as Taichi does
    begun = program()
    assert once_around() is begun
    assert float(np.sum(field.to_numpy())) == 15.0
    runtime.stop()
    assert once_around() is not once_around()
