"""The software renderer: a picture of the scene from Taichi kernels, on any machine, without a driver."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.render import overlay, palette
from sandbox.render.compiling import compiling
from sandbox.render.flat2d import FlatPainter
from sandbox.render.protocol import Picture
from sandbox.render.solid3d import SolidPainter
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import Camera, ColorBy, Render

FloatArray = NDArray[np.float64]

LEGEND_TITLES = {ColorBy.SPEED: "speed [m/s]", ColorBy.STRAIN: "strain"}


class SoftwareRenderer:
    """Draws a scene with four samples a pixel, soft shadows in 3D, flat colours in 2D."""

    def __init__(self, appearance: Appearance, render: Render, camera: Camera | None = None) -> None:
        """Allocate the buffers and draw what does not move. Taichi must have been started.

        `camera` overrides the one in `render`.
        """
        self.color_max: float | None = render.color_max
        self._title = LEGEND_TITLES.get(render.color)
        self._colormap = palette.colormap(palette.COLORMAPS[render.color]) if self._title else None
        self._legend: Any = None
        painter = SolidPainter if appearance.dimension == 3 else FlatPainter
        with compiling():
            self._painter: Any = painter(appearance, camera or render.camera, render.size, self._colormap)
        runtime.register(self)

    def set_color_max(self, value: float) -> None:
        """Set the top of the colour scale: speed [m/s] or strain [1]. Raises ValueError unless > 0."""
        if not value > 0:
            raise ValueError(f"color_max must be > 0, got {value}")
        self.color_max, self._legend = float(value), None

    def draw(self, positions: Any, slot: int, values: Any = None, time: float = 0.0, torn: Any = None) -> Picture:
        """Draw one frame, uint8 sRGB of shape (height, width, 3), top row first; the array is the caller's.

        `positions` is a Taichi vector field (slot_count, particle_count) [m], of which row `slot` is drawn; `values`
        a Taichi scalar field (particle_count,) [m/s or 1], needed where colours show a quantity. Moving colliders are
        drawn where they are at `time` [s]. `torn` is a Taichi i32 field (spring_count,), nonzero where a spring has
        torn: what hangs on it is not drawn. None: nothing has torn.
        Raises ValueError where it is missing, RuntimeError after `close`.
        """
        if self._painter is None:
            raise RuntimeError("the renderer is closed")
        if self._colormap is not None:
            if values is None:
                raise ValueError(f"colours show {self._title}, but no values were given")
            if self.color_max is None:
                self.set_color_max(max(float(np.max(values.to_numpy())), 1e-6))
        with compiling():
            self._painter.paint(positions, slot, values, 1.0 / (self.color_max or 1.0), time, torn)
        picture: Picture = self._painter.picture.copy()
        if self._title is not None and self._colormap is not None and self.color_max is not None:
            if self._legend is None:
                self._legend = overlay.draw_legend(self._title, self.color_max, self._colormap, picture.shape[0])
            self._lay_legend(picture)
        return picture

    def _lay_legend(self, picture: Picture) -> None:
        margin = round(picture.shape[0] * 0.03)
        overlay.blend(picture, self._legend, picture.shape[1] - self._legend.shape[1] - margin, margin)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where points [m], shape (N, dimension), are in the picture: pixel x and y (down), shape (N, 2)."""
        return np.asarray(self._painter.camera.project(points)[..., :2])

    def close(self) -> None:
        """Free all buffers; calling it again does nothing."""
        self._painter = None
        runtime.unregister(self)

    def suspend(self) -> None:
        """Let go before Taichi is started anew, which would take the buffers away; the renderer is then closed."""
        self.close()
