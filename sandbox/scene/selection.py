"""Which particles of a body a pin, an attachment or a region means. NumPy only."""

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.lattice import FloatArray
from sandbox.scene.model import Attachment, Pin, Region


def inside(region: Region, points: FloatArray) -> NDArray[np.bool_]:
    """True for points in a box, its faces included [m], shape (N, d); shape (N,)."""
    return np.asarray(((points >= np.asarray(region.min)) & (points <= np.asarray(region.max))).all(axis=1))


def selected(where: str, chosen: Pin | Attachment, positions: FloatArray) -> NDArray[np.bool_]:
    """Mask of the particles of a body, at world positions [m], shape (N, d), by index or region; shape (N,).

    Raises SceneError, beginning with ``where``, for an index that is not there and a region that is empty.
    """
    mask = np.zeros(len(positions), dtype=bool)
    for row, index in enumerate(chosen.indices):
        if index >= len(positions):
            raise SceneError(f"{where}.indices[{row}]: there is no particle {index}; the body has {len(positions)}")
        mask[index] = True
    if chosen.region is not None:
        within = inside(chosen.region, positions)
        if not within.any():
            raise SceneError(f"{where}.region: holds no particle of the body")
        mask |= within
    return mask
