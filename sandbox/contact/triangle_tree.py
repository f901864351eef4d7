"""A tree of boxes around triangles, with which few of them are looked at in a search. NumPy only.

Triangles are split at the median along the longest side of what they span, again and again, down to a handful a leaf.
Nodes lie in the order in which a search meets them: behind each comes its first half, and ``skip`` says where to go on
if nothing in its box can matter. A search is then one loop without a stack.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_LEAF = 4
"""Most triangles of a leaf."""


@dataclass(frozen=True)
class TriangleTree:
    """Boxes around triangles, in depth-first order."""

    order: IndexArray
    """Which triangle stands at which place of the leaves, shape (T,)."""
    low: FloatArray
    """Lowest corners of the boxes [m], shape (N, 3)."""
    high: FloatArray
    """Highest corners of the boxes [m], shape (N, 3)."""
    skip: IndexArray
    """The node that comes after all that is within a node, shape (N,)."""
    first: IndexArray
    """First place of a leaf's triangles, shape (N,)."""
    last: IndexArray
    """One behind the last place of a leaf's triangles; as ``first`` for what is no leaf, shape (N,)."""

    def pairs(
        self, count: int, meets: Callable[[IndexArray, FloatArray, FloatArray], NDArray[np.bool_]]
    ) -> tuple[IndexArray, IndexArray]:
        """Queries and triangles whose boxes meet: ``meets(queries, low, high)`` [m] says so of ``count`` queries."""
        query, node = np.arange(count), np.zeros(count, dtype=np.int64)
        queries, triangles = [], []
        while len(query):
            met = meets(query, self.low[node], self.high[node])
            query, node = query[met], node[met]
            leaf = self.last[node] > self.first[node]
            size = (self.last - self.first)[node[leaf]]
            within = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
            queries.append(np.repeat(query[leaf], size))
            triangles.append(self.order[np.repeat(self.first[node[leaf]], size) + within])
            query, node = np.tile(query[~leaf], 2), np.concatenate([node[~leaf] + 1, self.skip[node[~leaf] + 1]])
        return np.concatenate(queries), np.concatenate(triangles)

    def neighbours(self, near: float) -> tuple[IndexArray, IndexArray]:
        """Pairs of triangles in leaves whose boxes are no more than ``near`` [m] apart, each pair one way round."""
        one, other = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
        while self.first[one[0]] == self.last[one[0]]:  # all leaves are equally deep
            first, second = (np.stack([nodes + 1, self.skip[nodes + 1]]) for nodes in (one, other))
            itself = one == other
            one = np.concatenate([first[0], first[0], first[1], first[1][~itself]])
            other = np.concatenate([second[0], second[1], second[1], second[0][~itself]])
            met = (self.low[one] <= self.high[other] + near) & (self.high[one] >= self.low[other] - near)
            one, other = one[met.all(axis=1)], other[met.all(axis=1)]
        begin, end = (self.first[nodes][:, None] + np.arange(_LEAF) for nodes in (one, other))
        shape = (len(one), _LEAF, _LEAF)
        begin, end = np.broadcast_to(begin[:, :, None], shape), np.broadcast_to(end[:, None, :], shape)
        there = (begin < self.last[one][:, None, None]) & (end < self.last[other][:, None, None])
        there &= (one != other)[:, None, None] | (begin < end)
        return self.order[begin[there]], self.order[end[there]]


def build_tree(corners: FloatArray) -> TriangleTree:
    """The tree of triangles with the given ``corners`` [m], shape (T, 3, 3)."""
    count = len(corners)
    levels = max(0, int(np.ceil(np.log2(count / _LEAF))))
    bounds = np.arange(2**levels + 1) * count // 2**levels
    order = np.arange(count)
    centres = corners.mean(axis=1)
    for level in range(levels):
        part = bounds[:: 2 ** (levels - level)]
        sorted_centres = centres[order]
        low, high = (f.reduceat(sorted_centres, part[:-1]) for f in (np.minimum, np.maximum))
        segment = np.repeat(np.arange(2**level), np.diff(part))
        along = np.take_along_axis(sorted_centres, (high - low).argmax(axis=1)[segment][:, None], axis=1)[:, 0]
        order = order[np.lexsort((along, segment))]
    low = np.minimum.reduceat(corners.min(axis=1)[order], bounds[:-1])
    high = np.maximum.reduceat(corners.max(axis=1)[order], bounds[:-1])
    lows, highs = [low], [high]
    for _ in range(levels):
        lows.append(np.minimum(lows[-1][::2], lows[-1][1::2]))
        highs.append(np.maximum(highs[-1][::2], highs[-1][1::2]))
    # Where each node of a level comes in the order: behind its parent, the second half behind all of the first.
    place, size = np.zeros(1, dtype=np.int64), 2 ** (levels + 1) - 1
    places, sizes = [place], [size]
    for _ in range(levels):
        size //= 2
        place = np.stack([place + 1, place + 1 + size], axis=1).reshape(-1)
        places.append(place)
        sizes.append(size)
    total = 2 ** (levels + 1) - 1
    boxes, skip, ends = np.empty((2, total, 3)), np.empty(total, dtype=np.int64), np.zeros((2, total), dtype=np.int64)
    for level, (place, size) in enumerate(zip(places, sizes, strict=True)):
        boxes[0, place], boxes[1, place] = lows[levels - level], highs[levels - level]
        skip[place] = place + size
    ends[0, places[-1]], ends[1, places[-1]] = bounds[:-1], bounds[1:]
    return TriangleTree(order, boxes[0], boxes[1], skip, ends[0], ends[1])
