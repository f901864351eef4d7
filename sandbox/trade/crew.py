"""Work for several processes: on this machine, or on a Dask cluster. What crashes or hangs is an outcome, not the end.

A slot does one job at a time. It gets jobs of the group that it had last as long as there are any, since what those
need is compiled and in memory there. For that reason jobs are handed out here, and not by a pool's own queue.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
import time as clock
from bisect import insort
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import connection
from typing import Any, Protocol

from pebble import ProcessExpired, ProcessPool

from sandbox.trade.cluster import WorkerDied, open_cluster

ATTEMPTS = 2
"""How often a job is begun whose worker dies."""
_LOOK_AGAIN = 2.0
"""Time without any news after which workers are asked whether they are there [s]."""
_PAUSE = 0.2
"""Time after which they are asked again while none is there [s]."""


@dataclass(frozen=True)
class Job:
    """Something to be done by a worker: a function of a module, and its arguments."""

    key: str
    """Name of its outcome."""
    group: str
    """The same for jobs that a worker does best one after the other."""
    cost: float
    """About how long it takes [s]."""
    task: Callable[..., Any]
    arguments: tuple[Any, ...]
    timeout: float | None = None
    """Time after which it counts as hanging [s]; only on this machine."""


@dataclass(frozen=True)
class Failed:
    """Outcome of a job that none came of."""

    message: str


class Slot(Protocol):
    """A worker process."""

    def ready(self) -> bool:
        """Whether it can take a job now. Raises SandboxError where nobody will."""
        ...

    def submit(self, job: Job) -> "Future[Any]":
        """Begin a job."""
        ...

    def check(self) -> None:
        """End a job that nothing will come of. Raises SandboxError where nothing will come of any."""
        ...


@contextlib.contextmanager
def open_crew(workers: int, cluster: str | None = None) -> Iterator[list[Slot]]:
    """Worker processes: so many on this machine, or all of the Dask scheduler at an address.

    Raises SceneError where there is no such scheduler, or its workers run another engine; SandboxError where Dask's
    distributed is not installed.
    """
    if cluster is not None:
        with open_cluster(cluster) as slots:
            yield list(slots)
        return
    local = [_LocalSlot() for _ in range(workers)]
    try:
        yield list(local)
    finally:
        for slot in local:
            slot.stop()
        for slot in local:
            slot.join()


def work_off(slots: Sequence[Slot], jobs: Iterable[Job], done: Callable[[Job, Any], None]) -> None:
    """Do all jobs; ``done(job, outcome)`` is called as each one ends, with :class:`Failed` if its worker died twice.

    What ``done`` raises ends the work; jobs that are under way are cancelled then.
    """
    waiting = _Waiting(jobs)
    attempts: dict[str, int] = {}
    running: dict[Future[Any], tuple[Job, int]] = {}
    last: dict[int, str] = {}
    idle = list(range(len(slots)))
    looked = clock.monotonic()
    try:
        while waiting or running:
            for number in [number for number in idle if waiting and slots[number].ready()]:
                if waiting:
                    idle.remove(number)
                    job = waiting.next(last.get(number), {other.group for other, _ in running.values()})
                    last[number] = job.group
                    running[slots[number].submit(job)] = job, number
            if not running:
                clock.sleep(_PAUSE)
            finished, _ = wait(running, timeout=_LOOK_AGAIN, return_when=FIRST_COMPLETED)
            if clock.monotonic() > looked + _LOOK_AGAIN:
                looked = clock.monotonic()
                for _, number in running.values():
                    slots[number].check()
            for future in finished:
                job, number = running.pop(future)
                idle.append(number)
                attempts[job.key] = attempts.get(job.key, 0) + 1
                if _died(future) and attempts[job.key] < ATTEMPTS:
                    waiting.add(job)
                else:
                    done(job, _outcome(future))
    finally:
        for future in running:
            future.cancel()


def _died(future: "Future[Any]") -> bool:
    """Whether a job ended since its process did."""
    return isinstance(future.exception(), ProcessExpired | BrokenProcessPool | WorkerDied)


def _outcome(future: "Future[Any]") -> Any:
    error = future.exception()
    if error is None:
        return future.result()
    if _died(future):
        return Failed(f"its worker died{_cause(error)}")
    if isinstance(error, TimeoutError) and error.args[:1] == ("Task timeout",):
        return Failed(f"hung, and was stopped after {error.args[1]:g} s")
    text = " ".join(str(error).split())
    return Failed(f"{type(error).__name__}: {text}" if text else type(error).__name__)


def _cause(error: BaseException) -> str:
    """What a process ended by, as far as is known."""
    code = getattr(error, "exitcode", None)
    if code is None:
        return ""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f" ({signal.Signals(-code).name})"
    return f" (exit code {code})"


class _LocalSlot:
    """A process of its own on this machine, begun when it is needed, and anew if it dies."""

    def __init__(self) -> None:
        self._pool: Any = None

    def ready(self) -> bool:
        """A process is begun when it is needed."""
        return True

    def submit(self, job: Job) -> "Future[Any]":
        # Keys pressed in a terminal reach all its processes. This one ends the others; they have to be deaf from their
        # very start. Threads and processes that the pool begins inherit what is blocked here.
        with _interrupts_held():
            if self._pool is None or not self._pool.active:  # a pool breaks where a worker dies between two jobs
                self._renew()
            future: Future[Any] = self._pool.schedule(job.task, args=job.arguments, timeout=job.timeout)
        return future

    def check(self) -> None:
        """The pool tells by itself what ends."""

    def stop(self) -> None:
        if self._pool is not None:
            self._pool.stop()

    def join(self) -> None:
        if self._pool is not None:
            self._pool.join()

    def _renew(self) -> None:
        self.stop()
        self.join()
        # Taichi's threads do not survive a fork.
        spawn = multiprocessing.get_context("spawn")
        self._pool = ProcessPool(max_workers=1, context=spawn, initializer=_begin_worker)


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Let interrupts wait until the end of the block, where the system can."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """In a new process: be silent, and end with the one that began it, however that ends."""
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


class _Waiting:
    """Jobs that nobody does yet, by group; the dearest groups and jobs first, so that all end at about one time."""

    def __init__(self, jobs: Iterable[Job]) -> None:
        self.groups: dict[str, list[Job]] = {}
        self.costs: dict[str, float] = {}
        for job in jobs:
            self.add(job)

    def __bool__(self) -> bool:
        return bool(self.groups)

    def add(self, job: Job) -> None:
        """Put a job in its place: the dearest of a group are taken first, equal ones in the order that they came in."""
        insort(self.groups.setdefault(job.group, []), job, key=lambda other: -other.cost)
        self.costs[job.group] = self.costs.get(job.group, 0.0) + job.cost

    def next(self, last: str | None, held: set[str]) -> Job:
        """The job to do next for who did one of group ``last``, while others have those ``held`` at work."""
        name = max(self.groups, key=lambda name: (name == last, name not in held, self.costs[name]))
        job = self.groups[name].pop(0)
        self.costs[name] -= job.cost
        if not self.groups[name]:
            del self.groups[name], self.costs[name]
        return job
