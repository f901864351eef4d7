"""What colliders bear in an implicit step, friction and bounces there, and steps that ask for too much."""

import math

import numpy as np
import pytest

from sandbox.integrators.bearing import FREE
from sandbox.integrators.resting import HELD, SLIDING
from tests import analytical
from tests.conftest import falling_point, make_scene

SCHEMES = ("implicit_euler", "implicit_midpoint")


def column(precision: str, dt: float, integrator: str = "implicit_euler"):
    """Six masses one above the other on the floor, that only springs hold up."""
    count = 6
    shape = {
        "kind": "custom", "points": [[0.0, 0.1 * k] for k in range(count)],
        "springs": [[k, k + 1] for k in range(count - 1)], "masses": [0.5] * count,
    }  # fmt: skip
    body = {"name": "column", "position": [0.2, 0.3], "shape": shape}
    body["material"] = {"stiffness": 2e4, "damping_ratio": 0.3}
    floor = {"kind": "half_space", "point": [0.0, 0.25], "normal": [0.0, 1.0], "friction": 0.5}
    solver = {"integrator": integrator, "dt": dt, "precision": precision}
    return make_scene(dimension=2, gravity=[0.0, -9.81], solver=solver, bodies=[body], colliders=[floor])


@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("integrator", SCHEMES)
def test_a_column_stands_on_the_floor_as_high_as_statics_says(simulate, precision, integrator):
    """The floor bears it in the solve: at 1/60 s it neither hovers nor sinks, and no step size changes its height."""
    simulation = simulate(column(precision, 1.0 / 60.0, integrator))
    weights = 0.5 * 9.81 * np.arange(5, 0, -1)
    heights = 0.25 + np.concatenate([[0.0], np.cumsum(0.1 - weights / 2e4)])
    for dt in (1.0 / 60.0, 1.0 / 240.0):
        simulation.restore()
        simulation.dt = dt
        simulation.advance(4.0)
        # The midpoint rule hardly damps what is faster than its steps.
        accuracy = 1e-9 if precision == "f64" and integrator == "implicit_euler" else 1e-6
        assert simulation.positions()[:, 1] == pytest.approx(heights, abs=accuracy)
        assert np.abs(simulation.velocities()).max() < 1e-3
    assert simulation._pipeline.stepper.resting[0].mode.to_numpy().tolist() == [HELD] + [FREE] * 5


def box(angle: float, friction: float, dt: float, velocity: float, integrator: str, **more):
    """A box on a slope of ``angle`` [rad] that falls to the right."""
    body = {
        "name": "box",
        "shape": {"kind": "box", "size": [0.4, 0.2], "cells": [4, 2]},
        "position": [0.1 * math.sin(angle), 0.1 * math.cos(angle)],
        "rotation": -math.degrees(angle),
        "velocity": [velocity * math.cos(angle), -velocity * math.sin(angle)],
        "material": {"youngs_modulus": 1e6, "damping_ratio": 0.3},
    }
    slope = {"kind": "half_space", "point": [0, 0], "normal": [math.sin(angle), math.cos(angle)], "friction": friction}
    solver = {"integrator": integrator, "dt": dt, "precision": "f64"}
    return make_scene(dimension=2, gravity=[0.0, -9.81], solver=solver, bodies=[body], colliders=[slope], **more)


@pytest.mark.parametrize(("integrator", "dt"), [("implicit_euler", 1.0 / 60.0), ("implicit_midpoint", 1e-3)])
def test_friction_holds_a_box_or_lets_it_slide_as_coulomb_says(simulate, integrator, dt):
    angle = math.radians(25.0)
    down = np.array([math.cos(angle), -math.sin(angle)])
    simulation = simulate(box(angle, 0.6, dt, 0.0, integrator))
    simulation.advance(1.0)
    settled = simulation.positions()
    simulation.advance(2.0)
    assert np.abs(simulation.positions() - settled).max() < 1e-4  # tan 25 degrees = 0.47 < 0.6
    simulation.close()
    simulation = simulate(box(angle, 0.2, dt, 1.0, integrator))
    before = simulation.positions().mean(axis=0)
    simulation.advance(1.0)
    speed = float((simulation.velocities().mean(axis=0) * down).sum())
    assert speed == pytest.approx(analytical.sliding(1.0, angle, 0.2, 9.81, 1.0), rel=0.01)
    way = float(((simulation.positions().mean(axis=0) - before) * down).sum())
    assert way == pytest.approx(0.5 * (1.0 + speed), rel=0.02)
    assert (simulation._pipeline.stepper.resting[0].mode.to_numpy() == SLIDING).sum() == 5


def test_friction_and_drive_close_the_ledger(simulate):
    scene = box(0.0, 0.3, 1e-3, 2.0, "implicit_euler", diagnostics={"ledger": True})
    simulation = simulate(scene)
    before = simulation.energy().total
    simulation.advance(1.0)  # it stops after 2 / (0.3 g) = 0.68 s
    work = simulation.measure().work
    mass = simulation.assembly.masses.sum()
    assert np.abs(simulation.velocities()).max() < 1e-3
    assert work["friction"] == pytest.approx(-0.5 * mass * 4.0, rel=0.02)
    assert simulation.energy().total - before == pytest.approx(sum(work.values()), abs=0.005 * mass)


@pytest.mark.parametrize("integrator", SCHEMES)
def test_what_falls_bounces_by_its_restitution(simulate, integrator):
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "restitution": 0.5}
    solver = {"integrator": integrator, "dt": 1e-3, "precision": "f64"}
    simulation = simulate(falling_point(gravity=[0.0, -9.81], solver=solver, colliders=[floor]))
    fall = math.sqrt(2.0 / 9.81)
    simulation.advance(1.5 * fall)  # down, and up to a quarter of the height
    assert simulation.positions()[0, 1] == pytest.approx(0.25, abs=0.01)
    simulation.advance(3.0)
    # At rest, but for bounces no higher than a step of gravity.
    assert simulation.positions()[0, 1] == pytest.approx(0.0, abs=9.81 * 1e-6)
    assert abs(simulation.velocities()[0, 1]) < 9.81 * 1e-3


def test_what_rests_on_a_lift_goes_along_and_what_is_pulled_up_comes_off(simulate):
    """A lift that stops at its top at once: what rests on it flies on, nothing holds it down."""
    lift = {
        "name": "lift", "kind": "box", "position": [0.0, 0.0], "size": [1.0, 0.2], "friction": 0.5,
        "motion": [{"time": 0.0}, {"time": 1.0, "position": [0.3, 1.0]}, {"time": 3.0, "position": [0.3, 1.0]}],
        "interpolation": "linear",
    }  # fmt: skip
    solver = {"integrator": "implicit_euler", "dt": 0.01, "precision": "f64"}
    scene = falling_point(position=(0.0, 0.1), gravity=[0.0, -9.81], solver=solver, colliders=[lift])
    simulation = simulate(scene)
    for time in (0.3, 0.6, 0.9):
        simulation.advance(time - simulation.time)
        assert simulation.positions()[0, 1] == pytest.approx(0.1 + time, abs=1e-3)
    simulation.advance(0.15)
    top = simulation.positions()[0, 1]
    assert top > 1.1 + 0.02
    simulation.advance(1.0)
    assert simulation.positions()[0, 1] == pytest.approx(1.1, abs=1e-6)


EXTREMES = [
    {"dt": 0.1, "stiffness": 1e9, "ratio": 1e-6},
    {"dt": 1.0 / 60.0, "stiffness": 1e9, "ratio": 1e6, "speed": 1e4, "strain": 9.0, "damping_ratio": 10.0},
    {"dt": 1.0 / 60.0, "stiffness": 1e6, "strain": 9.0},
    {"dt": 1e-6, "stiffness": 1e9, "speed": 1e4},
    {"dt": 0.1, "stiffness": 1e-3, "ratio": 1e6, "damping_ratio": 10.0, "speed": 1e4},
]


@pytest.mark.parametrize("extreme", EXTREMES, ids=[str(k) for k in range(len(EXTREMES))])
def test_nothing_that_is_asked_for_makes_energy_or_hangs(simulate, extreme):
    """In f32, with a floor: a lattice of 4 x 4 masses, every third of them heavier or lighter by ``ratio``."""
    points = [[0.25 * (k % 4), 0.25 * (k // 4)] for k in range(16)]
    ends = [(a, b) for a in range(16) for b in range(a) if math.dist(points[a], points[b]) < 0.4]
    speed, strain = extreme.get("speed", 0.0), extreme.get("strain", 0.0)
    shape = {
        "kind": "custom", "points": [[(1.0 + strain) * c for c in point] for point in points], "springs": ends,
        "rest_lengths": [math.dist(points[a], points[b]) for a, b in ends],
        "masses": [1.0 if k % 3 else extreme.get("ratio", 1.0) for k in range(16)],
    }  # fmt: skip
    body = {"name": "body", "position": [0.0, 0.6], "velocity": [0.3 * speed, -speed], "shape": shape}
    body["material"] = {"stiffness": extreme["stiffness"], "damping_ratio": extreme.get("damping_ratio", 0.0)}
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.3}
    scene = make_scene(
        dimension=2,
        gravity=[0.0, -9.81],
        solver={"integrator": "implicit_euler", "dt": extreme["dt"]},
        diagnostics={"max_strain": 1e6, "max_speed": 1e9},
        bodies=[body],
        colliders=[floor],
    )
    simulation = simulate(scene)
    first = simulation.energy().total
    for _ in range(10):
        simulation.advance(4 * extreme["dt"])
        assert simulation.energy().total < 1.01 * first
        assert simulation.measure().finite
    report = simulation._pipeline.stepper.report()
    assert report["newton_most"] <= 40 and report["unfinished"] < 0.2
