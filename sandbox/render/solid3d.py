"""Draws three-dimensional scenes: owns the buffers, and runs the passes of a frame in their order."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.render import colliders, palette, raster, shade, statics, tiles, vertices
from sandbox.render.arrays import upload, vectors, zeros
from sandbox.render.camera import frame_3d
from sandbox.render.light import LIGHT_TILE, LightFrame, key_light
from sandbox.render.opening import Opening
from sandbox.render.posing import PosedSolids
from sandbox.render.seen import seen_points
from sandbox.render.shadow import TABLE
from sandbox.render.skin import build_skin, has_two_skins, is_inner
from sandbox.render.solids import Solid, build_solid
from sandbox.render.tearing import Tearing
from sandbox.render.topology import value_particles
from sandbox.render.types import vec2, vec3, vec4
from sandbox.render.view import BLOCK, CELL, MOVING, OPEN, SOLID, STILL, TILE, view_constants
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import Camera, Collider, MeshCollider

INSIDE_SHADE = 0.85
"""Linear brightness of what was inside of a body, relative to its outside."""


class SolidPainter:
    """Paints a 3D scene into an array that it keeps; only what may have changed is painted again."""

    def __init__(
        self, appearance: Appearance, camera: Camera, size: tuple[int, int], colormap: NDArray[np.float64] | None
    ) -> None:
        """`colormap` is sRGB in [0, 1], shape (count, 3), or None where colours are the bodies' own."""
        built = [(collider, build_solid(collider, appearance.bounds)) for collider in appearance.colliders]
        solids = [(collider, solid) for collider, solid in built if solid is not None]
        self.camera = frame_3d(camera, appearance.bounds, size)
        self.light = self._fit_light(appearance, [solid for _, solid in solids if solid.is_casting])
        self.picture = np.zeros((size[1], size[0], 3), dtype=np.uint8)
        self._by_value = colormap is not None
        self._view = upload(view_constants(self.camera, self.light), ti.f32)
        self._disk = upload(TABLE, ti.f32)
        self._table = upload(palette.encode_table(), ti.i32)
        self._colormap = upload(palette.to_linear(np.zeros((2, 3)) if colormap is None else colormap), ti.f32)
        self._moving = PosedSolids([solid for _, solid in solids if solid.motion is not None])
        self._create_bodies(appearance)
        self._create_surface(appearance)
        self._create_rounds(appearance)
        self._create_tearing(appearance)
        self._create_buffers(size)
        still = [(collider, solid) for collider, solid in solids if solid.motion is None]
        self._paint_statics(
            [collider for collider in appearance.colliders if not collider.motion],
            [solid for collider, solid in still if isinstance(collider, MeshCollider)],
            appearance,
        )
        self._values: Any = upload(np.zeros(1), ti.f32)

    def _fit_light(self, appearance: Appearance, casting: Sequence[Solid]) -> LightFrame:
        """The key light, and a shadow map that holds what there is to see of all shadows."""
        extents = [solid.extent() for solid in casting]
        seen = seen_points(self.camera, appearance.bounds, extents, appearance.colliders)
        casters = [(solid.places(), float(solid.radius.max(initial=0.0))) for solid in casting]
        return key_light(self.camera, appearance.bounds, casters, seen)

    def _create_bodies(self, appearance: Appearance) -> None:
        """Colours and looks of bodies, then of colliders that move, then of the insides of bodies."""
        looks = np.where(appearance.body_two_sided & ~has_two_skins(appearance), OPEN, 0)
        if appearance.cells is not None:
            looks[appearance.cells.body_opens] = OPEN
        colors = palette.to_linear(appearance.body_colors)
        moving, inside = self._moving, colors[:0]
        if np.any(is_inner(appearance)):
            inside = INSIDE_SHADE * colors
        self._body_color = upload(np.concatenate([colors, moving.tints, inside]), ti.f32)
        self._body_look = upload(np.concatenate([looks, np.full(len(moving), SOLID), np.zeros(len(inside))]), ti.i32)

    def _create_surface(self, appearance: Appearance) -> None:
        """Triangles of bodies, then of colliders that move."""
        skin, moving = build_skin(appearance), self._moving
        surface = skin.surface
        self._vertex_count = len(surface.points)
        corners = self._vertex_count + np.arange(moving.corner_count, dtype=np.int32)
        owners = len(appearance.body_colors) + moving.triangle_owner
        self._triangle_count = len(surface.triangles) + len(owners)
        self._points = upload(surface.points, ti.i32)
        self._ring_start = upload(surface.ring_start, ti.i32)
        self._ring = upload(surface.ring, ti.i32)
        self._ring_triangle = upload(surface.ring_triangle, ti.i32)
        self._triangles = upload(np.concatenate([surface.triangles, corners.reshape(-1, 3)]), ti.i32)
        bodies = skin.triangle_body.copy()
        bodies[: len(appearance.triangles)][is_inner(appearance)] += len(appearance.body_colors) + len(moving)
        self._triangle_body = upload(np.concatenate([bodies, owners]), ti.i32)
        self._opening = Opening(skin, appearance) if np.any(is_inner(appearance)) else None
        self._is_thick = bool(np.any(skin.radius > 0.0))
        self._vertex_radius = upload(skin.radius if self._is_thick else np.zeros(1), ti.f32)
        # Colliders show no values: any particle will do.
        self._value_of = upload(
            np.concatenate([value_particles(surface.points, appearance), np.zeros_like(corners)]), ti.i32
        )
        self._vertices = [vectors(self._vertex_count + len(corners)) for _ in range(4)]
        self._particle_count = appearance.particle_count
        self._has_carried = bool(np.any(surface.points >= appearance.particle_count))
        self._carried = vectors(len(appearance.carried_nodes) if self._has_carried else 1)
        if self._has_carried:
            self._carried_nodes = upload(appearance.carried_nodes, ti.i32)
            self._carried_weights = upload(appearance.carried_weights, ti.f32)

    def _create_rounds(self, appearance: Appearance) -> None:
        """Capsules, then spheres as capsules whose ends are one particle, then rods of colliders that move."""
        moving = self._moving
        spheres = np.repeat(np.reshape(appearance.spheres, (-1, 1)), 2, axis=1)
        ends = np.concatenate([np.reshape(appearance.capsules, (-1, 2)), spheres])
        radii = [appearance.capsule_radius, appearance.sphere_radius, moving.rod_radius]
        bodies = [appearance.capsule_body, appearance.sphere_body, len(appearance.body_colors) + moving.rod_owner]
        self._body_round_count = len(ends)
        self._round_count = len(ends) + moving.rod_count
        self._placed_ends = upload(ends, ti.i32)
        self._round_ends = upload(np.concatenate([ends, np.zeros((moving.rod_count, 2))]), ti.i32)
        self._round_radius = upload(np.concatenate(radii), ti.f32)
        self._round_body = upload(np.concatenate(bodies), ti.i32)
        self._rounds = [vectors(self._round_count) for _ in range(2)]

    def _create_tearing(self, appearance: Appearance) -> None:
        cells = appearance.cells
        others = len(appearance.spheres) + self._moving.rod_count
        self._tearing = Tearing(
            cells,
            [
                (None if cells is None else cells.triangles, self._triangle_count),
                (None if cells is None else cells.capsules, len(appearance.capsules) + others),
            ],
        )

    def _create_buffers(self, size: tuple[int, int]) -> None:
        width, height = size
        across, down = -(-width // TILE), -(-height // TILE)
        self._samples = ti.ndarray(ti.u64, (height, width, 4))
        self._depths = ti.ndarray(ti.f32, (height, width, 4))
        self._ambient, self._key = ti.ndarray(vec3, (height, width)), ti.ndarray(vec3, (height, width))
        self._place, self._slope = ti.ndarray(vec3, (height, width)), ti.ndarray(vec2, (height, width))
        self._tiles, self._tiles_before = zeros(ti.i32, down, across), zeros(ti.i32, down, across)
        self._tile_list = ti.ndarray(ti.i32, across * down + 1)
        self._tile_reach = ti.ndarray(vec4, (down, across))
        across, down = self.light.size
        self._shadow_map, self._still_map = (zeros(ti.i32, down, across) for _ in range(2))
        self._shadow_block, self._still_block = (zeros(ti.i32, down // BLOCK, across // BLOCK) for _ in range(2))
        self._shadow_cells, self._still_cells = (zeros(ti.i32, down // CELL, across // CELL, 2) for _ in range(2))
        self._light_tiles = zeros(ti.i32, down // LIGHT_TILE, across // LIGHT_TILE)

    def _paint_statics(self, still: Sequence[Collider], meshes: Sequence[Solid], appearance: Appearance) -> None:
        """Cast what does not move once, and ask for the whole picture to be painted in the first frame."""
        cast = [collider for collider in still if not isinstance(collider, MeshCollider)]
        rows = colliders.collider_rows(cast, appearance.bounds)
        collider_rows = upload(rows if len(rows) else colliders.nothing(), ti.f32)
        mesh = PosedSolids(meshes)
        mesh_vertices = [vectors(mesh.corner_count) for _ in range(4)]
        if len(mesh):
            self._enter_meshes(mesh, mesh_vertices)
        if len(mesh) or np.any(rows[:, colliders.KIND] >= colliders.SPHERE):
            statics.cast_static_shadow(collider_rows, self._view, self._still_map, self._still_block, self._light_tiles)
            self._shadow_map.copy_from(self._still_map)
            self._shadow_block.copy_from(self._still_block)
            tiles.bound_shadow(STILL, self._still_map, self._still_cells, self._light_tiles)
            self._shadow_cells.copy_from(self._still_cells)
        statics.cast_static_picture(
            len(mesh) > 0, collider_rows, mesh_vertices[2], mesh_vertices[1], upload(mesh.triangle_owner, ti.i32),
            upload(mesh.tints, ti.f32), self._view, *map(float, self.light.size), self._samples, self._depths,
            self._ambient, self._key, self._place, self._slope, self._tile_reach,
        )  # fmt: skip
        self._tiles.fill(0)
        self._tiles_before.fill(1)

    def _enter_meshes(self, mesh: PosedSolids, mesh_vertices: Sequence[Any]) -> None:
        """Find out where meshes that do not move are in front, and what they shade."""
        mesh.place(0.0, self._view, mesh_vertices, 0, (vectors(1), vectors(1)), 0)
        self._samples.fill(0)
        raster.draw_triangles(
            False, self._tearing.hidden, upload(np.arange(mesh.corner_count), ti.i32),
            upload(mesh.triangle_owner, ti.i32), upload(np.full(len(mesh), SOLID), ti.i32), mesh_vertices[2],
            mesh_vertices[3], self._samples, self._tiles, self._still_map, self._still_block, self._light_tiles,
        )  # fmt: skip
        statics.settle_shadow(self._light_tiles)

    def paint(
        self, positions: Any, slot: int, values: Any, value_scale: float, time: float = 0.0, torn: Any = None
    ) -> None:
        """Bring the picture up to date with row `slot` of `positions`, and colliders at `time` [s].

        `values` times `value_scale` give colours; what hangs on springs that are nonzero in `torn` is left out.
        """
        if self._by_value:
            self._copy_values(values, value_scale)
        self._tearing.update(torn)
        self._place_all(positions, slot, time)
        self._enter_all()
        tiles.choose_tiles(self._tiles, self._tiles_before, self._tile_list, self._tile_reach, self._light_tiles)
        tiles.bound_shadow(MOVING, self._shadow_map, self._shadow_cells, self._light_tiles)
        self._shade()
        tiles.restore_shadow_map(
            self._still_map, self._still_block, self._still_cells, self._shadow_map, self._shadow_block,
            self._shadow_cells, self._light_tiles,
        )  # fmt: skip

    def _copy_values(self, values: Any, scale: float) -> None:
        if self._values.shape != values.shape:
            self._values = ti.ndarray(ti.f32, values.shape)
        vertices.copy_values(values, scale, self._values)

    def _place_all(self, positions: Any, slot: int, time: float) -> None:
        """Where all vertices and rods are."""
        if self._has_carried:
            vertices.carry_points(positions, slot, self._carried_nodes, self._carried_weights, self._carried)
        if self._opening is not None:
            self._opening.place(
                self._has_carried, positions, slot, self._carried, self._tearing.hidden, self._view, self._vertices
            )
        elif self._vertex_count:
            vertices.place_vertices(
                self._has_carried, self._tearing.is_possible, self._is_thick, positions, slot, self._particle_count,
                self._carried, self._points, self._vertex_radius, self._ring_start, self._ring, self._ring_triangle,
                self._tearing.hidden, self._view, *self._vertices,
            )  # fmt: skip
        if self._body_round_count:
            vertices.place_rounds(positions, slot, self._placed_ends, *self._rounds)
        if len(self._moving):
            self._moving.place(
                time, self._view, self._vertices, self._vertex_count, self._rounds, self._body_round_count
            )

    def _enter_all(self) -> None:
        """Which triangles and rods are in front, for the camera and for the light."""
        targets = (self._samples, self._tiles, self._shadow_map, self._shadow_block, self._light_tiles)
        can_tear, hidden = self._tearing.is_possible, self._tearing.hidden
        if self._triangle_count:
            raster.draw_triangles(
                can_tear, hidden, self._triangles, self._triangle_body, self._body_look, *self._vertices[2:], *targets
            )
        if self._round_count:
            raster.draw_rounds(
                can_tear, hidden, self._triangle_count, *self._rounds, self._round_radius, self._view, *targets
            )

    def _shade(self) -> None:
        world, normal, screen, _ = self._vertices
        shade.shade_tiles(
            self._by_value, len(self._moving) > 0, self._tile_list, self._tiles, self._light_tiles, self._samples,
            self._depths, self._shadow_map, self._shadow_block, self._shadow_cells, self._ambient, self._key,
            self._place, self._slope, self._view, self._disk, self._table, self._triangles, self._triangle_body,
            self._body_look, self._body_color, world, normal, screen, self._value_of, *self._rounds,
            self._round_radius, self._round_body, self._round_ends, self._values, self._colormap, self.picture,
        )  # fmt: skip
