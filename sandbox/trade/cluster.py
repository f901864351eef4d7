"""Workers of a Dask cluster. Needs the extra ``cluster``."""

import contextlib
import logging
import threading
import time as clock
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, InvalidStateError, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from sandbox.errors import SandboxError, SceneError, missing_extra
from sandbox.trade.trial import engine_digest

if TYPE_CHECKING:
    from sandbox.trade.crew import Job

_ANSWER = 8.0
"""Time in which a scheduler has to answer [s]."""
_PATIENCE = 60.0
"""Time for which a cluster may be without any workers [s]: those that died begin anew in less."""


@contextlib.contextmanager
def open_cluster(address: str) -> Iterator[list["ClusterSlot"]]:
    """A slot for every worker of the Dask scheduler at an address.

    Raises SceneError where there is no such scheduler, or its workers run another engine; SandboxError where Dask's
    distributed is not installed.
    """
    try:
        from distributed import Client
    except ImportError:
        raise SandboxError(missing_extra("--cluster", "Dask's distributed", "cluster")) from None
    with _silenced():
        try:
            client = Client(address, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError, TypeError):
            raise SceneError(f"--cluster {address}: no Dask scheduler answers there") from None
        with client:
            cluster = Cluster(client, address)
            cluster.check_engine()
            yield [ClusterSlot(cluster, number) for number in range(len(cluster.placed))]


class WorkerDied(Exception):
    """A worker of a cluster went away with a job."""


class Cluster:
    """A Dask scheduler and its workers."""

    def __init__(self, client: Any, address: str) -> None:
        self.client, self.address = client, address
        self.placed = self.workers()
        """Workers of the slots. One that was begun anew has another address."""
        self._seen = clock.monotonic()
        """When there were workers last [s]."""

    def workers(self) -> list[str]:
        """Addresses of the workers that are there now. Raises SandboxError where the scheduler is gone."""
        try:
            if self.client.status == "running":
                return list(self.client.scheduler_info(n_workers=-1)["workers"])
        except (OSError, RuntimeError):
            pass
        raise SandboxError(f"--cluster {self.address}: the scheduler is gone")

    def check_engine(self) -> None:
        """Raise SceneError where workers run other sources than this process does."""
        answers = self.client.run(engine_digest, on_error="return")
        if not answers:
            raise SceneError(f"--cluster {self.address}: the scheduler has no workers")
        for worker, answer in answers.items():
            if isinstance(answer, BaseException):
                raise SceneError(f"--cluster {self.address}: worker {worker} cannot run the sandbox ({answer})")
            if answer != engine_digest():
                raise SceneError(f"--cluster {self.address}: worker {worker} has another version of the sandbox")

    def find(self, slot: int) -> bool:
        """Whether a slot has its worker, or one that has no slot yet now has it.

        Raises SandboxError where there have been no workers for long.
        """
        there = self.workers()
        now = clock.monotonic()
        self._seen = now if there else self._seen
        if now > self._seen + _PATIENCE:
            raise SandboxError(f"--cluster {self.address}: all workers are gone")
        if self.placed[slot] not in there:
            self.placed[slot] = next((worker for worker in there if worker not in self.placed), self.placed[slot])
        return self.placed[slot] in there


class ClusterSlot:
    """A worker of a Dask cluster; another one takes its place if it goes."""

    def __init__(self, cluster: Cluster, number: int) -> None:
        self.cluster, self.number = cluster, number
        self._future: Future[Any] = Future()

    @property
    def worker(self) -> str:
        """Address of the worker."""
        return self.cluster.placed[self.number]

    def ready(self) -> bool:
        """Whether there is a worker. Raises SandboxError where the cluster has had none for long."""
        return self.cluster.find(self.number)

    def submit(self, job: "Job") -> "Future[Any]":
        """Begin a job at this slot's worker."""
        # Dask may leave a job of a worker that died waiting for ever, even one that other workers may do: it is tied to
        # this worker, and taken back by check().
        executor = self.cluster.client.get_executor(workers=[self.worker], pure=False)
        asked: Future[Any] = executor.submit(in_turn, job.task, job.arguments)
        future: Future[Any] = Future()
        future.add_done_callback(lambda _: asked.cancel())
        asked.add_done_callback(lambda _: _pass_on(asked, future))
        self._future = future
        return future

    def check(self) -> None:
        """End the job if its worker is gone. Raises SandboxError where the scheduler is."""
        if self.worker not in self.cluster.workers():
            with contextlib.suppress(InvalidStateError):
                self._future.set_exception(WorkerDied())


def _pass_on(asked: "Future[Any]", future: "Future[Any]") -> None:
    """What came of a job, unless it was given up."""
    with contextlib.suppress(InvalidStateError):
        if asked.cancelled():
            future.set_exception(WorkerDied())
        elif (error := asked.exception()) is None:
            future.set_result(asked.result())
        else:
            future.set_exception(WorkerDied() if type(error).__name__ == "KilledWorker" else error)


_turns: ThreadPoolExecutor | None = None
_first = threading.Lock()


def in_turn(task: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Within a worker: do tasks one by one in one thread, however many Dask has. Taichi belongs to a thread."""
    global _turns
    with _first:
        _turns = _turns or ThreadPoolExecutor(max_workers=1)
    return _turns.submit(task, *arguments).result()


@contextlib.contextmanager
def _silenced() -> Iterator[None]:
    """Keep what Dask has to tell off standard error: what matters becomes an error of ours.

    Its log stays silent: a client goes on in the background for a while after it was closed.
    """
    from distributed.versions import VersionMismatchWarning

    for name in [*logging.root.manager.loggerDict, "asyncio"]:
        if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
            logger = logging.getLogger(name)
            logger.handlers, logger.propagate = [logging.NullHandler()], False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VersionMismatchWarning)
        warnings.filterwarnings("ignore", message="Sending large graph")
        yield
