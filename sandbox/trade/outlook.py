"""What happens in a scene, and when: the meetings and actions that a study should see before it says what settings are
worth.

Actions and motions of colliders are in the scene. Meetings come of one run with the scene's own settings, to its end or
as far as there is time for: the first of every body with every collider, and of every body with any other body. After
each picture distances are compared with those before it; what closes so fast that it meets before the next picture
counts as met, so that no bounce between two pictures is missed.

A study looks at the scene for long enough to see actions, and the first meeting of every body with a collider and with
another body. What comes after that, and what there is no time for, it names.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sandbox.contact.colliders.depths import Depths
from sandbox.errors import DivergedError
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Keyframe, Move, Scene, Spawn, Switch
from sandbox.simulation import Simulation

FloatArray = NDArray[np.float64]

_TOUCH = 1e-4
"""Distance below which things touch, in sizes of the body [1]."""
_NEAR = 0.5
"""Distance of their boxes, in sizes of the larger one, below which two bodies are looked at closely [1]."""
_SOON = 3.0
"""Pictures within which their boxes would meet, likewise."""
_TOLD = 3
"""Events that a line names."""


@dataclass(frozen=True, order=True)
class Event:
    """Something that happens for the first time."""

    time: float
    """[s]"""
    what: str
    """For a line: ``ball meets floor``."""
    first: bool = True
    """Whether it is an action, or the first meeting of a body with any collider or with any other body."""


@dataclass(frozen=True)
class Outlook:
    """What happens in a scene."""

    events: tuple[Event, ...]
    """After its start, in the order of their times."""
    until: float
    """Time up to which meetings are known [s]."""
    duration: float
    """Of the scene [s]."""

    @classmethod
    def planned(cls, assembly: Assembly) -> "Outlook":
        """What the scene itself says; meetings are known where there can be none."""
        scene = assembly.scene
        known = not _meets_colliders(assembly) and not _meeting_pairs(assembly)
        events = sorted(event for event in _planned(scene) if 0.0 < event.time < scene.duration)
        return cls(tuple(events), scene.duration if known else 0.0, scene.duration)

    def with_meetings(self, events: tuple[Event, ...], until: float) -> "Outlook":
        """The same with what a run has met up to a time [s]."""
        return Outlook(tuple(sorted((*self.events, *events))), max(until, self.until), self.duration)

    def wanted(self, least: float) -> float:
        """Time to look at [s], ``least`` or more: all that happens first, and what it makes a difference to."""
        return _horizon([event for event in self.events if event.first], least, self.duration)

    def unseen(self, horizon: float, predictable: float, frame: float) -> list[str]:
        """What a study did not see, one line each, that looked at ``horizon`` [s] in pictures of ``frame`` [s].

        Of these it compared trajectories over the first ``predictable`` [s].
        """
        if predictable < horizon - 0.5 * frame:
            why = f"no error is known of what comes after {predictable:.3g} s, where the scene turns chaotic"
            late = self._from(predictable - frame)
        else:
            why, late = f"only the first {horizon:.3g} s were looked at", self._from(horizon - 1.5 * frame)
            if late:
                why += f" (--horizon {_horizon(late, horizon, self.duration):.2g} sees more)"
        lines = [f"{why}: not seen: {_listed(late)}"] if late and predictable < self.duration - 0.5 * frame else []
        if self.until < min(self.duration, 1e9) - 0.5 * frame and horizon < self.duration - 0.5 * frame:
            lines.append(
                f"what bodies meet after {max(self.until, horizon):.3g} s is not known: the scene lasts "
                f"{self.duration:.3g} s, which would take long to run"
            )
        return lines

    def _from(self, time: float) -> list[Event]:
        return [event for event in self.events if event.time > time]


def _horizon(events: list[Event], least: float, duration: float) -> float:
    last = max((event.time for event in events), default=0.0)
    return min(least if last <= 0.9 * least else 1.25 * last + 0.25, duration)


def _listed(events: list[Event]) -> str:
    told = [f"{event.what} at {event.time:.3g} s" for event in events[:_TOLD]]
    more = [f"{len(events) - _TOLD} more"] if len(events) > _TOLD else []
    return ", ".join(told + more)


# -- what the scene says ----------------------------------------------------------------------------------------


def _planned(scene: Scene) -> Iterator[Event]:
    """When actions and wind begin, and colliders begin to move."""
    for number, action in enumerate(scene.actions):
        if isinstance(action, Switch):
            continue  # studies choose the solver themselves
        moments = (getattr(action, "start", None), getattr(action, "time", None))
        time = _begins(action.path) if isinstance(action, Move) else moments[0] if moments[1] is None else moments[1]
        if time is not None:
            yield Event(float(time), f"actions[{number}] ({action.kind})")
    for number, collider in enumerate(scene.colliders):
        if (time := _begins(collider.motion)) is not None:
            yield Event(time, f"{collider.name or f'colliders[{number}]'} begins to move")
    if scene.wind is not None:
        yield Event(scene.wind.start, "wind begins to blow")


def _begins(path: tuple[Keyframe, ...]) -> float | None:
    """When something that is led along keyframes first moves [s]; None where it does not."""
    for before, after in itertools.pairwise(path):
        if any(
            value is not None and value != getattr(before, name)
            for name, value in (("position", after.position), ("rotation", after.rotation))
        ):
            return before.time
    return path[0].time if len(path) == 1 else None


# -- what a run shows -------------------------------------------------------------------------------------------


def _free(assembly: Assembly) -> NDArray[np.bool_]:
    """Whether particles are free, or may come to be, shape (N,)."""
    return np.asarray(assembly.unheld().inverse_masses > 0.0)


def _meets_colliders(assembly: Assembly) -> bool:
    return bool(assembly.colliders) and bool(_free(assembly).any())


def _meeting_pairs(assembly: Assembly) -> list[tuple[int, int]]:
    """Bodies that can touch each other."""
    if not assembly.meets_particles:
        return []
    free = np.bincount(assembly.particle_body, _free(assembly), len(assembly.scene.bodies)) > 0
    radii = [float(assembly.radii[assembly.particle_body == body].max(initial=0.0)) for body in range(len(free))]
    solid = [body for body, radius in enumerate(radii) if radius > 0.0]
    families = assembly.families
    return [(a, b) for a in solid for b in solid if a < b and families[a] != families[b] and bool(free[a] or free[b])]


class _Lookout:
    """Distances of bodies from colliders and from each other, picture by picture."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation, assembly = simulation, simulation.assembly
        self.members = [np.flatnonzero(assembly.particle_body == b) for b in range(len(assembly.scene.bodies))]
        self.free = _free(assembly)
        solids, meets = simulation.parts.colliders, _meets_colliders(assembly)
        self.depths = Depths(simulation.state, solids, assembly) if meets else None
        self.pairs = np.array(_meeting_pairs(assembly), dtype=np.int64).reshape(-1, 2)
        self.radii = np.array([float(assembly.radii[rows].max(initial=0.0)) for rows in self.members])
        self.sizes = np.array([float(np.ptp(assembly.positions[rows], axis=0).max()) for rows in self.members])
        self.sizes[self.sizes == 0.0] = float(np.ptp(assembly.positions, axis=0).max()) or 1.0
        names = [body.name for body in assembly.scene.bodies]
        self.enters = np.zeros(len(names))
        for action in assembly.scene.actions:
            if isinstance(action, Spawn):
                self.enters[names.index(action.body)] = action.time
        self.boxes = np.zeros(len(self.pairs))

    def collider_gaps(self) -> FloatArray:
        """Smallest distance of every body's free particles from every collider [m], shape (B, C)."""
        if self.depths is None:
            return np.full((len(self.members), len(self.simulation.scene.colliders)), np.inf)
        gaps = np.where(self.free[:, None], -self.depths.read(), np.inf)
        return np.array([gaps[rows].min(axis=0, initial=np.inf) for rows in self.members])

    def body_gaps(self, met: NDArray[np.bool_]) -> FloatArray:
        """Smallest distance of the particles of two bodies [m], of every pair that has not ``met``, shape (P,)."""
        if not len(self.pairs):
            return np.zeros(0)
        x = self.simulation.assembly.internal_order(self.simulation.positions())
        low, high = (np.array([pick(x[rows], axis=0) for rows in self.members]) for pick in (np.min, np.max))
        a, b = self.pairs.T
        apart = np.maximum(np.maximum(low[a] - high[b], low[b] - high[a]), 0.0)
        gaps = np.linalg.norm(apart, axis=1) - self.radii[a] - self.radii[b]
        near = gaps < _NEAR * np.maximum(self.sizes[a], self.sizes[b])
        near |= gaps < _SOON * (self.boxes - gaps)
        self.boxes = gaps.copy()
        for pair in np.flatnonzero(near & ~met):
            one, other = sorted((x[self.members[body]] for body in self.pairs[pair]), key=len)
            distance, _ = cKDTree(other).query(one)
            gaps[pair] = distance.min() - self.radii[self.pairs[pair]].sum()
        return np.asarray(gaps)


def meetings(simulation: Simulation, frames: int, check: Callable[[], Any]) -> tuple[tuple[Event, ...], float]:
    """First meetings in a run of so many pictures from the scene's start, and the time up to which it came [s].

    ``check()`` is called before every picture; where it returns True, the run ends there.
    """
    lookout, frame = _Lookout(simulation), 1.0 / simulation.scene.render.fps
    solids = (len(lookout.members), len(simulation.scene.colliders))
    times: list[FloatArray] = [np.full(solids, np.inf), np.full(len(lookout.pairs), np.inf)]
    before = [np.full_like(values, np.inf) for values in times]
    for number in range(frames + 1):
        entered = lookout.enters <= simulation.time
        there = (np.broadcast_to(entered[:, None], solids), entered[lookout.pairs].all(axis=1))
        gaps = [lookout.collider_gaps(), lookout.body_gaps(np.isfinite(times[1]))]
        touch = (_TOUCH * lookout.sizes[:, None], _TOUCH * lookout.sizes[lookout.pairs].min(axis=1))
        for k in range(2):
            gaps[k] = np.where(there[k], gaps[k], np.inf)
            found = _meeting_times(before[k], gaps[k], touch[k], simulation.time, frame)
            times[k] = np.minimum(times[k], found)
        before = gaps
        if number == frames or check():
            break
        try:
            simulation.step_frame()
        except DivergedError:
            break
    return tuple(_told(lookout, times)), simulation.time


def _meeting_times(before: FloatArray, now: FloatArray, touch: Any, time: float, frame: float) -> FloatArray:
    """When distances [m] close, those that touch already or do before the next picture; infinity for others [s]."""
    with np.errstate(invalid="ignore", divide="ignore"):
        closing = np.where(np.isfinite(before), before - now, 0.0)
        soon = (closing > 0.0) & (now <= closing)
        later = np.where(soon, time + frame * np.clip(now / closing, 0.0, 1.0), np.inf)
    return np.where(now <= touch, time, later)


def _told(lookout: _Lookout, times: list[FloatArray]) -> Iterator[Event]:
    """All meetings but those from the start, and of pairs of bodies only the first of one of them."""
    scene = lookout.simulation.scene
    names = [body.name for body in scene.bodies]
    solids = [collider.name or f"colliders[{index}]" for index, collider in enumerate(scene.colliders)]
    for body, row in enumerate(np.where(times[0] > 0.0, times[0], np.inf)):
        for index in np.flatnonzero(np.isfinite(row)):
            yield Event(float(row[index]), f"{names[body]} meets {solids[index]}", bool(row[index] == row.min()))
    first: dict[int, int] = {}
    for pair in np.argsort(times[1], kind="stable"):
        if 0.0 < times[1][pair] < np.inf:
            for body in lookout.pairs[pair]:
                first.setdefault(int(body), int(pair))
    for pair in sorted(set(first.values())):
        a, b = lookout.pairs[pair]
        yield Event(float(times[1][pair]), f"{names[a]} meets {names[b]}")
