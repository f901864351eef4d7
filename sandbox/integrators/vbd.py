"""Vertex block descent: implicit Euler solved particle by particle, in sweeps over colours of particles.

Source: Chen, Liu, Yang and Yuksel, "Vertex Block Descent", ACM Trans. Graph. 43 (2024). It is a block Gauss-Seidel
method with one Newton step a particle and sweep, in place on the trial of the step's end. No two particles of a
colour share a spring or a face, so that they may move at once. Sweeps are few and fixed in number: what is left
of the residual is the price, and :meth:`VertexBlockDescent.report` tells it.

Sweeps spread news slowly through a stiff body. So the first guess knows of gravity, see
:mod:`sandbox.integrators.first_guess`; what a gas does to all of a body comes at once, see
:mod:`sandbox.integrators.coupling`; and what moves a free body as a whole is set right after the sweeps, see
:mod:`sandbox.integrators.rigid_motion`.

Chebyshev acceleration (Wang, "A Chebyshev semi-iterative approach", ACM Trans. Graph. 34 (2015)) takes after each
sweep but the last v <- omega (v - v'') + v'', with v'' of two sweeps before; particles at colliders are left out.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.integrators.colouring import ColourLists, colour_particles
from sandbox.integrators.coupling import Coupling
from sandbox.integrators.descent import MEASURE, MEET, RELAX, Descent
from sandbox.integrators.first_guess import FirstGuess
from sandbox.integrators.kick import PlainKick
from sandbox.integrators.rigid_motion import FreeBodies, RigidMotion
from sandbox.integrators.stepper import Setup, Stepper
from sandbox.scene.assemble import Assembly
from sandbox.state import place

FloatArray = NDArray[np.float64]

SWEEPS = 10
"""Sweeps a step where the scene names no number."""
VBD_SERIAL_WORK = 3_000_000
"""Work (particles + half-edges) below which one serial launch wins; see benchmarks/vbd_sweep.py."""


@ti.data_oriented
class VertexBlockDescent(Stepper):
    """Advances a state by implicit Euler, solved by sweeps."""

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup, PlainKick())
        builder, state, assembly, solver = setup.builder, setup.state, setup.assembly, setup.solver
        self.sweeps = solver.iterations or SWEEPS
        self.prepares = bool(self.preparation.laws)
        self.descent = Descent(builder, state, setup.parts, self.drag)
        self.holds = assembly.plan.holds
        """Whether particles may be held later: who moves is then asked of every one."""
        free = assembly.unheld()
        self.lists = ColourLists.of(*_colours(free)).without(free.inverse_masses == 0.0)
        self.first = self.lists.first.tolist()
        self.member_count = len(self.lists.member)
        self.member = place(builder, ti.field(ti.i32), self.member_count)
        """Particles that move, colour by colour."""
        moves = free.inverse_masses > 0.0
        self.coupling = [
            Coupling(builder, state, law, np.where(moves, law.particle_gas, np.int32(-1)), self.descent)
            for law in self.laws
            if hasattr(law, "bulk")
        ]
        bodies = FreeBodies.of(assembly)
        rigid = len(bodies.mass) > 0 and not self.holds
        self.rigid = [RigidMotion(builder, state, bodies, self.descent, self.drag)] if rigid else []
        self.meets_again = bool(self.colliders) and bool(self.coupling or self.rigid)
        """True where corrections may move a particle into a collider."""
        self.first_guess = FirstGuess(builder, state, self.laws)
        self.remembering.append(self.first_guess)
        self.accelerates = solver.chebyshev > 0.0
        self.relaxation = _relaxation(solver.chebyshev, self.sweeps)
        self._place(builder)

    def _place(self, builder: ti.FieldsBuilder) -> None:
        real, count = runtime.real(), self.state.count
        self.left = place(builder, ti.field(ti.f64), 2)
        """Relative residual after the last sweep of the last call, and the largest since the start [1]."""
        self.tallies.append(self.left)
        if self.accelerates:
            self.omega = place(builder, ti.field(real), self.sweeps)
            """Chebyshev's factor after every sweep [1]."""
            self.last = place(builder, self.vector.field(), count)
            self.earlier = place(builder, self.vector.field(), count)
            """Trial velocities before the last sweep, and before the one before [m/s]."""

    def load(self, assembly: Assembly) -> None:
        """Upload colours and factors."""
        self._write(self.lists.member, self.relaxation)
        for coupling in self.coupling:
            coupling.load()
        for rigid in self.rigid:
            rigid.load()
        self.first_guess.load()

    # -- steps --------------------------------------------------------------------------------------

    def run_serial(self, slot: int, steps: int, dt: float, time: float) -> None:
        """All steps in one launch."""
        self._run_serial(slot, steps, self.sweeps, dt, time)

    def take_step(self, step: int, steps: int, slot: int, dt: float, time: float) -> None:
        """One step, a launch for every colour of every sweep."""
        self._begin_parallel(slot, step, dt, time)
        for sweep in range(self.sweeps):
            self._sweep_parallel(sweep, slot, step, dt, time)
        if self.rigid or step == steps - 1:
            self._measure_parallel(slot, step, dt, time)
        if self.meets_again:
            self._relax_parallel(0, self.member_count, slot, dt, MEET)
        if self.books:
            self._again_parallel(slot, step, dt, time)
        self._finish_parallel(slot, dt)

    def _sweep_parallel(self, sweep: int, slot: int, step: int, dt: float, time: float) -> None:
        if self.prepares:
            self._again_parallel(slot, step, dt, time)
        for first, end in zip(self.first[:-1], self.first[1:], strict=True):
            self._relax_parallel(first, end, slot, dt, RELAX)
        if self.coupling:
            self._couple_parallel(slot, dt)
        if self.accelerates:
            self._accelerate_parallel(sweep, slot, dt)

    def _measure_parallel(self, slot: int, step: int, dt: float, time: float) -> None:
        if self.prepares:
            self._again_parallel(slot, step, dt, time)
        self._relax_parallel(0, self.member_count, slot, dt, MEASURE)
        if self.rigid:
            self._correct_parallel(slot, dt)
        self._sum_parallel()

    @ti.kernel
    def _begin_parallel(self, slot: int, step: int, dt: float, time: float):
        self.begin(slot, time + step * dt, dt)

    @ti.kernel
    def _again_parallel(self, slot: int, step: int, dt: float, time: float):
        self.again(slot, time + step * dt, dt)

    @ti.kernel
    def _relax_parallel(self, first: int, end: int, slot: int, dt: float, errand: int):
        for k in range(first, end):
            self.relax(self.member[k], slot, dt, errand)

    @ti.kernel
    def _couple_parallel(self, slot: int, dt: float):
        for coupling in ti.static(self.coupling):
            coupling.end_sweep(slot, dt)

    @ti.kernel
    def _accelerate_parallel(self, sweep: int, slot: int, dt: float):
        for k in range(self.member_count):
            self.accelerate(self.member[k], sweep, slot, dt)

    @ti.kernel
    def _correct_parallel(self, slot: int, dt: float):
        for rigid in ti.static(self.rigid):
            rigid.correct(slot, dt)

    @ti.kernel
    def _sum_parallel(self):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.sum_up()

    @ti.kernel
    def _finish_parallel(self, slot: int, dt: float):
        for i in range(self.state.count):
            self.finish(i, slot, dt)

    @ti.kernel
    def _run_serial(self, slot: int, steps: int, sweeps: int, dt: float, time: float):
        ti.loop_config(serialize=True)
        for n in range(steps):
            begun = self.slot_at(slot, n)
            now = time + n * dt
            self.begin(begun, now, dt)
            # One loop for all that visits particle by particle: their equation is compiled once. After the sweeps
            # residuals are measured, if somebody wants to know, and what was corrected meets colliders again.
            for visit in range(sweeps + 2):
                errand = ti.max(visit - sweeps + 1, RELAX)
                due = errand == RELAX
                if errand == MEASURE:
                    due = ti.static(len(self.rigid) > 0) or n == steps - 1
                if errand == MEET:
                    due = ti.static(self.meets_again)
                if due:
                    self.visit(visit, errand, begun, now, dt)
            if ti.static(self.books):
                self.again(begun, now, dt)
            for i in range(self.state.count):
                self.finish(i, begun, dt)
            self.meet_others_serial(begun, dt)

    @ti.func
    def visit(self, visit, errand, slot, time, dt):
        """Visit all particles, one after the other."""
        if errand != MEET:
            self.again(slot, time, dt)
        for k in range(self.member_count):
            self.relax(self.member[k], slot, dt, errand)
        if errand == RELAX:
            for coupling in ti.static(self.coupling):
                coupling.end_sweep(slot, dt)
            if ti.static(self.accelerates):
                for k in range(self.member_count):
                    self.accelerate(self.member[k], visit, slot, dt)
        elif errand == MEASURE:
            for rigid in ti.static(self.rigid):
                rigid.correct(slot, dt)
            self.sum_up()

    # -- parts of a step ----------------------------------------------------------------------------

    @ti.func
    def begin(self, slot, time, dt):
        """What moves and flows in the step, and the first guess of its end."""
        self.preparation.begin(slot, time, dt)
        for i in range(self.state.count):
            self.guess(i, slot, dt)

    @ti.func
    def guess(self, i, slot, dt):
        """First guess of particle i; of those that are held or carried it is where they will be."""
        for law in ti.static(self.evolving):
            law.evolve(i, slot, dt)
        start = self.state.x[slot, i]
        v = self.first_guess.velocity(i, slot, dt)
        x = start + dt * v
        for carrier in ti.static(self.carriers):
            x, v = carrier.carry(i, start, x, v, dt)
        self.state.x[1 - slot, i] = x
        self.state.v[1 - slot, i] = v
        self.descent.begin(i)
        if ti.static(self.accelerates):
            self.last[i] = v

    @ti.func
    def again(self, slot, time, dt):
        """What laws must know of the trial."""
        if ti.static(self.prepares):
            self.preparation.again(1 - slot, time + dt)
            for coupling in ti.static(self.coupling):
                coupling.begin_sweep(slot)

    @ti.func
    def relax(self, i, slot, dt, errand):
        """One Newton step of particle i, or another errand; those that are held have none."""
        if ti.static(not self.holds) or self.state.inverse_mass[i] > 0.0:
            if ti.static(self.coupling):
                self.coupling[0].relax(i, slot, dt, errand)
            else:
                self.descent.relax(i, slot, dt, errand)
        else:
            self.descent.residual[i] = self.vector(0.0)
            self.descent.impulse[i] = 0.0
            for coupling in ti.static(self.coupling):
                coupling.lean[i] = self.vector(0.0)

    @ti.func
    def accelerate(self, i, sweep, slot, dt):
        """Particle i after a sweep: further the way that it goes."""
        v = self.state.v[1 - slot, i]
        before = self.last[i]
        if self.omega[sweep] != 1.0 and self.descent.touched(i) == 0:
            v = self.omega[sweep] * (v - self.earlier[i]) + self.earlier[i]
            self.state.v[1 - slot, i] = v
            self.state.x[1 - slot, i] = self.state.x[slot, i] + dt * v
        self.earlier[i] = before
        self.last[i] = v

    @ti.func
    def finish(self, i, slot, dt):
        """The trial of particle i is its new state."""
        trial = 1 - slot
        x = self.state.x[trial, i]
        self.first_guess.learn(i, slot)
        for contact in ti.static(self.contact):
            contact.watch(i, x)
        for books in ti.static(self.books):
            self.book(books, i, slot, dt)

    @ti.func
    def book(self, books: ti.template(), i, slot, dt):
        """Book the step of particle i: forces at its end, and what of its impulse colliders gave."""
        trial = 1 - slot
        m = self.state.mass[i]
        v = self.state.v[trial, i]
        begun = self.state.v[slot, i]
        force = self.vector(0.0)
        for law in ti.static(self.descent.laws):
            force += law.force_on(i, trial)
        lossy = books.stage(i, trial, dt, force)
        impulse = dt * force
        if ti.static(self.drag > 0.0):
            books.ledger.add(books.drag_term, i, -dt * self.drag * m * v.dot(v))
            impulse -= dt * self.drag * m * v
        free = v
        if self.descent.touched(i) == 1:
            free = begun + self.state.inverse_mass[i] * impulse
        for meetings in ti.static(self.descent.meetings):
            meetings.hand_in_friction(books.ledger, i, m * (v - free))
        moved = self.state.x[trial, i] - self.state.x[slot, i] - dt * free
        books.finish(i, begun, force - lossy, moved, free, v, dt)

    # -- what is left -------------------------------------------------------------------------------

    @ti.func
    def sum_up(self):
        """Relative residual of what was measured, added up in order."""
        residual = ti.cast(0.0, ti.f64)
        impulse = ti.cast(0.0, ti.f64)
        for k in range(self.member_count):
            i = self.member[k]
            r = self.descent.residual[i]
            residual += ti.cast(self.state.inverse_mass[i] * r.dot(r), ti.f64)
            impulse += ti.cast(self.descent.impulse[i], ti.f64)
        left = ti.cast(0.0, ti.f64)
        if impulse > 0.0:
            left = ti.sqrt(residual / impulse)
        self.left[0] = left
        self.left[1] = ti.max(self.left[1], left)

    def report(self) -> dict[str, float]:
        """Norm of M^-1/2 r against that of the impulses of all laws, after the last sweep of a call [1]."""
        last, largest = self.left.to_numpy()
        return {"sweeps": float(self.sweeps), "residual": float(last), "largest_residual": float(largest)}

    @ti.kernel
    def _write(self, member: ti.types.ndarray(), omega: ti.types.ndarray()):
        for k in range(member.shape[0]):
            self.member[k] = member[k]
        if ti.static(self.accelerates):
            for sweep in range(omega.shape[0]):
                self.omega[sweep] = omega[sweep]


def _colours(assembly: Assembly) -> tuple[int, NDArray[np.int32]]:
    """Colours of all particles by springs and faces; held ones take no part, and wall off none."""
    faces = [assembly.gas_faces.faces, assembly.wind_faces.faces]
    sides = [face[:, [a, b]] for face in faces for a in range(face.shape[1]) for b in range(a)]
    pairs = np.concatenate([assembly.springs, *sides]).astype(np.int64)
    moving = assembly.inverse_masses > 0.0
    return colour_particles(assembly.particle_count, pairs[moving[pairs].all(axis=1)])


def _relaxation(radius: float, sweeps: int) -> FloatArray:
    """Chebyshev's factors after every sweep for a spectral radius of one sweep, shape (sweeps,); 1 after the last."""
    factors = np.ones(sweeps)
    for k in range(1, sweeps - 1):
        factors[k] = 2.0 / (2.0 - radius**2) if k == 1 else 4.0 / (4.0 - radius**2 * factors[k - 1])
    return factors
