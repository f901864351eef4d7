"""Particle state in Taichi fields: positions and velocities in slots, masses; save and restore.

A *slot* is one whole copy of positions and velocities. A step reads one slot and writes another,
so that every particle gathers from the same instant; one more slot keeps the last good state, and
schemes of several stages have more of them.
"""

import math

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.scene.assemble import Assembly

FloatArray = NDArray[np.float64]

SLICE = 8
"""Consecutive particles that some laws handle together."""
BACKUP_SLOT = 2
_SERIAL_COUNT = 4096
FIRST_STAGE_SLOT = 3
"""Slot of the first further state that a scheme goes through within a step."""


def place(builder: ti.FieldsBuilder, field: ti.Field, *shape: int) -> ti.Field:
    """Put ``field`` into the simulation's tree with the given shape (no axis shorter than 1).

    Where Taichi packs fields without gaps, one of an odd number of 32-bit words gets a word more. Otherwise fields of
    64 bits could begin in the middle of 8 bytes, and would be read and written one word too early: over a neighbour.
    """
    axes = [ti.i, ti.ij, ti.ijk][len(shape) - 1]
    sizes = [max(1, n) for n in shape]
    if runtime.packs_fields() and len(field.vars) * math.prod(sizes) % 2 == 1:
        # A cell of the field and the gap, so that the field's own shape is what was asked for.
        padded = builder.dense(axes, [1] * len(shape))
        padded.dense(axes, sizes).place(field)
        if field.dtype not in (ti.f64, ti.i64, ti.u64):
            padded.dense(ti.i, 1).place(ti.field(ti.i32))
    else:
        builder.dense(axes, sizes).place(field)
    runtime.own(field)
    return field


@ti.data_oriented
class ParticleState:
    """Fields of all particles, in the assembly's order.

    Attributes
    ----------
    x : positions [m], vectors, shape (3 + stages, particle_count): two slots, a backup, and ``stages`` more
    v : velocities [m/s], vectors, of the same shape
    force_velocity : velocities that forces see [m/s]: ``v`` itself, or a scheme's prediction of it
    mass, inverse_mass : [kg], [1/kg] (0 where pinned), shape (particle_count,)
    """

    def __init__(self, builder: ti.FieldsBuilder, assembly: Assembly, predicts_velocity: bool, stages: int = 0) -> None:
        self.count = assembly.particle_count
        self.dimension = assembly.dimension
        vector = runtime.vector(self.dimension)
        real = runtime.real()
        self.capacity = -(-self.count // SLICE) * SLICE
        """Rows of the fields: ``count`` rounded up to whole slices; the rest stays zero."""
        slots = FIRST_STAGE_SLOT + stages
        self.x = place(builder, vector.field(), slots, self.capacity)
        self.v = place(builder, vector.field(), slots, self.capacity)
        self.predicts_velocity = predicts_velocity
        self.force_velocity = place(builder, vector.field(), slots, self.capacity) if predicts_velocity else self.v
        self.mass = place(builder, ti.field(real), self.count)
        self.inverse_mass = place(builder, ti.field(real), self.count)
        self.serialize = runtime.settings().arch == "cpu" and self.count <= _SERIAL_COUNT
        """True where starting threads takes longer than a pass over all particles."""
        self.slot = 0
        """Slot that holds the state now."""

    def load(self, assembly: Assembly) -> None:
        """Upload masses and the initial state."""
        self._write_masses(assembly.masses, assembly.inverse_masses)
        self.write(assembly.positions, assembly.velocities)

    def write(self, positions: FloatArray, velocities: FloatArray, force_velocities: FloatArray | None = None) -> None:
        """Set the state [m], [m/s], each of shape (particle_count, dimension), internal order.

        ``force_velocities`` are a scheme's predictions; without them it starts from the velocities.
        """
        self.slot = 0
        seen = velocities if force_velocities is None else force_velocities
        self._write(*(np.ascontiguousarray(values) for values in (positions, velocities, seen)))

    def read(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions [m], velocities and those that forces see [m/s], each (particle_count, dimension), f64.

        In internal order. Written back they continue the trajectory bit for bit.
        """
        # One array: each costs a launch some 50 microseconds.
        parts = np.empty((3, self.count, self.dimension))
        self._read(self.slot, parts)
        return parts[0], parts[1], parts[2]

    def keep(self) -> None:
        """Copy the state into the backup slot."""
        self._copy(self.slot, BACKUP_SLOT)

    def restore(self) -> None:
        """Copy the backup slot back."""
        self.slot = 0
        self._copy(BACKUP_SLOT, self.slot)

    @ti.kernel
    def _write_masses(self, mass: ti.types.ndarray(), inverse: ti.types.ndarray()):
        for i in range(self.count):
            self.mass[i] = mass[i]
            self.inverse_mass[i] = inverse[i]

    @ti.kernel
    def _write(self, positions: ti.types.ndarray(), velocities: ti.types.ndarray(), seen: ti.types.ndarray()):
        for i in range(self.count):
            for axis in ti.static(range(self.dimension)):
                self.x[0, i][axis] = positions[i, axis]
                self.v[0, i][axis] = velocities[i, axis]
                if ti.static(self.predicts_velocity):
                    self.force_velocity[0, i][axis] = seen[i, axis]

    @ti.kernel
    def _read(self, slot: int, parts: ti.types.ndarray()):
        ti.loop_config(serialize=self.serialize)
        for i in range(self.count):
            for axis in ti.static(range(self.dimension)):
                parts[0, i, axis] = self.x[slot, i][axis]
                parts[1, i, axis] = self.v[slot, i][axis]
                parts[2, i, axis] = self.force_velocity[slot, i][axis]

    @ti.kernel
    def _copy(self, source: int, target: int):
        ti.loop_config(serialize=self.serialize)
        for i in range(self.count):
            self.x[target, i] = self.x[source, i]
            self.v[target, i] = self.v[source, i]
            if ti.static(self.predicts_velocity):
                self.force_velocity[target, i] = self.force_velocity[source, i]
