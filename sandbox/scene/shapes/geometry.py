"""What every shape becomes: particles, springs and surfaces as numbers, in the shape's own frame."""

from dataclasses import dataclass, field
from functools import singledispatch

import numpy as np

from sandbox.errors import SceneError
from sandbox.scene.lattice import FloatArray, IntArray

_JOINING = 0.525
"""Radius of particles over their distance where it is to leave no gap [1]."""


def no_elements(width: int) -> IntArray:
    """An empty list of elements, shape (0, width)."""
    return np.zeros((0, width), dtype=np.int32)


@dataclass(frozen=True)
class Geometry:
    """A shape as numbers. N particles, S springs, dimension d."""

    points: FloatArray
    """Particle positions in the shape's frame [m], shape (N, d)."""
    springs: IntArray
    """Pairs of particles, each once, shape (S, 2)."""
    rest_lengths: FloatArray
    """Rest length of every spring [m], shape (S,)."""
    spring_scale: FloatArray | None
    """Stiffness over Young's modulus of every spring [m], shape (S,); None where a shape has no lattice.
    NaN where the lattice has no isotropic solution."""
    mass_share: FloatArray
    """Fraction of the body's mass at every particle, shape (N,)."""
    volume: float | None
    """Volume, in 2D that of a 1 m thick body [m^3]; None where it is not known."""
    spring_ratio: FloatArray | None = None
    """Factor on a ``stiffness`` given for the body [1], shape (S,): 1 for structural and shear springs, ``bend`` for
    bend springs; None: 1 for all."""
    masses: FloatArray | None = None
    """Masses where the shape gives them itself [kg], shape (N,)."""
    velocities: FloatArray | None = None
    """Velocities where the shape gives them itself [m/s], shape (N, d)."""
    pinned: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """Particles that the shape itself pins."""
    triangles: IntArray = field(default_factory=lambda: no_elements(3))
    """Surface triangles, counter-clockwise from outside (2D: filling triangles), shape (T, 3)."""
    outline: IntArray = field(default_factory=lambda: no_elements(2))
    """2D outline edges, shape (E, 2); the body lies to their left."""
    capsules: IntArray = field(default_factory=lambda: no_elements(2))
    """Pairs of particles drawn as a rod, shape (C, 2)."""
    capsule_radius: float = 0.0
    """Radius of the rods [m]; 0: chosen by what is around."""
    two_sided: bool = False
    """True for an open surface."""
    membrane: bool = False
    """True where the shape is thin (sheet, shell, ring, rope): wind blows on it by default."""
    carried_nodes: IntArray = field(default_factory=lambda: no_elements(1))
    """Particles that carry every extra surface point, shape (V, nodes); triangles name such a point as N + its row."""
    carried_weights: FloatArray = field(default_factory=lambda: np.zeros((0, 1)))
    """Their weights, which add up to 1, shape (V, nodes)."""
    cells: IntArray = field(default_factory=lambda: no_elements(8))
    """Particles at the corners of every cell of a solid lattice, which count up in binary, x first, shape (C, 2^d)."""
    show_particles: bool = False
    """True where particles are to be seen even if the scene does not ask for them."""
    remarks: tuple[str, ...] = ()
    """What is odd about the shape, one line each."""


def lengths(points: FloatArray, springs: IntArray) -> FloatArray:
    """Distance between the ends of every spring [m], shape (S,)."""
    return np.asarray(np.linalg.norm(points[springs[:, 1]] - points[springs[:, 0]], axis=1))


def joining_radius(geometry: Geometry) -> float:
    """Radius that leaves no gap between a body's particles [m]: a little over half of the way to a neighbour.

    Of the longest such way that it takes to get through all of the body along springs. Neighbours overlap at rest, and
    so do not meet each other. Raises SceneError where there are no springs.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import minimum_spanning_tree

    ends, count = geometry.springs, len(geometry.points)
    ways = lengths(geometry.points, ends) if len(ends) else np.zeros(0)
    if not ways.any():
        raise SceneError('"auto" goes by the springs, of which the body has none; give a number')
    tree = minimum_spanning_tree(coo_matrix((ways, (ends[:, 0], ends[:, 1])), shape=(count, count)).tocsr())
    return _JOINING * float(tree.data.max())


@singledispatch
def generate(shape: object, dimension: int) -> Geometry:
    """The geometry of a shape in a scene of 2 or 3 dimensions.

    Raises SceneError, one line, where the shape's numbers make no body (a mesh file that cannot be read,
    an outline that crosses itself).
    """
    raise TypeError(f"no generator for {type(shape).__name__}")
