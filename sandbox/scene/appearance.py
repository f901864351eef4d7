"""What there is to draw: index lists into the particles, colours, colliders. NumPy only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.model import Collider

IntArray = NDArray[np.int32]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Appearance:
    """Drawable elements of a scene. Indices are into the particle order of the simulation's fields."""

    dimension: int
    """2 or 3."""
    triangles: IntArray
    """Filled surface triangles, counter-clockwise from outside (2D: counter-clockwise), shape (triangle_count, 3)."""
    triangle_body: IntArray
    """Body of every triangle, shape (triangle_count,)."""
    outline: IntArray
    """2D only: outline edges, shape (edge_count, 2)."""
    outline_body: IntArray
    """Body of every outline edge, shape (edge_count,)."""
    capsules: IntArray
    """Ropes and struts: pairs of particles, shape (capsule_count, 2)."""
    capsule_radius: FloatArray
    """Radius of every capsule [m], shape (capsule_count,)."""
    capsule_body: IntArray
    """Body of every capsule, shape (capsule_count,)."""
    spheres: IntArray
    """Particles drawn as spheres, shape (sphere_count,)."""
    sphere_radius: FloatArray
    """Radius of every sphere [m], shape (sphere_count,)."""
    sphere_body: IntArray
    """Body of every sphere, shape (sphere_count,)."""
    body_colors: FloatArray
    """sRGB colour of every body in [0, 1], shape (body_count, 3)."""
    body_two_sided: NDArray[np.bool_]
    """True where a body is an open surface (a sheet), seen from both sides, shape (body_count,)."""
    colliders: tuple[Collider, ...]
    """Solid things; where one has a ``motion``, :func:`sandbox.scene.motion.motion_of` tells where it is."""
    bounds: FloatArray
    """Lower and upper corner of all particles over the expected motion [m], shape (2, dimension)."""
    element_size: float
    """Typical spring length [m]: a scale for outline widths."""
    particle_count: int
    """Number of particles. Triangles may name points past them: entry ``i - particle_count`` of ``carried_nodes``."""
    carried_nodes: IntArray
    """Particles that carry every extra surface point, shape (carried_count, nodes)."""
    carried_weights: FloatArray
    """Their weights, which add up to 1, shape (carried_count, nodes)."""
    triangle_springs: IntArray | None = None
    """Springs along the edges of every triangle, -1 where there is none, shape (triangle_count, 3); a triangle
    with a torn spring is not drawn. None in a scene where nothing tears."""
    outline_spring: IntArray | None = None
    """Spring along every outline edge, or -1, shape (edge_count,); None where nothing tears."""
    capsule_spring: IntArray | None = None
    """Spring of every capsule, or -1, shape (capsule_count,); None where nothing tears."""
    body_radius: FloatArray | None = None
    """Radius of every body's particles, by which it meets others [m], shape (body_count,); None: all 0."""
