"""Bodies from mesh files: shells, and lattices that carry the file's surface."""

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.lattice import FloatArray, IntArray, build_lattice
from sandbox.scene.mesh_file import Surface, load_surface
from sandbox.scene.mesh_files.union import union_volume
from sandbox.scene.model import MOST_PARTICLES, Fill, Mesh
from sandbox.scene.shapes.geometry import Geometry, generate, lengths
from sandbox.scene.shapes.shells import surface_geometry
from sandbox.scene.shapes.voxels import inside_fraction

_MOST_OUTSIDE = 1.0
"""By how many cells a surface may leave the cell that carries it without a word."""


@generate.register
def _mesh(shape: Mesh, dimension: int) -> Geometry:
    surface = load_surface(shape)
    if shape.fill is Fill.SHELL:
        geometry = surface_geometry(
            surface.vertices, surface.triangles, shape.thickness, shape.bend, closed=not surface.gaps
        )
        return replace(geometry, remarks=surface.remarks)
    if surface.gaps:
        raise SceneError(
            f"{shape.file}: is not watertight, so nothing is inside it: it has {surface.gaps}; "
            'close it or take fill = "shell"'
        )
    return _filled(shape, surface)


def _filled(shape: Mesh, surface: Surface) -> Geometry:
    """A lattice of cubes inside a closed mesh, about the middle of its box; the mesh rides on it."""
    vertices, triangles, middle = surface.vertices - surface.middle, surface.triangles, surface.middle
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
    nodes, weights, outside = _carried(vertices, lattice.points, occupied, low, spacing)
    remarks = surface.remarks
    if (outside > _MOST_OUTSIDE).any():
        worst, count = int(outside.argmax()), int((outside > _MOST_OUTSIDE).sum())
        place = ", ".join(f"{x:.3g}" for x in vertices[worst] + middle)
        remarks += (
            f"{shape.file}: {count} of {len(vertices)} surface points hang on cells that are more than a cell of "
            f"{spacing:.2g} m away (up to {outside.max():.1f} cells, near ({place}) m of the shape), for the mesh is "
            f"thinner than a cell there; take more than {shape.cells} cells",
        )
    return Geometry(
        points=lattice.points + middle,
        springs=lattice.springs,
        rest_lengths=lengths(lattice.points, lattice.springs),
        spring_scale=lattice.spring_scale,
        mass_share=lattice.mass_share,
        volume=union_volume(vertices, triangles),
        triangles=triangles + np.int32(len(lattice.points)),
        carried_nodes=nodes,
        carried_weights=weights,
        cells=lattice.corners,
        remarks=remarks,
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
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Corners of the occupied cell nearest to every vertex, (V, 8), and their trilinear weights, (V, 8).

    A vertex outside its cell is extrapolated: weights still add up to 1, some are negative. By how many cells it is
    outside along one axis, at most, comes last, (V,).
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
    outside = np.maximum(np.abs(local - 0.5).max(axis=1) - 0.5, 0.0)
    return np.stack(nodes, axis=1), np.stack(weights, axis=1), outside
