"""Index lists for the kernels: which particles are on a surface, and the triangles around each. NumPy only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class Surface:
    """Triangles over the particles that they use."""

    particles: IntArray
    """Particle of every surface vertex, shape (vertex_count,)."""
    triangles: IntArray
    """Vertices of every triangle, shape (triangle_count, 3)."""
    ring_start: IntArray
    """Where the ring of every vertex begins in `ring`, shape (vertex_count + 1,)."""
    ring: IntArray
    """For every triangle around a vertex its two other particles, in turning order, shape (3 triangle_count, 2)."""


def build_surface(triangles: IntArray) -> Surface:
    """Compact the vertices of `triangles` (particle indices, shape (triangle_count, 3)) and list their rings."""
    triangles = np.asarray(triangles, dtype=np.int32).reshape(-1, 3)
    particles, inverse = np.unique(triangles, return_inverse=True)
    local = inverse.reshape(-1, 3).astype(np.int32)
    owner = local.ravel()
    others = np.stack([np.roll(triangles, -1, axis=1), np.roll(triangles, -2, axis=1)], axis=-1).reshape(-1, 2)
    order = np.argsort(owner, kind="stable")
    counts = np.bincount(owner, minlength=len(particles))
    ring_start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return Surface(particles.astype(np.int32), local, ring_start, others[order].astype(np.int32))
