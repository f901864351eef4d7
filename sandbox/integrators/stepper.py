"""What the steppers of all schemes share: the parts of a scene by what they do in a step, and the frame of a call.

A stepper either takes all steps of a call in one serial launch or goes step by step with parallel launches; both
share its ti.funcs. Which one depends on the size of the scene alone, so that no number of threads changes a result.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.integrators.bookkeeping import Bookkeeping
from sandbox.integrators.kick import DragKick, PlainKick
from sandbox.integrators.preparation import Preparation
from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Solver
from sandbox.state import SLICE, ParticleState

Memory = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Setup:
    """What a stepper is built from, whatever its scheme; before the tree of fields is finalised."""

    builder: ti.FieldsBuilder
    """Takes the stepper's fields."""
    state: ParticleState
    parts: Parts
    assembly: Assembly
    serial: bool
    """Whether one launch takes all steps of a call."""

    @property
    def solver(self) -> Solver:
        """What the scene says of the solver."""
        return self.assembly.scene.solver

    @property
    def drag(self) -> float:
        """Drag rate [1/s]."""
        return self.assembly.scene.drag

    @property
    def pinned(self) -> bool:
        """Whether some particle is held or carried, or may come to be."""
        return self.assembly.can_be_held


@ti.data_oriented
class Stepper:
    """Takes steps of one scheme. What a scheme does in a step is its own; how a call goes is here.

    Parameters
    ----------
    kick : how drag acts in the scheme; plain where it is a force like others
    """

    def __init__(self, setup: Setup, kick: PlainKick | DragKick) -> None:
        state, parts = setup.state, setup.parts
        self.state = state
        self.tallies: list[Any] = []
        """Fields that count how steps went, for reports; they do not change a state."""
        self.serial = setup.serial
        self.drag = setup.drag
        self.laws = parts.laws
        self.slicing = [law for law in parts.laws if hasattr(law, "gather_slice")]
        self.slices = state.capacity // SLICE
        self.evolving = [law for law in parts.laws if getattr(law, "changes", False)]
        self.preparation = Preparation(parts)
        self.colliders = parts.colliders
        self.carriers = parts.carriers
        self.contact = parts.contact
        self.books = [Bookkeeping(state, parts, kick, ledger) for ledger in parts.ledger]
        self.vector = runtime.vector(state.dimension)
        self.remembering: list[Any] = []
        """Parts of the stepper with a memory from step to step."""

    # -- a call -------------------------------------------------------------------------------------

    def advance(self, steps: int, dt: float, time: float) -> None:
        """Take ``steps`` steps of ``dt`` [s] from ``time`` [s]; afterwards x and v are of the same time."""
        for contact in self.contact:
            contact.invalidate()
        if self.serial:
            self.run_serial(self.state.slot, steps, dt, time)
        else:
            self.run_stepwise(self.state.slot, steps, dt, time)
        if not self.contact:
            self.state.slot = (self.state.slot + steps) % 2

    def run_serial(self, slot: int, steps: int, dt: float, time: float) -> None:
        """Take all steps in one launch."""
        raise NotImplementedError

    def run_stepwise(self, slot: int, steps: int, dt: float, time: float) -> None:
        """Take step after step, each in as many launches as it needs."""
        for step in range(steps):
            # With contact a step ends in the slot that it began in.
            begun = slot if self.contact else (slot + step) % 2
            self.take_step(step, steps, begun, dt, time)
            if self.contact:
                self.meet_others(begun, dt)

    def take_step(self, step: int, steps: int, slot: int, dt: float, time: float) -> None:
        """Take one of ``steps`` steps, from ``slot`` to the other one.

        ``time`` [s] is that of the call: kernels add ``step`` dt, which so is rounded alike in both ways to run.
        """
        raise NotImplementedError

    def meet_others(self, slot: int, dt: float) -> None:
        """Have particles that flew to the other slot meet each other; ``slot`` gets what comes of it."""
        self.contact[0].resolve(1 - slot, slot, dt)

    @ti.func
    def slot_at(self, slot, step):
        """Slot that a step of a call begins in, where the call began in ``slot``."""
        begun = (slot + step) % 2
        if ti.static(self.contact):
            begun = slot
        return begun

    @ti.func
    def meet_others_serial(self, slot, dt):
        """The same as :meth:`meet_others` within a serial loop, if there is contact."""
        if ti.static(self.contact):
            self.contact[0].resolve_serial(1 - slot, slot, dt)

    # -- memory -------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Copy what the next step must know of the last one into a backup."""
        for part in self.remembering:
            part.keep()

    def restore(self) -> None:
        """Copy the backup back."""
        for part in self.remembering:
            part.restore()

    def memory(self) -> Memory:
        """What :meth:`remember` takes."""
        return {name: values for part in self.remembering for name, values in part.memory().items()}

    def remember(self, values: Memory) -> None:
        """Set what the next step must know from :meth:`memory`."""
        for part in self.remembering:
            part.remember(values)
