"""Surfaces of bodies that open: faces come to light that were inside, and move into the gap between them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from sandbox.render.arrays import upload, vectors, zeros
from sandbox.render.skin import Skin
from sandbox.render.topology import build_rings
from sandbox.render.types import Floats, Ints, Points, vec3
from sandbox.render.vertices import FARTHEST, point3
from sandbox.render.view import project, to_light
from sandbox.scene import cells
from sandbox.scene.appearance import Appearance

OUTER, INNER, RIM = 0, 1, 2
"""Kinds of places: where only outer faces meet, only inner ones, or both."""


@ti.kernel
def move_places(
    has_carried: ti.template(),
    is_thick: ti.template(),
    positions: ti.template(),
    slot: ti.i32,
    particle_count: ti.i32,
    carried: Points,
    points: Ints,
    radius: Floats,
    start: Ints,
    around: Ints,
    around_triangle: Ints,
    hidden: Ints,
    depth: Floats,
    kinds: Ints,
    places: Points,
    outward: Points,
):
    """Where the surface passes every place [m]: a particle, half a cell into the gap where a cell beside it is broken.

    Where `is_thick`, it also lies its `radius` [m] outside. `kinds` tells which places are inside and at rims,
    `outward` which way the gap is.
    """
    for i in range(points.shape[0]):
        p = point3(has_carried, positions, slot, particle_count, carried, points[i])
        n, area, reach, n_gap, around_gap = vec3(0.0, 0.0, 0.0), 0.0, 0.0, vec3(0.0, 0.0, 0.0), 0.0
        inner, outer = 0, 0
        for k in range(start[i], start[i + 1]):
            t = around_triangle[k]
            if hidden[t] == 0:
                is_inner = depth[t] > 0.0
                if is_inner:
                    inner += 1
                else:
                    outer += 1
                if is_inner or is_thick:
                    one = point3(has_carried, positions, slot, particle_count, carried, points[around[2 * k]])
                    two = point3(has_carried, positions, slot, particle_count, carried, points[around[2 * k + 1]])
                    face = (one - p).cross(two - p)
                    n += face
                    area += face.norm()
                    if is_inner:
                        face /= ti.max((one - p).norm_sqr() * (two - p).norm_sqr(), 1e-30)
                        weight = face.norm()
                        n_gap += face
                        around_gap += weight
                        reach += weight * depth[t]
        # As in `cells.gap_points`.
        least = around_gap * ti.static(1.0 / cells.FARTHEST[3])
        p += n_gap * (reach / ti.max(n_gap.dot(n_gap), least * least, 1e-30))
        outward[i] = n_gap.normalized(1e-15)
        if ti.static(is_thick):
            length = ti.sqrt(ti.max(n.dot(n), 1e-30))
            p += n * (radius[i] * ti.min(area / length, FARTHEST) / length)
        places[i] = p
        kind = OUTER
        if inner > 0:
            kind = INNER
            if outer > 0:
                kind = RIM
        kinds[i] = kind


@ti.kernel
def smooth_places(
    start: Ints,
    around: Ints,
    around_triangle: Ints,
    hidden: Ints,
    depth: Floats,
    kinds: Ints,
    places: Points,
    outward: Points,
    smooth: Points,
):
    """Places inside moved out or in, toward the middle of those around them, rims along themselves; others as they are.

    As in `cells.gap_points`.
    """
    for i in range(kinds.shape[0]):
        p, total, number = places[i], vec3(0.0, 0.0, 0.0), 0
        if kinds[i] != OUTER:
            for k in range(start[i], start[i + 1]):
                t = around_triangle[k]
                if hidden[t] == 0 and depth[t] > 0.0:
                    for side in ti.static(range(2)):
                        other = around[2 * k + side]
                        if kinds[i] == INNER or kinds[other] == RIM:
                            total += places[other]
                            number += 1
        if number > 0:
            rise = (total * (1.0 / ti.cast(number, ti.f32)) - p).dot(outward[i])
            p += outward[i] * (rise * ti.static(cells.SMOOTHING[3]))
        smooth[i] = p


@ti.kernel
def place_open_vertices(
    place_of: Ints,
    ring_start: Ints,
    ring: Ints,
    ring_triangle: Ints,
    hidden: Ints,
    view: Floats,
    places: Points,
    world: Points,
    normal: Points,
    screen: Points,
    light: Points,
):
    """World, screen and light coordinates of every vertex that is seen, and its normal from the triangles there are."""
    for i in range(place_of.shape[0]):
        p, n, is_seen = places[place_of[i]], vec3(0.0, 0.0, 0.0), False
        for k in range(ring_start[i], ring_start[i + 1]):
            if hidden[ring_triangle[k]] == 0:
                is_seen = True
                n += (places[ring[2 * k]] - p).cross(places[ring[2 * k + 1]] - p)
        if is_seen:
            world[i] = p
            normal[i] = n * (1.0 / ti.sqrt(ti.max(n.dot(n), 1e-30)))
            screen[i] = project(view, p)
            light[i] = to_light(view, p)


class Opening:
    """Vertices of surfaces with an inside: outer and inner faces have their own ones, at the same places."""

    def __init__(self, skin: Skin, appearance: Appearance) -> None:
        """`skin` is that of an `appearance` in which something can tear."""
        assert appearance.cells is not None
        surface, point = skin.surface, skin.place_point
        # Rims between two skins come last, and are in no ring.
        vertices = surface.triangles[: len(surface.ring) // 3]
        places = skin.vertex_place[vertices]
        radius = np.zeros(len(point))
        radius[skin.vertex_place] = skin.radius
        depth = np.zeros(len(surface.triangles))
        depth[: len(appearance.triangles)] = appearance.cells.triangles.depth
        self._particle_count = appearance.particle_count
        self._is_thick = bool(np.any(radius > 0.0))
        self._points, self._radius, self._depth = upload(point, ti.i32), upload(radius, ti.f32), upload(depth, ti.f32)
        self._around = [upload(values, ti.i32) for values in build_rings(places, places, len(point))]
        self._place_of = upload(skin.vertex_place, ti.i32)
        self._rings = [upload(values, ti.i32) for values in build_rings(vertices, places, len(surface.points))]
        self._kinds = zeros(ti.i32, len(point))
        self._places, self._outward, self._smooth = (vectors(len(point)) for _ in range(3))

    def place(
        self, has_carried: bool, positions: Any, slot: int, carried: Any, hidden: Any, view: Any, targets: Sequence[Any]
    ) -> None:
        """Enter all that are seen into `targets`: world coordinates, normals, screen and light coordinates."""
        move_places(
            has_carried, self._is_thick, positions, slot, self._particle_count, carried, self._points, self._radius,
            *self._around, hidden, self._depth, self._kinds, self._places, self._outward,
        )  # fmt: skip
        smooth_places(*self._around, hidden, self._depth, self._kinds, self._places, self._outward, self._smooth)
        place_open_vertices(self._place_of, *self._rings, hidden, view, self._smooth, *targets)
