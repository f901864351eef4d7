"""How much of every cell of a grid lies inside a closed mesh."""

import numpy as np

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.winding import winding


def inside_fraction(
    vertices: FloatArray, triangles: IntArray, low: FloatArray, spacing: float, cells: tuple[int, ...]
) -> FloatArray:
    """Fraction of each cell inside the closed mesh, from 2 x 2 x 2 samples [1], shape ``cells``.

    ``low`` is the grid's lower corner [m], ``spacing`` the edge length of its cells [m].
    """
    across, deep, high = cells
    samples = winding(vertices, triangles, low + 0.25 * spacing, 0.5 * spacing, (2 * across, 2 * deep, 2 * high))
    return np.asarray((samples > 0).reshape(across, 2, deep, 2, high, 2).mean(axis=(1, 3, 5)))
