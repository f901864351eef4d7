"""The window of GGUI, in the drawing process: what is drawn in it, what comes back from it."""

import math
from typing import Any

import taichi as ti
from taichi.ui.utils import get_field_info

from sandbox import runtime
from sandbox.render.camera import FlatCamera, PinholeCamera
from sandbox.render.compiling import compiling
from sandbox.render.ggui.finish import finish_picture
from sandbox.render.ggui.flat import FlatScenery
from sandbox.render.ggui.messages import Button, Frame, Input, KeyEvent, Panel, Task, Text
from sandbox.render.ggui.shared import SharedArrays
from sandbox.render.ggui.solid import SolidScenery

BUTTONS = (ti.ui.LMB, ti.ui.MMB, ti.ui.RMB)


class Stage:
    """Draws frames with GGUI, on the screen or into the shared picture."""

    def __init__(self, task: Task, arrays: SharedArrays) -> None:
        """Open the window and draw a first frame. Raises RuntimeError where there is no Vulkan driver."""
        runtime.start(arch="cpu", precision="f32", threads=task.threads)
        self._is_visible = task.is_visible
        self._camera = task.camera
        self._window = ti.ui.Window(task.title, task.camera.size, show_window=task.is_visible, vsync=task.is_visible)
        self._canvas, self._gui = self._window.get_canvas(), self._window.get_gui()
        self._scene = self._window.get_scene()
        self._lens = ti.ui.Camera()
        self._arrays = arrays
        self._positions, self._hidden, self._values = arrays["positions"], arrays["hidden"], arrays["values"]
        self._picture = None if task.is_visible else arrays["picture"]
        scenery: Any = SolidScenery if task.appearance.dimension == 3 else FlatScenery
        with compiling():
            self._scenery: Any = scenery(task.appearance, task.camera, task.colormap)
        if not task.is_visible:
            self.draw(Frame(time=0.0))

    def draw(self, frame: Frame) -> Input | None:
        """Draw one frame; with a window, what was done in it since the frame before."""
        with compiling():
            if frame.camera is not None:
                self._camera = frame.camera
                self._scenery.look(frame.camera)
            self._scenery.update(
                self._positions[frame.slot], self._values, self._hidden if frame.hides else None, frame.time
            )
            self._lay_out()
        if self._picture is not None:
            # Each reading draws anew: the picture is read once, and never shown.
            with compiling():
                finish_picture(self._window.get_image_buffer_as_numpy(), self._picture)
            return None
        clicked = {label for panel in frame.panels for label in self._lay_panel(panel)}
        self._window.show()
        return self._input(frozenset(clicked))

    def _lay_out(self) -> None:
        """Give GGUI what there is to draw."""
        if isinstance(self._camera, FlatCamera):
            # Numbers of vertices as they are: GGUI's own functions would copy each anew, by a kernel for every size.
            self._canvas.canvas.set_image(get_field_info(self._scenery.background))
            if len(self._scenery.indices):
                vertices, indices = get_field_info(self._scenery.vertices), get_field_info(self._scenery.indices)
                self._canvas.canvas.triangles(vertices, indices, True, (0.5, 0.5, 0.5))
            return
        self._aim(self._camera)
        self._scene.set_camera(self._lens)
        # Vertices come with the light that they send; GGUI's own lamps would add to it.
        self._scene.ambient_light((1.0, 1.0, 1.0))
        vertices, indices = self._scenery.vertices, self._scenery.indices
        self._scene.scene.mesh(
            get_field_info(vertices), True, get_field_info(indices), (0.5, 0.5, 0.5), True, len(indices), 0,
            len(vertices), 0, False,
        )  # fmt: skip
        self._canvas.scene(self._scene)

    def _aim(self, camera: PinholeCamera) -> None:
        near, far = self._scenery.depth_range
        self._lens.position(*map(float, camera.eye))
        self._lens.lookat(*map(float, camera.eye + camera.forward))
        self._lens.up(*map(float, camera.up))
        self._lens.fov(math.degrees(2.0 * math.atan(0.5 * camera.size[1] / camera.focal)))
        self._lens.z_near(near)
        self._lens.z_far(far)

    def _lay_panel(self, panel: Panel) -> list[str]:
        """Draw a panel; the buttons in it that were clicked."""
        clicked = []
        with self._gui.sub_window(panel.title, *panel.place) as gui:
            for widget in panel.widgets:
                match widget:
                    case Text():
                        gui.text(widget.text, color=widget.color)
                    case Button() if gui.button(widget.label):
                        clicked.append(widget.label)
        return clicked

    def _input(self, clicked: frozenset[str]) -> Input:
        window = self._window
        presses = [KeyEvent(event.key, True) for event in window.get_events(ti.ui.PRESS)]
        releases = [KeyEvent(event.key, False) for event in window.get_events(ti.ui.RELEASE)]
        return Input(
            cursor=tuple(window.get_cursor_pos()),
            held=frozenset(button for button in BUTTONS if window.is_pressed(button)),
            events=(*presses, *releases),
            clicked=clicked,
            size=tuple(window.get_window_shape()),
            is_open=bool(window.running),
        )

    def close(self) -> None:
        """Write what was compiled to the cache on disk."""
        runtime.stop()
