"""The renderer that draws nothing: for runs that need only numbers."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.render.protocol import Picture


class NullRenderer:
    """Gives the same grey picture for every frame, at no cost."""

    def __init__(self, size: tuple[int, int] = (16, 16)) -> None:
        """`size` is the width and height of the picture [pixels]."""
        self.color_max: float | None = None
        self._picture = np.full((size[1], size[0], 3), 128, dtype=np.uint8)

    def draw(self, positions: Any, slot: int, values: Any = None, time: float = 0.0, torn: Any = None) -> Picture:
        """A grey picture, shape (height, width, 3)."""
        return self._picture

    def set_color_max(self, value: float) -> None:
        """Remember the top of the colour scale; nothing shows it."""
        self.color_max = float(value)

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The middle of the picture, for every point."""
        return np.tile(np.array(self._picture.shape[1::-1]) / 2.0, (len(points), 1))

    def close(self) -> None:
        """Nothing to free."""
