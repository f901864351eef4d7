"""Carries out the actions of a scene: what is due at a time, and what it does to bodies, springs and hands.

Actions happen between steps: a simulation cuts its way at their times. What lasts, a grip, a push, a shake, is a
force law that is filled when it begins and emptied when it ends; all else changes the state or the numbers of the
scene once. Nothing is compiled for it while a simulation runs.
"""

import bisect
import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.actions.choosing import Grip, chosen, crossed, gripped, particles_of
from sandbox.actions.event import BEGINS, ENDS, Change, Event, Memory, Situation, moments
from sandbox.actions.grips import Segment
from sandbox.errors import SceneError
from sandbox.forces.changing_springs import memory_name
from sandbox.scene.assemble import Assembly
from sandbox.scene.attachments import Carried
from sandbox.scene.model import (
    Action,
    Cut,
    Grab,
    PinDown,
    Poke,
    Push,
    Shake,
    Soften,
    Solver,
    Spawn,
    Stiffen,
    Switch,
    Unpin,
)

_SWINGS = 2.0 * math.pi * 2.0
"""Frequency at which a grip's springs swing a body, if nobody says how stiff they are [rad/s]."""
_STRENGTH = 5.0 * 9.81
"""Largest force of a grip over the body's mass, if nobody says [m/s^2]."""
_STABLE = 0.3
"""Most of dt times the frequency, or the rate, of a grip's springs at one particle: any scheme can take that [1]."""


class Actor:
    """The time line of a scene's actions, and what of the scene they have changed so far."""

    def __init__(self, assembly: Assembly) -> None:
        self.base = assembly
        self.plan = assembly.plan
        self.actions: list[Any] = list(assembly.scene.actions)
        self.events = sorted(itertools.chain.from_iterable(map(self._events_of, range(len(self.actions)))))
        self.begin_again()

    def begin_again(self) -> None:
        """Nothing has happened yet."""
        self.done = 0
        self.factors = np.ones(self.base.spring_count)
        """Stiffness of every spring over that of the scene, 0 where it is cut, shape (S,)."""
        self.held = self.base.inverse_masses == 0.0
        """True where particles do not move by themselves, shape (N,)."""
        self.led = np.ones(len(self.base.carried.particles), dtype=bool)
        """True where particles that were carried at the start still are, shape (C,)."""
        self.entered = np.array([i not in self.plan.entering for i in range(len(self.base.scene.bodies))])
        self._parting: set[int] = set()
        """Cuts that have parted something."""
        self.grips: list[int] = [-1] * self.plan.grips
        """Action that has every grip, or -1."""
        self.shakes: list[int] = [-1] * self.plan.shakes
        self.pushes: list[int] = [-1] * self.plan.pushes
        """Action that has every place for a push, or -1."""
        self.taken: dict[int, Grip] = {}
        """What hands took, by action."""
        self._forces = np.zeros((self.plan.pushes, *self.base.positions.shape))
        """What those push with [N], shape (P, N, d)."""

    # -- the time line ------------------------------------------------------------------------------

    def due(self, time: float) -> Event | None:
        """The next event that is to happen by now [s]; it counts as done."""
        if self.done < len(self.events) and self.events[self.done].time <= time:
            self.done += 1
            return self.events[self.done - 1]
        return None

    @property
    def next_time(self) -> float:
        """When something happens next [s]; infinity where nothing will."""
        return self.events[self.done].time if self.done < len(self.events) else math.inf

    def skip_to(self, time: float) -> None:
        """What lies before a time [s] does not happen any more."""
        self.done = bisect.bisect_left(self.events, (time,), key=lambda event: (event.time,))

    def opening(self, time: float) -> int:
        """Hands that open by now [s] before the next step, less those that take something."""
        soon = [e for e in self.events[self.done :] if e.time <= time and isinstance(self.actions[e.action], Grab)]
        opens = sum(e.order == ENDS for e in soon)
        return opens - sum(e.order == BEGINS and e.part == 0 for e in soon)

    def forget(self, given: int) -> None:
        """Forget all actions but the first ``given``, and all that has happened."""
        del self.actions[given:]
        self.events = sorted(itertools.chain.from_iterable(map(self._events_of, range(given))))
        self.begin_again()

    def add(self, action: Action) -> int:
        """Put an action on the time line while the simulation runs; its number."""
        self.actions.append(action)
        for event in self._events_of(len(self.actions) - 1):
            bisect.insort(self.events, event, lo=self.done)
        return len(self.actions) - 1

    def end(self, action: int, time: float) -> None:
        """End an action of open end at a time [s]."""
        self.events = [e for e in self.events if e.action != action or e.order != ENDS]
        bisect.insort(self.events, Event(time, ENDS, action), lo=self.done)

    def _events_of(self, number: int) -> Iterator[Event]:
        match self.actions[number]:
            case Grab() as grab:
                times = [grab.start, *(waypoint.time for waypoint in grab.path[:-1])]
                yield from (Event(time, BEGINS, number, part) for part, time in enumerate(times) if time < grab.end)
                yield Event(grab.end, ENDS, number)
            case Push() | Shake() as lasting:
                yield Event(lasting.start, BEGINS, number)
                yield Event(lasting.end, ENDS, number)
            case Cut() | Stiffen() | Soften() as gradual:
                for part, time in enumerate(moments(*gradual.span)[1:]):
                    yield Event(time, BEGINS, number, part)
            case Poke() | PinDown() | Unpin() | Spawn() | Switch() as sudden:
                yield Event(sudden.time, BEGINS, number)

    # -- what happens -------------------------------------------------------------------------------

    def perform(self, event: Event, now: Situation) -> Change:
        """Do what an event says; hands and loads are changed at once, the rest is said."""
        action = self.actions[event.action]
        if event.order == ENDS:
            return self._finish(event.action, action, now)
        match action:
            case Grab():
                return self._grab(event, action, now)
            case Push():
                return self._push(event.action, action, now)
            case Shake():
                return self._shake(event.action, action, now)
            case Poke():
                return self._poke(event.action, action, now)
            case Cut():
                parts = len(moments(*action.span)) - 1
                return self._cut(event, action, now, parts)
            case Stiffen() | Soften():
                return self._reform(event.action, action, now, len(moments(*action.span)) - 1)
            case PinDown() | Unpin():
                return self._hold(event.action, action, now)
            case Spawn():
                return self._spawn(action, now)
            case _:
                return Change(solver=_switched(now.solver, action))

    def _finish(self, number: int, action: Any, now: Situation) -> Change:
        if isinstance(action, Grab) and number in self.grips:
            row = self.grips.index(number)
            self.grips[row] = -1
            now.parts.grips[0].let_go(row)
        elif isinstance(action, Shake) and number in self.shakes:
            row = self.shakes.index(number)
            self.shakes[row] = -1
            now.parts.loads[0].shake(row, np.zeros(len(self.held)), np.zeros(self.base.dimension), 0.0, 0.0)
        elif isinstance(action, Push) and number in self.pushes:
            row = self.pushes.index(number)
            self.pushes[row], self._forces[row] = -1, 0.0
            now.parts.loads[0].push_by(self._forces.sum(axis=0))
        return Change()

    # -- hands and loads ----------------------------------------------------------------------------

    def _grab(self, event: Event, action: Grab, now: Situation) -> Change:
        hands = now.parts.grips[0]
        if event.part > 0:
            before, after = action.path[event.part - 1 : event.part + 1]
            # A hand that stays is not led: it rests where it came to, whether or not a waypoint says so.
            if event.action in self.grips and before.position != after.position:
                origin, goal = np.asarray(before.position), np.asarray(after.position)
                hands.lead(self.grips.index(event.action), Segment(before.time, after.time, origin, goal))
            return Change()
        positions = now.state[0]
        grip = gripped(now.assembly, positions, self.free, action)
        if grip is None:
            return _nothing(event.action, "grab")
        row = self.grips.index(-1)
        self.grips[row], self.taken[event.action] = event.action, grip
        mass = float(self.base.masses[self.base.particle_body == grip.body].sum())
        stiffness = action.stiffness or mass * _SWINGS**2
        share = np.zeros(len(positions))
        share[grip.particles] = stiffness / len(grip.particles)
        if action.stiffness is None:
            share = np.minimum(share, self.base.masses * (_STABLE / now.dt) ** 2)
        rate = 2.0 * action.damping_ratio * math.sqrt(mass / stiffness)
        damping = np.minimum(rate * share, self.base.masses * _STABLE / now.dt)
        offset = np.where(share[:, None] > 0.0, positions - grip.middle, 0.0)
        most = (action.max_force or _STRENGTH * mass) / len(grip.particles)
        first = action.path[0] if action.path else None
        hands.take(row, share, damping, offset, most)
        if first is None or np.array_equal(first.position, grip.middle):
            hands.lead(row, Segment(action.start, action.start, grip.middle, grip.middle))
        else:
            hands.lead(row, Segment(action.start, first.time, grip.middle, np.asarray(first.position)))
        return Change()

    def _push(self, number: int, action: Push, now: Situation) -> Change:
        pushed = chosen(now.assembly, now.state[0], action) & ~self.held
        if not pushed.any():
            return _nothing(number, "push")
        row = self.pushes.index(-1)
        self.pushes[row] = number
        self._forces[row] = pushed[:, None] * (np.asarray(action.force) / pushed.sum())
        now.parts.loads[0].push_by(self._forces.sum(axis=0))
        return Change()

    def _shake(self, number: int, action: Shake, now: Situation) -> Change:
        row = self.shakes.index(-1)
        self.shakes[row] = number
        masses = np.where(particles_of(self.base, action.body), self.base.masses, 0.0)
        now.parts.loads[0].shake(row, masses, np.asarray(action.amplitude), action.frequency, action.start)
        return Change()

    # -- once and for all ---------------------------------------------------------------------------

    def _poke(self, number: int, action: Poke, now: Situation) -> Change:
        x, v, seen = now.state
        struck = chosen(now.assembly, x, action) & ~self.held
        if not struck.any():
            return _nothing(number, "poke")
        gain = np.where(struck[:, None], np.asarray(action.impulse) / self.base.masses[struck].sum(), 0.0)
        return Change(state=(x, v + gain, seen + gain))

    def _cut(self, event: Event, action: Cut, now: Situation, parts: int) -> Change:
        begin, end = event.part / parts, (event.part + 1) / parts
        parted = np.asarray(crossed(now.assembly, now.state[0], action, begin, end) & (self.factors > 0.0))
        if not parted.any():
            vain = event.part + 1 == parts and event.action not in self._parting
            return _nothing(event.action, "cut") if vain else Change()
        self._parting.add(event.action)
        self.factors[parted] = 0.0
        marks = now.memory["springs.torn"].copy()
        marks[parted] = 1.0
        return self._sprung(now, {"springs.torn": marks}, parted, 0.0)

    def _reform(self, number: int, action: Stiffen | Soften, now: Situation, parts: int) -> Change:
        mask = chosen(now.assembly, now.state[0], action)
        reformed = np.asarray(mask[now.assembly.springs].all(axis=1))
        if not reformed.any():
            return _nothing(number, action.kind)
        factor = action.factor ** (1.0 / parts)
        self.factors[reformed] *= factor
        change = self._sprung(now, {}, reformed, factor)
        change.stiffer = True
        return change

    def _sprung(self, now: Situation, memory: Memory, which: NDArray[np.bool_], factor: float) -> Change:
        """Springs that are otherwise now: their law has them so, and laws that remember stiffness do too."""
        for behaviour, numbers in self.base.spring_set.behaviours():
            name = f"{memory_name(numbers)}.stiffness"
            if (behaviour.yields or behaviour.tears) and name in now.memory:
                memory[name] = np.where(which[numbers], factor, 1.0) * now.memory[name]
        return Change(assembly=self.current(), memory=memory)

    def _hold(self, number: int, action: PinDown | Unpin, now: Situation) -> Change:
        mask = chosen(now.assembly, now.state[0], action) & self.entered[self.base.particle_body]
        if not mask.any():
            return _nothing(number, action.kind)
        x, v, seen = now.state
        if isinstance(action, PinDown):
            self.held = self.held | mask
            stopped = (mask & (self.base.inverse_masses >= 0.0))[:, None]
            return Change(self.current(), (x, np.where(stopped, 0.0, v), np.where(stopped, 0.0, seen)))
        self.held = self.held & ~mask
        self.led = self.led & ~mask[self.base.carried.particles]
        return Change(assembly=self.current(), stiffer=True)

    def _spawn(self, action: Spawn, now: Situation) -> Change:
        index = next(i for i, body in enumerate(self.base.scene.bodies) if body.name == action.body)
        self.entered[index] = True
        mine = self.base.particle_body == index
        self.held = np.where(mine, self.base.home.pinned, self.held)
        x, v, seen = (values.copy() for values in now.state)
        x[mine] = self.base.home.positions[mine]
        for values in (v, seen):
            values[mine] = np.where(self.held[mine, None], 0.0, self.base.home.velocities[mine])
        return Change(assembly=self.current(), state=(x, v, seen), stiffer=True)

    # -- the scene as it is now ---------------------------------------------------------------------

    @property
    def free(self) -> NDArray[np.bool_]:
        """True where particles can be taken, shape (N,)."""
        return np.asarray(~self.held & self.entered[self.base.particle_body])

    @property
    def changes(self) -> bool:
        """Whether the scene's numbers are others than at the start."""
        held = (self.held != (self.base.inverse_masses == 0.0)).any()
        return bool((self.factors != 1.0).any() or held or not self.led.all())

    def current(self) -> Assembly:
        """The scene's numbers with all that has been changed."""
        springs, carried = self.base.spring_set, self.base.carried
        stiffness, damping = springs.stiffness * self.factors, springs.damping * np.sqrt(self.factors)
        if not self.led.all():
            carried = Carried(carried.particles[self.led], carried.collider[self.led], carried.local[self.led])
        return replace(
            self.base,
            spring_set=replace(springs, stiffness=stiffness, damping=damping),
            inverse_masses=np.where(self.held, 0.0, 1.0 / self.base.masses),
            carried=carried,
        )

    @property
    def stiffest(self) -> float:
        """How many times as stiff as the scene says the springs are that were stiffened most, 1 at least [1]."""
        return float(self.factors.max(initial=1.0))

    def solver_by(self, time: float) -> Solver:
        """How the scene is solved by a time [s], before what happens just then."""
        switches = [action for action in self.actions if isinstance(action, Switch) and action.time < time]
        return functools.reduce(_switched, sorted(switches, key=lambda each: each.time), self.base.scene.solver)

    def use(self, solver: Solver) -> None:
        """The scene is solved otherwise from now on."""
        self.base = replace(self.base, scene=self.base.scene.model_copy(update={"solver": solver}))

    def memory(self) -> Memory:
        """What :meth:`remember` takes."""
        return {
            "actions.done": np.array([float(self.done)]),
            "actions.factors": self.factors.copy(),
            "actions.held": self.held.astype(float),
            "actions.led": self.led.astype(float),
            "actions.entered": self.entered.astype(float),
            "actions.rows": np.array([*self.grips, *self.shakes, *self.pushes], dtype=float),
            "actions.forces": self._forces.copy(),
        }

    def remember(self, values: Memory) -> None:
        """Go by what :meth:`memory` said. Raises SceneError where that was of other actions."""
        done, own = values["actions.done"], values["actions.rows"]
        if not (0 <= done[0] <= len(self.events) and ((own >= -1) & (own < len(self.actions))).all()):
            raise SceneError("state: what was done until then is not what this scene does")
        self.done = int(done[0])
        self.factors = values["actions.factors"].copy()
        self.held, self.led, self.entered = (values[f"actions.{name}"] > 0.5 for name in ("held", "led", "entered"))
        rows = own.astype(int).tolist()
        grips, shakes = self.plan.grips, self.plan.shakes
        self.grips, self.shakes, self.pushes = rows[:grips], rows[grips : grips + shakes], rows[grips + shakes :]
        self._forces = values["actions.forces"].copy()


def _nothing(number: int, verb: str) -> Change:
    return Change(found_nothing=f"actions[{number}]: finds nothing to {verb}")


def _switched(solver: Solver, action: Switch) -> Solver:
    given = {name: getattr(action, name) for name in ("integrator", "dt", "iterations")}
    return solver.model_copy(update={name: value for name, value in given.items() if value is not None})


def check_live(action: Action) -> None:
    """Raise SceneError where an action cannot be done to a simulation that runs already."""
    if not isinstance(action, Grab | Poke | Push | Shake | Cut | PinDown | Unpin | Stiffen | Soften | Switch):
        raise SceneError(f"a {action.kind} must be in the scene from the start")
