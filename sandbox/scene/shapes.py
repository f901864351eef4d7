"""Pure NumPy generators: what particles, springs and surfaces a shape stands for, in its own frame.

The shape's centre is at the origin. Nothing here knows the material: springs carry their stiffness
over Young's modulus, particles their share of the mass.
"""

from dataclasses import dataclass, field
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray, Lattice, build_lattice
from sandbox.scene.model import Ball, Box, Custom, Rope, Sheet


def _no_elements(width: int) -> IntArray:
    return np.zeros((0, width), dtype=np.int32)


@dataclass(frozen=True)
class Geometry:
    """A shape as numbers. N particles, S springs, dimension d."""

    points: FloatArray
    """Particle positions in the shape's frame [m], shape (N, d)."""
    springs: IntArray
    """Pairs of particles, shape (S, 2)."""
    rest_lengths: FloatArray
    """Rest length of every spring [m], shape (S,)."""
    spring_scale: FloatArray | None
    """Stiffness over Young's modulus of every spring [m], shape (S,); None where a shape has no lattice.
    NaN where the lattice has no isotropic solution."""
    mass_share: FloatArray
    """Fraction of the body's mass at every particle, shape (N,)."""
    volume: float | None
    """Volume, in 2D that of a 1 m thick body [m^3]; None where it is not known."""
    masses: FloatArray | None = None
    """Masses where the shape gives them itself [kg], shape (N,)."""
    velocities: FloatArray | None = None
    """Velocities where the shape gives them itself [m/s], shape (N, d)."""
    pinned: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """Particles that the shape itself pins."""
    triangles: IntArray = field(default_factory=lambda: _no_elements(3))
    """Surface triangles, counter-clockwise from outside (2D: filling triangles), shape (T, 3)."""
    outline: IntArray = field(default_factory=lambda: _no_elements(2))
    """2D outline edges, shape (E, 2)."""
    capsules: IntArray = field(default_factory=lambda: _no_elements(2))
    """Pairs of particles drawn as a rod, shape (C, 2)."""
    capsule_radius: float = 0.0
    """Radius of the rods [m]; 0: chosen by what is around."""
    two_sided: bool = False
    """True for an open surface."""
    show_particles: bool = False
    """True where particles are to be seen even if the scene does not ask for them."""


def lengths(points: FloatArray, springs: IntArray) -> FloatArray:
    """Distance between the ends of every spring [m], shape (S,)."""
    return np.asarray(np.linalg.norm(points[springs[:, 1]] - points[springs[:, 0]], axis=1))


@singledispatch
def generate(shape: object, dimension: int) -> Geometry:
    """The geometry of a shape in a scene of 2 or 3 dimensions."""
    raise TypeError(f"no generator for {type(shape).__name__}")


@generate.register
def _box(shape: Box, dimension: int) -> Geometry:
    spacing = tuple(s / n for s, n in zip(shape.size, shape.cells, strict=True))
    lattice = build_lattice(np.ones(shape.cells, dtype=bool), spacing, shape.bracing)
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
        mass_share=lattice.mass_share,
        volume=volume,
        triangles=lattice.cells if flat else lattice.faces,
        outline=lattice.faces if flat else _no_elements(2),
    )


@generate.register
def _rope(shape: Rope, dimension: int) -> Geometry:
    along = np.linspace(0.0, 1.0, shape.segments + 1)[:, None]
    points = (1.0 - along) * np.asarray(shape.start) + along * np.asarray(shape.end)
    springs = np.stack([np.arange(shape.segments), np.arange(1, shape.segments + 1)], axis=1).astype(np.int32)
    share = np.full(len(points), 1.0 / shape.segments)
    share[[0, -1]] *= 0.5
    length = float(np.linalg.norm(np.subtract(shape.end, shape.start)))
    area = shape.thickness if dimension == 2 else np.pi / 4.0 * shape.thickness**2
    with np.errstate(divide="ignore"):
        scale = np.full(shape.segments, area * shape.segments / np.float64(length))
    return Geometry(
        points=points,
        springs=springs,
        rest_lengths=lengths(points, springs),
        spring_scale=scale,
        mass_share=share,
        volume=area * length,
        capsules=springs,
        capsule_radius=0.5 * shape.thickness,
    )


@generate.register
def _sheet(shape: Sheet, dimension: int) -> Geometry:
    spacing = (shape.size[0] / shape.cells[0], shape.size[1] / shape.cells[1])
    flat = build_lattice(np.ones(shape.cells, dtype=bool), spacing, shape.bracing)
    points = np.zeros((len(flat.points), 3))
    points[:, [0, 2]] = flat.points
    return Geometry(
        points=points,
        springs=flat.springs,
        rest_lengths=lengths(points, flat.springs),
        spring_scale=flat.spring_scale * shape.thickness,
        mass_share=flat.mass_share,
        volume=shape.size[0] * shape.size[1] * shape.thickness,
        # z points down when x and y point right and up: turned over, the triangles face +y.
        triangles=flat.cells[:, ::-1],
        two_sided=True,
    )


@generate.register
def _custom(shape: Custom, dimension: int) -> Geometry:
    points = np.asarray(shape.points, dtype=float).reshape(-1, dimension)
    springs = np.asarray(shape.springs, dtype=np.int32).reshape(-1, 2)
    triangles = np.asarray(shape.triangles, dtype=np.int32).reshape(-1, 3)
    rest = lengths(points, springs) if shape.rest_lengths is None else np.asarray(shape.rest_lengths, dtype=float)
    if dimension == 2 and len(triangles):
        triangles = _counter_clockwise(points, triangles)
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
        outline=_open_edges(triangles) if dimension == 2 else _no_elements(2),
        capsules=_no_elements(2) if covered else springs,
        two_sided=dimension == 3 and len(_open_edges(triangles)) > 0,
        show_particles=not covered,
    )


def _counter_clockwise(points: FloatArray, triangles: IntArray) -> IntArray:
    ab, ac = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    clockwise = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0] < 0
    return np.where(clockwise[:, None], triangles[:, ::-1], triangles)


def _open_edges(triangles: IntArray) -> IntArray:
    """Edges with a triangle on one side only, in the direction of that triangle, shape (E, 2)."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, inverse, counts = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    once: NDArray[np.bool_] = counts[inverse.reshape(-1)] == 1
    return np.asarray(edges[once], dtype=np.int32)
