"""Which stepper carries out which kind of scheme."""

from typing import Any

from sandbox.integrators import kick_drift, vbd, xpbd
from sandbox.integrators.implicit import Implicit
from sandbox.integrators.kick_drift import KickDrift
from sandbox.integrators.runge_kutta import RungeKutta
from sandbox.integrators.schemes import (
    ConstraintScheme,
    DescentScheme,
    ImplicitScheme,
    RungeKuttaScheme,
    Scheme,
    SplittingScheme,
)
from sandbox.integrators.stepper import Setup, Stepper
from sandbox.integrators.vbd import VertexBlockDescent
from sandbox.integrators.xpbd import Xpbd
from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState


def stage_slots(scheme: Scheme) -> int:
    """States beside the first that a scheme goes through within a step, and keeps."""
    return scheme.stages - 1 if isinstance(scheme, RungeKuttaScheme) else 0


def takes_slices(scheme: Scheme) -> bool:
    """Whether laws may gather for several particles at once: not where these move one after the other."""
    return not isinstance(scheme, ConstraintScheme | DescentScheme)


def serial_work(scheme: Scheme) -> int:
    """Work, particles + half-edges, up to which one serial launch for all steps of a call is the faster path."""
    match scheme:
        case ConstraintScheme():
            return xpbd.SERIAL_WORK
        case DescentScheme():
            return vbd.VBD_SERIAL_WORK
        case _:
            return kick_drift.SERIAL_WORK


def build_stepper(
    builder: Any, scheme: Scheme, state: ParticleState, parts: Parts, assembly: Assembly, serial: bool
) -> Stepper:
    """The stepper of a scheme, for just the parts of a scene; to be called before the tree is finalised."""
    setup = Setup(builder, state, parts, assembly, serial)
    if isinstance(scheme, ImplicitScheme | DescentScheme):
        for law in parts.laws:
            if hasattr(law, "linearise"):
                law.linearise(builder)
    match scheme:
        case SplittingScheme():
            return KickDrift(setup, scheme)
        case RungeKuttaScheme():
            return RungeKutta(setup, scheme)
        case ImplicitScheme():
            return Implicit(setup, scheme)
        case ConstraintScheme():
            return Xpbd(setup)
        case DescentScheme():
            return VertexBlockDescent(setup)
        case _:
            raise NotImplementedError(assembly.scene.solver.integrator)
