"""Which stepper carries out which kind of scheme."""

from typing import Any, Protocol

from sandbox.integrators.kick_drift import KickDrift
from sandbox.integrators.runge_kutta import RungeKutta
from sandbox.integrators.schemes import RungeKuttaScheme, Scheme, SplittingScheme
from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState


class Stepper(Protocol):
    """What every scheme's machinery does."""

    def advance(self, steps: int, dt: float, time: float) -> None:
        """Take ``steps`` steps of ``dt`` [s] from ``time`` [s]; afterwards x and v are of the same time."""


def stage_slots(scheme: Scheme) -> int:
    """States beside the first that a scheme goes through within a step, and keeps."""
    return scheme.stages - 1 if isinstance(scheme, RungeKuttaScheme) else 0


def build_stepper(
    builder: Any, scheme: Scheme, state: ParticleState, parts: Parts, assembly: Assembly, serial: bool
) -> Stepper:
    """The stepper of a scheme, for just the parts of a scene; to be called before the tree is finalised."""
    pinned = bool((assembly.inverse_masses == 0.0).any())
    scene = assembly.scene
    match scheme:
        case SplittingScheme():
            return KickDrift(scheme, state, parts, scene.drag, pinned, serial)
        case RungeKuttaScheme():
            return RungeKutta(builder, scheme, state, parts, scene.drag, pinned, serial)
        case _:
            raise NotImplementedError(scene.solver.integrator)
