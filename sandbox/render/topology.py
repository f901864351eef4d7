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
    if point_count is not None:
        points, triangles = points % point_count, triangles % point_count
    return Surface(points.astype(np.int32), local, *build_rings(local, triangles, len(points)))


def build_rings(vertices: IntArray, names: IntArray, vertex_count: int) -> tuple[IntArray, IntArray, IntArray]:
    """`ring_start`, `ring` and `ring_triangle` of :class:`Surface` for triangles of vertices, shape (T, 3).

    The ring names the corners as `names` does, shape (T, 3).
    """
    others = np.stack([np.roll(names, -1, axis=1), np.roll(names, -2, axis=1)], axis=-1).reshape(-1, 2)
    owner = vertices.ravel()
    order = np.argsort(owner, kind="stable")
    ring_start = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=vertex_count))]).astype(np.int32)
    return ring_start, others[order].astype(np.int32), (order // 3).astype(np.int32)


def value_particles(points: IntArray, appearance: Appearance) -> IntArray:
    """Particle whose value a point shows, shape like `points`: itself, or the one that carries most of it."""
    result = points.copy()
    is_carried = points >= appearance.particle_count
    carried = points[is_carried] - appearance.particle_count
    heaviest = np.argmax(appearance.carried_weights[carried], axis=1) if len(carried) else np.zeros(0, dtype=int)
    result[is_carried] = appearance.carried_nodes[carried, heaviest]
    return result
