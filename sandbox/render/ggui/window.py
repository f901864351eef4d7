"""A window on the screen, drawn by the drawing process; what is done in it comes back."""

import dataclasses
import os
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from sandbox import runtime
from sandbox.render.compiling import compiling
from sandbox.render.ggui.copying import copy_positions, copy_values
from sandbox.render.ggui.messages import AnyCamera, Frame, Input, Panel, Task
from sandbox.render.ggui.process import DrawingProcess, DriverError
from sandbox.render.ggui.renderer import Hiding, shared_arrays
from sandbox.scene.appearance import Appearance, FloatArray


class LiveWindow:
    """Draws while the simulation goes on: a frame is shown while the one after it is computed."""

    def __init__(self, appearance: Appearance, camera: AnyCamera, colormap: FloatArray | None, title: str) -> None:
        """Open it; `colormap` as in :class:`Task`. Raises DriverError where there is no screen, or no Vulkan driver."""
        if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise DriverError("there is no screen here (no DISPLAY)")
        self._arrays = shared_arrays(appearance, 2, None)
        self._hiding = Hiding(appearance, self._arrays["hidden"])
        self._colormap, self._slot, self._camera = colormap, 0, camera
        layout, threads = self._arrays.layout, runtime.settings().threads
        task = Task(appearance, camera, colormap, layout, threads, title=title, is_visible=True)
        self._process = DrawingProcess(task, self._arrays)
        self._is_drawing = False

    @property
    def pid(self) -> int:
        """Number of the drawing process."""
        return self._process.pid

    def input(self) -> Input:
        """What was done since the frame before; waits until the last one is on the screen.

        Raises DriverError where the driver has died.
        """
        if not self._is_drawing:
            return Input(size=self._camera.size)
        self._is_drawing = False
        answer: Input = self._process.answer()
        return answer

    def show(
        self, camera: AnyCamera, state: Any, values: Any, scale: float, time: float, torn: Any, panels: Sequence[Panel]
    ) -> None:
        """Have a frame drawn of a simulation's `state`; `values` times `scale` give colours.

        Raises DriverError where the driver has died.
        """
        self._slot = 1 - self._slot
        with compiling():
            copy_positions(state.x, state.slot, self._arrays["positions"][self._slot])
            if self._colormap is not None:
                copy_values(values, scale, self._arrays["values"])
        # A view that stays needs no new surroundings.
        moved = None if _is_same(camera, self._camera) else camera
        self._camera = camera
        hides = self._hiding.update(torn)
        self._process.post(Frame(time, self._slot, moved, hides, tuple(panels)))
        self._is_drawing = True

    def close(self) -> None:
        """Close it."""
        self._process.close()


def _is_same(one: AnyCamera, other: AnyCamera) -> bool:
    """Whether two cameras of one kind see the same."""
    return all(np.array_equal(getattr(one, each.name), getattr(other, each.name)) for each in dataclasses.fields(one))
