"""Which settings a study tries: every scheme at several steps, by what theory says of its limit and its cost."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sandbox import limits
from sandbox.integrators.schemes import SCHEMES, ConstraintScheme, DescentScheme, RungeKuttaScheme, SplittingScheme
from sandbox.pipeline import network_of
from sandbox.scene.assemble import Assembly, assemble
from sandbox.scene.model import IntegratorName, Precision, Scene
from sandbox.step_size import LONGEST_AUTO_DT
from sandbox.trade.trial import Settings

LIMITED = (1.0, 0.5, 0.25, 0.125)
"""Steps of schemes with a limit, in what dt = "auto" would take [1]."""
UNLIMITED = (4.0, 2.0, 1.0, 0.5, 0.25)
"""Steps of schemes without one, likewise [1]."""
DEAREST = 6.0
"""Settings that are estimated to take so much longer than the scene's own are not tried by default [1]."""
_FAR_TOO_DEAR = 3.0
"""Times DEAREST beyond which not even the longest step of a scheme is tried [1]."""
IN_DOUBLE = (IntegratorName.RK4,)
"""Schemes whose shortest step is tried in f64 too by default: accurate enough for rounding to show, and compiled for
the reference anyway."""
ITERATIONS = (4, 16)
"""Iterations of xpbd and sweeps of vbd a step."""
# Nanoseconds of one core for each half-edge, and for a fifth of each particle: of one evaluation of all forces, of
# a step of an implicit scheme with the iterations that it takes, of one iteration of xpbd or vbd.
_EVALUATION, _IMPLICIT, _ITERATION, _PARTICLE = 3e-9, 100e-9, 8e-9, 5
_CONTACT = 80e-9
"""Time of particle contact for each particle and step [s]."""
_FRAME = 1.5e-3
"""Time of what is done once a picture [s]."""


@dataclass(frozen=True)
class Prospect:
    """What is known of a scheme in a scene before it runs."""

    integrator: IntegratorName
    limit: float
    """Largest stable step [s]; infinity where there is none."""
    dt: float
    """Step that dt = "auto" takes [s]."""
    step_seconds: float
    """Estimated time of a step, or of a step with one iteration where the scheme iterates, on one core [s]."""

    @property
    def order(self) -> int:
        """Order of convergence in smooth motion."""
        return SCHEMES[self.integrator].order

    @property
    def iterates(self) -> bool:
        """Whether its accuracy depends on a number of iterations."""
        return isinstance(SCHEMES[self.integrator], ConstraintScheme | DescentScheme)

    def seconds(self, dt: float, iterations: int | None) -> float:
        """Estimated time of a simulated second [s]."""
        return self.step_seconds * (iterations or 10 if self.iterates else 1) / dt


class Prospects:
    """All schemes in one scene.

    Raises SceneError where the scene cannot be built.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.assembly = scene, assemble(scene)
        self._network = network_of(self.assembly)
        self._known: dict[IntegratorName, Prospect] = {}
        self._limits: dict[Any, float] = {}

    def of(self, integrator: IntegratorName) -> Prospect:
        """What is known of a scheme."""
        if integrator not in self._known:
            self._known[integrator] = self._look_at(integrator)
        return self._known[integrator]

    def own_settings(self) -> Settings:
        """Those of the scene itself, in steps that divide its pictures evenly."""
        solver = self.scene.solver
        dt = self.of(solver.integrator).dt if solver.dt == "auto" else float(solver.dt)
        return Settings(
            solver.integrator, whole_steps(dt, 1.0 / self.scene.render.fps), solver.precision, solver.iterations
        )

    def accurate_step(self, integrator: IntegratorName, accuracy: float) -> float:
        """Step that keeps the slowest deformation true to an accuracy over its period [s], whatever it does else."""
        x, body = self.assembly.positions, self.assembly.particle_body
        return limits.accurate_step(SCHEMES[integrator], self._network, x, body, accuracy)

    def _limit(self, integrator: IntegratorName) -> float:
        """Largest stable step [s]; schemes with the same stability polynomial share it."""
        scheme = SCHEMES[integrator]
        kind: Any = scheme.growth if isinstance(scheme, RungeKuttaScheme) else scheme
        if kind not in self._limits:
            found = limits.stable_step(scheme, self._network, self.assembly.positions, self.scene.duration)
            self._limits[kind] = found
        return self._limits[kind]

    def _look_at(self, integrator: IntegratorName) -> Prospect:
        solver = self.scene.solver
        limit = self._limit(integrator)
        if math.isfinite(limit):
            dt = solver.safety * limit
        else:
            dt = self.accurate_step(integrator, solver.accuracy)
        return Prospect(integrator, limit, min(dt, LONGEST_AUTO_DT), _step_seconds(self.assembly, integrator))


def _step_seconds(assembly: Assembly, integrator: IntegratorName) -> float:
    work = 2 * assembly.spring_count + _PARTICLE * assembly.particle_count
    contact = _CONTACT * assembly.particle_count if assembly.meets_particles else 0.0
    match SCHEMES[integrator]:
        case SplittingScheme():
            return _EVALUATION * work + contact
        case RungeKuttaScheme(stages=stages):
            return _EVALUATION * stages * work + contact
        case ConstraintScheme() | DescentScheme():
            return _ITERATION * work + contact
        case _:
            return _IMPLICIT * work + contact


def whole_steps(dt: float, frame: float) -> float:
    """The step of at most ``dt`` [s] that divides a picture's time evenly [s]."""
    return frame / max(1, math.ceil(frame / dt * (1.0 - 1e-9)))


@dataclass(frozen=True)
class Choice:
    """What the user wants to be tried; None for what fits the scene."""

    schemes: tuple[IntegratorName, ...] = tuple(IntegratorName)
    dts: tuple[float, ...] | None = None
    """Steps of every scheme [s]."""
    iterations: tuple[int, ...] | None = None
    """Of xpbd and vbd."""
    precisions: tuple[Precision, ...] | None = None


def ladder(prospects: Prospects, choice: Choice) -> list[Settings]:
    """All settings to be tried, without those that come to the same.

    What the choice leaves open is filled by what fits the scene: its precision, steps from the longest stable ones
    down to where they become dear.
    """
    frame = 1.0 / prospects.scene.render.fps
    own = prospects.scene.solver.precision
    rungs: dict[Settings, None] = {}
    for integrator in choice.schemes:
        prospect = prospects.of(integrator)
        dts = _dts(prospect, choice, frame)
        counts: Sequence[int | None] = (choice.iterations or ITERATIONS) if prospect.iterates else (None,)
        for iterations in counts:
            tried = dts if choice.dts else _affordable(prospects, prospect, dts, iterations)
            for precision in choice.precisions or (own,):
                for dt in tried:
                    rungs[Settings(integrator, dt, precision, iterations)] = None
            if choice.precisions is None and integrator in IN_DOUBLE:
                rungs[Settings(integrator, tried[-1], Precision.F64, iterations)] = None
    return list(rungs)


def _affordable(prospects: Prospects, prospect: Prospect, dts: list[float], iterations: int | None) -> list[float]:
    """Steps that are not dear against the scene's own settings, and the longest one unless it is far too dear.

    A scheme whose stable steps are all far too dear is tried at the scene's own step: it diverges, which is a row.
    """
    own = prospects.of(prospects.scene.solver.integrator)
    most = DEAREST * own.seconds(own.dt, prospects.scene.solver.iterations)
    if math.isfinite(prospect.limit) and prospect.seconds(dts[0], iterations) > _FAR_TOO_DEAR * most:
        return [whole_steps(own.dt, 1.0 / prospects.scene.render.fps)]
    return [dt for dt in dts if dt == dts[0] or prospect.seconds(dt, iterations) <= most]


def _dts(prospect: Prospect, choice: Choice, frame: float) -> list[float]:
    """Steps to be tried [s], longest first."""
    if choice.dts is not None:
        dts = choice.dts
    elif math.isfinite(prospect.limit):
        dts = tuple(factor * prospect.dt for factor in LIMITED)
    else:
        dts = tuple(factor * prospect.dt for factor in UNLIMITED)
    return sorted({whole_steps(dt, frame) for dt in dts}, reverse=True)


def run_seconds(prospect: Prospect, settings: Settings, horizon: float, fps: float) -> float:
    """Estimated time of a run of a length [s] on one core [s]."""
    return horizon * (prospect.seconds(settings.dt, settings.iterations) + _FRAME * fps)
