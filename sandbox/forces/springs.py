"""Springs between particles, gathered by each particle over its own half-edges.

Every spring is stored twice, once at each end, in compressed rows (CSR) sorted by neighbour. Both
ends compute the same force with opposite sign, so momentum is kept without atomics, and the order of
the sum never changes.

The inner loops are in a shape that LLVM turns into vector instructions: no branch, one reciprocal
square root, no division. ``max(r^2, tiny)`` makes a spring of length 0 pull with no force at all.
"""

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState, place

# Smallest squared length [m^2] that is told from 0; its reciprocal square root is finite in f32.
_TINY = 1e-24


@ti.data_oriented
class Springs:
    """Undamped springs: force k (r - L) u on the end whose neighbour lies in direction u."""

    term = "elastic"

    def __init__(self, builder: ti.FieldsBuilder, assembly: Assembly, state: ParticleState) -> None:
        self.state = state
        self.vector = runtime.vector(state.dimension)
        half_edges = 2 * assembly.spring_count
        self.row = place(builder, ti.field(ti.i32), state.count + 1)
        self.neighbour = place(builder, ti.field(ti.i32), half_edges)
        self.rest_length = place(builder, ti.field(runtime.real()), half_edges)
        self.stiffness = place(builder, ti.field(runtime.real()), half_edges)

    def load(self, assembly: Assembly) -> None:
        """Upload rows, neighbours and constants."""
        row, neighbour, spring = half_edges(assembly.springs, assembly.particle_count)
        self._write(row, neighbour, assembly.spring_rest_lengths[spring], assembly.spring_stiffness[spring])

    @ti.kernel
    def _write(
        self,
        row: ti.types.ndarray(),
        neighbour: ti.types.ndarray(),
        rest_length: ti.types.ndarray(),
        stiffness: ti.types.ndarray(),
    ):
        for i in range(row.shape[0]):
            self.row[i] = row[i]
        for h in range(neighbour.shape[0]):
            self.neighbour[h] = neighbour[h]
            self.rest_length[h] = rest_length[h]
            self.stiffness[h] = stiffness[h]

    @ti.func
    def force_on(self, i, slot):
        x = self.state.x[slot, i]
        force = self.vector(0.0)
        for h in range(self.row[i], self.row[i + 1]):
            d = self.state.x[slot, self.neighbour[h]] - x
            r2 = ti.max(d.dot(d), _TINY)
            inverse_r = ti.rsqrt(r2)
            force += (self.stiffness[h] * (r2 * inverse_r - self.rest_length[h])) * inverse_r * d
        return force

    @ti.func
    def energy_on(self, i, slot):
        """Half of the energy of every spring at particle i [J]; the other end has the other half."""
        x = self.state.x[slot, i]
        energy = 0.0
        for h in range(self.row[i], self.row[i + 1]):
            stretch = (self.state.x[slot, self.neighbour[h]] - x).norm() - self.rest_length[h]
            energy += 0.25 * self.stiffness[h] * stretch * stretch
        return energy

    @ti.func
    def strain_on(self, i, slot):
        """Largest |r - L| / L of the springs at particle i [1]. Springs of rest length 0 have none."""
        x = self.state.x[slot, i]
        strain = 0.0
        for h in range(self.row[i], self.row[i + 1]):
            rest = self.rest_length[h]
            stretch = ti.abs((self.state.x[slot, self.neighbour[h]] - x).norm() - rest)
            if rest > 0.0:
                strain = ti.max(strain, stretch / rest)
        return strain


@ti.data_oriented
class DampedSprings(Springs):
    """Springs with dampers: force [k (r - L) + c (v_b - v_a) u] u."""

    def __init__(self, builder: ti.FieldsBuilder, assembly: Assembly, state: ParticleState) -> None:
        super().__init__(builder, assembly, state)
        self.damping = place(builder, ti.field(runtime.real()), 2 * assembly.spring_count)

    def load(self, assembly: Assembly) -> None:
        super().load(assembly)
        _, _, spring = half_edges(assembly.springs, assembly.particle_count)
        self._write_damping(assembly.spring_damping[spring])

    @ti.kernel
    def _write_damping(self, damping: ti.types.ndarray()):
        for h in range(damping.shape[0]):
            self.damping[h] = damping[h]

    @ti.func
    def force_on(self, i, slot):
        x = self.state.x[slot, i]
        v = self.state.force_velocity[slot, i]
        force = self.vector(0.0)
        for h in range(self.row[i], self.row[i + 1]):
            j = self.neighbour[h]
            d = self.state.x[slot, j] - x
            r2 = ti.max(d.dot(d), _TINY)
            inverse_r = ti.rsqrt(r2)
            closing = (self.state.force_velocity[slot, j] - v).dot(d) * inverse_r
            tension = self.stiffness[h] * (r2 * inverse_r - self.rest_length[h]) + self.damping[h] * closing
            force += tension * inverse_r * d
        return force


def half_edges(springs: np.ndarray, particle_count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compressed rows of springs as seen from both ends.

    Returns row starts, shape (particle_count + 1,), and for every half-edge its neighbour and its
    spring, each of shape (2 * spring_count,), rows sorted by neighbour.
    """
    owner = np.concatenate([springs[:, 0], springs[:, 1]])
    neighbour = np.concatenate([springs[:, 1], springs[:, 0]])
    by_row = np.lexsort((neighbour, owner))
    row = np.zeros(particle_count + 1, dtype=np.int32)
    np.cumsum(np.bincount(owner, minlength=particle_count), out=row[1:])
    spring = np.concatenate([np.arange(len(springs))] * 2)[by_row]
    return row, neighbour[by_row].astype(np.int32), spring
