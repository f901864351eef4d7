"""The same trajectory, bit for bit: over thread counts, over save and load, over restarts and orders."""

from dataclasses import replace

import numpy as np
import pytest

from sandbox import Simulation, load_scene
from sandbox.headless import RunOptions, run
from sandbox.scene.load import scene_from_data
from tests.conftest import make_scene

CHUNKS = 20


def trajectory(scene, seconds=0.2, **options):
    simulation = Simulation(scene, **options)
    simulation.advance(seconds)
    state = np.concatenate([simulation.positions(), simulation.velocities()])
    simulation.close()
    return state


def block(**solver):
    return make_scene(
        dimension=3,
        gravity=[0.0, -9.81, 0.0],
        solver=solver,
        bodies=[
            {
                "name": "block",
                "shape": {"kind": "box", "size": [1.0, 1.0, 1.0], "cells": [9, 9, 9]},
                "position": [0.0, 0.55, 0.0],
                "rotation": [10.0, 20.0, 30.0],
                "material": {"youngs_modulus": 1e5, "damping_ratio": 0.05},
            }
        ],
        colliders=[
            {"kind": "half_space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "friction": 0.5},
        ],
    )


@pytest.mark.parametrize("serial", [True, False])
def test_one_and_two_threads_give_the_same_bits(serial):
    scene = block()
    one, two = (trajectory(scene, threads=threads, serial=serial) for threads in (1, 2))
    assert np.array_equal(one, two)


def test_the_size_alone_picks_the_path():
    scene = block()
    assert all(Simulation(scene, threads=threads).serial for threads in (1, 2))
    assert not Simulation(load_scene("jelly", {"bodies.0.shape.cells": [26, 26, 26]})).serial


@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet"])
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_save_and_load_continue_bit_for_bit(simulate, tmp_path, integrator, precision):
    scene = block(integrator=integrator, precision=precision)
    simulation = simulate(scene)
    simulation.advance(0.1)
    simulation.save(tmp_path / "half.npz")
    simulation.advance(0.1)
    loaded = Simulation.load(tmp_path / "half.npz")
    assert loaded.time == pytest.approx(0.1)
    loaded.advance(0.1)
    assert np.array_equal(loaded.positions(), simulation.positions())
    assert np.array_equal(loaded.velocities(), simulation.velocities())
    assert loaded.time == simulation.time
    assert loaded.scene == scene


@pytest.mark.parametrize("integrator", ["symplectic_euler", "heun", "rk4", "implicit_midpoint"])
def test_a_run_that_ended_early_goes_on_to_the_same_bits(tmp_path, integrator):
    """Its steps do not hang on how long it was to be, and its pictures are where they would have been."""
    options = RunOptions("block", renderer="none", video="none")

    def ran(pictures, name, resume=None):
        scene = block(integrator=integrator, precision="f64").model_copy(update={"duration": pictures / 30.0})
        return run(scene, replace(options, out=tmp_path / name, resume=resume)).state_sha256

    whole = ran(12, "whole")
    for pictures in (3, 7):
        ran(pictures, "part")
        assert ran(12, "rest", tmp_path / "part" / "checkpoint.npz") == whole


@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet"])
def test_how_time_is_cut_into_calls_changes_no_more_than_rounding(simulate, integrator):
    simulation = simulate(block(integrator=integrator, precision="f64", dt=1e-3))
    simulation.advance(0.2)
    whole = simulation.positions()
    simulation.restore()
    for _ in range(CHUNKS):
        simulation.advance(0.2 / CHUNKS)
    assert simulation.positions() == pytest.approx(whole, abs=1e-12)


def test_a_simulation_survives_a_restart_of_taichi(simulate):
    """Another precision starts Taichi anew; the first simulation goes on where it was, with the same bits."""
    scene = block()
    alone = simulate(scene)
    alone.advance(0.1)
    alone.advance(0.1)
    first = simulate(scene)
    first.advance(0.1)
    other = simulate(scene, precision="f64")
    other.advance(0.05)
    first.advance(0.1)
    assert np.array_equal(first.positions(), alone.positions())


def test_restore_and_close_go_back_and_on(simulate):
    simulation = simulate(block())
    start = simulation.positions()
    simulation.advance(0.1)
    end = simulation.positions()
    simulation.close()
    assert np.array_equal(simulation.positions(), end)
    simulation.restore()
    assert np.array_equal(simulation.positions(), start) and simulation.time == 0.0
    simulation.advance(0.1)
    assert np.array_equal(simulation.positions(), end)


def test_particles_are_reordered_inside_but_answered_in_the_order_of_the_scene(simulate):
    """A shuffled lattice is put into a good order inside; its answers match the one that was never shuffled."""
    cells, rng = 18, np.random.default_rng(0)
    base = Simulation(make_scene(**{**block().model_dump(exclude_none=True), "bodies": [_plain_box(cells)]})).assembly
    shuffle = rng.permutation(base.particle_count)
    inverse = np.argsort(shuffle)
    bodies = []
    for points, springs in (
        (base.positions, base.springs),
        (base.positions[shuffle], inverse[base.springs]),
    ):
        shape = {"kind": "custom", "points": points.tolist(), "springs": springs.tolist()}
        bodies.append({"name": "block", "shape": shape, "material": {"stiffness": 4e3, "mass": 500.0}})
    results = []
    for body in bodies:
        data = {"dimension": 3, "gravity": [0, -9.81, 0], "solver": {"precision": "f64"}, "bodies": [body]}
        ground = {"kind": "half_space", "point": [0, -0.55, 0], "normal": [0, 1, 0]}
        simulation = simulate(scene_from_data({**data, "colliders": [ground]}, None))
        simulation.advance(0.3)
        results.append(simulation.positions())
        order = simulation.assembly.order
    assert not np.array_equal(order, np.arange(len(order)))
    assert results[1] == pytest.approx(results[0][shuffle], abs=1e-9)
    assert np.abs(results[0] - base.positions).max() > 0.02


def _plain_box(cells):
    return {
        "name": "block",
        "shape": {"kind": "box", "size": [1.0, 1.0, 1.0], "cells": [cells] * 3},
        "material": {"stiffness": 4e3},
    }
