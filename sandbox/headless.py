"""A headless run: simulate, measure, draw, and leave a run folder."""

import math
import os
import platform
import time as clock
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox import __version__, checkpoint
from sandbox.balance import EnergyBalance
from sandbox.diagnostics import Measurement
from sandbox.errors import DivergedError, SceneError
from sandbox.exports import FrameRecorder, check_outputs
from sandbox.output.folder import RunFolder
from sandbox.output.inline import InlinePicture, InlineVideo
from sandbox.output.metrics import MetricsWriter
from sandbox.output.progress import NoProgress, ProgressReport, Timings
from sandbox.output.video import PictureWriter, open_writer, video_names, write_image
from sandbox.particle_values import ParticleValues
from sandbox.recording import late_actions
from sandbox.render import NullRenderer, Renderer, RendererName, create_renderer
from sandbox.render.overlay import mark
from sandbox.scene.load import to_toml
from sandbox.scene.model import ColorBy, Scene
from sandbox.simulation import Simulation

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
    """Checkpoint to go on from; the run still ends at the scene's duration."""
    verbose: bool = False
    tick: float | None = None
    """Time that goes by at once [s], as in the recording that is run again; by default a picture's."""

    trajectory: str | None = None
    """npz or zarr: the state at every picture is written down."""
    exports: tuple[str, ...] = ()
    """Kinds of mesh files: ply, faces, obj, vtu, springs, usd, glb."""

    @property
    def folder(self) -> Path:
        return self.out or Path("outputs") / self.name

    @property
    def names(self) -> tuple[str, ...]:
        """Files and folders that a run may leave, mesh files apart."""
        pictures = () if self.renderer == "none" else ("poster.png", "postmortem.png", *video_names(self.video))
        states = () if self.trajectory is None else (f"trajectory.{self.trajectory}",)
        return ("metrics.csv", "summary.json", "scene.toml", "checkpoint.npz", *pictures, *states)


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

    Raises SceneError (wrong input), and DivergedError after the folder with everything up to the
    last good state was written.
    """
    check_options(options)
    start = clock.perf_counter()
    folder = RunFolder(options.folder, options.names)
    failure: BaseException | None = None
    with folder.discarded_on_failure():
        recorder = _Recorder(scene, options, folder, start)
        try:
            recorder.record(progress or NoProgress())
        except (DivergedError, KeyboardInterrupt) as error:
            failure = error
        summary = recorder.finish(failure)
    if failure is not None:
        for line in summary.warnings:
            failure.add_note(line)
        raise failure
    return summary


def check_options(options: RunOptions) -> None:
    """Raise SceneError where there is no such renderer or kind of video."""
    for name, value, allowed in (("renderer", options.renderer, RENDERERS), ("video", options.video, VIDEOS)):
        if value not in allowed:
            raise SceneError(f"--{name} {value}: must be one of {', '.join(allowed)}")
    check_outputs(options.trajectory, options.exports)


class _Recorder:
    """The parts of one run: simulation, renderer, writers, and what is remembered for the summary."""

    def __init__(self, scene: Scene, options: RunOptions, folder: RunFolder, start: float) -> None:
        self.scene, self.options, self.folder, self.start = scene, options, folder, start
        self.timings = Timings()
        self.simulation = Simulation(
            scene,
            arch=options.arch,
            precision=options.precision,
            threads=options.threads,
            verbose=options.verbose,
        )
        self.simulation.warning_log.open(late_actions(scene))
        if options.resume is not None:
            self._resume(options.resume)
        self.stable_dt = self.simulation.initial_stable_dt
        self.renderer, self.values = self._open_renderer()
        video = "none" if isinstance(self.renderer, NullRenderer) else options.video
        self.writer: PictureWriter = open_writer(folder.partial, video, scene.render.fps)
        self.metrics = MetricsWriter(folder.partial / "metrics.csv", self.simulation.assembly)
        self.first = self.simulation.measure()
        self.max_strain = self.first.max_strain
        self.most_inverted = self.first.inverted_cells
        self.balance = EnergyBalance(self.first) if scene.diagnostics.ledger else None
        self.torn = self.first.torn
        self.first_tear: float | None = None
        self.poster: NDArray[np.uint8] | None = None
        self.poster_merit = -math.inf
        self.pictures = 0
        self.begin = self.simulation.time
        self.frames = FrameRecorder.open(
            self.simulation, folder, options.name, options.arch, options.trajectory, options.exports
        )
        self.timings.setup = clock.perf_counter() - start

    def _resume(self, path: Path) -> None:
        saved = checkpoint.read(path)
        shape = (self.simulation.particle_count, self.scene.dimension)
        if saved.positions.shape != shape:
            raise SceneError(f"{path}: holds {saved.positions.shape[0]} particles, the scene has {shape[0]}")
        if saved.time >= self.scene.duration:
            raise SceneError(
                f"{path}: is at {saved.time:g} s already, the run ends at {self.scene.duration:g} s; raise --seconds"
            )
        self.simulation.resume(saved)

    def _open_renderer(self) -> tuple[Renderer, ParticleValues | None]:
        appearance = self.simulation.assembly.appearance
        renderer = create_renderer(self.options.renderer, appearance, self.scene.render)
        if isinstance(renderer, NullRenderer) or self.scene.render.color is ColorBy.BODY:
            return renderer, None
        values = ParticleValues(self.simulation, self.scene.render.color)
        if self.scene.render.color_max is None:
            renderer.set_color_max(values.expected_largest())
        return renderer, values

    def record(self, progress: ProgressReport) -> None:
        """Every picture from the start to the scene's duration."""
        simulation, duration = self.simulation, self.scene.duration
        self.metrics.write(0, simulation.time, self.first)
        self.frames.write(0, -math.inf)
        frame = 1.0 / self.scene.render.fps
        count = max(1, math.ceil((duration - self.begin) / frame - 1e-6))
        for number in range(1, count + 1):
            due = min(self.begin + number * frame, duration)
            with self.timings.measure("simulate"):
                self._advance_to(due)
                measured = simulation.measure()
            if number == 1:
                self.timings.first_step = clock.perf_counter() - self.start
            self.max_strain = max(self.max_strain, measured.max_strain)
            self.most_inverted = max(self.most_inverted, measured.inverted_cells)
            self.metrics.write(number, simulation.time, measured)
            self._note_tears(measured.torn, simulation.time)
            if self.balance is not None:
                self.balance.add(measured)
            merit = self._merit(measured, (number - 0.5) / count)
            self._draw(merit)
            self._write_down(number, merit)
            progress.update(simulation.time, self._real_time_factor())

    def _merit(self, measured: Measurement, part: float) -> float:
        """What the state now is worth as a poster, when so much of the run is over [1]."""
        wanted = self.scene.render.poster
        if wanted is not None:
            return -abs(self.simulation.time - wanted)
        # The moment of largest deformation; without springs, the middle of the run.
        return measured.energy.elastic if self.simulation.spring_count else -abs(part - 0.5)

    def _advance_to(self, time: float) -> None:
        """On to a time [s]; in a recording that runs again by its ticks, to the last one that ends by then."""
        tick = self.options.tick
        if tick is None:
            self.simulation.advance(time - self.simulation.time)
            return
        for number in range(round(self.simulation.time / tick) + 1, math.floor(time / tick + 1e-6) + 1):
            self.simulation.advance_to(number * tick)

    def _note_tears(self, torn: int, time: float) -> None:
        if torn > self.torn:
            self.first_tear = time if self.first_tear is None else self.first_tear
            self.torn = torn

    def _write_down(self, number: int, merit: float) -> None:
        if self.frames.writers:
            with self.timings.measure("export"):
                self.frames.write(number, merit)

    def _draw(self, merit: float) -> None:
        if isinstance(self.renderer, NullRenderer):
            return
        with self.timings.measure("render"):
            picture = self._picture()
        with self.timings.measure("encode"):
            self.writer.write(picture)
        self.pictures += 1
        if merit > self.poster_merit:
            self.poster, self.poster_merit = picture, merit

    def _picture(self) -> NDArray[np.uint8]:
        """The state as it is now."""
        simulation = self.simulation
        state = simulation.state
        self.values = None if self.values is None else self.values.current()
        values = None if self.values is None else self.values.update()
        return self.renderer.draw(state.x, state.slot, values, time=simulation.time, torn=simulation.torn)

    def _draw_postmortem(self, error: DivergedError) -> None:
        """The last good picture, with what left its bounds first marked in it."""
        if isinstance(self.renderer, NullRenderer) or not error.particles:
            return
        points = self.renderer.pixels(self.simulation.positions()[list(error.particles)])
        label = f"{error.element} left its bounds at t = {error.time:.4g} s"
        write_image(self.folder.partial / "postmortem.png", mark(self._picture(), points, label))

    def _real_time_factor(self) -> float:
        # The first advance compiles; it says nothing of speed unless it is all there is.
        times = self.timings.simulate
        spent = sum(times[1:]) if len(times) > 1 else sum(times)
        simulated = self.simulation.time - self.begin
        share = (len(times) - 1) / len(times) if len(times) > 1 else 1.0
        return simulated * share / spent if spent > 0.0 else 0.0

    def finish(self, failure: BaseException | None) -> Summary:
        """Close all files, write the rest, and publish the folder."""
        if failure is not None and self.pictures == 0:
            self._draw(0.0)  # of the last good state: better than no picture at all
        if isinstance(failure, DivergedError):
            self._draw_postmortem(failure)
        self.writer.close()
        self.metrics.close()
        if self.frames.writers:
            with self.timings.measure("export"):
                self.frames.close()
        self.renderer.close()
        if self.poster is not None:
            write_image(self.folder.partial / "poster.png", self.poster)
        self.folder.write_text("scene.toml", to_toml(self.scene))
        self.simulation.save(self.folder.partial / "checkpoint.npz")
        summary = self._summary(failure, sorted([*self.folder.names(), "summary.json"]))
        self.folder.write_json("summary.json", asdict(summary))
        self.folder.publish()
        return summary

    def _summary(self, failure: BaseException | None, files: list[str]) -> Summary:
        simulation = self.simulation
        status = {type(None): "done", DivergedError: "diverged"}.get(type(failure), "interrupted")
        return Summary(
            name=self.options.name,
            title=self.scene.title,
            status=status,
            message="" if failure is None else str(failure),
            folder=os.fspath(self.folder.path),
            files=files,
            simulated=simulation.time,
            pictures=self.pictures,
            particles=simulation.particle_count,
            springs=simulation.spring_count,
            integrator=str(self.scene.solver.integrator),
            precision=simulation.precision,
            arch=self.options.arch,
            threads=self.options.threads,
            dt=simulation.dt,
            stable_dt=self.stable_dt if math.isfinite(self.stable_dt) else None,
            rescues=[asdict(rescue) for rescue in simulation.rescues],
            solver=simulation.solver_report(),
            real_time_factor=self._real_time_factor(),
            energy_start=_energies(self.first.energy),
            energy_end=_energies(simulation.energy()),
            max_strain=self.max_strain,
            inverted_cells=simulation.measure().inverted_cells,
            most_inverted_cells=self.most_inverted,
            torn_springs=self.torn,
            first_tear=self.first_tear,
            work=None if (work := simulation.measure().work) is None else dict(work),
            energy_moved=None if self.balance is None else self.balance.moved,
            energy_unexplained=None if self.balance is None else self.balance.unexplained,
            warnings=simulation.warnings,
            state_sha256=simulation.state_hash(),
            seconds=self.timings.summary(clock.perf_counter() - self.start),
            versions={"sandbox": __version__, "python": platform.python_version(), "numpy": np.__version__},
        )


def _energies(energy: Any) -> dict[str, float]:
    return {**asdict(energy), "total": energy.total}


__all__ = ["RENDERERS", "VIDEOS", "RunOptions", "Summary", "run"]
