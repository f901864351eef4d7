"""Capsules and spheres as triangles: one pattern for all of a scene. NumPy only."""

import math
from dataclasses import dataclass

import numpy as np

from sandbox.scene.appearance import FloatArray, IntArray

_FINENESS = ((64, 32, 8), (1000, 16, 4), (6000, 10, 2), (10**9, 6, 1))
"""Up to so many of them, each has so many sides, and rings on either half."""


@dataclass(frozen=True)
class Pattern:
    """A capsule of radius 1 along z: two halves of a sphere, and what joins them."""

    directions: FloatArray
    """From the end that a vertex belongs to, shape (vertex_count, 3); 2D: shape (vertex_count, 2)."""
    ends: IntArray
    """0 for vertices of the start, 1 for those of the end, shape (vertex_count,)."""
    triangles: IntArray
    """Counter-clockwise from outside, shape (triangle_count, 3)."""

    def indices(self, count: int, first: int) -> IntArray:
        """Triangles of ``count`` of them, with vertices from ``first`` on, shape (count, triangle_count, 3)."""
        starts = first + np.arange(count, dtype=np.int32) * np.int32(len(self.ends))
        return (self.triangles[None] + starts[:, None, None]).astype(np.int32)


def capsule_pattern(count: int) -> Pattern:
    """A pattern that is the finer, the fewer there are of them."""
    sides, rings = next((sides, rings) for most, sides, rings in _FINENESS if count <= most)
    turns = 2.0 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    # From pole to pole; the equator is there twice, once for either end.
    heights = np.concatenate([-np.cos(np.pi / 2 * np.arange(rings + 1) / rings)])
    levels = np.concatenate([heights[1:], -heights[::-1][:-1]])
    rows = [np.column_stack([circle * math.sqrt(1.0 - z * z), np.full(sides, z)]) for z in levels]
    directions = np.concatenate([[[0.0, 0.0, -1.0]], *rows, [[0.0, 0.0, 1.0]]])
    # As wide as the circle in the mean, not inside of it everywhere.
    directions *= math.sqrt(turns[1] / math.sin(turns[1]))
    ends = np.repeat([0, 1], len(directions) // 2).astype(np.int32)
    one = np.arange(sides)
    two = (one + 1) % sides
    last = len(directions) - 1
    triangles = [np.stack([np.zeros_like(one), 1 + two, 1 + one], axis=1)]
    for level in range(len(levels) - 1):
        low, high = 1 + level * sides, 1 + (level + 1) * sides
        triangles.append(np.stack([low + one, low + two, high + two], axis=1))
        triangles.append(np.stack([low + one, high + two, high + one], axis=1))
    top = 1 + (len(levels) - 1) * sides
    triangles.append(np.stack([np.full_like(one, last), top + one, top + two], axis=1))
    return Pattern(directions, ends, np.concatenate(triangles).astype(np.int32))


def stadium_pattern(count: int) -> Pattern:
    """The same in the plane, along x."""
    half = 12 if count <= 4000 else 6
    angles = np.pi / 2 + np.pi * np.arange(half + 1) / half
    start = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    directions = np.concatenate([start, -start])
    ends = np.repeat([0, 1], half + 1).astype(np.int32)
    fan = np.arange(1, len(directions) - 1)
    return Pattern(directions, ends, np.stack([np.zeros_like(fan), fan, fan + 1], axis=1).astype(np.int32))
