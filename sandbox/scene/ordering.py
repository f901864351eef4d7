"""An order of particles in which neighbours in space are neighbours in memory."""

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray

# Half the particles of a core's second-level cache (512 KiB at 48 bytes a particle): below it every
# order is equally good, above it a spring whose ends are further apart than this misses the cache.
_CACHED_PARTICLES = 4_000


def locality_order(positions: FloatArray, particle_body: IntArray, springs: IntArray) -> NDArray[np.int64]:
    """Scene index of every internal particle, shape (particle_count,).

    The scene's own order where the springs already join near indices (lattices, ropes, small
    scenes), else bodies one after the other, each along a Z-order (Morton) curve. Source: Morton 1966.
    """
    count = len(positions)
    natural = np.arange(count)
    if count <= _CACHED_PARTICLES or len(springs) == 0:
        return natural
    if np.percentile(np.abs(springs[:, 1] - springs[:, 0]), 90) <= _CACHED_PARTICLES:
        return natural
    return np.lexsort((morton_codes(positions), particle_body))


def morton_codes(positions: FloatArray) -> NDArray[np.uint64]:
    """Z-order code of every point on a grid of 2^20 steps along the longest side, shape (N,)."""
    low = positions.min(axis=0)
    extent = float((positions.max(axis=0) - low).max()) or 1.0
    steps = np.minimum((positions - low) / extent * 2**20, 2**20 - 1).astype(np.uint64)
    dimension = positions.shape[1]
    codes = np.zeros(len(positions), dtype=np.uint64)
    for bit in range(20):
        for axis in range(dimension):
            codes |= ((steps[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(bit * dimension + axis)
    return codes
