"""2D polygons: convex, concave, with holes.

A point is inside by the even-odd rule: a ray along +x crosses an odd number of edges. What starts
inside leaves at the closest point of the closest edge; what comes from outside is swept against the
edges, each moved outward by the particle's radius and rounded at its ends, which is exact.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.contact.colliders.solid import BLUNT, NEVER, Numbers, SolidCollider, enter_ball, outside_box, rounding
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import PolygonCollider
from sandbox.scene.motion import origin
from sandbox.scene.placement import rotation_matrix
from sandbox.scene.shapes.outlines import loop_area
from sandbox.state import ParticleState, place

FloatArray = NDArray[np.float64]

_BIG = 1e30


def outline_edges(points: Any, holes: Any) -> tuple[FloatArray, FloatArray]:
    """Both ends of every edge [m], each (edges, 2), the solid on the left; edges without length are left out."""
    starts, ends = [], []
    for outline, turns in [(points, 1.0), *((hole, -1.0) for hole in holes)]:
        corners = np.asarray(outline, dtype=float)
        following = np.roll(corners, -1, axis=0)
        pair = (corners, following) if loop_area(corners) * turns > 0.0 else (following, corners)
        apart = (corners != following).any(axis=1)
        starts.append(pair[0][apart])
        ends.append(pair[1][apart])
    return np.concatenate(starts), np.concatenate(ends)


def _placed_edges(collider: PolygonCollider) -> tuple[FloatArray, FloatArray]:
    turn = rotation_matrix(collider.rotation, 2)
    position = origin(collider, 2)
    start, end = outline_edges(collider.points, collider.holes)
    return start @ turn.T + position, end @ turn.T + position


@ti.data_oriented
class OutlineCollider(SolidCollider):
    """Solid polygons; ``reach`` is the farthest from the origin that they may be moved [m]."""

    most_hits = 4

    def __init__(
        self,
        colliders: Sequence[PolygonCollider],
        surface: Any,
        radius: Any,
        state: ParticleState,
        builder: Any,
        reach: float,
    ) -> None:
        super().__init__(surface, radius, state)
        self.count = len(colliders)
        outlines = [_placed_edges(collider) for collider in colliders]
        self.ends = tuple(np.concatenate([outline[k] for outline in outlines]) for k in range(2))
        first = np.cumsum([0] + [len(outline[0]) for outline in outlines])
        self.numbers: Any = Numbers(
            builder,
            low=[outline[0].min(axis=0) for outline in outlines],
            high=[outline[0].max(axis=0) for outline in outlines],
            first=first[:-1],
            last=first[1:],
        )
        vector = runtime.vector(2)
        self.slack = 4.0 * rounding() * (float(np.abs(self.ends[0]).max()) + reach)
        """Distance within which a particle counts as touching [m]: what rounding leaves open."""
        self.reach = reach
        self.edges = len(self.ends[0])
        self.start = place(builder, vector.field(), self.edges)
        self.end = place(builder, vector.field(), self.edges)
        self.along = place(builder, vector.field(), self.edges)
        self.length = place(builder, ti.field(runtime.real()), self.edges)

    def load(self, assembly: Assembly) -> None:
        """Upload the edges."""
        self.numbers.load()
        self._write(*(np.ascontiguousarray(ends) for ends in self.ends))

    @ti.kernel
    def _write(self, start: ti.types.ndarray(), end: ti.types.ndarray()):
        for e in range(self.edges):
            for axis in ti.static(range(2)):
                self.start[e][axis] = start[e, axis]
                self.end[e][axis] = end[e, axis]
                self.along[e][axis] = end[e, axis] - start[e, axis]
            self.length[e] = self.along[e].norm()
            self.along[e] = self.along[e] / self.length[e]

    @ti.func
    def _first(self, c):
        """First edge of polygon c."""
        return ti.cast(self.numbers.first.of(c), ti.i32)

    @ti.func
    def _last(self, c):
        return ti.cast(self.numbers.last.of(c), ti.i32)

    @ti.func
    def _gap(self, c, x):
        """Distance from the bounding box [m]: the polygon is no nearer."""
        return outside_box(self.numbers.low.of(c), self.numbers.high.of(c), x)

    @ti.func
    def closest(self, c, x):
        """Signed distance from the closest edge [m], and the direction away from the solid there."""
        best = _BIG
        normal = 0.0 * x
        away = 0.0 * x
        inside = False
        at_corner = False
        for e in range(self._first(c), self._last(c)):
            a, b, u = self.start[e], self.end[e], self.along[e]
            arm = x - a
            way = arm.dot(u)
            along = ti.min(ti.max(way, 0.0), self.length[e])
            arm = arm - along * u
            square = arm.dot(arm)
            if square < best:
                best = square
                away = arm
                normal = ti.Vector([u[1], -u[0]])
                at_corner = along != way
            # The ray meets an edge that reaches over it and has the point on its left when going up.
            side = (b[0] - a[0]) * (x[1] - a[1]) - (b[1] - a[1]) * (x[0] - a[0])
            if (a[1] > x[1]) != (b[1] > x[1]) and (side > 0.0) == (b[1] > a[1]):
                inside = not inside
        distance = ti.sqrt(best)
        # Beside an edge its normal is exact; the difference that leads to a corner is rounding where it is small.
        if at_corner and distance > BLUNT * self.slack:
            normal = ti.select(inside, -away, away) / distance
        return ti.select(inside, -distance, distance), normal

    @ti.func
    def signed_distance(self, c, x):
        distance, _ = self.closest(c, x)
        return distance

    @ti.func
    def depth_in(self, c, i, x):
        """How far particle i is inside polygon c [m]; where it is far outside, at most this."""
        radius = self.radius.of(i)
        depth = radius - self._gap(c, x)
        if depth >= 0.0:
            depth = radius - self.signed_distance(c, x)
        return depth

    @ti.func
    def entry(self, c, start, end, radius):
        path = end - start
        length = path.norm()
        hit = False
        fraction = 0.0
        place = start
        normal = 0.0 * start
        if self._gap(c, start) - radius <= length:
            distance, way_out = self.closest(c, start)
            before = distance - radius
            if before < -self.slack:
                hit = True
                place = start - before * way_out
                normal = way_out
            elif before <= length:
                fraction, place, normal = self._sweep(c, start, path, radius, self.grazing * length)
                hit = fraction <= 1.0
        return hit, fraction, place, normal

    @ti.func
    def _sweep(self, c, start, path, radius, along):
        """Where a path from outside first meets an edge; less than ``along`` [m] towards one is not towards it."""
        best = NEVER
        place = start
        normal = 0.0 * start
        for e in range(self._first(c), self._last(c)):
            a, u = self.start[e], self.along[e]
            n = ti.Vector([u[1], -u[0]])
            arm = start - a
            height = arm.dot(n)
            closing = -path.dot(n)
            if closing > along and height > -self.slack:
                t = ti.max((height - radius) / closing, 0.0)
                at = (arm + t * path).dot(u)
                # Past the ends by rounding at most, so that no point slips in between two edges.
                if t < best and at >= -self.slack and at <= self.length[e] + self.slack:
                    best = t
                    normal = n
                    place = a + ti.min(ti.max(at, 0.0), self.length[e]) * u + radius * n
            if radius > self.slack and -path.dot(arm) > along * arm.norm():
                # Shallower than rounding is no corner: else joints of a straight line would be felt.
                t = enter_ball(arm, path, radius - self.slack)
                if t < best:
                    best = t
                    normal = (arm + t * path).normalized()
                    place = a + radius * normal
        return best, place, normal
