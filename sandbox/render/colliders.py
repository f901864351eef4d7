"""Colliders as numbers for the kernels. NumPy only."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sandbox.render import palette
from sandbox.scene.appearance import FloatArray
from sandbox.scene.model import BoxCollider, CapsuleCollider, Collider, HalfSpace, SphereCollider
from sandbox.scene.motion import origin
from sandbox.scene.placement import rotation_matrix

GROUND = (0.52, 0.535, 0.56)
"""Linear colour of half-spaces that name none."""
COLLIDER = (0.50, 0.53, 0.57)
"""Linear colour of other colliders that name none."""
PLANE, WALL, SPHERE, BOX, CAPSULE = range(5)
KIND, POINT, SHAPE, AXES, TINT, SPACING, FADE, ROW = 0, 1, 4, 7, 16, 19, 20, 21
MISS = 1e30
STEEPEST_GROUND = 50.0
"""Angle from the horizontal up to which a half-space is ground, and opaque [degrees]."""


def collider_rows(colliders: Sequence[Collider], bounds: FloatArray) -> NDArray[np.float32]:
    """Colliders at rest as the kernels read them, shape (collider_count, ROW); meshes are no rows."""
    rows = np.zeros((len(colliders), ROW), dtype=np.float32)
    extent = float(np.max(bounds[1] - bounds[0])) or 1.0
    for row, collider in zip(rows, colliders, strict=True):
        match collider:
            case HalfSpace():
                normal = np.array(collider.normal) / np.linalg.norm(collider.normal)
                row[KIND] = PLANE if is_ground(normal) else WALL
                row[POINT : POINT + 3] = collider.point
                row[SHAPE : SHAPE + 3] = normal
                row[AXES : AXES + 6] = np.concatenate(plane_axes(normal))
                row[SPACING] = grid_spacing(extent)
                row[FADE] = extent
            case SphereCollider():
                row[KIND] = SPHERE
                row[POINT : POINT + 3] = collider.position
                row[SHAPE] = collider.radius
            case BoxCollider():
                row[KIND] = BOX
                row[POINT : POINT + 3] = collider.position
                row[SHAPE : SHAPE + 3] = np.array(collider.size) / 2
                row[AXES : AXES + 9] = rotation_matrix(collider.rotation, 3).T.ravel()
            case CapsuleCollider():
                place, turn = origin(collider, 3), rotation_matrix(collider.rotation, 3)
                row[KIND] = CAPSULE
                row[POINT : POINT + 3] = place + turn @ collider.start
                row[SHAPE] = collider.radius
                row[AXES : AXES + 3] = place + turn @ collider.end
        row[TINT : TINT + 3] = palette.tint(collider.color, GROUND if isinstance(collider, HalfSpace) else COLLIDER)
    return rows


def nothing() -> NDArray[np.float32]:
    """A row for scenes without colliders, since kernels take no empty arrays: a sphere without size."""
    rows = np.zeros((1, ROW), dtype=np.float32)
    rows[0, KIND] = SPHERE
    rows[0, SHAPE] = -1.0
    return rows


def grid_spacing(extent: float) -> float:
    """Spacing of the ground's grid [m]: 1, 2 or 5 times a power of ten, about a fifth of `extent` [m]."""
    power = 10.0 ** math.floor(math.log10(extent / 4))
    return power * max(step for step in (1.0, 2.0, 5.0) if step * power <= extent / 4)


def is_ground(normal: FloatArray) -> bool:
    """True for the unit normal, shape (3,), of a half-space that things stand on."""
    return bool(normal[1] > math.cos(math.radians(STEEPEST_GROUND)))


def plane_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along a plane, shape (3,), that make a right-handed frame with its unit normal."""
    along = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    first = along - normal * (along @ normal)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)
