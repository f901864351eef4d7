"""Three-dimensional scenes as one list of triangles with their light: bodies, colliders, shadows, surroundings."""

from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.render import palette, vertices
from sandbox.render.arrays import refill, upload, vectors
from sandbox.render.camera import PinholeCamera
from sandbox.render.ggui import lighting
from sandbox.render.ggui.rounds import capsule_pattern
from sandbox.render.ggui.surroundings import SKY_REACH, Plane, plane_light, planes_of, surroundings
from sandbox.render.light import key_light
from sandbox.render.opening import Opening
from sandbox.render.posing import PosedSolids
from sandbox.render.skin import build_skin, has_two_skins, is_inner
from sandbox.render.solid3d import INSIDE_SHADE
from sandbox.render.solids import build_solid
from sandbox.render.topology import value_particles
from sandbox.render.view import OPEN, SOLID, view_constants
from sandbox.scene.appearance import Appearance, FloatArray, IntArray

NEAREST = 0.004
"""Distance of the nearest that is drawn, in extents of the bodies' box."""
MOST_SHADOWED = 2
"""Planes at most that shadows fall on."""


class SolidScenery:
    """Vertices and triangles of a scene, brought up to date for every frame.

    Vertices are those of surfaces, of colliders' surfaces, of rods and spheres; then their shadows, plane after plane;
    then the surroundings.
    """

    def __init__(self, appearance: Appearance, camera: PinholeCamera, colormap: FloatArray | None) -> None:
        """`colormap` is sRGB in [0, 1], shape (count, 3), or None where colours are the bodies' own."""
        solids = [build_solid(collider, appearance.bounds) for collider in appearance.colliders]
        self._appearance = appearance
        self._solids = PosedSolids([solid for solid in solids if solid is not None])
        self._is_casting = np.array([solid.is_casting for solid in solids if solid is not None], dtype=bool)
        self._extent = float(np.max(appearance.bounds[1] - appearance.bounds[0])) or 1.0
        self._light = key_light(camera, appearance.bounds, [], np.zeros((0, 3)))
        self._planes = planes_of(appearance.colliders)
        self._shadowed = [plane for plane in self._planes if plane.is_ground][:MOST_SHADOWED]
        self._by_value = colormap is not None
        self._colormap = upload(palette.to_linear(np.zeros((2, 3)) if colormap is None else colormap), ti.f32)
        self._table = upload(palette.encode_table(), ti.i32)
        self._positions = ti.Vector.field(3, ti.f32)
        builder = runtime.fields_builder()
        builder.dense(ti.ij, (1, appearance.particle_count)).place(self._positions)
        builder.finalize()
        self._values = upload(np.zeros(appearance.particle_count), ti.f32)
        self._create_owners(appearance)
        self._create_surface(appearance)
        self._create_rounds(appearance)
        self._create_triangles(camera)
        self.look(camera)

    @property
    def depth_range(self) -> tuple[float, float]:
        """Distances from the eye between which all is drawn [m]."""
        return NEAREST * self._extent, 1.1 * SKY_REACH * self._extent

    def _create_owners(self, appearance: Appearance) -> None:
        """Colours and looks of bodies, then of colliders, then of the insides of bodies."""
        looks = np.where(appearance.body_two_sided & ~has_two_skins(appearance), OPEN, 0)
        if appearance.cells is not None:
            looks[appearance.cells.body_opens] = OPEN
        colors, solids = palette.to_linear(appearance.body_colors), self._solids
        inside = INSIDE_SHADE * colors
        self._color = upload(np.concatenate([colors, solids.tints, inside]), ti.f32)
        self._look = upload(np.concatenate([looks, np.full(len(solids), SOLID), np.zeros(len(inside))]), ti.i32)

    def _create_surface(self, appearance: Appearance) -> None:
        """Vertices of bodies' surfaces, then of colliders'."""
        skin, solids = build_skin(appearance), self._solids
        surface = skin.surface
        body_count = len(appearance.body_colors)
        self._skin_count = len(surface.points)
        self._surface_count = self._skin_count + solids.corner_count
        self._skin_triangles = surface.triangles
        self._points = upload(surface.points, ti.i32)
        self._ring_start, self._ring = upload(surface.ring_start, ti.i32), upload(surface.ring, ti.i32)
        self._ring_triangle = upload(surface.ring_triangle, ti.i32)
        self._is_thick = bool(np.any(skin.radius > 0.0))
        self._radius = upload(skin.radius if self._is_thick else np.zeros(1), ti.f32)
        owner = np.zeros(self._surface_count, dtype=np.int32)
        triangle_owner = skin.triangle_body.copy()
        triangle_owner[: len(appearance.triangles)][is_inner(appearance)] += body_count + len(solids)
        owner[surface.triangles.ravel()] = np.repeat(triangle_owner, 3)
        owner[self._skin_count :] = body_count + np.repeat(solids.triangle_owner, 3)
        self._owner = upload(owner, ti.i32)
        shown = value_particles(surface.points, appearance)
        self._value_of = upload(np.concatenate([shown, np.zeros(solids.corner_count, dtype=np.int32)]), ti.i32)
        self._places = [vectors(self._surface_count) for _ in range(4)]
        self._particle_count = appearance.particle_count
        self._has_carried = bool(np.any(surface.points >= appearance.particle_count))
        self._carried = vectors(len(appearance.carried_nodes) if self._has_carried else 1)
        if self._has_carried:
            self._carried_nodes = upload(appearance.carried_nodes, ti.i32)
            self._carried_weights = upload(appearance.carried_weights, ti.f32)
        self._can_tear = appearance.tears
        self._opening = Opening(skin, appearance) if np.any(is_inner(appearance)) else None
        self._hidden = upload(np.zeros(len(surface.triangles)), ti.i32)

    def _create_rounds(self, appearance: Appearance) -> None:
        """Capsules, then spheres, then rods of colliders."""
        solids = self._solids
        spheres = np.repeat(np.reshape(appearance.spheres, (-1, 1)), 2, axis=1)
        ends = np.concatenate([np.reshape(appearance.capsules, (-1, 2)), spheres])
        radii = [appearance.capsule_radius, appearance.sphere_radius, solids.rod_radius]
        bodies = [appearance.capsule_body, appearance.sphere_body, len(appearance.body_colors) + solids.rod_owner]
        self._body_round_count = len(ends)
        self._round_count = len(ends) + solids.rod_count
        self._pattern = capsule_pattern(self._round_count)
        self._pattern_rows = upload(np.column_stack([self._pattern.directions, self._pattern.ends]), ti.f32)
        self._placed_ends = upload(ends, ti.i32)
        self._round_ends = upload(np.concatenate([ends, np.zeros((solids.rod_count, 2))]), ti.i32)
        self._round_radius = upload(np.concatenate(radii), ti.f32)
        self._round_owner = upload(np.concatenate(bodies), ti.i32)
        self._rounds = [vectors(self._round_count) for _ in range(2)]

    def _create_triangles(self, camera: PinholeCamera) -> None:
        """The order of drawing: bodies, shadows, ground and sky, lines on the ground, walls.

        What is in front comes first, since what lies behind need not be coloured then; what lets light through last.
        """
        first_round = self._surface_count
        corners = np.arange(self._skin_count, self._surface_count, dtype=np.int32).reshape(-1, 3)
        rods = self._pattern.indices(self._round_count, first_round)
        self._body_count = first_round + self._round_count * len(self._pattern.ends)
        around = self._surround(camera)
        first = self._body_count * (1 + len(self._shadowed))
        self.vertices = np.zeros((first + len(around.vertices), lighting.STRIDE), dtype=np.float32)
        """As GGUI has them: place, normal, texture, colour; shape (vertex_count, 12)."""
        # Nothing comes of a normal's direction, but not a number of its absence.
        self.vertices[:, 3:6] = 1.0
        casting = self._casting(corners, rods)
        own = np.concatenate([self._skin_triangles.reshape(-1, 3), corners, rods.reshape(-1, 3)])
        shadows = [casting + self._body_count * (1 + k) for k in range(len(self._shadowed))]
        parts = [own, *shadows, around.behind + first, around.lines + first, around.walls + first]
        self._shadow_starts = np.cumsum([len(part) for part in parts])[: len(shadows)]
        self._whole = np.concatenate(parts).astype(np.int32)
        self.indices: IntArray = self._whole.ravel().copy()
        """Vertices of all triangles, shape (3 triangle_count,)."""

    def _casting(self, corners: IntArray, rods: IntArray) -> IntArray:
        """Triangles that cast shadows: bodies' surfaces first, then their rods."""
        is_casting = self._is_casting
        rod_casts = np.concatenate([np.ones(self._body_round_count, dtype=bool), is_casting[self._solids.rod_owner]])
        kept = corners[is_casting[self._solids.triangle_owner]] if len(corners) else corners
        return np.concatenate([self._skin_triangles.reshape(-1, 3), rods[rod_casts].reshape(-1, 3), kept])

    def _surround(self, camera: PinholeCamera) -> Any:
        return surroundings(camera, self._planes, self._light.direction, self._extent)

    def look(self, camera: PinholeCamera) -> None:
        """Look from elsewhere."""
        self._view = upload(view_constants(camera, self._light), ti.f32)
        self._eye = camera.eye
        rows = self._surround(camera).vertices
        around = self.vertices[len(self.vertices) - len(rows) :]
        around[:, :3], around[:, 8:] = rows[:, :3], rows[:, 3:]

    def update(self, positions: Any, values: Any, hidden: Any, time: float) -> None:
        """Bring all vertices up to date with positions [m], shape (particle_count, 3), and values in [0, 1].

        `hidden` is nonzero for triangles, then outlines, then capsules of the appearance that are not drawn; None:
        as before.
        """
        lighting.take_positions(positions, self._positions)
        if self._by_value:
            self._values.from_numpy(values)
        if hidden is not None and self._can_tear:
            self._hide(hidden)
        if self._has_carried:
            vertices.carry_points(self._positions, 0, self._carried_nodes, self._carried_weights, self._carried)
        if self._opening is not None:
            self._opening.place(
                self._has_carried, self._positions, 0, self._carried, self._hidden, self._view, self._places
            )
        elif self._skin_count:
            vertices.place_vertices(
                self._has_carried, self._can_tear, self._is_thick, self._positions, 0, self._particle_count,
                self._carried, self._points, self._radius, self._ring_start, self._ring, self._ring_triangle,
                self._hidden, self._view, *self._places,
            )  # fmt: skip
        if self._body_round_count:
            vertices.place_rounds(self._positions, 0, self._placed_ends, *self._rounds)
        if len(self._solids):
            self._solids.place(time, self._view, self._places, self._skin_count, self._rounds, self._body_round_count)
        self._light_up()

    def _light_up(self) -> None:
        """The light that every vertex sends to the eye, and shadows."""
        shared = (self._look, self._color, self._values, self._colormap, self._view, self._table, self.vertices)
        if self._surface_count:
            lighting.light_surfaces(
                self._by_value, self._surface_count, *self._places[:2], self._owner, self._value_of, *shared
            )
        if self._round_count:
            lighting.light_rounds(
                self._by_value, self._round_count, self._surface_count, self._pattern_rows, *self._rounds,
                self._round_radius, self._round_owner, self._round_ends, *shared,
            )  # fmt: skip
        for number, plane in enumerate(self._shadowed):
            lighting.cast_shadows(
                self._body_count, (1 + number) * self._body_count, self._extent, self._plane_numbers(plane),
                self._view, self._table, self.vertices,
            )  # fmt: skip

    def _plane_numbers(self, plane: Plane) -> Any:
        shade = plane_light(plane, self._light.direction, lighting.SEEN_IN_SHADOW)
        return np.concatenate([plane.point, plane.normal, shade]).astype(np.float32)

    def _hide(self, hidden: Any) -> None:
        """Make triangles of what has torn vanish: all of their corners are one."""
        appearance = self._appearance
        triangle_count, capsule_count = len(appearance.triangles), len(appearance.capsules)
        # Rims and other sides of sheets come after; those do not tear.
        surface = np.zeros(len(self._skin_triangles), dtype=np.int32)
        surface[:triangle_count] = hidden[:triangle_count]
        refill(self._hidden, surface)
        rods = np.repeat(hidden[len(hidden) - capsule_count :] != 0, len(self._pattern.triangles))
        indices = self._whole.copy()
        rod_start = len(surface) + self._solids.corner_count // 3
        for start, first_rod in [(0, rod_start), *((s, len(surface)) for s in self._shadow_starts)]:
            indices[start : start + len(surface)][surface != 0] = 0
            indices[start + first_rod : start + first_rod + len(rods)][rods] = 0
        self.indices[:] = indices.ravel()
