"""What of a mesh's triangles bounds the solid where its parts overlap or touch: the others have solid on both sides.

A place is inside where the mesh winds around it, however often. Triangles that others cross are cut along the planes
of those, so that every piece bounds the solid as a whole or not at all. NumPy only.
"""

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.contact.mesh_surface import unit_normals
from sandbox.contact.triangle_tree import FloatArray, IndexArray, TriangleTree, build_tree
from sandbox.scene.lattice import IntArray
from sandbox.scene.mesh_file import signed_volume
from sandbox.scene.topology import directed_edges, pair_keys
from sandbox.scene.winding import side

_NEAR = 1e-9
"""Part of the mesh's size within which things touch [1]."""
_ASIDE = 1e-7
"""Part of the mesh's size by which a look beside a triangle is off it [1]."""
_MOST_CROSSINGS = 100_000
"""Most pairs of triangles for which cuts are worth their time."""


def outer_parts(vertices: FloatArray, triangles: IntArray) -> tuple[IntArray, FloatArray | None]:
    """Triangles without parts that lie in others, and the pieces that bound the solid [m], shape (P, 3, 3).

    There are no pieces, but None, where the triangles themselves bound it. No triangles where nothing is solid.
    """
    corners = vertices[triangles]
    tree = build_tree(corners)
    size = float(np.ptp(vertices, axis=0).max())
    one, other = _crossings(corners, triangles, tree, _NEAR * size)
    _, uses = np.unique(pair_keys(directed_edges(triangles)), return_counts=True)
    if abs(signed_volume(vertices, triangles)) < _NEAR * size**3:
        return triangles[:0], None
    simple = len(one) == 0 and bool((uses == 2).all())
    if simple and not _boxes_of_parts_meet(vertices, triangles):
        return triangles, None
    if simple:
        return triangles[_bounds_solid(corners, vertices, triangles, tree, _ASIDE * size)], None
    pieces = corners if len(one) > _MOST_CROSSINGS else _cut(corners, one, other, _NEAR * size)
    pieces = pieces[_bounds_solid(pieces, vertices, triangles, tree, _ASIDE * size)]
    return triangles if len(pieces) else triangles[:0], pieces


def windings(points: FloatArray, vertices: FloatArray, triangles: IntArray, tree: TriangleTree) -> NDArray[np.int64]:
    """How often the mesh winds around points [m], shape (P,): crossings of the ray from each along +z."""

    def above(query: IndexArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
        at = points[query]
        return np.asarray(((low[:, :2] <= at[:, :2]) & (at <= high)[:, :2]).all(axis=1) & (at[:, 2] <= high[:, 2]))

    point, t = tree.pairs(len(points), above)
    xy = vertices[:, :2]
    sides = [side(xy, triangles[t, k], triangles[t, (k + 1) % 3], points[point, :2]) for k in range(3)]
    left, right = (np.logical_and.reduce([s > 0.0 for s in signed]) for signed in (sides, [-s for s in sides]))
    first, second, third = (vertices[triangles[t, k]] for k in range(3))
    height = np.einsum("ij,ij->i", first - points[point], np.cross(second - first, third - first))
    leaving = np.where(left & (height > 0.0), 1, 0) - np.where(right & (height < 0.0), 1, 0)
    return np.rint(np.bincount(point, leaving, len(points))).astype(np.int64)


def _bounds_solid(
    pieces: FloatArray, vertices: FloatArray, triangles: IntArray, tree: TriangleTree, aside: float
) -> NDArray[np.bool_]:
    """Which of some pieces of triangles have solid behind and none in front, shape (P,)."""
    middle, out = pieces.mean(axis=1), aside * unit_normals(pieces)
    front, back = (windings(middle + step, vertices, triangles, tree) for step in (out, -out))
    return np.asarray((front == 0) & (back != 0))


def _boxes_of_parts_meet(vertices: FloatArray, triangles: IntArray) -> bool:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    ends = directed_edges(triangles)
    graph = coo_matrix((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(len(vertices),) * 2)
    count, part = connected_components(graph, directed=False)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, part, vertices)
    np.maximum.at(high, part, vertices)
    order = np.argsort(low[:, 0])
    low, high = low[order], high[order]
    for k in range(count):
        # Only those that begin before this one ends along x.
        behind = slice(k + 1, int(np.searchsorted(low[:, 0], high[k, 0], side="right")))
        if ((low[behind] <= high[k]) & (low[k] <= high[behind])).all(axis=1).any():
            return True
    return False


def _crossings(
    corners: FloatArray, triangles: IntArray, tree: TriangleTree, near: float
) -> tuple[IndexArray, IndexArray]:
    """Pairs of triangles without a common corner that cross or touch, each pair both ways round."""
    one, other = tree.neighbours(near)
    low, high = corners.min(axis=1), corners.max(axis=1)
    met = ((low[one] <= high[other] + near) & (high[one] >= low[other] - near)).all(axis=1)
    one, other = one[met], other[met]
    apart = (triangles[one][:, :, None] != triangles[other][:, None, :]).all(axis=(1, 2))
    one, other = one[apart], other[apart]
    met = _pierces(corners[one], corners[other], near) | _pierces(corners[other], corners[one], near)
    one, other = one[met], other[met]
    return np.concatenate([one, other]), np.concatenate([other, one])


def _pierces(one: FloatArray, other: FloatArray, near: float) -> NDArray[np.bool_]:
    """Whether an edge of a triangle goes through or up to the other triangle, shape (P,)."""
    normal = unit_normals(other)
    met = np.zeros(len(one), dtype=bool)
    height = np.einsum("pkj,pj->pk", one - other[:, :1], normal)
    for k in range(3):
        start, end = height[:, k], height[:, (k + 1) % 3]
        through = (np.minimum(start, end) <= near) & (np.maximum(start, end) >= -near) & (np.abs(start - end) > near)
        fraction = np.clip(start / np.where(through, start - end, 1.0), 0.0, 1.0)
        at = one[:, k] + fraction[:, None] * (one[:, (k + 1) % 3] - one[:, k])
        for j in range(3):
            edge = other[:, (j + 1) % 3] - other[:, j]
            beyond = np.einsum("pj,pj->p", np.cross(edge, normal), at - other[:, j])
            through &= beyond <= near * np.linalg.norm(edge, axis=1)
        met |= through
    return met


def _cut(corners: FloatArray, one: IndexArray, other: IndexArray, near: float) -> FloatArray:
    """All triangles, those that others cross in pieces: along the planes of those, shape (P, 3, 3)."""
    crossed: dict[int, list[int]] = defaultdict(list)
    for t, by in zip(one.tolist(), other.tolist(), strict=True):
        crossed[t].append(by)
    normals = unit_normals(corners)
    whole = np.ones(len(corners), dtype=bool)
    pieces: list[FloatArray] = []
    for t, cutters in crossed.items():
        whole[t] = False
        polygons = [corners[t]]
        for by in cutters:
            low, high = corners[by].min(axis=0) - near, corners[by].max(axis=0) + near
            polygons = [
                part
                for polygon in polygons
                for part in (
                    _split(polygon, (polygon - corners[by, 0]) @ normals[by], near)
                    if (polygon.min(axis=0) <= high).all() and (polygon.max(axis=0) >= low).all()
                    else [polygon]
                )
            ]
        pieces.extend(np.stack([p[0], p[k], p[k + 1]]) for p in polygons for k in range(1, len(p) - 1))
    cut = np.reshape(pieces, (-1, 3, 3))
    area = np.linalg.norm(np.cross(cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0]), axis=1)
    return np.concatenate([corners[whole], cut[area > near * near]])


def _split(polygon: FloatArray, height: FloatArray, near: float) -> list[Any]:
    """The parts of a convex polygon below and above a plane over which its corners are at a ``height`` [m]."""
    if height.min() >= -near or height.max() <= near:
        return [polygon]
    below, above = [], []
    for k in range(len(polygon)):
        onward = (k + 1) % len(polygon)
        if height[k] <= near:
            below.append(polygon[k])
        if height[k] >= -near:
            above.append(polygon[k])
        if min(height[k], height[onward]) < -near and max(height[k], height[onward]) > near:
            fraction = height[k] / (height[k] - height[onward])
            between = polygon[k] + fraction * (polygon[onward] - polygon[k])
            below.append(between)
            above.append(between)
    return [np.array(below), np.array(above)]
