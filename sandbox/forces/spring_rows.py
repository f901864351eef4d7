"""Springs arranged for gathering: rows of half-edges, and slices of particles with common offsets. NumPy only.

In a lattice, neighbouring particles have their neighbours at the same index offsets. For a *slice* of
consecutive particles and one such offset, all lanes read consecutive memory, which the compiler turns
into vector instructions; only what does not fit this pattern is gathered one by one. The layout is
the sliced diagonal format of sparse matrices (Monakov, Lokhmotov, Avetisyan 2010, with offsets).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int32]

END = 2**30
"""Offset that closes the list of a slice."""
# A slice takes an offset if at least this many of its particles have a spring there; with fewer,
# gathering them singly is cheaper.
_LEAST_LANES = 4


@dataclass(frozen=True)
class SpringRows:
    """Half-edges of S springs in compressed rows: of each particle first those gathered singly, then the sliced."""

    row: IntArray
    """Start of every particle's half-edges, shape (particle_count + 1,)."""
    sliced: IntArray
    """Start of those that slices take, shape (particle_count,)."""
    neighbour: IntArray
    """Other end of every half-edge, shape (2 S,)."""
    spring: NDArray[np.int64]
    """Spring of every half-edge, shape (2 S,)."""
    slice_row: IntArray
    """Start of every slice's offsets, shape (slice_count,)."""
    offset: IntArray
    """Index offset of the neighbours, each slice's list closed by END, shape (entry_count,)."""
    slice_spring: NDArray[np.int64]
    """Spring of every lane of every offset, -1 where there is none, shape (entry_count, lanes)."""

    @property
    def has_slices(self) -> bool:
        """True where slices take at least half of all half-edges: else they are not worth a pass."""
        return 2 * int((self.slice_spring >= 0).sum()) >= len(self.neighbour) > 0


def arrange(springs: IntArray, particle_count: int, lanes: int) -> SpringRows:
    """Arrange springs, shape (S, 2). Both ends get a half-edge; rows are sorted by neighbour."""
    owner = np.concatenate([springs[:, 0], springs[:, 1]]).astype(np.int64)
    neighbour = np.concatenate([springs[:, 1], springs[:, 0]]).astype(np.int64)
    spring = np.concatenate([np.arange(len(springs))] * 2)
    group = owner // lanes
    offset = neighbour - owner
    # One entry a (slice, offset): where every lane's neighbour exists, and enough lanes have a spring.
    key = group * (4 * particle_count) + offset + 2 * particle_count
    entries, entry_of, lanes_used = np.unique(key, return_inverse=True, return_counts=True)
    first = entries // (4 * particle_count) * lanes
    entry_offset = entries % (4 * particle_count) - 2 * particle_count
    inside = (first + entry_offset >= 0) & (first + entry_offset + lanes <= particle_count)
    # Two springs between the same ends would fall into one lane.
    repeated = np.zeros(len(entries), dtype=bool)
    pair = owner * particle_count + neighbour
    _, pair_of, pair_counts = np.unique(pair, return_inverse=True, return_counts=True)
    repeated[entry_of[pair_counts[pair_of] > 1]] = True
    chosen = inside & (lanes_used >= min(_LEAST_LANES, lanes)) & ~repeated & (first + lanes <= particle_count)
    taken = chosen[entry_of]

    by_row = np.lexsort((neighbour, taken, owner))
    counts = np.bincount(owner, minlength=particle_count)
    row = np.concatenate([[0], np.cumsum(counts)])
    sliced = row[:-1] + np.bincount(owner[~taken], minlength=particle_count)
    slice_row, offsets, slice_spring = _slices(
        entries[chosen] // (4 * particle_count), entry_offset[chosen], -(-particle_count // lanes), lanes
    )
    # Every chosen entry moves up by one closing END for each slice before it.
    place = np.cumsum(chosen)[entry_of[taken]] - 1 + group[taken]
    slice_spring[place, owner[taken] % lanes] = spring[taken]
    return SpringRows(
        row=row.astype(np.int32),
        sliced=sliced.astype(np.int32),
        neighbour=neighbour[by_row].astype(np.int32),
        spring=spring[by_row],
        slice_row=slice_row,
        offset=offsets,
        slice_spring=slice_spring,
    )


def _slices(
    group: NDArray[np.int64], offset: NDArray[np.int64], slice_count: int, lanes: int
) -> tuple[IntArray, IntArray, NDArray[np.int64]]:
    counts = np.bincount(group, minlength=slice_count)
    slice_row = np.concatenate([[0], np.cumsum(counts + 1)])
    offsets = np.full(slice_row[-1], END, dtype=np.int32)
    offsets[np.arange(len(group)) + group] = offset
    springs = np.full((slice_row[-1], lanes), -1, dtype=np.int64)
    return slice_row[:-1].astype(np.int32), offsets, springs
