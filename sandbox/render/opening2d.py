"""Outlines of flat bodies that open: edges come to light that were inside, and move into the gap between them."""

from typing import Any

import numpy as np
import taichi as ti

from sandbox.render.arrays import upload, zeros
from sandbox.render.opening import INNER, OUTER
from sandbox.render.paper2d import SCALE
from sandbox.render.raster2d import FARTHEST, point_at
from sandbox.render.types import Floats, Ints, Points2, vec2
from sandbox.scene import cells
from sandbox.scene.appearance import Appearance, FloatArray


@ti.kernel
def move_corners(
    positions: ti.template(),
    slot: ti.i32,
    first: ti.i32,
    corners: Ints,
    radius: Floats,
    start: Ints,
    around: Ints,
    ends: Ints,
    hidden: Ints,
    depth: Floats,
    view: Floats,
    kinds: Ints,
    outward: Points2,
    screen: Points2,
):
    """Move the particles of outlines into the gap, and outward by their `radius` [pixels].

    `hidden` tells of edges from `first` on; every edge has the body to its left. `kinds` tells which are inside.
    """
    for c in range(corners.shape[0]):
        n, reach, along, begins, comes = vec2(0.0, 0.0), 0.0, vec2(0.0, 0.0), 0, 0
        inner, outer = 0, 0
        for k in range(start[c], start[c + 1]):
            e = around[k]
            if hidden[first + e] == 0:
                step = point_at(positions, slot, ends[2 * e + 1]) - point_at(positions, slot, ends[2 * e])
                length = step.norm()
                along += step * (1.0 / ti.max(length, 1e-20))
                if ends[2 * e] == corners[c]:
                    begins += 1
                else:
                    comes += 1
                if depth[e] > 0.0:
                    n += vec2(step.y, -step.x) * (1.0 / ti.max(length, 1e-20))
                    inner += 1
                    reach += depth[e]
                else:
                    outer += 1
        # As in `cells.gap_points`.
        least = ti.cast(inner, ti.f32) * ti.static(1.0 / cells.FARTHEST[2])
        shift = n * (view[SCALE] * reach / ti.max(n.dot(n), least * least, 1e-30))
        screen[corners[c]] += vec2(shift.x, -shift.y)
        if begins == 1 and comes == 1:
            push = radius[c] * ti.min(2.0 / ti.max(along.norm(), 1e-6), FARTHEST)
            along *= push / ti.max(along.norm(), 1e-20)
            # Down in the picture is down in the world.
            screen[corners[c]] += vec2(along.y, along.x)
        outward[c] = vec2(n.x, -n.y).normalized(1e-15)
        kinds[c] = OUTER
        if outer == 0 and begins + comes > 0:
            kinds[c] = INNER


@ti.kernel
def smooth_corners(
    first: ti.i32,
    corners: Ints,
    start: Ints,
    around: Ints,
    ends: Ints,
    hidden: Ints,
    kinds: Ints,
    outward: Points2,
    screen: Points2,
    smooth: Points2,
):
    """Particles inside moved out or in, toward the middle of those before and after them."""
    for c in range(corners.shape[0]):
        own = corners[c]
        p, total, number = screen[own], vec2(0.0, 0.0), 0
        if kinds[c] == INNER:
            for k in range(start[c], start[c + 1]):
                e = around[k]
                if hidden[first + e] == 0:
                    total += screen[ends[2 * e] + ends[2 * e + 1] - own]
                    number += 1
        if number > 0:
            rise = (total * (1.0 / ti.cast(number, ti.f32)) - p).dot(outward[c])
            p += outward[c] * (rise * ti.static(cells.SMOOTHING[2]))
        smooth[c] = p


@ti.kernel
def write_corners(corners: Ints, smooth: Points2, screen: Points2):
    """Put corners where they are drawn."""
    for c in range(corners.shape[0]):
        screen[corners[c]] = smooth[c]


class FlatOpening:
    """Outlines of flat bodies that open."""

    def __init__(self, appearance: Appearance, first: int, radius: FloatArray) -> None:
        """`first` is the number of the first outline edge among what is hidden.

        `radius` [pixels] is how far outside of its particles every body is drawn, shape (body_count,).
        """
        assert appearance.cells is not None
        edges = appearance.outline
        self._first = first
        corners, inverse = np.unique(edges, return_inverse=True)
        row = inverse.reshape(-1)
        of_corner = np.zeros(len(corners))
        of_corner[row] = np.repeat(np.maximum(radius, 0.0)[appearance.outline_body], 2)
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(corners)))])
        around = np.argsort(row, kind="stable") // 2
        self._corners, self._radius = upload(corners, ti.i32), upload(of_corner, ti.f32)
        self._around = [upload(values, ti.i32) for values in (start, around, edges)]
        self._depth = upload(appearance.cells.outline.depth, ti.f32)
        self._kinds = zeros(ti.i32, len(corners))
        self._outward, self._smooth = (ti.ndarray(vec2, len(corners)) for _ in range(2))

    def move(self, positions: Any, slot: int, hidden: Any, view: Any, screen: Any) -> None:
        """Move the pixel coordinates in `screen` to where the particles of outlines are drawn."""
        move_corners(
            positions, slot, self._first, self._corners, self._radius, *self._around, hidden, self._depth, view,
            self._kinds, self._outward, screen,
        )  # fmt: skip
        smooth_corners(
            self._first, self._corners, *self._around, hidden, self._kinds, self._outward, screen, self._smooth
        )
        write_corners(self._corners, self._smooth, screen)
