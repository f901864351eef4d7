"""What is done to bodies live, against closed forms. One simulation serves all: every test begins with a reset."""

import math

import numpy as np
import pytest

from sandbox import runtime
from sandbox.acting import ActionWarning
from sandbox.actions.event import moments
from sandbox.errors import SceneError
from sandbox.session import Session
from tests.conftest import make_scene

_MASS = 10.0
_DT = 1e-3


def _scene(integrator: str = "symplectic_euler", **more):
    """A square of 1 m and 10 kg without gravity, and a point of 1 kg far from it."""
    box = {"kind": "box", "size": [1.0, 1.0], "cells": [4, 4]}
    point = {"kind": "custom", "points": [[0.0, 0.0]], "masses": [1.0]}
    parts = {
        "dimension": 2,
        "solver": {"dt": _DT, "precision": "f64", "integrator": integrator},
        "diagnostics": {"ledger": True},
        "render": {"fps": 50.0},
        "bodies": [
            {"name": "box", "shape": box, "material": {"youngs_modulus": 1e4, "mass": _MASS, "damping_ratio": 0.1}},
            {"name": "point", "shape": point, "position": [5.0, 0.0]},
        ],
    }
    return make_scene(**(parts | more))


@pytest.fixture(scope="module")
def opened():
    session = Session(_scene())
    yield session
    session.simulation.suspend()


@pytest.fixture
def session(opened):
    opened.reset()
    return opened


def _unexplained(session) -> float:
    """What the books do not explain of the energy there is [J]: at the start there is none."""
    measured = session.simulation.measure()
    return measured.energy.total - sum(measured.work.values())


def _advance(session, seconds: float) -> None:
    session.advance(round(seconds / session.tick))


def test_a_poke_gives_its_impulse_and_books_its_energy(session):
    session.act({"kind": "poke", "time": 0.0, "body": "box", "point": [0, 0], "radius": 3.0, "impulse": [2.0, -1.0]})
    session.advance()
    assert session.simulation.momentum() == pytest.approx([2.0, -1.0], rel=1e-12)
    assert session.simulation.measure().work["action"] == pytest.approx(5.0 / (2.0 * _MASS), rel=1e-12)


def test_a_poke_outside_of_all_bodies_is_told_and_does_nothing(session):
    session.act({"kind": "poke", "time": 0.0, "point": [0, 9], "radius": 0.1, "impulse": [2.0, -1.0]})
    with pytest.warns(ActionWarning, match=r"actions\[0\]: finds nothing to poke"):
        session.advance()
    assert session.simulation.measure().energy.kinetic == 0.0


@pytest.mark.parametrize(
    "action",
    [
        {"kind": "cut", "time": 0.0, "point": [20.0, 0.0], "normal": [1.0, 0.0]},
        {"kind": "cut", "start": 0.0, "end": 0.02, "from": [20.0, 0.0], "to": [20.0, 1.0]},
        {"kind": "grab", "start": 0.0, "end": 0.1, "point": [20.0, 0.0], "radius": 0.1},
        {"kind": "pin", "time": 0.0, "point": [20.0, 0.0], "radius": 0.1},
        {"kind": "stiffen", "time": 0.0, "point": [20.0, 0.0], "radius": 0.1, "factor": 2.0},
    ],
)
def test_what_finds_nothing_is_told(session, action):
    session.act(action)
    with pytest.warns(ActionWarning, match=rf"actions\[0\]: finds nothing to {action['kind']}"):
        _advance(session, 0.05)


def test_a_path_may_begin_with_its_grab(session):
    path = [{"time": 0.0, "position": [5.0, 0.0]}, {"time": 0.5, "position": [5.3, 0.2]}]
    session.act({"kind": "grab", "start": 0.0, "end": 2.0, "point": [5.0, 0.0], "path": path})
    _advance(session, 1.5)
    assert session.simulation.positions()[-1] == pytest.approx([5.3, 0.2], abs=1e-3)


def test_a_push_lasts_as_long_as_it_says(session):
    push = {"kind": "push", "start": 0.1, "end": 0.3, "body": "box", "force": [3.0, 0.0]}
    session.act(push)
    _advance(session, 0.5)
    assert session.simulation.momentum()[0] == pytest.approx(0.6, rel=1e-9)
    speed = 0.6 / _MASS
    assert session.simulation.measure().work["action"] == pytest.approx(0.5 * _MASS * speed**2, rel=0.02)
    assert abs(_unexplained(session)) < 1e-6


def test_pushes_at_one_time_add_up_and_end_by_themselves(session):
    for end, force in ((0.2, [1.0, 0.0]), (0.4, [0.0, 2.0])):
        session.act({"kind": "push", "start": 0.0, "end": end, "body": "point", "force": force})
    _advance(session, 0.5)
    assert session.simulation.momentum() == pytest.approx([0.2, 0.8], rel=1e-9)


def test_shaken_ground_leaves_a_free_point_behind(session):
    """Seen from ground that moves by A sin(w t), it is at A (w t - sin w t)."""
    amplitude, frequency = 0.02, 4.0
    session.act({"kind": "shake", "start": 0.0, "end": 1.0, "amplitude": [amplitude, 0.0], "frequency": frequency})
    _advance(session, 0.6)
    turns = 2.0 * math.pi * frequency * 0.6
    moved = session.simulation.positions()[-1, 0] - 5.0
    assert moved == pytest.approx(amplitude * (turns - math.sin(turns)), rel=3.0 * 2.0 * math.pi * frequency * _DT)


def test_a_hand_brings_a_body_where_it_goes(session):
    grip = session.grab([0.5, 0.5])
    assert grip.body == "box"
    begun = grip.point
    session.drag(grip, begun + np.array([0.4, 0.2]))
    _advance(session, 2.0)
    assert grip.point == pytest.approx(begun + np.array([0.4, 0.2]), abs=2e-3)
    assert abs(_unexplained(session)) < 2e-3 * session.simulation.measure().work["action"] + 1e-9
    session.release(grip)
    _advance(session, 0.1)
    pulled = session.simulation.momentum()
    _advance(session, 0.1)
    assert session.simulation.momentum() == pytest.approx(pulled, abs=1e-9)


def test_a_hand_is_no_stronger_than_it_says(session):
    """A point on a hand that pulls with all its strength is a falling body."""
    grab = {"kind": "grab", "start": 0.0, "end": 1.0, "point": [5.0, 0.0], "stiffness": 1e3, "max_force": 2.0}
    session.act(grab | {"damping_ratio": 0.0, "path": [{"time": 1e-6, "position": [9.0, 0.0]}]})
    _advance(session, 0.5)
    assert session.simulation.positions()[-1, 0] - 5.0 == pytest.approx(0.5 * 2.0 * 0.25, rel=0.01)


def test_hands_are_as_many_as_there_is_room_for(session):
    grips = [session.grab([0.5, 0.5]) for _ in range(5)]
    assert [grip is None for grip in grips] == [False] * 4 + [True]
    with pytest.raises(SceneError, match="all hands are full"):
        session.act({"kind": "grab", "start": 0.0, "end": 1.0, "point": [0.0, 0.0]})
    session.advance()
    session.release(grips[0])
    assert session.grab([-0.5, -0.5]) is not None


def test_a_cut_parts_a_body_and_takes_the_energy_of_its_springs(session):
    session.act({"kind": "push", "start": 0.0, "end": 0.2, "region": _box(0.4, 0.6), "force": [40.0, 0.0]})
    session.act({"kind": "push", "start": 0.0, "end": 0.2, "region": _box(-0.6, -0.4), "force": [-40.0, 0.0]})
    session.act({"kind": "cut", "time": 0.1, "body": "box", "point": [0.1, 0.0], "normal": [1.0, 0.0]})
    _advance(session, 0.11)
    torn = session.simulation.measure().torn
    assert torn == 5 + 8  # five rows of springs between two columns, four cells with two diagonals
    assert np.count_nonzero(session.simulation.torn.to_numpy()) == torn
    _advance(session, 1.0)
    x = session.simulation.positions()[:-1, 0]
    assert x.max() - x.min() > 1.5
    assert session.simulation.momentum()[0] == pytest.approx(0.0, abs=1e-9)
    assert session.simulation.measure().max_strain < 0.1
    assert abs(_unexplained(session)) < 0.01


def _box(low: float, high: float) -> dict:
    return {"min": [low, -1.0], "max": [high, 1.0]}


def test_a_blade_cuts_only_where_it_has_been(session):
    session.act({"kind": "cut", "start": 0.0, "end": 0.4, "from": [0.1, -0.6], "to": [0.1, 0.6]})
    torn = []
    for _ in range(4):
        _advance(session, 0.1)
        torn.append(session.simulation.measure().torn)
    assert 0 < torn[0] < torn[1] < torn[2] <= torn[3] == 13


def test_pinned_particles_stay_and_others_do_not(session):
    session.act({"kind": "poke", "time": 0.0, "body": "box", "point": [0, 0], "radius": 3.0, "impulse": [5.0, 0.0]})
    session.act({"kind": "pin", "time": 0.1, "region": _box(-2.0, -0.4)})
    _advance(session, 0.12)
    pinned = session.simulation.positions()[:-1, 0] < -0.35
    before = session.simulation.positions()[:-1][pinned]
    _advance(session, 0.4)
    assert session.simulation.positions()[:-1][pinned].tolist() == before.tolist()
    assert abs(_unexplained(session)) < 0.01
    session.act({"kind": "unpin", "time": session.simulation.time, "body": "box"})
    _advance(session, 0.3)
    assert (session.simulation.positions()[:-1][pinned] != before).any()


def test_stiffening_books_what_it_costs_and_shortens_steps_that_are_chosen():
    stiff = _scene(solver={"precision": "f64"}).model_dump(exclude_none=True)["bodies"]
    stiff[0]["material"]["youngs_modulus"] = 1e6
    with_auto = Session(_scene(solver={"precision": "f64"}, bodies=stiff))
    first = with_auto.simulation.dt
    with_auto.act({"kind": "stiffen", "time": 0.0, "factor": 4.0})
    with_auto.advance()
    assert with_auto.simulation.dt == pytest.approx(first / 2.0, rel=1e-12)
    with_auto.act({"kind": "soften", "time": with_auto.simulation.time, "factor": 0.25})
    with_auto.advance()
    assert with_auto.simulation.dt == pytest.approx(first, rel=1e-12)
    with_auto.simulation.suspend()


def test_stretched_springs_that_stiffen_gain_energy_that_is_booked(session):
    grip = session.grab([0.5, 0.5])
    session.drag(grip, grip.point + np.array([0.3, 0.3]))
    _advance(session, 0.1)
    before = session.simulation.energy().elastic
    session.act({"kind": "stiffen", "time": session.simulation.time, "factor": 1.5})
    worked = session.simulation.measure().work["action"]
    simulation = session.simulation
    simulation.acting.perform_due()
    assert simulation.energy().elastic == pytest.approx(1.5 * before, rel=1e-9)
    assert simulation.measure().work["action"] - worked == pytest.approx(0.5 * before, rel=1e-9)


def test_another_solver_goes_on_from_there_and_the_first_one_is_back_after_a_reset(session):
    session.act({"kind": "poke", "time": 0.0, "body": "box", "point": [0, 0], "radius": 3.0, "impulse": [5.0, 1.0]})
    _advance(session, 0.1)
    session.change_solver("velocity_verlet", 5e-4)
    _advance(session, 0.1)
    assert session.simulation.scene.solver.integrator == "velocity_verlet"
    assert session.simulation.dt == 5e-4
    assert session.simulation.momentum() == pytest.approx([5.0, 1.0], rel=1e-9)
    session.reset()
    assert session.simulation.scene.solver.integrator == "symplectic_euler"
    assert session.simulation.dt == _DT
    assert session.simulation.time == 0.0


@pytest.mark.parametrize("integrator", ["velocity_verlet", "rk4", "implicit_euler", "implicit_midpoint", "xpbd", "vbd"])
def test_a_hanging_body_sags_by_its_weight_over_the_stiffness_of_the_hand(integrator):
    grab = {"kind": "grab", "start": 0.0, "end": 9.0, "point": [0.0, 0.5], "radius": 2.0, "stiffness": 2e3}
    scene = _scene(integrator, gravity=[0.0, -10.0], bodies=[_scene().bodies[0].model_dump()])
    held = Session(scene)
    held.act(grab)
    before = held.simulation.positions()[:, 1].mean()
    _advance(held, 2.0)
    assert before - held.simulation.positions()[:, 1].mean() == pytest.approx(_MASS * 10.0 / 2e3, rel=1e-3)
    assert abs(_unexplained(held)) < 0.02 * _MASS * 10.0 * 0.05
    held.simulation.suspend()


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ({"kind": "spawn", "time": 1.0, "body": "box"}, "a spawn must be in the scene from the start"),
        (
            {"kind": "poke", "time": 0.0, "point": [0, 0], "radius": -1.0, "impulse": [1, 0]},
            "action: radius: must be > 0",
        ),
        ({"kind": "push", "start": 0.0, "end": 1.0, "body": "nobody", "force": [1, 0]}, "there is no body 'nobody'"),
        ({"kind": "push", "start": 0.0, "end": 1.0, "body": "box", "force": [1, 0, 0]}, "must have 2 components"),
    ],
)
def test_what_cannot_be_done_is_one_line(session, action, message):
    with pytest.raises(SceneError, match="(?s)" + message.replace("(", r"\(")):
        session.act(action)


@pytest.mark.parametrize(
    "point",
    [[math.nan, 0.0], [math.inf, 0.0], [0.0], [0.0, 0.0, 0.0], [1e16, 0.0], ["a", "b"], "ab", None, 3.0, {}],
    ids=str,
)
def test_places_that_are_none_are_refused(session, point):
    with pytest.raises(SceneError, match="point: must be 2 numbers of at most 1e"):
        session.grab(point)
    grip = session.grab([0.0, 0.0])
    with pytest.raises(SceneError, match="target: must be 2 numbers"):
        session.drag(grip, point)
    session.drag(grip, np.array([0.1, 0.0], dtype=np.float32))
    session.advance(2)
    assert np.isfinite(session.simulation.positions()).all()


@pytest.mark.parametrize("radius", [math.nan, -1.0, 0.0, "wide", [1.0]], ids=str)
def test_radii_that_are_none_are_refused(session, radius):
    with pytest.raises(SceneError, match="action: radius"):
        session.grab([0.0, 0.0], radius=radius)


@pytest.mark.parametrize(
    ("body", "stiffness"),
    [("box", math.nan), ("box", 0.0), ("box", "hard"), ("box", 10**400), ("box", 1e12), ("nobody", 2.0), ([], 2.0)],
    ids=str,
)
def test_materials_that_are_none_are_refused(session, body, stiffness):
    with pytest.raises(SceneError):
        session.scale_material(body, stiffness)
    assert session.recording().actions == ()


def test_a_cut_that_takes_for_ever_has_parts_all_the_same(session):
    for end in (1.0 / 120.0, 1.0, 1e15):
        times = moments(0.0, end)
        assert (times[0], times[-1]) == (0.0, end) and 2 <= len(times) <= 20_001
    session.act({"kind": "cut", "start": 0.0, "end": 1e15, "from": [3.0, 2.0], "to": [4.0, 2.0]})
    session.advance(2)


def test_a_reset_after_taichi_was_stopped_forgets_what_was_done(session):
    runtime.stop()  # what is asleep remembers a scene in which nothing was done
    session.change_solver(dt=2.0 * _DT)
    session.advance(2)
    runtime.stop()
    session.reset()
    session.advance(1)
    assert session.simulation.time == pytest.approx(session.tick)
    assert session.simulation.scene.solver.dt == _DT
