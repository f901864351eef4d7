"""A recording runs again to the same bits, and files of actions never bring a traceback or a NaN."""

import tomllib

import pytest

from sandbox.headless import RunOptions, run
from sandbox.recording import read, with_actions
from sandbox.session import Session
from tests.conftest import make_scene


def _scene(precision="f32", **more):
    box = {"kind": "box", "size": [1.0, 1.0], "cells": [4, 4]}
    parts = {
        "dimension": 2,
        "gravity": [0.0, -9.81],
        "solver": {"precision": precision},
        "render": {"fps": 50.0},
        "bodies": [
            {"name": "box", "shape": box, "position": [0.0, 0.6], "material": {"youngs_modulus": 1e4, "mass": 10.0}}
        ],
        "colliders": [{"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.5}],
    }
    return make_scene(**(parts | more))


def _play(session) -> None:
    """Some of everything that can be done live, at uneven times."""
    session.advance(7)
    grip = session.grab([0.5, 1.1])
    other = session.grab([-0.5, 0.1])
    session.drag(other, other.point)
    for step in range(9):
        session.drag(grip, [0.5 + 0.03 * step, 1.1 + 0.02 * step])
        session.advance(1 + step % 4)
    session.act({"kind": "poke", "time": session.simulation.time, "point": [0, 0.6], "radius": 0.4, "impulse": [3, 2]})
    session.release(other)
    session.scale_material("box", 1.7)
    session.advance(3)
    session.release(session.grab([0.0, 0.6]))
    session.change_solver("velocity_verlet")
    session.act({"kind": "cut", "time": session.simulation.time + 0.05, "point": [0.1, 0], "normal": [1, 0.2]})
    session.advance(20)
    session.drag(grip, [0.0, 1.0])
    session.advance(6)


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_a_recording_runs_again_to_the_same_bits(precision, tmp_path):
    scene = _scene(precision)
    session = Session(scene)
    _play(session)
    session.write_recording(tmp_path / "acts.toml")
    header = tomllib.loads((tmp_path / "acts.toml").read_text())["recording"]
    assert header["state_sha256"] == session.simulation.state_hash()
    session.simulation.suspend()
    file = read(tmp_path / "acts.toml")
    acted = with_actions(scene, file, "acts.toml")
    for number in range(2):
        options = RunOptions("again", tmp_path / str(number), renderer="none", tick=file.recording.tick)
        summary = run(acted, options)
        assert summary.state_sha256 == header["state_sha256"]
        assert summary.simulated == header["tick"] * header["ticks"]


def test_a_reset_begins_the_record_anew(tmp_path):
    session = Session(_scene())
    _play(session)
    session.reset()
    assert session.recording().actions == ()
    session.advance(5)
    undisturbed = session.simulation.state_hash()
    session.reset()
    _play(session)
    first = session.simulation.state_hash()
    session.reset()
    session.advance(5)
    assert session.simulation.state_hash() == undisturbed
    session.reset()
    _play(session)
    assert session.simulation.state_hash() == first
    session.simulation.suspend()


def test_a_recording_of_another_scene_is_told(tmp_path):
    session = Session(_scene())
    session.advance(2)
    session.write_recording(tmp_path / "acts.toml")
    session.simulation.suspend()
    with pytest.warns(UserWarning, match="was recorded in another scene"):
        with_actions(_scene(gravity=[0.0, -1.0]), read(tmp_path / "acts.toml"), "acts.toml")


def test_what_comes_too_late_is_told(tmp_path):
    push = {"kind": "push", "start": 0.5, "end": 0.6, "body": "box", "force": [1.0, 0.0]}
    with pytest.warns(UserWarning, match=r"actions\[0\]: begins at 0.5 s, when the run is over \(0.02 s\)"):
        run(_scene(duration=0.02, actions=[push]), RunOptions("late", tmp_path / "out", renderer="none"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("actions = 3", "acts.toml: actions: must be a list, got 3"),
        ("[[actions]]\nkind = 'poke'", "acts.toml: actions[0].point: is required"),
        ("[recording]\ntick = 0", "acts.toml: recording.tick: must be > 0, got 0"),
        ("surprise = 1", "acts.toml: surprise: unknown key"),
        ("= 1", "acts.toml: is not TOML"),
    ],
)
def test_a_broken_file_is_one_line(text, message, refuses, tmp_path):
    (tmp_path / "acts.toml").write_text(text)
    refuses(message, "run", "drop_2d", "--actions", tmp_path / "acts.toml")
    refuses(message, "validate", "drop_2d", "--actions", tmp_path / "acts.toml")
