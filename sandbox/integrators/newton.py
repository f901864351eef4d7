"""Newton's iteration for a step's velocity: when a direction is needed, how far to go along it, when it is enough.

Decisions alone, made from a few sums over all particles; the passes that make the sums are in
:mod:`sandbox.integrators.implicit_passes`. The line search looks at the slope direction . r, as energies so close
to each other cancel: a step that goes far past the place where the slope vanishes is taken back, and one that ends
far before it is made longer, by regula falsi.

The residual r [N s] is small enough when |M^-1/2 r| is at most ``tolerance`` times |M^-1/2 s|, where s_i is the sum
of the sizes of all impulses that act on particle i; or when it is no larger than what rounding of positions and
velocities leaves of it. Directions are solved for no more precisely than pays: relative to their residual the more
precisely the faster residuals fall (Eisenstat and Walker 1996), and never below what is small enough.
"""

from typing import Any

import numpy as np
import taichi as ti

from sandbox.integrators.conjugate_gradients import ConjugateGradients
from sandbox.state import place

SOLVE, SEARCH, DONE = 0, 1, 2
"""What comes next: a new direction, another way along the last one, nothing."""

MOST_ITERATIONS = 20
"""Most Newton iterations a step, unless the scene says otherwise."""
MOST_ROUNDS = 5
"""Most times that reactions are corrected in a step."""
_MANY_ROUNDS = 3 * MOST_ROUNDS
"""The same while the corrections are larger than all that acts: a step left so would crush what it drives in."""
_OVERSHOOT = 0.25
"""Part of the slope at the start that the slope may have at the end, if of opposite sign [1]."""
_UNDERSHOOT = 0.3
"""Part of it above which, if of the same sign, it pays to go on [1]."""
_MOST_CUTS = 12
_MOST_STRETCHES, _MOST_STRETCH = 2, 3.0
_LEAST_CUT, _MOST_CUT = 0.1, 0.9
_FIRST_FORCING, _LEAST_FORCING = 1e-4, 1e-2
"""Square of how far the first direction's residual is reduced [1], and the least reduction squared of any."""
_NOTABLE = 0.05**2
"""Square of a change of reactions, as part of all impulses, that is left to the next step [1]."""
_LOST = 1e-3**2
"""Square of the part of all impulses above which what is left of the residual means that nothing was solved [1]."""
_DROWNED = 0.1**2
"""Square of the part of all impulses that rounding must leave for a solution to mean anything [1]."""
_UNSOLVED = 0.05**2
"""Square of the part of all impulses above which what is left of a step's residual makes it a wrong one [1]."""
_EXACT = 1e-6
"""Square of the part of the tolerance at which a step needs no direction at all [1]."""
_STEPS, _NEWTON, _MOST_NEWTON, _LINEAR, _MOST_LINEAR, _RESIDUAL, _UNFINISHED, _REPLACED, _WRONG = range(9)


@ti.data_oriented
class Newton:
    """The state of one step's iteration, and a tally of all steps since the start."""

    def __init__(
        self, builder: ti.FieldsBuilder, linear: ConjugateGradients, laws: list[Any], most: int, tolerance: float
    ) -> None:
        self.linear = linear
        self.bounded = [law for law in laws if hasattr(law, "is_outside")]
        self.most = most
        self.tolerance2 = tolerance**2
        fine = linear.sums.fine
        self.way, self.steepness, self.low, self.rise = (place(builder, ti.field(fine), 1) for _ in range(4))
        """Part of the direction gone; slope at its start; the last part after which it was positive, and it there."""
        self.residual, self.impulse, self.before = (place(builder, ti.field(fine), 1) for _ in range(3))
        """|M^-1/2 r|^2 and |M^-1/2 s|^2 at the last trial that was taken; the former at the one before."""
        counts = (place(builder, ti.field(ti.i32), 1) for _ in range(11))
        self.iterations, self.linear_iterations, self.opened, self.cuts, self.stretches, self.rounds, *flags = counts
        self.searching, self.solved, self.code, self.drowned, self.closing = flags
        """The last: how often in this step friction that drove was taken back, see :meth:`reconsider`."""
        self.tally = place(builder, ti.field(fine), 9)

    def report(self) -> dict[str, float]:
        """Iterations a step since the start, mean and most, and the largest relative residual that a step ended with.

        ``unfinished`` is the part of steps that ran out of iterations, ``unsolved`` of those that ended far from a
        solution, ``replaced`` of those that the scheme could not take, see :meth:`is_lost`.
        """
        tally = self.tally.to_numpy()
        steps = max(1.0, float(tally[_STEPS]))
        return {
            "steps": float(tally[_STEPS]),
            "newton_mean": float(tally[_NEWTON]) / steps,
            "newton_most": float(tally[_MOST_NEWTON]),
            "cg_mean": float(tally[_LINEAR]) / steps,
            "cg_most": float(tally[_MOST_LINEAR]),
            "residual": float(np.sqrt(tally[_RESIDUAL])),
            "unfinished": float(tally[_UNFINISHED]) / steps,
            "unsolved": float(tally[_WRONG]) / steps,
            "replaced": float(tally[_REPLACED]) / steps,
        }

    @ti.func
    def start(self):
        """Begin a step."""
        self.way[0], self.low[0] = 1.0, 0.0
        self.iterations[0], self.linear_iterations[0], self.opened[0] = 0, 0, 0
        self.cuts[0], self.stretches[0] = 0, 0
        self.rounds[0], self.searching[0], self.solved[0], self.drowned[0], self.closing[0] = 0, 0, 0, 0, 0
        self.before[0] = 0.0
        self.linear.yielding[0] = 1

    @ti.func
    def is_outside(self) -> ti.i32:
        """1 where the state last prepared is none that forces are defined for."""
        outside = 0
        for law in ti.static(self.bounded):
            outside = ti.max(outside, law.is_outside())
        return outside

    @ti.func
    def decide(self, residual, impulse, slope, steepness):
        """What to do at a trial with these sums: :attr:`residual`, :attr:`impulse`, direction . r now and at first."""
        self.steepness[0] = steepness
        if self.low[0] == 0.0:
            self.rise[0] = steepness
        outside = self.is_outside()
        past = self.searching[0] == 1 and slope < -_OVERSHOOT * self.steepness[0]
        short = self.searching[0] == 1 and slope > _UNDERSHOOT * self.steepness[0]
        code = SOLVE
        if self.cuts[0] < _MOST_CUTS and (outside == 1 or past):
            self._cut(slope, outside)
            code = SEARCH
        elif short and self.cuts[0] == 0 and self.stretches[0] < _MOST_STRETCHES:
            self._stretch(slope)
            code = SEARCH
        else:
            self.before[0] = self.residual[0]
            self.residual[0], self.impulse[0] = residual, impulse
            enough = self.tolerance2 * impulse
            if residual <= _EXACT * enough or self.iterations[0] - self.opened[0] >= self.most:
                code = DONE
            elif self.solved[0] == 1 and residual <= ti.max(enough, self.linear.noise[0]):
                code = DONE
        self.code[0] = code

    @ti.func
    def _cut(self, slope, outside):
        """Go back to where the slope would vanish if it fell evenly since the last place where it was positive."""
        cut = 0.5 * self.linear.sums.one()
        if outside == 0:
            cut = ti.min(ti.max(self.rise[0] / (self.rise[0] - slope), _LEAST_CUT), _MOST_CUT)
        self.way[0] = self.low[0] + cut * (self.way[0] - self.low[0])
        self.cuts[0] += 1

    @ti.func
    def _stretch(self, slope):
        """Go on to where it would vanish if it fell on as since the start."""
        stretch = _MOST_STRETCH * self.linear.sums.one()
        if slope < self.steepness[0]:
            stretch = ti.min(stretch, self.steepness[0] / (self.steepness[0] - slope))
        self.low[0], self.rise[0] = self.way[0], slope
        self.way[0] *= stretch
        self.stretches[0] += 1

    @ti.func
    def begin_solve(self, noise):
        """How precise a linear solve pays, and its start."""
        ratio = ti.cast(_FIRST_FORCING, self.linear.sums.fine)
        if self.solved[0] == 0:
            self.drowned[0] = ti.cast(noise > _DROWNED * self.impulse[0], ti.i32)
        if self.solved[0] == 1 and self.before[0] > 0.0:
            ratio = ti.min(0.81 * (self.residual[0] / self.before[0]) ** 2, _LEAST_FORCING)
        self.linear.start(1 - self.solved[0], noise, ratio, 0.25 * self.tolerance2 * self.impulse[0], _LEAST_FORCING)

    @ti.func
    def aim(self):
        """A direction has been solved for: go all of it."""
        self.iterations[0] += 1
        self.linear_iterations[0] += self.linear.count[0]
        self.way[0] = 1.0
        self.low[0] = 0.0
        self.cuts[0], self.stretches[0] = 0, 0
        self.searching[0], self.solved[0] = 1, 1
        # Where the true stiffness leads downhill without end, the next direction goes by the positive one.
        self.linear.yielding[0] = 1 - self.linear.bent[0]

    @ti.func
    def reconsider(self, change, driven):
        """Reactions change by this |M^-1/2 dr|^2: if that counts, what is reached is a first guess again.

        A part of a stiff body's impulses that does not count may be much for what slides. So what is reached does not
        stand either where friction gave all that slides more than it took, ``driven`` [J]: once more with those held
        that it drove, and if that does not do, without friction of what slides (:meth:`spares`).
        """
        notable = change > _NOTABLE * self.impulse[0]
        again = notable and self.rounds[0] < MOST_ROUNDS and self.iterations[0] < self.most
        if change > self.impulse[0]:
            again = self.rounds[0] < _MANY_ROUNDS
        if not again and driven > 0.0 and self.closing[0] < 2:
            self.closing[0] += 1
            again = True
        if again:
            self.rounds[0] += 1
            self.opened[0] = self.iterations[0]
            self.searching[0], self.solved[0] = 0, 0
            self.code[0] = SOLVE

    @ti.func
    def spares(self) -> ti.i32:
        """1 where a step that is solved for once more is so without friction of what slides."""
        return ti.cast(self.closing[0] == 2, ti.i32)

    @ti.func
    def is_lost(self) -> ti.i32:
        """1 where iterations have ended far from any solution, or rounding is more than what acts."""
        residual = self.residual[0]
        astray = residual > _LOST * self.impulse[0] and residual > self.linear.noise[0]
        return ti.cast(astray or self.drowned[0] == 1, ti.i32)

    @ti.func
    def finish(self, replaced):
        """Enter the step into the tally; ``replaced`` is 1 where another scheme took it."""
        tally = ti.static(self.tally)
        tally[_STEPS] += 1.0
        tally[_REPLACED] += replaced
        tally[_NEWTON] += self.iterations[0]
        tally[_MOST_NEWTON] = ti.max(tally[_MOST_NEWTON], ti.cast(self.iterations[0], self.linear.sums.fine))
        tally[_LINEAR] += self.linear_iterations[0]
        tally[_MOST_LINEAR] = ti.max(tally[_MOST_LINEAR], ti.cast(self.linear_iterations[0], self.linear.sums.fine))
        if self.impulse[0] > 0.0:
            relative = self.residual[0] / self.impulse[0]
            tally[_RESIDUAL] = ti.max(tally[_RESIDUAL], relative)
            if relative > self.tolerance2 and self.residual[0] > self.linear.noise[0]:
                tally[_UNFINISHED] += 1.0
                if relative > _UNSOLVED:
                    tally[_WRONG] += 1.0
