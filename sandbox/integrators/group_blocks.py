"""Particles of several groups in short runs, for sums that no number of threads changes. NumPy only."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int32]

_BLOCK = 64
"""Particles that are added up one after the other."""


@dataclass(frozen=True)
class GroupBlocks:
    """Particles of G groups in B blocks, each of one group."""

    member: IntArray
    """Particles of group 0, then those of group 1, ..."""
    first: IntArray
    """First member of every block, and one after the last, shape (B + 1,)."""
    group: IntArray
    """Group of every block, shape (B,)."""
    row: IntArray
    """First block of every group, and one after the last, shape (G + 1,)."""

    @classmethod
    def of(cls, group: IntArray, group_count: int) -> "GroupBlocks":
        """Blocks of particles whose groups are given, -1 for none, shape (particle_count,)."""
        member = np.argsort(group, kind="stable")[int((group < 0).sum()) :]
        begins = np.concatenate([[0], np.cumsum(np.bincount(group[member], minlength=group_count))])
        firsts = [np.arange(a, b, _BLOCK) for a, b in itertools.pairwise(begins.tolist())]
        first = np.concatenate([*firsts, [len(member)]]).astype(np.int32)
        return cls(
            member=member.astype(np.int32),
            first=first,
            group=group[member[first[:-1]]].astype(np.int32),
            row=np.concatenate([[0], np.cumsum([len(part) for part in firsts])]).astype(np.int32),
        )
