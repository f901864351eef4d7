"""The motion of whole bodies within sweeps: no sweep sees it, so it is set right at the end.

Springs and gases of a body by itself give it no momentum, linear or angular: the residuals of its particles must add up
to nothing, and so must their moments. Sweeps end before they know: they move particle after particle, and a stiff body,
whose particles hardly give way by themselves, would fall slower than a stone. So once the sweeps are done every
body that nothing holds and no collider touched is moved as a rigid one until both sums vanish. Its shape, and so
its forces, stay as they are. A coarse correction in the sense of multigrid, with the rigid motions of bodies
for the coarse space.
"""

from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.group_blocks import GroupBlocks, GroupFields
from sandbox.integrators.descent import Descent
from sandbox.integrators.small_systems import factorised, solved
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState, place


@dataclass(frozen=True)
class FreeBodies:
    """Groups of bodies that nothing holds, each by itself or with those that attachments tie to it."""

    blocks: GroupBlocks
    """Their particles."""
    mass: NDArray[np.float64]
    """Mass of every group [kg], shape (G,)."""

    @classmethod
    def of(cls, assembly: Assembly) -> "FreeBodies":
        """Those of a scene with no pinned or carried particle, and with springs."""
        family = assembly.families[assembly.particle_body]
        tied = np.zeros(int(family.max()) + 1, dtype=bool)
        tied[family[assembly.springs.ravel()]] = True
        tied[family[assembly.inverse_masses == 0.0]] = False
        number = np.cumsum(tied) - 1
        group = np.where(tied[family], number[family], -1).astype(np.int32)
        mass = np.zeros(int(tied.sum()))
        np.add.at(mass, group[group >= 0], assembly.masses[group >= 0])
        return cls(GroupBlocks.of(group, len(mass)), mass)


@ti.data_oriented
class RigidMotion:
    """Moves free bodies as rigid ones until their residuals balance."""

    def __init__(
        self, builder: ti.FieldsBuilder, state: ParticleState, bodies: FreeBodies, descent: Descent, drag: float
    ) -> None:
        self.state = state
        self.bodies = bodies
        self.blocks = GroupFields(builder, bodies.blocks)
        self.descent = descent
        self.drag = drag
        self.dimension = state.dimension
        blocks, groups = self.blocks.block_count, self.blocks.group_count
        fine = ti.f64
        self.spins = 1 if state.dimension == 2 else 3
        self.line = ti.types.vector(state.dimension, fine)
        self.turn = ti.types.vector(self.spins, fine)
        self.tensor = ti.types.matrix(self.spins, self.spins, fine)
        self.rounding = 1e-12
        self.mass = place(builder, ti.field(fine), groups)
        # Sums over blocks: m x, r, x cross r, inertia, about the group's first particle; and who was touched.
        self.weighed, self.lacking = (place(builder, self.line.field(), blocks) for _ in range(2))
        self.moment = place(builder, self.turn.field(), blocks)
        self.inertia = place(builder, self.tensor.field(), blocks)
        self.touched = place(builder, ti.field(ti.i32), blocks)
        self.centre, self.velocity = (place(builder, self.line.field(), groups) for _ in range(2))
        """Centre of mass [m], and what is to be taken from the velocity there [m/s]."""
        self.spin = place(builder, self.turn.field(), groups)
        """What is to be taken from the angular velocity [rad/s]."""

    def load(self) -> None:
        """Upload the lists."""
        self.blocks.load()
        self._write(self.bodies.mass)

    @ti.kernel
    def _write(self, mass: ti.types.ndarray()):
        for g in range(mass.shape[0]):
            self.mass[g] = mass[g]

    @ti.func
    def correct(self, slot, dt):
        """Balance the residuals that were noted last. Loops run in parallel where the kernel calls this outermost."""
        for b in range(self.blocks.block_count):
            self.add_up(b, slot)
        ti.loop_config(serialize=True)
        for g in range(self.blocks.group_count):
            self.settle(g, slot, dt)
        for b in range(self.blocks.block_count):
            self.move(b, slot, dt)

    @ti.func
    def place_of(self, i, slot):
        """Where particle i is in the trial [m]."""
        return ti.cast(self.state.x[1 - slot, i], self.mass.dtype)

    @ti.func
    def add_up(self, b, slot):
        weighed, lacking = self.line(0.0), self.line(0.0)
        moment, inertia = self.turn(0.0), self.tensor(0.0)
        touched = 0
        origin = self.place_of(self.blocks.first_member(self.blocks.group[b]), slot)
        for k in range(self.blocks.first[b], self.blocks.first[b + 1]):
            i = self.blocks.member[k]
            x = self.place_of(i, slot) - origin
            m = ti.cast(self.state.mass[i], self.mass.dtype)
            r = ti.cast(self.descent.residual[i], self.mass.dtype)
            weighed += m * x
            lacking += r
            moment += self.cross(x, r)
            inertia += m * self.spread(x)
            touched = ti.max(touched, self.descent.touched(i))
        self.weighed[b] = weighed
        self.lacking[b] = lacking
        self.moment[b] = moment
        self.inertia[b] = inertia
        self.touched[b] = touched

    @ti.func
    def cross(self, a, b):
        """Moment of b at a."""
        if ti.static(self.dimension == 2):
            return self.turn([a[0] * b[1] - a[1] * b[0]])
        else:
            return a.cross(b)

    @ti.func
    def spread(self, x):
        """Inertia of a unit mass at x [m^2]."""
        tensor = self.tensor(0.0)
        if ti.static(self.dimension == 2):
            tensor[0, 0] = x.dot(x)
        else:
            tensor = -x.outer_product(x)
            for axis in ti.static(range(3)):
                tensor[axis, axis] += x.dot(x)
        return tensor

    @ti.func
    def settle(self, g, slot, dt):
        """How group g has to move."""
        weighed, lacking = self.line(0.0), self.line(0.0)
        moment, inertia = self.turn(0.0), self.tensor(0.0)
        touched = 0
        for b in range(self.blocks.row[g], self.blocks.row[g + 1]):
            weighed += self.weighed[b]
            lacking += self.lacking[b]
            moment += self.moment[b]
            inertia += self.inertia[b]
            touched = ti.max(touched, self.touched[b])
        m = self.mass[g]
        centre = weighed / m
        moment -= self.cross(centre, lacking)
        inertia -= m * self.spread(centre)
        # What it takes to stop all of it, drag included; a touched body is left to the sweeps.
        ease = (1.0 - touched) / (1.0 + dt * self.drag)
        least = self.rounding * m * centre.dot(centre)
        self.centre[g] = centre + self.place_of(self.blocks.first_member(g), slot)
        self.velocity[g] = ease * lacking / m
        self.spin[g] = ease * solved(factorised(inertia, ti.max(least, 1e-30), self.rounding), moment)

    @ti.func
    def move(self, b, slot, dt):
        g = self.blocks.group[b]
        for k in range(self.blocks.first[b], self.blocks.first[b + 1]):
            i = self.blocks.member[k]
            x = self.place_of(i, slot) - self.centre[g]
            swing = self.line(0.0)
            if ti.static(self.dimension == 2):
                swing = self.spin[g][0] * self.line([-x[1], x[0]])
            else:
                swing = self.spin[g].cross(x)
            self.descent.shift(i, slot, ti.cast(self.velocity[g] + swing, self.state.mass.dtype), dt)
