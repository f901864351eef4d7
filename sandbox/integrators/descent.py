"""One particle's part in a step of implicit Euler, with all others held still: the block of vertex block descent.

The step's end, the *trial*, is in the other slot. A particle's own equation is

    r(v) = m (v - v0) + h gamma m v - h F(x0 + h v, v) = 0,

of which one Newton step is v - A^-1 r with A = m (1 + h gamma) + h^2 K + h C, the laws' diagonal blocks. Colliders
take part in every such step, see :mod:`sandbox.integrators.meetings`.
"""

import taichi as ti

from sandbox import runtime
from sandbox.contact.colliders.solid import rounding
from sandbox.integrators.bearing import FREE
from sandbox.integrators.meetings import Meetings
from sandbox.integrators.small_systems import factorised, solved
from sandbox.parts import Parts
from sandbox.state import ParticleState, place

RELAX, MEASURE, MEET = 0, 1, 2
"""What particles are visited for: a Newton step; to note their residuals; to meet colliders after a correction."""
_DROWNED = 8.0
"""Rounding errors of a matrix's trace that count as nothing."""


@ti.data_oriented
class Descent:
    """Newton steps of single particles, in place on the trial of a step."""

    def __init__(self, builder: ti.FieldsBuilder, state: ParticleState, parts: Parts, drag: float) -> None:
        self.state = state
        self.laws = parts.laws
        # What couples particles by a ``bulk`` stiffness is seen to by whoever sweeps.
        stiff = [law for law in parts.laws if hasattr(law, "block_on") and not hasattr(law, "bulk")]
        self.products = [law for law in stiff if hasattr(law, "product_on")]
        self.answering = [law for law in stiff if hasattr(law, "answer_on")]
        self.others = [law for law in parts.laws if law not in self.answering]
        self.stiff = [law for law in stiff if law not in self.answering]
        self.meetings = [Meetings(builder, state, parts.colliders)] if parts.colliders else []
        self.drag = drag
        self.vector = runtime.vector(state.dimension)
        self.matrix = ti.types.matrix(state.dimension, state.dimension, runtime.real())
        self.rounding = _DROWNED * rounding()
        self.residual = place(builder, self.vector.field(), state.count)
        """r of every particle when last measured [N s], less what colliders give."""
        self.impulse = place(builder, ti.field(runtime.real()), state.count)
        """Sum over all laws of |h F|^2 / m then [J]."""

    @ti.func
    def begin(self, i):
        """Nothing has touched particle i in this step."""
        for meetings in ti.static(self.meetings):
            meetings.mode[i] = FREE

    @ti.func
    def touched(self, i) -> ti.i32:
        """1 where a collider changed the particle's last move."""
        touched = 0
        for meetings in ti.static(self.meetings):
            touched = ti.cast(meetings.mode[i] != FREE, ti.i32)
        return touched

    @ti.func
    def equation(self, i, slot, dt):
        """Residual r [N s] and matrix A [kg] of particle i at its trial, and the squares of its impulses [N^2 s^2]."""
        trial = 1 - slot
        m = self.state.mass[i]
        force = self.vector(0.0)
        size = 0.0 * m
        block = self.matrix(0.0)
        for law in ti.static(self.answering):
            push, part = law.answer_on(i, trial, dt * dt, dt)
            force += push
            size += push.dot(push)
            block += part
        for law in ti.static(self.others):
            push = law.force_on(i, trial)
            force += push
            size += push.dot(push)
        for law in ti.static(self.stiff):
            block += law.block_on(i, trial, dt * dt, dt)
        v = self.state.v[trial, i]
        residual = m * (v - self.state.v[slot, i]) - dt * force
        inertia = m
        if ti.static(self.drag > 0.0):
            residual += dt * self.drag * m * v
            inertia += dt * self.drag * m
        for axis in ti.static(range(self.state.dimension)):
            block[axis, axis] += inertia
        return residual, block, dt * dt * size

    @ti.func
    def relax(self, i, slot, dt, errand):
        """One Newton step of particle i, or another errand."""
        residual, change = self.vector(0.0), self.vector(0.0)
        block = self.mass_of(i)
        factor = block
        if errand != MEET:
            r, a, size = self.equation(i, slot, dt)
            if errand == MEASURE:
                self.note(i, r, size)
            else:
                residual = r
                block = a
                factor = factorised(a, self.state.mass[i], self.rounding)
                change = solved(factor, residual)
        self.go(i, slot, change, block, factor, dt, errand)

    @ti.func
    def go(self, i, slot, change, block, factor, dt, errand):
        """Move particle i, unless it is only measured; what meets once more is only what met nothing so far."""
        if errand == RELAX or (errand == MEET and self.touched(i) == 0):
            self.move(i, slot, change, block, factor, dt)

    @ti.func
    def mass_of(self, i):
        """The mass of particle i as a matrix [kg], which is its own factor."""
        matrix = self.matrix(0.0)
        for axis in ti.static(range(self.state.dimension)):
            matrix[axis, axis] = self.state.mass[i]
        return matrix

    @ti.func
    def note(self, i, residual, size):
        """Remember how far particle i is from its equation."""
        rest = residual
        for meetings in ti.static(self.meetings):
            rest = meetings.excess(i, residual)
        self.residual[i] = rest
        self.impulse[i] = self.state.inverse_mass[i] * size

    @ti.func
    def shift(self, i, slot, change, dt):
        """Take ``change`` [m/s] from the velocity of particle i, in a motion that changes no force."""
        self.state.v[1 - slot, i] -= change
        self.state.x[1 - slot, i] -= dt * change
        self.residual[i] -= (1.0 + dt * self.drag) * self.state.mass[i] * change

    @ti.func
    def move(self, i, slot, change, block, factor, dt):
        """Particle i shall have ``change`` [m/s] less, and meets what is there."""
        trial = 1 - slot
        v = self.state.v[trial, i] - change
        end = self.state.x[slot, i] + dt * v
        if ti.static(self.meetings):
            if self.touched(i) == 1:
                end = self.state.x[trial, i] - dt * change
            for meetings in ti.static(self.meetings):
                meetings.move(i, slot, end, v, block, factor, dt)
        else:
            self.state.x[trial, i] = end
            self.state.v[trial, i] = v
