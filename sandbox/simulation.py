"""A scene in motion: builds exactly the pipeline that the scene needs, and steps it."""

import math
import os
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sandbox import checkpoint, limits, runtime, stability
from sandbox.acting import Acting
from sandbox.diagnostics import Measurement
from sandbox.divergence import first_bad_step
from sandbox.errors import DivergedError, SceneError
from sandbox.integrators.build import serial_work
from sandbox.integrators.schemes import SCHEMES
from sandbox.observed import Observed
from sandbox.pipeline import MOST_NEIGHBOURS, Memory, Pipeline, build_pipeline, first_neighbours, network_of
from sandbox.postmortem import describe
from sandbox.scene.assemble import Assembly, assemble
from sandbox.scene.model import Scene, Solver
from sandbox.start import check_memory, check_start, start_remarks
from sandbox.step_size import EnergyWatch, Rescue, StepSize
from sandbox.warning_log import WarningKind, WarningLog
from sandbox.watch import Watch

FloatArray = NDArray[np.float64]


class Simulation(Observed):
    """A running scene.

    Parameters
    ----------
    scene : what to simulate
    arch : "cpu", "cuda", "vulkan" or "metal"
    precision : "f32" or "f64"; by default the scene's
    threads : CPU threads; by default all cores. The trajectory does not depend on it.
    serial : one launch for all steps of a frame, or a parallel one a step; by default what is faster for the size
    warns : whether to look out for what the simulation cannot do, see :attr:`warnings`; it takes a little time

    Raises SceneError where the scene cannot be built, RuntimeUnavailableError where ``arch`` is not there.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        arch: str = "cpu",
        precision: str | None = None,
        threads: int | None = None,
        serial: bool | None = None,
        verbose: bool = False,
        warns: bool = True,
    ) -> None:
        self.scene = scene
        self.warning_log = WarningLog()
        self.scheme = SCHEMES[scene.solver.integrator]
        runtime.check(arch, precision or str(scene.solver.precision), threads)
        self.assembly = assemble(scene)
        self.time = 0.0
        """Simulated time [s]."""
        self._settings = runtime.Settings(arch, precision or str(scene.solver.precision), threads, verbose)
        self._wants_serial = serial
        self.serial = self._is_serial()
        self._network = network_of(self.assembly.unheld())
        self.acting = Acting(self) if scene.actions or scene.interaction is not None else None
        """What is done to the bodies; None in a scene where nothing is."""
        self._pipeline: Pipeline | None = None
        self._asleep = (self.assembly.positions, self.assembly.velocities, self.assembly.velocities)
        self._asleep_memory: Memory | None = None
        self._first_memory: Memory = {}
        self._neighbours = first_neighbours(self.assembly)
        self._measurement: Measurement | None = None
        check_start(self.assembly, self.precision)
        self._steps = StepSize(self.scheme, self.assembly, self._network)
        self.dt = self._steps.chosen
        """Longest step [s]; every call divides its time into equal steps of at most this."""
        if warns:
            self.warning_log.open([*self._steps.remarks(), *start_remarks(self.assembly)])
        self.watch = Watch(self.assembly, self.warning_log) if warns else None
        self.energy_watch = EnergyWatch.of(self.assembly) if scene.solver.adapt is not None else None
        self._first_solver = scene.solver
        self.explains_failures = True
        """Whether a blow-up is looked into step by step; studies that provoke them have no time for that."""
        self.rescues: list[Rescue] = []
        """Returns to the last good picture so far; only with solver.adapt = "rescue"."""
        self._wake()

    # -- stepping ---------------------------------------------------------------------------------

    def advance(self, seconds: float) -> None:
        """Simulate ``seconds`` [s], in equal steps of at most ``dt``.

        Raises DivergedError where the state leaves its bounds; the state is then the last good one.
        """
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise SceneError(f"advance({seconds}): must be a time >= 0 in seconds")
        if seconds > 0.0:
            self.advance_to(self.time + seconds)

    def advance_to(self, time: float) -> None:
        """Simulate up to a time [s] that is not behind; like :meth:`advance`, which it ends for exactly there."""
        if not (math.isfinite(time) and time >= self.time):
            raise SceneError(f"advance_to({time}): must be a time from {self.time:g} s on")
        while self.time < time:
            until = time
            if self.acting is not None:
                self.acting.perform_due()
                until = min(time, self.acting.next_time)
            while not self._advance_evenly(until - self.time):
                pass
            self.time = until

    def step_frame(self) -> None:
        """Simulate the time of one picture, 1 / render.fps."""
        self.advance(1.0 / self.scene.render.fps)

    def _advance_evenly(self, seconds: float) -> bool:
        """Simulate ``seconds`` [s] in equal steps. False where the step was changed on the way: there is time left."""
        steps, dt = self._divide(seconds)
        between_checks, start, longest = max(1, round(1.0 / (self.scene.render.fps * dt))), self.time, self.dt
        for done in range(0, steps, between_checks):
            self._advance_checked(min(between_checks, steps - done), dt)
            self.time = start + min(done + between_checks, steps) * dt
            if self.watch is not None:
                self.watch.look(self)
            if self.dt != longest and done + between_checks < steps:
                return False
        return True

    def _divide(self, seconds: float) -> tuple[int, float]:
        ratio = seconds / self.dt
        steps = max(1, math.ceil(ratio - 1e-9 * max(1.0, ratio)))
        # Where dt divides the time but for rounding, dt itself is used: advance(1.0) steps like ten advance(0.1).
        dt = self.dt if abs(steps * self.dt - seconds) <= 1e-9 * seconds else seconds / steps
        return steps, dt

    def _advance_checked(self, steps: int, dt: float) -> None:
        pipeline = self._wake()
        before = self.measure() if self.energy_watch is not None else None
        pipeline.keep()
        pipeline.stepper.advance(steps, dt, self.time)
        self._measurement = None
        if pipeline.parts.contact and pipeline.parts.contact[0].overflowed():
            pipeline.restore()
            self._widen_contact()
            self._advance_checked(steps, dt)
            return
        alarm = pipeline.alarm()
        gained = self.energy_watch is not None and self.energy_watch.is_suspicious(before, self.measure())
        if alarm or gained or self._out_of_bounds(self.measure()):
            error = self._diverged(steps, dt) if self.explains_failures else self._given_up()
            self._rescue(steps, dt, error)
            return
        self.dt = self._steps.refreshed(
            self.dt, self.measure(), lambda: network_of(self.assembly, pipeline.memory()), lambda: self._read()[0]
        )

    def _rescue(self, steps: int, dt: float, error: DivergedError) -> None:
        """Go on from the last good state with half the step, if the scene wants that; else raise the error."""
        solver = self.scene.solver
        if solver.adapt is None or len(self.rescues) >= solver.most_halvings:
            raise error
        self.dt = 0.5 * dt
        self.rescues.append(Rescue(time=self.time, dt=self.dt, reason=str(error)))
        self.warning_log.note(WarningKind.RESCUED, self.rescues[-1].line(len(self.rescues)))
        self._advance_checked(2 * steps, self.dt)

    def _widen_contact(self) -> None:
        """Build everything again with room for twice as many neighbours."""
        if self._neighbours >= MOST_NEIGHBOURS:
            raise SceneError(
                f"bodies: a particle meets more than {MOST_NEIGHBOURS} others at once; use smaller or more even radii"
            )
        self.suspend()
        self._neighbours *= 2

    # -- what a state is ----------------------------------------------------------------------------

    def set_state(
        self,
        positions: FloatArray,
        velocities: FloatArray,
        time: float | None = None,
        force_velocities: FloatArray | None = None,
        memory: Memory | None = None,
    ) -> None:
        """Replace the state [m], [m/s], each (particle_count, dimension) in the scene's order, and the time [s].

        ``force_velocities`` and ``memory`` are what those of this name gave, to continue a trajectory bit
        for bit; without ``memory`` what parts remember stays as it is.
        """
        shape = (self.particle_count, self.assembly.dimension)
        arrays = []
        seen = velocities if force_velocities is None else force_velocities
        for name, values in (("positions", positions), ("velocities", velocities), ("force velocities", seen)):
            array = np.asarray(values, dtype=np.float64)
            if array.shape != shape or not np.isfinite(array).all():
                raise SceneError(f"{name}: must be finite numbers of shape {shape}, got shape {array.shape}")
            arrays.append(self.assembly.internal_order(array))
        if memory is not None:
            check_memory(self._first_memory, memory)
            self._recall(memory)
        elif self.acting is not None and time is not None:
            self.acting.actor.skip_to(time)
        self._wake().state.write(*arrays)
        self._measurement = None
        self.time = self.time if time is None else time
        self._wake().set_time(self.time)
        self._look_anew()

    def restore(self) -> None:
        """Go back to the start of the scene, with everything compiled."""
        if self._pipeline is None:
            self._asleep_memory = self._first_memory  # what it would wake up with may be of actions that are forgotten
        if self.scene.solver != self._first_solver:
            self.switch_solver(self._first_solver)
        pipeline = self._wake()
        pipeline.state.write(self.assembly.positions, self.assembly.velocities)
        self._recall(self._first_memory)
        pipeline.set_time(0.0)
        self._measurement = None
        self.time = 0.0
        self.dt = self._steps.begin_again(self.dt)
        self.warning_log.begin_again()
        self._look_anew()

    def _look_anew(self) -> None:
        """The state has become another one: what was seen of the last one says nothing of it."""
        if self.watch is not None:
            self.watch.begin(self)

    def retune(self, assembly: Assembly) -> None:
        """Go to the start with other masses and springs of the same bodies, with everything compiled."""
        self.assembly = assembly
        pipeline = self._wake()
        pipeline.remember(self._first_memory)
        pipeline.reload(assembly)
        self._first_memory = self.memory
        self.restore()

    # -- stability ----------------------------------------------------------------------------------

    @property
    def initial_stable_dt(self) -> float:
        """Stability limit of the scheme in the shape that the scene starts with [s]."""
        return self._steps.limit

    def stable_dt(self) -> float:
        """Largest stable step of the scene's integrator in the shape that the bodies have now [s]."""
        memory = self._asleep_memory if self._pipeline is None else self._pipeline.memory()
        network = network_of(self.assembly, memory)
        return limits.stable_step(self.scheme, network, self._read()[0], self.scene.solver.horizon)

    def _out_of_bounds(self, measurement: Measurement) -> bool:
        bounds = self.scene.diagnostics
        return not (
            measurement.finite
            and measurement.max_strain <= bounds.max_strain
            and measurement.max_speed <= bounds.max_speed
        )

    def _diverged(self, steps: int, dt: float) -> DivergedError:
        """What went wrong in the last steps; leaves the last good state."""
        time, failure, finite, alarm = first_bad_step(
            self._wake(), self.assembly, (self.time, steps, dt), self._out_of_bounds
        )
        self._measurement = None
        stable = self.stable_dt()
        if alarm:
            return DivergedError(f"diverged at t = {time:.6g} s: {alarm}", time=time, stable_dt=stable)
        frequencies = stability.element_frequencies(self._network)
        message = describe(failure, self.assembly, time, dt, stable, frequencies, finite)
        element, particles = failure.element(self.assembly), failure.particles(self.assembly)
        return DivergedError(message, time=time, stable_dt=stable, element=element, particles=particles)

    def _given_up(self) -> DivergedError:
        """Leave the last good state, and ask nothing."""
        self._wake().restore()
        self._measurement = None
        return DivergedError(f"diverged after t = {self.time:.6g} s", time=self.time, stable_dt=math.nan)

    # -- life ---------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a checkpoint (.npz) that :meth:`load` continues bit for bit."""
        checkpoint.write(path, self.snapshot())

    def snapshot(self) -> checkpoint.Checkpoint:
        """The scene and its state now."""
        settings, (positions, velocities, seen) = self._settings, self._read()
        order = self.assembly.scene_order
        return checkpoint.Checkpoint(
            scene=self.scene,
            time=self.time,
            positions=order(positions),
            velocities=order(velocities),
            force_velocities=order(seen),
            arch=settings.arch,
            precision=settings.precision,
            steps=(self.dt, *self._steps.memory()),
            memory=self.memory,
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, arch: str | None = None, threads: int | None = None) -> "Simulation":
        """The simulation of a checkpoint. Raises SceneError where the file is none."""
        saved = checkpoint.read(path)
        simulation = cls(saved.scene, arch=arch or saved.arch, precision=saved.precision, threads=threads)
        simulation.resume(saved)
        return simulation

    def resume(self, saved: checkpoint.Checkpoint) -> None:
        """Go on from a checkpoint of a scene with the same bodies; with the same solver, with its step too."""
        if self.acting is not None and (solver := self.acting.actor.solver_by(saved.time)) != self.scene.solver:
            self.switch_solver(solver)
        self.set_state(saved.positions, saved.velocities, saved.time, saved.force_velocities, saved.memory)
        if saved.steps and saved.scene.solver == self.scene.solver:
            self._steps.check(saved.steps[0])
            self.dt = saved.steps[0]
            self._steps.remember(saved.steps[1:])

    def change(self, assembly: Assembly, memory: Memory) -> None:
        """Go on with other masses, springs and carried particles of the same bodies, and what parts remember then."""
        self.assembly = assembly
        pipeline = self._wake()
        remembered = pipeline.memory()
        pipeline.reload(assembly)
        pipeline.remember({name: memory.get(name, values) for name, values in remembered.items()})
        pipeline.set_time(self.time)
        self._measurement = None

    def stiffened(self, factor: float) -> None:
        """Have steps fit springs that are at most ``factor`` times as stiff as the scene's, or particles set free."""
        self.dt = self._steps.for_stiffer(self.dt, factor)

    def forget_measurement(self) -> None:
        """Somebody has changed the state."""
        self._measurement = None

    def switch_solver(self, solver: Solver) -> None:
        """Go on with another solver from here; everything is compiled for it."""
        scene = self.scene.model_copy(update={"solver": solver})
        self.suspend()
        self.scene, self.scheme = scene, SCHEMES[solver.integrator]
        self.assembly = replace(self.assembly, scene=self.assembly.scene.model_copy(update={"solver": solver}))
        if self.acting is not None:
            self.acting.actor.use(solver)
        self.serial = self._is_serial()
        self._steps = StepSize(self.scheme, self.assembly, self._network)
        self.dt = self._steps.chosen
        # Schemes remember each their own; what all else began with does not change.
        known, self._asleep_memory, first = self._asleep_memory or {}, None, self._first_memory
        fresh = self._wake().memory()
        self._first_memory = fresh | first
        self._asleep_memory = {name: known.get(name, values) for name, values in (known | fresh).items()}
        self._recall(self._asleep_memory)
        self._wake().set_time(self.time)
        if self.acting is not None:
            self.stiffened(self.acting.actor.stiffest)
        self._measurement = None

    def _is_serial(self) -> bool:
        small = self._settings.arch == "cpu" and self.assembly.work <= serial_work(self.scheme)
        return small if self._wants_serial is None else self._wants_serial

    def _recall(self, memory: Memory) -> None:
        """Have the parts remember, and the scene be as actions left it then."""
        pipeline = self._wake()
        if self.acting is not None and self.acting.recall(memory):
            pipeline.reload(self.assembly)
        pipeline.remember(memory)

    def suspend(self) -> None:
        """Leave Taichi, keeping the state; the next use builds everything again."""
        if self._pipeline is not None:
            self._asleep = self._pipeline.state.read()
            self._asleep_memory = self.memory
            self._pipeline = None
            runtime.unregister(self)

    def close(self) -> None:
        """Give the fields back. Using the simulation again builds them anew."""
        if self._pipeline is not None:
            tree = self._pipeline.tree
            self.suspend()
            tree.destroy()

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self._asleep if self._pipeline is None else self._pipeline.state.read()

    def _wake(self) -> Pipeline:
        if self._pipeline is None:
            runtime.start(**vars(self._settings))
            self._pipeline = build_pipeline(self.assembly, self.scheme, self.serial, self._neighbours)
            self._pipeline.state.write(*self._asleep)
            runtime.register(self)
            if self._asleep_memory is None:
                self._first_memory = self.memory
            else:
                self._recall(self._asleep_memory)
                self._pipeline.set_time(self.time)
        return self._pipeline
