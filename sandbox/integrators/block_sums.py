"""Sums over all particles that no number of threads changes: in fixed blocks, then block by block."""

import taichi as ti

from sandbox.state import SLICE, place

BLOCK = 16 * SLICE
"""Consecutive particles that are summed one after the other."""


@ti.data_oriented
class BlockSums:
    """Several sums at once, in double precision; a block belongs to one thread."""

    def __init__(self, builder: ti.FieldsBuilder, particle_count: int, columns: int) -> None:
        self.count = particle_count
        self.blocks = -(-particle_count // BLOCK)
        self.fine = ti.f64
        self.table = place(builder, ti.field(self.fine), self.blocks, columns)

    @ti.func
    def first(self, block):
        """First particle of a block."""
        return block * BLOCK

    @ti.func
    def end(self, block):
        """One after the last particle of a block."""
        return ti.min((block + 1) * BLOCK, self.count)

    @ti.func
    def zero(self):
        """What a sum starts with."""
        return ti.cast(0.0, self.fine)

    @ti.func
    def one(self):
        """1, of the sums' type."""
        return ti.cast(1.0, self.fine)

    @ti.func
    def put(self, block, column, value):
        """Note the sum of a block."""
        self.table[block, column] = value

    @ti.func
    def total(self, column):
        """Sum of all blocks; to be called within a serial loop."""
        value = self.zero()
        for block in range(self.blocks):
            value += self.table[block, column]
        return value

    @ti.func
    def least(self, column):
        """The least of all blocks; to be called within a serial loop."""
        value = self.table[0, column]
        for block in range(self.blocks):
            value = ti.min(value, self.table[block, column])
        return value
