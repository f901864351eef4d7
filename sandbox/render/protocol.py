"""What every renderer offers to the code that runs a simulation."""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
"""One frame: sRGB, shape (height, width, 3), top row first."""


@runtime_checkable
class Renderer(Protocol):
    """Turns particle positions into pictures; reads the simulation's fields where they are."""

    color_max: float | None
    """Value at the top of the colour scale: speed [m/s] or strain [1]; None until it is known."""

    def draw(self, positions: Any, slot: int, values: Any = None, time: float = 0.0, torn: Any = None) -> Picture:
        """Draw one frame.

        `positions` is a Taichi vector field of shape (slot_count, particle_count) [m], of which row `slot` is drawn.
        `values` is a Taichi scalar field of shape (particle_count,), read only where colours show a quantity.
        `time` [s] tells where moving colliders are. `torn` is a Taichi i32 field of shape (spring_count,), nonzero
        where a spring has torn, read only where the appearance names springs; None: nothing has torn.
        """
        ...

    def set_color_max(self, value: float) -> None:
        """Set the top of the colour scale: speed [m/s] or strain [1]; must be > 0."""
        ...

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points [m], shape (N, dimension), are in the picture: pixel x and y (down), shape (N, 2)."""
        ...

    def close(self) -> None:
        """Free all memory; the renderer cannot draw afterwards."""
        ...
