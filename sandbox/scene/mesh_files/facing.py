"""Which way the triangles of a mesh face, what they enclose, and where they do not close."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.topology import directed_edges, pair_keys

Numbers = NDArray[np.int64]
MaskArray = NDArray[np.bool_]

_LOOKS = 64
"""About how many vertices of a part are looked at to see whether it lies in another one."""
_RAYS = 3
"""From how many triangles of a patch one looks for what is before it."""
_ASKEW = (0.0731, 0.1093, -0.0517)
"""By how much rays are off the normal: they are not to meet edges of what lies straight before them."""
_WITHIN, _ON = 0.75, 0.05
"""A mesh winds around a point inside once, around one on a face half, on an edge or at a corner some part of that."""


@dataclass(frozen=True)
class _EdgeTable:
    """Edges of triangles, each once whichever way it is passed."""

    of_side: Numbers
    """Edge of every side 0-1, 1-2, 2-0 of one triangle after the other, shape (3 T,)."""
    way: Numbers
    """1 where a side passes its edge from the lower vertex, else -1, shape (3 T,)."""
    uses: Numbers
    """How many triangles have each edge, shape (E,)."""
    net: Numbers
    """How many more pass it the one way than the other, shape (E,)."""

    @classmethod
    def of(cls, triangles: IntArray) -> "_EdgeTable":
        sides = directed_edges(triangles)
        _, inverse, uses = np.unique(pair_keys(sides), return_inverse=True, return_counts=True)
        way = np.where(sides[:, 0] < sides[:, 1], 1, -1)
        net = np.bincount(inverse.reshape(-1), way, minlength=len(uses)).astype(np.int64)
        return cls(inverse.reshape(-1), way, uses, net)


def is_closed(triangles: IntArray) -> bool:
    """True where every directed edge is met as often as its reverse: the mesh has an inside."""
    return len(triangles) > 0 and not _EdgeTable.of(triangles).net.any()


def signed_volume(vertices: FloatArray, triangles: IntArray) -> float:
    """Volume of a closed mesh [m^3], positive where it faces outward (Gauss's theorem); overlaps count twice."""
    return float(_tetrahedra(vertices, triangles).sum())


def gaps(vertices: FloatArray, triangles: IntArray) -> str:
    """Why a mesh is not closed, and near which place, in the units of its vertices; "" where it is."""
    table = _EdgeTable.of(triangles)
    sides, bad = directed_edges(triangles), table.net != 0
    reasons, places = [], []
    for chosen, said in (
        (table.uses == 1, "{} with a triangle on one side only"),
        (table.uses == 2, "{} with both triangles on the same side, as a Moebius strip has"),
        (table.uses > 2, "{} where {} triangles meet whose sides do not pair up"),
    ):
        edges = np.nonzero(bad & chosen)[0]
        if len(edges):
            count = f"{len(edges)} edge{'' if len(edges) == 1 else 's'}"
            most = table.uses[edges]
            reasons.append(
                said.format(count, most.max() if (most == most[0]).all() else f"{most.min()} to {most.max()}")
            )
            places.append(vertices[sides[np.argmax(table.of_side == edges[0])]].mean(axis=0))
    return f"{' and '.join(reasons)}, one near ({', '.join(f'{x:.4g}' for x in places[0])})" if reasons else ""


def face_outward(vertices: FloatArray, triangles: IntArray) -> tuple[IntArray, int]:
    """Neighboring triangles turned to face the same way, closed parts outward, and walls of hollows inward.

    And how many hollows there are whose walls the file has facing outward. A part that lies in another one is a
    hollow; one that only overlaps another is not.
    """
    flip, patch = _consistent(triangles)
    triangles = np.where(flip[:, None], triangles[:, ::-1], triangles)
    if not is_closed(triangles):
        flip = _looks_inward(vertices, triangles, patch)
        triangles = np.where(flip[patch][:, None], triangles[:, ::-1], triangles)
        if not is_closed(triangles):
            return triangles, 0
    part = _parts(triangles, patch)
    volumes = np.asarray(np.bincount(part, _tetrahedra(vertices, triangles)), dtype=np.float64)
    inward = _depths(vertices, triangles, part, volumes) % 2 == 1
    turned = np.where(inward, volumes > 0.0, volumes < 0.0)
    hollows = 0 if turned[~inward].any() else int(turned.sum())
    return np.where(turned[part][:, None], triangles[:, ::-1], triangles), hollows


def encloses(vertices: FloatArray, triangles: IntArray) -> bool:
    """Whether a mesh is closed, and more than sheets with two faces: then so is what is left without these."""
    if not is_closed(triangles):
        return False
    odd = (np.diff(triangles[:, [0, 1, 2, 0]], axis=1) > 0).sum(axis=1) == 1
    _, same = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True)
    same = same.reshape(-1)
    triangles = triangles[np.bincount(same, np.where(odd, 1, -1))[same] != 0]
    if not is_closed(triangles):
        return False
    size = float(np.ptp(vertices, axis=0).max())
    volumes = np.bincount(_parts(triangles, _consistent(triangles)[1]), _tetrahedra(vertices, triangles))
    return bool((np.abs(volumes) > 1e-12 * size**3).any())


def _tetrahedra(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """Signed volumes of the triangles' tetrahedra with the mesh's middle [m^3], shape (T,)."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(axis=0) for k in range(3))
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


def _consistent(triangles: IntArray) -> tuple[MaskArray, Numbers]:
    """Which triangles to turn so that neighbors agree, and the patch of every triangle, both (T,).

    A patch is what edges of exactly two triangles join. Every triangle is a node twice, as it is and turned. Neighbors
    that agree are joined as (as it is, as it is) and (turned, turned), others crosswise; of the two halves that a patch
    falls into, the one that turns fewer triangles is taken. A patch that falls into one, such as a Moebius strip, is
    left as it is.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    table, count = _EdgeTable.of(triangles), len(triangles)
    slots = np.argsort(table.of_side, kind="stable")
    first = (np.cumsum(table.uses) - table.uses)[table.uses == 2]
    one, other = slots[first], slots[first + 1]
    crossed = table.way[one] == table.way[other]
    one, other = one // 3, other // 3
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * crossed, other + count * ~crossed])
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    _, label = connected_components(graph, directed=False)
    as_is, turned = label[:count], label[count:]
    _, patch = np.unique(np.minimum(as_is, turned), return_inverse=True)
    patch = patch.reshape(-1)
    flip = as_is > turned
    many = np.bincount(patch, flip) > 0.5 * np.bincount(patch)
    return (flip ^ many[patch]) & (as_is != turned), patch


def _loose_patches(triangles: IntArray, patch: Numbers) -> MaskArray:
    """True for patches that are not closed by themselves: they end at edges of more than two triangles, shape (P,)."""
    table, count = _EdgeTable.of(triangles), int(patch.max()) + 1
    # Of every edge and every patch at it, how many more sides pass it the one way.
    both, inverse = np.unique(table.of_side * count + np.repeat(patch, 3), return_inverse=True)
    net = np.bincount(inverse.reshape(-1), table.way)
    loose = np.zeros(count, dtype=bool)
    loose[both[(net != 0) & (table.uses[both // count] > 2)] % count] = True
    return loose


def _looks_inward(vertices: FloatArray, triangles: IntArray, patch: Numbers) -> MaskArray:
    """Loose patches that face what the mesh encloses, shape (P,).

    How those that meet at an edge belong together cannot be told from the edge: rays tell inside from outside.
    """
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    loose = _loose_patches(triangles, patch)
    inward = np.zeros(len(loose), dtype=bool)
    for own in np.nonzero(loose)[0]:
        rows = np.nonzero(patch == own)[0]
        largest = rows[np.argsort(-area[rows], kind="stable")[:_RAYS]]
        odd = [_crossings(corners, row, normal[row] / max(area[row], 1e-300)) % 2 for row in largest]
        inward[own] = 2 * sum(odd) > len(odd)
    return inward


def _crossings(corners: FloatArray, row: int, normal: FloatArray) -> int:
    """How often a ray from the middle of one triangle, on the side that it faces, meets the others.

    Source: T. Moeller and B. Trumbore, Journal of Graphics Tools 2(1), 1997.
    """
    start, way = corners[row].mean(axis=0), normal + np.array(_ASKEW)
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(way, two)
    volume = (one * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        away = start - corners[:, 0]
        u = (away * across).sum(axis=1) / volume
        turned = np.cross(away, one)
        v = turned @ way / volume
        met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & ((two * turned).sum(axis=1) / volume > 0.0)
    met[row] = False
    return int(met.sum())


def _parts(triangles: IntArray, patch: Numbers) -> Numbers:
    """Part of every triangle of a closed mesh, each closed by itself, shape (T,).

    Patches that are closed by themselves are parts. At the edges of others, triangles that pass it the one way are
    paired, in the order of the file, with those that pass it the other way: files have parts one after the other.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    table, count = _EdgeTable.of(triangles), len(triangles)
    loose = _loose_patches(triangles, patch)
    rank = np.repeat(np.where(loose[patch], len(loose), patch), 3)
    order = np.lexsort([rank, table.of_side])
    one, other = (order[table.way[order] == way] // 3 for way in (-1, 1))
    graph = coo_matrix((np.ones(len(one), dtype=np.int8), (one, other)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _depths(vertices: FloatArray, triangles: IntArray, part: Numbers, volumes: FloatArray) -> Numbers:
    """How many other closed parts each part of a mesh lies in with all of it, shape (part_count,).

    One that touches the other from inside lies in it where the file has them face opposite ways.
    """
    count = int(part.max()) + 1
    order = np.argsort(part, kind="stable")
    groups = np.split(triangles[order], np.cumsum(np.bincount(part))[:-1])
    low = np.array([vertices[group].min(axis=(0, 1)) for group in groups])
    high = np.array([vertices[group].max(axis=(0, 1)) for group in groups])
    depths = np.zeros(count, dtype=np.int64)
    for inner in range(count):
        around = (low <= low[inner]).all(axis=1) & (high[inner] <= high).all(axis=1)
        around[inner] = False
        if around.any():
            points = _looked_at(vertices[np.unique(groups[inner])])
            for outer in np.nonzero(around)[0]:
                opposed = volumes[inner] * volumes[outer] < 0.0
                least = _ON if opposed else _WITHIN
                depths[inner] += all(abs(_winding(point, vertices, groups[outer])) > least for point in points)
    return depths


def _looked_at(points: FloatArray) -> FloatArray:
    """Some of the points [m]: every so many, and the outermost ones, which would be the first to stick out."""
    ways = np.array(list(itertools.product((-1, 0, 1), repeat=3)))
    chosen = [*range(0, len(points), max(1, len(points) // _LOOKS)), *(points @ ways.T).argmax(axis=0)]
    return np.asarray(points[np.unique(chosen)])


def _winding(point: FloatArray, vertices: FloatArray, triangles: IntArray) -> float:
    """How often a closed mesh winds around a point: 1 inside, 0 outside, 1/2 on a face.

    Sum of the triangles' solid angles; source: Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30, 1983.
    """
    a, b, c = (vertices[triangles[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(edge, axis=1) for edge in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a))]
    angle = 2.0 * np.arctan2(triple, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    return float(angle.sum() / (4.0 * np.pi))
