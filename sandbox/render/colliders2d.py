"""Two-dimensional colliders as numbers for the kernels. NumPy only."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sandbox.render import palette
from sandbox.scene.appearance import FloatArray
from sandbox.scene.model import (
    BoxCollider,
    CapsuleCollider,
    Collider,
    HalfSpace,
    PolygonCollider,
    SphereCollider,
)
from sandbox.scene.motion import motion_of, origin
from sandbox.scene.placement import rotation_matrix

COLLIDER = (0.56, 0.59, 0.63)
"""Linear colour of colliders that name none."""
LINE, DISC, RECTANGLE, ROD, POLYGON = range(5)
KIND, POINT, SHAPE, AXIS, TINT, ROW = 0, 1, 3, 5, 7, 10
EDGE = 6


def pose(collider: Collider, time: float) -> tuple[FloatArray, FloatArray]:
    """Origin [m], shape (2,), and rotation matrix, shape (2, 2), of a collider at a time [s]."""
    motion = motion_of(collider, 2)
    if motion is not None:
        return motion.pose(time)
    return origin(collider, 2), rotation_matrix(getattr(collider, "rotation", 0.0), 2)


def collider_rows(colliders: Sequence[Collider], time: float = 0.0) -> NDArray[np.float32]:
    """Colliders at a time [s] as the kernels read them, shape (collider_count, ROW).

    Polygons name their edges in the list that `polygon_edges` makes of the same colliders.
    """
    rows = np.zeros((len(colliders), ROW), dtype=np.float32)
    edge_count = 0
    for row, collider in zip(rows, colliders, strict=True):
        place, turn = pose(collider, time)
        row[POINT : POINT + 2], row[AXIS : AXIS + 2] = place, turn[:, 0]
        match collider:
            case HalfSpace():
                row[KIND] = LINE
                row[AXIS : AXIS + 2] = turn @ collider.normal / np.linalg.norm(collider.normal)
            case SphereCollider():
                row[KIND], row[SHAPE] = DISC, collider.radius
            case BoxCollider():
                row[KIND] = RECTANGLE
                row[SHAPE : SHAPE + 2] = np.array(collider.size) / 2
            case CapsuleCollider():
                row[KIND], row[SHAPE] = ROD, collider.radius
                row[POINT : POINT + 2] = place + turn @ collider.start
                row[AXIS : AXIS + 2] = turn @ np.subtract(collider.end, collider.start)
            case PolygonCollider():
                count = len(collider.points) + sum(len(hole) for hole in collider.holes)
                row[KIND] = POLYGON
                row[SHAPE : SHAPE + 2] = edge_count, count
                edge_count += count
        row[TINT : TINT + 3] = palette.tint(collider.color, COLLIDER)
    return rows


def nothing() -> NDArray[np.float32]:
    """A row for scenes without colliders, since kernels take no empty arrays: a disc far from having a size."""
    rows = np.zeros((1, ROW), dtype=np.float32)
    rows[0, KIND], rows[0, SHAPE] = DISC, -1e30
    return rows


def polygon_edges(colliders: Sequence[Collider]) -> FloatArray:
    """Every edge of every polygon, its holes' among them, in its own axes, shape (edge_count, EDGE).

    An edge is its start and end [m], one over its squared length [1/m^2], and its slope dx/dy.
    """
    edges = [np.zeros((0, EDGE))]
    for collider in colliders:
        if isinstance(collider, PolygonCollider):
            for outline in (collider.points, *collider.holes):
                corners = np.array(outline, dtype=float)
                ends = np.roll(corners, -1, axis=0)
                along = ends - corners
                square = np.maximum((along**2).sum(axis=1), 1e-20)
                # The slope of level edges is never asked for.
                slope = along[:, 0] / np.where(along[:, 1] == 0.0, 1.0, along[:, 1])
                edges.append(np.column_stack([corners, ends, 1.0 / square, slope]))
    return np.concatenate(edges)
