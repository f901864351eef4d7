"""Faces of any number of corners, as files have them, and the triangles that they are."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray

Numbers = NDArray[np.int64]

_MOST_FANS = 8
"""Faces of up to so many corners are tried as a fan around every corner before ears are cut off one by one."""
_LEAST_AREA = 1e-9
"""Triangles of a polygon with less than this part of its area count as flat."""


class BadFileError(Exception):
    """What is wrong with a mesh file, in one line without its name."""


@dataclass(frozen=True)
class RawMesh:
    """V vertices and F faces of a file, in its own units and order."""

    vertices: FloatArray
    """Shape (V, 3)."""
    corners: Numbers
    """Vertices of the faces, one face after the other."""
    counts: Numbers
    """Number of corners of every face, shape (F,)."""
    step: float = 0.0
    """How far apart numbers of the file are at least, over their size [1]; 0 where it may be any number."""
    left_out: tuple[str, ...] = ()
    """What else the file has and no reader takes, such as "2 lines"."""

    def triangles(self) -> Numbers:
        """Every face as triangles that face as it does, in the order of the faces; shape (T, 3).

        Raises BadFileError where a face names a vertex that is not there.
        """
        if len(self.corners) and (self.corners.min() < 0 or self.corners.max() >= len(self.vertices)):
            raise BadFileError("a face names a vertex that is not there")
        start = np.cumsum(self.counts) - self.counts
        parts, owners = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for count in np.unique(self.counts[self.counts >= 3]):
            faces = np.nonzero(self.counts == count)[0]
            polygons = self.corners[start[faces][:, None] + np.arange(count)]
            parts.append(polygons if count == 3 else _divided(self.vertices, polygons).reshape(-1, 3))
            owners.append(np.repeat(faces, count - 2))
        return np.concatenate(parts)[np.argsort(np.concatenate(owners), kind="stable")]


def counted(counts: Counter[str]) -> tuple[str, ...]:
    """ "1 line", "3 points of light": what was counted, most first; names are in the singular."""
    several = {name: " ".join([f"{first}s", *rest]) for name in counts for first, *rest in [name.split(" ")]}
    return tuple(f"{count} {name if count == 1 else several[name]}" for name, count in counts.most_common())


def _divided(vertices: FloatArray, polygons: Numbers) -> Numbers:
    """Polygons of n corners each, shape (F, n), as n - 2 triangles each, shape (F, n - 2, 3)."""
    count = polygons.shape[1]
    # Seen from one of its corners, so that a face far from the origin keeps its digits.
    points = vertices[polygons] - vertices[polygons[:, :1]]
    # Newell's normal: twice the area vector of a polygon, plane or not.
    normal = np.cross(points, np.roll(points, -1, axis=1)).sum(axis=1)
    size = np.linalg.norm(normal, axis=1)
    fan = np.stack([np.zeros(count - 2, dtype=int), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    result = polygons[:, fan]
    left = np.arange(len(polygons))
    for first in range(count if count <= _MOST_FANS else 1):
        turned = (fan + first) % count
        a, b, c = (points[left][:, turned[:, k]] for k in range(3))
        area = (np.cross(b - a, c - a) * normal[left][:, None]).sum(axis=2)
        # A fan of triangles that all face as the polygon does covers it once.
        fits = (area > _LEAST_AREA * (size[left] ** 2)[:, None]).all(axis=1)
        result[left[fits]] = polygons[left[fits]][:, turned]
        left = left[~fits]
    for face in left:
        if size[face] > 0.0:
            result[face] = polygons[face][ear_clipping(_flat(points[face], normal[face]))]
    return result


def _flat(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Points in the plane across a normal, which looks at one; shape (n, 2)."""
    one = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    one /= np.linalg.norm(one)
    other = np.cross(normal / np.linalg.norm(normal), one)
    return np.stack([points @ one, points @ other], axis=1)


def ear_clipping(points: FloatArray) -> IntArray:
    """Triangles, shape (n - 2, 3), of a polygon that is counter-clockwise in the plane, shape (n, 2).

    It may be concave. Where it crosses itself, triangles still pass all its edges, and all others both ways.
    Source: G. Meisters, "Polygons have ears", American Mathematical Monthly 82, 1975.
    """
    ring = list(range(len(points)))
    flat = _LEAST_AREA * abs(_cross(points[:-1], points[1:]).sum() + float(_cross(points[-1], points[0])))
    triangles, at, refused = [], 0, 0
    while len(ring) > 3:
        at %= len(ring)
        corner = (ring[at - 1], ring[at], ring[(at + 1) % len(ring)])
        if refused >= len(ring):
            # No ear is left: it crosses or touches itself. The flattest corner goes, and the rest is tried again.
            before, after = points[np.roll(ring, 1)], points[np.roll(ring, -1)]
            at = int(np.argmin(np.abs(_cross(points[ring] - before, after - before))))
            corner = (ring[at - 1], ring[at], ring[(at + 1) % len(ring)])
        elif not _is_ear(points, ring, corner, flat):
            at, refused = at + 1, refused + 1
            continue
        triangles.append(corner)
        del ring[at]
        # One corner on, so that not all triangles meet in one.
        refused = 0
    triangles.append((ring[0], ring[1], ring[2]))
    return np.array(triangles, dtype=np.int32)


def _is_ear(points: FloatArray, ring: list[int], corner: tuple[int, int, int], flat: float) -> bool:
    a, b, c = points[list(corner)]
    if float(_cross(b - a, c - a)) <= flat:
        return False
    others = points[ring]
    sides = [_cross(q - p, others - p) for p, q in ((a, b), (b, c), (c, a))]
    within = np.all([side >= -flat for side in sides], axis=0)
    # Corners of the ear itself, and others at the same place, as at the bridge to a hole, are not in the way.
    for own in (a, b, c):
        within &= (others != own).any(axis=1)
    return not within.any()


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
