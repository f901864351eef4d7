"""Colliders as numbers for the kernels. NumPy only."""

import math

import numpy as np
from numpy.typing import NDArray

from sandbox.render import palette
from sandbox.scene.model import BoxCollider, Collider, HalfSpace, SphereCollider

GROUND = (0.52, 0.535, 0.56)
"""Linear colour of half-spaces that name none."""
COLLIDER = (0.50, 0.53, 0.57)
"""Linear colour of other colliders that name none."""
PLANE, WALL, SPHERE, BOX = 0, 1, 2, 3
KIND, POINT, SHAPE, AXES, TINT, SPACING, FADE, ROW = 0, 1, 4, 7, 16, 19, 20, 21
MISS = 1e30
STEEPEST_GROUND = 50.0
"""Angle from the horizontal up to which a half-space is ground, and opaque [degrees]."""


def rotation_matrix(rotation: float | tuple[float, float, float]) -> NDArray[np.float64]:
    """Rotation about x, then y, then z [degrees], shape (3, 3); one number turns about z."""
    x, y, z = (0.0, 0.0, rotation) if isinstance(rotation, int | float) else rotation
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(math.radians(a)), math.sin(math.radians(a))) for a in (x, y, z))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def collider_rows(colliders: tuple[Collider, ...], bounds: NDArray[np.float64]) -> NDArray[np.float32]:
    """Colliders as the kernels read them, shape (collider_count, ROW)."""
    rows = np.zeros((len(colliders), ROW), dtype=np.float32)
    extent = float(np.max(bounds[1] - bounds[0])) or 1.0
    for row, collider in zip(rows, colliders, strict=True):
        tint = np.array(COLLIDER)
        match collider:
            case HalfSpace():
                normal = np.array(collider.normal) / np.linalg.norm(collider.normal)
                is_ground = normal[1] > math.cos(math.radians(STEEPEST_GROUND))
                tint = np.array(GROUND)
                row[KIND] = PLANE if is_ground else WALL
                row[POINT : POINT + 3] = collider.point
                row[SHAPE : SHAPE + 3] = normal
                row[AXES : AXES + 6] = np.concatenate(_plane_axes(normal))
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
                row[AXES : AXES + 9] = rotation_matrix(collider.rotation).T.ravel()
        if collider.color is not None:
            tint = palette.to_linear(palette.from_hex(collider.color))
        row[TINT : TINT + 3] = tint
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


def _plane_axes(normal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    along = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    first = along - normal * (along @ normal)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)
