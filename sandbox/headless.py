"""A headless run: simulate, measure, draw, and leave a run folder."""

import contextlib
import json
import math
import os
import platform
import signal
import threading
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from sandbox import __version__
from sandbox.errors import DivergedError, SceneError
from sandbox.exports import check_outputs
from sandbox.gathered import energies
from sandbox.output.folder import CHECKPOINT, SUMMARY, RunFolder
from sandbox.output.inline import InlinePicture, InlineVideo
from sandbox.output.kept_frames import KEPT_FRAMES
from sandbox.output.progress import NoProgress, ProgressReport
from sandbox.output.video import video_names
from sandbox.recorder import Recorder
from sandbox.render import RendererName
from sandbox.scene.load import to_toml
from sandbox.scene.model import Scene
from sandbox.unfinished import Unfinished, find

RENDERERS = tuple(RendererName)
VIDEOS = ("mp4", "webm", "gif", "png", "none")


@dataclass(frozen=True)
class RunOptions:
    """Where and how a run leaves its results."""

    name: str
    """Name of the scene: names the folder and the summary."""
    out: Path | None = None
    """Run folder; outputs/NAME by default."""
    renderer: str = "taichi"
    """taichi, ggui or none."""
    video: str = "mp4"
    """mp4, webm, gif, png or none."""
    arch: str = "cpu"
    precision: str | None = None
    threads: int | None = None
    resume: Path | None = None
    """What to go on from; the run still ends at the scene's duration.

    A checkpoint is where a new run begins. Of the folder of a run that was killed, stopped or out of disk, all goes
    on: the run ends with the files of one that went through.
    """
    verbose: bool = False
    tick: float | None = None
    """Time that goes by at once [s], as in the recording that is run again; by default a picture's."""

    trajectory: str | None = None
    """npz or zarr: the state at every picture is written down."""
    exports: tuple[str, ...] = ()
    """Kinds of mesh files: ply, faces, obj, vtu, springs, usd, glb."""

    @property
    def folder(self) -> Path:
        if self.out is None and self.resume is not None and self.resume.is_dir():
            return self.resume
        return self.out or Path("outputs") / self.name

    @property
    def names(self) -> tuple[str, ...]:
        """Files and folders that a run may leave, mesh files apart."""
        pictures = () if self.renderer == "none" else ("poster.png", "postmortem.png", *video_names(self.video))
        states = [] if self.trajectory is None else [f"trajectory.{self.trajectory}"]
        states += [KEPT_FRAMES] if self.trajectory or self.exports else []
        return ("metrics.csv", SUMMARY, "scene.toml", CHECKPOINT, *pictures, *states)

    def plain(self, precision: str) -> dict[str, Any]:
        """What must be the same where a run is gone on with, as plain data."""
        names = ("name", "renderer", "video", "arch", "tick", "trajectory")
        return {name: getattr(self, name) for name in names} | {"precision": precision, "exports": list(self.exports)}


@dataclass(frozen=True)
class Summary:
    """What a run came to; summary.json."""

    name: str
    title: str
    status: str
    """done, diverged or interrupted."""
    message: str
    folder: str
    files: list[str]
    simulated: float
    """Simulated time at the end [s]."""
    pictures: int
    particles: int
    springs: int
    integrator: str
    precision: str
    arch: str
    threads: int | None
    dt: float
    """Longest step [s]."""
    stable_dt: float | None
    """Stability limit at the start [s]; None where nothing oscillates, or the scheme has none."""
    rescues: list[dict[str, Any]]
    """Returns to the last good picture with half the step: when [s], the step since [s], and why."""
    solver: dict[str, float]
    """What the scheme says of its work: iterations a step, largest residual; empty for explicit ones."""
    real_time_factor: float
    """Simulated seconds a second of simulation, drawing and compilation apart."""
    energy_start: dict[str, float]
    energy_end: dict[str, float]
    max_strain: float
    """Largest strain of any measured instant [1]."""
    inverted_cells: int
    """Cells that are inside out at the end."""
    most_inverted_cells: int
    """Most of any measured instant."""
    torn_springs: int
    """Springs that have torn."""
    first_tear: float | None
    """Time of the first picture that shows a tear [s]; None if nothing tore in this run."""
    work: dict[str, float] | None
    """Work done on the bodies by term of the ledger [J]; None where diagnostics.ledger is off, as the next two."""
    energy_moved: float | None
    """Energy that went from one form to another [J]."""
    energy_unexplained: float | None
    """Change of the total energy that no term explains [J]: the scheme's own error."""
    warnings: list[str]
    """What the run could not do, one line each, see docs/warnings.md; empty where all went as the scene says."""
    state_sha256: str
    """Hash of final positions and velocities: equal for equal trajectories."""
    seconds: dict[str, float]
    versions: dict[str, str]

    def video(self) -> InlineVideo:
        """The run's video, which notebooks show by themselves. Raises SandboxError where it has none."""
        return InlineVideo.of_folder(Path(self.folder))

    def poster(self) -> InlinePicture:
        """The run's poster, which notebooks show by themselves. Raises SandboxError where it has none."""
        return InlinePicture.of_file(Path(self.folder) / "poster.png")


def run(scene: Scene, options: RunOptions, progress: ProgressReport | None = None) -> Summary:
    """Simulate a scene to its duration and leave the run folder.

    Raises SceneError (wrong input); DivergedError, or KeyboardInterrupt at an interrupt or SIGTERM, after the folder
    with everything up to the last good state was written. Before the first picture there is nothing to write; a second
    interrupt does not wait for the next picture, and leaves what a kill does, see ``resume`` of :class:`RunOptions`.
    """
    check_options(options)
    start = clock.perf_counter()
    with _stopping() as is_stopping:
        earlier = _earlier(scene, options)
        folder = RunFolder(options.folder, options.names, None if earlier is None else earlier.folder)
        if earlier is not None and earlier.is_done:
            return _published(folder)
        failure: BaseException | None = None
        with (
            folder.discarded_on_failure(),
            contextlib.closing(Recorder(scene, options, folder, start, earlier)) as recorder,
        ):
            try:
                recorder.record(progress or NoProgress(), is_stopping)
            except (DivergedError, KeyboardInterrupt) as error:
                failure = error
            if isinstance(failure, KeyboardInterrupt) and not (recorder.is_whole and recorder.gathered.number):
                raise failure
            recorder.finish(failure)
            files = sorted({*folder.names(), SUMMARY} - {KEPT_FRAMES})
            summary = _summary(recorder, failure, files)
            folder.write_json(SUMMARY, asdict(summary))
            recorder.settle(failure)
            folder.publish()
    if failure is not None:
        for line in summary.warnings:
            failure.add_note(line)
        raise failure
    return summary


def _earlier(scene: Scene, options: RunOptions) -> Unfinished | None:
    """The run to go on with, where ``resume`` is a folder that holds one. Raises SceneError where it cannot be."""
    if options.resume is None or not options.resume.is_dir():
        return None
    return find(options.resume, to_toml(scene), options.plain(options.precision or str(scene.solver.precision)))


def _published(folder: RunFolder) -> Summary:
    """Publish a run that had all but that done when it was killed."""
    with folder.discarded_on_failure():
        place = folder.partial / SUMMARY
        place = place if place.is_file() else folder.path / SUMMARY
        summary = replace(Summary(**json.loads(place.read_text(encoding="utf-8"))), folder=os.fspath(folder.path))
        folder.write_json(SUMMARY, asdict(summary))
        folder.publish(adds=True)
    return summary


@contextlib.contextmanager
def _stopping() -> Iterator[Callable[[], bool]]:
    """Whether an interrupt or SIGTERM has come. Before one asks that, it is a KeyboardInterrupt; so is a second one.

    A run that stops at a picture can be gone on with to the same bits; one that stops anywhere cannot.
    """
    asked = begun = False

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked or not begun:
            signal.default_int_handler(number, frame)
        asked = True

    def is_asked() -> bool:
        nonlocal begun
        begun = True
        return asked

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False  # signals do not come here
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    taken = [number for number, handler in before.items() if handler is signal.default_int_handler]
    for number in taken:
        signal.signal(number, ask)
    try:
        yield is_asked
    finally:
        for number in taken:
            signal.signal(number, before[number])


def check_options(options: RunOptions) -> None:
    """Raise SceneError where there is no such renderer or kind of video."""
    for name, value, allowed in (("renderer", options.renderer, RENDERERS), ("video", options.video, VIDEOS)):
        if value not in allowed:
            raise SceneError(f"--{name} {value}: must be one of {', '.join(allowed)}")
    check_outputs(options.trajectory, options.exports)


def _summary(recorder: Recorder, failure: BaseException | None, files: list[str]) -> Summary:
    simulation, gathered, options = recorder.simulation, recorder.gathered, recorder.options
    status = {type(None): "done", DivergedError: "diverged"}.get(type(failure), "interrupted")
    return Summary(
        name=options.name,
        title=recorder.scene.title,
        status=status,
        message="" if failure is None else str(failure),
        folder=os.fspath(recorder.folder.path),
        files=files,
        simulated=simulation.time,
        pictures=gathered.pictures,
        particles=simulation.particle_count,
        springs=simulation.spring_count,
        integrator=str(recorder.scene.solver.integrator),
        precision=simulation.precision,
        arch=options.arch,
        threads=options.threads,
        dt=simulation.dt,
        stable_dt=recorder.stable_dt if math.isfinite(recorder.stable_dt) else None,
        rescues=[asdict(rescue) for rescue in simulation.rescues],
        solver=simulation.solver_report(),
        real_time_factor=recorder.real_time_factor(),
        energy_start=gathered.energy_start,
        energy_end=energies(simulation.energy()),
        max_strain=gathered.max_strain,
        inverted_cells=simulation.measure().inverted_cells,
        most_inverted_cells=gathered.most_inverted,
        torn_springs=gathered.torn,
        first_tear=gathered.first_tear,
        work=None if (work := simulation.measure().work) is None else dict(work),
        energy_moved=None if gathered.balance is None else gathered.balance.moved,
        energy_unexplained=None if gathered.balance is None else gathered.balance.unexplained,
        warnings=simulation.warnings,
        state_sha256=simulation.state_hash(),
        seconds=recorder.timings.summary(clock.perf_counter() - recorder.start),
        versions={"sandbox": __version__, "python": platform.python_version(), "numpy": np.__version__},
    )


__all__ = ["RENDERERS", "VIDEOS", "RunOptions", "Summary", "run"]
