"""Edges of triangles, as pairs and as numbers. NumPy only."""

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import IntArray


def directed_edges(triangles: IntArray) -> IntArray:
    """Edges 0-1, 1-2, 2-0 of one triangle after the other, shape (3 T, 2)."""
    return triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def pair_keys(pairs: NDArray[np.int32] | NDArray[np.int64]) -> NDArray[np.int64]:
    """One number for each pair, the same for both directions: lower index in the upper 32 bits, shape (E,)."""
    return np.asarray((pairs.min(axis=1).astype(np.int64) << 32) | pairs.max(axis=1), dtype=np.int64)
