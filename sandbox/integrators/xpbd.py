"""Implicit Euler solved constraint by constraint (XPBD): springs by colour, gas by body, colliders by particle.

A step of length h: forces that are no constraints, and drag, give velocities v*; then each iteration goes once over
all constraints, in place (Gauss-Seidel), see :mod:`sandbox.integrators.constraints`; then x = x0 + h v. Source:
Macklin, Mueller and Chentanez, "XPBD: position-based simulation of compliant constrained dynamics", MIG 2016.

Colliders take part in the iterations, so that a body bears its own weight however long the step: after each, every
particle's velocity without what colliders gave it so far meets them anew, without restitution but with friction. So
a push is never more than the load, and gone with it. The end of the step does the same once more, and there what
had arrived by itself, at v*, bounces.
"""

from dataclasses import replace

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.integrators.bookkeeping import Bookkeeping
from sandbox.integrators.constraints import constraints_of
from sandbox.integrators.kick import DragKick, PlainKick
from sandbox.integrators.preparation import Preparation
from sandbox.integrators.step_end import StepEnd
from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState, place

ITERATIONS = 10
"""Iterations a step where the scene says nothing."""
# Work (particles + half-edges) below which one serial launch wins; see benchmarks/xpbd_sweep.py.
SERIAL_WORK = 300_000
# Particles whose residuals are added up one after the other.
_BLOCK = 256
_TINY = 1e-30


@ti.data_oriented
class Xpbd:
    """Advances a state by solving constraints, with the given parts.

    Slot ``slot`` keeps the state at the step's start, the other one holds trial velocities until its end.
    """

    def __init__(
        self,
        builder: ti.FieldsBuilder,
        state: ParticleState,
        parts: Parts,
        drag: float,
        pinned: bool,
        iterations: int | None,
        serial: bool,
    ) -> None:
        self.state = state
        self.iterations = iterations or ITERATIONS
        self.serial = serial
        self.vector, self.real = runtime.vector(state.dimension), runtime.real()
        solved = [(law, constraints_of(builder, law, state)) for law in parts.laws]
        self.constraints = [constraint for _, constraint in solved if constraint is not None]
        self.refreshing = [constraint for constraint in self.constraints if hasattr(constraint, "refresh")]
        self.inner = [law for law, constraint in solved if constraint is not None]
        """Laws that the constraints stand for."""
        self.outer = [law for law, constraint in solved if constraint is None]
        """Laws that act as forces of the step's start."""
        self.evolving = [law for law in parts.laws if getattr(law, "changes", False)]
        self.preparation = Preparation(parts)
        self.kick = DragKick(drag) if drag > 0.0 else PlainKick()
        self.contact = parts.contact
        self.colliders = parts.colliders
        self.carriers = parts.carriers
        self.predicted = place(builder, self.vector.field(), state.count)
        """v*, what forces other than constraints make of velocities [m/s]."""
        self._place_ends(builder, parts, pinned)
        self._place_sums(builder, parts)

    def _place_ends(self, builder: ti.FieldsBuilder, parts: Parts, pinned: bool) -> None:
        """What meets colliders in trial states and at the end of a step."""
        bouncy = any(collider.surface.bouncy for collider in parts.colliders)
        if parts.colliders:
            self.push = place(builder, self.vector.field(), self.state.count)
            """What colliders give to velocities in the trial state [m/s]."""
        self.bounces = [place(builder, self.vector.field(), self.state.count)] if bouncy else []
        """What constraints gave to velocities in the step [m/s]; only where there is restitution."""
        given = self.bounces[0] if bouncy else None
        ends = [collider.under_solver(given, booked=True) for collider in parts.colliders]
        trials = [collider.under_solver() for collider in parts.colliders]
        self.end = StepEnd(self.state, replace(parts, colliders=ends), pinned)
        self.trial_end = StepEnd(self.state, replace(parts, colliders=trials, carriers=[], contact=[]), pinned)
        self.ride = StepEnd(self.state, replace(parts, colliders=[], contact=[]), pinned)

    def _place_sums(self, builder: ti.FieldsBuilder, parts: Parts) -> None:
        """What is summed up of a step: its residual and, with a ledger, forces."""
        self.block_count = -(-self.state.count // _BLOCK)
        fine = ti.f64 if runtime.settings().arch in ("cpu", "cuda") else runtime.real()
        self.fine = fine
        self.squares = place(builder, ti.field(fine), self.block_count, 2)
        """Of residuals and of impulses, each over the root of the mass [kg m^2/s^2], by block."""
        self.residuals = place(builder, ti.field(fine), 2)
        """Relative residual of the last step looked at, and the largest [1]."""
        self.noise = place(builder, ti.field(fine), self.state.count)
        """Force that rounding of its place makes at a particle [N], over that place."""
        self.books = [Bookkeeping(self.state, parts, self.kick, ledger) for ledger in parts.ledger]
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
        residuals = np.empty(2)
        self._read(residuals)
        return {
            "iterations": float(self.iterations),
            "residual": float(residuals[0]),
            "largest_residual": float(residuals[1]),
        }

    # -- a call -------------------------------------------------------------------------------------

    def advance(self, steps: int, dt: float, time: float) -> None:
        """Take ``steps`` steps of ``dt`` [s] from ``time`` [s]."""
        decay, gain = self.kick.factors(dt)
        for contact in self.contact:
            contact.invalidate()
        if self.serial:
            self._run_serial(self.state.slot, steps, decay, gain, dt, time)
        else:
            self._run_parallel(steps, decay, gain, dt, time)
        # With contact a step ends in the slot that it began in.
        if not self.contact:
            self.state.slot = (self.state.slot + steps) % 2

    def _run_parallel(self, steps: int, decay: float, gain: float, dt: float, time: float) -> None:
        slot = self.state.slot
        for step in range(steps):
            self._begin_parallel(slot, step, decay, gain, dt, time)
            for iteration in range(self.iterations):
                for constraint in self.constraints:
                    constraint.sweep(slot, 1 - slot, dt, gain, iteration)
                if self.colliders:
                    self._keep_out_parallel(slot, dt)
            if self.books or step == steps - 1:
                self._survey_parallel(slot, gain, dt)
            self._finish_parallel(slot, dt)
            if self.contact:
                self.contact[0].resolve(1 - slot, slot, dt)
            else:
                slot = 1 - slot

    @ti.kernel
    def _run_serial(self, slot: int, steps: int, decay: float, gain: float, dt: float, time: float):
        ti.loop_config(serialize=True)
        for n in range(steps):
            start = (slot + n) % 2
            if ti.static(self.contact):
                start = slot
            self.begin(start, decay, gain, dt, time + n * dt)
            for iteration in range(self.iterations):
                for constraint in ti.static(self.constraints):
                    constraint.sweep_serial(start, 1 - start, dt, gain, iteration)
                if ti.static(self.colliders):
                    self.keep_out(start, dt)
            if ti.static(self.books):
                self.survey(start, gain, dt)
            elif n == steps - 1:
                self.survey(start, gain, dt)
            self.finish(start, dt)
            if ti.static(self.contact):
                self.contact[0].resolve_serial(1 - start, start, dt)

    @ti.kernel
    def _begin_parallel(self, slot: int, step: int, decay: float, gain: float, dt: float, time: float):
        # The sum is rounded as in the serial kernel.
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
        for i in range(self.state.count):
            self.meet_colliders(i, slot, dt)

    @ti.func
    def survey(self, slot, gain, dt):
        """Forces at the trial state, for the residual and the books."""
        for i in range(self.state.count):
            self.state.x[1 - slot, i] = self.state.x[slot, i] + dt * self.state.v[1 - slot, i]
        for constraint in ti.static(self.refreshing):
            constraint.refresh(1 - slot)
        for k in range(self.block_count):
            self.squares[k, 0] = ti.cast(0.0, self.fine)
            self.squares[k, 1] = ti.cast(0.0, self.fine)
            for i in range(k * _BLOCK, ti.min((k + 1) * _BLOCK, self.state.count)):
                self.look_at(i, k, slot, gain, dt)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self._sum_up()

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
                there, _ = self.ride.meet(i, start, start, v, dt)
                v = (there - start) / dt
        self.predicted[i] = v
        self.state.v[1 - slot, i] = v
        if ti.static(self.colliders):
            self.push[i] = self.vector(0.0)

    @ti.func
    def meet_colliders(self, i, slot, dt):
        """Find anew what colliders must give to the velocity of particle i."""
        if self.state.inverse_mass[i] > 0.0:
            start = self.state.x[slot, i]
            free = self.state.v[1 - slot, i] - self.push[i]
            end = start + dt * free
            kept, _ = self.trial_end.meet(i, start, end, free, dt)
            push = (kept - end) / dt
            self.push[i] = push
            self.state.v[1 - slot, i] = free + push

    @ti.func
    def free_velocity(self, i, slot):
        """Velocity of particle i without what colliders gave it [m/s]."""
        v = self.state.v[1 - slot, i]
        if ti.static(self.colliders):
            v -= self.push[i]
        return v

    @ti.func
    def look_at(self, i, k, slot, gain, dt):
        """Add the residual of particle i to block k."""
        force, forces = self.vector(0.0), ti.cast(0.0, self.real)
        for law in ti.static(self.inner):
            own = law.force_on(i, 1 - slot)
            force += own
            forces += own.dot(own)
        for _ in ti.static(self.books):
            self._book_inner(i, slot, force, gain / dt)
        if self.state.inverse_mass[i] > 0.0:
            m = self.state.mass[i]
            given = m * (self.free_velocity(i, slot) - self.predicted[i])
            outer = m * (self.predicted[i] - self.state.v[slot, i])
            missing = given - gain * force
            x = self.state.x[slot, i]
            noise = ti.cast(self.noise[i] * self.noise[i], self.real) * x.dot(x)
            square = (outer.dot(outer) + gain * gain * (forces + noise)) / m
            self.squares[k, 0] = self.squares[k, 0] + ti.cast(missing.dot(missing) / m, self.fine)
            self.squares[k, 1] = self.squares[k, 1] + ti.cast(square, self.fine)

    @ti.func
    def _sum_up(self):
        missing, whole = ti.cast(0.0, self.fine), ti.cast(0.0, self.fine)
        for k in range(self.block_count):
            missing += self.squares[k, 0]
            whole += self.squares[k, 1]
        residual = ti.sqrt(missing / ti.max(whole, _TINY))
        self.residuals[0] = residual
        self.residuals[1] = ti.max(self.residuals[1], residual)

    @ti.func
    def end_step(self, i, slot, dt):
        """Particle i at the end of the step."""
        start = self.state.x[slot, i]
        free = self.free_velocity(i, slot)
        for given in ti.static(self.bounces):
            given[i] = free - self.predicted[i]
        x, v = self.end.meet(i, start, start + dt * free, free, dt)
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

    @ti.kernel
    def _read(self, residuals: ti.types.ndarray()):
        for k in range(2):
            residuals[k] = self.residuals[k]
