"""Draws two-dimensional scenes: owns the buffers, and runs the passes of a frame in their order."""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.render import colliders2d, palette, raster2d, tiles, vertices
from sandbox.render.arrays import upload, zeros
from sandbox.render.camera import frame_2d
from sandbox.render.colliders import grid_spacing
from sandbox.render.types import vec2, vec3, vec4
from sandbox.render.view import TILE
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import Camera

OUTLINE_WIDTH = 2.6 / 720.0
"""Width of outlines, as part of the picture's height."""
OUTLINE_SHADE, STRUT_SHADE, PARTICLE_SHADE = 0.50, 0.62, 0.38
"""Linear brightness of lines and particles on a body that is filled, relative to its fill."""


class FlatPainter:
    """Paints a 2D scene into an array that it keeps; only what may have changed is painted again."""

    def __init__(
        self, appearance: Appearance, camera: Camera, size: tuple[int, int], colormap: NDArray[np.float64] | None
    ) -> None:
        """`colormap` is sRGB in [0, 1], shape (count, 3), or None where colours are the bodies' own."""
        self.camera = frame_2d(camera, appearance.bounds, size)
        self.picture = np.zeros((size[1], size[0], 3), dtype=np.uint8)
        self._by_value = colormap is not None
        center = self.camera.center
        self._view = upload([center[0], center[1], self.camera.scale, size[0] / 2, size[1] / 2], ti.f32)
        self._table = upload(palette.encode_table_flat(), ti.i32)
        self._colormap = upload(palette.to_linear(np.zeros((2, 3)) if colormap is None else colormap), ti.f32)
        self._body_color = upload(palette.to_linear(appearance.body_colors), ti.f32)
        self._triangles = upload(appearance.triangles, ti.i32)
        self._triangle_body = upload(appearance.triangle_body, ti.i32)
        self._triangle_count = len(appearance.triangles)
        self._create_rounds(appearance, size)
        self._create_buffers(size)
        self._paint_paper(appearance, size)

    def _create_rounds(self, appearance: Appearance, size: tuple[int, int]) -> None:
        """Springs, then outlines, then particles: later ones are drawn on top."""
        line = OUTLINE_WIDTH / 2 * size[1]
        discs = np.repeat(np.reshape(appearance.spheres, (-1, 1)), 2, axis=1)
        groups = [np.reshape(appearance.capsules, (-1, 2)), np.reshape(appearance.outline, (-1, 2)), discs]
        bodies = [appearance.capsule_body, appearance.outline_body, appearance.sphere_body]
        scale = self.camera.scale
        radii = [
            np.maximum(np.asarray(appearance.capsule_radius) * scale, 0.6 * line),
            np.full(len(appearance.outline), line),
            np.maximum(np.asarray(appearance.sphere_radius) * scale, 0.9 * line),
        ]
        is_filled = np.zeros(len(appearance.body_colors), dtype=bool)
        is_filled[appearance.triangle_body] = True
        shades = [
            np.where(is_filled[body], shade, 1.0)
            for body, shade in zip(bodies, (STRUT_SHADE, OUTLINE_SHADE, PARTICLE_SHADE), strict=True)
        ]
        self._round_count = sum(len(group) for group in groups)
        self._round_ends = upload(np.concatenate(groups), ti.i32)
        self._round_radius = upload(np.concatenate(radii), ti.f32)
        self._round_body = upload(np.concatenate(bodies), ti.i32)
        self._round_shade = upload(np.concatenate(shades), ti.f32)

    def _create_buffers(self, size: tuple[int, int]) -> None:
        width, height = size
        across, down = -(-width // TILE), -(-height // TILE)
        self._keys = zeros(ti.i32, height, width, raster2d.SAMPLES)
        self._paper = ti.ndarray(vec3, (height, width))
        self._tiles, self._tiles_before = zeros(ti.i32, down, across), zeros(ti.i32, down, across)
        self._tiles_before.fill(1)
        self._tile_list = ti.ndarray(ti.i32, across * down + 1)
        # Nothing casts shadows in the plane: rectangles that are empty, in a map of one tile.
        self._tile_reach = ti.ndarray(vec4, (down, across))
        self._tile_reach.fill(ti.Vector([1.0, 1.0, -1.0, -1.0]))
        self._light_tiles = zeros(ti.i32, 1, 1)
        self._screen: Any = ti.ndarray(vec2, 1)
        self._values: Any = zeros(ti.f32, 1)

    def _paint_paper(self, appearance: Appearance, size: tuple[int, int]) -> None:
        rows = colliders2d.collider_rows(appearance.colliders)
        if not len(rows):
            rows = np.zeros((1, colliders2d.ROW), dtype=np.float32)
            rows[0, colliders2d.KIND], rows[0, colliders2d.SHAPE] = colliders2d.DISC, -1e30
        spacing = grid_spacing(size[1] / self.camera.scale)
        raster2d.cast_paper(upload(rows, ti.f32), self._view, spacing, OUTLINE_WIDTH / 2 * size[1], self._paper)

    def paint(self, positions: Any, slot: int, values: Any, value_scale: float) -> None:
        """Bring the picture up to date with row `slot` of `positions`; values times `value_scale` give colours."""
        particle_count = positions.shape[1]
        if self._screen.shape[0] != particle_count:
            self._screen, self._values = ti.ndarray(vec2, particle_count), zeros(ti.f32, particle_count)
        raster2d.place_points(positions, slot, self._view, self._screen)
        if self._by_value:
            vertices.copy_values(values, value_scale, self._values)
        if self._triangle_count:
            raster2d.draw_flat_triangles(self._triangles, self._triangle_body, self._screen, self._keys, self._tiles)
        if self._round_count:
            raster2d.draw_flat_rounds(
                self._triangle_count + 1, self._round_ends, self._round_radius, self._screen, self._keys, self._tiles
            )
        tiles.choose_tiles(self._tiles, self._tiles_before, self._tile_list, self._tile_reach, self._light_tiles)
        raster2d.color_tiles(
            self._by_value, self._tile_list, self._tiles, self._keys, self._paper, self._table, self._triangles,
            self._triangle_body, self._triangle_count, self._body_color, self._screen, self._round_ends,
            self._round_body, self._round_shade, self._values, self._colormap, self.picture,
        )  # fmt: skip
