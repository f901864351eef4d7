"""One run from its first picture to its last: what it simulates, measures, draws, writes down, and keeps to go on."""

import math
import time as clock
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sandbox import checkpoint, unfinished
from sandbox.diagnostics import Measurement
from sandbox.errors import DivergedError, SceneError
from sandbox.exports import FrameRecorder
from sandbox.gathered import Gathered
from sandbox.history import history, recall
from sandbox.output.folder import CHECKPOINT, RunFolder
from sandbox.output.kept_frames import KEPT_FRAMES
from sandbox.output.mark import remove
from sandbox.output.metrics import MetricsWriter
from sandbox.output.pictures import PictureWriter
from sandbox.output.progress import ProgressReport, Timings
from sandbox.output.video import open_writer, video_names, write_image
from sandbox.particle_values import ParticleValues
from sandbox.recording import late_actions
from sandbox.render import NullRenderer, Renderer, create_renderer
from sandbox.render.overlay import mark
from sandbox.scene.load import to_toml
from sandbox.scene.model import ColorBy, Scene
from sandbox.simulation import Simulation

if TYPE_CHECKING:
    from sandbox.headless import RunOptions

_ROUNDING = 1e-6
"""Part of the time between two pictures that counts as none [1]."""


class Recorder:
    """The parts of one run: simulation, renderer, writers, and what is remembered for the summary.

    Parameters
    ----------
    folder : takes the files; where there is an ``earlier`` run, it holds those of that one
    start : when the run began, by the clock of performance [s]
    earlier : a run of the same scene that is not done, to go on with
    """

    def __init__(
        self,
        scene: Scene,
        options: "RunOptions",
        folder: RunFolder,
        start: float,
        earlier: unfinished.Unfinished | None,
    ) -> None:
        self.scene, self.options, self.folder, self.start = scene, options, folder, start
        self.toml = to_toml(scene)
        self.frame = 1.0 / scene.render.fps
        """Time between two pictures [s]."""
        self.timings, self.pace = Timings(), unfinished.Pace()
        self.simulation = Simulation(
            scene,
            arch=options.arch,
            precision=options.precision,
            threads=options.threads,
            verbose=options.verbose,
        )
        self.simulation.warning_log.open(late_actions(scene))
        self.stable_dt = self.simulation.initial_stable_dt
        self.is_whole = True
        """False while the state is not one between two pictures."""
        try:
            self._open(earlier)
        except (KeyError, ValueError, TypeError) as error:
            if earlier is None or isinstance(error, SceneError):
                raise
            raise SceneError(f"{earlier.folder}: is damaged, cannot be gone on with: {error}") from None
        self.timings.setup = clock.perf_counter() - start

    def _open(self, earlier: unfinished.Unfinished | None) -> None:
        """Open all writers, and begin: at the start, at a checkpoint, or where an earlier run was."""
        options, folder, scene, simulation = self.options, self.folder, self.scene, self.simulation
        if earlier is not None:
            self._drop_but_kept()
            simulation.resume(earlier.saved)
            recall(simulation, earlier.note["history"])
        elif options.resume is not None and not options.resume.is_dir():
            self._resume(options.resume)
        self.begun = simulation.time
        """Where this process began [s]."""
        self.renderer, self.values = self._open_renderer()
        first = simulation.measure()
        if earlier is None:
            self.gathered = Gathered(first, simulation.time, scene.diagnostics.ledger)
        else:
            self.gathered = Gathered.of(earlier.note["gathered"], earlier.poster, first)
        video = "none" if isinstance(self.renderer, NullRenderer) else options.video
        memory = None if earlier is None else earlier.writer
        self.writer: PictureWriter = open_writer(folder.partial, video, scene.render.fps, memory)
        rows = 0 if earlier is None else int(earlier.note["metrics"])
        self.metrics = MetricsWriter(folder.partial / "metrics.csv", simulation.assembly, rows)
        self.count = max(1, math.ceil((scene.duration - self.gathered.begin) / self.frame - _ROUNDING))
        """Number of the last picture."""
        self.frames = FrameRecorder.open(
            *(simulation, folder, options.name, options.arch, options.trajectory, options.exports),
            pictures=self.count,
            earlier=0 if earlier is None else self.gathered.number + 1,
        )
        if earlier is None:
            self.metrics.write(0, simulation.time, first)
            self.frames.write(0, -math.inf)

    def _drop_but_kept(self) -> None:
        """Remove of an earlier run's files what is written anew."""
        kept = {CHECKPOINT, "metrics.csv", KEPT_FRAMES, *video_names(self.options.video)}
        for name in self.folder.names():
            if name not in kept:
                remove(self.folder.partial / name)

    def _resume(self, path: Any) -> None:
        saved = checkpoint.read(path)
        shape = (self.simulation.particle_count, self.scene.dimension)
        if saved.positions.shape != shape:
            raise SceneError(f"{path}: holds {saved.positions.shape[0]} particles, the scene has {shape[0]}")
        if saved.time >= self.scene.duration - _ROUNDING * self.frame:
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

    def record(self, progress: ProgressReport, is_stopping: Callable[[], bool]) -> None:
        """Every picture that is left until the scene's duration. Raises KeyboardInterrupt where that is wanted."""
        simulation, gathered, count = self.simulation, self.gathered, self.count
        for number in range(gathered.number + 1, count + 1):
            self.is_whole = False
            with self.timings.measure("simulate"):
                self._advance_to(self._due(number))
                measured = simulation.measure()
            if not self.timings.first_step:
                self.timings.first_step = clock.perf_counter() - self.start
            gathered.add(number, measured, simulation.time)
            self.metrics.write(number, simulation.time, measured)
            merit = self._merit(measured, (number - 0.5) / count)
            self._draw(merit)
            self._write_down(number, merit)
            self.is_whole = True
            if self.pace.is_due(self.writer.between_groups) or number == count:
                self._keep()
            progress.update(simulation.time, self.real_time_factor())
            if is_stopping() and number < count:
                raise KeyboardInterrupt

    def _due(self, number: int) -> float:
        """When picture ``number`` is [s].

        A run that goes on from a picture of another one has its pictures, and so its steps, where that one would have
        had them, to the bit.
        """
        begin, frame, duration = self.gathered.begin, self.frame, self.scene.duration
        before = round(begin / frame)
        is_picture = abs(before * frame - begin) <= _ROUNDING * frame
        due = (before + number) * frame if is_picture else begin + number * frame
        return due if due <= duration + _ROUNDING * frame else duration

    def _keep(self) -> None:
        """Write down how far the run is, and all that it needs to go on from here."""
        with self.timings.measure("keep"):
            note = {
                "options": self.options.plain(self.simulation.precision),
                "scene": self.toml,
                "gathered": self.gathered.plain(),
                "history": history(self.simulation),
                "metrics": self.metrics.size,
            }
            arrays = {f"writer.{name}": values for name, values in self.writer.memory().items()}
            if self.gathered.poster is not None:
                arrays["poster"] = self.gathered.poster
            unfinished.write(self.folder.partial, self.simulation.snapshot(), note, arrays)
        self.pace.took(self.timings.keep[-1])

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
            self.simulation.advance_to(time)
            return
        for number in range(round(self.simulation.time / tick) + 1, math.floor(time / tick + 1e-6) + 1):
            self.simulation.advance_to(number * tick)

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
        self.gathered.show(picture, merit)

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

    def real_time_factor(self) -> float:
        """Simulated seconds a second of simulation in this process [1]."""
        # The first advance compiles; it says nothing of speed unless it is all there is.
        times = self.timings.simulate
        spent = sum(times[1:]) if len(times) > 1 else sum(times)
        simulated = self.simulation.time - self.begun
        share = (len(times) - 1) / len(times) if len(times) > 1 else 1.0
        return simulated * share / spent if spent > 0.0 else 0.0

    def _goes_on(self, failure: BaseException | None) -> bool:
        """Whether the run was stopped, and can be gone on with."""
        return isinstance(failure, KeyboardInterrupt)

    def finish(self, failure: BaseException | None) -> None:
        """Close all files and write the rest, but for the summary.

        Until :meth:`settle`, the run can still be gone on with from the folder as it is.
        """
        if failure is not None and self.gathered.pictures == 0:
            self._draw(0.0)  # of the last good state: better than no picture at all
        if isinstance(failure, DivergedError):
            self._draw_postmortem(failure)
        if self._goes_on(failure):
            self._keep()
        self.writer.close(indexes=not self._goes_on(failure))
        self.metrics.close()
        if self.frames.writers:
            with self.timings.measure("export"):
                self.frames.close()
        self.renderer.close()
        if self.gathered.poster is not None:
            write_image(self.folder.partial / "poster.png", self.gathered.poster)
        self.folder.write_text("scene.toml", self.toml)

    def settle(self, failure: BaseException | None) -> None:
        """Nothing is left to do but to publish the folder, which is then of a run that has ended.

        A stopped one keeps what it needs to go on.
        """
        if self._goes_on(failure):
            return
        self.simulation.save(self.folder.partial / CHECKPOINT)
        self.writer.settle()
        (self.folder.partial / KEPT_FRAMES).unlink(missing_ok=True)

    def close(self) -> None:
        """Give back what the run holds in Taichi."""
        self.renderer.close()
        self.simulation.close()
