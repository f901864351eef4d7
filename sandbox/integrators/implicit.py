"""Implicit Euler and the implicit midpoint rule: a step's velocity from the forces of the state that it leads to.

With a = theta h, Newton's method solves M (v - v0) = a (F(x0 + a v, v) - gamma M v) for v, the velocity at theta
of the step; then x1 = x0 + h v and v1 = v0 + (v - v0) / theta. Drag belongs to the forces, so that it is of the
scheme's order and no more exact than that. The trial state x0 + a v, v is in the slot that the step's end goes to.

Springs flow and tear once, at the start. Colliders bear what rests on them or flies into them within the solve
(:mod:`sandbox.integrators.resting`); what is left of it, and carriers, follow at the end as in every scheme.

Small scenes take all steps of a call in one serial launch; with colliders, whose code is long, four launches a step,
as Taichi's time to compile grows with the square of a kernel. Large scenes take a launch for every pass, and the
host is told what comes next. All go by the same decisions, of :mod:`sandbox.integrators.newton`.
"""

from typing import Any

import taichi as ti

from sandbox.integrators.implicit_passes import ImplicitPasses
from sandbox.integrators.newton import DONE, SOLVE
from sandbox.integrators.schemes import ImplicitScheme
from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Solver
from sandbox.state import ParticleState


@ti.data_oriented
class Implicit(ImplicitPasses):
    """Advances a state by an implicit scheme with the given parts."""

    def __init__(
        self,
        builder: ti.FieldsBuilder,
        scheme: ImplicitScheme,
        state: ParticleState,
        parts: Parts,
        solver: Solver,
        drag: float,
        pinned: bool,
        serial: bool,
    ) -> None:
        super().__init__(builder, scheme, state, parts, solver, drag, pinned)
        self.serial = serial

    def load(self, assembly: Assembly) -> None:
        """Upload what the parts of the stepper must know."""
        for resting in self.resting:
            resting.load(assembly)

    def report(self) -> dict[str, float]:
        """How hard the steps since the start were to solve, see :meth:`Newton.report`."""
        return self.newton.report()

    # -- memory -------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Remember how particles rest now."""
        for resting in self.resting:
            resting.keep()

    def restore(self) -> None:
        """Go back to what was kept."""
        for resting in self.resting:
            resting.restore()

    def memory(self) -> dict[str, Any]:
        """How particles rest, for :meth:`remember`."""
        return {name: values for resting in self.resting for name, values in resting.memory().items()}

    def remember(self, values: dict[str, Any]) -> None:
        """Set how particles rest."""
        for resting in self.resting:
            resting.remember(values)

    # -- ways to take a step ------------------------------------------------------------------------

    def advance(self, steps: int, dt: float, time: float) -> None:
        """Take ``steps`` steps of ``dt`` [s] from ``time`` [s]."""
        for contact in self.contact:
            contact.invalidate()
        slot = self.state.slot
        if self.serial and not self.resting:
            self._run_serial(slot, steps, dt, time)
        else:
            for step in range(steps):
                # With contact a step ends in the slot that it began in.
                self._step(slot if self.contact else (slot + step) % 2, dt, time + step * dt)
        if not self.contact:
            self.state.slot = (slot + steps) % 2

    def _step(self, slot: int, dt: float, time: float) -> None:
        self._begin(slot, dt, time)
        self._solve(slot, dt, time)
        while self.resting and self._revise(slot, dt):
            self._solve(slot, dt, time)
        self._finish(slot, dt)
        if self.contact and not self.serial:
            self.contact[0].resolve(1 - slot, slot, dt)

    def _solve(self, slot: int, dt: float, time: float) -> None:
        if self.serial:
            self._solve_serial(slot, dt, time)
            return
        while (code := self._evaluate(slot, dt, time)) != DONE:
            if code == SOLVE:
                going = self._linearise(slot, dt)
                while going:
                    going = self._iterate(slot, dt)
            self._move(slot, dt, code)

    @ti.kernel
    def _run_serial(self, slot: int, steps: int, dt: float, time: float):
        ti.loop_config(serialize=True)
        for n in range(steps):
            source = (slot + n) % 2
            if ti.static(self.contact):
                source = slot
            self.begin(source, dt, time + n * dt)
            self.solve(source, dt, time + n * dt)
            self.finish_serial(source, dt)

    @ti.kernel
    def _solve_serial(self, slot: int, dt: float, time: float):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.solve(slot, dt, time)

    @ti.func
    def solve(self, slot, dt, time):
        """All of Newton's iterations, within a serial loop."""
        code = SOLVE
        while code != DONE:
            self.evaluate(slot, dt, time)
            code = self.newton.code[0]
            if code != DONE:
                if code == SOLVE:
                    self.linearise(slot, dt)
                    while self.linear.going[0] == 1:
                        self.iterate(slot, dt)
                self.move(slot, dt, code)

    @ti.func
    def finish_serial(self, slot, dt):
        """The end of a step, within a serial loop."""
        self.finish(slot, dt)
        if ti.static(self.contact):
            self.contact[0].resolve_serial(1 - slot, slot, dt)

    @ti.kernel
    def _begin(self, slot: int, dt: float, time: float):
        if ti.static(self.serial):
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.begin(slot, dt, time)
        else:
            self.begin(slot, dt, time)

    @ti.kernel
    def _revise(self, slot: int, dt: float) -> ti.i32:
        if ti.static(self.serial):
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.revise(slot, dt)
        else:
            self.revise(slot, dt)
        return ti.cast(self.newton.code[0] != DONE, ti.i32)

    @ti.kernel
    def _finish(self, slot: int, dt: float):
        if ti.static(self.serial):
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.finish_serial(slot, dt)
        else:
            self.finish(slot, dt)

    @ti.kernel
    def _evaluate(self, slot: int, dt: float, time: float) -> ti.i32:
        self.evaluate(slot, dt, time)
        return self.newton.code[0]

    @ti.kernel
    def _linearise(self, slot: int, dt: float) -> ti.i32:
        self.linearise(slot, dt)
        return self.linear.going[0]

    @ti.kernel
    def _iterate(self, slot: int, dt: float) -> ti.i32:
        self.iterate(slot, dt)
        return self.linear.going[0]

    @ti.kernel
    def _move(self, slot: int, dt: float, code: int):
        self.move(slot, dt, code)
