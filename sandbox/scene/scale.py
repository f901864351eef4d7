"""What numbers colours reach to where a scene does not say. NumPy only."""

import math

import numpy as np

from sandbox.scene.assemble import Assembly
from sandbox.scene.model import ColorBy

_USUAL_STRAIN = 0.25
"""Top of the strain scale where the scene gives none [1]."""


def usual_largest(shown: ColorBy, assembly: Assembly) -> float:
    """A round speed [m/s] or strain [1] that a scene is likely to reach: a top for the colour scale."""
    if shown is not ColorBy.SPEED:
        return _USUAL_STRAIN
    strength = float(np.linalg.norm(assembly.scene.gravity or (0.0,)))
    low, high = assembly.appearance.bounds
    falling = math.sqrt(2.0 * strength * float((high - low).max()))
    start = float(np.linalg.norm(assembly.velocities, axis=1).max())
    return _round_up(max(start, falling, 1e-3))


def _round_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - 1e-9))
