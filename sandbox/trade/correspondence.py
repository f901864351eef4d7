"""Where particles of one lattice lie in another one of the same bodies: for comparing runs of both.

Every particle of the other lattice is a weighted mean of particles of the first, by where both start: barycentric in
the tetrahedra (2D: triangles) of solids, on the triangles of shells, along ropes and rings. Weights add up to 1, so
that motions of a body that are linear in the place carry over exactly where the start does.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import Delaunay, cKDTree

from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Ring, Rope, Shell
from sandbox.trade.record import ENERGIES, Record

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEAREST = 24
"""Elements near a particle that are looked at where none holds it."""
_OUTSIDE = 1e-6
"""Weight below 0 that is rounding still [1]."""
_THIN = 1e-6
"""Extent over the largest one below which points lie in a plane or on a line [1]."""
_FLAT = 1e-9
"""Volume over edge^n below which an element is flat [1]."""
_POOR = 1e-3
"""Volume over edge^n below which an element is too flat to extrapolate from [1]."""


def correspondence(fine: Assembly, coarse: Assembly) -> sparse.csr_array | None:
    """Weights of the first assembly's particles for every particle of the second, shape (M, N), in scene order.

    Both are scenes of the same bodies, of which some may have other lattices. None where all particles are the same.
    """
    blocks = []
    pairs = list(zip(fine.scene.bodies, coarse.scene.bodies, strict=True))
    same = [one.shape == other.shape for one, other in pairs]
    if all(same):
        return None
    for body, (ours, theirs) in enumerate(zip(_points(fine), _points(coarse), strict=True)):
        blocks.append(sparse.eye_array(len(ours), format="csr") if same[body] else _weights(fine, body, ours, theirs))
    return sparse.csr_array(sparse.block_diag(blocks, format="csr"))


def mapped(reference: Record, run: Record, weights: sparse.csr_array | None) -> Record:
    """A reference as seen from another lattice: its positions there, and its energies from the same level.

    Where a lattice is made of other particles its potential energies start at another value, which means nothing.
    """
    if weights is None:
        return reference
    offset = run.energies[0] - reference.energies[0]
    offset[ENERGIES.index("kinetic")] = 0.0
    positions = np.stack([weights @ sample for sample in reference.positions])
    return replace(reference, positions=positions, energies=reference.energies + offset)


def _points(assembly: Assembly) -> list[FloatArray]:
    """Start positions of every body [m], in the scene's order."""
    points = assembly.scene_order(assembly.positions)
    counts = np.bincount(assembly.particle_body, minlength=len(assembly.scene.bodies))
    return np.split(points, np.cumsum(counts)[:-1])


def _weights(assembly: Assembly, body: int, points: FloatArray, wanted: FloatArray) -> sparse.csr_array:
    match assembly.scene.bodies[body].shape:
        case Rope():
            return _along(np.linspace(0.0, 1.0, len(points)), np.linspace(0.0, 1.0, len(wanted)), len(points))
        case Ring():
            # One more point at the end, which is the first.
            there = np.arange(len(wanted)) / len(wanted)
            return _along(np.linspace(0.0, 1.0, len(points) + 1), there, len(points))
        case Shell():
            return _on_triangles(points, _triangles(assembly, body), wanted)
        case _:
            return _in_simplices(points, wanted)


def _along(places: FloatArray, wanted: FloatArray, count: int) -> sparse.csr_array:
    """Linear interpolation between rising places; nodes from ``count`` on are the first ones again."""
    start = np.clip(np.searchsorted(places, wanted, side="right") - 1, 0, len(places) - 2)
    part = (wanted - places[start]) / (places[start + 1] - places[start])
    return _matrix(np.stack([start, start + 1], axis=1) % count, np.stack([1.0 - part, part], axis=1), count)


def _triangles(assembly: Assembly, body: int) -> IntArray:
    """Triangles of a body that is a surface, in its own particles, shape (T, 3)."""
    look = assembly.appearance
    own: IntArray = assembly.order[look.triangles[look.triangle_body == body]]
    return own - int((assembly.particle_body < body).sum())


def _on_triangles(points: FloatArray, triangles: IntArray, wanted: FloatArray) -> sparse.csr_array:
    """Barycentric weights of the nearest point on a surface."""
    from trimesh.triangles import closest_point, points_to_barycentric

    count = min(_NEAREST, len(triangles))
    near = cKDTree(points[triangles].mean(axis=1)).query(wanted, k=count)[1].reshape(-1)
    closest = closest_point(points[triangles[near]], np.repeat(wanted, count, axis=0)).reshape(-1, count, 3)
    best = np.linalg.norm(closest - wanted[:, None], axis=2).argmin(axis=1)
    rows = np.arange(len(wanted))
    chosen = triangles[near.reshape(-1, count)[rows, best]]
    weights = points_to_barycentric(points[chosen], closest[rows, best])
    return _matrix(chosen, np.clip(weights, 0.0, 1.0), len(points))


def _in_simplices(points: FloatArray, wanted: FloatArray) -> sparse.csr_array:
    """Barycentric weights in the tetrahedron or triangle that holds a place, or else in a near one of good shape.

    In a lattice many corners lie on one sphere, and some elements between them are flat: those are no use.
    """
    middle, axes = _axes(points)
    points, wanted = (points - middle) @ axes, (wanted - middle) @ axes
    if points.shape[1] == 1:
        order = np.argsort(points[:, 0])
        line = _along(points[order, 0], wanted[:, 0], len(points))
        return line[:, np.argsort(order)]
    mesh = Delaunay(points)
    corners = np.asarray(mesh.simplices, dtype=np.int64)
    held = mesh.find_simplex(wanted, tol=_FLAT)
    weights = _barycentric(points[corners[held]], wanted)
    nodes = corners[held]
    unheld = (held < 0) | ~(weights.min(axis=1) > -_OUTSIDE)
    if unheld.any():
        nodes[unheld], weights[unheld] = _extrapolated(points, corners, wanted[unheld])
    return _matrix(nodes, weights, len(points))


def _axes(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle of some points, and orthonormal axes of the line, plane or space that they fill, shape (d, rank)."""
    middle = points.mean(axis=0)
    # Squares of three columns: a decomposition of all rows would occupy every core, for much longer if it has to wait.
    squares = np.einsum("ni,nj->ij", points - middle, points - middle)
    extents, axes = np.linalg.eigh(squares)
    return middle, axes[:, extents > _THIN**2 * extents[-1]]


def _extrapolated(points: FloatArray, corners: IntArray, wanted: FloatArray) -> tuple[IntArray, FloatArray]:
    """Nodes and weights of the element, of those near a place, out of which it is the least."""
    edges = points[corners[:, 1:]] - points[corners[:, :1]]
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    good = corners[np.abs(np.linalg.det(edges)) > _POOR * longest ** points.shape[1]]
    count = min(_NEAREST, len(good))
    near = cKDTree(points[good].mean(axis=1)).query(wanted, k=count)[1].reshape(len(wanted), count)
    weights = _barycentric(points[good[near]], wanted[:, None])
    best = weights.min(axis=2).argmax(axis=1)
    rows = np.arange(len(wanted))
    return good[near[rows, best]], weights[rows, best]


def _barycentric(corners: FloatArray, places: FloatArray) -> FloatArray:
    """Weights of corners, shape (..., n + 1, n), that give the places, (..., n); nan where an element is flat."""
    edges = np.swapaxes(corners[..., 1:, :] - corners[..., :1, :], -1, -2)
    size = np.abs(edges).max(axis=(-1, -2), initial=0.0)
    flat = np.abs(np.linalg.det(edges)) <= _FLAT * size ** edges.shape[-1]
    edges = np.where(flat[..., None, None], np.eye(edges.shape[-1]), edges)
    rest = np.linalg.solve(edges, (places - corners[..., 0, :])[..., None])[..., 0]
    weights = np.concatenate([1.0 - rest.sum(axis=-1, keepdims=True), rest], axis=-1)
    return np.where(flat[..., None], np.nan, weights)


def _matrix(nodes: IntArray, weights: FloatArray, count: int) -> sparse.csr_array:
    """Rows of weights at nodes as a matrix."""
    rows = np.repeat(np.arange(len(nodes)), nodes.shape[1])
    entries = (weights.reshape(-1), (rows, nodes.reshape(-1)))
    return sparse.csr_array(sparse.coo_array(entries, shape=(len(nodes), count)))
