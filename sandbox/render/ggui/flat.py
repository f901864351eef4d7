"""Two-dimensional scenes for GGUI: the software renderer's paper as a background, and bodies as triangles on it."""

from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.render.arrays import upload
from sandbox.render.camera import FlatCamera
from sandbox.render.flat2d import FlatPainter
from sandbox.render.ggui import flat_vertices, lighting
from sandbox.render.ggui.rounds import stadium_pattern
from sandbox.scene.appearance import Appearance, FloatArray, IntArray
from sandbox.scene.model import Camera


class FlatScenery:
    """Vertices and triangles of a scene, brought up to date for every frame, and the picture behind them."""

    def __init__(self, appearance: Appearance, camera: FlatCamera, colormap: FloatArray | None) -> None:
        """`colormap` is sRGB in [0, 1], shape (count, 3), or None where colours are the bodies' own."""
        self._appearance, self._colormap = appearance, colormap
        self._positions = ti.Vector.field(2, ti.f32)
        builder = runtime.fields_builder()
        builder.dense(ti.ij, (1, appearance.particle_count)).place(self._positions)
        builder.finalize()
        self._values = upload(np.zeros(appearance.particle_count), ti.f32)
        self._hides: Any = None
        self.look(camera)

    def look(self, camera: FlatCamera) -> None:
        """Look elsewhere."""
        self._painter = _Paper(self._appearance, camera, self._colormap)
        width, height = camera.size
        self.background = np.zeros((width, height), dtype=np.uint32)
        """Colours of what lies behind, as GGUI has them: red in the lowest byte, shape (width, height), y up."""
        self._is_laid = False
        self._create_triangles()

    def _create_triangles(self) -> None:
        painter = self._painter
        count = self._appearance.particle_count
        self._pattern = stadium_pattern(painter.round_count)
        rounds = self._pattern.indices(painter.round_count, 3 * painter.triangle_count)
        self._pattern_rows = upload(np.column_stack([self._pattern.directions, self._pattern.ends]), ti.f32)
        own = np.arange(3 * painter.triangle_count, dtype=np.int32).reshape(-1, 3)
        self._whole = np.concatenate([own, rounds.reshape(-1, 3)])
        self.indices: IntArray = self._whole.ravel().copy()
        """Vertices of all triangles, later ones on top, shape (3 triangle_count,)."""
        rows = 3 * painter.triangle_count + painter.round_count * len(self._pattern.ends)
        self.vertices = np.zeros((max(1, rows), lighting.STRIDE), dtype=np.float32)
        """As GGUI has them: place, normal, texture, colour; shape (vertex_count, 12)."""
        assert count == self._positions.shape[1]
        if self._hides is not None:
            self._hide(self._hides)

    def update(self, positions: Any, values: Any, hidden: Any, time: float) -> None:
        """Bring all up to date with positions [m], shape (particle_count, 2), and values in [0, 1].

        `hidden` is nonzero for triangles, then outlines, then capsules of the appearance that are not drawn; None:
        as before.
        """
        painter = self._painter
        lighting.take_positions(positions, self._positions)
        if self._colormap is not None:
            self._values.from_numpy(values)
        if hidden is not None:
            self._hides = hidden.copy()
            self._hide(hidden)
        if painter.has_moving or not self._is_laid:
            self._is_laid = True
            flat_vertices.take_background(painter.paper(self._positions, time), self.background)
        screen = painter.place(self._positions)
        shared = (painter.body_color, self._values, painter.colormap, painter.table, *map(float, painter.camera.size))
        if painter.triangle_count:
            flat_vertices.color_triangles(
                self._colormap is not None, painter.triangle_count, painter.triangles, painter.triangle_body, screen,
                *shared, self.vertices,
            )  # fmt: skip
        if painter.round_count:
            flat_vertices.color_rounds(
                self._colormap is not None, painter.round_count, 3 * painter.triangle_count, self._pattern_rows,
                *painter.rounds, screen, *shared, self.vertices,
            )  # fmt: skip

    def _hide(self, hidden: Any) -> None:
        """Make triangles of what has torn vanish: all of their corners are one."""
        appearance, painter, size = self._appearance, self._painter, len(self._pattern.triangles)
        first, second = len(appearance.triangles), len(appearance.triangles) + len(appearance.outline)
        indices = self._whole.copy()
        surface = hidden[:first][painter.is_drawn] != 0
        indices[: len(surface)][surface] = 0
        # Capsules are drawn before outlines, whose order in the list is the other way round.
        rounds = np.concatenate([hidden[second:], hidden[first:second]]) != 0
        painter.hide(surface, rounds)
        corners = np.repeat(rounds, size)
        indices[len(surface) : len(surface) + len(corners)][corners] = 0
        self.indices[:] = indices.ravel()


class _Paper(FlatPainter):
    """The software renderer's picture without bodies, and the numbers that it has of them."""

    def __init__(self, appearance: Appearance, camera: FlatCamera, colormap: FloatArray | None) -> None:
        view = Camera(target=tuple(camera.center), height=camera.size[1] / camera.scale)
        super().__init__(appearance, view, camera.size, colormap)
        self.is_drawn = np.all(appearance.triangles < appearance.particle_count, axis=1)
        self.triangle_count, self.round_count = self._triangle_count, self._round_count
        self.triangles, self.triangle_body = self._triangles, self._triangle_body
        self.rounds = (self._round_ends, self._round_radius, self._round_body, self._round_shade)
        self.body_color, self.colormap, self.table = self._body_color, self._colormap, self._table
        self.has_moving = bool(self._moving)
        # What is counted as nothing is not painted.
        self._triangle_count = self._round_count = 0
        self._by_value = False
        self._spheres = appearance.spheres

    def paper(self, positions: Any, time: float) -> Any:
        """The picture without bodies, shape (height, width, 3)."""
        self.paint(positions, 0, None, 1.0, time)
        return self.picture

    def place(self, positions: Any) -> Any:
        """Where all particles are in the picture [pixels], as the software renderer has them."""
        self._place(positions, 0)
        return self._screen

    def hide(self, triangles: Any, rounds: Any) -> None:
        """What is hidden of triangles, and of capsules and then outlines: the edge of a tear is drawn elsewhere."""
        if self._tearing.is_possible:
            spheres = np.zeros(len(self._spheres))
            self._tearing.hidden.from_numpy(np.concatenate([triangles, rounds, spheres]).astype(np.int32))
