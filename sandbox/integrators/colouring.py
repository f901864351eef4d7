"""Colours for what may be solved at once: no two of a colour have to do with each other. NumPy and plain Python.

First fit, one after the other, with sets of colours as bits of whole numbers: some 5 million half-edges a second,
once a simulation. On a lattice in its natural order that finds the fewest colours that there are for particles
(8 with 26 neighbours each), and close to the fewest for springs. Afterwards what is in crowded colours moves to
emptier ones where it may. The same input gives the same colours everywhere.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class ColourLists:
    """The members of every colour, one colour after the other."""

    member: IntArray
    """Members, rising within a colour, shape (count,)."""
    first: IntArray
    """Where each colour begins, and one after the last, shape (colour_count + 1,)."""

    @classmethod
    def of(cls, colour_count: int, colour: IntArray) -> "ColourLists":
        """Lists of what has the colours given, shape (count,)."""
        first = np.concatenate([[0], np.cumsum(np.bincount(colour, minlength=colour_count))])
        return cls(np.argsort(colour, kind="stable").astype(np.int32), first.astype(np.int32))

    def without(self, left_out: NDArray[np.bool_]) -> "ColourLists":
        """The same lists without some members, by number; a colour may be empty then."""
        stays = ~left_out[self.member]
        first = np.concatenate([[0], np.cumsum(stays)])[self.first]
        return ColourLists(self.member[stays], first.astype(np.int32))


def colour_particles(count: int, pairs: NDArray[np.integer]) -> tuple[int, IntArray]:
    """Colours of ``count`` particles such that both of every pair, shape (P, 2), differ; (colour count, of each).

    Pairs of a particle with itself, and repeated ones, do no harm.
    """
    pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    owner = np.concatenate([pairs[:, 0], pairs[:, 1]])
    other = np.concatenate([pairs[:, 1], pairs[:, 0]])[np.argsort(owner, kind="stable")].tolist()
    row = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=count))]).tolist()
    bits = [0] * count
    for i in range(count):
        taken = 0
        for j in other[row[i] : row[i + 1]]:
            taken |= bits[j]
        bits[i] = ~taken & (taken + 1)
    sizes = _sizes(bits)
    for i in range(count):
        if _crowded(sizes, count, bits[i]):
            taken = 0
            for j in other[row[i] : row[i + 1]]:
                taken |= bits[j]
            bits[i] = _emptiest(sizes, count, bits[i], taken)
    return len(sizes), _colours(bits)


def colour_edges(count: int, pairs: NDArray[np.integer]) -> tuple[int, IntArray]:
    """Colours of springs, shape (S, 2), such that those of a colour share none of ``count`` particles.

    (Colour count, colour of each spring.) Springs are taken direction by direction, that is by the difference of
    their ends' numbers: in a lattice each direction needs two colours.
    """
    pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    ends = np.sort(pairs, axis=1)
    order = np.lexsort((ends[:, 0], ends[:, 1] - ends[:, 0]))
    first, second = ends[order, 0].tolist(), ends[order, 1].tolist()
    used = [0] * count
    bits = [0] * len(first)
    for e, (a, b) in enumerate(zip(first, second, strict=True)):
        taken = used[a] | used[b]
        bit = ~taken & (taken + 1)
        bits[e] = bit
        used[a] |= bit
        used[b] |= bit
    sizes = _sizes(bits)
    for e, (a, b) in enumerate(zip(first, second, strict=True)):
        if _crowded(sizes, len(bits), bits[e]):
            bit = _emptiest(sizes, len(bits), bits[e], used[a] | used[b])
            if bit != bits[e]:
                used[a] = used[a] & ~bits[e] | bit
                used[b] = used[b] & ~bits[e] | bit
                bits[e] = bit
    colour = np.empty(len(bits), dtype=np.int32)
    colour[order] = _colours(bits)
    return len(sizes), colour


def _colours(bits: list[int]) -> IntArray:
    """Numbers of colours from their bits."""
    return np.array([bit.bit_length() - 1 for bit in bits], dtype=np.int32)


def _sizes(bits: list[int]) -> dict[int, int]:
    """Members of every colour, by its bit."""
    found, sizes = np.unique(_colours(bits), return_counts=True)
    return {1 << int(colour): int(size) for colour, size in zip(found, sizes, strict=True)}


def _crowded(sizes: dict[int, int], total: int, bit: int) -> bool:
    """Whether a colour has more than its part of the total."""
    return sizes[bit] * len(sizes) > total


def _emptiest(sizes: dict[int, int], total: int, bit: int, taken: int) -> int:
    """The colour with the fewest members that is not taken and has room, else ``bit``; the sizes follow."""
    best = bit
    for other, size in sizes.items():
        if not other & taken and size * len(sizes) < total and size < sizes[best]:
            best = other
    sizes[bit] -= 1
    sizes[best] += 1
    return best
