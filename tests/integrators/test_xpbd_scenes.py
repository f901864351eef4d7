"""Scenes stepped by XPBD: colliders, books, paths and threads, and the edge of what can be asked of it."""

import math

import numpy as np
import pytest

from sandbox import Simulation
from sandbox.balance import EnergyBalance
from tests.conftest import make_scene
from tests.integrators.test_xpbd import custom, solver, square
from tests.test_ledger import SMOOTH

FLOOR = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0]}


def test_a_body_bears_its_own_weight_at_long_steps(simulate):
    """On the floor it is as high as with short explicit steps; a bottom without the load would sink, or hover."""
    heights = []
    scene = {"dimension": 2, "gravity": [0.0, -9.81], "drag": 6.0, "colliders": [FLOOR]}
    for dt in (1 / 60, 1 / 240):
        simulation = simulate(make_scene(**scene, bodies=[square()], solver=solver(dt, 60)))
        simulation.advance(4.0)
        x = simulation.positions()
        assert x[:, 1].min() == pytest.approx(0.0, abs=1e-12)
        assert simulation.measure().max_speed < 1e-3
        heights.append(x[:, 1].mean())
    reference = simulate(make_scene(**scene, bodies=[square()], solver={"dt": 5e-4, "precision": "f64"}))
    reference.advance(4.0)
    sag = 0.5 - reference.positions()[:, 1].mean()
    assert sag > 0.01
    assert 0.5 - np.array(heights) == pytest.approx([sag, sag], rel=1e-3)


def test_a_body_that_iterations_cannot_solve_is_soft_but_whole(simulate):
    """Pushes larger than springs are long: turned at once with their springs, they would crumple it to a puddle."""
    body = {**square(cells=16, youngs_modulus=6e5), "position": [0.0, 0.6]}
    scene = make_scene(
        dimension=2, gravity=[0.0, -9.81], drag=2.0, colliders=[FLOOR], bodies=[body], solver=solver(1 / 60, 20)
    )
    simulation = simulate(scene)
    simulation.advance(2.0)
    assert simulation.solver_report()["residual"] > 0.5
    assert 0.47 < simulation.positions()[:, 1].mean() < 0.5


def test_bounces_and_friction_act_once_a_step(simulate):
    """A point falls onto a rough floor: restitution, friction and their books are those of one collision."""
    point = {"kind": "custom", "points": [[0.0, 0.0]], "masses": [2.0]}
    scene = make_scene(
        dimension=2,
        gravity=[0.0, -9.81],
        solver=solver(1e-4, 10),
        diagnostics={"ledger": True},
        bodies=[{"name": "point", "position": [0.0, 1.0], "velocity": [1.0, 0.0], "shape": point}],
        colliders=[{**FLOOR, "restitution": 0.5, "friction": 0.1}],
    )
    simulation = simulate(scene)
    before = simulation.energy().total
    simulation.advance(0.5)  # one bounce, at 0.4515 s
    work, speed = simulation.measure().work, math.sqrt(2.0 * 9.81)
    tangent = 1.0 - 0.1 * 1.5 * speed
    assert simulation.velocities()[0] == pytest.approx([tangent, 0.5 * speed - 9.81 * 0.0485], rel=2e-3)
    assert work["collision"] == pytest.approx(-0.5 * 2.0 * (1.0 - 0.25) * speed**2, rel=1e-3)
    assert work["friction"] == pytest.approx(0.5 * 2.0 * (tangent**2 - 1.0), rel=1e-3)
    assert simulation.energy().total - before == pytest.approx(sum(work.values()), rel=1e-3)


def test_a_body_slides_on_a_slope_by_coulomb(simulate):
    """a = g (sin - mu cos), at long steps too; below the limit it stays."""
    angle, g = math.atan(0.4), 9.81
    flat = {**square(youngs_modulus=1e6, damping_ratio=0.3), "position": [0.0, 0.125]}
    flat["shape"] = {"kind": "box", "size": [1.0, 0.25], "cells": [8, 2]}
    speeds = []
    for friction in (0.2, 0.5):
        scene = make_scene(
            dimension=2,
            gravity=[g * math.sin(angle), -g * math.cos(angle)],
            solver=solver(1 / 120, 30),
            bodies=[flat],
            colliders=[{**FLOOR, "friction": friction, "restitution": 0.3}],
        )
        simulation = simulate(scene)
        simulation.advance(1.0)
        speeds.append(simulation.velocities()[:, 0].mean())
    assert speeds[0] == pytest.approx(g * (math.sin(angle) - 0.2 * math.cos(angle)), rel=0.03)
    assert abs(speeds[1]) < 0.02


# -- books, paths, extremes ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(SMOOTH))
def test_what_the_ledger_leaves_over_shrinks_with_the_step(simulate, name):
    """That of implicit Euler, which damps by itself: of first order, and always a loss."""
    steps = (8e-5, 4e-5, 2e-5)
    left, scene = [], SMOOTH[name]
    simulation = simulate(make_scene(dimension=2, solver=solver(1e-4, 4), diagnostics={"ledger": True}, **scene))
    for dt in steps:
        simulation.restore()
        simulation.dt = dt
        balance = EnergyBalance(simulation.measure())
        for _ in range(10):
            simulation.advance(0.02)
            balance.add(simulation.measure())
        left.append(balance.unexplained)
    assert -0.05 * balance.moved < left[0] < 0.0
    assert math.log(left[0] / left[-1]) / math.log(4.0) == pytest.approx(1.0, abs=0.3)


def zoo():
    """Everything at once, in f32: springs of several laws, gas, wind, a moving collider that carries, contact."""
    jelly = {**square(cells=5), "position": [0.0, 0.6]}
    jelly.update(radius=0.04, rotation=20.0)
    ring = {
        "name": "ring", "position": [1.2, 0.7], "radius": 0.03,
        "shape": {"kind": "ring", "radius": 0.4, "segments": 24}, "material": {"stiffness": 500.0, "mass": 2.0},
        "pressure": {"gauge_pressure": 300.0, "ambient": 1000.0, "leak": 0.1},
    }  # fmt: skip
    rope = {
        "name": "rope", "material": {"stiffness": 400.0, "damping": 0.3, "mass": 0.5, "tension_only": True},
        "shape": {"kind": "rope", "from": [0.0, 1.6], "to": [1.0, 1.7], "segments": 8, "thickness": 0.02},
    }  # fmt: skip
    hand = {
        "name": "hand", "kind": "sphere", "position": [0.0, 1.6], "radius": 0.05,
        "motion": [{"time": 0.0}, {"time": 0.5, "position": [0.4, 1.8], "rotation": 90.0}],
    }  # fmt: skip
    return make_scene(
        dimension=2, gravity=[0.0, -9.81], drag=0.2, wind={"velocity": [3.0, 1.0]}, solver=solver(1 / 120, 6, "f32"),
        bodies=[jelly, ring, rope], colliders=[{**FLOOR, "friction": 0.5, "restitution": 0.4}, hand],
        attachments=[{"body": "rope", "indices": [0], "to": "hand"}],
    )  # fmt: skip


def test_paths_and_threads_give_the_same_bits():
    states = []
    for options in ({"serial": True, "threads": 1}, {"serial": False, "threads": 2}):
        simulation = Simulation(zoo(), **options)
        simulation.advance(0.25)
        simulation.advance(0.25)
        states.append(np.concatenate([simulation.positions(), simulation.velocities()]))
        simulation.close()
    assert np.array_equal(states[0], states[1])
    # The rope's end is where the hand carried it.
    end = len(states[0]) // 2 - 9
    assert states[0][end] == pytest.approx([0.4, 1.8], abs=1e-6)


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_bounded_at_the_extremes(simulate, precision):
    """Stiffness over 12 decades, masses over 6, any step: nothing grows beyond what it began with."""
    bodies = []
    for number, (stiffness, light) in enumerate([(1e-3, 1.0), (1e3, 1e-6), (1e6, 1.0), (1e9, 1.0), (1e9, 1e-6)]):
        points = [[0.2 * i, 0.2 * j] for i in range(4) for j in range(4)]
        springs = [[a, b] for a in range(16) for b in range(a) if math.dist(points[a], points[b]) < 0.3]
        masses = [1.0 if (i // 4 + i) % 2 else light for i in range(16)]
        body = custom(points, springs, stiffness=stiffness, damping_ratio=1.0, shape={"masses": masses})
        bodies.append({**body, "name": f"body {number}", "position": [2.0 * number, 1.0]})
    bounds = {"max_strain": 1e9, "max_speed": 1e9}
    scene = make_scene(
        dimension=2, gravity=[0.0, -9.81], solver=solver(0.1, 10, precision), diagnostics=bounds, bodies=bodies,
        colliders=[FLOOR],
    )  # fmt: skip
    simulation = simulate(scene)
    start = simulation.positions()
    rng = np.random.default_rng(2)
    for dt, steps in ((1e-6, 200), (1e-3, 300), (0.1, 100)):
        for stretch, speed in ((1.0, 1e4), (11.0, 0.0), (0.05, 0.0)):
            centre = np.repeat(start.reshape(5, 16, 2).mean(axis=1), 16, axis=0)
            simulation.set_state(centre + stretch * (start - centre) + [0.0, 4.0], speed * rng.normal(size=start.shape))
            simulation.dt = dt
            largest = max(2e4, simulation.measure().max_speed)
            energy = simulation.energy().total
            simulation.advance(steps * dt)
            measured = simulation.measure()
            assert measured.finite
            assert measured.energy.total < 1.01 * energy + 1.0, (dt, stretch, speed)
            assert measured.max_speed < 1e3 * largest, (dt, stretch, speed)
