"""Colliders for formats that show a whole scene. NumPy only.

Polygons (2D) are left out; a half-space is a large square.
"""

from dataclasses import dataclass

import numpy as np

from sandbox.output.frames import FloatArray
from sandbox.render import palette
from sandbox.render.colliders import COLLIDER, GROUND, plane_axes
from sandbox.render.solids import build_solid
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import BoxCollider, CapsuleCollider, Collider, HalfSpace, SphereCollider
from sandbox.scene.motion import Motion, motion_of, origin
from sandbox.scene.placement import rotation_matrix

_REACH = 4.0
"""Half edge of the square of a half-space, in the size of what moves [1]."""
_ROUND = 64
"""Corners of a disc."""


@dataclass(frozen=True)
class Prop:
    """A collider in its own axes, and where it is: triangles and rods, of which spheres are short ones."""

    name: str
    corners: FloatArray
    """Corners of triangles, counter-clockwise from outside [m], shape (triangle_count, 3, 3)."""
    ends: FloatArray
    """Both ends of every rod [m], shape (rod_count, 2, 3)."""
    radius: FloatArray
    """Of every rod [m], shape (rod_count,)."""
    color: FloatArray
    """Linear colour, shape (3,)."""
    origin: FloatArray
    """Where it stands if it does not move [m], shape (3,)."""
    rotation: FloatArray
    """How it stands if it does not move, shape (3, 3)."""
    motion: Motion | None

    def pose(self, time: float) -> FloatArray:
        """Where it is at a time [s]: the matrix that takes columns (x, y, z, 1) there, shape (4, 4)."""
        place, turn = (self.origin, self.rotation) if self.motion is None else self.motion.pose(time)
        result = np.eye(4)
        result[: len(turn), : len(turn)], result[: len(place), 3] = turn, place
        return result


def props(appearance: Appearance) -> list[Prop]:
    """The colliders of a scene that can be shown."""
    found = []
    for number, collider in enumerate(appearance.colliders):
        name = collider.name or f"{collider.kind}_{number}"
        prop = (_flat if appearance.dimension == 2 else _solid)(name, collider, appearance.bounds)
        if prop is not None:
            found.append(prop)
    return found


def _solid(name: str, collider: Collider, bounds: FloatArray) -> Prop | None:
    solid = build_solid(collider, bounds)
    if solid is not None:
        return Prop(
            name, solid.corners, solid.ends, solid.radius, solid.tint, solid.origin, solid.rotation, solid.motion
        )
    if not isinstance(collider, HalfSpace):
        return None
    normal = np.asarray(collider.normal) / np.linalg.norm(collider.normal)
    first, second = plane_axes(normal)
    middle = bounds.mean(axis=0)
    middle = middle - normal * ((middle - np.asarray(collider.point)) @ normal)
    reach = _REACH * float((bounds[1] - bounds[0]).max())
    square = [middle + reach * (u * first + v * second) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return _still(name, _fan(np.array(square)), collider, np.zeros(3), np.eye(3), None)


def _flat(name: str, collider: Collider, bounds: FloatArray) -> Prop | None:
    outline = _outline(collider, bounds)
    if outline is None:
        return None
    corners = _fan(np.pad(outline, ((0, 0), (0, 1))))
    place = np.pad(origin(collider, 2), (0, 1))
    turn = np.eye(3)
    turn[:2, :2] = rotation_matrix(getattr(collider, "rotation", 0.0), 2)
    return _still(name, corners, collider, place, turn, motion_of(collider, 2))


def _outline(collider: Collider, bounds: FloatArray) -> FloatArray | None:
    """The convex outline of a 2D collider in its own axes, counter-clockwise [m], shape (corner_count, 2)."""
    angles = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    match collider:
        case SphereCollider():
            return np.asarray(collider.radius * circle)
        case BoxCollider():
            return np.asarray(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.asarray(collider.size) / 2)
        case CapsuleCollider():
            start, end = np.asarray(collider.start, dtype=float), np.asarray(collider.end, dtype=float)
            ahead = (circle @ (end - start) > 0.0)[:, None]
            return np.asarray(np.where(ahead, end, start) + collider.radius * circle)
        case HalfSpace():
            normal = np.asarray(collider.normal) / np.linalg.norm(collider.normal)
            along = np.array([normal[1], -normal[0]])
            reach = _REACH * float((bounds[1] - bounds[0]).max())
            middle = along * ((bounds.mean(axis=0) - np.asarray(collider.point)) @ along)
            ends = np.array([middle - reach * along, middle + reach * along])
            return np.concatenate([ends[::-1], ends - 2.0 * reach * normal])
    return None


def _fan(outline: FloatArray) -> FloatArray:
    """Triangles that fill a convex outline, shape (corner_count - 2, 3, 3)."""
    return np.stack([np.broadcast_to(outline[0], outline[2:].shape), outline[1:-1], outline[2:]], axis=1)


def _still(
    name: str, corners: FloatArray, collider: Collider, place: FloatArray, turn: FloatArray, motion: Motion | None
) -> Prop:
    tint = palette.tint(collider.color, GROUND if isinstance(collider, HalfSpace) else COLLIDER)
    return Prop(name, corners, np.zeros((0, 2, 3)), np.zeros(0), tint, place, turn, motion)
