"""How long the steps of a run are: chosen before it, looked at again as shapes change, halved in a rescue."""

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sandbox import limits
from sandbox.contact_limits import bounce_remarks, contact_remarks, elastic_share, falling_step, worst_load
from sandbox.diagnostics import Measurement
from sandbox.errors import SceneError
from sandbox.integrators.schemes import Scheme
from sandbox.scene.assemble import Assembly
from sandbox.stability import FloatArray, SpringNetwork
from sandbox.warning_log import Remark, WarningKind

LONGEST_AUTO_DT = 1.0 / 240.0
"""Step that dt = "auto" takes where stability or accuracy would allow a longer one [s]: contact wants to be seen in
time."""
MOST_STEPS = 1e6
"""Most steps between two pictures; a scene that needs more would seem to hang."""
_MORE_STRAIN = 0.25
"""Largest strain has grown by so much since the limit was last looked at: time to look again [1]."""
_MORE_TORN = 0.02
"""The same of torn springs, as a part of all [1]."""
_MUCH_WEIGHT = 0.1
"""Part of a scene's weight times its size that is a lot of energy [1]."""
_SHORTER, _LONGER = 0.9, 1.25
"""By how much the step must change to be changed at all [1]."""


@dataclass(frozen=True)
class Rescue:
    """A return to the last good picture, with steps half as long from there on."""

    time: float
    """Where the run went on from [s]."""
    dt: float
    """Longest step since [s]."""
    reason: str
    """What had gone wrong."""

    def line(self, count: int) -> str:
        """It was the last one of so many, in a line."""
        return f"rescued {count} times, last from t = {self.time:.4g} s on with dt = {self.dt:.3g} s: {self.reason}"


@dataclass
class EnergyWatch:
    """Notices energy from nowhere, long before bounds of strain and speed are left.

    Only for scenes in which nothing is driven: there the total energy cannot grow, but for the scheme's own error.
    """

    scale: float
    """Energy that would be a lot in this scene [J]: so far the most in motion and springs at once."""

    @classmethod
    def of(cls, assembly: Assembly) -> "EnergyWatch | None":
        """The watch over a scene; None where something is driven."""
        scene = assembly.scene
        moved = any(getattr(collider, "motion", None) for collider in scene.colliders)
        if scene.wind is not None or moved or scene.actions or scene.interaction is not None:
            return None
        extent = float(np.ptp(assembly.positions, axis=0).max())
        weight = float(np.linalg.norm(scene.gravity or 0.0) * assembly.masses.sum())
        return cls(scale=_MUCH_WEIGHT * weight * extent)

    def is_suspicious(self, before: Measurement | None, after: Measurement) -> bool:
        """Whether more energy came between two measurements than was ever in motion and springs."""
        if before is None or not after.finite:
            return False
        self.scale = max(self.scale, before.energy.kinetic + before.energy.elastic)
        return after.energy.total - before.energy.total > self.scale


class StepSize:
    """Chooses the longest step of a scene for its scheme.

    Raises SceneError where no step would do.
    """

    def __init__(self, scheme: Scheme, assembly: Assembly, network: SpringNetwork) -> None:
        self.scheme, self.assembly, self.network = scheme, assembly, network
        self.solver, self.duration = assembly.scene.solver, assembly.scene.duration
        self.load = worst_load(assembly)
        """The body that another one bears worst."""
        self.safety = min(self.solver.safety, elastic_share(assembly))
        """Part of its limit that an automatic step takes [1]."""
        self.longest = min(LONGEST_AUTO_DT, falling_step(assembly), math.inf if self.load is None else self.load.step)
        """Longest automatic step [s]."""
        self.chosen = self._choose(network)
        """Longest step [s], to begin with and since the limit was last looked at."""
        self.first = self.chosen
        self.seen = (0.0, 0.0)
        """Largest strain [1], and torn springs, when the limit was last looked at."""
        self.check(self.chosen)

    def check(self, dt: float) -> None:
        """Raise SceneError where steps of ``dt`` [s] make more a picture than anybody waits for."""
        fps = self.assembly.scene.render.fps
        if dt * fps * MOST_STEPS < 1.0:
            grows = limits.always_grows(self.scheme)
            way = "damp it, or take another solver.integrator" if grows else "raise render.fps"
            raise SceneError(
                f"solver.dt: {dt:.3g} s makes {1.0 / max(dt * fps, 1e-300):.3g} steps a picture, more than "
                f"{MOST_STEPS:g}: soften or densify the stiffest body, or {way}"
            )

    @functools.cached_property
    def limit(self) -> float:
        """Stability limit of the scheme in the shape that the scene starts with [s]; takes a while to find."""
        return self._limit(self.network, self.assembly.positions)

    def remarks(self) -> Iterator[Remark]:
        """What will go wrong with the step; a fixed one has its limit looked for, which takes a while."""
        yield from contact_remarks(self.assembly, self.load, self.chosen)
        yield from bounce_remarks(self.scheme, self.assembly, self.network, self.chosen)
        if self.solver.dt != "auto":
            if self.chosen > (limit := self._run_limit):
                yield Remark(
                    WarningKind.STEP_ABOVE_LIMIT,
                    f"solver.dt = {self.chosen:.4g} s is above the stability limit {limit:.4g} s of "
                    f"{self.solver.integrator} in this scene; expect it to diverge",
                )
        elif self._outlasts_horizon and self.chosen > self._run_limit:
            yield Remark(
                WarningKind.STEP_ABOVE_LIMIT,
                f'solver.dt = "auto" of {self.solver.integrator} is for solver.horizon = {self.solver.horizon:g} s: '
                f"in the {self.duration:g} s of this run vibrations without damping may grow more than tenfold; "
                "raise solver.horizon",
            )

    @property
    def _outlasts_horizon(self) -> bool:
        """Whether the run is longer than a scheme that lets all vibrations grow keeps them small."""
        return limits.always_grows(self.scheme) and self.duration > self.solver.horizon

    @functools.cached_property
    def _run_limit(self) -> float:
        """Longest step in which vibrations stay small to the run's end, whatever the horizon [s]."""
        if not limits.always_grows(self.scheme):
            return self.limit
        return limits.stable_step(self.scheme, self.network, self.assembly.positions, self.duration)

    def refreshed(
        self,
        dt: float,
        measured: Measurement,
        network: Callable[[], SpringNetwork],
        positions: Callable[[], FloatArray],
    ) -> float:
        """The step to go on with [s] after one of ``dt``: another one only where shapes have changed much.

        The limit is asked for only where strain or tears have grown beyond what was seen when last it was.
        """
        if self.solver.dt != "auto" or self.limit == float("inf") or dt != self.chosen:
            return dt  # it is somebody else's choice, or there is none
        strain, tears = self.seen
        strained = measured.max_strain > strain + _MORE_STRAIN
        torn = measured.torn > tears + _MORE_TORN * self.assembly.spring_count
        if not (strained or torn):
            return dt
        self.seen = (max(strain, measured.max_strain), float(measured.torn))
        wanted = min(self.safety * self._limit(network(), positions()), self.longest)
        if wanted < _SHORTER * dt or (torn and wanted > _LONGER * dt):
            self.chosen = wanted
        return self.chosen

    def for_stiffer(self, dt: float, factor: float) -> float:
        """The step to go on with [s] after one of ``dt`` where springs are at most ``factor`` times as stiff as first.

        No frequency grows by more than the root of that, with damping ratios as they were.
        """
        if self.solver.dt != "auto" or dt != self.chosen or not np.isfinite(self.limit):
            return dt
        fits = min(self.safety * self.limit / max(1.0, factor) ** 0.5, self.longest)
        self.chosen = fits if self.seen == (0.0, 0.0) else min(self.chosen, fits)
        return self.chosen

    def begin_again(self, dt: float) -> float:
        """The step [s] to start the scene anew with, after one of ``dt``; nothing has been seen yet."""
        dt = self.first if dt == self.chosen else dt
        self.chosen, self.seen = self.first, (0.0, 0.0)
        return dt

    def memory(self) -> tuple[float, ...]:
        """What :meth:`remember` takes."""
        return (self.chosen, *self.seen)

    def remember(self, values: Sequence[float]) -> None:
        """Go by what was seen when :meth:`memory` gave this."""
        self.chosen, self.seen = values[0], (values[1], values[2])

    def _limit(self, network: SpringNetwork, positions: FloatArray) -> float:
        return limits.stable_step(self.scheme, network, positions, self.solver.horizon)

    def _choose(self, network: SpringNetwork) -> float:
        wanted = self.solver.dt
        if wanted == "auto":
            if self.limit < float("inf"):
                return min(self.safety * self.limit, self.longest)
            step = limits.accurate_step(
                self.scheme, network, self.assembly.positions, self.assembly.particle_body, self.solver.accuracy
            )
            return min(step, self.longest)
        return float(wanted)
