"""A small jelly over the ground, and a screen that nobody looks at."""

import os
import shutil
import subprocess
from collections.abc import Iterator

import pytest

JELLY = """
title = "Small jelly"
dimension = 3
duration = 3.0
gravity = [0.0, -9.81, 0.0]
[[bodies]]
name = "jelly"
position = [0.0, 0.5, 0.0]
shape = { kind = "box", size = [0.6, 0.6, 0.6], cells = [4, 4, 4] }
material = { youngs_modulus = 5e4, damping_ratio = 0.2 }
[[colliders]]
kind = "half_space"
point = [0.0, 0.0, 0.0]
normal = [0.0, 1.0, 0.0]
friction = 0.5
"""


@pytest.fixture
def jelly_file(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(JELLY, encoding="utf-8")
    return path


@pytest.fixture
def screen() -> Iterator[dict[str, str]]:
    """The environment of programs that have a screen of 1280x800, by Xvfb."""
    for name in ("Xvfb", "xdotool"):
        if shutil.which(name) is None:
            pytest.skip(f"{name} is not installed; Debian has it in {name.lower()}")
    reading, writing = os.pipe()
    # Without -noreset it starts anew, deaf for a moment, whenever the last program lets go of it.
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1280x800x24", "-nolisten", "tcp", "-noreset"]
    server = subprocess.Popen(command, pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(writing)
    try:
        with os.fdopen(reading) as told:
            number = told.readline().strip()
        assert number, "Xvfb did not start"
        yield {**os.environ, "DISPLAY": f":{number}"}
    finally:
        server.terminate()
        server.wait()
