"""Boxes, balls and sheets: bodies made of equal cells."""

import numpy as np

from sandbox.scene.lattice import FloatArray, Lattice, build_lattice
from sandbox.scene.model import Ball, Box, Sheet
from sandbox.scene.shapes.geometry import Geometry, generate, lengths, no_elements


@generate.register
def _box(shape: Box, dimension: int) -> Geometry:
    spacing = tuple(s / n for s, n in zip(shape.size, shape.cells, strict=True))
    lattice = build_lattice(np.ones(shape.cells, dtype=bool), spacing, shape.bracing, shape.bend)
    return _solid(lattice, lattice.points, float(np.prod(shape.size)))


@generate.register
def _ball(shape: Ball, dimension: int) -> Geometry:
    spacing = 2.0 * shape.radius / shape.cells
    centres = (np.indices((shape.cells,) * dimension) + 0.5) * spacing - shape.radius
    occupied = np.linalg.norm(centres, axis=0) <= shape.radius
    lattice = build_lattice(occupied, (spacing,) * dimension, shape.bracing)
    points = lattice.points.copy()
    # The rim of the staircase is drawn onto the sphere; inside, the lattice stays as it is.
    rim = np.unique(lattice.faces)
    points[rim] *= shape.radius / np.linalg.norm(points[rim], axis=1, keepdims=True)
    volume = np.pi * shape.radius**2 * (4.0 / 3.0 * shape.radius if dimension == 3 else 1.0)
    return _solid(lattice, points, volume)


def _solid(lattice: Lattice, points: FloatArray, volume: float) -> Geometry:
    flat = points.shape[1] == 2
    return Geometry(
        points=points,
        springs=lattice.springs,
        rest_lengths=lengths(points, lattice.springs),
        spring_scale=lattice.spring_scale,
        spring_ratio=lattice.spring_ratio,
        mass_share=lattice.mass_share,
        volume=volume,
        triangles=lattice.cells if flat else lattice.faces,
        outline=lattice.faces if flat else no_elements(2),
        cells=lattice.corners,
    )


@generate.register
def _sheet(shape: Sheet, dimension: int) -> Geometry:
    spacing = (shape.size[0] / shape.cells[0], shape.size[1] / shape.cells[1])
    flat = build_lattice(np.ones(shape.cells, dtype=bool), spacing, shape.bracing, shape.bend)
    points = np.zeros((len(flat.points), 3))
    points[:, [0, 2]] = flat.points
    return Geometry(
        points=points,
        springs=flat.springs,
        rest_lengths=lengths(points, flat.springs),
        spring_scale=flat.spring_scale * shape.thickness,
        spring_ratio=flat.spring_ratio,
        mass_share=flat.mass_share,
        volume=shape.size[0] * shape.size[1] * shape.thickness,
        # z points down when x and y point right and up: turned over, the triangles face +y.
        triangles=flat.cells[:, ::-1],
        two_sided=True,
        membrane=True,
    )
