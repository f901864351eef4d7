"""Judges inputs in a process of its own, which may hang, crash or run out of memory for one and is there for the next.

An input is fine where it is taken, or refused by a SandboxError of one short line. All else is a failure: any other
exception, a warning that is not the sandbox's own, anything printed, too much time, too much memory, a crash.
"""

import contextlib
import faulthandler
import multiprocessing
import os
import re
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from pebble import ProcessExpired, ProcessPool

from sandbox.errors import SandboxError
from tests.fuzz import seeds
from tests.fuzz.inputs import Attempt, Input, Kind, Wrong, check_message

MOST_SECONDS = 20.0
"""That an input may take of a processor, so that it does not matter what else the machine does."""
MOST_MEGABYTES = 1000.0
"""That the process may have in memory at once."""
_SPARE = 2.0
"""Time in which a process that hangs says where, before it is ended [s]."""
_ROOT = str(Path(__file__).resolve().parents[2])


@dataclass(frozen=True)
class Verdict:
    """What became of an input."""

    outcome: str
    """refused, failed, or how it was taken."""
    message: str = ""
    """What the user was told, or what went wrong at length."""
    place: str = ""
    """Of a failure: its name and where in the code; the same for inputs that fail alike."""
    seconds: float = 0.0
    """Of a processor; of one that hung, of the clock."""
    megabytes: float = 0.0
    """Most memory that the process had [MB]."""

    @property
    def failed(self) -> bool:
        return self.outcome == "failed"


class Court:
    """One process that judges inputs of some kinds, made anew where it ends."""

    def __init__(self, kinds: Sequence[Kind], longest: float = 3.0 * MOST_SECONDS) -> None:
        """``longest``: time after which a process that is not done counts as hanging [s]."""
        self._longest = longest
        self._folder = tempfile.TemporaryDirectory(prefix="fuzz-")
        self._pool = ProcessPool(
            1,
            context=multiprocessing.get_context("spawn"),
            initializer=_prepare,
            initargs=([kind.prepare for kind in kinds], Path(self._folder.name)),
        )

    def judge(self, kind: Kind, tried: Input) -> Verdict:
        """What becomes of an input."""
        begin = time.perf_counter()
        try:
            arguments = (kind.attempt, tried, self._longest)
            verdict: Verdict = self._pool.schedule(_judge, args=arguments, timeout=self._longest + _SPARE).result()
            return verdict
        except TimeoutError:
            stack = (Path(self._folder.name) / "stack").read_text()
            return Verdict("failed", stack, f"hangs {_innermost(stack)}", time.perf_counter() - begin)
        except ProcessExpired as error:
            return Verdict("failed", str(error), "crashes", time.perf_counter() - begin)

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(TimeoutError, ProcessExpired):
            self._pool.schedule(_rise, timeout=self._longest).result()
        self._pool.stop()
        self._pool.join()
        self._folder.cleanup()


@contextlib.contextmanager
def court(*kinds: Kind) -> Iterator[Court]:
    """A court for a while."""
    opened = Court(kinds)
    try:
        yield opened
    finally:
        opened.close()


# -- in the process that judges --------------------------------------------------------------------------


@dataclass(frozen=True)
class _Bench:
    folder: Path
    printed: IO[bytes]
    stack: IO[str]


_bench: Any = None


def _prepare(preparations: list[Callable[[], object]], folder: Path) -> None:
    """Import and start what every attempt needs; from here on memory is bounded, and what is printed is seen."""
    global _bench
    (folder / seeds.MESH_FILE).write_bytes(seeds.mesh())
    os.chdir(folder)
    for prepare in preparations:
        prepare()
    room = _kilobytes("VmSize") * 1024 + int(MOST_MEGABYTES * 1e6)
    if room > int(MOST_MEGABYTES * 1e6):
        resource.setrlimit(resource.RLIMIT_AS, (room, resource.RLIM_INFINITY))
    # What is appended begins at the start again once a file is cut off there.
    printed = (folder / "printed").open("a+b")
    for stream in (1, 2):
        os.dup2(printed.fileno(), stream)
    _bench = _Bench(folder, printed, (folder / "stack").open("a"))


def _judge(attempt: Attempt, tried: Input, longest: float) -> Verdict:
    """What becomes of an input, by what is raised, printed, and taken of time and memory."""
    bench: _Bench = _bench
    path = bench.folder / f"input{tried.suffix}"
    path.write_bytes(tried.data)
    os.ftruncate(bench.printed.fileno(), 0)
    bench.stack.truncate(0)
    _forget_peak()
    faulthandler.dump_traceback_later(longest, file=bench.stack)
    begin = time.process_time()
    outcome, message, place = _outcome(attempt, path)
    seconds = time.process_time() - begin
    faulthandler.cancel_dump_traceback_later()
    megabytes = _kilobytes("VmHWM") / 1000.0
    sys.stdout.flush()
    sys.stderr.flush()
    printed = os.pread(bench.printed.fileno(), 2000, 0)
    if outcome != "failed":
        before = f"{outcome}: {message}, after {seconds:.1f} s, with {megabytes:.0f} MB\n"
        excesses = {
            "prints": bool(printed),
            "takes too much memory": megabytes > MOST_MEGABYTES,
            "hangs": seconds > MOST_SECONDS,
        }
        if place := next((name for name, exceeds in excesses.items() if exceeds), ""):
            outcome, message = "failed", before + printed.decode("utf-8", "replace")
    return Verdict(outcome, message, place, seconds, megabytes)


def _rise() -> None:
    """Have Taichi keep what it compiled, for the next time."""
    runtime = sys.modules.get("sandbox.runtime")
    if runtime is not None:
        runtime.stop()


def _outcome(attempt: Attempt, path: Path) -> tuple[str, str, str]:
    """Outcome, message and place of one attempt."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)  # the sandbox's own are of this kind
        try:
            taken = attempt(path)
            return taken if isinstance(taken, str) else "accepted", "", ""
        except SandboxError as error:
            try:
                check_message(error)
            except Wrong as wrong:
                return "failed", _traceback(error), f"Wrong message {_place(error)}: {str(wrong)[:60]}"
            return "refused", str(error), ""
        except BaseException as error:
            name = f"Wrong: {error}" if isinstance(error, Wrong) else type(error).__name__
            return "failed", _traceback(error), f"{name} {_place(error)}"


def _traceback(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))[-6000:]


def _place(error: BaseException) -> str:
    return _innermost("".join(traceback.format_tb(error.__traceback__)[::-1]))


def _innermost(stack: str) -> str:
    """The first line of the sandbox's own code in a stack that begins at its end."""
    found = re.search(rf'File "{re.escape(_ROOT)}/(sandbox/[^"]+)", line (\d+),? in (\S+)', stack)
    return f"in {found[1]}:{found[2]} {found[3]}" if found else ""


def _forget_peak() -> None:
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _kilobytes(name: str) -> int:
    """A figure of this process's memory [KiB]; 0 where the system does not say."""
    try:
        found = re.search(rf"^{name}:\s+(\d+)", Path("/proc/self/status").read_text(), re.MULTILINE)
    except OSError:
        return 0
    return int(found[1]) if found else 0
