"""The drawing process, seen from the simulation: started, asked, and given up where it dies."""

import contextlib
import os
import pickle
import queue
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

from sandbox.errors import SandboxError
from sandbox.render.ggui.messages import Failed, Frame, Ready, Refused, Task
from sandbox.render.ggui.shared import SharedArrays

START_SECONDS = 90.0
"""Longest time to a first picture [s]: compiling takes some."""
ANSWER_SECONDS = 60.0
"""Longest time of a picture [s]."""
_GONE = object()
"""Comes after the last answer."""


class DriverError(SandboxError):
    """There is no Vulkan driver that draws, or there no longer is."""


class DrawingProcess:
    """A process that draws with the Vulkan driver."""

    def __init__(self, task: Task, arrays: SharedArrays) -> None:
        """Start it, and wait for its first picture. Raises DriverError where none comes."""
        self._folder = tempfile.TemporaryDirectory(prefix="sandbox-ggui-")
        self._errors = tempfile.TemporaryFile()
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        try:
            self._process = self._started()
            threading.Thread(target=self._listen, daemon=True).start()
            first = self._first_answer(task)
        finally:
            arrays.forget_name()
        if isinstance(first, Refused):
            self.close()
            raise DriverError(f"no Vulkan driver that GGUI can draw with ({first.reason})")
        assert isinstance(first, Ready)

    def _started(self) -> "subprocess.Popen[bytes]":
        root = str(Path(__file__).resolve().parents[3])
        paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
        return subprocess.Popen(
            [sys.executable, "-m", "sandbox.render.ggui.child"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            # GGUI leaves a file with the places of its panels where it is started.
            cwd=self._folder.name,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        )

    def _first_answer(self, task: Task) -> Any:
        try:
            self._send(task)
            return self.answer(START_SECONDS)
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def ask(self, frame: Frame) -> Any:
        """Have a frame drawn, and wait for the answer. Raises DriverError where none comes."""
        self.post(frame)
        return self.answer()

    def post(self, frame: Frame) -> None:
        """Have a frame drawn. Raises DriverError where the process is gone."""
        self._send(frame)

    def answer(self, seconds: float = ANSWER_SECONDS) -> Any:
        """Wait for the next answer, for so long [s]. Raises DriverError where none comes."""
        try:
            answer = self._answers.get(timeout=seconds)
        except queue.Empty:
            raise DriverError(f"the Vulkan driver has not drawn for {seconds:g} s") from None
        if answer is _GONE:
            raise self._death()
        if isinstance(answer, Failed):
            raise DriverError(f"the picture could not be drawn ({answer.reason})")
        return answer

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._errors.close()
        with contextlib.suppress(OSError):
            self._folder.cleanup()

    def _send(self, message: Any) -> None:
        assert self._process.stdin is not None
        try:
            pickle.dump(message, self._process.stdin)
            self._process.stdin.flush()
        except OSError:
            raise self._death() from None

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with contextlib.suppress(EOFError, pickle.UnpicklingError, OSError):
            while True:
                self._answers.put(pickle.load(self._process.stdout))
        self._answers.put(_GONE)

    def _death(self) -> DriverError:
        words = self._last_words()
        if "GLFW" in words:
            return DriverError("no window can be opened on the screen that DISPLAY names")
        return DriverError(f"the Vulkan driver crashed{words}")

    def _last_words(self) -> str:
        """How the process ended, and the last line that it wrote."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5.0)
        code = self._process.returncode
        end = "" if code is None else f" (signal {-code})" if code < 0 else f" (exit code {code})"
        with contextlib.suppress(OSError, ValueError):
            self._errors.seek(0)
            lines = [line.strip() for line in self._errors.read().decode(errors="replace").splitlines()]
            telling = [line for line in lines if "error" in line.lower() or "assert" in line.lower()]
            if last := (telling or [line for line in lines if line])[-1:]:
                return f"{end}: {last[0][:200]}"
        return end
