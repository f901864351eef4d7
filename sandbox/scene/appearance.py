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
    """Solid things; they do not move."""
    bounds: FloatArray
    """Lower and upper corner of all particles over the expected motion [m], shape (2, dimension)."""
    element_size: float
    """Typical spring length [m]: a scale for outline widths."""
