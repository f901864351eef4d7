"""Implicit Euler and the implicit midpoint rule: a step's velocity from the forces of the state that it leads to.

With a = theta h, Newton's method solves M (v - v0) = a (F(x0 + a v, v) - gamma M v) for v, the velocity at theta
of the step; then x1 = x0 + h v and v1 = v0 + (v - v0) / theta. Drag belongs to the forces, so that it is of the
scheme's order and no more exact than that. The trial state x0 + a v, v is in the slot that the step's end goes to.

Springs flow and tear once, at the start. Colliders bear what rests on them or flies into them within the solve
(:mod:`sandbox.integrators.resting`); what is left of it, and carriers, follow at the end as in every scheme.

The midpoint rule goes as far beyond the state that it solves for as that is from the start, which keeps energy on
linear springs but has no bounds of its own. So where its equation could not be solved in a step, or rounding is more
than what acts, that step is one of implicit Euler, which takes energy out: the solve starts over with theta = 1.

Small scenes take all steps of a call in one serial launch; with colliders, whose code is long, four launches a step,
as Taichi's time to compile grows with the square of a kernel. Large scenes take a launch for every pass, and the
host is told what comes next. All go by the same decisions, of :mod:`sandbox.integrators.newton`.
"""

import taichi as ti

from sandbox.integrators.implicit_passes import ImplicitPasses
from sandbox.integrators.newton import DONE, SOLVE
from sandbox.scene.assemble import Assembly


@ti.data_oriented
class Implicit(ImplicitPasses):
    """Advances a state by an implicit scheme: the order of the passes, and who decides on it."""

    def load(self, assembly: Assembly) -> None:
        """Upload what the parts of the stepper must know."""
        for resting in self.resting:
            resting.load(assembly)

    def report(self) -> dict[str, float]:
        """How hard the steps since the start were to solve, see :meth:`Newton.report`."""
        return self.newton.report()

    # -- ways to take a step ------------------------------------------------------------------------

    def run_serial(self, slot: int, steps: int, dt: float, time: float) -> None:
        """All steps in one launch, unless colliders make that too long to compile."""
        if self.resting:
            self.run_stepwise(slot, steps, dt, time)
        else:
            self._run_serial(slot, steps, dt, time)

    def take_step(self, step: int, steps: int, slot: int, dt: float, time: float) -> None:
        """One step: solve for its end, and again while colliders correct what they bear."""
        self._begin(slot, step, dt, time)
        self._solve(slot, step, dt, time)
        while self.resting and self._revise(slot, dt):
            self._solve(slot, step, dt, time)
        self._finish(slot, dt)

    def meet_others(self, slot: int, dt: float) -> None:
        """Of a small scene, particles have met each other in the launch that finished the step."""
        if not self.serial:
            super().meet_others(slot, dt)

    def _solve(self, slot: int, step: int, dt: float, time: float) -> None:
        if self.serial:
            self._solve_serial(slot, step, dt, time)
            return
        while True:
            code = self._evaluate(slot, step, dt, time)
            if code == DONE:
                if not (self.falls_back and self._is_lost()):
                    return
                self._fall_back(slot, dt)
            else:
                if code == SOLVE:
                    going = self._linearise(slot, dt)
                    while going:
                        going = self._iterate(slot, dt)
                self._move(slot, dt, code)

    @ti.kernel
    def _run_serial(self, slot: int, steps: int, dt: float, time: float):
        ti.loop_config(serialize=True)
        for n in range(steps):
            begun = self.slot_at(slot, n)
            self.begin(begun, dt, time + n * dt)
            self.solve(begun, dt, time + n * dt)
            self.finish_serial(begun, dt)

    @ti.kernel
    def _solve_serial(self, slot: int, step: int, dt: float, time: float):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.solve(slot, dt, time + step * dt)

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
            elif ti.static(self.falls_back):
                if self.is_lost() == 1:
                    self.open(slot, dt, 1.0)
                    code = SOLVE

    @ti.func
    def finish_serial(self, slot, dt):
        """The end of a step, within a serial loop."""
        self.finish(slot, dt)
        self.meet_others_serial(slot, dt)

    @ti.kernel
    def _begin(self, slot: int, step: int, dt: float, time: float):
        if ti.static(self.serial):
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.begin(slot, dt, time + step * dt)
        else:
            self.begin(slot, dt, time + step * dt)

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
    def _evaluate(self, slot: int, step: int, dt: float, time: float) -> ti.i32:
        self.evaluate(slot, dt, time + step * dt)
        return self.newton.code[0]

    @ti.kernel
    def _is_lost(self) -> ti.i32:
        return self.is_lost()

    @ti.kernel
    def _fall_back(self, slot: int, dt: float):
        self.open(slot, dt, 1.0)

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
