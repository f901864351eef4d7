"""Index lists for the kernels: which points are on a surface, and the triangles around each. NumPy only."""

from dataclasses import dataclass

import numpy as np

from sandbox.scene.appearance import Appearance, IntArray


@dataclass(frozen=True)
class Surface:
    """Triangles over the points that they use: particles, and past them carried points."""

    points: IntArray
    """Point of every surface vertex, shape (vertex_count,); a sheet drawn with both sides has two at each."""
    triangles: IntArray
    """Vertices of every triangle, shape (triangle_count, 3)."""
    ring_start: IntArray
    """Where the ring of every vertex begins in `ring`, shape (vertex_count + 1,)."""
    ring: IntArray
    """For every triangle around a vertex its two other points, in turning order, shape (3 triangle_count, 2)."""
    ring_triangle: IntArray
    """The triangles of the rings, shape (3 triangle_count,)."""


def build_surface(triangles: IntArray, point_count: int | None = None) -> Surface:
    """Compact the vertices of `triangles` (point indices, shape (triangle_count, 3)) and list their rings.

    Indices past `point_count`, where it is given, name the same points again, for vertices of their own.
    """
    triangles = np.asarray(triangles, dtype=np.int32).reshape(-1, 3)
    points, inverse = np.unique(triangles, return_inverse=True)
    local = inverse.reshape(-1, 3).astype(np.int32)
    owner = local.ravel()
    if point_count is not None:
        points, triangles = points % point_count, triangles % point_count
    others = np.stack([np.roll(triangles, -1, axis=1), np.roll(triangles, -2, axis=1)], axis=-1).reshape(-1, 2)
    order = np.argsort(owner, kind="stable")
    counts = np.bincount(owner, minlength=len(points))
    ring_start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return Surface(
        points.astype(np.int32), local, ring_start, others[order].astype(np.int32), (order // 3).astype(np.int32)
    )


def value_particles(points: IntArray, appearance: Appearance) -> IntArray:
    """Particle whose value a point shows, shape like `points`: itself, or the one that carries most of it."""
    result = points.copy()
    is_carried = points >= appearance.particle_count
    carried = points[is_carried] - appearance.particle_count
    heaviest = np.argmax(appearance.carried_weights[carried], axis=1) if len(carried) else np.zeros(0, dtype=int)
    result[is_carried] = appearance.carried_nodes[carried, heaviest]
    return result
