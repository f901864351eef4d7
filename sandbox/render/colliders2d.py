"""Two-dimensional colliders as numbers for the kernels. NumPy only."""

import math

import numpy as np
from numpy.typing import NDArray

from sandbox.render import palette
from sandbox.scene.model import BoxCollider, Collider, HalfSpace, SphereCollider

COLLIDER = (0.56, 0.59, 0.63)
"""Linear colour of colliders that name none."""
LINE, DISC, RECTANGLE = 0, 1, 2
KIND, POINT, SHAPE, AXIS, TINT, ROW = 0, 1, 3, 5, 7, 10


def collider_rows(colliders: tuple[Collider, ...]) -> NDArray[np.float32]:
    """Colliders as the kernels read them, shape (collider_count, ROW)."""
    rows = np.zeros((len(colliders), ROW), dtype=np.float32)
    for row, collider in zip(rows, colliders, strict=True):
        match collider:
            case HalfSpace():
                row[KIND] = LINE
                row[POINT : POINT + 2] = collider.point
                row[AXIS : AXIS + 2] = np.array(collider.normal) / np.linalg.norm(collider.normal)
            case SphereCollider():
                row[KIND] = DISC
                row[POINT : POINT + 2] = collider.position
                row[SHAPE] = collider.radius
            case BoxCollider():
                angle = collider.rotation if isinstance(collider.rotation, int | float) else collider.rotation[2]
                row[KIND] = RECTANGLE
                row[POINT : POINT + 2] = collider.position
                row[SHAPE : SHAPE + 2] = np.array(collider.size) / 2
                row[AXIS : AXIS + 2] = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        tint = np.array(COLLIDER)
        if collider.color is not None:
            tint = palette.to_linear(palette.from_hex(collider.color))
        row[TINT : TINT + 3] = tint
    return rows
