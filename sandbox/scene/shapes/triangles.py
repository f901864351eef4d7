"""Triangle meshes as springs: edges, areas, and how stiff each edge must be."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.shapes.geometry import lengths, no_elements
from sandbox.scene.topology import directed_edges, pair_keys

# Bend springs of equilateral triangles form a lattice of their own, sqrt(3) times as wide, with as many
# springs: it is 3 times as stiff as the edges' at the same spring stiffness.
_BEND_SHARE = 3.0


@dataclass(frozen=True)
class Edges:
    """Edges of a triangle mesh."""

    pairs: IntArray
    """Ends of every edge, each edge once, lower index first, shape (E, 2)."""
    of_triangle: NDArray[np.int64]
    """Edges (0-1, 1-2, 2-0) of every triangle, shape (T, 3)."""
    uses: NDArray[np.int64]
    """How many triangles have each edge, shape (E,)."""


@dataclass(frozen=True)
class TriangleSprings:
    """Springs of a triangulated membrane."""

    springs: IntArray
    """Pairs of points: edges, then bend springs, shape (S, 2)."""
    scale: FloatArray
    """Stiffness over Young's modulus [m], shape (S,)."""
    ratio: FloatArray | None
    """Stiffness over that of structural springs where all of those are equal [1], shape (S,); None without bend."""


def find_edges(triangles: IntArray) -> Edges:
    """Edges of the triangles, sorted by their ends."""
    directed = directed_edges(triangles)
    keys, inverse, uses = np.unique(pair_keys(directed), return_inverse=True, return_counts=True)
    pairs = np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1).astype(np.int32)
    return Edges(pairs=pairs, of_triangle=inverse.reshape(-1, 3), uses=uses)


def open_edges(triangles: IntArray) -> IntArray:
    """Edges with a triangle on one side only, in the direction of that triangle, shape (E, 2)."""
    if len(triangles) == 0:
        return no_elements(2)
    edges = find_edges(triangles)
    directed = directed_edges(triangles)
    return np.asarray(directed[edges.uses[edges.of_triangle.reshape(-1)] == 1], dtype=np.int32)


def counter_clockwise(points: FloatArray, triangles: IntArray) -> IntArray:
    """The same 2D triangles, clockwise ones turned round, shape (T, 3)."""
    clockwise = signed_areas(points, triangles) < 0.0
    return np.where(clockwise[:, None], triangles[:, ::-1], triangles)


def signed_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Areas of 2D triangles, positive counter-clockwise [m^2], shape (T,)."""
    ab, ac = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    return np.asarray(0.5 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]))


def triangle_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Areas of 2D or 3D triangles [m^2], shape (T,)."""
    if points.shape[1] == 2:
        return np.abs(signed_areas(points, triangles))
    ab, ac = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    return np.asarray(0.5 * np.linalg.norm(np.cross(ab, ac), axis=1))


def mass_shares(point_count: int, triangles: IntArray, areas: FloatArray) -> FloatArray:
    """Fraction of the area at every point, a third of each triangle around it, shape (N,)."""
    share = np.bincount(triangles.reshape(-1), np.repeat(areas / 3.0, 3), minlength=point_count)
    return np.asarray(share / areas.sum())


def membrane_springs(points: FloatArray, triangles: IntArray, thickness: float, bend: float = 0.0) -> TriangleSprings:
    """Springs along all edges, and with ``bend`` > 0 across them, that together stretch like a membrane.

    An edge of length L has k = E t (sum of the areas of its triangles) / L^2, which is exact for equilateral
    triangles, with Poisson's ratio 1/3. Source: A. Van Gelder, "Approximate simulation of elastic membranes by
    triangulated spring meshes", Journal of Graphics Tools 3(2), 1998. With bend springs the edges are softened by
    1 / (1 + 3 bend), so that Young's modulus stays the same. ``thickness`` t in [m].
    """
    edges = find_edges(triangles)
    areas = triangle_areas(points, triangles)
    around = np.bincount(edges.of_triangle.reshape(-1), np.repeat(areas, 3), minlength=len(edges.pairs))
    scale = thickness * around / lengths(points, edges.pairs) ** 2
    if bend <= 0.0:
        return TriangleSprings(springs=edges.pairs, scale=scale, ratio=None)
    scale /= 1.0 + _BEND_SHARE * bend
    across, near = _across(triangles, edges)
    return TriangleSprings(
        springs=np.concatenate([edges.pairs, across]),
        scale=np.concatenate([scale, bend * scale[near].mean(axis=1)]),
        ratio=np.repeat([1.0, bend], [len(edges.pairs), len(across)]),
    )


def _across(triangles: IntArray, edges: Edges) -> tuple[IntArray, NDArray[np.int64]]:
    """Opposite corners of every two triangles with a common edge, (B, 2), and the edges of both triangles, (B, 6).

    The common edge comes twice among them. Pairs that are edges already, or pairs already, are left out.
    """
    slot = np.argsort(edges.of_triangle.reshape(-1), kind="stable")
    first = np.concatenate([[0], np.cumsum(edges.uses)[:-1]])[edges.uses == 2]
    sides = np.stack([slot[first], slot[first + 1]], axis=1)  # slot = 3 * triangle + side
    corners = triangles[sides // 3, (sides % 3 + 2) % 3]
    _, earliest = np.unique(pair_keys(np.concatenate([edges.pairs, corners])), return_index=True)
    row = np.sort(earliest[earliest >= len(edges.pairs)]) - len(edges.pairs)
    row = row[corners[row, 0] != corners[row, 1]]
    near = edges.of_triangle[sides[row] // 3].reshape(-1, 6)
    return np.sort(corners[row], axis=1).astype(np.int32), near
