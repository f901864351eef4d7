"""Workers: deaths, hangs and errors are outcomes; interrupts end everything; a Dask cluster does the same."""

import logging
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from pathlib import Path

import pytest

from sandbox.errors import SandboxError, SceneError
from sandbox.trade import cluster, crew
from sandbox.trade.crew import Failed, Job, open_crew, work_off
from tests.conftest import heed_interrupts

# -- what workers do here -------------------------------------------------------------------------------------


def square(number):
    return number * number


def shout(text):
    print(text, flush=True)
    os.write(1, text.encode())
    os.write(2, text.encode())
    return len(text)


def die_once(trace):
    """Die at the first go."""
    if not Path(trace).exists():
        Path(trace).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "second go"


def die():
    os.kill(os.getpid(), signal.SIGKILL)


def leave():
    sys.exit(3)


def raise_error():
    raise ValueError("two\nlines")


def hang():
    time.sleep(60.0)


def process():
    return os.getpid()


def pause():
    time.sleep(0.3)
    return os.getpid()


def write_process(path):
    Path(path).write_text(str(os.getpid()))
    time.sleep(60.0)


def other_digest():
    return f"of process {os.getpid()}"


# -- this machine ---------------------------------------------------------------------------------------------


def outcomes(slots, *jobs):
    found = {}
    work_off(slots, jobs, lambda job, outcome: found.update({job.key: outcome}))
    return found


def job(task, *arguments, key="", group="", cost=1.0, timeout=None):
    return Job(key or task.__name__, group, cost, task, arguments, timeout)


def test_whatever_happens_to_a_job_is_its_outcome(tmp_path, capfd):
    with open_crew(2) as slots:
        found = outcomes(
            slots,
            job(square, 3),
            job(die_once, str(tmp_path / "trace")),
            job(die),
            job(leave),
            job(raise_error),
            job(hang, timeout=0.3),
            job(shout, "noise"),
            job(open, os.devnull),  # its outcome cannot be sent back
        )
    assert found["square"] == 9 and found["die_once"] == "second go" and found["shout"] == 5
    assert found["die"] == Failed("its worker died (SIGKILL)")
    assert found["leave"] == Failed("SystemExit: 3")
    assert found["raise_error"] == Failed("ValueError: two lines")
    assert found["hang"] == Failed("hung, and was stopped after 0.3 s")
    assert isinstance(found["open"], Failed) and "pickle" in found["open"].message
    assert capfd.readouterr() == ("", "")


def test_a_worker_that_dies_between_two_jobs_costs_nothing():
    seen = []

    def done(_, outcome):
        seen.append(outcome)
        os.kill(outcome, signal.SIGKILL)
        time.sleep(0.5)

    with open_crew(1) as slots:
        work_off(slots, [job(process, key=str(number)) for number in range(2)], done)
    assert len(set(seen)) == 2 and all(isinstance(number, int) for number in seen)


def is_running(number):
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{number}/stat")
    return not (status.exists() and status.read_text().rpartition(")")[2].split()[0] == "Z")


def wait_for(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


SCRIPT = """
import sys
from sandbox.trade.crew import open_crew, work_off
from tests.trade.test_crew import job, square, write_process
if __name__ == "__main__":
    try:
        with open_crew(2) as slots:
            work_off(slots, [job(write_process, path, key=path) for path in sys.argv[1:]], print)
    except KeyboardInterrupt:
        sys.exit(7)
"""


@pytest.mark.parametrize("means", [signal.SIGINT, signal.SIGKILL])
def test_workers_end_with_the_one_that_began_them(tmp_path, means):
    """A key pressed reaches all processes of a terminal; a kill only the one it is meant for."""
    (tmp_path / "script.py").write_text(SCRIPT)
    traces = [tmp_path / "0", tmp_path / "1"]
    begun = subprocess.Popen(
        [sys.executable, str(tmp_path / "script.py"), *map(str, traces)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        preexec_fn=heed_interrupts,
    )  # fmt: skip
    wait_for(lambda: all(trace.exists() and trace.read_text() for trace in traces))
    workers = [int(trace.read_text()) for trace in traces]
    (os.killpg if means is signal.SIGINT else os.kill)(begun.pid, means)
    printed, errors = begun.communicate(timeout=20.0)
    assert begun.returncode == (7 if means is signal.SIGINT else -means)
    assert printed == b"" and (errors == b"" or means is signal.SIGKILL)
    wait_for(lambda: not any(map(is_running, workers)))


# -- the order ------------------------------------------------------------------------------------------------


class InTurn:
    """A slot that does its job at once."""

    def __init__(self, seen):
        self.seen = seen

    def ready(self):
        return True

    def submit(self, job):
        self.seen.append(job.key)
        future = Future()
        future.set_result(None)
        return future

    def check(self):
        pass


def test_a_slot_stays_with_its_group_and_the_dearest_come_first():
    seen = []
    jobs = [job(square, key=f"{group}{cost}", group=group, cost=cost) for group, cost in
            [("a", 1), ("b", 5), ("a", 2), ("c", 4), ("b", 1), ("c", 3)]]  # fmt: skip
    work_off([InTurn(seen)], jobs, lambda *_: None)
    assert seen == ["c4", "c3", "b5", "b1", "a2", "a1"]
    first, second = [], []
    work_off([InTurn(first), InTurn(second)], jobs, lambda *_: None)
    assert first[:2] == ["c4", "c3"] and second[:2] == ["b5", "b1"]
    assert sorted(first + second) == sorted(seen)


def test_equal_jobs_keep_their_order_and_many_take_no_time():
    seen = []
    start = time.perf_counter()
    work_off([InTurn(seen)], [job(square, key=str(number)) for number in range(5000)], lambda *_: None)
    assert seen == [str(number) for number in range(5000)]
    assert time.perf_counter() - start < 5.0  # squared, it would be minutes


def test_what_done_raises_ends_the_work():
    def done(*_):
        raise SandboxError("the disk is full")

    with open_crew(1) as slots, pytest.raises(SandboxError, match="disk is full"):
        work_off(slots, [job(square, 1, key="1"), job(hang)], done)


# -- a cluster ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scheduler():
    """Address of a scheduler with two worker processes."""
    distributed = pytest.importorskip("distributed", reason="Dask's distributed is not installed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
    ) as local:
        yield local.scheduler_address


def test_a_cluster_gives_the_same_outcomes(scheduler, tmp_path, monkeypatch):
    monkeypatch.setattr(crew, "_LOOK_AGAIN", 0.2)
    jobs = (
        *(job(square, number, key=str(number)) for number in range(4)),
        job(raise_error),
        job(die_once, str(tmp_path / "trace")),
    )
    with open_crew(2) as slots:
        expected = outcomes(slots, *jobs)
    (tmp_path / "trace").unlink()
    with open_crew(1, scheduler) as slots:
        assert len(slots) == 2
        assert outcomes(slots, *jobs) == expected
        # Workers that were begun anew have other addresses.
        assert outcomes(slots[:1], job(die)) == {"die": Failed("its worker died")}
        wait_for(lambda: len(slots[0].cluster.workers()) == 2)
        again = outcomes(slots, *(job(pause, key=str(number)) for number in range(4)))
        assert len(set(again.values())) == 2


def test_a_cluster_that_is_not_there_is_one_line(monkeypatch, capfd):
    pytest.importorskip("distributed", reason="Dask's distributed is not installed")
    monkeypatch.setattr(cluster, "_ANSWER", 0.5)
    for address in ("tcp://127.0.0.1:1", "nowhere", "tcp://nowhere.invalid:1", "cheese://x"):
        with pytest.raises(SceneError) as caught, open_crew(1, address):
            pass
        assert str(caught.value) == f"--cluster {address}: no Dask scheduler answers there"
    assert capfd.readouterr() == ("", "")


def test_a_cluster_of_another_version_is_refused(scheduler, monkeypatch):
    monkeypatch.setattr(cluster, "engine_digest", other_digest)
    with pytest.raises(SceneError, match="has another version of the sandbox"), open_crew(1, scheduler):
        pass


def test_a_cluster_that_goes_away_ends_the_work(monkeypatch):
    distributed = pytest.importorskip("distributed", reason="Dask's distributed is not installed")
    monkeypatch.setattr(cluster, "_PATIENCE", 1.0)
    local = distributed.LocalCluster(n_workers=1, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL)
    with local, open_crew(1, local.scheduler_address) as slots:

        def done(*_):
            local.scale(0)
            wait_for(lambda: not local.scheduler.workers)

        with pytest.raises(SandboxError, match="all workers are gone"):
            work_off(slots, [job(process, key="1"), job(hang)], done)
