"""Searches among the triangles of a closed mesh, on the device: the closest place, what a path meets first, winding.

All walk the same tree, see :mod:`sandbox.contact.triangle_tree`. A ball meets faces from their front, and the edges and
corners that stick out: each of them once, whichever triangles share it.
"""

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.contact.colliders.solid import NEVER, enter_ball
from sandbox.contact.mesh_surface import COPLANAR, REVERSED, STICKS_OUT, MeshSurface
from sandbox.state import place

_BIG = 1e30
FACE = 0
"""What is closest is within a triangle; from 1 on its edges 0-1, 1-2, 2-0, from 4 on its corners 0, 1, 2."""


@ti.func
def outside_square(low, high, x):
    """Squared distance of a point from an axis-aligned box [m^2]."""
    away = ti.max(ti.max(low - x, x - high), 0.0)
    return away.dot(away)


@ti.data_oriented
class TriangleSearch:
    """The triangles of a surface; ``slack`` is the distance within which things touch [m]."""

    def __init__(self, builder: ti.FieldsBuilder, surface: MeshSurface, slack: float) -> None:
        vector = runtime.vector(3)
        self.surface = surface
        self.slack = slack
        self.real = runtime.real()
        self.nodes = len(surface.tree.skip)
        count = len(surface.corners)
        self.low, self.high = (place(builder, vector.field(), self.nodes) for _ in range(2))
        self.skip, self.first, self.last = (place(builder, ti.field(ti.i32), self.nodes) for _ in range(3))
        self.corner = place(builder, vector.field(), count, 3)
        self.normal = place(builder, vector.field(), count)
        self.outward = place(builder, vector.field(), count, 6)
        self.marks = place(builder, ti.field(ti.i32), count)

    def load(self) -> None:
        """Upload the triangles and their tree."""
        tree, surface = self.surface.tree, self.surface
        boxes = np.concatenate([tree.low - self.slack, tree.high + self.slack], axis=1)
        self._write_tree(boxes, np.stack([tree.skip, tree.first, tree.last], axis=1).astype(np.int32))
        vectors = np.concatenate([surface.corners, surface.normals[:, None], surface.outward], axis=1)
        self._write_triangles(np.ascontiguousarray(vectors), surface.marks)

    @ti.kernel
    def _write_tree(self, boxes: ti.types.ndarray(), links: ti.types.ndarray()):
        for node in range(self.nodes):
            for axis in ti.static(range(3)):
                self.low[node][axis] = boxes[node, axis]
                self.high[node][axis] = boxes[node, 3 + axis]
            self.skip[node] = links[node, 0]
            self.first[node] = links[node, 1]
            self.last[node] = links[node, 2]

    @ti.kernel
    def _write_triangles(self, vectors: ti.types.ndarray(), marks: ti.types.ndarray()):
        for t in range(marks.shape[0]):
            for axis in ti.static(range(3)):
                for k in ti.static(range(3)):
                    self.corner[t, k][axis] = vectors[t, k, axis]
                self.normal[t][axis] = vectors[t, 3, axis]
                for k in ti.static(range(6)):
                    self.outward[t, k][axis] = vectors[t, 4 + k, axis]
            self.marks[t] = marks[t]

    # -- the closest place --------------------------------------------------------------------------

    @ti.func
    def closest(self, x, guess):
        """The place closest to x [m], its triangle, which part of that it is, and the leaf that holds it.

        The leaf ``guess`` is looked into first: the nearer its triangles, the less is left to look at.
        """
        best = ti.cast(_BIG, self.real)
        spot, triangle, part, leaf = x, 0, FACE, guess
        node, guessing = guess, True
        while node < self.nodes:
            onward = self.skip[node]
            if outside_square(self.low[node], self.high[node], x) < best:
                first, last = self.first[node], self.last[node]
                if first == last:
                    onward = node + 1
                for t in range(first, last):
                    at, of = self._on_triangle(x, t)
                    square = (x - at).dot(x - at)
                    if square < best:
                        best, spot, triangle, part, leaf = square, at, t, of, node
            node = ti.select(guessing, 0, onward)
            guessing = False
        return spot, triangle, part, leaf

    @ti.func
    def _on_triangle(self, x, t):
        """The place of a triangle that is closest to x, and which part of it that is.

        Of the edges only those that x is beyond: that holds for slivers, too.
        """
        n = self.normal[t]
        spot = x - (x - self.corner[t, 0]).dot(n) * n
        part = FACE
        best = ti.cast(_BIG, self.real)
        for k in range(3):  # not written out: the code is long
            start = self.corner[t, k]
            edge = self.corner[t, (k + 1) % 3] - start
            arm = x - start
            if edge.cross(n).dot(arm) > 0.0:
                fraction = ti.min(ti.max(arm.dot(edge) / edge.dot(edge), 0.0), 1.0)
                apart = arm - fraction * edge
                if apart.dot(apart) < best:
                    best = apart.dot(apart)
                    spot = start + fraction * edge
                    part = 1 + k
                    if fraction <= 0.0:
                        part = 4 + k
                    elif fraction >= 1.0:
                        part = 4 + (k + 1) % 3
        return spot, part

    @ti.func
    def outward_at(self, triangle, part):
        """Direction away from the solid at a part of a triangle."""
        result = self.normal[triangle]
        if part > 0:
            result = self.outward[triangle, part - 1]
        return result

    @ti.func
    def is_flat(self, triangle, part):
        """Whether the surface is flat at a part of a triangle: a face, or an edge between two of a plane."""
        flat = part == FACE
        if part > FACE and part < 4:
            flat = self.marks[triangle] & (ti.static(COPLANAR[0]) << (part - 1)) != 0
        return flat

    # -- the first meeting on a path ----------------------------------------------------------------

    @ti.func
    def sweep(self, start, path, radius, along):
        """Fraction of a path from outside at which a ball first meets the surface, where it is then, and the normal.

        Less than ``along`` [m] towards something is not towards it; NEVER where it meets nothing.
        """
        best = ti.cast(NEVER, self.real)
        spot, normal = start, 0.0 * start
        length = path.norm()
        low, high = ti.min(start, start + path) - radius, ti.max(start, start + path) + radius
        node = 0
        while node < self.nodes:
            onward = self.skip[node]
            node_low, node_high = self.low[node], self.high[node]
            reach = radius + self.slack + ti.min(best, 1.0) * length
            over = ti.max(node_low - high, low - node_high).max() <= 0.0
            if over and outside_square(node_low, node_high, start) <= reach * reach:
                first, last = self.first[node], self.last[node]
                if first == last:
                    onward = node + 1
                for t in range(first, last):
                    fraction, at, n = self._meet(t, start, path, radius, along)
                    if fraction < best:
                        best, spot, normal = fraction, at, n
            node = onward
        return best, spot, normal

    @ti.func
    def _meet(self, t, start, path, radius, along):
        """The same with one triangle."""
        best, spot, normal = self._meet_face(t, start, path, radius, along)
        marks = self.marks[t] & ti.static(sum(STICKS_OUT))
        if marks != 0 and radius > self.slack:
            # One edge and one corner written out, not three: the code is long.
            for k in range(3):
                edge_start = self.corner[t, k]
                arm = start - edge_start
                edge = self.corner[t, (k + 1) % 3] - edge_start
                if marks & (ti.static(STICKS_OUT[0]) << k):
                    fraction, at = self._enter_edge(arm, edge, path, radius, along)
                    if fraction < best:
                        best = fraction
                        normal = (arm + fraction * path - at * edge).normalized()
                        spot = edge_start + at * edge + radius * normal
                if marks & (ti.static(STICKS_OUT[3]) << k) and -path.dot(arm) > along * arm.norm():
                    # Shallower than rounding is no corner.
                    fraction = enter_ball(arm, path, radius - self.slack)
                    if fraction < best:
                        best = fraction
                        normal = (arm + fraction * path).normalized()
                        spot = edge_start + radius * normal
        return best, spot, normal

    @ti.func
    def _meet_face(self, t, start, path, radius, along):
        fraction = ti.cast(NEVER, self.real)
        n = self.normal[t]
        spot = start
        closing = -path.dot(n)
        height = (start - self.corner[t, 0]).dot(n)
        if closing > along and height > -self.slack:
            at = ti.max((height - radius) / closing, 0.0)
            if at <= 1.0:
                meeting = start + at * path
                within = True
                for k in range(3):
                    corner = self.corner[t, k]
                    edge = self.corner[t, (k + 1) % 3] - corner
                    beyond = edge.cross(n).dot(meeting - corner)
                    # Past an edge by rounding at most, so that no point slips in between two triangles.
                    if beyond > 0.0 and beyond > self.slack * edge.norm():
                        within = False
                if within:
                    fraction = at
                    spot = meeting + (radius - height + at * closing) * n
        return fraction, spot, n

    @ti.func
    def _enter_edge(self, arm, edge, path, radius, along):
        """Fraction of a path at which a ball meets an edge, and where on it [1]; ``arm`` leads from its start."""
        square = edge.dot(edge)
        at, onward = arm.dot(edge) / square, path.dot(edge) / square
        across, moved = arm - at * edge, path - onward * edge
        fraction = ti.cast(NEVER, self.real)
        if -moved.dot(across) > along * across.norm():
            fraction = enter_ball(across, moved, radius - self.slack)
            at = at + fraction * onward
            if at < 0.0 or at > 1.0:
                fraction = ti.cast(NEVER, self.real)
        return fraction, at

    # -- winding ------------------------------------------------------------------------------------

    @ti.func
    def winding(self, x):
        """How often the mesh winds around x: crossings of the ray from there along +z."""
        turns = 0
        node = 0
        while node < self.nodes:
            onward = self.skip[node]
            low, high = self.low[node], self.high[node]
            if low[0] <= x[0] and x[0] <= high[0] and low[1] <= x[1] and x[1] <= high[1] and x[2] <= high[2]:
                first, last = self.first[node], self.last[node]
                if first == last:
                    onward = node + 1
                for t in range(first, last):
                    turns += self._crossing(x, t)
            node = onward
        return turns

    @ti.func
    def _crossing(self, x, t):
        """1 where the ray from x along +z leaves the solid through a triangle, -1 where it enters it, or 0."""
        left = 0
        # A loop at run time: both triangles of an edge must round alike.
        for k in range(3):
            backward = self.marks[t] & (ti.static(REVERSED[0]) << k) != 0
            onward = (k + 1) % 3
            a, b = self.corner[t, ti.select(backward, onward, k)], self.corner[t, ti.select(backward, k, onward)]
            area = (b[0] - a[0]) * (x[1] - a[1]) - (b[1] - a[1]) * (x[0] - a[0])
            left += ti.select((area >= 0.0) != backward, 1, -1)
        height = (self.corner[t, 0] - x).dot(self.normal[t])
        result = 0
        if left == 3 and height > 0.0:
            result = 1
        elif left == -3 and height < 0.0:
            result = -1
        return result
