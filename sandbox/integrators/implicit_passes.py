"""The passes of an implicit step over all particles; the order in which they run belongs to the stepper.

The trial state x0 + a v, v is in the slot that the step's end goes to.
"""

from dataclasses import replace

import taichi as ti

from sandbox import runtime
from sandbox.integrators.bearing import FREE
from sandbox.integrators.block_sums import BLOCK, BlockSums
from sandbox.integrators.conjugate_gradients import ConjugateGradients
from sandbox.integrators.kick import PlainKick
from sandbox.integrators.newton import DONE, MOST_ITERATIONS, SEARCH, Newton
from sandbox.integrators.resting import Resting
from sandbox.integrators.schemes import ImplicitScheme
from sandbox.integrators.step_end import StepEnd
from sandbox.integrators.stepper import Setup, Stepper
from sandbox.state import SLICE, place

_RESIDUAL, _IMPULSE, _SLOPE, _STEEPNESS = 0, 1, 2, 3
_CHANGE, _FRACTION, _DRIVEN = 0, 1, 2


@ti.data_oriented
class ImplicitPasses(Stepper):
    """What is done to every particle in a step; loops run in parallel where a kernel calls them outermost."""

    def __init__(self, setup: Setup, scheme: ImplicitScheme) -> None:
        super().__init__(setup, PlainKick())
        builder, state, solver = setup.builder, setup.state, setup.solver
        self.theta = scheme.theta
        self.falls_back = scheme.theta < 1.0
        """True where a step that cannot be solved is taken as one of implicit Euler."""
        if self.falls_back:
            self.share = place(builder, ti.field(runtime.real()), 1)
            """Where in this step the forces are taken [1]."""
        self.resting = [Resting(builder, state, self.colliders)] if self.colliders else []
        self.remembering.extend(self.resting)
        ground = [collider for resting in self.resting for collider in resting.colliders]
        self.end = StepEnd(state, replace(setup.parts, colliders=ground), setup.pinned)
        self.linear = ConjugateGradients(builder, state, self.laws, self.resting, solver.linear_iterations)
        self.newton = Newton(builder, self.linear, self.laws, solver.iterations or MOST_ITERATIONS, solver.tolerance)
        self.tallies.append(self.newton.tally)
        self.base = place(builder, self.vector.field(), state.count)
        """Velocity from which the line search goes out [m/s]."""
        self.guess = place(builder, self.vector.field(), state.count)
        """Velocity that the linear solve shall start with [m/s]."""
        self.sums = BlockSums(builder, state.count, 4)
        self.changes = BlockSums(builder, state.count, 3)
        self.latest = place(builder, ti.field(self.changes.fine), 1)
        """Fraction of the step until which new meetings with colliders count [1]."""
        if self.books:
            self.force = place(builder, self.vector.field(), 2, state.count)
            """Of the trial, and the part of it that has a potential [N]."""

    @ti.func
    def begin(self, slot, dt, time):
        """What moves and flows does so; then the first trial."""
        for resting in ti.static(self.resting):
            for i in range(self.state.count):
                resting.check(i, slot, dt)
        self.preparation.begin(slot, time, dt)
        if ti.static(self.evolving):
            for i in range(self.state.count):
                for law in ti.static(self.evolving):
                    law.evolve(i, slot, dt)
        self.open(slot, dt, self.theta)

    @ti.func
    def open(self, slot, dt, theta):
        """Newton sets out, for the forces at ``theta`` of the step."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.newton.start()
            if ti.static(self.falls_back):
                self.share[0] = theta
        for i in range(self.state.count):
            self._open(i, slot, dt)

    @ti.func
    def span(self, dt):
        """Time from the step's start to where its forces are taken [s]."""
        if ti.static(self.falls_back):
            return self.share[0] * dt
        else:
            return self.theta * dt

    @ti.func
    def is_lost(self) -> ti.i32:
        """1 where the scheme's equation could not be solved, but that of implicit Euler may be.

        It can, as it takes energy out: what the midpoint rule makes of a wrong solution has no bounds.
        """
        lost = 0
        if ti.static(self.falls_back):
            if self.share[0] < 1.0:
                lost = self.newton.is_lost()
        return lost

    @ti.func
    def _open(self, i, slot, dt):
        """Newton sets out from the places that there are, and from the velocity that there is as its first solution."""
        start, v = self.state.x[slot, i], self.state.v[slot, i]
        still = self.vector(0.0)
        if self.state.inverse_mass[i] > 0.0:
            for resting in ti.static(self.resting):
                still, v = resting.constrained(i, still), resting.constrained(i, v)
        else:
            for carrier in ti.static(self.carriers):
                end, _ = carrier.carry(i, start, start + dt * v, v, dt)
                v = (end - start) / dt
            still = v
        self.guess[i] = v
        self._try(i, slot, still, dt)

    @ti.func
    def _try(self, i, slot, v, dt):
        """Make v [m/s] the trial of particle i."""
        self.state.v[1 - slot, i] = v
        self.state.x[1 - slot, i] = self.state.x[slot, i] + self.span(dt) * v

    @ti.func
    def evaluate(self, slot, dt, time):
        """Residual at the trial, and what Newton makes of it."""
        self.preparation.again(1 - slot, time + self.span(dt))
        for block in range(self.sums.blocks):
            self._weigh(block, slot, dt)
        ti.loop_config(serialize=True)
        for _ in range(1):
            residual, impulse = self.sums.total(_RESIDUAL), self.sums.total(_IMPULSE)
            self.newton.decide(residual, impulse, self.sums.total(_SLOPE), self.sums.total(_STEEPNESS))

    @ti.func
    def _weigh(self, block, slot, dt):
        residual, impulse = self.sums.zero(), self.sums.zero()
        slope, steepness = self.sums.zero(), self.sums.zero()
        for part in range(BLOCK // SLICE):
            index = block * (BLOCK // SLICE) + part
            if ti.static(self.slicing):
                if index * SLICE < self.state.count:
                    for law in ti.static(self.slicing):
                        law.gather_slice(index, 1 - slot)
            for i in range(index * SLICE, ti.min((index + 1) * SLICE, self.state.count)):
                r, acted = self._residual_on(i, slot, dt)
                w = self.state.inverse_mass[i]
                self.linear.residual[i] = r
                for resting in ti.static(self.resting):
                    r = resting.filter(i, r)
                residual += w * r.dot(r)
                impulse += w * acted * acted
                slope += r.dot(self.linear.solution[i])
                steepness += self.linear.first[i].dot(self.linear.solution[i])
        self.sums.put(block, _RESIDUAL, residual)
        self.sums.put(block, _IMPULSE, impulse)
        self.sums.put(block, _SLOPE, slope)
        self.sums.put(block, _STEEPNESS, steepness)

    @ti.func
    def _residual_on(self, i, slot, dt):
        """M (v0 - v) + a F at particle i, and the sum of the sizes of the impulses a F [N s]."""
        span = self.span(dt)
        force = self.vector(0.0)
        acted = 0.0 * dt
        for law in ti.static(self.laws):
            pull = law.force_on(i, 1 - slot)
            force += pull
            acted += span * pull.norm()
        if ti.static(self.books):
            self.force[0, i] = force
        r = self.vector(0.0)
        if self.state.inverse_mass[i] > 0.0:
            m, v = self.state.mass[i], self.state.v[1 - slot, i]
            r = m * (self.state.v[slot, i] - v) + span * force
            if ti.static(self.drag > 0.0):
                r -= (span * self.drag * m) * v
                acted += span * self.drag * m * v.norm()
            for resting in ti.static(self.resting):
                r += resting.rub[i]
        return r, acted

    @ti.func
    def revise(self, slot, dt):
        """Correct reactions that colliders cannot give, and meetings not reckoned with; go on if that counts."""
        for block in range(self.changes.blocks):
            self._examine(block, slot, dt)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.newton.reconsider(self.changes.total(_CHANGE), self.changes.total(_DRIVEN))
            self.latest[0] = ti.select(self.newton.code[0] == DONE, -1.0, self.changes.least(_FRACTION))
        for i in range(self.state.count):
            self._reopen(i, slot, dt)

    @ti.func
    def _examine(self, block, slot, dt):
        changes, fraction, driven = self.changes.zero(), self.changes.one(), self.changes.zero()
        for resting in ti.static(self.resting):
            for i in range(self.changes.first(block), self.changes.end(block)):
                w, v = self.state.inverse_mass[i], self.state.v[1 - slot, i]
                inertia, change = self.linear.inertia[i], 0.0 * dt
                if w > 0.0:
                    if resting.mode[i] != FREE:
                        driven += resting.drive(i, v)
                        change = resting.revise(i, v, self.linear.residual[i], inertia)
                    else:
                        start, begun = self.state.x[slot, i], self.state.v[slot, i]
                        change = resting.look_ahead(i, start, begun, v, dt, inertia)
                        fraction = ti.min(fraction, ti.cast(resting.fraction[i], self.changes.fine))
                changes += w * change * change
        self.changes.put(block, _CHANGE, changes)
        self.changes.put(block, _FRACTION, fraction)
        self.changes.put(block, _DRIVEN, driven)

    @ti.func
    def _reopen(self, i, slot, dt):
        """Back to the instant of the first meeting, before anything has flown into what is now in its way."""
        latest = ti.cast(self.latest[0], self.linear.real)
        for resting in ti.static(self.resting):
            resting.decline(i, latest)
            if latest >= 0.0 and self.state.inverse_mass[i] > 0.0:
                if self.newton.spares() == 1:
                    resting.spare(i)
                v = self.state.v[1 - slot, i]
                self.guess[i] = resting.constrained(i, v)
                self._try(i, slot, resting.constrained(i, latest * v), dt)

    @ti.func
    def linearise(self, slot, dt):
        """The matrix at the trial, and the beginning of a solve with it."""
        span = self.span(dt)
        for block in range(self.sums.blocks):
            noise = self.sums.zero()
            for i in range(self.sums.first(block), self.sums.end(block)):
                v = self.state.v[1 - slot, i]
                guess = ti.select(self.newton.solved[0] == 1, self.vector(0.0), self.guess[i] - v)
                self.base[i] = v
                noise += self.linear.linearise(i, 1 - slot, guess, 1.0 + span * self.drag, span * span, span)
            self.sums.put(block, _RESIDUAL, noise)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.newton.begin_solve(self.sums.total(_RESIDUAL))

    @ti.func
    def iterate(self, slot, dt):
        """One iteration of the linear solve."""
        span = self.span(dt)
        self.linear.iterate(1 - slot, 1.0 + span * self.drag, span * span, span)

    @ti.func
    def move(self, slot, dt, code):
        """The next trial along the direction."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if code != SEARCH:
                self.newton.aim()
        for i in range(self.state.count):
            way = ti.cast(self.newton.way[0], self.linear.real)
            self._try(i, slot, self.base[i] + way * self.linear.solution[i], dt)

    @ti.func
    def finish(self, slot, dt):
        """From the solution to the step's end, which meets colliders and carriers."""
        if ti.static(self.books):
            for i in range(self.state.count):
                self._book(i, slot, dt)
        for i in range(self.state.count):
            self._end(i, slot, dt)
        ti.loop_config(serialize=True)
        for _ in range(1):
            replaced = 0
            if ti.static(self.falls_back):
                replaced = ti.cast(self.share[0] == 1.0, ti.i32)
            self.newton.finish(replaced)

    @ti.func
    def _book(self, i, slot, dt):
        """Book the forces, while every particle is still at the trial."""
        for books in ti.static(self.books):
            lossy = books.stage(i, 1 - slot, dt, self.force[0, i])
            self.force[1, i] = self.force[0, i] - lossy
            if ti.static(self.drag > 0.0):
                v = self.state.v[1 - slot, i]
                books.ledger.add(books.drag_term, i, -dt * self.drag * self.state.mass[i] * v.dot(v))

    @ti.func
    def _end(self, i, slot, dt):
        start, begun, solved = self.state.x[slot, i], self.state.v[slot, i], self.state.v[1 - slot, i]
        v = solved
        if self.state.inverse_mass[i] > 0.0:
            if ti.static(self.falls_back):
                v = begun + (solved - begun) / self.share[0]
            for resting in ti.static(self.resting):
                v = resting.stopped(i, v)
        x_new, v_new = self.end.meet(i, start, start + dt * solved, v, 0.0 * v, 1.0, dt)
        for books in ti.static(self.books):
            reaction = self.vector(0.0)
            if ti.static(self.resting):
                if self.state.inverse_mass[i] > 0.0:
                    reaction = self._reaction(i, begun, solved, v, dt)
                    for resting in ti.static(self.resting):
                        resting.hand_in_friction(books.ledger, i, reaction)
            moved = x_new - start - dt * solved + dt * self.state.inverse_mass[i] * reaction
            free = v - self.state.inverse_mass[i] * reaction
            books.finish(i, begun, self.force[1, i], moved, free, v_new, dt)
        self.state.x[1 - slot, i] = x_new
        self.state.v[1 - slot, i] = v_new

    @ti.func
    def _reaction(self, i, begun, solved, v, dt):
        """What the surface gave particle i in the step [N s]: the change of its momentum that no force explains."""
        reaction = self.vector(0.0)
        for resting in ti.static(self.resting):
            if resting.mode[i] != FREE:
                m = self.state.mass[i]
                reaction = m * (v - begun + dt * self.drag * solved) - dt * self.force[0, i]
        return reaction
