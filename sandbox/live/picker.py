"""From the cursor into the scene. A cursor is in parts of the picture, (0, 0) its lower left corner. NumPy only."""

import numpy as np

from sandbox.render.camera import FlatCamera, PinholeCamera
from sandbox.scene.appearance import FloatArray

Cursor = tuple[float, float]


def ray(camera: PinholeCamera | FlatCamera, cursor: Cursor) -> tuple[FloatArray, FloatArray | None]:
    """Where a ray through the cursor begins [m], and its unit direction; in 2D the point itself, and None."""
    across, up = _offset(camera, cursor)
    if isinstance(camera, FlatCamera):
        return camera.center + np.array([across, up]) / camera.scale, None
    direction = camera.forward * camera.focal + camera.right * across + camera.up * up
    return camera.eye, direction / np.linalg.norm(direction)


def beside(camera: PinholeCamera | FlatCamera, cursor: Cursor, point: FloatArray) -> FloatArray:
    """The point under the cursor in the plane through ``point`` [m] that is parallel to the picture [m], shape (d,)."""
    across, up = _offset(camera, cursor)
    if isinstance(camera, FlatCamera):
        return np.asarray(camera.center + np.array([across, up]) / camera.scale)
    depth = float((np.asarray(point) - camera.eye) @ camera.forward)
    return np.asarray(camera.eye + depth * (camera.forward + (camera.right * across + camera.up * up) / camera.focal))


def cursor_of(camera: PinholeCamera | FlatCamera, point: FloatArray) -> Cursor:
    """Where a point [m] is in the picture."""
    x, y = camera.project(np.asarray(point))[:2]
    return float(x) / camera.size[0], 1.0 - float(y) / camera.size[1]


def _offset(camera: PinholeCamera | FlatCamera, cursor: Cursor) -> tuple[float, float]:
    """From the middle of the picture, right and up [pixels]."""
    return (cursor[0] - 0.5) * camera.size[0], (cursor[1] - 0.5) * camera.size[1]
