"""Where a live run and its recording could part: what hands are told, what is compiled, how long steps are."""

import pytest

from sandbox import Simulation, checkpoint
from sandbox.actions.grips import Grips
from sandbox.errors import DivergedError
from sandbox.headless import RunOptions, run
from sandbox.recording import ActionFile, Header, read, with_actions
from sandbox.scene.action_plan import ActionPlan
from sandbox.scene.load import scene_from_data
from sandbox.scene.model import Interaction
from sandbox.session import Session
from tests.conftest import make_scene

_FPS = 47.0


def _scene(**more):
    box = {"kind": "box", "size": [1.0, 1.0], "cells": [4, 4]}
    parts = {
        "dimension": 2,
        "gravity": [0.0, -9.81],
        "solver": {"precision": "f64"},
        "render": {"fps": _FPS},
        "bodies": [
            {"name": "box", "shape": box, "position": [0.0, 0.6], "material": {"youngs_modulus": 1e4, "mass": 10.0}}
        ],
        "colliders": [{"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.5}],
    }
    return make_scene(**(parts | more))


def _again(scene, session, path):
    """What the recording of a session comes to, and the recording."""
    session.write_recording(path / "acts.toml")
    session.simulation.suspend()
    file = read(path / "acts.toml")
    options = RunOptions("again", path / "again", renderer="none", tick=file.recording.tick)
    return run(with_actions(scene, file, "acts.toml"), options), file


def test_a_hand_that_rests_is_told_the_same_in_both(monkeypatch, tmp_path):
    """A recording has a waypoint where a hand rests; to be led from there to there would round it away from there."""
    told = []
    lead = Grips.lead

    def listen(grips, row, segment):
        told.append((row, segment.start, segment.end, *segment.origin.tolist(), *segment.goal.tolist()))
        lead(grips, row, segment)

    monkeypatch.setattr(Grips, "lead", listen)
    scene = _scene()
    session = Session(scene)
    session.advance(3)
    grip = session.grab([0.5, 1.1])
    session.advance(2)
    session.drag(grip, [0.71, 1.23])
    session.advance(2)
    session.advance(5)
    session.drag(grip, [0.47, 1.31])
    session.advance(3)
    session.release(session.grab([-0.5, 0.1]))
    short = session.simulation.scene.actions[-1]
    assert short.end == (session.ticks + 1) * session.tick  # a tick's end, not the start and a tick, rounded
    session.advance(3)
    live = told.copy()
    told.clear()
    summary, file = _again(scene, session, tmp_path)
    assert told == live
    assert summary.state_sha256 == file.recording.state_sha256


@pytest.mark.parametrize("given", [(), ("grab", "push")])
def test_a_recording_is_compiled_for_as_many_hands_as_the_live_run(given):
    """What the scene itself does takes room of its own, live as in the recording."""
    grab = {"kind": "grab", "point": [0.5, 1.1]}
    push = {"kind": "push", "body": "box", "force": [1.0, 0.0]}
    kinds = {"grab": grab, "push": push}
    scene = _scene(actions=[kinds[kind] | {"start": 0.1, "end": 0.4} for kind in given])
    spans = [(0.0, 0.2), (0.05, 0.3), (0.2, 0.5)]
    done = _scene(actions=[kind | {"start": a, "end": b} for a, b in spans for kind in kinds.values()]).actions
    header = Header(tick=0.005, ticks=100, precision="f64")
    for room in (Interaction(), Interaction(grips=3, pushes=5, shakes=0)):
        file = ActionFile(recording=header, interaction=room, actions=done)
        live = ActionPlan.of(scene.model_copy(update={"interaction": room}))
        assert ActionPlan.of(with_actions(scene, file, "acts.toml")) == live


def test_a_hand_goes_on_from_what_it_took(tmp_path):
    """What it was seen to take is pinned before time goes on: it takes what is left, and leads that from there."""
    scene = _scene()
    session = Session(scene)
    session.advance(2)
    region = {"min": [0.3, 0.0], "max": [2.0, 3.0]}
    session.act({"kind": "pin", "time": session.simulation.time, "region": region})
    grip = session.grab([0.3, 1.1], radius=0.35)
    session.advance(3)
    assert grip.point[0] < 0.26
    session.drag(grip, [-0.2, 1.3])
    session.advance(6)
    summary, file = _again(scene, session, tmp_path)
    assert file.actions[1].path[0].position[0] < 0.26
    assert summary.state_sha256 == file.recording.state_sha256


def test_what_went_wrong_and_was_put_right_runs_again(tmp_path):
    """Time stops before its end: the hand is still on its way there, and its waypoints rise."""
    scene = _scene(diagnostics={"max_speed": 50.0})
    session = Session(scene)
    session.advance(2)
    grip = session.grab([0.5, 1.1])
    session.drag(grip, [0.6, 1.2])
    now = session.simulation.time
    session.act({"kind": "poke", "time": now, "point": [0, 0.6], "radius": 3.0, "impulse": [2000.0, 0.0]})
    with pytest.raises(DivergedError):
        session.advance(3)
    session.drag(grip, [0.5, 1.3])
    session.act({"kind": "pin", "time": now, "body": "box"})
    session.advance(1)
    session.act({"kind": "unpin", "time": session.simulation.time, "body": "box"})
    for place in ([0.4, 1.2], [0.3, 1.3], [0.5, 1.4]):
        session.drag(grip, place)
        session.advance(3)
    summary, file = _again(scene, session, tmp_path)
    times = [waypoint.time for waypoint in file.actions[0].path]
    assert times == sorted(set(times)) and len(times) >= 3
    assert summary.state_sha256 == file.recording.state_sha256


def test_a_solver_that_was_changed_on_the_way_is_there_again_after_a_restart_and_a_checkpoint(simulate, tmp_path):
    poke = {"kind": "poke", "time": 0.07, "point": [0, 0.6], "radius": 3.0, "impulse": [3.0, 1.0]}
    pin = {"kind": "pin", "time": 0.05, "region": {"min": [-1.0, -1.0], "max": [1.0, 0.2]}}
    solver = {"kind": "solver", "time": 0.03, "integrator": "velocity_verlet"}
    scene = _scene(actions=[solver, pin, poke])
    first = simulate(scene)
    hashes = []
    for _ in range(2):
        first.advance(0.06)
        first.save(tmp_path / f"{len(hashes)}.npz")
        first.advance(0.06)
        hashes.append(first.state_hash())
        first.restore()
    assert hashes[0] == hashes[1]
    resumed = simulate(scene_from_data(scene.model_dump(mode="json", exclude_none=True), None))
    resumed.resume(checkpoint.read(tmp_path / "0.npz"))
    assert resumed.scene.solver.integrator == "velocity_verlet"
    resumed.advance(0.06)
    assert resumed.state_hash() == hashes[0]
    loaded = Simulation.load(tmp_path / "1.npz")
    loaded.advance(0.06)
    assert loaded.state_hash() == hashes[0]
    loaded.suspend()
