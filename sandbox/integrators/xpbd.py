"""Implicit Euler solved constraint by constraint (XPBD): springs by colour, gas by body, colliders by particle.

A step of length h: forces that are no constraints, and drag, give velocities v*; then each iteration goes once over
all constraints, in place (Gauss-Seidel), see :mod:`sandbox.integrators.constraints`; then x = x0 + h v. Source:
Macklin, Mueller and Chentanez, "XPBD: position-based simulation of compliant constrained dynamics", MIG 2016.

Colliders take part in the iterations, see :mod:`sandbox.integrators.pushes`.
"""

from dataclasses import replace

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.integrators.block_sums import BlockSums
from sandbox.integrators.constraints import constraints_of
from sandbox.integrators.kick import kick_with
from sandbox.integrators.pushes import Pushes
from sandbox.integrators.step_end import StepEnd
from sandbox.integrators.stepper import Setup, Stepper
from sandbox.scene.assemble import Assembly
from sandbox.state import place

ITERATIONS = 10
"""Iterations a step where the scene says nothing."""
# Work (particles + half-edges) below which one serial launch wins; see benchmarks/xpbd_sweep.py.
SERIAL_WORK = 300_000
_MISSING, _WHOLE = 0, 1
_TINY = 1e-30


@ti.data_oriented
class Xpbd(Stepper):
    """Advances a state by solving constraints.

    Slot ``slot`` keeps the state at the step's start, the other one holds trial velocities until its end.
    """

    def __init__(self, setup: Setup) -> None:
        self.kick = kick_with(setup.drag)
        super().__init__(setup, self.kick)
        builder, state, parts = setup.builder, setup.state, setup.parts
        self.iterations = setup.solver.iterations or ITERATIONS
        self.real = runtime.real()
        solved = [(law, constraints_of(builder, law, state)) for law in self.laws]
        self.constraints = [constraint for _, constraint in solved if constraint is not None]
        self.refreshing = [constraint for constraint in self.constraints if hasattr(constraint, "refresh")]
        self.inner = [law for law, constraint in solved if constraint is not None]
        """Laws that the constraints stand for."""
        self.outer = [law for law, constraint in solved if constraint is None]
        """Laws that act as forces of the step's start."""
        self.predicted = place(builder, self.vector.field(), state.count)
        """v*, what forces other than constraints make of velocities [m/s]."""
        self.pushes = [Pushes(builder, state, parts, setup.pinned)] if parts.colliders else []
        ends = [collider for pushes in self.pushes for collider in pushes.ends]
        self.end = StepEnd(state, replace(parts, colliders=ends), setup.pinned)
        self.ride = StepEnd(state, replace(parts, colliders=[], contact=[]), setup.pinned)
        self._place_sums(builder)

    def _place_sums(self, builder: ti.FieldsBuilder) -> None:
        """What is summed up of a step: its residual and, with a ledger, forces."""
        self.sums = BlockSums(builder, self.state.count, 2)
        """Squares of residuals and of impulses, each over the mass [kg m^2/s^2]."""
        fine = self.sums.fine
        self.residuals = place(builder, ti.field(fine), 2)
        """Relative residual of the last step looked at, and the largest [1]."""
        self.tallies.append(self.residuals)
        self.noise = place(builder, ti.field(fine), self.state.count)
        """Force that rounding of its place makes at a particle [N], over that place."""
        outer, inner = ([law for law in laws if hasattr(law, "dissipation_on")] for laws in (self.outer, self.inner))
        self.lossy_laws = [*outer, *inner]
        self.first_inner, self.drag_row = len(outer), len(outer) + len(inner)
        for books in self.books:
            self.terms = [books.ledger.index(law.dissipation_term) for law in self.lossy_laws]
            self.lossy = place(builder, self.vector.field(), self.drag_row + 1, self.state.count)
            """Forces without energy, a law a row, and drag [N]."""
            self.conservative = place(builder, self.vector.field(), self.state.count)
            """All other forces [N]."""

    def load(self, assembly: Assembly) -> None:
        """Upload the constraints, and what rounding does."""
        for constraint in self.constraints:
            constraint.load(assembly)
        springs = assembly.spring_set
        sums = sum(np.bincount(springs.ends[:, end], springs.stiffness, self.state.count) for end in range(2))
        self._write_noise(np.finfo("float64" if runtime.settings().precision == "f64" else "float32").eps * sums)

    def report(self) -> dict[str, float]:
        """Iterations a step, and how far the steps looked at, the last of every call, were from solved.

        A residual is the norm of M^(-1/2) r, with r what impulses lack to be those of implicit Euler, relative to
        the norm of those impulses, or to what rounding makes of them where that is more.
        """
        last, largest = self.residuals.to_numpy()
        return {"iterations": float(self.iterations), "residual": float(last), "largest_residual": float(largest)}

    # -- a call -------------------------------------------------------------------------------------

    def run_serial(self, slot: int, steps: int, dt: float, time: float) -> None:
        """All steps in one launch."""
        self._run_serial(slot, steps, self.iterations, *self.kick.factors(dt), dt, time)

    def take_step(self, step: int, steps: int, slot: int, dt: float, time: float) -> None:
        """One step, a launch for every colour of every iteration."""
        decay, gain = self.kick.factors(dt)
        self._begin_parallel(slot, step, decay, gain, dt, time)
        for iteration in range(self.iterations):
            for constraint in self.constraints:
                constraint.sweep(slot, 1 - slot, dt, gain, iteration)
            if self.pushes:
                self._keep_out_parallel(slot, dt)
        if self.books or step == steps - 1:
            self._survey_parallel(slot, gain, dt)
        self._finish_parallel(slot, dt)

    @ti.kernel
    def _run_serial(self, slot: int, steps: int, iterations: int, decay: float, gain: float, dt: float, time: float):
        ti.loop_config(serialize=True)
        for n in range(steps):
            start = self.slot_at(slot, n)
            self.begin(start, decay, gain, dt, time + n * dt)
            for iteration in range(iterations):
                for constraint in ti.static(self.constraints):
                    constraint.sweep_serial(start, 1 - start, dt, gain, iteration)
                self.keep_out(start, dt)
            if ti.static(self.books):
                self.survey(start, gain, dt)
            elif n == steps - 1:
                self.survey(start, gain, dt)
            self.finish(start, dt)
            self.meet_others_serial(start, dt)

    @ti.kernel
    def _begin_parallel(self, slot: int, step: int, decay: float, gain: float, dt: float, time: float):
        self.begin(slot, decay, gain, dt, time + step * dt)

    @ti.kernel
    def _keep_out_parallel(self, slot: int, dt: float):
        self.keep_out(slot, dt)

    @ti.kernel
    def _survey_parallel(self, slot: int, gain: float, dt: float):
        self.survey(slot, gain, dt)

    @ti.kernel
    def _finish_parallel(self, slot: int, dt: float):
        self.finish(slot, dt)

    # -- passes over all particles ------------------------------------------------------------------

    @ti.func
    def begin(self, slot, decay, gain, dt, time):
        """What moves and flows does so for the step; then velocities without constraints."""
        self.preparation.begin(slot, time, dt)
        for i in range(self.state.count):
            self.predict(i, slot, decay, gain, dt)

    @ti.func
    def keep_out(self, slot, dt):
        """Have all particles meet the colliders."""
        for pushes in ti.static(self.pushes):
            for i in range(self.state.count):
                pushes.renew(i, slot, dt)

    @ti.func
    def survey(self, slot, gain, dt):
        """Forces at the trial state, for the residual and the books."""
        for i in range(self.state.count):
            self.state.x[1 - slot, i] = self.state.x[slot, i] + dt * self.state.v[1 - slot, i]
        for constraint in ti.static(self.refreshing):
            constraint.refresh(1 - slot)
        for block in range(self.sums.blocks):
            missing, whole = self.sums.zero(), self.sums.zero()
            for i in range(self.sums.first(block), self.sums.end(block)):
                lacking, acting = self.look_at(i, slot, gain, dt)
                missing += lacking
                whole += acting
            self.sums.put(block, _MISSING, missing)
            self.sums.put(block, _WHOLE, whole)
        ti.loop_config(serialize=True)
        for _ in range(1):
            residual = ti.sqrt(self.sums.total(_MISSING) / ti.max(self.sums.total(_WHOLE), _TINY))
            self.residuals[0] = residual
            self.residuals[1] = ti.max(self.residuals[1], residual)

    @ti.func
    def finish(self, slot, dt):
        """The state at the end of the step."""
        for i in range(self.state.count):
            self.end_step(i, slot, dt)

    # -- one particle -------------------------------------------------------------------------------

    @ti.func
    def predict(self, i, slot, decay, gain, dt):
        """Velocity of particle i without constraints; a held one has that of what holds it."""
        for law in ti.static(self.evolving):
            law.evolve(i, slot, dt)
        force = self.vector(0.0)
        for law in ti.static(self.outer):
            force += law.force_on(i, slot)
        w = self.state.inverse_mass[i]
        begun = self.state.v[slot, i]
        v = self.kick.apply(begun, w * force, decay, gain)
        for _ in ti.static(self.books):
            self._book_outer(i, slot, force, v, dt)
        if w == 0.0:
            v = self.vector(0.0)
            if ti.static(self.carriers):
                start = self.state.x[slot, i]
                there, _ = self.ride.meet(i, start, start, v, 0.0 * v, 1.0, dt)
                v = (there - start) / dt
        self.predicted[i] = v
        self.state.v[1 - slot, i] = v
        for pushes in ti.static(self.pushes):
            pushes.begin(i)

    @ti.func
    def free_velocity(self, i, slot):
        """Velocity of particle i without what colliders gave it [m/s]."""
        v = self.state.v[1 - slot, i]
        for pushes in ti.static(self.pushes):
            v -= pushes.push[i]
        return v

    @ti.func
    def look_at(self, i, slot, gain, dt):
        """Squares of what the impulses on particle i lack, and of those that act on it, over its mass [kg m^2/s^2]."""
        force, forces = self.vector(0.0), ti.cast(0.0, self.real)
        for law in ti.static(self.inner):
            own = law.force_on(i, 1 - slot)
            force += own
            forces += own.dot(own)
        for _ in ti.static(self.books):
            self._book_inner(i, slot, force, gain / dt)
        lacking, acting = 0.0 * dt, 0.0 * dt
        if self.state.inverse_mass[i] > 0.0:
            m = self.state.mass[i]
            given = m * (self.free_velocity(i, slot) - self.predicted[i])
            outer = m * (self.predicted[i] - self.state.v[slot, i])
            missing = given - gain * force
            x = self.state.x[slot, i]
            noise = ti.cast(self.noise[i] * self.noise[i], self.real) * x.dot(x)
            lacking = missing.dot(missing) / m
            acting = (outer.dot(outer) + gain * gain * (forces + noise)) / m
        return lacking, acting

    @ti.func
    def end_step(self, i, slot, dt):
        """Particle i at the end of the step."""
        start = self.state.x[slot, i]
        free = self.free_velocity(i, slot)
        for pushes in ti.static(self.pushes):
            pushes.end(i, free - self.predicted[i])
        x, v = self.end.meet(i, start, start + dt * free, free, 0.0 * free, 1.0, dt)
        for books in ti.static(self.books):
            self._book_end(books, i, slot, free, x, v, dt)
        self.state.x[1 - slot, i] = x
        self.state.v[1 - slot, i] = v

    # -- books --------------------------------------------------------------------------------------

    @ti.func
    def _book_outer(self, i, slot, force, kicked, dt):
        """Note the forces at the start, of which drag is what an exact kick lacks to a plain one."""
        conservative = force
        for k in ti.static(range(self.first_inner)):
            self.lossy[k, i] = self.lossy_laws[k].dissipation_on(i, slot)
            conservative -= self.lossy[k, i]
        self.conservative[i] = conservative
        drag = self.vector(0.0)
        if self.state.inverse_mass[i] > 0.0:
            gained = self.state.mass[i] * (kicked - self.state.v[slot, i])
            drag = gained / dt - force
        self.lossy[self.drag_row, i] = drag

    @ti.func
    def _book_inner(self, i, slot, force, share):
        """Note the forces of constraints at the trial state, which acted for a ``share`` of the step [1]."""
        conservative = self.conservative[i] + force
        for k in ti.static(range(self.first_inner, self.drag_row)):
            self.lossy[k, i] = self.lossy_laws[k].dissipation_on(i, 1 - slot)
            conservative -= self.lossy[k, i]
        self.conservative[i] = conservative
        self.lossy[self.drag_row, i] = self.lossy[self.drag_row, i] + (share - 1.0) * force

    @ti.func
    def _book_end(self, books: ti.template(), i, slot, free, x, v, dt):
        """Book the step of particle i that ended at x, v; ``free`` was its velocity without colliders."""
        start, begun = self.state.x[slot, i], self.state.v[slot, i]
        w = self.state.inverse_mass[i]
        mean = 0.5 * (books.met(i, begun, v) + v)
        way = ti.select(w == 0.0, x - start, dt * mean)
        conservative = self.conservative[i]
        work = conservative.dot(way)
        for k in ti.static(range(self.drag_row)):
            lost = self.lossy[k, i].dot(way)
            books.ledger.add(self.terms[k], i, lost)
            work += lost
        if w > 0.0:
            if ti.static(books.drags):
                books.ledger.add(books.drag_term, i, self.lossy[self.drag_row, i].dot(way))
            if ti.static(books.collides):
                books.collide(i, conservative, x - start - dt * v, free, v, mean, dt)
        elif ti.static(books.carries):
            books.drive(i, begun, v, work)

    @ti.kernel
    def _write_noise(self, noise: ti.types.ndarray()):
        for i in range(self.state.count):
            self.noise[i] = noise[i]
