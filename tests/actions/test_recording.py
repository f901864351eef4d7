"""A recording runs again to the same bits, and files of actions never bring a traceback or a NaN."""

import math
import tomllib

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sandbox.errors import SceneError
from sandbox.headless import RunOptions, run
from sandbox.recording import read, with_actions
from sandbox.scene.load import scene_from_data
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


# Taichi's threads flush subnormal numbers to zero, Python's then too.
# -- anything at all ----------------------------------------------------------------------------------

_times = st.floats(0.0, 0.25, allow_subnormal=False)
_places = st.floats(-2.0, 2.0, allow_subnormal=False)
_vectors = st.tuples(_places, _places)
_forces = st.tuples(*[st.floats(-1e9, 1e9, allow_subnormal=False)] * 2)
_bodies = st.sampled_from(["box", "nobody"])
_odd = st.sampled_from([0, -1, 1e300, "x", [], [1.0], None, True, math.inf, math.nan])
_fields = {
    "time": _times, "start": _times, "end": _times, "body": _bodies, "point": _vectors, "radius": st.floats(0.01, 3.0),
    "force": _forces, "impulse": _forces, "amplitude": _vectors, "frequency": st.floats(0.1, 1e4),
    "velocity": _vectors, "normal": _vectors, "from": _vectors, "to": _vectors, "factor": st.floats(1e-4, 1e4),
    "indices": st.lists(st.integers(0, 30), max_size=3), "stiffness": st.floats(1.0, 1e12),
    "max_force": st.floats(1.0, 1e12), "dt": st.floats(1e-4, 1.0),
    "amount": st.floats(-1.0, 1.0, allow_subnormal=False),
    "integrator": st.sampled_from(["symplectic_euler", "rk4", "nonsense"]),
    "path": st.lists(st.fixed_dictionaries({"time": _times, "position": _vectors}), max_size=3),
}  # fmt: skip
_needed = {
    "grab": ("start", "end", "point"), "poke": ("time", "point", "radius", "impulse"),
    "push": ("start", "end", "body", "force"), "shake": ("start", "end", "amplitude", "frequency"),
    "wind": ("start", "end", "velocity"), "cut": ("time", "point", "normal"), "pin": ("time", "body"),
    "unpin": ("time", "body"), "stiffen": ("time", "factor"), "soften": ("start", "end", "factor"),
    "spawn": ("time", "body"), "move": ("body", "path"), "solver": ("time", "dt"), "pump": ("start", "end", "body"),
}  # fmt: skip


@st.composite
def actions(draw):
    """An action that is right but for what chance makes of it."""
    kind = draw(st.sampled_from(sorted(_needed)))
    names = {*_needed[kind], *draw(st.lists(st.sampled_from(sorted(_fields)), max_size=1))}
    action = {name: draw(_odd if draw(st.integers(0, 19)) == 0 else _fields[name]) for name in sorted(names)}
    return {"kind": kind} | {name: value for name, value in action.items() if value is not None}


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(actions(), max_size=4))
def test_any_file_is_taken_or_refused_with_one_line(done):
    data = _scene().model_dump(mode="json", exclude_none=True)
    try:
        scene = scene_from_data(data | {"actions": done}, None, source="fuzz")
    except SceneError as error:
        assert "\n" not in str(error) and "actions" in str(error)
        return
    assert (
        scene_from_data(tomllib.loads(tomli_w.dumps(scene.model_dump(mode="json", exclude_none=True))), None) == scene
    )


@pytest.fixture(scope="module")
def opened():
    session = Session(_scene(diagnostics={"max_speed": 1e4}))
    yield session
    session.simulation.suspend()


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(actions(), min_size=1, max_size=4))
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_whatever_is_done_the_state_is_finite(opened, done):
    """The state is good, or the run stops with one line and the last good state."""
    from sandbox.errors import SandboxError

    opened.reset()
    try:
        for action in done:
            if action["kind"] != "solver":  # compiles
                opened.act(action)
        opened.advance(60)
    except SandboxError as error:
        assert "\n" not in str(error)
    assert np.isfinite(opened.simulation.positions()).all()
    assert np.isfinite(opened.simulation.velocities()).all()
    assert math.isfinite(opened.simulation.energy().total)
