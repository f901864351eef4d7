"""Corners that a file has more than once made one, and triangles without area taken out, so that no gap opens."""

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.topology import directed_edges, pair_keys

FLAT = 1e-9
"""Edges, and triangles across their longest edge, with less than this part of the mesh's size have none."""
_STEPS = (2.0, 8.0)
"""Corners of gaps so many steps of the file's numbers apart are the same: one step along each axis, and a few."""
_LOOSE = 1e-6
"""Part of the mesh's size within which corners of gaps that are left are the same."""
_ROUNDS = 20


def welded(vertices: FloatArray, triangles: IntArray, step: float) -> tuple[FloatArray, IntArray]:
    """One vertex a place, and no triangle with two corners in one; the order is otherwise kept.

    ``step``: of the file's numbers, over their size [1]. Places that differ are one only where an edge is too short
    to be one, or where a gap would stay open without: exporters round the corners of every triangle by themselves.
    """
    vertices, triangles = _without_unused(vertices, triangles)
    if len(triangles) == 0:
        return vertices, triangles
    size = float(np.ptp(vertices, axis=0).max())
    order = np.lexsort(vertices.T)
    differs = np.ones(len(vertices), dtype=bool)
    differs[1:] = (vertices[order[1:]] != vertices[order[:-1]]).any(axis=1)
    # Sorting keeps the order of equal places: the first of each stands for all.
    same = np.empty(len(vertices), dtype=np.int64)
    same[order] = order[differs][np.cumsum(differs) - 1]
    triangles = _renamed(triangles, same)
    edges = directed_edges(triangles)
    apart = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    triangles = _renamed(triangles, _joined(len(vertices), edges[apart <= FLAT * size]))
    steps = [factor * step * float(np.abs(vertices).max()) for factor in _STEPS]
    for tolerance in (*steps, max(steps[-1], _LOOSE * size)):
        gap = _gap_corners(triangles)
        if len(gap) == 0:
            break
        triangles = _renamed(triangles, _joined(len(vertices), gap[_near(vertices[gap], tolerance)]))
    return _without_unused(vertices, triangles)


def distinct(triangles: IntArray, *, each_way: bool) -> IntArray:
    """Triangles over the same corners once, or once each way that they face; the first of each."""
    corners = np.sort(triangles, axis=1)
    # A triangle faces the one way or the other as its corners are an even or an odd permutation.
    odd = (np.diff(triangles[:, [0, 1, 2, 0]], axis=1) > 0).sum(axis=1) == 1
    keys = np.column_stack([corners, odd if each_way else np.zeros(len(corners), dtype=int)])
    order = np.lexsort(keys.T)
    repeated = np.zeros(len(triangles), dtype=bool)
    repeated[order[1:]] = (keys[order[1:]] == keys[order[:-1]]).all(axis=1)
    return triangles[~repeated]


def without_slivers(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """The same surface without triangles that have no area, as far as the edges beside them allow.

    A triangle without area is an edge that has a corner on one side and none on the other: the triangle on the other
    side is divided there instead (a flip of that edge), so that a closed mesh stays closed. On a rim it just goes.
    """
    size = float(np.ptp(vertices, axis=0).max())
    for _ in range(_ROUNDS):
        corners = vertices[triangles]
        edges = np.roll(corners, -1, axis=1) - corners
        lengths = np.linalg.norm(edges, axis=2)
        longest = lengths.argmax(axis=1)
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        flat = area <= FLAT * size * lengths.max(axis=1)
        changed = _flipped(triangles, np.nonzero(flat)[0], longest) if flat.any() else triangles
        if changed is triangles:
            break
        triangles = changed
        if len(triangles) == 0:
            break
    return _without_unused(vertices, triangles)


def _flipped(triangles: IntArray, slivers: NDArray[np.int64], longest: NDArray[np.int64]) -> IntArray:
    """Triangles after one round of flips; the same array where nothing could be done."""
    keys = pair_keys(directed_edges(triangles))
    order = np.argsort(keys, kind="stable")
    wanted = keys[3 * slivers + longest[slivers]]
    low, high = np.searchsorted(keys[order], wanted), np.searchsorted(keys[order], wanted, side="right")
    result, gone, is_sliver = triangles.copy(), [], set(slivers.tolist())
    busy: set[int] = set()
    for sliver, first, end in zip(slivers.tolist(), low.tolist(), high.tolist(), strict=True):
        if end - first == 1:
            gone.append(sliver)
        if end - first != 2 or sliver in busy:
            continue
        other = next((slot for slot in order[first:end].tolist() if slot // 3 != sliver), None)
        if other is None or other // 3 in busy:
            continue
        a, b, tip = np.roll(triangles[sliver], -longest[sliver]).tolist()
        start, end_of_other, across = np.roll(triangles[other // 3], -(other % 3)).tolist()
        if (start, end_of_other) != (b, a) or (other // 3 in is_sliver and across != tip):
            continue
        busy |= {sliver, other // 3}
        if across == tip:
            gone += [sliver, other // 3]
        else:
            result[sliver], result[other // 3] = (tip, a, across), (b, tip, across)
    return np.delete(result, gone, axis=0) if gone or busy else triangles


def _gap_corners(triangles: IntArray) -> NDArray[np.int64]:
    """Vertices on edges that an odd number of triangles meet, each triangle counted once."""
    edges = directed_edges(distinct(triangles, each_way=False))
    _, inverse, uses = np.unique(pair_keys(edges), return_inverse=True, return_counts=True)
    return np.unique(edges[uses[inverse.reshape(-1)] % 2 == 1]).astype(np.int64)


def _near(points: FloatArray, tolerance: float) -> NDArray[np.int64]:
    """Pairs of points within a tolerance of each other, shape (P, 2)."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(points).query_pairs(tolerance, output_type="ndarray"), dtype=np.int64).reshape(-1, 2)


def _joined(count: int, pairs: NDArray[np.int64] | IntArray) -> NDArray[np.int64]:
    """For every vertex the first of those that pairs join it to, shape (count,)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    if len(pairs) == 0:
        return np.arange(count)
    graph = coo_matrix((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    return np.asarray(first[label])


def _renamed(triangles: IntArray, same: NDArray[np.int64]) -> IntArray:
    """Triangles over what vertices are the same as; those with two corners in one are gone."""
    renamed = same[triangles].astype(np.int32)
    a, b, c = renamed.T
    return np.asarray(renamed[(a != b) & (b != c) & (c != a)])


def _without_unused(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    used, compact = np.unique(triangles, return_inverse=True)
    return vertices[used], compact.reshape(-1, 3).astype(np.int32)
