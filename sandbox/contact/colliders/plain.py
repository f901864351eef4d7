"""Half-space, ball, box and capsule: solids with a closed form."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.contact.colliders.solid import NEVER, TINY, Numbers, SolidCollider, enter_ball
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import BoxCollider, CapsuleCollider, HalfSpace, SphereCollider
from sandbox.scene.motion import origin
from sandbox.scene.placement import rotation_matrix
from sandbox.state import ParticleState

FloatArray = NDArray[np.float64]


@ti.data_oriented
class PlainCollider(SolidCollider):
    """Solids that a few numbers describe."""

    numbers: Any

    def load(self, assembly: Assembly) -> None:
        """Upload the numbers."""
        self.numbers.load()


@ti.data_oriented
class HalfSpaceCollider(PlainCollider):
    """Everything below a plane."""

    def __init__(
        self, colliders: Sequence[HalfSpace], surface: Any, radius: Any, state: ParticleState, builder: Any
    ) -> None:
        super().__init__(surface, radius, state)
        self.count = len(colliders)
        normals = np.array([collider.normal for collider in colliders])
        self.numbers = Numbers(
            builder,
            normal=normals / np.linalg.norm(normals, axis=1, keepdims=True),
            point=[collider.point for collider in colliders],
        )

    @ti.func
    def signed_distance(self, c, x):
        return (x - self.numbers.point.of(c)).dot(self.numbers.normal.of(c))

    @ti.func
    def entry(self, c, start, end, radius):
        before = self.signed_distance(c, start) - radius
        after = self.signed_distance(c, end) - radius
        fraction = 0.0
        normal = self.numbers.normal.of(c)
        place = start - before * normal
        if before > 0.0:
            fraction = before / ti.max(before - after, TINY)
            place = start + fraction * (end - start)
        return after < 0.0, fraction, place, normal


@ti.data_oriented
class BallCollider(PlainCollider):
    """Solid sphere, in 2D a disc."""

    def __init__(
        self, colliders: Sequence[SphereCollider], surface: Any, radius: Any, state: ParticleState, builder: Any
    ) -> None:
        super().__init__(surface, radius, state)
        self.count = len(colliders)
        self.numbers = Numbers(
            builder,
            centre=[collider.position for collider in colliders],
            size=[collider.radius for collider in colliders],
        )

    @ti.func
    def signed_distance(self, c, x):
        return (x - self.numbers.centre.of(c)).norm() - self.numbers.size.of(c)

    @ti.func
    def entry(self, c, start, end, radius):
        centre = self.numbers.centre.of(c)
        reach = self.numbers.size.of(c) + radius
        arm = start - centre
        path = end - start
        distance = arm.norm()
        normal = arm / ti.max(distance, TINY)
        if distance <= TINY:  # from the very centre every way out is as short: take +y
            normal[1] = 1.0
        fraction = 0.0
        place = start + (reach - distance) * normal
        # Inward counts even where the path leaves again on the other side.
        hit = distance <= reach and ((end - centre).norm() < reach or path.dot(normal) < 0.0)
        if distance > reach:
            fraction = enter_ball(arm, path, reach)
            if fraction <= 1.0:
                hit = True
                normal = (start + fraction * path - centre).normalized()
                place = centre + reach * normal
        return hit, fraction, place, normal


@ti.data_oriented
class BlockCollider(PlainCollider):
    """Solid box in any orientation, in 2D a rectangle."""

    def __init__(
        self, colliders: Sequence[BoxCollider], surface: Any, radius: Any, state: ParticleState, builder: Any
    ) -> None:
        super().__init__(surface, radius, state)
        self.count = len(colliders)
        self.dimension = len(colliders[0].position)
        self.numbers = Numbers(
            builder,
            centre=[collider.position for collider in colliders],
            half=0.5 * np.array([collider.size for collider in colliders]),
            to_world=[rotation_matrix(collider.rotation, self.dimension) for collider in colliders],
        )

    @ti.func
    def _local(self, c, x):
        return self.numbers.to_world.of(c).transpose() @ (x - self.numbers.centre.of(c))

    @ti.func
    def signed_distance(self, c, x):
        q = ti.abs(self._local(c, x)) - self.numbers.half.of(c)
        return ti.max(q, 0.0).norm() + ti.min(q.max(), 0.0)

    @ti.func
    def entry(self, c, start, end, radius):
        half = self.numbers.half.of(c) + radius
        a, b = self._local(c, start), self._local(c, end)
        inside = (half - ti.abs(a)).min() >= 0.0
        hit = False
        fraction = 0.0
        place = a
        normal = 0.0 * a
        if inside:
            place, normal = self._nearest_face(a, half)
            # Inward counts even where the path leaves again on the other side.
            hit = (half - ti.abs(b)).min() > 0.0 or (b - a).dot(normal) < 0.0
        else:
            first, last, normal = self._slabs(a, b - a, half)
            hit = first <= last and first >= 0.0 and first <= 1.0
            fraction = first
            place = a + first * (b - a)
        to_world = self.numbers.to_world.of(c)
        return hit, fraction, self.numbers.centre.of(c) + to_world @ place, to_world @ normal

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
            if ti.abs(path[axis]) < TINY * half[axis]:
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


@ti.data_oriented
class RodCollider(PlainCollider):
    """Capsule: every point within a radius of a line from one point to another."""

    def __init__(
        self, colliders: Sequence[CapsuleCollider], surface: Any, radius: Any, state: ParticleState, builder: Any
    ) -> None:
        super().__init__(surface, radius, state)
        self.count = len(colliders)
        axes = [_axis(collider) for collider in colliders]
        self.numbers = Numbers(
            builder,
            start=[axis[0] for axis in axes],
            along=[axis[1] for axis in axes],
            aside=[axis[2] for axis in axes],
            length=[axis[3] for axis in axes],
            size=[collider.radius for collider in colliders],
        )

    @ti.func
    def _on_axis(self, c, x):
        """The closest point of the axis."""
        start, along = self.numbers.start.of(c), self.numbers.along.of(c)
        return start + ti.min(ti.max((x - start).dot(along), 0.0), self.numbers.length.of(c)) * along

    @ti.func
    def signed_distance(self, c, x):
        return (x - self._on_axis(c, x)).norm() - self.numbers.size.of(c)

    @ti.func
    def entry(self, c, start, end, radius):
        reach = self.numbers.size.of(c) + radius
        path = end - start
        middle = self._on_axis(c, start)
        arm = start - middle
        distance = arm.norm()
        normal = arm / ti.max(distance, TINY)
        if distance <= TINY:
            normal = self.numbers.aside.of(c)
        fraction = 0.0
        place = middle + reach * normal
        # Inward counts even where the path leaves again on the other side.
        hit = distance <= reach and (self.signed_distance(c, end) < radius or path.dot(normal) < 0.0)
        if distance > reach and distance - reach <= path.norm():
            fraction = self._sweep(c, start, path, reach)
            if fraction <= 1.0:
                hit = True
                contact = start + fraction * path
                middle = self._on_axis(c, contact)
                normal = (contact - middle).normalized()
                place = middle + reach * normal
        return hit, fraction, place, normal

    @ti.func
    def _sweep(self, c, start, path, reach):
        """Fraction at which a path from outside first enters the round side or one of the ends."""
        along, length = self.numbers.along.of(c), self.numbers.length.of(c)
        arm = start - self.numbers.start.of(c)
        first = ti.min(enter_ball(arm, path, reach), enter_ball(arm - length * along, path, reach))
        at = arm.dot(along)
        onward = path.dot(along)
        side = enter_ball(arm - at * along, path - onward * along, reach)
        meets = at + side * onward
        if side < first and meets >= 0.0 and meets <= length:
            first = side
        # A path within the endless cylinder can only enter through an end.
        return ti.min(first, NEVER)


def _axis(collider: CapsuleCollider) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Start of a capsule's axis [m], its direction, one across, for a particle on the very axis, and its length [m]."""
    dimension = len(collider.start)
    turn = rotation_matrix(collider.rotation, dimension)
    position = origin(collider, dimension)
    start, end = (position + turn @ np.asarray(place) for place in (collider.start, collider.end))
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > 0.0 else np.eye(dimension)[0]
    aside = np.eye(dimension)[np.abs(along).argmin()]
    aside = aside - (aside @ along) * along
    return start, along, aside / np.linalg.norm(aside), length
