"""Hollow spheres and other surfaces of triangles whose edges are springs."""

import numpy as np

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.model import Shell
from sandbox.scene.shapes.geometry import Geometry, generate, lengths
from sandbox.scene.shapes.triangles import find_edges, mass_shares, membrane_springs, triangle_areas

_GOLDEN = (1.0 + 5.0**0.5) / 2.0
_CORNERS = np.array(
    [[0, s, t * _GOLDEN] for s in (-1, 1) for t in (-1, 1)]
    + [[s, t * _GOLDEN, 0] for s in (-1, 1) for t in (-1, 1)]
    + [[t * _GOLDEN, 0, s] for s in (-1, 1) for t in (-1, 1)]
)
"""Corners of an icosahedron with edges of length 2: cyclic permutations of (0, +-1, +-golden ratio)."""


@generate.register
def _shell(shape: Shell, dimension: int) -> Geometry:
    points, triangles = icosphere(shape.subdivisions)
    return surface_geometry(shape.radius * points, triangles, shape.thickness, shape.bend, closed=True)


def surface_geometry(
    points: FloatArray, triangles: IntArray, thickness: float, bend: float, *, closed: bool
) -> Geometry:
    """A membrane of the given triangles, ``thickness`` [m] thick; ``bend`` as in :func:`membrane_springs`."""
    areas = triangle_areas(points, triangles)
    membrane = membrane_springs(points, triangles, thickness, bend)
    return Geometry(
        points=points,
        springs=membrane.springs,
        rest_lengths=lengths(points, membrane.springs),
        spring_scale=membrane.scale,
        spring_ratio=membrane.ratio,
        mass_share=mass_shares(len(points), triangles, areas),
        volume=float(areas.sum()) * thickness,
        triangles=triangles,
        two_sided=not closed,
        membrane=True,
    )


def icosphere(subdivisions: int) -> tuple[FloatArray, IntArray]:
    """Points of the unit sphere, (10 * 4^n + 2, 3), and outward triangles, (20 * 4^n, 3), from an icosahedron.

    Each subdivision divides every triangle into 4 and draws the new points onto the sphere. Points keep their
    numbers when the sphere is divided further.
    """
    points, triangles = _icosahedron()
    for _ in range(subdivisions):
        edges = find_edges(triangles)
        middle = points[edges.pairs].sum(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        a, b, c = triangles.T
        ab, bc, ca = (edges.of_triangle + len(points)).T
        points = np.concatenate([points, middle])
        parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts]).astype(np.int32)
    return points, triangles


def _icosahedron() -> tuple[FloatArray, IntArray]:
    """The unit icosahedron: its triangles are all triples of corners that are neighbours of each other."""
    near = np.linalg.norm(_CORNERS[:, None] - _CORNERS[None], axis=2) < 2.5
    triples = np.array(
        [
            (a, b, c)
            for a in range(12)
            for b in range(a + 1, 12)
            for c in range(b + 1, 12)
            if near[[a, b, a], [b, c, c]].all()
        ]
    )
    volumes = np.linalg.det(_CORNERS[triples])
    triples[volumes < 0.0] = triples[volumes < 0.0][:, ::-1]
    return _CORNERS / np.linalg.norm(_CORNERS[0]), triples.astype(np.int32)
