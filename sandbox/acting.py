"""Carries what an actor says into a running simulation, and takes orders while it runs."""

import warnings
from typing import Any

from sandbox.actions.actor import Actor
from sandbox.actions.choosing import Grip, gripped
from sandbox.actions.event import Event, Situation
from sandbox.actions.grips import Segment
from sandbox.pipeline import Memory
from sandbox.scene.action_plan import most_at_once
from sandbox.scene.model import Action, Grab, Push, Shake
from sandbox.warning_log import WarningKind


class ActionWarning(UserWarning):
    """An action found nothing to act on."""


class Acting:
    """The actions of a simulation.

    Parameters
    ----------
    simulation : the :class:`sandbox.Simulation` whose they are
    """

    def __init__(self, simulation: Any) -> None:
        self.simulation = simulation
        self.actor = Actor(simulation.assembly)

    # -- while time goes on -------------------------------------------------------------------------

    @property
    def next_time(self) -> float:
        """When something happens next [s]; infinity where nothing will."""
        return self.actor.next_time

    def perform_due(self) -> None:
        """Do all that is due now."""
        while (event := self.actor.due(self.simulation.time)) is not None:
            self._perform(event)

    def _perform(self, event: Event) -> None:
        simulation = self.simulation
        ledger = simulation.parts.ledger
        before = simulation.energy().total if ledger else 0.0
        change = self.actor.perform(event, Situation(simulation))
        if change.found_nothing:
            simulation.warning_log.note(WarningKind.ACTION, change.found_nothing, f"actions[{event.action}]")
            warnings.warn(change.found_nothing, ActionWarning, stacklevel=2)
        if change.assembly is not None:
            simulation.change(change.assembly, change.memory)
        if change.state is not None:
            simulation.state.write(*change.state)
        if change.solver is not None:
            simulation.switch_solver(change.solver)
        if change.stiffer:
            simulation.stiffened(self.actor.stiffest)
        if change.state is not None:
            simulation.forget_measurement()
        for books in simulation.parts.ledger:
            books.book("action", simulation.energy().total - before)
            simulation.forget_measurement()

    def recall(self, memory: Memory) -> bool:
        """Go by what was remembered; whether the scene's numbers are others for it."""
        before = self.simulation.assembly
        self.actor.remember(memory)
        base = self.actor.base
        self.simulation.assembly = self.actor.current() if self.actor.changes else base
        return before is not base or self.actor.changes

    # -- orders -------------------------------------------------------------------------------------

    def act(self, action: Action) -> int:
        """Have something done now or later; the number of the action."""
        number = self.actor.add(action)
        self._tell()
        return number

    def amend(self, number: int, action: Action) -> None:
        """Have an action be another one of the same kind, of which nothing has happened yet but what has happened."""
        self.actor.actions[number] = action
        self._tell()

    def end(self, number: int, action: Grab) -> None:
        """End a grab of open end as ``action`` says."""
        self.actor.actions[number] = action
        self.actor.end(number, action.end)
        self._tell()

    def lead(self, number: int, segment: Segment) -> None:
        """Lead the hand of a grab along a segment."""
        if number in self.actor.grips:
            self.simulation.parts.grips[0].lead(self.actor.grips.index(number), segment)

    def gripped(self, action: Grab) -> Grip | None:
        """What a grab would take now; None where there is nothing."""
        simulation = self.simulation
        positions = simulation.assembly.internal_order(simulation.positions())
        return gripped(simulation.assembly, positions, self.actor.free, action)

    def has_room(self, action: Action) -> bool:
        """Whether there is room for a grab, a push or a shake beside the others of its time."""
        room = {Grab: self.actor.plan.grips, Push: self.actor.plan.pushes, Shake: self.actor.plan.shakes}
        for kind, most in room.items():
            if isinstance(action, kind):
                return most_at_once([*(a for a in self.actor.actions if isinstance(a, kind)), action]) <= most
        return True

    @property
    def free_hands(self) -> int:
        """Hands that could take something in the next step."""
        now = self.simulation.time
        return self.actor.grips.count(-1) + self.actor.opening(now)

    def forget(self, given: int) -> None:
        """Forget all actions but the first ``given``."""
        self.actor.forget(given)
        self._tell()

    def _tell(self) -> None:
        simulation = self.simulation
        actions = tuple(self.actor.actions)
        simulation.scene = simulation.scene.model_copy(update={"actions": actions})
