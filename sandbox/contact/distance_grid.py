"""Signed distances from a closed triangle mesh, on a grid, made once.

Distance: exact, to the nearest triangle of those that can be the nearest one in a block of nodes;
blocks of 16 and of 4 nodes a side thin out the candidates. Sign: by the winding number along a ray
through every column of nodes, with edges that neighbouring triangles see alike, so that no ray slips
through between two of them.
"""

from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.scene.winding import winding

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_BLOCKS = (16, 4)
_BIG = 1e30


@dataclass(frozen=True)
class DistanceGrid:
    """Distances at the nodes of a cubic grid."""

    low: FloatArray
    """Lowest node [m], shape (3,)."""
    cell: float
    """Distance between nodes [m]."""
    values: NDArray[np.floating]
    """Signed distances [m], negative inside, shape (nx, ny, nz)."""

    def at(self, points: FloatArray) -> FloatArray:
        """Interpolated distances at points [m] within the grid, shape (P, 3)."""
        place = (points - self.low) / self.cell
        base = np.clip(np.floor(place).astype(int), 0, np.array(self.values.shape) - 2)
        weight = place - base
        total = np.zeros(len(points))
        for corner in np.ndindex(2, 2, 2):
            share = np.where(np.array(corner) == 1, weight, 1.0 - weight).prod(axis=1)
            total += share * self.values[tuple((base + corner).T)]
        return total


def grid_frame(vertices: FloatArray, resolution: int, margin: float) -> tuple[FloatArray, float, tuple[int, int, int]]:
    """Lowest node [m], cell [m] and node counts of a grid around a mesh, ``margin`` [m] wider and a little more."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = float((high - low).max()) / resolution
    extra = 2 + int(np.ceil(margin / cell))
    nodes = np.ceil((high - low) / cell).astype(int) + 1 + 2 * extra
    # What rounding up adds goes to both sides alike: a symmetric mesh makes a symmetric grid.
    return 0.5 * (low + high) - 0.5 * cell * (nodes - 1), cell, (int(nodes[0]), int(nodes[1]), int(nodes[2]))


def bake(vertices: FloatArray, triangles: IntArray, resolution: int, margin: float) -> DistanceGrid:
    """The distance grid of a closed mesh with ``resolution`` cells along its longest side. Starts kernels."""
    low, cell, nodes = grid_frame(vertices, resolution, margin)
    inside = winding(vertices, triangles, low, cell, nodes) != 0
    distances = _distances(vertices, triangles, low, cell, nodes)
    return DistanceGrid(low, cell, np.where(inside, -distances, distances))


def lost_share(grid: DistanceGrid, vertices: FloatArray, triangles: IntArray) -> float:
    """Part of the mesh's area behind which the grid knows no inside [1]: walls thinner than a cell."""
    corners = vertices[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    inward = -across / np.maximum(area, np.finfo(float).tiny)[:, None]
    # Of a closed mesh, whichever way it faces, one side is the inside.
    volume = np.einsum("ij,ij->", corners[:, 0], across)
    inward = inward if volume > 0.0 else -inward
    deepest = np.full(len(triangles), _BIG)
    for depth in (0.25, 0.5, 0.75, 1.0):
        deepest = np.minimum(deepest, grid.at(corners.mean(axis=1) + depth * grid.cell * inward))
    return float(area[deepest >= 0.0].sum() / area.sum())


def _distances(
    vertices: FloatArray, triangles: IntArray, low: FloatArray, cell: float, nodes: tuple[int, int, int]
) -> NDArray[np.floating]:
    """Distance of every node from the nearest triangle [m], shape ``nodes``."""
    real = np.float64 if runtime.settings().precision == "f64" else np.float32
    # About the middle of the grid and in cells, so that single precision has all its digits to spare.
    middle = 0.5 * (np.array(nodes) - 1.0)
    corners = np.ascontiguousarray(((vertices - low) / cell - middle)[triangles], dtype=real)
    centres = np.ascontiguousarray(corners.mean(axis=1))
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1).astype(real)
    # Candidates of all blocks one after the other; the whole grid is one block whose candidates are all triangles.
    row, near, width = np.array([0, len(triangles)]), np.arange(len(triangles), dtype=np.int32), max(nodes)
    for finer in _BLOCKS:
        if finer < width:
            row, near = _thin_out(centres, radii, nodes, (row, near, width), finer)
            width = finer
    values = np.empty(nodes, dtype=real)
    _measure(corners, centres, radii, row, near, values, width)
    return values * cell


def _thin_out(
    centres: NDArray[np.floating],
    radii: NDArray[np.floating],
    nodes: tuple[int, int, int],
    coarse: tuple[NDArray[np.int_], IntArray, int],
    width: int,
) -> tuple[NDArray[np.int_], IntArray]:
    """Candidates of blocks of ``width`` nodes a side from those of coarser blocks: first ones and all."""
    row, near, coarse_width = coarse
    blocks = [-(-n // width) for n in nodes]
    count = np.zeros(blocks, dtype=np.int64)
    nothing = np.zeros(1, dtype=np.int32)
    shape = np.array(nodes, dtype=np.int32)
    _candidates(centres, radii, row, near, coarse_width, shape, width, count, nothing, 0)
    finer = np.concatenate([[0], np.cumsum(count.reshape(-1))])
    chosen = np.empty(max(1, finer[-1]), dtype=np.int32)
    place = np.ascontiguousarray(finer[:-1].reshape(blocks))
    _candidates(centres, radii, row, near, coarse_width, shape, width, place, chosen, 1)
    return finer, chosen


@ti.kernel
def _candidates(
    centres: ti.types.ndarray(),
    radii: ti.types.ndarray(),
    row: ti.types.ndarray(),
    near: ti.types.ndarray(),
    coarse: int,
    shape: ti.types.ndarray(),
    width: int,
    place: ti.types.ndarray(),
    chosen: ti.types.ndarray(),
    writes: int,
):
    """Counts (``writes`` 0) or lists, from ``place`` on, the triangles that can be nearest within each block."""
    for i, j, k in ti.ndrange(place.shape[0], place.shape[1], place.shape[2]):
        parent = _block(i * width, j * width, k * width, shape[1], shape[2], coarse)
        first, last = ti.cast(row[parent], ti.i32), ti.cast(row[parent + 1], ti.i32)
        half = 0.5 * (width - 1.0)
        reach = half * ti.sqrt(3.0)
        x = ti.Vector([i * width + half, j * width + half, k * width + half])
        for axis in ti.static(range(3)):
            x[axis] = x[axis] - 0.5 * (shape[axis] - 1.0)
        nearest = _BIG
        for c in range(first, last):
            nearest = ti.min(nearest, _apart(x, centres, near[c]))
        # A node of the block is at most `reach` from its middle; a little more for rounding.
        bound = (nearest + 2.0 * reach) * 1.0001 + 1e-3
        total = 0
        for c in range(first, last):
            t = near[c]
            if _apart(x, centres, t) - radii[t] <= bound:
                if writes == 1:
                    chosen[ti.cast(place[i, j, k], ti.i32) + total] = t
                total += 1
        if writes == 0:
            place[i, j, k] = total


@ti.kernel
def _measure(
    corners: ti.types.ndarray(),
    centres: ti.types.ndarray(),
    radii: ti.types.ndarray(),
    row: ti.types.ndarray(),
    near: ti.types.ndarray(),
    values: ti.types.ndarray(),
    width: int,
):
    """Distance of every node from the nearest of its block's candidates, in cells."""
    for i, j, k in ti.ndrange(values.shape[0], values.shape[1], values.shape[2]):
        block = _block(i, j, k, values.shape[1], values.shape[2], width)
        x = ti.Vector(
            [
                i - 0.5 * (values.shape[0] - 1.0),
                j - 0.5 * (values.shape[1] - 1.0),
                k - 0.5 * (values.shape[2] - 1.0),
            ]
        )
        best = _BIG
        for c in range(ti.cast(row[block], ti.i32), ti.cast(row[block + 1], ti.i32)):
            t = near[c]
            if _apart(x, centres, t) - radii[t] < best:
                best = ti.min(best, _from_triangle(x, corners, t))
        values[i, j, k] = best


@ti.func
def _block(i, j, k, ny, nz, width):
    """Number of the block of ``width`` nodes a side that a node is in."""
    return ((i // width) * ((ny + width - 1) // width) + j // width) * ((nz + width - 1) // width) + k // width


@ti.func
def _apart(x, centres: ti.template(), t):
    return (x - ti.Vector([centres[t, 0], centres[t, 1], centres[t, 2]])).norm()


@ti.func
def _from_triangle(x, corners: ti.template(), t):
    """Distance of a point from a triangle; one without area is its edges."""
    a = ti.Vector([corners[t, 0, 0], corners[t, 0, 1], corners[t, 0, 2]])
    b = ti.Vector([corners[t, 1, 0], corners[t, 1, 1], corners[t, 1, 2]])
    c = ti.Vector([corners[t, 2, 0], corners[t, 2, 1], corners[t, 2, 2]])
    normal = (b - a).cross(c - a)
    square = normal.dot(normal)
    within = (
        (b - a).cross(normal).dot(x - a) < 0.0
        and (c - b).cross(normal).dot(x - b) < 0.0
        and (a - c).cross(normal).dot(x - c) < 0.0
    )
    distance = 0.0
    if within and square > 0.0:
        distance = ti.abs((x - a).dot(normal)) * ti.rsqrt(square)
    else:
        distance = ti.sqrt(ti.min(_from_edge(x, a, b), ti.min(_from_edge(x, b, c), _from_edge(x, c, a))))
    return distance


@ti.func
def _from_edge(x, a, b):
    """Squared distance of a point from a line from a to b."""
    along = b - a
    t = ti.min(ti.max((x - a).dot(along) / ti.max(along.dot(along), 1e-20), 0.0), 1.0)
    apart = x - a - t * along
    return apart.dot(apart)
