"""A server of its own that hostile clients speak to, one after the other: it serves all others, and it ends."""

import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="needs the extra web")

from tests.conftest import heed_interrupts
from tests.serve import hostile_crowds  # noqa: F401
from tests.serve.hostile import HOSTILE
from tests.serve.target import Target, pack
from tests.serve.viewer import Viewer

HAS_PROC = Path("/proc/self/status").exists()
pytestmark = pytest.mark.skipif(not HAS_PROC, reason="needs Linux, to see what a process takes")

SCENE = """
dimension = 3
gravity = [0.0, -9.81, 0.0]
[[bodies]]
name = "cube"
position = [0.0, 0.25, 0.0]
shape = { kind = "box", size = [0.5, 0.5, 0.5], cells = [4, 4, 4] }
material = { youngs_modulus = 4e5, damping_ratio = 0.2, density = 1000.0 }
[[colliders]]
kind = "half_space"
point = [0.0, 0.0, 0.0]
normal = [0.0, 1.0, 0.0]
friction = 0.8
"""
MOST_GROWTH = 50e6
"""[bytes]"""


class Served:
    """The process of a server."""

    def __init__(self, folder):
        (folder / "cube.toml").write_text(SCENE)
        self.errors = folder / "errors"
        command = [sys.executable, "-m", "sandbox", "serve", "cube.toml", "--no-shadows", "--port", "0"]
        with self.errors.open("w") as errors:
            self.child = subprocess.Popen(
                command, cwd=folder, stdout=subprocess.PIPE, stderr=errors, text=True, preexec_fn=heed_interrupts
            )
        self.port = int(re.search(r":(\d+)/", self.child.stdout.readline())[1])
        viewer = Viewer(self.port)
        while not {"Time", "cube", "Step [s]", "Save recording", "Integrator"} <= viewer.controls.keys():
            assert viewer.look(10.0)
        viewer.vanish()
        self.target = Target(self.port, viewer.controls)

    def serve_others(self):
        """The page comes, and a browser that resets the scene sees it move."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/", timeout=10.0) as page:
            assert page.status == 200 and b"<script" in page.read()
        viewer = Viewer(self.port, open_timeout=10.0)
        while viewer.updates < 1:
            assert viewer.look(10.0), "nothing is shown"
        viewer.connection.send(pack(self.target.update("Time", "Reset")))
        while viewer.updates < 4:
            assert viewer.look(20.0), "nothing moves"
        viewer.vanish()

    @property
    def memory(self):
        """What the process takes [bytes]."""
        return 1024 * int(re.search(r"VmRSS:\s+(\d+)", self._status)[1])

    @property
    def threads(self):
        return int(re.search(r"Threads:\s+(\d+)", self._status)[1])

    @property
    def descriptors(self):
        return len(list(Path(f"/proc/{self.child.pid}/fd").iterdir()))

    @property
    def _status(self):
        return Path(f"/proc/{self.child.pid}/status").read_text()


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    one = Served(tmp_path_factory.mktemp("hostile"))
    try:
        for _ in range(3):
            one.serve_others()
        one.before = one.memory, one.threads, one.descriptors
        yield one
    finally:
        one.child.kill()
        one.child.wait()


@pytest.mark.parametrize("name", HOSTILE)
def test_others_are_served_meanwhile_and_afterwards(served, name):
    HOSTILE[name](served.target)
    served.serve_others()
    assert served.memory - served.before[0] < MOST_GROWTH


def test_nothing_is_left_of_them_and_the_server_ends(served):
    def left():
        return served.threads - served.before[1], served.descriptors - served.before[2]

    end = time.perf_counter() + 5.0
    while max(left()) > 2 and time.perf_counter() < end:
        time.sleep(0.1)
    assert max(left()) <= 2
    assert served.memory - served.before[0] < MOST_GROWTH
    start = time.perf_counter()
    served.child.send_signal(signal.SIGTERM)
    printed, _ = served.child.communicate(timeout=20.0)
    assert time.perf_counter() - start < 2.0
    assert served.child.returncode == 0
    assert re.fullmatch(r"served [\d.]+ s of simulated time\n", printed)
    assert re.fullmatch(r"warning: refused [\d,]+ messages and [\d,]+ connections: .*\n", served.errors.read_text())
