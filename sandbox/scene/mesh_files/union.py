"""What parts of a mesh that overlap hold together."""

import numpy as np

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.mesh_files.facing import signed_volume
from sandbox.scene.winding import crossings

_COARSE, _FINE = 64, 160
"""Rays along each side of the box in which overlaps are looked for, and then of the one that they are in."""
_TURNS = (0.7297, 0.4142, 1.1180)
"""By what angles about z, x and z meshes are turned before rays are sent: faces like to lie along the axes [rad]."""


def union_volume(vertices: FloatArray, triangles: IntArray) -> float:
    """Volume of everything that a closed mesh which faces outward winds around at least once [m^3].

    Exact but for overlaps: what counts twice of these is measured along some 20,000 rays, to about 1e-6 of it.
    """
    total = signed_volume(vertices, triangles)
    turned = (vertices - vertices.mean(axis=0)) @ _turn()
    low, high = turned.min(axis=0)[:2], turned.max(axis=0)[:2]
    size = float((high - low).max())
    for rays in (_COARSE, _FINE):
        cell = float((high - low).max()) / rays
        columns = np.maximum(np.ceil((high - low) / cell).astype(int), 1)
        spare = _spare_lengths(turned, triangles, low, cell, (int(columns[0]), int(columns[1])))
        where = np.argwhere(np.abs(spare) > 1e-9 * size)
        if len(where) == 0:
            return total
        excess = float(spare.sum()) * cell**2
        low, high = low + (where.min(axis=0) - 1) * cell, low + (where.max(axis=0) + 2) * cell
    return total - excess


def _turn() -> FloatArray:
    def about(axis: int, angle: float) -> FloatArray:
        matrix, (one, other) = np.eye(3), [k for k in range(3) if k != axis]
        matrix[[one, other], [one, other]] = np.cos(angle)
        matrix[one, other], matrix[other, one] = -np.sin(angle), np.sin(angle)
        return matrix

    z, x, again = _TURNS
    return about(2, z) @ about(0, x) @ about(2, again)


def _spare_lengths(
    vertices: FloatArray, triangles: IntArray, low: FloatArray, cell: float, columns: tuple[int, int]
) -> FloatArray:
    """Of every ray along z, through the middle of a column, the length that counts more than once [m], (columns)."""
    column, height, step = crossings(vertices, triangles, np.append(low + 0.5 * cell, 0.0), cell, columns)
    ray = column[:, 0] * columns[1] + column[:, 1]
    order = np.lexsort([height, ray])
    ray, height = ray[order], height[order] * cell
    # A ray ends as often as it begins, so that the sum starts every ray at none.
    times = np.cumsum(step[order])[:-1]
    length = np.where(ray[1:] == ray[:-1], np.diff(height), 0.0)
    spare = np.bincount(ray[:-1], (times - (times > 0)) * length, minlength=columns[0] * columns[1])
    return np.asarray(spare.reshape(columns))
