"""Cells of every shape, and the faces between them. NumPy only."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.cells import Cells, FaceCells
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.shapes.geometry import Geometry, no_elements
from sandbox.scene.surfaces import pair_springs
from sandbox.scene.topology import directed_edges, pair_keys

Numbers = NDArray[np.int64]

_STIFF = {2: 1, 3: 3, 4: 5, 8: 18}
"""Fewest springs that hold so many corners in shape: their degrees of freedom less those of a rigid body."""
_SIDES = {
    3: np.array([[0, 1], [1, 2], [2, 0]]),
    4: np.array([[0, 2], [2, 3], [3, 1], [1, 0]]),
    8: np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]),
}
"""Sides of a cell of so many corners, facing out; the corners of squares and cubes count up in binary, x first."""
_FINEST = 64
"""Most parts of a triangle's edge in the search for the cells that it covers."""


@dataclass(frozen=True)
class Inside:
    """The cells of a scene, and the faces between them."""

    cells: Cells
    """Its faces are the scene's own, then those below."""
    triangles: IntArray
    """Triangles between cells, facing out of those behind them, shape (T, 3)."""
    triangle_body: IntArray
    """Body of each, shape (T,)."""
    outline: IntArray
    """Edges between cells of flat bodies, with the cells behind them to the left, shape (E, 2)."""
    outline_body: IntArray
    """Body of each, shape (E,)."""


def find_inside(
    geometries: Sequence[Geometry],
    rods: Sequence[IntArray],
    numbers: Sequence[Numbers],
    springs: IntArray,
    is_bare: Sequence[bool],
) -> Inside:
    """The inside of bodies whose springs can tear.

    ``rods`` are the capsules of every body in its own points; ``numbers`` lead from these to the points that
    ``springs``, shape (spring_count, 2), and the result name. Of a body that ``is_bare`` one sees particles or springs
    as well: its faces stay with them, and move into no gap.
    """
    bodies = [_BodyCells.of(*body) for body in zip(geometries, rods, is_bare, strict=True)]
    first = np.cumsum([0] + [sum(map(len, body.groups)) for body in bodies])
    groups = [
        _group_springs(number[group], springs)
        for body, number in zip(bodies, numbers, strict=True)
        for group in body.groups
    ]
    start = np.concatenate([[0], np.cumsum(np.concatenate([count for count, _, _ in groups]))]).astype(np.int32)

    def faces(*kinds: str) -> FaceCells:
        rows = [(getattr(body, kind), at) for kind in kinds for body, at in zip(bodies, first, strict=False)]
        return FaceCells.joined([part.shifted(int(at)) for part, at in rows])

    def points(name: str, width: int) -> tuple[IntArray, IntArray]:
        rows = [number[getattr(body, name)].reshape(-1, width) for body, number in zip(bodies, numbers, strict=True)]
        owner = np.repeat(np.arange(len(rows), dtype=np.int32), [len(row) for row in rows])
        return np.concatenate(rows).astype(np.int32), owner

    can_tear = start[first[1:]] > start[first[:-1]]
    cells = Cells(
        start=start,
        springs=np.concatenate([own for _, own, _ in groups]).astype(np.int32),
        limit=np.concatenate([limit for _, _, limit in groups]).astype(np.int32),
        triangles=faces("triangles", "inner_triangles"),
        outline=faces("outline", "inner_outline"),
        capsules=faces("capsules"),
        body_opens=np.array([body.opens for body in bodies]) & can_tear,
    )
    return Inside(cells, *points("inner_triangle_points", 3), *points("inner_outline_points", 2))


@dataclass(frozen=True)
class _BodyCells:
    """Cells of one body and the faces between them, in its own points."""

    groups: list[IntArray]
    """Corners of the cells, those with as many in one array, shape (cells, corners)."""
    triangles: FaceCells
    outline: FaceCells
    capsules: FaceCells
    inner_triangles: FaceCells
    inner_triangle_points: IntArray
    inner_outline: FaceCells
    inner_outline_points: IntArray
    opens: bool

    @classmethod
    def of(cls, geometry: Geometry, rods: IntArray, is_bare: bool) -> "_BodyCells":
        flat, is_lattice = geometry.points.shape[1] == 2, len(geometry.cells) > 0
        corners = geometry.cells if is_lattice else geometry.triangles
        none = FaceCells.of(np.zeros(0, dtype=np.int64))
        sides = _Sides.of(geometry.points, corners) if is_lattice or (flat and not geometry.membrane) else None
        groups = [corners, rods]
        if sides is None and len(geometry.outline):
            groups.append(geometry.outline)
            outline = FaceCells.of(len(corners) + len(rods) + np.arange(len(geometry.outline)))
        else:
            outline = FaceCells.of(sides.owners_of(geometry.outline)) if sides is not None else none
        if is_lattice and len(geometry.carried_nodes):
            triangles = _covered(geometry)
        elif sides is not None and is_lattice:
            triangles = FaceCells.of(sides.owners_of(geometry.triangles))
        else:
            triangles = FaceCells.of(np.arange(len(geometry.triangles)))
        between, inner = no_elements(2 if flat else 4), none
        if sides is not None:
            between, inner = sides.inner(0.0 if is_bare else 1.0)
        quads, edges = (no_elements(4), between) if flat else (between, no_elements(2))
        return cls(
            groups=groups,
            triangles=triangles,
            outline=outline,
            capsules=FaceCells.of(len(corners) + np.arange(len(rods))),
            inner_triangles=none if flat else FaceCells.joined([inner, inner]),
            inner_triangle_points=np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
            inner_outline=inner if flat else none,
            inner_outline_points=edges,
            opens=not flat and len(geometry.triangles) > 0 and not (is_lattice and len(geometry.carried_nodes) == 0),
        )


@dataclass(frozen=True)
class _Sides:
    """All sides of cells: every inner face twice, once for either cell."""

    corners: IntArray
    """Corners of the cells, shape (cells, corners)."""
    faces: IntArray
    """Corners of the sides, shape (F, 2 or 4)."""
    owner: Numbers
    """Cell behind each, shape (F,)."""
    neighbour: Numbers
    """Cell in front of each, or -1, shape (F,)."""
    depth: FloatArray
    """Half the distance between both [m], 0 where there is but one, shape (F,)."""

    @classmethod
    def of(cls, points: FloatArray, corners: IntArray) -> "_Sides":
        sides = _SIDES[corners.shape[1]]
        faces = corners[:, sides].reshape(-1, sides.shape[1])
        owner = np.repeat(np.arange(len(corners)), len(sides))
        # Opposite corners of a square are those of no other square.
        ends = faces[:, [0, -1]] if faces.shape[1] == 2 else faces[:, [0, 2]]
        _, inverse, uses = np.unique(pair_keys(ends), return_inverse=True, return_counts=True)
        slot = np.argsort(inverse.reshape(-1), kind="stable")
        one = np.concatenate([[0], np.cumsum(uses)[:-1]])[uses == 2] if len(uses) else np.zeros(0, dtype=np.int64)
        neighbour = np.full(len(faces), -1)
        neighbour[slot[one]], neighbour[slot[one + 1]] = owner[slot[one + 1]], owner[slot[one]]
        middle = points[corners].mean(axis=1)
        apart = np.linalg.norm(middle[owner] - middle[neighbour], axis=1)
        return cls(corners, faces, owner, neighbour, np.where(neighbour >= 0, 0.5 * apart, 0.0))

    def inner(self, part: float) -> tuple[IntArray, FaceCells]:
        """Faces between two cells, and these cells; with `part` of their depth."""
        inner = self.neighbour >= 0
        return self.faces[inner], FaceCells.of(self.owner[inner], self.neighbour[inner], part * self.depth[inner])

    def owners_of(self, elements: IntArray) -> Numbers:
        """Cell of every outer edge, or of every triangle that is half of a square side or cell, or -1."""
        if elements.shape[1] == 2:
            outer = self.neighbour < 0
            known, owner = pair_keys(self.faces[outer]), self.owner[outer]
            wanted = pair_keys(elements)[:, None]
        else:
            squares, owner = (self.corners[:, [0, 2, 3, 1]], np.arange(len(self.corners)))
            if self.faces.shape[1] == 4:
                outer = self.neighbour < 0
                squares, owner = self.faces[outer], self.owner[outer]
            # Either diagonal may be the one that parts the square.
            known = np.concatenate([pair_keys(squares[:, [0, 2]]), pair_keys(squares[:, [1, 3]])])
            owner = np.tile(owner, 2)
            wanted = pair_keys(directed_edges(elements)).reshape(-1, 3)
        if not len(known) or not len(elements):
            return np.full(len(elements), -1)
        order = np.argsort(known, kind="stable")
        place = np.minimum(np.searchsorted(known[order], wanted), len(known) - 1)
        found = np.where(known[order][place] == wanted, owner[order][place], -1)
        return np.asarray(found.max(axis=1))


def _group_springs(corners: Numbers, springs: IntArray) -> tuple[Numbers, IntArray, Numbers]:
    """Of cells with as many corners, shape (C, n): how many springs each has, (C,), these, and its limit, (C,).

    A cell is broken once it may be floppy, and once a corner may have come off.
    """
    width = corners.shape[1]
    pairs = np.array(list(itertools.combinations(range(width), 2)))
    found = pair_springs(corners[:, pairs].reshape(-1, 2), springs).reshape(-1, len(pairs))
    there = found >= 0
    count = there.sum(axis=1)
    at_corner = np.stack([there[:, (pairs == corner).any(axis=1)].sum(axis=1) for corner in range(width)], axis=1)
    limit = np.minimum(count - _STIFF[width] + 1, at_corner.min(axis=1))
    return count, found[there], np.maximum(limit, 1)


def _covered(geometry: Geometry) -> FaceCells:
    """Cells behind triangles over carried points: of all points of a triangle the nearest cells."""
    from scipy.spatial import cKDTree

    own = np.einsum("cn,cnd->cd", geometry.carried_weights, geometry.points[geometry.carried_nodes])
    corner = np.concatenate([geometry.points, own])[geometry.triangles]
    middles = geometry.points[geometry.cells].mean(axis=1)
    cell_size = np.linalg.norm(np.ptp(geometry.points[geometry.cells[0]], axis=0)) / np.sqrt(3.0)
    edge = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(2.0 * edge / cell_size), 1, _FINEST).astype(int)
    tree = cKDTree(middles)
    rows, cells = [], []
    for count in np.unique(parts):
        chosen = np.nonzero(parts == count)[0]
        weights = np.array([(i, j, count - i - j) for i in range(count + 1) for j in range(count + 1 - i)]) / count
        near = tree.query((weights @ corner[chosen]).reshape(-1, 3))[1]
        rows.append(np.repeat(chosen, len(weights)))
        cells.append(near)
    both = np.unique(np.stack([np.concatenate(rows), np.concatenate(cells)], axis=1), axis=0)
    start = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=len(corner)))])
    outside = np.full(len(corner), -1, dtype=np.int32)
    return FaceCells(start.astype(np.int32), both[:, 1].astype(np.int32), outside, np.zeros(len(corner)))
