"""Kernels that copy a simulation's fields into memory that the drawing process sees."""

import taichi as ti

from sandbox.render.types import Floats, Rows


@ti.kernel
def copy_positions(positions: ti.template(), slot: ti.i32, rows: Rows):
    """Positions of the particles [m], one a row; the field may have more than there are rows."""
    for i in range(rows.shape[0]):
        for axis in ti.static(range(positions.n)):
            rows[i, axis] = ti.cast(positions[slot, i][axis], ti.f32)


@ti.kernel
def copy_values(values: ti.template(), scale: ti.f32, result: Floats):
    """Values of the particles in units of the colour scale's top."""
    for i in range(result.shape[0]):
        result[i] = ti.cast(values[i], ti.f32) * scale
