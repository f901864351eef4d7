"""Every combination of values of a scene's keys, a run folder each, and one table of what came of them.

A run folder says by a stamp that it belongs to a sweep, and which scene and engine it holds: what is finished is not
run again, and what is not ours is not touched.
"""

import contextlib
import hashlib
import json
import math
import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sandbox.errors import DivergedError, SandboxError, SceneError
from sandbox.files import replace_when_whole
from sandbox.headless import RunOptions, check_options, run
from sandbox.output.folder import RunFolder
from sandbox.output.mark import MARK, Mark
from sandbox.trade.combinations import Combination, SceneData, Variation, combinations
from sandbox.trade.crew import Failed, Job, open_crew, work_off
from sandbox.trade.progress import Progress, progress_bar
from sandbox.trade.sweep_table import Row, row_of, write_sheet, write_tables
from sandbox.trade.trial import engine_digest
from sandbox.warning_log import SceneWarning

STAMP = ".sweep.json"
"""In a run folder: what it holds. In the folder of a sweep: of what."""


@dataclass(frozen=True)
class SweepOptions:
    """How a sweep goes about it."""

    name: str
    """Name of the scene: names the folder."""
    out: Path | None = None
    """Folder; outputs/NAME-sweep by default."""
    video: str = "none"
    posters: bool = False
    """Draw, and put the posters on one sheet."""
    arch: str = "cpu"
    precision: str | None = None
    threads: int | None = None
    """CPU threads of a run; one by default where several are side by side."""
    workers: int | None = None
    """Processes; all cores by default."""
    cluster: str | None = None
    """Address of a Dask scheduler."""
    fresh: bool = False
    """Run what is finished again."""

    @property
    def folder(self) -> Path:
        return self.out or Path("outputs") / f"{self.name}-sweep"

    @property
    def draws(self) -> bool:
        """Whether pictures are drawn."""
        return self.posters or self.video != "none"

    def processes(self, runs: int) -> int:
        """Worker processes for so many runs."""
        return max(1, min(self.workers or _cores(), runs))

    def run_options(self, combination: Combination, runs: int) -> RunOptions:
        """Of the run of a combination, among so many."""
        alone = self.cluster is None and self.processes(runs) == 1
        return RunOptions(
            name=self.name,
            out=self.folder / combination.name,
            renderer="taichi" if self.draws else "none",
            video=self.video,
            arch=self.arch,
            precision=self.precision,
            threads=self.threads or (None if alone else 1),
        )


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


# -- within a worker ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Task:
    """A run, as it goes to a worker."""

    combination: Combination
    options: RunOptions
    key: str
    """The same for the same scene, drawing and engine."""
    sends: bool = False
    """Whether the worker may be on another machine, and sends its files."""

    @property
    def name(self) -> str:
        """Of its folder: no other run of the sweep has it."""
        return self.combination.name


@dataclass(frozen=True)
class Result:
    """What came of a run."""

    status: str
    """done, diverged, refused or crashed."""
    message: str = ""
    summary: dict[str, Any] | None = None
    files: dict[str, bytes] = field(default_factory=dict)
    """Of the run folder, by path within it, where they are sent."""


def run_task(task: Task) -> Result:
    """Run a combination into its folder, or send its files; whatever goes wrong is part of the result."""
    if not task.sends:
        return _run_in(RunPlace(task.options.folder), task)
    with tempfile.TemporaryDirectory(prefix="sandbox-") as folder:
        result = _run_in(RunPlace(Path(folder) / "run"), task)
        place = Path(folder) / "run"
        sent = (path for path in place.rglob("*") if path.is_file() and path.name not in (STAMP, MARK))
        files = {str(path.relative_to(place)): path.read_bytes() for path in sent}
    if result.summary is not None:
        result.summary["folder"] = os.fspath(task.options.folder)
        files["summary.json"] = (json.dumps(result.summary, indent=2) + "\n").encode()
    return replace(result, files=files)


def _run_in(place: "RunPlace", task: Task) -> Result:
    from sandbox import runtime

    try:
        place.claim()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)
            run(task.combination.scene, replace(task.options, out=place.folder))
    except DivergedError:
        pass  # the summary says so
    except SandboxError as error:
        place.leave()
        return Result("refused" if isinstance(error, SceneError) else "crashed", str(error))
    finally:
        # The next run finds on disk what this one compiled, and all memory free.
        runtime.stop()
    place.stamp(task.key)
    summary = place.summary()
    return Result(summary["status"], summary["message"], summary)


class RunPlace:
    """The folder of a run that belongs to a sweep."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def claim(self) -> None:
        """Make it ours; what is in it counts as unfinished. Raises SandboxError where it cannot be written."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._write({})
            (self.folder / "summary.json").unlink(missing_ok=True)
        except OSError as error:
            raise SandboxError(f"{self.folder}: cannot be written: {error.strerror or error}") from None

    def stamp(self, key: str) -> None:
        """Say what is in it, now that it is whole."""
        self._write({"key": key, "summary": self._digest()})

    def holds(self, key: str) -> bool:
        """Whether it has the finished run of this key, and nobody wrote another one into it since."""
        with contextlib.suppress(OSError, ValueError):
            return bool(json.loads((self.folder / STAMP).read_text()) == {"key": key, "summary": self._digest()})
        return False

    def is_foreign(self) -> bool:
        """Whether there is something in it that is not of a sweep."""
        if not self.folder.is_dir():
            return os.path.lexists(self.folder)
        if (self.folder / STAMP).exists():
            return False
        # A sweep that was killed while it claimed the folder left a stamp that has not got its name yet.
        return any(path.name != f".{STAMP}.part" for path in self.folder.iterdir())

    def check(self, names: Sequence[str]) -> None:
        """Raise SceneError where a run would replace what is not as a run has left it; its summary may be."""
        Mark.read(self.folder).check(name for name in names if name != "summary.json")

    def leave(self) -> None:
        """Take away what an unfinished run left, and the folder if nothing else is in it."""
        if (self.folder / STAMP).exists():
            RunFolder(self.folder).discard()
            if [path.name for path in self.folder.iterdir()] == [STAMP]:
                (self.folder / STAMP).unlink()
                self.folder.rmdir()

    def keep(self, files: dict[str, bytes], key: str) -> None:
        """Write the files of a run that was done elsewhere."""
        self.claim()
        folder = RunFolder(self.folder, sorted({Path(name).parts[0] for name in files}))
        with folder.discarded_on_failure():
            for name, content in files.items():
                (folder.partial / name).parent.mkdir(parents=True, exist_ok=True)
                (folder.partial / name).write_bytes(content)
            folder.publish()
        self.stamp(key)

    def summary(self) -> dict[str, Any]:
        """What the run came to."""
        data: dict[str, Any] = json.loads((self.folder / "summary.json").read_text(encoding="utf-8"))
        return data

    def _digest(self) -> str:
        return hashlib.sha256((self.folder / "summary.json").read_bytes()).hexdigest()

    def _write(self, data: dict[str, str]) -> None:
        with replace_when_whole(self.folder / STAMP) as temporary:
            temporary.write_text(json.dumps(data), encoding="utf-8")


# -- the sweep ------------------------------------------------------------------------------------------------


def sweep(
    base: SceneData, variations: Sequence[Variation], options: SweepOptions, silent: bool
) -> tuple[list[Row], Path]:
    """Run all combinations that are not finished yet; a row for each, and the folder of them all.

    Raises SceneError where something is wrong with the input; nothing is left then.
    """
    tasks = _tasks(base, variations, options)
    if options.cluster is None:
        _check_machine(options)
    with _opened(options, [variation.key for variation in variations], tasks) as folder:
        results = {} if options.fresh else _finished(tasks)
        for task in tasks:
            if task.name not in results:
                RunPlace(task.options.folder).check(task.options.names)
        with progress_bar(silent) as progress:
            _run(tasks, results, options, progress)
        rows = [row_of(task.combination, results[task.name]) for task in tasks]
        title = tasks[0].combination.scene.title
        write_tables(folder.partial, options.name, title, variations, rows)
        if options.posters:
            write_sheet(folder.partial / "sweep.png", folder.path, title or options.name, variations, rows)
        folder.publish()
    return rows, folder.path


def _tasks(base: SceneData, variations: Sequence[Variation], options: SweepOptions) -> list[Task]:
    check_options(RunOptions(options.name, video=options.video))
    found = combinations(base, variations)
    tasks = []
    for combination in found:
        run_options = options.run_options(combination, len(found))
        parts = (
            combination.scene.model_dump_json(), run_options.renderer, run_options.video, options.arch,
            str(options.precision), engine_digest(),
        )  # fmt: skip
        key = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:24]
        tasks.append(Task(combination, run_options, key, sends=options.cluster is not None))
    return tasks


def _check_machine(options: SweepOptions) -> None:
    from sandbox import runtime

    runtime.check(options.arch, options.precision or "f32", options.threads)


@contextlib.contextmanager
def _opened(options: SweepOptions, keys: list[str], tasks: Sequence[Task]) -> Iterator[RunFolder]:
    """The folder of a sweep, which is not another one's. It goes if it was made here and nothing came into it."""
    path, ours = options.folder, {"name": options.name, "keys": keys}
    theirs = ours
    with contextlib.suppress(OSError, ValueError):
        theirs = json.loads((path / STAMP).read_text(encoding="utf-8"))
    if theirs != ours:
        name, others = theirs.get("name"), ", ".join(theirs.get("keys", ()))
        raise SceneError(f"{path}: holds another sweep, of {name} over {others}; choose another --out")
    for task in tasks:
        if RunPlace(task.options.folder).is_foreign():
            raise SceneError(f"{task.options.folder}: holds something that is of no sweep; choose another --out")
    made = not path.exists()
    folder = RunFolder(path, ("sweep.csv", "sweep.json", *(("sweep.png",) if options.posters else ())))
    try:
        with folder.discarded_on_failure():
            with replace_when_whole(path / STAMP) as temporary:
                temporary.write_text(json.dumps(ours), encoding="utf-8")
            yield folder
    finally:
        if made and path.exists() and [entry.name for entry in path.iterdir()] == [STAMP]:
            shutil.rmtree(path)


def _finished(tasks: Sequence[Task]) -> dict[str, Result]:
    """Results of the runs that are done already, by name."""
    results = {}
    for task in tasks:
        place = RunPlace(task.options.folder)
        if place.holds(task.key):
            summary = place.summary()
            if summary["status"] in ("done", "diverged"):
                results[task.name] = Result(summary["status"], summary["message"], summary)
    return results


def _run(tasks: Sequence[Task], results: dict[str, Result], options: SweepOptions, progress: Progress) -> None:
    """Run what has no result yet."""
    owners = {task.name: task for task in tasks if task.name not in results}
    whole = sum(task.combination.work for task in tasks) or math.inf
    passed = sum(task.combination.work for task in tasks if task.name in results)
    progress(passed / whole, f"{len(results)} of {len(tasks)} done already")
    jobs = [Job(name, "", task.combination.work, run_task, (task,)) for name, task in owners.items()]

    def done(job: Job, outcome: Result | Failed) -> None:
        nonlocal passed
        task = owners[job.key]
        place = RunPlace(task.options.folder)
        result = Result("crashed", outcome.message) if isinstance(outcome, Failed) else outcome
        if result.summary is None:
            place.leave()
        elif task.sends:
            place.keep(result.files, task.key)
        results[job.key] = replace(result, files={})
        passed += task.combination.work
        progress(passed / whole, f"{len(results)} of {len(tasks)}; {task.combination.label}: {result.status}")

    if not jobs:
        return
    try:
        with open_crew(options.processes(len(jobs)), options.cluster) as slots:
            work_off(slots, jobs, done)
    except BaseException as error:
        # Workers are gone by now; what they were at is not finished.
        for name, task in owners.items():
            if name not in results:
                with contextlib.suppress(OSError, SandboxError):
                    RunPlace(task.options.folder).leave()
        if isinstance(error, KeyboardInterrupt):
            raise SandboxError(
                f"interrupted; {options.folder} holds {len(results)} of {len(tasks)} runs: "
                "the same command goes on from there"
            ) from None
        raise
