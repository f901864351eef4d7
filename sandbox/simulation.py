"""A scene in motion: builds exactly the pipeline that the scene needs, and steps it."""

import math
import os
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox import checkpoint, limits, runtime, stability
from sandbox.diagnostics import Energy, Measurement
from sandbox.errors import DivergedError, SceneError
from sandbox.integrators.kick_drift import SERIAL_WORK
from sandbox.integrators.schemes import SCHEMES
from sandbox.pipeline import MOST_NEIGHBOURS, Memory, Pipeline, build_pipeline, first_neighbours, network_of
from sandbox.postmortem import Failure, describe
from sandbox.scene.assemble import assemble
from sandbox.scene.model import Scene
from sandbox.state import ParticleState

FloatArray = NDArray[np.float64]

LONGEST_AUTO_DT = 1.0 / 240.0
"""Step that dt = "auto" takes where stability would allow a longer one [s]: contact wants to be seen in time."""


MOST_STEPS = 1e6
"""Most steps between two pictures; a scene that needs more would seem to hang."""
_COARSEST = 0.01
"""Most of the shortest spring that rounding may take from a coordinate [1]."""


class StabilityWarning(UserWarning):
    """A fixed step is longer than the scheme can take in this scene."""


class Simulation:
    """A running scene.

    Parameters
    ----------
    scene : what to simulate
    arch : "cpu", "cuda", "vulkan" or "metal"
    precision : "f32" or "f64"; by default the scene's
    threads : CPU threads; by default all cores. The trajectory does not depend on it.
    serial : one launch for all steps of a frame (True) or a parallel launch a step (False);
        by default whichever is faster for the scene's size

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
    ) -> None:
        self.scene = scene
        self.scheme = SCHEMES[scene.solver.integrator]
        runtime.check(arch, precision or str(scene.solver.precision), threads)
        self.assembly = assemble(scene)
        self.time = 0.0
        """Simulated time [s]."""
        self._settings = runtime.Settings(arch, precision or str(scene.solver.precision), threads, verbose)
        work = self.assembly.particle_count + 2 * self.assembly.spring_count
        self.serial = (arch == "cpu" and work <= SERIAL_WORK) if serial is None else serial
        self._network = network_of(self.assembly)
        self._pipeline: Pipeline | None = None
        self._asleep = (self.assembly.positions, self.assembly.velocities, self.assembly.velocities)
        self._asleep_memory: Memory | None = None
        self._first_memory: Memory = {}
        self._neighbours = first_neighbours(self.assembly)
        self._measurement: Measurement | None = None
        self._check_start()
        self.initial_stable_dt = limits.stable_step(self.scheme, self._network, self.assembly.positions, scene.duration)
        """Stability limit of the scheme in the shape that the scene starts with [s]."""
        self.dt = self._choose_dt(self.initial_stable_dt)
        """Longest step that is taken [s]; every call divides its time into equal steps of at most this."""
        if self.dt * scene.render.fps * MOST_STEPS < 1.0:
            raise SceneError(
                f"solver.dt: {self.dt:.3g} s makes {1.0 / (self.dt * scene.render.fps):.3g} steps a picture, more than "
                f"{MOST_STEPS:g}: soften or densify the stiffest body, or raise render.fps"
            )
        self._wake()

    # -- stepping ---------------------------------------------------------------------------------

    def advance(self, seconds: float) -> None:
        """Simulate ``seconds`` [s], in equal steps of at most ``dt``.

        Raises DivergedError where the state leaves its bounds; the state is then the last good one.
        """
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise SceneError(f"advance({seconds}): must be a time >= 0 in seconds")
        if seconds == 0.0:
            return
        steps, dt = self._divide(seconds)
        between_checks = max(1, round(1.0 / (self.scene.render.fps * dt)))
        start = self.time
        for done in range(0, steps, between_checks):
            self._advance_checked(min(between_checks, steps - done), dt)
            self.time = start + min(done + between_checks, steps) * dt
        self.time = start + seconds

    def step_frame(self) -> None:
        """Simulate the time of one picture, 1 / render.fps."""
        self.advance(1.0 / self.scene.render.fps)

    def _divide(self, seconds: float) -> tuple[int, float]:
        ratio = seconds / self.dt
        steps = max(1, math.ceil(ratio - 1e-9 * max(1.0, ratio)))
        # Where dt divides the time but for rounding, dt itself is used: advance(1.0) steps like ten advance(0.1).
        dt = self.dt if abs(steps * self.dt - seconds) <= 1e-9 * seconds else seconds / steps
        return steps, dt

    def _advance_checked(self, steps: int, dt: float) -> None:
        pipeline = self._wake()
        pipeline.keep()
        pipeline.stepper.advance(steps, dt, self.time)
        self._measurement = None
        if pipeline.parts.contact and pipeline.parts.contact[0].overflowed():
            pipeline.restore()
            self._widen_contact()
            self._advance_checked(steps, dt)
        elif self._out_of_bounds(self.measure()) or pipeline.alarm():
            raise self._diverged(steps, dt)

    def _widen_contact(self) -> None:
        """Build everything again with room for twice as many neighbours."""
        if self._neighbours >= MOST_NEIGHBOURS:
            raise SceneError(
                f"bodies: a particle meets more than {MOST_NEIGHBOURS} others at once; use smaller or more even radii"
            )
        self.suspend()
        self._neighbours *= 2

    # -- what a state is ----------------------------------------------------------------------------

    @property
    def particle_count(self) -> int:
        """Number of particles of all bodies."""
        return self.assembly.particle_count

    @property
    def spring_count(self) -> int:
        """Number of springs of all bodies."""
        return self.assembly.spring_count

    @property
    def precision(self) -> str:
        """f32 or f64."""
        return self._settings.precision

    @property
    def state(self) -> ParticleState:
        """The fields themselves, for renderers and diagnostics; in the assembly's order."""
        return self._wake().state

    @property
    def laws(self) -> list[Any]:
        """Force laws of the scene, in the order of their sum."""
        return self._wake().parts.laws

    @property
    def torn(self) -> Any:
        """Field of marks, nonzero where a spring has torn, shape (spring_count,); None where none can."""
        tears = self._wake().parts.tears
        return tears[0].torn if tears else None

    @property
    def memory(self) -> Memory:
        """What the scene's parts remember beyond positions and velocities, by name: for :meth:`set_state`."""
        return self._wake().memory()

    def positions(self) -> FloatArray:
        """Particle positions [m], shape (particle_count, dimension), in the scene's order."""
        return self.assembly.scene_order(self._read()[0])

    def velocities(self) -> FloatArray:
        """Particle velocities [m/s], shape (particle_count, dimension), in the scene's order."""
        return self.assembly.scene_order(self._read()[1])

    def force_velocities(self) -> FloatArray:
        """Velocities that forces see [m/s], like :meth:`velocities`: these, or the scheme's prediction of them."""
        return self.assembly.scene_order(self._read()[2])

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
            self._check_memory(memory)
            self._wake().remember(memory)
        self._wake().state.write(*arrays)
        self._measurement = None
        self.time = self.time if time is None else time
        self._wake().set_time(self.time)

    def _check_memory(self, memory: Memory) -> None:
        for name, values in self._first_memory.items():
            if name.startswith("ledger."):
                continue  # a run may begin its books anew
            if name not in memory or memory[name].shape != values.shape or not np.isfinite(memory[name]).all():
                raise SceneError(f"state: {name} must be {len(values)} finite numbers for this scene")

    def restore(self) -> None:
        """Go back to the start of the scene, with everything compiled."""
        pipeline = self._wake()
        pipeline.state.write(self.assembly.positions, self.assembly.velocities)
        pipeline.remember(self._first_memory)
        pipeline.set_time(0.0)
        self._measurement = None
        self.time = 0.0

    def measure(self) -> Measurement:
        """Energies, momenta, largest strain, speed and penetration of the state now."""
        if self._measurement is None:
            self._measurement = self._wake().diagnostics.measure()
        return self._measurement

    def energy(self) -> Energy:
        """Energies of the state now [J]: .kinetic .elastic .gravity .gas .total."""
        return self.measure().energy

    def momentum(self) -> FloatArray:
        """Linear momentum [kg m/s], shape (dimension,)."""
        return np.array(self.measure().momentum)

    def angular_momentum(self) -> FloatArray:
        """Angular momentum about the origin [kg m^2/s], shape (1,) in 2D, (3,) in 3D."""
        return np.array(self.measure().angular_momentum)

    # -- stability ----------------------------------------------------------------------------------

    def stable_dt(self) -> float:
        """Largest stable step of the scene's integrator in the shape that the bodies have now [s]."""
        memory = self._asleep_memory if self._pipeline is None else self._pipeline.memory()
        network = network_of(self.assembly, memory)
        return limits.stable_step(self.scheme, network, self._read()[0], self.scene.duration)

    def _choose_dt(self, limit: float) -> float:
        wanted = self.scene.solver.dt
        if wanted == "auto":
            return min(self.scene.solver.safety * limit, LONGEST_AUTO_DT)
        if wanted > limit:
            warnings.warn(
                f"solver.dt = {wanted:.4g} s is above the stability limit {limit:.4g} s of "
                f"{self.scene.solver.integrator} in this scene; expect it to diverge",
                StabilityWarning,
                stacklevel=3,
            )
        return float(wanted)

    def _out_of_bounds(self, measurement: Measurement) -> bool:
        bounds = self.scene.diagnostics
        return not (
            measurement.finite
            and measurement.max_strain <= bounds.max_strain
            and measurement.max_speed <= bounds.max_speed
        )

    def _check_start(self) -> None:
        bounds = self.scene.diagnostics
        speed = float(np.linalg.norm(self.assembly.velocities, axis=1).max())
        if speed > bounds.max_speed:
            raise SceneError(f"diagnostics.max_speed: a body starts at {speed:.4g} m/s, above {bounds.max_speed:.4g}")
        rest = self.assembly.spring_set.rest_lengths
        rounding = float(
            np.finfo("float64" if self.precision == "f64" else "float32").eps * np.abs(self.assembly.positions).max()
        )
        if (rest > 0.0).any() and rounding > _COARSEST * rest[rest > 0.0].min():
            raise SceneError(
                f"bodies: so far from the origin {self.precision} rounds coordinates to {rounding:.2g} m, too coarse "
                f"for springs of {rest[rest > 0.0].min():.2g} m; move the scene nearer, or use solver.precision f64"
            )
        failure = Failure.of_state(self.assembly, self.assembly.positions, self.assembly.velocities)
        if failure.strain > bounds.max_strain:
            raise SceneError(
                f"diagnostics.max_strain: {failure.element(self.assembly)} starts at strain {failure.strain:.4g}, "
                f"above {bounds.max_strain:.4g}"
            )

    def _diverged(self, steps: int, dt: float) -> DivergedError:
        """Find the first bad step by taking the last steps again, one by one; leave the last good state."""
        pipeline = self._wake()
        pipeline.restore()
        pipeline.alarm()  # that of the steps undone is no longer of interest
        good, good_memory = pipeline.state.read(), pipeline.memory()
        before, time = good[:2], self.time
        for step in range(1, steps + 1):
            pipeline.stepper.advance(1, dt, time)
            time = self.time + step * dt
            after = pipeline.state.read()[:2]
            alarm = pipeline.alarm()
            if self._out_of_bounds(pipeline.diagnostics.measure()) or alarm:
                break
            before = after
        finite = bool(np.isfinite(after[0]).all() and np.isfinite(after[1]).all())
        failure = Failure.of_state(self.assembly, *(after if finite else before))
        pipeline.state.write(*good)
        pipeline.remember(good_memory)
        self._measurement = None
        stable = self.stable_dt()
        if alarm:
            return DivergedError(f"diverged at t = {time:.6g} s: {alarm}", time=time, stable_dt=stable)
        frequencies = stability.element_frequencies(self._network)
        message = describe(failure, self.assembly, time, dt, stable, frequencies, finite)
        return DivergedError(message, time=time, stable_dt=stable)

    # -- life ---------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a checkpoint (.npz) that :meth:`load` continues bit for bit."""
        settings = self._settings
        checkpoint.write(
            path,
            checkpoint.Checkpoint(
                scene=self.scene,
                time=self.time,
                positions=self.positions(),
                velocities=self.velocities(),
                force_velocities=self.force_velocities(),
                arch=settings.arch,
                precision=settings.precision,
                memory=self.memory,
            ),
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, arch: str | None = None, threads: int | None = None) -> "Simulation":
        """The simulation of a checkpoint. Raises SceneError where the file is none."""
        saved = checkpoint.read(path)
        simulation = cls(saved.scene, arch=arch or saved.arch, precision=saved.precision, threads=threads)
        simulation.set_state(saved.positions, saved.velocities, saved.time, saved.force_velocities, saved.memory)
        return simulation

    def suspend(self) -> None:
        """Leave Taichi, keeping the state; the next use builds everything again."""
        if self._pipeline is not None:
            self._asleep = self._pipeline.state.read()
            self._asleep_memory = self._pipeline.memory()
            self._pipeline = None

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
            if self._asleep_memory is None:
                self._first_memory = self._pipeline.memory()
            else:
                self._pipeline.remember(self._asleep_memory)
                self._pipeline.set_time(self.time)
            runtime.register(self)
        return self._pipeline
