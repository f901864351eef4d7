"""Where a moving collider is: keyframes of position and rotation, interpolated. NumPy only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.model import Collider, HalfSpace, Interpolation, Keyframe, Rotation
from sandbox.scene.placement import rotation_matrix

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Keyframes as numbers: K times, in dimension d with a angles (1 in 2D, 3 in 3D)."""

    times: FloatArray
    """[s], rising, shape (K,)."""
    positions: FloatArray
    """Of the collider's own origin [m], shape (K, d)."""
    angles: FloatArray
    """About z, in 3D about x, then y, then z [degrees], shape (K, a)."""
    smooth: bool
    """True where the motion starts and stops gently at every keyframe."""

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.positions.shape[1])

    def pose(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Origin [m], shape (d,), and rotation matrix, shape (d, d), at a time [s]; before and after, it rests."""
        last = len(self.times) - 1
        key = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, max(last - 1, 0)))
        fraction = 0.0
        if last > 0:
            fraction = float(np.clip((time - self.times[key]) / (self.times[key + 1] - self.times[key]), 0.0, 1.0))
        if self.smooth:
            fraction = fraction * fraction * (3.0 - 2.0 * fraction)
        following = min(key + 1, last)
        position = (1.0 - fraction) * self.positions[key] + fraction * self.positions[following]
        angles = (1.0 - fraction) * self.angles[key] + fraction * self.angles[following]
        rotation = angles[0] if self.dimension == 2 else tuple(angles)
        return position, rotation_matrix(rotation, self.dimension)


def origin(collider: Collider, dimension: int) -> FloatArray:
    """The point of a collider that its ``position`` (a half-space's ``point``) says [m], shape (d,)."""
    place = collider.point if isinstance(collider, HalfSpace) else collider.position
    return np.zeros(dimension) if place is None else np.asarray(place, dtype=float)


def motion_of(collider: Collider, dimension: int) -> Motion | None:
    """The motion of a collider; None where it stands still."""
    if not collider.motion:
        return None
    rotation = getattr(collider, "rotation", 0.0)
    return motion_along(
        collider.motion, origin(collider, dimension), rotation, collider.interpolation is Interpolation.SMOOTH
    )


def motion_along(keyframes: Sequence[Keyframe], position: FloatArray, rotation: Rotation, smooth: bool) -> Motion:
    """The motion through keyframes of what is at a place [m], shape (d,), turned by angles [degrees], without them."""
    angle_count = 1 if len(position) == 2 else 3
    angles = np.broadcast_to(np.asarray(rotation, dtype=float), angle_count)
    positions, turns = [], []
    for keyframe in keyframes:
        if keyframe.position is not None:
            position = np.asarray(keyframe.position, dtype=float)
        if keyframe.rotation is not None:
            angles = np.broadcast_to(np.asarray(keyframe.rotation, dtype=float), angle_count)
        positions.append(position)
        turns.append(angles)
    return Motion(np.array([keyframe.time for keyframe in keyframes]), np.array(positions), np.array(turns), smooth)
