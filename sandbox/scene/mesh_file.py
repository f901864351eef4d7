"""Triangle meshes from files: read, cleaned, facing outward.

SciPy and trimesh take half a second each to import, and most scenes need neither: the functions that do import them.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.topology import directed_edges, pair_keys

MOST_TRIANGLES = 5_000_000
"""Most triangles of a mesh file."""
_GRID = 2.0**20
"""Places along the mesh's size that are told apart: STL keeps about as many, and three numbers fit into 63 bits."""

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


def load_mesh(file: str, scale: float) -> tuple[FloatArray, IntArray]:
    """Vertices [m], shape (V, 3), and triangles, shape (T, 3), of a mesh file (OBJ, PLY, STL, ...).

    ``scale`` leads from the file's units to metres; the file's own origin is kept. All parts of the file make one
    mesh; vertices at the same place are one; triangles without area and repeated ones are gone. Neighbouring
    triangles face the same way, and a closed mesh faces outward (the walls of a hollow inside it inward).
    Raises SceneError ``FILE: what is wrong``.
    """
    vertices, triangles = _read(file)
    if len(triangles) == 0:
        raise SceneError(f"{file}: has no triangles")
    if len(triangles) > MOST_TRIANGLES:
        raise SceneError(f"{file}: has {len(triangles)} triangles, at most {MOST_TRIANGLES} are taken")
    vertices = vertices * scale
    if not np.isfinite(vertices[triangles]).all():
        raise SceneError(f"{file}: has a vertex that is not finite")
    vertices, triangles = _clean(vertices, triangles)
    if len(triangles) == 0:
        raise SceneError(f"{file}: has no triangle with an area")
    return vertices, _face_outward(vertices, triangles)


def is_closed(triangles: IntArray) -> bool:
    """True where every edge is used exactly twice, in opposite directions: the mesh has an inside."""
    directed = directed_edges(triangles).astype(np.int64)
    forward = np.sort((directed[:, 0] << 32) | directed[:, 1])
    backward = np.sort((directed[:, 1] << 32) | directed[:, 0])
    once = bool((np.diff(forward) > 0).all())
    return len(triangles) > 0 and once and np.array_equal(forward, backward)


def signed_volume(vertices: FloatArray, triangles: IntArray) -> float:
    """Volume of a closed mesh [m^3], positive where it faces outward (Gauss's theorem)."""
    return float(_tetrahedra(vertices, triangles).sum())


def _tetrahedra(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """Signed volumes of the triangles' tetrahedra with the mesh's middle [m^3], shape (T,)."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(axis=0) for k in range(3))
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


def _read(file: str) -> tuple[FloatArray, IntArray]:
    import trimesh

    # Materials of an OBJ are files of their own, and nobody looks at them.
    options: dict[str, Any] = {"skip_materials": True} if file.lower().endswith(".obj") else {}
    try:
        with open(file, "rb"):
            pass
        mesh = trimesh.load(file, force="mesh", process=False, **options)
        # Anything without faces, such as a cloud of points, is a mesh without triangles.
        faces = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))), dtype=np.int64).reshape(-1, 3)
        vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    except OSError as error:
        raise SceneError(f"{file}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # readers of broken files raise whatever broke
        raise SceneError(f"{file}: is not a mesh that can be read: {error or type(error).__name__}") from None
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise SceneError(f"{file}: a triangle names a vertex that is not there")
    return vertices, faces.astype(np.int32)


def _clean(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """One vertex a place, no triangle without area, none twice, no vertex unused; order otherwise kept."""
    used = np.unique(triangles)
    vertices, triangles = vertices[used], np.searchsorted(used, triangles).astype(np.int32)
    size = float(np.ptp(vertices, axis=0).max())
    if size == 0.0:
        return vertices, np.zeros((0, 3), dtype=np.int32)
    place = np.round((vertices - vertices.min(axis=0)) * (_GRID / size)).astype(np.int64)
    keys = (place[:, 0] << 42) | (place[:, 1] << 21) | place[:, 2]
    _, first, same = np.unique(keys, return_index=True, return_inverse=True)
    triangles = first[same.reshape(-1)][triangles].astype(np.int32)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    triangles = triangles[np.linalg.norm(np.cross(b - a, c - a), axis=1) > (size / _GRID) ** 2]
    corners = np.sort(triangles, axis=1)
    order = np.lexsort(corners.T)
    repeated = np.zeros(len(triangles), dtype=bool)
    repeated[order[1:]] = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    triangles = triangles[~repeated]
    used, compact = np.unique(triangles, return_inverse=True)
    return vertices[used], compact.reshape(-1, 3).astype(np.int32)


def _face_outward(vertices: FloatArray, triangles: IntArray) -> IntArray:
    """Neighbouring triangles turned to face the same way, closed parts outward."""
    flip, part = _consistent(triangles)
    triangles = np.where(flip[:, None], triangles[:, ::-1], triangles)
    if not is_closed(triangles):
        return triangles
    wanted = np.where(_depths(vertices, triangles, part) % 2 == 0, 1.0, -1.0)
    volumes = np.bincount(part, _tetrahedra(vertices, triangles))
    return np.where((volumes * wanted < 0.0)[part][:, None], triangles[:, ::-1], triangles)


def _consistent(triangles: IntArray) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which triangles to turn so that neighbours agree, and the connected part of every triangle, both (T,).

    Every triangle is a node twice, as it is and turned. Neighbours that agree are joined as (as it is, as it is)
    and (turned, turned), others crosswise; of the two halves that a part falls into, the one that turns fewer
    triangles is taken. A part that falls into one, such as a Moebius strip, is left as it is.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(triangles)
    directed = directed_edges(triangles).astype(np.int64)
    keys = pair_keys(directed)
    order = np.argsort(keys, kind="stable")
    _, start, uses = np.unique(keys[order], return_index=True, return_counts=True)
    one, other = order[start[uses == 2]], order[start[uses == 2] + 1]
    crossed = directed[one, 0] == directed[other, 0]
    one, other = one // 3, other // 3
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * crossed, other + count * ~crossed])
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    _, label = connected_components(graph, directed=False)
    as_is, turned = label[:count], label[count:]
    halves = np.stack([np.minimum(as_is, turned), np.maximum(as_is, turned)], axis=1)
    _, part = np.unique(halves[:, 0], return_inverse=True)
    flip = as_is > turned
    many = np.bincount(part, flip) > 0.5 * np.bincount(part)
    return (flip ^ many[part]) & (as_is != turned), part.reshape(-1)


def _depths(vertices: FloatArray, triangles: IntArray, part: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many other closed parts each part of a mesh lies in, shape (part_count,)."""
    count = int(part.max()) + 1
    order = np.argsort(part, kind="stable")
    groups = np.split(triangles[order], np.cumsum(np.bincount(part))[:-1])
    low = np.array([vertices[group].min(axis=(0, 1)) for group in groups])
    high = np.array([vertices[group].max(axis=(0, 1)) for group in groups])
    depths = np.zeros(count, dtype=np.int64)
    for inner in range(count):
        around = (low <= low[inner]).all(axis=1) & (high[inner] <= high).all(axis=1)
        around[inner] = False
        point = vertices[groups[inner][0, 0]]
        depths[inner] = sum(abs(_winding(point, vertices, groups[outer])) > 0.5 for outer in np.nonzero(around)[0])
    return depths


def _winding(point: FloatArray, vertices: FloatArray, triangles: IntArray) -> float:
    """How often a closed mesh winds around a point: 1 inside, 0 outside.

    Sum of the triangles' solid angles; source: Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30, 1983.
    """
    a, b, c = (vertices[triangles[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(edge, axis=1) for edge in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a))]
    angle = 2.0 * np.arctan2(triple, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    return float(angle.sum() / (4.0 * np.pi))
