"""Springs between particles, gathered by each particle over its own half-edges.

Every spring is stored twice, once at each end. Both ends compute the same force with opposite sign,
so momentum is kept without atomics, and the order of the sum never changes.

The inner loops are in a shape that LLVM turns into vector instructions: no branch, one square root,
one division. ``max(r^2, tiny)`` makes a spring of length 0 pull with no force at all.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.forces.spring_rows import END, SpringRows, arrange
from sandbox.scene.assemble import Assembly
from sandbox.scene.spring_set import SpringSet
from sandbox.state import SLICE, ParticleState, place

# Smallest squared length [m^2] that is told from 0; its reciprocal square root is finite in f32.
_TINY = 1e-24
# Of a spring's stiffness: what it may lose sideways where it is compressed to next to nothing.
_MOST_YIELDING = -10.0
# Below this a step is over before slices pay for the longer kernel that they compile to.
_LEAST_SPRINGS = 1000


@ti.data_oriented
class Springs:
    """Springs: force [k (r - L) + c (v_b - v_a) u] u on the end whose neighbour lies in direction u.

    Without damping anywhere in the scene, the damping term, its field and the reading of velocities
    are not compiled.
    """

    term = "elastic"
    dissipation_term = "damping"
    linked = False
    """True with room for :meth:`link`."""
    constraint = "springs"
    """As what a scheme that solves constraints takes them."""
    tension_only = False
    """True where springs pull and never push."""
    numbers: NDArray[np.int64]
    """Number of each of these springs among all of the scene."""

    def __init__(self, builder: ti.FieldsBuilder, springs: SpringSet, state: ParticleState, rows: SpringRows) -> None:
        self.state = state
        self.springs = springs
        self.rows = rows
        self.vector = runtime.vector(state.dimension)
        self.matrix = ti.types.matrix(state.dimension, state.dimension, runtime.real())
        self.damped = bool(springs.damping.any())
        real = runtime.real()
        half_edges = len(rows.neighbour)
        self.row = place(builder, ti.field(ti.i32), state.count + 1)
        self.neighbour = place(builder, ti.field(ti.i32), half_edges)
        self.rest_length = place(builder, ti.field(real), half_edges)
        self.stiffness = place(builder, ti.field(real), half_edges)
        if self.damped:
            self.damping = place(builder, ti.field(real), half_edges)

    def place_links(self, builder: ti.FieldsBuilder) -> None:
        """Make room for :meth:`link`; before the tree is finalised."""
        self.linked = True
        self.link_axis = place(builder, self.vector.field(), len(self.rows.neighbour))
        self.link_cross = place(builder, ti.field(runtime.real()), len(self.rows.neighbour))

    def load(self, assembly: Assembly) -> None:
        """Upload rows, neighbours and constants."""
        rows, springs = self.rows, self.springs
        self._write(
            rows.row,
            rows.neighbour,
            springs.rest_lengths[rows.spring],
            springs.stiffness[rows.spring],
            springs.damping[rows.spring],
        )

    @ti.kernel
    def _write(
        self,
        row: ti.types.ndarray(),
        neighbour: ti.types.ndarray(),
        rest_length: ti.types.ndarray(),
        stiffness: ti.types.ndarray(),
        damping: ti.types.ndarray(),
    ):
        for i in range(row.shape[0]):
            self.row[i] = row[i]
        for h in range(neighbour.shape[0]):
            self.neighbour[h] = neighbour[h]
            self.rest_length[h] = rest_length[h]
            self.stiffness[h] = stiffness[h]
            if ti.static(self.damped):
                self.damping[h] = damping[h]

    @ti.func
    def force_on(self, i, slot):
        return self.gather(i, slot, self.row[i], self.row[i + 1])

    @ti.func
    def gather(self, i, slot, first, end):
        """Force of the half-edges ``first`` to ``end`` on particle i [N]."""
        x = self.state.x[slot, i]
        v = self.vector(0.0)
        if ti.static(self.damped):
            v = self.state.force_velocity[slot, i]
        force = self.vector(0.0)
        for h in range(first, end):
            j = self.neighbour[h]
            d = self.state.x[slot, j] - x
            r2 = ti.max(d.dot(d), _TINY)
            inverse_r = ti.rsqrt(r2)
            stretch = r2 * inverse_r - self.rest_length[h]
            tension = self.stiffness[h] * stretch
            if ti.static(self.damped):
                tension += self.damping[h] * ((self.state.force_velocity[slot, j] - v).dot(d) * inverse_r)
            if ti.static(self.tension_only):
                # A rope never pushes, not even by its damping.
                tension = ti.select(stretch > 0.0, ti.max(tension, 0.0), 0.0)
            force += tension * inverse_r * d
        return force

    @ti.func
    def energy_on(self, i, slot):
        """Half of the energy of every spring at particle i [J]; the other end has the other half."""
        x = self.state.x[slot, i]
        energy = 0.0
        for h in range(self.row[i], self.row[i + 1]):
            stretch = (self.state.x[slot, self.neighbour[h]] - x).norm() - self.rest_length[h]
            if ti.static(self.tension_only):
                stretch = ti.max(stretch, 0.0)
            energy += 0.25 * self.stiffness[h] * stretch * stretch
        return energy

    @ti.func
    def dissipation_on(self, i, slot):
        """The damping part of the force on particle i [N]."""
        force = self.vector(0.0)
        if ti.static(self.damped):
            x = self.state.x[slot, i]
            v = self.state.force_velocity[slot, i]
            for h in range(self.row[i], self.row[i + 1]):
                j = self.neighbour[h]
                d = self.state.x[slot, j] - x
                r2 = ti.max(d.dot(d), _TINY)
                force += self.damping[h] * ((self.state.force_velocity[slot, j] - v).dot(d) / r2) * d
        return force

    @ti.func
    def product_on(self, i, slot, u: ti.template(), stiff, damp):
        """Row i of (``stiff`` K + ``damp`` C) u at the positions of ``slot``; K is made positive, see :meth:`_link`.

        u is a field of vectors, shape (particle_count,).
        """
        x, own = self.state.x[slot, i], u[i]
        product = self.vector(0.0)
        for h in range(self.row[i], self.row[i + 1]):
            j = self.neighbour[h]
            d = self.state.x[slot, j] - x
            axial, cross = self._link(h, d, stiff, damp, 0.0)
            w = own - u[j]
            product += (axial * w.dot(d)) * d + cross * w
        return product

    @ti.func
    def link(self, i, slot, stiff, damp, yielding):
        """Note the blocks of the half-edges of particle i for :meth:`linked_product_on`.

        With ``yielding`` 1 as they are, compressed springs that give way sideways included; with 0 made positive.
        """
        x = self.state.x[slot, i]
        for h in range(self.row[i], self.row[i + 1]):
            d = self.state.x[slot, self.neighbour[h]] - x
            axial, cross = self._link(h, d, stiff, damp, yielding)
            self.link_axis[h] = ti.sqrt(ti.max(axial, 0.0)) * d
            self.link_cross[h] = cross

    @ti.func
    def linked_product_on(self, i, u: ti.template()):
        """Row i of the matrix last noted times u: for the many products of one linear solve."""
        own = u[i]
        product = self.vector(0.0)
        for h in range(self.row[i], self.row[i + 1]):
            w = own - u[self.neighbour[h]]
            product += self.link_axis[h].dot(w) * self.link_axis[h] + self.link_cross[h] * w
        return product

    @ti.func
    def block_on(self, i, slot, stiff, damp):
        """Diagonal block of the same matrix, of particle i, (d, d), made positive."""
        x = self.state.x[slot, i]
        block = self.matrix(0.0)
        for h in range(self.row[i], self.row[i + 1]):
            d = self.state.x[slot, self.neighbour[h]] - x
            axial, cross = self._link(h, d, stiff, damp, 0.0)
            block += axial * d.outer_product(d)
            for axis in ti.static(range(self.state.dimension)):
                block[axis, axis] += cross
        return block

    @ti.func
    def _link(self, h, d, stiff, damp, yielding):
        """Factors a and b of a half-edge's block a d d^T + b I.

        Along the spring k and c, across it k (1 - L / r), which but for ``yielding`` 1 is left out where it is
        negative: a compressed spring gives way sideways, and no method that minimises may be led by that alone
        (Teran et al. 2005).
        """
        r2 = ti.max(d.dot(d), _TINY)
        inverse_r = ti.rsqrt(r2)
        slack = 1.0 - self.rest_length[h] * inverse_r
        along = stiff * self.stiffness[h]
        cross = along * ti.max(slack, 0.0)
        if ti.static(not self.tension_only):
            cross += along * yielding * ti.max(ti.min(slack, 0.0), _MOST_YIELDING)
        if ti.static(self.damped):
            along += damp * self.damping[h]
        if ti.static(self.tension_only):
            along = ti.select(slack > 0.0, along, 0.0)
        return (along - cross) / r2, cross

    @ti.func
    def answer_on(self, i, slot, stiff, damp):
        """:meth:`force_on` and :meth:`block_on` in one go, which takes half the time of both."""
        x = self.state.x[slot, i]
        v = self.vector(0.0)
        if ti.static(self.damped):
            v = self.state.force_velocity[slot, i]
        force = self.vector(0.0)
        block = self.matrix(0.0)
        for h in range(self.row[i], self.row[i + 1]):
            j = self.neighbour[h]
            d = self.state.x[slot, j] - x
            inverse_r = ti.rsqrt(ti.max(d.dot(d), _TINY))
            inverse_r2 = inverse_r * inverse_r
            slack = 1.0 - self.rest_length[h] * inverse_r
            pull = self.stiffness[h] * slack
            along = stiff * self.stiffness[h]
            cross = along * ti.max(slack, 0.0)
            if ti.static(self.damped):
                pull += self.damping[h] * ((self.state.force_velocity[slot, j] - v).dot(d) * inverse_r2)
                along += damp * self.damping[h]
            if ti.static(self.tension_only):
                pull = ti.select(slack > 0.0, ti.max(pull, 0.0), 0.0)
                along = ti.select(slack > 0.0, along, 0.0)
            force += pull * d
            axial = (along - cross) * inverse_r2
            for a in ti.static(range(self.state.dimension)):
                for b in ti.static(range(a + 1)):
                    block[a, b] += axial * d[a] * d[b]
                block[a, a] += cross
        for a in ti.static(range(self.state.dimension)):
            for b in ti.static(range(a)):
                block[b, a] = block[a, b]
        return force, block

    @ti.func
    def strain_on(self, i, slot):
        """Largest |r - L| / L of the springs at particle i [1]. Those of rest length 0, slack or torn have none."""
        x = self.state.x[slot, i]
        strain = 0.0
        for h in range(self.row[i], self.row[i + 1]):
            rest = self.rest_length[h]
            stretch = (self.state.x[slot, self.neighbour[h]] - x).norm() - rest
            if ti.static(self.tension_only):
                stretch = ti.max(stretch, 0.0)
            if rest > 0.0 and self.stiffness[h] > 0.0:
                strain = ti.max(strain, ti.abs(stretch) / rest)
        return strain


@ti.data_oriented
class SlicedSprings(Springs):
    """The same springs, most of them gathered for a slice of consecutive particles at once."""

    def __init__(self, builder: ti.FieldsBuilder, springs: SpringSet, state: ParticleState, rows: SpringRows) -> None:
        super().__init__(builder, springs, state, rows)
        lanes = ti.types.vector(SLICE, runtime.real())
        self.lanes = ti.types.matrix(state.dimension, SLICE, runtime.real())
        entries = len(rows.offset)
        self.sliced = place(builder, ti.field(ti.i32), state.count)
        self.slice_row = place(builder, ti.field(ti.i32), len(rows.slice_row))
        self.offset = place(builder, ti.field(ti.i32), entries)
        self.slice_rest_length = place(builder, lanes.field(), entries)
        self.slice_stiffness = place(builder, lanes.field(), entries)
        if self.damped:
            self.slice_damping = place(builder, lanes.field(), entries)
        # By axis, then by lane: stores of consecutive lanes are what the compiler packs from.
        self.slice_force = place(builder, lanes.field(), state.capacity // SLICE, state.dimension)

    def load(self, assembly: Assembly) -> None:
        super().load(assembly)
        rows = self.rows
        self._write_slices(
            rows.sliced,
            rows.slice_row,
            rows.offset,
            _by_lane(self.springs.rest_lengths, rows),
            _by_lane(self.springs.stiffness, rows),
            _by_lane(self.springs.damping, rows),
        )

    @ti.kernel
    def _write_slices(
        self,
        sliced: ti.types.ndarray(),
        slice_row: ti.types.ndarray(),
        offset: ti.types.ndarray(),
        rest_length: ti.types.ndarray(),
        stiffness: ti.types.ndarray(),
        damping: ti.types.ndarray(),
    ):
        for i in range(sliced.shape[0]):
            self.sliced[i] = sliced[i]
        for s in range(slice_row.shape[0]):
            self.slice_row[s] = slice_row[s]
        for e in range(offset.shape[0]):
            self.offset[e] = offset[e]
            for lane in range(SLICE):
                self.slice_rest_length[e][lane] = rest_length[e, lane]
                self.slice_stiffness[e][lane] = stiffness[e, lane]
                if ti.static(self.damped):
                    self.slice_damping[e][lane] = damping[e, lane]

    @ti.func
    def gather_slice(self, index, slot):
        """Forces on the particles of a slice by its common offsets, left in ``slice_force``.

        The lanes are written out one by one, in a loop whose end the compiler cannot count: so it packs
        the lanes into vectors. Left to count the loop, it would pack its rounds, and gather.
        """
        first = index * SLICE
        x, v, force = self.lanes(0.0), self.lanes(0.0), self.lanes(0.0)
        for lane in ti.static(range(SLICE)):
            for axis in ti.static(range(self.state.dimension)):
                x[axis, lane] = self.state.x[slot, first + lane][axis]
                if ti.static(self.damped):
                    v[axis, lane] = self.state.force_velocity[slot, first + lane][axis]
        e = self.slice_row[index]
        while self.offset[e] != END:
            # 64 bits: in 32 the compiler would have to prove for each lane that its index does not wrap.
            other = ti.i64(first + self.offset[e])
            for lane in ti.static(range(SLICE)):
                d = self.state.x[slot, other + ti.i64(lane)]
                for axis in ti.static(range(self.state.dimension)):
                    d[axis] -= x[axis, lane]
                r2 = ti.max(d.dot(d), _TINY)
                pull = self.slice_stiffness[e][lane] * (r2 - self.slice_rest_length[e][lane] * ti.sqrt(r2))
                if ti.static(self.damped):
                    w = self.state.force_velocity[slot, other + ti.i64(lane)]
                    for axis in ti.static(range(self.state.dimension)):
                        w[axis] -= v[axis, lane]
                    pull += self.slice_damping[e][lane] * w.dot(d)
                pull /= r2
                for axis in ti.static(range(self.state.dimension)):
                    force[axis, lane] += pull * d[axis]
            e += 1
        for axis in ti.static(range(self.state.dimension)):
            for lane in ti.static(range(SLICE)):
                self.slice_force[index, axis][lane] = force[axis, lane]

    @ti.func
    def force_on(self, i, slot):
        force = self.gather(i, slot, self.row[i], self.sliced[i])
        for axis in ti.static(range(self.state.dimension)):
            force[axis] += self.slice_force[i // SLICE, axis][i % SLICE]
        return force


def _by_lane(values: NDArray[np.float64], rows: SpringRows) -> NDArray[np.float64]:
    """A constant of every spring, for every lane of every offset; 0 where there is no spring."""
    return np.where(rows.slice_spring >= 0, values[rows.slice_spring], 0.0)


def plain_springs(builder: ti.FieldsBuilder, springs: SpringSet, state: ParticleState, slices: bool = True) -> Springs:
    """Springs that only pull and push: in slices where most of them fit, which pays on a CPU alone.

    Without ``slices`` never, for schemes that move particles one after the other.
    """
    rows = arrange(springs.ends, state.count, SLICE)
    sliced = slices and len(springs) >= _LEAST_SPRINGS and rows.has_slices and runtime.settings().arch == "cpu"
    return (SlicedSprings if sliced else Springs)(builder, springs, state, rows)
