"""Vertex block descent: what its sweeps converge to, how fast, and what holds however few they are."""

import math

import numpy as np
import pytest

from tests.conftest import falling_point, make_scene, oscillator
from tests.test_ledger import SMOOTH, unexplained

OMEGA = math.sqrt(1000.0)


def solver(sweeps: int = 10, dt: float = 1 / 60, **more) -> dict:
    return {"integrator": "vbd", "dt": dt, "precision": "f64", "iterations": sweeps, **more}


def box(cells=(5, 4), youngs_modulus: float = 1e5, **more) -> dict:
    material = {"youngs_modulus": youngs_modulus, "damping_ratio": 0.05, "density": 100.0}
    return {
        "name": "box",
        "shape": {"kind": "box", "size": [1.0, 1.0], "cells": list(cells)},
        "material": material,
        **more,
    }


def ring(ambient: float = 1000.0, **more) -> dict:
    return {
        "name": "ring",
        "shape": {"kind": "ring", "radius": 0.5, "segments": 24},
        "material": {"stiffness": 500.0, "damping": 0.5, "mass": 2.0},
        "pressure": {"gauge_pressure": 300.0, "ambient": ambient},
        **more,
    }


FLYING = {"velocity": [1.0, -2.0], "angular_velocity": 3.0}


def after(simulate, scene, seconds: float, **options):
    simulation = simulate(scene, **options)
    simulation.advance(seconds)
    return simulation


# -- what it converges to -------------------------------------------------------------------------------


@pytest.mark.parametrize("zeta", [0.0, 0.3])
@pytest.mark.parametrize("dt", [1e-3, 1 / 60])
def test_one_particle_matches_implicit_euler_exactly(simulate, dt, zeta):
    """Amplitude factor 1 / sqrt(1 + w^2 h^2) a step and frequency atan(w h) / h without damping, see CASES."""
    steps = 50
    simulation = after(simulate, oscillator("vbd", dt, zeta), steps * dt)
    matrix = np.array([[1.0, -dt], [OMEGA**2 * dt, 1.0 + 2.0 * zeta * OMEGA * dt]])
    x, v = np.linalg.matrix_power(np.linalg.inv(matrix), steps) @ [0.5, 0.0]
    if zeta == 0.0:
        factor = (1.0 + (OMEGA * dt) ** 2) ** (-0.5 * steps)
        assert x == pytest.approx(0.5 * factor * math.cos(steps * math.atan(OMEGA * dt)), abs=1e-13)
    assert simulation.positions()[1, 0] - 1.0 == pytest.approx(x, abs=1e-12)
    assert simulation.velocities()[1, 0] == pytest.approx(v, abs=1e-12 * OMEGA)
    assert simulation.positions()[0].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("body", [box((5, 4), 3e4, **FLYING), ring(velocity=[0.0, 2.0])], ids=["jelly", "ring"])
def test_the_residual_falls_with_every_sweep_and_the_states_converge(simulate, body):
    residuals, places = [], []
    for sweeps in (1, 3, 10, 100):
        simulation = after(simulate, make_scene(dimension=2, solver=solver(sweeps), bodies=[body]), 1 / 60)
        residuals.append(simulation.solver_report()["residual"])
        places.append(simulation.positions())
        simulation.close()
    assert residuals[0] > 1.3 * residuals[1] > 2.0 * residuals[2] and residuals[3] < 1e-10
    errors = [np.abs(place - places[-1]).max() for place in places[:-1]]
    assert errors[0] > errors[1] > errors[2] and errors[2] < 1e-3 * 2.0 / 60.0


def test_a_stiff_gas_takes_no_more_sweeps(simulate):
    """1 bar around makes the volume 80 times as stiff as the ring is heavy; colour by colour 100 sweeps were few."""
    scene = make_scene(dimension=2, solver=solver(12), bodies=[ring(ambient=1e5, velocity=[0.0, 2.0])])
    simulation = after(simulate, scene, 1 / 6)
    assert simulation.solver_report()["largest_residual"] < 1e-9


def test_chebyshev_speeds_up_a_stiff_body(simulate):
    left = []
    for radius in (0.0, 0.95):
        made = make_scene(dimension=2, solver=solver(150, chebyshev=radius), bodies=[box((8, 8), 1e6, **FLYING)])
        left.append(after(simulate, made, 1 / 60).solver_report()["residual"])
    assert left[1] < 0.3 * left[0]


# -- what holds however few the sweeps are --------------------------------------------------------------


def test_a_free_body_keeps_its_momentum_and_falls_like_a_stone_after_one_sweep(simulate):
    stiff = box((5, 4), 1e7, **FLYING)
    few, many = (
        after(simulate, make_scene(dimension=2, gravity=[0.0, -9.81], solver=solver(n), bodies=[stiff]), 0.5)
        for n in (1, 200)
    )
    assert few.momentum() == pytest.approx([100.0, -200.0 - 9.81 * 0.5 * 100.0], rel=1e-12)
    assert few.angular_momentum() == pytest.approx(many.angular_momentum(), rel=5e-3)


def test_a_cube_keeps_its_momentum_in_3d(simulate):
    body = {
        "name": "box",
        "velocity": [1.0, -2.0, 0.5],
        "angular_velocity": [1.0, 2.0, 3.0],
        "shape": {"kind": "box", "size": [1.0, 1.2, 0.8], "cells": [3, 4, 2]},
        "material": {"stiffness": 1e5, "mass": 10.0},
    }
    few, many = (after(simulate, make_scene(dimension=3, solver=solver(n), bodies=[body]), 0.2) for n in (2, 200))
    assert few.momentum() == pytest.approx([10.0, -20.0, 5.0], rel=1e-12)
    assert few.angular_momentum() == pytest.approx(many.angular_momentum(), rel=5e-3)


@pytest.mark.parametrize("stiffness", [1e-3, 1e3, 1e9])
@pytest.mark.parametrize("dt", [1e-6, 1e-3, 0.1])
def test_it_stays_bounded_in_extremes(simulate, stiffness, dt):
    """Thrown at a floor at 10 km/s, and blown up to a strain of 10.

    In the step in which only some of its particles meet the floor the body is as long as its way.
    """
    body = {
        "name": "box",
        "position": [0.0, 0.6],
        "velocity": [6e3, -8e3],
        "shape": {"kind": "box", "size": [1.0, 1.0], "cells": [3, 3]},
        "material": {"stiffness": stiffness, "damping_ratio": 0.1, "mass": 1.0},
    }
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.5, "restitution": 0.3}
    simulation = simulate(
        make_scene(
            dimension=2,
            gravity=[0.0, -9.81],
            solver={"integrator": "vbd", "dt": dt},
            bodies=[body],
            colliders=[floor],
            diagnostics={"max_strain": 1e4, "max_speed": 1e6},
        )
    )
    simulation.advance(20 * dt)
    thrown = simulation.measure()
    assert thrown.finite and thrown.max_speed < 1.5e4 and thrown.max_strain < 12.0
    simulation.restore()
    x = simulation.positions()
    x = 11.0 * (x - x.mean(axis=0)) + [0.0, 10.0]
    simulation.set_state(x, 0.0 * x)
    simulation.advance(20 * dt)
    blown = simulation.measure()
    frequency = math.sqrt(8.0 * stiffness * 16.0)  # no spring has more in it than its strain of 10
    assert blown.finite and blown.max_strain < 12.0 and blown.max_speed < 20.0 * frequency + 100.0


# -- colliders ------------------------------------------------------------------------------------------


def test_a_frictionless_floor_pushes_along_its_normal_alone(simulate):
    """A mass on a slanted spring slides on a floor: with the floor for a bearing it moves in one dimension."""
    shape = {
        "kind": "custom",
        "points": [[0.0, -1.0], [1.3, 0.0]],
        "springs": [[0, 1]],
        "rest_lengths": [1.6],
        "masses": [1.0, 1.0],
        "pinned": [0],
    }
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    body = {"name": "pair", "shape": shape, "material": {"stiffness": 1e4}}
    dt, steps = 1 / 60, 10
    scene = make_scene(dimension=2, gravity=[0.0, -1e3], solver=solver(60, dt), bodies=[body], colliders=[floor])
    simulation = after(simulate, scene, steps * dt)
    x, v = 1.3, 0.0
    for _ in range(steps):
        begun, start = v, x
        for _ in range(60):
            x = start + dt * v
            r = math.hypot(x, 1.0)
            force = -1e4 * (1.0 - 1.6 / r) * x
            slope = 1e4 * ((x / r) ** 2 + max(1.0 - 1.6 / r, 0.0) * (1.0 / r) ** 2)
            v -= (v - begun - dt * force) / (1.0 + dt**2 * slope)
        x = start + dt * v
    assert simulation.positions()[1] == pytest.approx([x, 0.0], abs=1e-9)


@pytest.mark.parametrize("friction", [0.2, 0.7])
def test_a_point_on_a_slope_slips_or_holds_as_coulomb_says(simulate, friction):
    angle = math.radians(30.0)
    normal = [math.sin(angle), math.cos(angle)]
    slope = {"kind": "half_space", "point": [0.0, 0.0], "normal": normal, "friction": friction}
    scene = falling_point(position=(0.0, 0.0), gravity=[0.0, -9.81], solver=solver(2, 1e-3), colliders=[slope])
    simulation = after(simulate, scene, 0.5)
    along = simulation.velocities()[0] @ [math.cos(angle), -math.sin(angle)]
    slips = max(math.sin(angle) - friction * math.cos(angle), 0.0)
    assert along == pytest.approx(9.81 * slips * 0.5, abs=1e-9)


def test_a_point_rebounds_with_its_restitution(simulate):
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "restitution": 0.5}
    scene = falling_point(gravity=[0.0, -9.81], solver=solver(3, 1e-3), colliders=[floor])
    simulation = after(simulate, scene, math.sqrt(2.0 / 9.81) + 0.5 * math.sqrt(2.0 / 9.81))
    assert simulation.positions()[0, 1] == pytest.approx(0.25, rel=2e-2)


def test_sweeps_converge_on_what_slides_and_rests_in_a_polygon(simulate):
    """A balloon in a funnel: a particle that meets one side twice, by rounding, once kept every sweep from settling."""
    funnel = {
        "kind": "polygon",
        "points": [[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [0.0, 0.0], [-2.0, 1.0]],
        "friction": 0.2,
    }
    body = ring(1e4, position=[0.1, 0.65])
    parts = {"dimension": 2, "gravity": [0.0, -9.81], "bodies": [body], "colliders": [funnel]}
    simulation = simulate(make_scene(solver=solver(60, 1 / 240), **parts))
    touched = 0
    for _ in range(20):
        simulation.advance(1 / 60)
        assert simulation.solver_report()["residual"] < 1e-6
        touched += (simulation.measure().max_penetration > -1e-9) and simulation.positions()[:, 1].min() < 0.2
    assert touched > 5


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_a_box_rests_on_a_floor_as_it_does_with_small_steps(simulate, friction):
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": friction}
    parts = {
        "dimension": 2,
        "gravity": [0.0, -9.81],
        "drag": 6.0,
        "bodies": [box((6, 6), 3e4, position=[0.0, 0.55])],
        "colliders": [floor],
    }
    small = after(simulate, make_scene(solver={"dt": "auto", "precision": "f64"}, **parts), 6.0)
    large = after(simulate, make_scene(solver=solver(20, 1 / 120), **parts), 6.0)
    # It is 1.6 % lower for its weight; that depends on how friction holds its foot.
    top, wanted = (one.positions()[:, 1].max() for one in (large, small))
    assert top == pytest.approx(wanted, abs=2e-3 if friction > 0.0 else 1e-5)
    assert large.energy().elastic == pytest.approx(small.energy().elastic, rel=0.1 if friction > 0.0 else 1e-3)
    assert large.positions()[:, 1].min() == pytest.approx(0.0, abs=1e-9)


# -- all that a scene can have --------------------------------------------------------------------------

EVERYTHING = {
    "dimension": 2,
    "gravity": [0.0, -9.81],
    "drag": 0.2,
    "wind": {"velocity": [3.0, 1.0]},
    "bodies": [
        ring(position=[0.0, 0.8], radius=0.03, velocity=[0.0, -3.0]),
        box((4, 4), position=[1.4, 0.8], radius=0.05, velocity=[-2.0, 0.0]),
        {
            "name": "rope",
            "shape": {"kind": "rope", "from": [-1.0, 2.0], "to": [1.0, 2.2], "segments": 10, "thickness": 0.02},
            "material": {"stiffness": 4e3, "damping": 0.3, "mass": 0.5, "tension_only": True},
            "pin": {"indices": [10]},
        },
        {
            "name": "clay",
            "position": [3.5, 0.8],
            "velocity": [0.0, -8.0],
            "shape": {"kind": "box", "size": [0.8, 0.8], "cells": [3, 3]},
            "material": {
                "stiffness": 2e3, "damping_ratio": 0.1, "mass": 3.0, "yield_strain": 0.02, "creep": 20.0,
                "max_plastic_strain": 0.5, "break_strain": 0.08,
            },
        },
    ],
    "colliders": [
        {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.5, "restitution": 0.2},
        {
            "name": "hand", "kind": "sphere", "position": [-1.0, 2.0], "radius": 0.05,
            "motion": [{"time": 0.0}, {"time": 0.5, "position": [-0.6, 2.3], "rotation": 90.0}],
        },
    ],
    "attachments": [{"body": "rope", "indices": [0], "to": "hand"}],
}  # fmt: skip


def test_the_number_of_threads_changes_no_bit_with_all_there_is(simulate):
    scene = make_scene(solver=solver(6, 1 / 120, chebyshev=0.8), **EVERYTHING)
    states = []
    for threads in (1, 2):
        simulation = after(simulate, scene, 0.25, serial=False, threads=threads)
        states.append([simulation.positions(), simulation.velocities(), simulation.solver_report()["residual"]])
        assert simulation.measure().torn > 0
        simulation.close()
    assert np.array_equal(states[0][0], states[1][0]) and np.array_equal(states[0][1], states[1][1])
    assert states[0][2] == states[1][2] > 0.0
    rope = states[0][0][24 + 25 : 24 + 25 + 11]
    assert rope[10].tolist() == [1.0, 2.2]
    assert np.linalg.norm(rope[0] - [-0.8, 2.15]) < 0.02  # half way with the hand, give or take its turn


PATHS = {
    "free": {"bodies": [EVERYTHING["bodies"][0], EVERYTHING["bodies"][2]], "wind": EVERYTHING["wind"]},
    "all": EVERYTHING,
}


@pytest.mark.parametrize("name", PATHS)
def test_both_paths_lead_to_the_same_state(simulate, name):
    """To the bit; with colliders but for rounding, as the compiler orders products of theirs as it likes."""
    parts = {"dimension": 2, "gravity": [0.0, -9.81], "drag": 0.2, **PATHS[name]}
    scene = make_scene(solver=solver(6, 1 / 120), **parts)
    one, other = (after(simulate, scene, 0.2, serial=serial).positions() for serial in (True, False))
    if name == "free":
        assert np.array_equal(one, other)
    assert one == pytest.approx(other, abs=1e-12)


def test_a_checkpoint_goes_on_bit_for_bit(simulate, tmp_path):
    scene = make_scene(solver=solver(2), gravity=[0.0, -9.81], dimension=2, bodies=[box(pin={"indices": [0]})])
    simulation = after(simulate, scene, 0.2)
    simulation.save(tmp_path / "half.npz")
    resumed = type(simulation).load(tmp_path / "half.npz")
    for one in (simulation, resumed):
        one.advance(0.2)
    assert np.array_equal(simulation.positions(), resumed.positions())
    resumed.suspend()


@pytest.mark.parametrize("name", ["gas ring in wind", "carried and yielding"])
def test_what_the_ledger_leaves_over_is_of_first_order(simulate, name):
    assert name in SMOOTH
    left, moved = zip(*(unexplained(simulate, name, "vbd", dt) for dt in (2.5e-4, 6.25e-5)), strict=True)
    assert abs(left[0]) < 0.2 * moved[0]
    assert 3.0 < left[0] / left[1] < 5.0


def test_the_ledger_tells_friction_from_the_push_of_a_floor(simulate):
    """A sprung box slides to rest: friction takes what it had, the floor itself next to nothing."""
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.3}
    scene = make_scene(
        dimension=2,
        gravity=[0.0, -9.81],
        solver=solver(30, 1 / 240),
        diagnostics={"ledger": True},
        bodies=[box((3, 3), 1e6, position=[0.0, 0.5], velocity=[1.0, 0.0])],
        colliders=[floor],
    )
    simulation = after(simulate, scene, 1.0)
    work = simulation.measure().work
    assert simulation.measure().max_speed < 0.01
    assert work["friction"] == pytest.approx(-50.0, rel=0.1)
    assert abs(work["collision"]) < 2.0
