"""The GGUI renderer: pictures by the machine's Vulkan driver, from a process of its own."""

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.render import overlay, palette
from sandbox.render.camera import frame_2d, frame_3d
from sandbox.render.compiling import compiling
from sandbox.render.ggui.copying import copy_positions, copy_values
from sandbox.render.ggui.messages import AnyCamera, Frame, Task
from sandbox.render.ggui.process import DrawingProcess, DriverError
from sandbox.render.ggui.shared import SharedArrays
from sandbox.render.protocol import Picture, Renderer
from sandbox.render.software import LEGEND_TITLES, SoftwareRenderer
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import Camera, Render

FloatArray = NDArray[np.float64]


class RendererWarning(UserWarning):
    """Pictures come from another renderer than was asked for."""


def open_ggui(appearance: Appearance, render: Render, camera: Camera | None = None) -> Renderer:
    """The GGUI renderer; with a warning the software renderer, where there is no Vulkan driver that draws."""
    try:
        return GguiRenderer(appearance, render, camera)
    except (DriverError, OSError) as error:
        warnings.warn(f"renderer ggui: {error}; the software renderer draws instead", RendererWarning, stacklevel=2)
        return SoftwareRenderer(appearance, render, camera)


def shared_arrays(appearance: Appearance, copies: int, size: tuple[int, int] | None) -> SharedArrays:
    """Room for so many copies of the positions, for what is hidden, for values, and for a picture of this size."""
    hideable = len(appearance.triangles) + len(appearance.outline) + len(appearance.capsules)
    return SharedArrays.create(
        {
            "positions": (np.float32, (copies, appearance.particle_count, appearance.dimension)),
            "hidden": (np.uint8, (hideable,)),
            "values": (np.float32, (appearance.particle_count,)),
            "picture": (np.uint8, (0, 0, 3) if size is None else (size[1], size[0], 3)),
        }
    )


def framed(appearance: Appearance, camera: Camera, size: tuple[int, int]) -> AnyCamera:
    """The camera of the default renderer."""
    frame = frame_3d if appearance.dimension == 3 else frame_2d
    return frame(camera, appearance.bounds, size)


class Hiding:
    """Tells the drawing process what has torn."""

    def __init__(self, appearance: Appearance, hidden: Any) -> None:
        self._appearance, self._hidden = appearance, hidden
        self._torn_count = -1

    def update(self, torn: Any) -> bool:
        """Read the field `torn`, nonzero where a spring has torn; True where something else is hidden than before."""
        if not self._appearance.tears:
            return False
        marks = None if torn is None else torn.to_numpy()
        count = 0 if marks is None else int(np.count_nonzero(marks))
        if count == self._torn_count:
            return False
        self._torn_count = count
        self._hidden[:] = ~np.concatenate(self._appearance.shown(marks))
        return True


class GguiRenderer:
    """Draws a scene with the Vulkan driver, as the software renderer frames it; where that dies, it goes on with this.

    Raises DriverError where there is no driver that draws.
    """

    def __init__(self, appearance: Appearance, render: Render, camera: Camera | None = None) -> None:
        """Start the drawing process and wait for a first picture. `camera` overrides the one in `render`."""
        self.color_max: float | None = render.color_max
        self._appearance, self._render, self._given = appearance, render, camera
        self._camera = framed(appearance, camera or render.camera, render.size)
        self._title = LEGEND_TITLES.get(render.color)
        self._colormap = palette.colormap(palette.COLORMAPS[render.color]) if self._title else None
        self._legend: Any = None
        self._stand_in: SoftwareRenderer | None = None
        self._arrays = shared_arrays(appearance, 1, render.size)
        self._hiding = Hiding(appearance, self._arrays["hidden"])
        task = Task(appearance, self._camera, self._colormap, self._arrays.layout, runtime.settings().threads)
        self._process: DrawingProcess | None = DrawingProcess(task, self._arrays)

    def set_color_max(self, value: float) -> None:
        """Set the top of the colour scale: speed [m/s] or strain [1]. Raises ValueError unless > 0."""
        if not value > 0:
            raise ValueError(f"color_max must be > 0, got {value}")
        self.color_max, self._legend = float(value), None
        if self._stand_in is not None:
            self._stand_in.set_color_max(value)

    def draw(self, positions: Any, slot: int, values: Any = None, time: float = 0.0, torn: Any = None) -> Picture:
        """Draw one frame; see :class:`sandbox.render.protocol.Renderer`.

        Raises ValueError where values are missing, RuntimeError after `close`.
        """
        if self._stand_in is None and self._process is None:
            raise RuntimeError("the renderer is closed")
        if self._stand_in is None:
            try:
                return self._drawn(positions, slot, values, time, torn)
            except DriverError as error:
                self._give_up(error)
        assert self._stand_in is not None
        return self._stand_in.draw(positions, slot, values, time, torn)

    def _drawn(self, positions: Any, slot: int, values: Any, time: float, torn: Any) -> Picture:
        assert self._process is not None
        with compiling():
            copy_positions(positions, slot, self._arrays["positions"][0])
            if self._colormap is not None:
                if values is None:
                    raise ValueError(f"colours show {self._title}, but no values were given")
                if self.color_max is None:
                    self.set_color_max(max(float(np.max(values.to_numpy())), 1e-6))
                copy_values(values, 1.0 / (self.color_max or 1.0), self._arrays["values"])
        self._process.ask(Frame(time=time, hides=self._hiding.update(torn)))
        picture: Picture = self._arrays["picture"].copy()
        if self._title is not None and self._colormap is not None and self.color_max is not None:
            if self._legend is None:
                self._legend = overlay.draw_legend(self._title, self.color_max, self._colormap, picture.shape[0])
            margin = round(picture.shape[0] * 0.03)
            overlay.blend(picture, self._legend, picture.shape[1] - self._legend.shape[1] - margin, margin)
        return picture

    def _give_up(self, error: DriverError) -> None:
        """Have the software renderer draw the rest: a run that took long goes on."""
        warnings.warn(f"renderer ggui: {error}; the software renderer draws on", RendererWarning, stacklevel=3)
        if self._process is not None:
            self._process.close()
        self._process = None
        self._stand_in = SoftwareRenderer(self._appearance, self._render, self._given)
        if self.color_max is not None:
            self._stand_in.set_color_max(self.color_max)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where points [m], shape (N, dimension), are in the picture: pixel x and y (down), shape (N, 2)."""
        return np.asarray(self._camera.project(points)[..., :2])

    def close(self) -> None:
        """End the drawing process; calling it again does nothing."""
        if self._process is not None:
            self._process.close()
        if self._stand_in is not None:
            self._stand_in.close()
        self._process, self._stand_in = None, None
