"""Particles that hang together by one number, as all of a balloon do by its volume.

To the matrix that a sweep goes through, springs and masses, a gas adds kappa a a^T with a = dV/dx of all its particles
and kappa = -h^2 dp/dV. It is left out of the particles' own blocks: each would answer all of the pressure by itself, or
none of them would dare to move. So a sweep goes with the pressure as it is, and afterwards is corrected for what the
volume did meanwhile: if the sweep is v <- v - B^-1 r, then with y = B^-1 a the sweep for B + kappa a a^T is

    v <- v - B^-1 r + y kappa (a, B^-1 r) / (1 + kappa (a, y))        (Sherman and Morrison 1950),

which converges wherever the sweep without gas does (Householder and John: B + B^T - A stays positive). y comes with
the sweep, particle by particle. Areas and pressures are measured anew before each.

Particles at colliders have y = 0: how far they give way is not known beforehand; what they did is seen in the volume.
"""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.group_blocks import GroupBlocks, GroupFields
from sandbox.integrators.descent import MEASURE, MEET, Descent
from sandbox.integrators.small_systems import factorised, solved
from sandbox.state import ParticleState, place


@ti.data_oriented
class Coupling:
    """Sweeps of particles that G gases couple.

    Parameters
    ----------
    law : has ``bulk`` (-dp/dV of every gas, [Pa/m^3]) and ``area_on(i)`` (dV/dx [m^2]), both as last prepared
    gas : gas of every particle, -1 if none, or if it cannot move, shape (particle_count,)
    """

    def __init__(
        self, builder: ti.FieldsBuilder, state: ParticleState, law: Any, gas: NDArray[np.int32], descent: Descent
    ) -> None:
        self.state = state
        self.law = law
        self.descent = descent
        self.products = descent.products
        self.count = law.count
        self.blocks = GroupFields(builder, GroupBlocks.of(gas, law.count))
        self.vector = runtime.vector(state.dimension)
        real = runtime.real()
        self.particle_gas = gas
        self.gas = place(builder, ti.field(ti.i32), state.count)
        self.begun = place(builder, self.vector.field(), state.count)
        """Trial positions before the sweep [m]."""
        self.lean = place(builder, self.vector.field(), state.count)
        """y of every particle so far [m^2/kg]."""
        self.grown, self.soft = (place(builder, ti.field(real), self.blocks.block_count) for _ in range(2))
        """Growth of the volume over h [m^3/s], and (a, y) [m^4/kg], of every block of particles."""
        self.share = place(builder, ti.field(real), self.count)
        """kappa (a, B^-1 r) / (1 + kappa (a, y)) of every gas [kg/(m s)]."""

    def load(self) -> None:
        """Upload the lists."""
        self.blocks.load()
        self._write(self.particle_gas)

    @ti.kernel
    def _write(self, gas: ti.types.ndarray()):
        for i in range(gas.shape[0]):
            self.gas[i] = gas[i]

    @ti.func
    def begin_sweep(self, slot):
        """Before a sweep: nothing has moved."""
        for i in range(self.state.count):
            self.begun[i] = self.state.x[1 - slot, i]
            self.lean[i] = self.vector(0.0)

    @ti.func
    def relax(self, i, slot, dt, errand):
        """One Newton step of particle i at the pressure as it is, and its y; or another errand."""
        change, lean = self.vector(0.0), self.vector(0.0)
        block = self.descent.mass_of(i)
        factor = block
        if errand != MEET:
            r, a, size = self.descent.equation(i, slot, dt)
            if errand == MEASURE:
                self.descent.note(i, r, size)
            else:
                block = a
                factor = factorised(a, self.state.mass[i], self.descent.rounding)
                change = solved(factor, r)
                if self.gas[i] >= 0:
                    lean = self.law.area_on(i)
                    for law in ti.static(self.products):
                        lean -= law.product_on(i, 1 - slot, self.lean, dt * dt, dt)
                    lean = solved(factor, lean)
        self.descent.go(i, slot, change, block, factor, dt, errand)
        self.lean[i] = (1.0 - self.descent.touched(i)) * lean

    @ti.func
    def end_sweep(self, slot, dt):
        """After a sweep: correct it for what volumes did. Loops run in parallel where a kernel calls this outermost."""
        for b in range(self.blocks.block_count):
            self.add_up(b, slot, dt)
        ti.loop_config(serialize=True)
        for g in range(self.count):
            self.settle(g, dt)
        for b in range(self.blocks.block_count):
            self.correct(b, slot, dt)

    @ti.func
    def add_up(self, b, slot, dt):
        """How the volume grew, and how soft it is, over a block of particles."""
        grown, soft = 0.0 * dt, 0.0 * dt
        for k in range(self.blocks.first[b], self.blocks.first[b + 1]):
            i = self.blocks.member[k]
            area = self.law.area_on(i)
            grown += area.dot(self.state.x[1 - slot, i] - self.begun[i]) / dt
            soft += area.dot(self.lean[i])
        self.grown[b] = grown
        self.soft[b] = soft

    @ti.func
    def settle(self, g, dt):
        """What gas g makes of it."""
        grown, soft = 0.0 * dt, 0.0 * dt
        for b in range(self.blocks.row[g], self.blocks.row[g + 1]):
            grown += self.grown[b]
            soft += self.soft[b]
        kappa = dt * dt * self.law.bulk[g]
        self.share[g] = -kappa * grown / (1.0 + kappa * ti.max(soft, 0.0))

    @ti.func
    def correct(self, b, slot, dt):
        """Move the particles of a block on."""
        share = self.share[self.blocks.group[b]]
        for k in range(self.blocks.first[b], self.blocks.first[b + 1]):
            i = self.blocks.member[k]
            if self.descent.touched(i) == 0:
                self.descent.shift(i, slot, -share * self.lean[i], dt)
