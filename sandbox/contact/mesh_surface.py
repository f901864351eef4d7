"""The surface of a closed mesh as searches want it: normals of faces, edges and corners, and which of them stick out.

Where a place is closest to an edge or a corner, the sum of the normals around it, weighted by their angles at a corner,
tells the outside from the inside; source: Baerentzen and Aanaes, IEEE Trans. Vis. Comput. Graph. 11, 2005.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.contact.triangle_tree import FloatArray, TriangleTree, build_tree
from sandbox.scene.lattice import IntArray
from sandbox.scene.topology import directed_edges, pair_keys

FLAT = 1e-4
"""Sine of the angle between two faces below which the edge between them is none [1]."""
_NOTHING = 1e-12
"""Size of a sum of normals that is rounding [1]."""
STICKS_OUT = (1, 2, 4, 8, 16, 32)
"""Marks of edges 0-1, 1-2, 2-0 and corners 0, 1, 2 that a ball can meet; each of one of its triangles only."""
COPLANAR = (64, 128, 256)
"""Marks of edges between faces of one plane."""
REVERSED = (512, 1024, 2048)
"""Marks of edges whose second vertex has the lower number: both triangles see such an edge alike by it."""


@dataclass(frozen=True)
class MeshSurface:
    """Triangles in the order of the leaves of their tree."""

    tree: TriangleTree
    corners: FloatArray
    """Corners [m], shape (T, 3, 3), counter-clockwise seen from outside."""
    normals: FloatArray
    """Unit normals, shape (T, 3)."""
    outward: FloatArray
    """Directions away from the solid at edges 0-1, 1-2, 2-0 and corners 0, 1, 2, shape (T, 6, 3)."""
    marks: NDArray[np.int32]
    """Sum of the marks of every triangle, shape (T,)."""


def unit_normals(corners: FloatArray) -> FloatArray:
    """Unit normals of triangles [1], shape (T, 3)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))


def mesh_surface(vertices: FloatArray, triangles: IntArray) -> MeshSurface:
    """The surface of a closed mesh that faces outward; no triangle is without area."""
    corners = vertices[triangles]
    normals = unit_normals(corners)
    edges, edge_marks = _edges(vertices, triangles, normals)
    around, corner_marks = _corners(vertices, triangles, normals, edge_marks)
    tree = build_tree(corners)
    backward = np.where(triangles > np.roll(triangles, -1, axis=1), REVERSED, 0).sum(axis=1)
    marks = np.asarray(edge_marks.sum(axis=1) + corner_marks + backward, dtype=np.int32)
    outward = np.concatenate([edges, around], axis=1)
    return MeshSurface(tree, corners[tree.order], normals[tree.order], outward[tree.order], marks[tree.order])


def loose_surface(corners: FloatArray) -> MeshSurface:
    """The surface of triangles [m], shape (T, 3, 3), that are only asked for the closest place."""
    tree = build_tree(corners)
    normals = unit_normals(corners)[tree.order]
    outward = np.repeat(normals[:, None], 6, axis=1)
    return MeshSurface(tree, corners[tree.order], normals, outward, np.zeros(len(corners), dtype=np.int32))


def _edges(vertices: FloatArray, triangles: IntArray, normals: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Normals at the edges of every triangle, shape (T, 3, 3), and their marks, shape (T, 3)."""
    directed = directed_edges(triangles)
    of = np.repeat(np.arange(len(triangles)), 3)
    _, first, same, uses = np.unique(pair_keys(directed), return_index=True, return_inverse=True, return_counts=True)
    total = np.stack([np.bincount(same, normals[of, axis]) for axis in range(3)], axis=1)[same]
    along = vertices[directed[:, 1]] - vertices[directed[:, 0]]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # The neighbour is what the sum holds besides the own normal, where there is just one.
    turn = np.einsum("ij,ij->i", np.cross(normals[of], total), along)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    folded = (size < 1.0)[:, 0]
    # Faces folded onto each other have no sum: outward is then away from both, in their plane.
    total = np.where(size > _NOTHING, total / np.maximum(size, _NOTHING), np.cross(along, normals[of]))
    pair = uses[same] == 2
    flat = pair & (np.abs(turn) <= FLAT) & ~folded
    meets = ~pair | (turn > FLAT) | (folded & (turn > -FLAT))
    own = np.zeros(len(directed), dtype=bool)
    own[first] = True
    marks = np.where((meets & own).reshape(-1, 3), STICKS_OUT[:3], 0) + np.where(flat.reshape(-1, 3), COPLANAR, 0)
    return np.asarray(total.reshape(-1, 3, 3), dtype=np.float64), np.asarray(marks, dtype=np.int64)


def _corners(
    vertices: FloatArray, triangles: IntArray, normals: FloatArray, edge_marks: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Normals at the corners of every triangle, shape (T, 3, 3), and marks of its corners, shape (T,)."""
    corners = vertices[triangles]
    onward, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    angle = np.arctan2(np.linalg.norm(np.cross(onward, back), axis=2), (onward * back).sum(axis=2))
    total = np.stack(
        [np.bincount(triangles.ravel(), (angle * normals[:, None, axis]).ravel(), len(vertices)) for axis in range(3)],
        axis=1,
    )
    size = np.linalg.norm(total, axis=1, keepdims=True)
    around = (total / np.maximum(size, _NOTHING))[triangles]
    around = np.where((size > _NOTHING)[triangles], around, normals[:, None])
    # A corner sticks out where an edge that does ends in it.
    out = np.zeros(len(vertices), dtype=bool)
    row, edge = np.nonzero(edge_marks & np.array(STICKS_OUT[:3]))
    out[triangles[row, edge]] = True
    out[triangles[row, (edge + 1) % 3]] = True
    vertex, first = np.unique(triangles.ravel(), return_index=True)
    marks = np.zeros(triangles.size, dtype=np.int64)
    marks[first] = np.where(out[vertex], np.array(STICKS_OUT[3:])[first % 3], 0)
    return around, marks.reshape(-1, 3).sum(axis=1)
