"""A window under a synthetic mouse: what is recorded runs again to the same bits."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib

import numpy as np
import pytest
import tomli_w
from PIL import ImageGrab, features

from sandbox import runtime
from sandbox.render.ggui.process import DriverError
from sandbox.render.ggui.renderer import GguiRenderer
from sandbox.scene.assemble import assemble
from sandbox.scene.model import Render
from tests.conftest import falling_point, heed_interrupts

SANDBOX = [sys.executable, "-m", "sandbox"]
LONGEST = 120.0
"""Longest time that anything here may take [s]."""


@pytest.fixture
def driver():
    """Skips where there is no driver, or no way to see the screen."""
    runtime.start(arch="cpu", precision="f32")
    point = falling_point(velocity=(0.0, 0.0, 0.0), position=(0.0, 1.0, 0.0))
    try:
        GguiRenderer(assemble(point).appearance, Render(size=(32, 32))).close()
    except DriverError as error:
        pytest.skip(f"{error}; Debian's mesa-vulkan-drivers has one that needs no GPU")
    if not features.check("xcb"):
        pytest.skip("this Pillow cannot read a screen")


class Hand:
    """A mouse and keys on a screen, and the eye that looks for the body."""

    def __init__(self, environment):
        self.environment = environment

    def do(self, *arguments):
        subprocess.run(["xdotool", *map(str, arguments)], env=self.environment, check=True, timeout=LONGEST)

    def see(self):
        """Middle of what is red on the screen [pixels]; None where nothing is."""
        picture = np.asarray(ImageGrab.grab(xdisplay=self.environment["DISPLAY"])).astype(int)
        red = picture[..., 0] - np.maximum(picture[..., 1], picture[..., 2]) > 60
        if np.count_nonzero(red) < 500:
            return None
        return np.argwhere(red).mean(axis=0)[::-1].round().astype(int)

    def find(self, process):
        """The same, once there is something."""
        end = time.monotonic() + LONGEST
        while (place := self.see()) is None:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end, "no body was ever seen"
            time.sleep(0.2)
        return place

    def drag(self, place, way):
        """Press the left button at a place, move along a way [pixels], let go."""
        self.do("mousemove", *place)
        time.sleep(0.2)
        self.do("mousedown", 1)
        time.sleep(0.2)
        for k in range(1, 11):
            self.do("mousemove", *(np.asarray(place) + np.asarray(way) * k // 10))
            time.sleep(0.04)
        time.sleep(0.2)
        self.do("mouseup", 1)


@pytest.fixture
def play(screen, driver, tmp_path):
    started = []

    def start(*arguments):
        command = [*SANDBOX, "play", *map(str, arguments)]
        process = subprocess.Popen(
            command, env=screen, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=heed_interrupts,
        )  # fmt: skip
        started.append(process)
        return process, Hand(screen)

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def test_what_a_mouse_did_runs_again_to_the_same_bits(play, jelly_file, tmp_path):
    record = tmp_path / "actions.toml"
    process, hand = play(jelly_file, "--size", "960x600", "--record", record)
    place = hand.find(process)
    hand.drag(place, (60, -120))
    hand.do("key", "q")
    printed, errors = process.communicate(timeout=LONGEST)
    assert (process.returncode, errors) == (0, "")
    recording = tomllib.loads(record.read_text(encoding="utf-8"))
    (grab,) = recording["actions"]
    assert grab["kind"] == "grab" and len(grab["path"]) >= 2
    # The hand went up: so did what it held.
    assert grab["path"][-1]["position"][1] > grab["path"][0]["position"][1] + 0.05
    assert recording["recording"]["state_sha256"][:16] in printed
    for number in range(2):
        command = ["run", jelly_file, "--actions", record, "--renderer", "none", "--json", "--out", f"run{number}"]
        done = subprocess.run(
            [*SANDBOX, *map(str, command)], cwd=tmp_path, capture_output=True, text=True, timeout=LONGEST
        )
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["state_sha256"] == recording["recording"]["state_sha256"]


SPRINGS = {"stiffness": 1e3, "mass": 0.1}
BARE = {
    "rope": {"kind": "rope", "from": [0, 1, 0], "to": [1, 1, 0], "segments": 9},
    "point": {"kind": "custom", "points": [[0, 1, 0]], "masses": [1]},
    "ring": {"kind": "ring", "radius": 0.4, "segments": 13},
    "late": {"kind": "ball", "radius": 0.4, "cells": 3},
}
"""All that a scene has: some have no surface, some lie in the plane, one enters later."""


@pytest.mark.parametrize("name", BARE)
def test_a_window_opens_on_any_scene(play, tmp_path, name):
    dimension = 3 if name in ("rope", "point") else 2
    body = {"name": name, "shape": BARE[name], "position": [0, 1, 0][:dimension]}
    scene = {
        "dimension": dimension,
        "bodies": [body if name == "point" else body | {"material": SPRINGS}],
        "colliders": [{"kind": "half_space", "point": [0, 0, 0][:dimension], "normal": [0, 1, 0][:dimension]}],
        "actions": [{"kind": "spawn", "time": 0.5, "body": "late"}] if name == "late" else [],
    }
    (tmp_path / "bare.toml").write_text(tomli_w.dumps(scene), encoding="utf-8")
    process, _ = play(tmp_path / "bare.toml", "--size", "320x200", "--seconds", "1")
    _, errors = process.communicate(timeout=LONGEST)
    assert (process.returncode, errors) == (0, "")


@pytest.mark.parametrize("end", ["interrupt", "crash"])
def test_a_recording_is_written_whatever_ends_the_window(play, jelly_file, tmp_path, end):
    record = tmp_path / "actions.toml"
    process, hand = play(jelly_file, "--size", "640x400", "--record", record)
    hand.find(process)
    if end == "interrupt":
        process.send_signal(signal.SIGINT)
    else:
        children = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True, check=True)
        for pid in children.stdout.split():
            os.kill(int(pid), signal.SIGKILL)
    _, errors = process.communicate(timeout=LONGEST)
    if end == "interrupt":
        assert (process.returncode, errors) == (0, "")
    else:
        assert process.returncode == 1
        assert "the Vulkan driver crashed" in errors and str(record) in errors and errors.count("\n") == 1
    assert tomllib.loads(record.read_text(encoding="utf-8"))["recording"]["ticks"] > 0


def test_without_a_screen_a_line_says_so(run_cli, jelly_file, monkeypatch, tmp_path):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    code, printed, errors = run_cli("play", jelly_file, "--record", tmp_path / "actions.toml")
    assert (code, printed) == (1, "")
    assert "there is no screen here" in errors and errors.count("\n") == 1
    assert not (tmp_path / "actions.toml").exists()


def test_with_a_screen_that_is_not_there_a_line_says_so(driver, run_cli, jelly_file, monkeypatch):
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":4711")
    code, printed, errors = run_cli("play", jelly_file)
    assert (code, printed) == (1, "")
    assert "no window can be opened" in errors and errors.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--record", "nowhere/actions.toml"], "--record nowhere/actions.toml: no such folder"),
        (["--seconds", "0"], "--seconds 0: must be > 0"),
        (["--size", "big"], "--size big: must be WIDTHxHEIGHT"),
    ],
)
def test_wrong_options_are_refused(refuses, jelly_file, arguments, message):
    refuses(message, "play", jelly_file, *arguments)
