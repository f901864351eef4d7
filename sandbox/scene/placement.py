"""Where shapes stand: rotations and spins from the numbers of a scene."""

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.model import Rotation

FloatArray = NDArray[np.float64]


def rotation_matrix(rotation: Rotation, dimension: int) -> FloatArray:
    """Matrix that turns column vectors, shape (dimension, dimension).

    2D: angle [degrees], counter-clockwise. 3D: about x, then y, then z [degrees]: R = Rz Ry Rx.
    """
    angles = np.radians(rotation)
    if dimension == 2:
        c, s = float(np.cos(angles)), float(np.sin(angles))
        return np.array([[c, -s], [s, c]])
    matrix = np.eye(3)
    for axis, angle in enumerate(np.broadcast_to(angles, 3)):
        c, s = np.cos(angle), np.sin(angle)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
        matrix = turn @ matrix
    return matrix


def spin(angular_velocity: Rotation, arms: FloatArray) -> FloatArray:
    """Velocities of points that turn about the origin [m/s], shape like ``arms``; rates in rad/s."""
    if arms.shape[1] == 2:
        return np.stack([-arms[:, 1], arms[:, 0]], axis=1) * angular_velocity
    return np.cross(np.broadcast_to(angular_velocity, 3), arms)
