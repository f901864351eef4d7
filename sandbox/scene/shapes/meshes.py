"""Bodies from mesh files: shells, and lattices that carry the file's surface."""

import itertools

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.lattice import FloatArray, IntArray, build_lattice
from sandbox.scene.mesh_file import is_closed, load_mesh, signed_volume
from sandbox.scene.model import MOST_PARTICLES, Fill, Mesh
from sandbox.scene.shapes.geometry import Geometry, generate, lengths
from sandbox.scene.shapes.shells import surface_geometry
from sandbox.scene.shapes.voxels import inside_fraction


@generate.register
def _mesh(shape: Mesh, dimension: int) -> Geometry:
    vertices, triangles = load_mesh(shape.file, shape.scale)
    vertices = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    closed = is_closed(triangles)
    if shape.fill is Fill.SHELL:
        return surface_geometry(vertices, triangles, shape.thickness, shape.bend, closed=closed)
    if not closed:
        raise SceneError(f'{shape.file}: is not watertight, so nothing is inside it; close it or take fill = "shell"')
    return _filled(shape, vertices, triangles)


def _filled(shape: Mesh, vertices: FloatArray, triangles: IntArray) -> Geometry:
    """A lattice of cubes inside a closed mesh that is centred at the origin; the mesh rides on it."""
    extent = np.ptp(vertices, axis=0)
    spacing = float(extent.max()) / shape.cells
    cells = tuple(int(n) for n in np.maximum(np.round(extent / spacing), 1))
    if np.prod(cells, dtype=float) > MOST_PARTICLES:
        raise SceneError(
            f"{shape.file}: {shape.cells} cells along it make a grid of {np.prod(cells, dtype=float):.3g} cells, "
            f"at most {MOST_PARTICLES:.3g} are taken"
        )
    low = -0.5 * spacing * np.asarray(cells)
    occupied = _occupied(inside_fraction(vertices, triangles, low, spacing, cells), shape)
    lattice = build_lattice(occupied, (spacing,) * 3, shape.bracing)
    nodes, weights = _carried(vertices, lattice.points, occupied, low, spacing)
    return Geometry(
        points=lattice.points,
        springs=lattice.springs,
        rest_lengths=lengths(lattice.points, lattice.springs),
        spring_scale=lattice.spring_scale,
        mass_share=lattice.mass_share,
        volume=signed_volume(vertices, triangles),
        triangles=triangles + np.int32(len(lattice.points)),
        carried_nodes=nodes,
        carried_weights=weights,
        cells=lattice.corners,
    )


def _occupied(fraction: FloatArray, shape: Mesh) -> NDArray[np.bool_]:
    """Cells that are at least half inside; less where only that keeps the lattice in one piece."""
    from scipy import ndimage

    if not (fraction > 0.0).any():
        raise SceneError(f"{shape.file}: is thinner than half a cell everywhere; take more than {shape.cells} cells")
    pieces = 0
    for least in (4, 3, 2, 1):
        occupied = fraction > (least - 0.5) / 8.0
        # Cells that meet in a face only; an edge or a corner in common would be a hinge.
        _, pieces = ndimage.label(occupied)
        if pieces == 1:
            return np.asarray(occupied)
    raise SceneError(
        f"{shape.file}: falls into {pieces} pieces at {shape.cells} cells along it; take more cells, "
        "or a file and a body for every piece"
    )


def _carried(
    vertices: FloatArray, points: FloatArray, occupied: NDArray[np.bool_], low: FloatArray, spacing: float
) -> tuple[IntArray, FloatArray]:
    """Corners of the occupied cell nearest to every vertex, (V, 8), and their trilinear weights, (V, 8).

    A vertex outside its cell is extrapolated: weights still add up to 1, some are negative.
    """
    from scipy.spatial import cKDTree

    cells = np.argwhere(occupied)
    places = (vertices - low) / spacing
    cell = cells[cKDTree(cells + 0.5).query(places)[1]]
    index = np.full(tuple(n + 1 for n in occupied.shape), -1, dtype=np.int32)
    index[tuple(np.round((points - low) / spacing).astype(np.int64).T)] = np.arange(len(points))
    local = places - cell
    nodes, weights = [], []
    for corner in itertools.product((0, 1), repeat=3):
        nodes.append(index[tuple((cell + corner).T)])
        weights.append(np.where(corner, local, 1.0 - local).prod(axis=1))
    return np.stack(nodes, axis=1), np.stack(weights, axis=1)
