"""What a running simulation can be asked."""

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.acting import Acting
from sandbox.diagnostics import Energy, Measurement
from sandbox.parts import Parts
from sandbox.pipeline import Memory, Pipeline
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Scene
from sandbox.state import ParticleState
from sandbox.warning_log import WarningLog

if TYPE_CHECKING:
    from sandbox.output.inline import InlinePicture

FloatArray = NDArray[np.float64]


class Observed:
    """A simulation as those see it who only look."""

    scene: Scene
    time: float
    """Simulated time [s]."""
    assembly: Assembly
    acting: Acting | None
    warning_log: WarningLog
    _settings: runtime.Settings
    _measurement: Measurement | None

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
    def warnings(self) -> list[str]:
        """What could not be done so far, one line each; empty where all went as the scene says."""
        return self.warning_log.lines

    @property
    def state(self) -> ParticleState:
        """The fields themselves, for renderers and diagnostics; in the assembly's order."""
        return self._wake().state

    @property
    def laws(self) -> list[Any]:
        """Force laws of the scene, in the order of their sum."""
        return self._wake().parts.laws

    @property
    def parts(self) -> Parts:
        """What acts in the scene."""
        return self._wake().parts

    @property
    def torn(self) -> Any:
        """Field of marks, nonzero where a spring has torn, shape (spring_count,); None where none can."""
        tears = self._wake().parts.tears
        return tears[0].torn if tears else None

    @property
    def memory(self) -> Memory:
        """What the scene's parts remember beyond positions and velocities, by name: for :meth:`set_state`."""
        acts = {} if self.acting is None else self.acting.actor.memory()
        return self._wake().memory() | acts

    def positions(self) -> FloatArray:
        """Particle positions [m], shape (particle_count, dimension), in the scene's order."""
        return self.assembly.scene_order(self._read()[0])

    def velocities(self) -> FloatArray:
        """Particle velocities [m/s], shape (particle_count, dimension), in the scene's order."""
        return self.assembly.scene_order(self._read()[1])

    def force_velocities(self) -> FloatArray:
        """Velocities that forces see [m/s], like :meth:`velocities`: these, or the scheme's prediction of them."""
        return self.assembly.scene_order(self._read()[2])

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

    def solver_report(self) -> dict[str, float]:
        """What an iterating scheme says of its work since the pipeline was built; empty for explicit schemes."""
        stepper = self._wake().stepper
        return stepper.report() if hasattr(stepper, "report") else {}

    @property
    def tallies(self) -> list[Any]:
        """Fields that count how steps went, for :meth:`solver_report`."""
        return list(self._wake().stepper.tallies)

    def state_hash(self) -> str:
        """SHA-256 of positions and velocities: equal for equal trajectories."""
        digest = hashlib.sha256()
        for values in (self.positions(), self.velocities()):
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()

    def show(self, size: tuple[int, int] | None = None) -> "InlinePicture":
        """A picture of the state now that notebooks show by themselves, ``size`` pixels wide and high.

        By default as large as the scene says. It has ``pixels``, and ``save(path)``.
        """
        from sandbox.notebook import picture_of  # one floor up: only who wants a picture loads what draws it

        return picture_of(self, size)

    def _read(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        raise NotImplementedError

    def _wake(self) -> Pipeline:
        raise NotImplementedError
