"""A uniform grid in a hash table: who is near whom, in linear time and in a fixed order. No physics.

A cell's bucket is a weighted sum of its coordinates, modulo the table's size, with weight 1 for the last
one: cells on top of each other are one run of particles, and a particle's surroundings are 3 runs in
2D, 9 in 3D. Where the box around all particles has no more cells than the table buckets, the weights
number the box's cells, so that no two share a bucket; elsewhere they are large odd numbers. Particles
are sorted into buckets by counting (Green, "Particle simulation using CUDA", 2010), by id within a
bucket, so that nothing depends on the number of threads.
"""

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.state import place

LANES = 4
"""Positions are stored in groups of so many places, for readers that look at a group at once."""
_LOAD = 4
"""Least buckets a particle."""
_FEWEST = 64
_BLOCK = 1024
"""Buckets, or particles, that are summed up at a time."""
_TASK = 8
"""Blocks that a thread takes at a time; Taichi by itself would give all of a few hundred to one thread."""
_FINENESS = 3
"""Cells along the last axis that make up the reach: finer cells make runs fit closer, and more of them."""
_RUN = 2 * _FINENESS + 1
_FARTHEST = 1e9
"""Cells from the origin beyond which (and at no number) a particle is in no bucket."""
_MAGNITUDE_32, _MAGNITUDE_64 = 0x7FFFFFFF, 0x7FFFFFFFFFFFFFFF
"""All bits of a number but its sign; they order like its magnitude, and NaN above all."""
_ROOM = 1.001
"""Cells are this much larger than their reach, for the rounding of coordinates divided by them."""
_WEIGHTS = (0x2545F491, 0x1B873593)
"""Odd, with bits all over, so that columns of a box too large begin anywhere in the table."""
_END = 2**30
"""Beyond all cells."""


@ti.data_oriented
class SpatialHash:
    """Particles sorted into hashed cells.

    A run may hold particles that are elsewhere, where their columns share buckets, and a particle may
    meet the same neighbour in two runs: the reader measures the distance, and drops doubles.

    Parameters
    ----------
    count : number of particles
    dimension : 2 or 3
    reach : distance [m] within which a particle's surroundings are complete

    Attributes
    ----------
    begin : first place of every bucket, shape (size + 7,); the first buckets come again at the end
    member : ids by place, those of a bucket ascending, shape (2 count,)
    x : positions [m] by group of places and place in it, one field an axis, shape (2 count / LANES + 3,)
    """

    def __init__(self, builder: ti.FieldsBuilder, count: int, dimension: int, reach: float) -> None:
        self.count = count
        self.dimension = dimension
        self.cell = _ROOM * reach
        """Edge of a cell [m], but for the last axis, where it is a fraction of that."""
        self.double = runtime.settings().precision == "f64"
        farthest = np.array(_FARTHEST * self.cell / _FINENESS, dtype=np.float64 if self.double else np.float32)
        self.farthest = int(farthest.view(np.int64 if self.double else np.int32))
        self.size = 1 << int(np.ceil(np.log2(max(_FEWEST, _LOAD * count))))
        """Number of buckets."""
        self.columns = 3 ** (dimension - 1)
        """Runs that surround a particle."""
        self.blocks = -(-self.size // _BLOCK)
        self.block = min(self.size, _BLOCK)
        self.spans = -(-count // _BLOCK)
        self.cells = ti.types.vector(dimension, ti.i32)
        self.per_cell = ti.types.vector(dimension, runtime.real())(
            [1.0 / self.cell] * (dimension - 1) + [_FINENESS / self.cell]
        )
        self.corner = place(builder, self.cells.field(), 1)
        self.weight = place(builder, self.cells.field(), 1)
        self.low = place(builder, self.cells.field(), self.spans)
        self.high = place(builder, self.cells.field(), self.spans)
        self.bucket = place(builder, ti.field(ti.i32), count)
        self.rank = place(builder, ti.field(ti.i32), count)
        self.filled = place(builder, ti.field(ti.i32), self.size)
        self.block_sum = place(builder, ti.field(ti.i32), self.blocks + 1)
        self.begin = place(builder, ti.field(ti.i32), self.size + _RUN)
        self.member = place(builder, ti.field(ti.i32), 2 * count)
        lanes = ti.types.vector(LANES, runtime.real())
        self.x = [place(builder, lanes.field(), 2 * count // LANES + 3) for _ in range(dimension)]

    @ti.func
    def cell_of(self, x):
        """Cell that holds position x."""
        return ti.floor(x * self.per_cell, ti.i32)

    @ti.func
    def bucket_of(self, cell):
        """Bucket of a cell."""
        return (cell - self.corner[0]).dot(self.weight[0]) & (self.size - 1)

    @ti.func
    def surroundings(self, x):
        """Where the runs around position x start counting, and by what from column to column: for :meth:`run`."""
        cell = self.cell_of(x)
        lowest = cell - 1
        lowest[self.dimension - 1] = cell[self.dimension - 1] - _FINENESS
        weight = self.weight[0]
        return (lowest - self.corner[0]).dot(weight), weight

    @ti.func
    def run(self, lowest, weight, column):
        """First and end place of a column of the surroundings; columns count from 0."""
        bucket = lowest + column * weight[0]
        if ti.static(self.dimension == 3):
            bucket = lowest + column // 3 * weight[0] + column % 3 * weight[1]
        bucket = bucket & (self.size - 1)
        return self.begin[bucket], self.begin[bucket + _RUN]

    @ti.func
    def held(self):
        """Number of particles in the table."""
        return self.begin[self.size]

    @ti.func
    def build(self, x: ti.template(), slot, radius: ti.template(), all_sized: ti.template()):
        """Sort the particles at ``x[slot, i]`` anew; those of radius 0 stay out.

        Its loops run in parallel where the calling kernel calls it outermost, and in turn elsewhere.
        """
        self.number_cells(x, slot)
        for i in range(self.count):
            bucket = -1
            here = self.in_range(x[slot, i])
            if ti.static(not all_sized):
                here = here and radius[i] > 0.0
            if here:
                bucket = self.bucket_of(self.cell_of(x[slot, i]))
                self.rank[i] = ti.atomic_add(self.filled[bucket], 1)
            self.bucket[i] = bucket
        self.add_up()
        for i in range(self.count):
            if self.bucket[i] >= 0:
                self.member[self.begin[self.bucket[i]] + self.rank[i]] = i
        ti.loop_config(block_dim=_TASK)
        for block in range(self.blocks):
            for bucket in range(block * self.block, (block + 1) * self.block):
                self.settle(bucket, x, slot)

    @ti.func
    def in_range(self, x):
        """Whether cells can be counted up to x. By bits, as the compiler takes comparisons of NaN for what it likes."""
        here = True
        for axis in ti.static(range(self.dimension)):
            if ti.static(self.double):
                here = here and (ti.bit_cast(x[axis], ti.i64) & ti.i64(_MAGNITUDE_64)) < ti.i64(self.farthest)
            else:
                here = here and (ti.bit_cast(x[axis], ti.i32) & _MAGNITUDE_32) < self.farthest
        return here

    @ti.func
    def number_cells(self, x: ti.template(), slot):
        """Weights that number the cells of the box around all particles, or mix those of a box too large."""
        ti.loop_config(block_dim=_TASK)
        for span in range(self.spans):
            low, high = self.cells(_END), self.cells(-_END)
            for i in range(span * _BLOCK, ti.min((span + 1) * _BLOCK, self.count)):
                if self.in_range(x[slot, i]):
                    cell = self.cell_of(x[slot, i])
                    low = ti.min(low, cell)
                    high = ti.max(high, cell)
            self.low[span] = low
            self.high[span] = high
        ti.loop_config(serialize=True)
        for _ in range(1):
            low, high = self.cells(_END), self.cells(-_END)
            for span in range(self.spans):
                low = ti.min(low, self.low[span])
                high = ti.max(high, self.high[span])
            self.corner[0] = low
            weight = self.cells(1)
            cells = 1.0
            for back in ti.static(range(self.dimension - 1)):
                axis = self.dimension - 2 - back
                cells *= ti.cast(high[axis + 1], float) - ti.cast(low[axis + 1], float) + 1.0
                weight[axis] = weight[axis + 1] * (high[axis + 1] - low[axis + 1] + 1)
            cells *= ti.cast(high[0], float) - ti.cast(low[0], float) + 1.0
            if cells > self.size:
                for axis in ti.static(range(self.dimension - 1)):
                    weight[axis] = _WEIGHTS[axis]
            self.weight[0] = weight

    @ti.func
    def add_up(self):
        """Where every bucket begins, from how many it holds; leaves the counters at 0 for the next time."""
        ti.loop_config(block_dim=_TASK)
        for block in range(self.blocks):
            total = 0
            for bucket in range(block * self.block, (block + 1) * self.block):
                total += self.filled[bucket]
            self.block_sum[block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = 0
            for block in range(self.blocks):
                held = self.block_sum[block]
                self.block_sum[block] = total
                total += held
            self.block_sum[self.blocks] = total
        ti.loop_config(block_dim=_TASK)
        for block in range(self.blocks):
            total = self.block_sum[block]
            for bucket in range(block * self.block, (block + 1) * self.block):
                self.begin[bucket] = total
                total += self.filled[bucket]
                self.filled[bucket] = 0
        ti.loop_config(serialize=True)
        for extra in range(_RUN):
            self.begin[self.size + extra] = self.block_sum[self.blocks] + self.begin[extra]

    @ti.func
    def settle(self, bucket, x: ti.template(), slot):
        """Sort a bucket by id and copy positions; the first ones also to the end, so that no run wraps around."""
        first, end = self.begin[bucket], self.begin[bucket + 1]
        for taken in range(first + 1, end):
            i = self.member[taken]
            below = taken - 1
            while below >= first and self.member[below] > i:
                self.member[below + 1] = self.member[below]
                below -= 1
            self.member[below + 1] = i
        for own in range(first, end):
            self.copy(own, own, x, slot)
            if bucket < _RUN - 1:
                self.copy(own, own + self.begin[self.size], x, slot)

    @ti.func
    def copy(self, own, to, x: ti.template(), slot):
        """Repeat the particle at its own place at the place ``to``, with its position."""
        i = self.member[own]
        self.member[to] = i
        for axis in ti.static(range(self.dimension)):
            self.x[axis][to // LANES][to % LANES] = x[slot, i][axis]
