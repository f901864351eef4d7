"""Things of several groups in short runs, for sums that no number of threads changes: faces of a gas, particles of a
body. Each run, or block, is added up in order by one thread, and then the blocks of a group are.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.state import place

IntArray = NDArray[np.int32]

_BLOCK = 64
"""Members that are added up one after the other."""


@dataclass(frozen=True)
class GroupBlocks:
    """Members of G groups in B blocks, each of one group; arrays."""

    member: IntArray
    """Members of group 0, then those of group 1, ..."""
    first: IntArray
    """Place of every block's first member in that list, and one after the last, shape (B + 1,)."""
    group: IntArray
    """Group of every block, shape (B,)."""
    row: IntArray
    """First block of every group, and one after the last, shape (G + 1,)."""

    @classmethod
    def of(cls, group: IntArray, group_count: int) -> "GroupBlocks":
        """Blocks of things whose groups are given, -1 for none, shape (thing_count,)."""
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


@ti.data_oriented
class GroupFields:
    """The same in fields of the same names and shapes."""

    def __init__(self, builder: ti.FieldsBuilder, blocks: GroupBlocks) -> None:
        self.blocks = blocks
        self.member_count, self.block_count = len(blocks.member), len(blocks.group)
        self.group_count = len(blocks.row) - 1
        self.member = place(builder, ti.field(ti.i32), self.member_count)
        self.first = place(builder, ti.field(ti.i32), self.block_count + 1)
        self.group = place(builder, ti.field(ti.i32), self.block_count)
        self.row = place(builder, ti.field(ti.i32), self.group_count + 1)

    def load(self) -> None:
        """Upload the lists."""
        self._write(self.blocks.member, self.blocks.first, self.blocks.group, self.blocks.row)

    @ti.func
    def first_member(self, g):
        """First member of group g."""
        return self.member[self.first[self.row[g]]]

    @ti.kernel
    def _write(
        self, member: ti.types.ndarray(), first: ti.types.ndarray(), group: ti.types.ndarray(), row: ti.types.ndarray()
    ):
        for k in range(member.shape[0]):
            self.member[k] = member[k]
        for b in range(first.shape[0]):
            self.first[b] = first[b]
        for b in range(group.shape[0]):
            self.group[b] = group[b]
        for g in range(row.shape[0]):
            self.row[g] = row[g]
