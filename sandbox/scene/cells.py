"""Cells of bodies: which way round those of solids are, and what is seen where springs have torn. NumPy only.

A cell is a piece of a body that is there or not: a cube or a square of a lattice, a triangle of a sheet or of a filled
outline, a rod. It is broken when so many of its springs have torn that it may no longer keep its shape. A face is seen
where the cells behind it are whole, and the cell in front of it, if there is one, is broken.

A cell of a solid is inverted where some of its corners is: where the edges that lead out of it no longer turn the way
that they do at rest. Springs do not mind: they hold what is inside out as firmly as what is not.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.surfaces import pair_springs

MaskArray = NDArray[np.bool_]

_FLAT = 0.3
"""Part of what a cell's corners span, below which a corner is too flat at rest to tell which way it turns [1]."""
_AS_SQUARE = [0, 2, 1, 1]
"""A triangle as a square's corners, of which only the first one is looked at."""

FARTHEST = {2: 2.0, 3: 1.75}
"""How far a point moves into a gap, in depths of the faces there, at most: as at a corner of a triangle or a cube."""

SMOOTHING = {2: 1.0 / 2.0, 3: 2.0 / 3.0}
"""Part of the way out or in that a point moves to the middle of its neighbours: stairs of cells become slopes."""
_NEXT = {2: ([0, 1], [1, 0]), 3: ([0, 0, 1, 1, 2, 2], [1, 2, 2, 0, 0, 1])}


@dataclass(frozen=True)
class FaceCells:
    """The cells on both sides of F faces of one kind."""

    start: IntArray
    """Where the cells behind every face begin in ``owners``, shape (F + 1,)."""
    owners: IntArray
    """Cells behind the faces, one face after the other."""
    neighbour: IntArray
    """Cell in front of every face, -1 for the outside, shape (F,)."""
    depth: FloatArray
    """Half the distance between the cells on both sides of an inner face [m], 0 for outer ones, shape (F,)."""

    def __len__(self) -> int:
        return len(self.neighbour)

    @property
    def is_inner(self) -> MaskArray:
        """True for faces with a cell in front, shape (F,)."""
        return self.neighbour >= 0

    @classmethod
    def of(
        cls, owner: NDArray[Any], neighbour: NDArray[Any] | None = None, depth: FloatArray | None = None
    ) -> "FaceCells":
        """Faces with one cell behind each, or none (-1); shape (F,)."""
        outside = np.full(len(owner), -1) if neighbour is None else neighbour
        return cls(
            start=np.concatenate([[0], np.cumsum(owner >= 0)]).astype(np.int32),
            owners=owner[owner >= 0].astype(np.int32),
            neighbour=outside.astype(np.int32),
            depth=np.zeros(len(owner)) if depth is None else depth,
        )

    @classmethod
    def joined(cls, parts: "Sequence[FaceCells]") -> "FaceCells":
        """One after the other; at least one."""
        counts = np.concatenate([np.diff(part.start) for part in parts])
        return cls(
            start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
            owners=np.concatenate([part.owners for part in parts]),
            neighbour=np.concatenate([part.neighbour for part in parts]),
            depth=np.concatenate([part.depth for part in parts]),
        )

    def shifted(self, first: int) -> "FaceCells":
        """The same faces of cells that are counted from ``first``."""
        neighbour = np.where(self.is_inner, self.neighbour + first, -1).astype(np.int32)
        return FaceCells(self.start, (self.owners + first).astype(np.int32), neighbour, self.depth)

    def chosen(self, mask: MaskArray) -> "FaceCells":
        """Some of the faces; ``mask`` has shape (F,)."""
        counts = np.diff(self.start)
        return FaceCells(
            start=np.concatenate([[0], np.cumsum(counts[mask])]).astype(np.int32),
            owners=self.owners[np.repeat(mask, counts)],
            neighbour=self.neighbour[mask],
            depth=self.depth[mask],
        )

    def shown(self, broken: MaskArray) -> MaskArray:
        """True for the faces that are seen where some cells are broken, shape (F,)."""
        whole = _sums(broken[self.owners], self.start) == 0
        return np.asarray(whole & np.append(broken, True)[self.neighbour])


@dataclass(frozen=True)
class Cells:
    """C cells of all bodies of a scene in which springs can tear, and the faces that hang on them."""

    start: IntArray
    """Where the springs of every cell begin in ``springs``, shape (C + 1,)."""
    springs: IntArray
    """Springs between the corners of the cells, one cell after the other."""
    limit: IntArray
    """With so many torn springs a cell is broken, shape (C,)."""
    triangles: FaceCells
    """Those of the appearance's triangles."""
    outline: FaceCells
    """Those of its outline edges."""
    capsules: FaceCells
    """Those of its capsules."""
    body_opens: MaskArray
    """True where a tear lets one see a surface from behind, for no cells fill what is there, shape (body_count,)."""

    def broken(self, torn: IntArray | None) -> MaskArray:
        """True for broken cells, shape (C,). ``torn`` is nonzero where a spring has torn; None: nothing has."""
        if torn is None:
            return np.zeros(len(self.limit), dtype=bool)
        return np.asarray(_sums(torn[self.springs] != 0, self.start) >= self.limit)


@dataclass(frozen=True)
class SolidCells:
    """C cells of solids in d dimensions, body after body, in internal particle indices."""

    corners: IntArray
    """Particles at the corners, which count up in binary, x first, shape (C, 2^d); of a triangle, some twice."""
    watched: IntArray
    """Corners that turn the right way at rest, a bit each: all others are left out, shape (C,)."""
    body: IntArray
    """Body of every cell, rising, shape (C,)."""
    springs: IntArray
    """Springs between corners, -1 for none, shape (C, most of a cell); no columns where none can tear."""

    def __len__(self) -> int:
        return len(self.body)

    @classmethod
    def of(
        cls, bodies: "Sequence[tuple[IntArray, IntArray]]", positions: FloatArray, springs: IntArray | None
    ) -> "SolidCells":
        """Cells of every body, (C, 2^d), and its filling triangles, (T, 3), of which those count where it has no cells.

        Scene order, where particles start [m], shape (N, d). ``springs`` are those that can tear, None if none can.
        """
        width = 2 ** positions.shape[1]
        own = [cells if len(cells) else triangles[:, _AS_SQUARE].reshape(-1, width) for cells, triangles in bodies]
        triangular = [len(cells) == 0 for cells, _ in bodies]
        corners = np.concatenate([np.zeros((0, width), np.int32), *own]).astype(np.int32)
        body = np.repeat(np.arange(len(own), dtype=np.int32), [len(cells) for cells in own])
        volumes = corner_volumes(positions, corners)
        typical = np.median(np.abs(volumes), axis=1, keepdims=True) if len(volumes) else volumes
        turns = volumes > _FLAT * typical
        turns[:, 1:] &= ~np.repeat(triangular, [len(cells) for cells in own])[:, None]
        watched = (turns << np.arange(width)).sum(axis=1)
        between = np.zeros((len(corners), 0), dtype=np.int32)
        if springs is not None and len(corners):
            pairs = np.array(list(itertools.combinations(range(width), 2)))
            between = pair_springs(corners[:, pairs].reshape(-1, 2), springs).reshape(len(corners), -1)
        return cls(corners, watched.astype(np.int32), body, between)

    def renumbered(self, internal: NDArray[np.int64]) -> "SolidCells":
        """The same with particles by other numbers, shape (N,)."""
        return replace(self, corners=internal[self.corners].astype(np.int32))


def corner_volumes(points: FloatArray, corners: IntArray) -> FloatArray:
    """Volume (2D: area) that the edges out of every corner span, positive the right way round, shape (C, 2^d).

    [m^3] or [m^2]; ``corners`` count up in binary, x first, shape (C, 2^d).
    """
    axes = [1 << axis for axis in reversed(range(points.shape[1]))]
    columns = []
    for corner in range(corners.shape[1]):
        origin = points[corners[:, corner]]
        x, y, *z = ((points[corners[:, corner ^ axis]] - origin).T for axis in axes)
        turn = np.cross(x, y, axis=0) if z else x[0] * y[1] - x[1] * y[0]
        columns.append((-1.0) ** corner.bit_count() * ((turn * z[0]).sum(axis=0) if z else turn))
    return np.stack(columns, axis=1)


def gap_points(points: FloatArray, inner: IntArray, depth: FloatArray, outer: IntArray) -> FloatArray:
    """Where surfaces pass through points [m], shape (P, d), when bodies have opened, shape (P, d).

    ``inner`` and ``outer`` are the faces that are seen: triangles, shape (F, 3), or in 2D edges with the body to the
    left, shape (F, 2). Inner ones move out by their ``depth`` [m]. This shares out what was in a broken cell among the
    whole ones beside it: while what has torn lies together, no gap is seen. Then the steps between cells are smoothed.
    """
    dimension = points.shape[1]
    rows = inner.reshape(-1)
    if dimension == 2:
        along = points[inner[:, 1]] - points[inner[:, 0]]
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-20)[:, None]
        normal = np.repeat(np.stack([along[:, 1], -along[:, 0]], axis=1), 2, axis=0)
    else:
        one, two = (points[np.roll(inner, -k, axis=1).reshape(-1)] - points[rows] for k in (1, 2))
        # So two halves of a square weigh as much at its corner as another one's single half. Source: N. Max, "Weights
        # for computing vertex normals from facet normals", Journal of Graphics Tools 4(2), 1999.
        square = (one**2).sum(axis=1) * (two**2).sum(axis=1)
        normal = np.cross(one, two) / np.maximum(square, 1e-30)[:, None]
    weight = np.linalg.norm(normal, axis=1)

    def total(rows: IntArray, values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(rows, values, minlength=len(points)), dtype=np.float64)

    around, reach, *mean = (total(rows, v) for v in (weight, weight * np.repeat(depth, dimension), *normal.T))
    out = np.stack(mean, axis=1)
    # Faces that look in opposite ways leave no way to go: the shift fades to nothing.
    least = np.maximum((around / FARTHEST[dimension]) ** 2, 1e-30)
    moved = points + out * (reach / np.maximum((out**2).sum(axis=1), least))[:, None]
    is_rim = np.zeros(len(points), dtype=bool)
    is_rim[outer] = True
    begin, end = (inner[:, order].reshape(-1) for order in _NEXT[dimension])
    # The rim is smoothed along itself; in the plane it is but a point, and stays.
    counts = ~is_rim[begin] | (is_rim[end] & (dimension == 3))
    begin, end = begin[counts], end[counts]
    number = np.bincount(begin, minlength=len(points))
    middle = np.stack([total(begin, moved[end, axis]) for axis in range(dimension)], axis=1)
    middle /= np.maximum(number, 1)[:, None]
    # Out or in only: what lies beside a flat cut keeps its shape.
    out /= np.maximum(np.linalg.norm(out, axis=1), 1e-15)[:, None]
    rise = SMOOTHING[dimension] * ((middle - moved) * out).sum(axis=1)
    return np.asarray(moved + np.where(number > 0, rise, 0.0)[:, None] * out)


def _sums(values: MaskArray, start: IntArray) -> NDArray[np.int64]:
    """Number of true values in every row of a list of rows, shape (rows,)."""
    total: NDArray[np.int64] = np.concatenate([[0], np.cumsum(values)])
    return np.asarray(total[start[1:]] - total[start[:-1]])
