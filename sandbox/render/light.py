"""The key light and the frame of its shadow map. NumPy only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sandbox.render.camera import PinholeCamera, corners, padded_bounds
from sandbox.scene.appearance import FloatArray

SHADOW_SIZE = 1024
"""Texels along one side of the shadow map."""
SHADOW_MARGIN = 28
"""Texels kept free around what casts, at least the widest penumbra."""


@dataclass(frozen=True)
class LightFrame:
    """Directional light: texel (u, v) and height w toward the light [m] of a point p are linear in p."""

    direction: FloatArray
    """Unit vector toward the light, shape (3,)."""
    u_axis: FloatArray
    """Unit vector of growing u, shape (3,)."""
    v_axis: FloatArray
    """Unit vector of growing v, shape (3,); u x v points toward the light."""
    origin: FloatArray
    """Point at u = v = w = 0 [m], shape (3,): below all that casts, so that heights are positive."""
    texels_per_metre: float
    """Resolution of the shadow map [1/m]."""

    def locate(self, points: FloatArray) -> FloatArray:
        """Texel u, texel v and height w [m] of points [m], shape (..., 3) to (..., 3)."""
        relative = np.asarray(points, dtype=float) - self.origin
        scale = self.texels_per_metre
        return np.stack(
            [relative @ self.u_axis * scale, relative @ self.v_axis * scale, relative @ self.direction], axis=-1
        )


def key_light(camera: PinholeCamera, bounds: FloatArray, extents: Sequence[FloatArray]) -> LightFrame:
    """Light from above, to the left of and a little behind the camera; its map holds the box `bounds` [m].

    `extents` are boxes around colliders that cast [m], each of shape (2, 3): what of them is near is held, too.
    """
    up = np.array([0.0, 1.0, 0.0])
    right = camera.right - up * (camera.right @ up)
    right /= np.linalg.norm(right)
    back = np.cross(right, up)
    direction = 1.0 * up - 0.50 * right + 0.33 * back
    direction /= np.linalg.norm(direction)
    u_axis = np.cross(up, direction)
    u_axis /= np.linalg.norm(u_axis)
    v_axis = np.cross(direction, u_axis)
    points = _casting_points(padded_bounds(bounds), extents)
    u, v, w = points @ u_axis, points @ v_axis, points @ direction
    width = max(np.ptp(u), np.ptp(v))
    scale = (SHADOW_SIZE - 2 * SHADOW_MARGIN) / width
    half = SHADOW_SIZE / 2 / scale
    # Heights start well below the lowest caster: they are compared as the bits of positive floats.
    depth = w.min() - (np.ptp(w) + width)
    origin = ((u.min() + u.max()) / 2 - half) * u_axis + ((v.min() + v.max()) / 2 - half) * v_axis + depth * direction
    return LightFrame(direction, u_axis, v_axis, origin, float(scale))


def _casting_points(bounds: FloatArray, extents: Sequence[FloatArray]) -> FloatArray:
    """Corners of what casts shadows: the bodies' box, and colliders as far as they are near it."""
    low, high = bounds
    reach = 0.5 * (high - low).max()
    boxes = [bounds]
    for extent in extents:
        box = np.array([np.maximum(extent[0], low - reach), np.minimum(extent[1], high + reach)])
        if np.all(box[1] > box[0]):
            boxes.append(box)
    return np.concatenate([corners(box) for box in boxes])
