"""Draws three-dimensional scenes: owns the buffers, and runs the passes of a frame in their order."""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.render import colliders, palette, raster, shade, statics, tiles, vertices
from sandbox.render.arrays import upload, vectors, zeros
from sandbox.render.camera import frame_3d
from sandbox.render.light import SHADOW_SIZE, key_light
from sandbox.render.shadow import TABLE
from sandbox.render.topology import build_surface
from sandbox.render.types import vec2, vec3, vec4
from sandbox.render.view import BLOCK, LIGHT_TILE, TILE, view_constants
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import Camera


class SolidPainter:
    """Paints a 3D scene into an array that it keeps; only what may have changed is painted again."""

    def __init__(
        self, appearance: Appearance, camera: Camera, size: tuple[int, int], colormap: NDArray[np.float64] | None
    ) -> None:
        """`colormap` is sRGB in [0, 1], shape (count, 3), or None where colours are the bodies' own."""
        self.camera = frame_3d(camera, appearance.bounds, size)
        self.light = key_light(self.camera, appearance.bounds, appearance.colliders)
        self.picture = np.zeros((size[1], size[0], 3), dtype=np.uint8)
        self._by_value = colormap is not None
        self._view = upload(view_constants(self.camera, self.light), ti.f32)
        self._disk = upload(TABLE, ti.f32)
        self._table = upload(palette.encode_table(), ti.i32)
        self._colormap = upload(palette.to_linear(np.zeros((2, 3)) if colormap is None else colormap), ti.f32)
        self._body_color = upload(palette.to_linear(appearance.body_colors), ti.f32)
        self._body_open = upload(appearance.body_two_sided, ti.i32)
        self._create_surface(appearance)
        self._create_rounds(appearance)
        self._create_buffers(size)
        self._paint_statics(appearance)
        self._values: Any = upload(np.zeros(1), ti.f32)

    def _create_surface(self, appearance: Appearance) -> None:
        surface = build_surface(appearance.triangles)
        vertex_count = len(surface.particles)
        self._has_triangles = len(surface.triangles) > 0
        self._particles = upload(surface.particles, ti.i32)
        self._ring_start = upload(surface.ring_start, ti.i32)
        self._ring = upload(surface.ring, ti.i32)
        self._triangles = upload(surface.triangles, ti.i32)
        self._triangle_body = upload(appearance.triangle_body, ti.i32)
        self._world, self._normal = vectors(vertex_count), vectors(vertex_count)
        self._screen, self._texel = vectors(vertex_count), vectors(vertex_count)

    def _create_rounds(self, appearance: Appearance) -> None:
        """Capsules, then spheres as capsules whose ends are one particle."""
        spheres = np.repeat(np.reshape(appearance.spheres, (-1, 1)), 2, axis=1)
        ends = np.concatenate([np.reshape(appearance.capsules, (-1, 2)), spheres])
        self._has_rounds = len(ends) > 0
        self._round_ends = upload(ends, ti.i32)
        self._round_radius = upload(np.concatenate([appearance.capsule_radius, appearance.sphere_radius]), ti.f32)
        self._round_body = upload(np.concatenate([appearance.capsule_body, appearance.sphere_body]), ti.i32)
        self._round_start, self._round_end = vectors(len(ends)), vectors(len(ends))

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
        blocks, light_tiles = SHADOW_SIZE // BLOCK, SHADOW_SIZE // LIGHT_TILE
        self._shadow_map, self._still_map = (zeros(ti.i32, SHADOW_SIZE, SHADOW_SIZE) for _ in range(2))
        self._shadow_block, self._still_block = (zeros(ti.i32, blocks, blocks) for _ in range(2))
        self._light_tiles = zeros(ti.i32, light_tiles, light_tiles)

    def _paint_statics(self, appearance: Appearance) -> None:
        """Cast what does not move once, and ask for the whole picture to be painted in the first frame."""
        rows = colliders.collider_rows(appearance.colliders, appearance.bounds)
        is_casting = bool(np.any(rows[:, colliders.KIND] >= colliders.SPHERE))
        collider_rows = upload(rows if len(rows) else colliders.nothing(), ti.f32)
        if is_casting:
            statics.cast_static_shadow(collider_rows, self._view, self._still_map, self._still_block, self._light_tiles)
            self._shadow_map.copy_from(self._still_map)
            self._shadow_block.copy_from(self._still_block)
        statics.cast_static_picture(
            collider_rows, self._view, float(SHADOW_SIZE), self._samples, self._depths,
            self._ambient, self._key, self._place, self._slope, self._tile_reach,
        )  # fmt: skip
        self._tiles_before.fill(1)

    def paint(self, positions: Any, slot: int, values: Any, value_scale: float) -> None:
        """Bring the picture up to date with row `slot` of `positions`; values times `value_scale` give colours."""
        if self._by_value:
            self._copy_values(values, value_scale)
        if self._has_triangles:
            self._paint_triangles(positions, slot)
        if self._has_rounds:
            self._paint_rounds(positions, slot)
        tiles.choose_tiles(self._tiles, self._tiles_before, self._tile_list, self._tile_reach, self._light_tiles)
        self._shade()
        tiles.restore_shadow_map(
            self._still_map, self._still_block, self._shadow_map, self._shadow_block, self._light_tiles
        )

    def _copy_values(self, values: Any, scale: float) -> None:
        if self._values.shape != values.shape:
            self._values = ti.ndarray(ti.f32, values.shape)
        vertices.copy_values(values, scale, self._values)

    def _paint_triangles(self, positions: Any, slot: int) -> None:
        vertices.place_vertices(
            positions, slot, self._particles, self._ring_start, self._ring, self._view,
            self._world, self._normal, self._screen, self._texel,
        )  # fmt: skip
        raster.draw_triangles(
            self._triangles, self._triangle_body, self._body_open, self._screen, self._texel,
            self._samples, self._tiles, self._shadow_map, self._shadow_block, self._light_tiles,
        )  # fmt: skip

    def _paint_rounds(self, positions: Any, slot: int) -> None:
        vertices.place_rounds(positions, slot, self._round_ends, self._round_start, self._round_end)
        raster.draw_rounds(
            self._round_start, self._round_end, self._round_radius, self._view,
            self._samples, self._tiles, self._shadow_map, self._shadow_block, self._light_tiles,
        )  # fmt: skip

    def _shade(self) -> None:
        shade.shade_tiles(
            self._by_value, self._tile_list, self._tiles, self._light_tiles, self._samples, self._depths,
            self._shadow_map, self._shadow_block, self._ambient, self._key, self._place, self._slope,
            self._view, self._disk, self._table, self._triangles, self._triangle_body, self._body_open,
            self._body_color, self._world, self._normal, self._screen, self._particles, self._round_start,
            self._round_end, self._round_radius, self._round_body, self._round_ends, self._values, self._colormap,
            self.picture,
        )  # fmt: skip
