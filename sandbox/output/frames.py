"""The state at a picture's time, and who takes it: trajectories and mesh files. NumPy only."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """The state at one instant, in the scene's order: N particles, S springs, dimension d."""

    number: int
    """0 at the start, then one more a picture: the rows of metrics.csv."""
    time: float
    """[s]."""
    positions: FloatArray
    """[m], shape (N, d). Numbers of f32 simulations are exact in f64."""
    velocities: FloatArray
    """[m/s], shape (N, d)."""
    strain: FloatArray | None = None
    """Largest strain of the springs at every particle [1], shape (N,); None in a scene without springs."""
    torn: NDArray[np.bool_] | None = None
    """True where a spring has torn, shape (S,); None in a scene where none can."""
    merit: float = 0.0
    """What it is worth as a poster: the picture where this is largest is the run's."""


class FrameWriter(Protocol):
    """Takes frames in the order of time."""

    def write(self, frame: Frame) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Stem:
    """How the files of a series are called."""

    name: str
    pictures: int
    """Number of the last frame."""

    def of(self, number: int) -> str:
        """The name of a frame's file, without its ending; names sort as frames do."""
        return f"{self.name}_{number:0{max(4, len(str(self.pictures)))}d}"
