"""Particles and springs, one by one, as the scene lists them."""

import numpy as np

from sandbox.scene.model import Custom
from sandbox.scene.shapes.geometry import Geometry, generate, lengths, no_elements
from sandbox.scene.shapes.triangles import counter_clockwise, open_edges


@generate.register
def _custom(shape: Custom, dimension: int) -> Geometry:
    points = np.asarray(shape.points, dtype=float).reshape(-1, dimension)
    springs = np.asarray(shape.springs, dtype=np.int32).reshape(-1, 2)
    triangles = np.asarray(shape.triangles, dtype=np.int32).reshape(-1, 3)
    rest = lengths(points, springs) if shape.rest_lengths is None else np.asarray(shape.rest_lengths, dtype=float)
    if dimension == 2 and len(triangles):
        triangles = counter_clockwise(points, triangles)
    covered = len(triangles) > 0
    return Geometry(
        points=points,
        springs=springs,
        rest_lengths=rest,
        spring_scale=None,
        mass_share=np.full(len(points), 1.0 / len(points)),
        volume=None,
        masses=None if shape.masses is None else np.asarray(shape.masses),
        velocities=None if shape.velocities is None else np.asarray(shape.velocities).reshape(-1, dimension),
        pinned=np.asarray(shape.pinned, dtype=np.int32),
        triangles=triangles,
        outline=open_edges(triangles) if dimension == 2 else no_elements(2),
        capsules=no_elements(2) if covered else springs,
        two_sided=dimension == 3 and len(open_edges(triangles)) > 0,
        show_particles=not covered,
    )
