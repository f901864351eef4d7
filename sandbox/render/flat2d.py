"""Draws two-dimensional scenes: owns the buffers, and runs the passes of a frame in their order."""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.render import colliders2d, palette, paper2d, raster2d, tiles, vertices
from sandbox.render.arrays import upload, zeros
from sandbox.render.camera import frame_2d
from sandbox.render.colliders import grid_spacing
from sandbox.render.opening2d import FlatOpening
from sandbox.render.skin import body_offsets, outline_corners
from sandbox.render.tearing import Tearing
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
        # Carried points are for three dimensions: what hangs on them is not there.
        is_drawn = np.all(appearance.triangles < appearance.particle_count, axis=1)
        self._triangles = upload(appearance.triangles[is_drawn], ti.i32)
        self._triangle_body = upload(appearance.triangle_body[is_drawn], ti.i32)
        self._triangle_count = int(np.count_nonzero(is_drawn))
        cells = appearance.cells
        self._tearing = Tearing(
            cells,
            [
                (None if cells is None else cells.triangles.chosen(is_drawn), self._triangle_count),
                (None if cells is None else cells.capsules, len(appearance.capsules)),
                (None if cells is None else cells.outline, len(appearance.outline) + len(appearance.spheres)),
            ],
        )
        self._create_rounds(appearance, size)
        self._create_corners(appearance, size)
        self._create_buffers(appearance.particle_count, size)
        self._create_paper(appearance, size)

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

    def _create_corners(self, appearance: Appearance, size: tuple[int, int]) -> None:
        """Particles of outlines that are drawn a contact radius outside of where they are."""
        # The line's outer edge is where others meet the body.
        offsets = body_offsets(appearance) * self.camera.scale - OUTLINE_WIDTH / 2 * size[1]
        self._corner_count, self._opening = 0, None
        if appearance.cells is not None and np.any(appearance.cells.outline.is_inner):
            self._opening = FlatOpening(appearance, self._triangle_count + len(appearance.capsules), offsets)
            return
        corners, bodies = outline_corners(appearance)
        radius = offsets[bodies]
        is_pushed = radius > 0.0
        self._corner_count = int(np.count_nonzero(is_pushed))
        self._corners = upload(corners[is_pushed], ti.i32)
        self._corner_radius = upload(radius[is_pushed], ti.f32)

    def _create_buffers(self, particle_count: int, size: tuple[int, int]) -> None:
        width, height = size
        across, down = -(-width // TILE), -(-height // TILE)
        self._keys = zeros(ti.i32, height, width, raster2d.SAMPLES)
        self._tiles, self._tiles_before = zeros(ti.i32, down, across), zeros(ti.i32, down, across)
        self._tiles_before.fill(1)
        self._tile_list = ti.ndarray(ti.i32, across * down + 1)
        # Nothing casts shadows in the plane: rectangles that are empty, in a map of one tile.
        self._tile_reach = ti.ndarray(vec4, (down, across))
        self._tile_reach.fill(ti.Vector([1.0, 1.0, -1.0, -1.0]))
        self._light_tiles = zeros(ti.i32, 1, 1)
        # The field of positions has more rows than there are particles; that of values does not.
        self._screen: Any = ti.ndarray(vec2, max(1, particle_count))
        self._values: Any = zeros(ti.f32, max(1, particle_count))

    def _create_paper(self, appearance: Appearance, size: tuple[int, int]) -> None:
        """Paint what does not move, and keep the numbers of what does."""
        self._line = OUTLINE_WIDTH / 2 * size[1]
        self._paper = ti.ndarray(vec3, (size[1], size[0]))
        self._laid = zeros(ti.i32, *self._tiles.shape)
        self._laid.fill(1)
        self._near = ti.ndarray(ti.i32, (self._tiles.shape[0] * self._tiles.shape[1], paper2d.NEAR_EDGES))
        paper2d.cast_paper(self._view, grid_spacing(size[1] / self.camera.scale), self._paper)
        still = [collider for collider in appearance.colliders if not collider.motion]
        if still:
            rows, edges = colliders2d.collider_rows(still), colliders2d.polygon_edges(still)
            self._lay(upload(rows, ti.f32), upload(edges, ti.f32), self._paper)
        self._moving = [collider for collider in appearance.colliders if collider.motion]
        self._laid_rows: Any = None
        self._over = self._paper
        if self._moving:
            self._over = ti.ndarray(vec3, (size[1], size[0]))
            self._moving_rows = zeros(ti.f32, colliders2d.ROW * len(self._moving))
            self._moving_edges = upload(colliders2d.polygon_edges(self._moving), ti.f32)
            self._laid.fill(1)

    def _lay(self, rows: Any, edges: Any, over: Any) -> None:
        paper2d.lay_colliders(
            rows, edges, self._view, self._line, self._paper, over, self._near, self._laid, self._tiles
        )

    def _lay_moving(self, time: float) -> None:
        """Lay moving colliders on the paper again, unless they are where they were."""
        rows = colliders2d.collider_rows(self._moving, time)
        if self._laid_rows is None or not np.array_equal(rows, self._laid_rows):
            self._laid_rows = rows
            self._moving_rows.from_numpy(rows.ravel())
            self._lay(self._moving_rows, self._moving_edges, self._over)

    def _place(self, positions: Any, slot: int) -> None:
        """Where all particles are in the picture; those of outlines outside, and in the gaps beside what has torn."""
        raster2d.place_points(positions, slot, self._view, self._screen)
        if self._opening is not None:
            self._opening.move(positions, slot, self._tearing.hidden, self._view, self._screen)
        if self._corner_count:
            raster2d.push_outline(positions, slot, self._corners, self._corner_radius, self._view, self._screen)

    def paint(
        self, positions: Any, slot: int, values: Any, value_scale: float, time: float = 0.0, torn: Any = None
    ) -> None:
        """Bring the picture up to date with row `slot` of `positions`, and colliders at `time` [s].

        `values` times `value_scale` give colours; what hangs on springs that are nonzero in `torn` is left out.
        """
        self._tearing.update(torn)
        can_tear, hidden = self._tearing.is_possible, self._tearing.hidden
        self._place(positions, slot)
        if self._by_value:
            vertices.copy_values(values, value_scale, self._values)
        if self._moving:
            self._lay_moving(time)
        if self._triangle_count:
            raster2d.draw_flat_triangles(
                can_tear, hidden, self._triangles, self._triangle_body, self._screen, self._keys, self._tiles
            )
        if self._round_count:
            raster2d.draw_flat_rounds(
                can_tear, hidden, self._triangle_count, self._round_ends, self._round_radius, self._screen,
                self._keys, self._tiles,
            )  # fmt: skip
        tiles.choose_tiles(self._tiles, self._tiles_before, self._tile_list, self._tile_reach, self._light_tiles)
        raster2d.color_tiles(
            self._by_value, self._tile_list, self._tiles, self._keys, self._over, self._table, self._triangles,
            self._triangle_body, self._triangle_count, self._body_color, self._screen, self._round_ends,
            self._round_body, self._round_shade, self._values, self._colormap, self.picture,
        )  # fmt: skip
