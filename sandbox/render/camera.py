"""Where the picture is taken from: pinhole camera in 3D, orthographic view in 2D. NumPy only."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from sandbox.scene.appearance import FloatArray
from sandbox.scene.model import Camera

AZIMUTH = math.radians(32.0)
ELEVATION = math.radians(15.0)
FILL_3D = 0.74
FILL_2D = 0.86


@dataclass(frozen=True)
class PinholeCamera:
    """Perspective view; y is up. Pixel (0, 0) is the top left corner of the top left pixel."""

    eye: FloatArray
    """Position [m], shape (3,)."""
    right: FloatArray
    """Unit vector to the right of the picture, shape (3,)."""
    up: FloatArray
    """Unit vector to the top of the picture, shape (3,)."""
    forward: FloatArray
    """Unit vector into the picture, shape (3,)."""
    focal: float
    """Focal length [pixels]."""
    size: tuple[int, int]
    """Width and height of the picture [pixels]."""

    @property
    def center(self) -> tuple[float, float]:
        """Where the optical axis meets the picture [pixels]."""
        return self.size[0] / 2, self.size[1] / 2

    def project(self, points: FloatArray) -> FloatArray:
        """Pixel x, pixel y (down) and depth along the axis [m] of points [m], shape (..., 3) to (..., 3)."""
        relative = np.asarray(points, dtype=float) - self.eye
        depth = relative @ self.forward
        x = self.center[0] + self.focal * (relative @ self.right) / depth
        y = self.center[1] - self.focal * (relative @ self.up) / depth
        return np.stack([x, y, depth], axis=-1)


@dataclass(frozen=True)
class FlatCamera:
    """Orthographic view of a 2D scene; y is up in the world and down in the picture."""

    center: FloatArray
    """World point in the middle of the picture [m], shape (2,)."""
    scale: float
    """Pixels a metre."""
    size: tuple[int, int]
    """Width and height of the picture [pixels]."""

    def project(self, points: FloatArray) -> FloatArray:
        """Pixel x and y (down) of points [m], shape (..., 2) to (..., 2)."""
        relative = (np.asarray(points, dtype=float) - self.center) * self.scale
        return np.stack([self.size[0] / 2 + relative[..., 0], self.size[1] / 2 - relative[..., 1]], axis=-1)


def corners(bounds: FloatArray) -> FloatArray:
    """The 2^n corners of a box given by its lower and upper corner, shape (2, n) to (2^n, n)."""
    return np.array(list(itertools.product(*np.asarray(bounds, dtype=float).T)))


def padded_bounds(bounds: FloatArray) -> FloatArray:
    """`bounds` with every extent at least a small part of the largest (or of 1 m), so that no view degenerates."""
    low, high = np.asarray(bounds, dtype=float)
    largest = float(np.max(high - low))
    least = 0.05 * largest if largest > 0 else 0.5
    growth = np.maximum(least - (high - low), 0.0) / 2
    return np.array([low - growth, high + growth])


def frame_3d(camera: Camera, bounds: FloatArray, size: tuple[int, int]) -> PinholeCamera:
    """The camera as given; what is not given is chosen so that the box `bounds` [m] fills the picture."""
    points = corners(padded_bounds(bounds))
    half_height = math.tan(math.radians(camera.field_of_view) / 2)
    half_width = half_height * size[0] / size[1]
    focal = size[1] / 2 / half_height
    middle = points.mean(axis=0)
    target = middle if camera.target is None else np.array(camera.target, dtype=float)
    if camera.eye is not None:
        eye = np.array(camera.eye, dtype=float)
        if np.allclose(eye, target):
            raise ValueError("render.camera: eye and target are the same point")
        return PinholeCamera(eye, *_axes(target - eye), focal, size)
    direction = -np.array(
        [math.sin(AZIMUTH) * math.cos(ELEVATION), math.sin(ELEVATION), math.cos(AZIMUTH) * math.cos(ELEVATION)]
    )
    right, up, forward = _axes(direction)
    fill = (half_width * FILL_3D, half_height * FILL_3D)
    relative = (points - target) @ np.array([right, up, forward]).T
    if camera.target is None:
        offset = _tight_eye(relative, *fill)
    else:
        # The target stays in the middle of the picture: only the distance is free.
        reach = np.abs(relative[:, :2]) / np.array(fill) - relative[:, 2:]
        offset = np.array([0.0, 0.0, -float(reach.max())])
    return PinholeCamera(target + offset @ np.array([right, up, forward]), right, up, forward, focal, size)


def frame_2d(camera: Camera, bounds: FloatArray, size: tuple[int, int]) -> FlatCamera:
    """The view as given; what is not given is chosen so that the rectangle `bounds` [m] fills the picture."""
    box = padded_bounds(bounds)
    middle = box.mean(axis=0)
    center = middle if camera.target is None else np.array(camera.target[:2], dtype=float)
    if camera.height is not None:
        return FlatCamera(center, size[1] / camera.height, size)
    reach = np.maximum(np.abs(box[0] - center), np.abs(box[1] - center))
    scale = float(np.min(np.array(size) / 2 * FILL_2D / reach))
    return FlatCamera(center, scale, size)


def _axes(direction: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    forward = direction / np.linalg.norm(direction)
    pole = np.array([0.0, 1.0, 0.0]) if abs(forward[1]) < 0.999 else np.array([0.0, 0.0, -1.0])
    right = np.cross(forward, pole)
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def _tight_eye(points: FloatArray, half_width: float, half_height: float) -> FloatArray:
    """Nearest eye, in camera axes, whose view pyramid holds all `points`, shape (count, 3)."""
    eye = np.zeros(3)
    nearest = []
    for axis, half in ((0, half_width), (1, half_height)):
        one = float(np.max(points[:, axis] - half * points[:, 2]))
        other = float(np.max(-points[:, axis] - half * points[:, 2]))
        eye[axis] = (one - other) / 2
        nearest.append(-(one + other) / (2 * half))
    eye[2] = min(nearest)
    return eye
