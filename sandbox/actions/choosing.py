"""Which particles and springs an action means, in the shape that bodies have then. NumPy only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.assemble import Assembly
from sandbox.scene.lattice import FloatArray
from sandbox.scene.model import Choice, Cut, Grab, Hold
from sandbox.scene.selection import inside

Mask = NDArray[np.bool_]

REACH = 0.125
"""Reach of a grip, in the largest side of the body [1]."""
_NEAR_RAY = 2.0
"""Distance from a ray within which particles count as met, in the length of springs [1]."""


def particles_of(assembly: Assembly, body: str | None) -> Mask:
    """Those of a body, or all; shape (N,)."""
    if body is None:
        return np.ones(assembly.particle_count, dtype=bool)
    return assembly.of_body(body)


def chosen(assembly: Assembly, positions: FloatArray, action: Choice) -> Mask:
    """Particles of a body, in a box or a ball, at positions [m], shape (N, d); shape (N,)."""
    mask = particles_of(assembly, action.body)
    if action.region is not None:
        mask &= inside(action.region, positions)
    if action.point is not None and action.radius is not None:
        apart = positions - np.asarray(action.point)
        mask &= np.einsum("ij,ij->i", apart, apart) <= action.radius**2
    if isinstance(action, Hold) and action.indices:
        first = assembly.order[particles_of(assembly, action.body)].min()
        mask &= np.isin(assembly.order, first + np.asarray(action.indices))
    return mask


@dataclass(frozen=True)
class Grip:
    """Particles in a hand."""

    particles: NDArray[np.int64]
    """Internal numbers, shape (n,)."""
    middle: FloatArray
    """Mean of their places [m], shape (d,)."""
    body: int
    """Whose they are."""


def gripped(assembly: Assembly, positions: FloatArray, free: Mask, action: Grab) -> Grip | None:
    """What a hand takes: the particle nearest to a point, or that a ray meets first, and its body's near it.

    ``free`` particles can be grabbed, shape (N,). None where there is nothing to grab, or nothing within the
    reach that the action gives.
    """
    numbers = np.nonzero(particles_of(assembly, action.body) & free)[0]
    if len(numbers) == 0:
        return None
    apart = positions[numbers] - np.asarray(action.point)
    if action.direction is None:
        nearest = int(numbers[np.argmin(np.einsum("ij,ij->i", apart, apart))])
        if action.radius is not None and np.linalg.norm(positions[nearest] - action.point) > action.radius:
            return None
    else:
        direction = np.asarray(action.direction) / np.linalg.norm(action.direction)
        depth = apart @ direction
        beside = np.linalg.norm(apart - depth[:, None] * direction, axis=1)
        met = (beside <= _NEAR_RAY * assembly.appearance.element_size) & (depth > 0.0)
        if not met.any():
            return None
        # What is a little deeper but nearer to the ray is what the eye points at.
        nearest = int(numbers[met][np.argmin(depth[met] + beside[met])])
    body = int(assembly.particle_body[nearest])
    own = numbers[assembly.particle_body[numbers] == body]
    reach = action.radius
    if reach is None:
        whole = positions[assembly.particle_body == body]
        reach = max(REACH * float(np.ptp(whole, axis=0).max()), 1.5 * assembly.appearance.element_size)
    around = positions[own] - positions[nearest]
    held = own[np.einsum("ij,ij->i", around, around) <= reach**2]
    return Grip(held, positions[held].mean(axis=0), body)


def crossed(assembly: Assembly, positions: FloatArray, action: Cut, begin: float, end: float) -> Mask:
    """Springs that a cut parts between two fractions of its way [1]; shape (S,)."""
    a, b = positions[assembly.springs[:, 0]], positions[assembly.springs[:, 1]]
    if action.point is not None and action.normal is not None:
        normal = np.asarray(action.normal)
        above_a, above_b = ((ends - np.asarray(action.point)) @ normal >= 0.0 for ends in (a, b))
        parted = above_a != above_b
        if action.region is not None:
            parted &= inside(action.region, 0.5 * (a + b))
    else:
        start, stop = np.asarray(action.edge_start), np.asarray(action.edge_end)
        if assembly.dimension == 2:
            way = stop - start
            parted = _cross_segment(a, b, start + begin * way, start + end * way)
        else:
            sweep = np.zeros(3) if action.sweep is None else np.asarray(action.sweep)
            corners = [start + begin * sweep, stop + begin * sweep, stop + end * sweep, start + end * sweep]
            parted = _cross_triangle(a, b, corners[0], corners[1], corners[2])
            parted |= _cross_triangle(a, b, corners[0], corners[2], corners[3])
    if action.body is not None:
        mine = particles_of(assembly, action.body)
        parted &= mine[assembly.springs].any(axis=1)
    return np.asarray(parted)


def _cross_segment(a: FloatArray, b: FloatArray, p: FloatArray, q: FloatArray) -> Mask:
    """Whether segments a to b, shape (S, 2), cross the one from p to q; what lies on a line is above it."""

    def above(points: FloatArray, foot: FloatArray, way: FloatArray) -> Mask:
        return np.asarray(way[..., 0] * (points - foot)[..., 1] - way[..., 1] * (points - foot)[..., 0] >= 0.0)

    return np.asarray((above(a, p, q - p) != above(b, p, q - p)) & (above(p, a, b - a) != above(q, a, b - a)))


def _cross_triangle(a: FloatArray, b: FloatArray, p: FloatArray, q: FloatArray, r: FloatArray) -> Mask:
    """Whether segments a to b, shape (S, 3), pass through a triangle."""

    def volume(one: FloatArray, two: FloatArray, three: FloatArray, four: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("...i,...i->...", np.cross(two - one, three - one), four - one))

    through = (volume(p, q, r, a) >= 0.0) != (volume(p, q, r, b) >= 0.0)
    sides = [volume(a, b, one, two) >= 0.0 for one, two in ((p, q), (q, r), (r, p))]
    return np.asarray(through & (sides[0] == sides[1]) & (sides[1] == sides[2]))
