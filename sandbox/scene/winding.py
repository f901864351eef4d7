"""How often a triangle mesh winds around the nodes of a grid. NumPy only.

Along a ray through every column of nodes, with edges that neighbouring triangles see alike, so that no
ray slips through between two of them.
"""

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray

_ASIDE = (1e-6 * np.sqrt(2.0), 1e-6 * np.sqrt(3.0))
"""By how much of a cell rays pass beside the nodes: meshes like to have vertices right there."""


def winding(
    vertices: FloatArray, triangles: IntArray, low: FloatArray, cell: float, nodes: tuple[int, int, int]
) -> NDArray[np.int32]:
    """How often the mesh winds around every node, shape ``nodes``: crossings of the ray from below along z."""
    column, crossing, step = crossings(vertices, triangles, low, cell, nodes[:2])
    above = np.clip(np.ceil(crossing).astype(int), 0, nodes[2])
    steps = np.zeros((nodes[0], nodes[1], nodes[2] + 1), dtype=np.int32)
    # Leaving upward faces lose one, entering gain one; parts that overlap count twice and stay inside.
    np.add.at(steps, (column[:, 0], column[:, 1], above), step)
    return np.cumsum(steps, axis=2, dtype=np.int32)[:, :, : nodes[2]]


def crossings(
    vertices: FloatArray, triangles: IntArray, low: FloatArray, cell: float, columns: tuple[int, int]
) -> tuple[NDArray[np.int_], FloatArray, NDArray[np.int32]]:
    """Where upward rays, through every column of nodes, go through a mesh.

    Column of every crossing, shape (C, 2), its height above ``low`` in cells, (C,), and 1 where the ray enters what
    the mesh encloses, -1 where it leaves, (C,).
    """
    xy = (vertices[:, :2] - low[:2]) / cell - np.array(_ASIDE)
    height = (vertices[:, 2] - low[2]) / cell
    corners = xy[triangles]
    first = np.maximum(np.ceil(corners.min(axis=1)).astype(int), 0)
    last = np.minimum(np.floor(corners.max(axis=1)).astype(int), np.array(columns) - 1)
    span = np.maximum(last - first + 1, 0)
    count = span.prod(axis=1)
    row = np.repeat(np.arange(len(triangles)), count)
    within = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    column = first[row] + np.stack([within // span[row, 1], within % span[row, 1]], axis=1)
    sides = np.stack([side(xy, triangles[row, k], triangles[row, (k + 1) % 3], column) for k in range(3)], axis=1)
    # Exactly on an edge counts as left of it, seen along the edge from its first vertex, from both triangles.
    met = (sides > 0.0).all(axis=1) | (sides < 0.0).all(axis=1)
    row, column, sides = row[met], column[met], sides[met]
    weights = sides[:, [1, 2, 0]] / sides.sum(axis=1, keepdims=True)
    crossing = (weights * height[triangles[row]]).sum(axis=1)
    return column, crossing, np.where(sides[:, 0] > 0.0, -1, 1).astype(np.int32)


def side(xy: FloatArray, start: IntArray, end: IntArray, point: NDArray[np.int_] | FloatArray) -> FloatArray:
    """Twice the area of edge and point, positive on the left; the same number, but for its sign, in reverse."""
    forward = start < end
    a, b = xy[np.where(forward, start, end)], xy[np.where(forward, end, start)]
    area = (b[:, 0] - a[:, 0]) * (point[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (point[:, 0] - a[:, 0])
    area = np.where(area == 0.0, np.finfo(float).tiny, area)
    return np.where(forward, area, -area)
