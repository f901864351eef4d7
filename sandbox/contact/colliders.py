"""Solid things that particles meet: swept, so that no speed carries a particle through.

Each collider finds where the straight path of a particle within a substep enters it; the particle
goes there, its velocity is treated by the surface, and it spends the rest of the substep at the new
velocity. A particle that starts inside is put onto the closest surface first.
"""

from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.contact.surface import BodySurfaces, UniformSurface
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import BoxCollider, Collider, HalfSpace, SphereCollider
from sandbox.scene.placement import rotation_matrix
from sandbox.state import ParticleState, place

_TINY = 1e-12


@ti.data_oriented
class ParticleRadius:
    """Contact radius of every particle [m]."""

    def __init__(self, builder: ti.FieldsBuilder, count: int) -> None:
        self.radius = place(builder, ti.field(runtime.real()), count)

    def load(self, assembly: Assembly) -> None:
        self._write(assembly.radii)

    @ti.kernel
    def _write(self, radii: ti.types.ndarray()):
        for i in range(radii.shape[0]):
            self.radius[i] = radii[i]

    @ti.func
    def of(self, i):
        return self.radius[i]


@ti.data_oriented
class UniformRadius:
    """One contact radius for all particles [m], known when kernels compile."""

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def load(self, assembly: Assembly) -> None:
        """Nothing to upload."""

    @ti.func
    def of(self, i):
        return self.radius


@ti.data_oriented
class SolidCollider:
    """What all colliders share. A kind gives ``entry`` and ``signed_distance``."""

    def __init__(self, surface: Any, radius: Any) -> None:
        self.surface = surface
        self.radius = radius

    @ti.func
    def resolve(self, i, start, end, v, duration):
        """Position and velocity after a straight move from ``start`` to ``end`` = start + duration v."""
        hit, fraction, place, normal = self.entry(start, end, self.radius.of(i))
        x_new, v_new = end, v
        if hit:
            v_new = self.surface.respond(i, v, normal)
            x_new = place + (1.0 - fraction) * duration * v_new
        return x_new, v_new

    def entry(self, start, end, radius):
        """Whether the path enters the solid, at which fraction, where, and the normal there: a ti.func of each kind."""
        raise NotImplementedError

    def signed_distance(self, x):
        """Distance of a point from the surface [m], negative inside: a ti.func of each kind."""
        raise NotImplementedError

    @ti.func
    def depth(self, i, x):
        """How far particle i is inside [m]; negative outside."""
        return self.radius.of(i) - self.signed_distance(x)


@ti.data_oriented
class HalfSpaceCollider(SolidCollider):
    """Everything below a plane."""

    def __init__(self, collider: HalfSpace, surface: Any, radius: Any) -> None:
        super().__init__(surface, radius)
        vector = runtime.vector(len(collider.normal))
        self.normal = vector(np.asarray(collider.normal) / np.linalg.norm(collider.normal))
        self.point = vector(collider.point)

    @ti.func
    def signed_distance(self, x):
        return (x - self.point).dot(self.normal)

    @ti.func
    def entry(self, start, end, radius):
        before = self.signed_distance(start) - radius
        after = self.signed_distance(end) - radius
        fraction = 0.0
        place = start - before * self.normal
        if before > 0.0:
            fraction = before / ti.max(before - after, _TINY)
            place = start + fraction * (end - start)
        return after < 0.0, fraction, place, self.normal


@ti.data_oriented
class BallCollider(SolidCollider):
    """Solid sphere, in 2D a disc."""

    def __init__(self, collider: SphereCollider, surface: Any, radius: Any) -> None:
        super().__init__(surface, radius)
        self.centre = runtime.vector(len(collider.position))(collider.position)
        self.size = collider.radius
        self.dimension = len(collider.position)

    @ti.func
    def signed_distance(self, x):
        return (x - self.centre).norm() - self.size

    @ti.func
    def entry(self, start, end, radius):
        reach = self.size + radius
        arm = start - self.centre
        path = end - start
        distance = arm.norm()
        normal = arm / ti.max(distance, _TINY)
        if distance <= _TINY:  # from the very centre every way out is as short: take +y
            normal[1] = 1.0
        fraction = 0.0
        place = start + (reach - distance) * normal
        hit = distance <= reach and (end - self.centre).norm() < reach
        if distance > reach:
            # |arm + t path|^2 = reach^2, the smaller root
            a = path.dot(path)
            b = arm.dot(path)
            outside = (distance - reach) * (distance + reach)
            discriminant = b * b - a * outside
            if b < 0.0 and discriminant >= 0.0:
                fraction = outside / (-b + ti.sqrt(discriminant))  # the form without cancellation
                hit = fraction <= 1.0
                normal = (start + fraction * path - self.centre).normalized()
                place = self.centre + reach * normal
        return hit, fraction, place, normal


@ti.data_oriented
class BlockCollider(SolidCollider):
    """Solid box in any orientation, in 2D a rectangle."""

    def __init__(self, collider: BoxCollider, surface: Any, radius: Any) -> None:
        super().__init__(surface, radius)
        self.dimension = len(collider.position)
        real = runtime.real()
        vector = runtime.vector(self.dimension)
        self.centre = vector(collider.position)
        self.half = vector(0.5 * np.asarray(collider.size))
        turn = rotation_matrix(collider.rotation, self.dimension)
        self.to_world = ti.types.matrix(self.dimension, self.dimension, real)(turn)
        self.to_local = ti.types.matrix(self.dimension, self.dimension, real)(turn.T)

    @ti.func
    def signed_distance(self, x):
        q = ti.abs(self.to_local @ (x - self.centre)) - self.half
        return ti.max(q, 0.0).norm() + ti.min(q.max(), 0.0)

    @ti.func
    def entry(self, start, end, radius):
        half = self.half + radius
        a = self.to_local @ (start - self.centre)
        b = self.to_local @ (end - self.centre)
        inside = (half - ti.abs(a)).min() >= 0.0
        hit = False
        fraction = 0.0
        place = a
        normal = 0.0 * a
        if inside:
            hit = (half - ti.abs(b)).min() > 0.0
            place, normal = self._nearest_face(a, half)
        else:
            first, last, normal = self._slabs(a, b - a, half)
            hit = first <= last and first >= 0.0 and first <= 1.0
            fraction = first
            place = a + first * (b - a)
        return hit, fraction, self.centre + self.to_world @ place, self.to_world @ normal

    @ti.func
    def _nearest_face(self, a, half):
        """The closest point of the surface to an inside point, and its normal."""
        gap = half - ti.abs(a)
        closest = gap.min()
        place = a
        normal = 0.0 * a
        found = False
        for axis in ti.static(range(self.dimension)):
            if not found and gap[axis] <= closest:
                found = True
                side = ti.select(a[axis] < 0.0, -1.0, 1.0)
                place[axis] = side * half[axis]
                normal[axis] = side
        return place, normal

    @ti.func
    def _slabs(self, a, path, half):
        """Fractions of the path at which it enters and leaves all slabs, and the entered face's normal."""
        first = -1.0
        last = 2.0
        normal = 0.0 * a
        for axis in ti.static(range(self.dimension)):
            if ti.abs(path[axis]) < _TINY * half[axis]:
                if ti.abs(a[axis]) > half[axis]:
                    last = -2.0  # runs beside the slab
            else:
                side = ti.select(path[axis] > 0.0, -1.0, 1.0)
                near = (side * half[axis] - a[axis]) / path[axis]
                far = (-side * half[axis] - a[axis]) / path[axis]
                last = ti.min(last, far)
                if near > first:
                    first = near
                    normal = 0.0 * a
                    normal[axis] = side
        return first, last, normal


_KINDS: dict[type, Any] = {
    HalfSpace: HalfSpaceCollider,
    SphereCollider: BallCollider,
    BoxCollider: BlockCollider,
}


def build_colliders(
    builder: ti.FieldsBuilder, assembly: Assembly, state: ParticleState
) -> tuple[list[SolidCollider], list[Any]]:
    """The colliders of a scene, and the parts of theirs that want ``load(assembly)`` once."""
    if not assembly.colliders:
        return [], []
    radii = np.unique(assembly.radii)
    radius = UniformRadius(float(radii[0])) if len(radii) == 1 else ParticleRadius(builder, state.count)
    parts: list[Any] = [radius]
    colliders = []
    for collider, pairs in zip(assembly.colliders, assembly.contacts, strict=True):
        surface = UniformSurface(pairs[0]) if len(set(pairs)) == 1 else BodySurfaces(builder, assembly, pairs)
        parts.append(surface)
        colliders.append(_build(collider, surface, radius))
    return colliders, parts


def _build(collider: Collider, surface: Any, radius: Any) -> SolidCollider:
    built: SolidCollider = _KINDS[type(collider)](collider, surface, radius)
    return built
