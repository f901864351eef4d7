"""What browsers draw of colliders, as triangles in their own axes, and where they are. NumPy only."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.render import palette
from sandbox.render.colliders import GROUND, grid_spacing, is_ground, plane_axes
from sandbox.render.colliders2d import COLLIDER, pose
from sandbox.render.solids import build_solid
from sandbox.scene.appearance import FloatArray
from sandbox.scene.model import BoxCollider, CapsuleCollider, Collider, HalfSpace, PolygonCollider, SphereCollider

Corners = Sequence[Sequence[float]] | FloatArray
Pose = Callable[[float], tuple[FloatArray, FloatArray]]

_REACH = 6.0
"""Half-width of a plane, in extents of the scene [1]."""
_BEHIND = 0.002
"""How far behind the bodies 2D colliders are drawn, in extents of the scene [1]."""
_CIRCLE = 64


@dataclass(frozen=True)
class Block:
    """A collider as a browser draws it."""

    vertices: FloatArray
    """In its own axes [m], shape (V, 3)."""
    faces: NDArray[np.uint32]
    """Counter-clockwise from outside, shape (F, 3)."""
    color: tuple[int, int, int]
    """sRGB, 0 to 255."""
    pose: Pose
    """Origin [m], shape (3,), and rotation matrix, shape (3, 3), at a time [s]."""
    moves: bool
    grid: float | None = None
    """Spacing of the grid on it [m]; None: it has none. Its own z axis is then normal to it."""


def build_blocks(colliders: Sequence[Collider], bounds: FloatArray) -> list[Block]:
    """Colliders as browsers draw them; ``bounds`` is the box that bodies move in [m], shape (2, d)."""
    build = _block_2d if bounds.shape[1] == 2 else _block_3d
    return [block for collider in colliders if (block := build(collider, bounds)) is not None]


def quaternion(rotation: FloatArray) -> tuple[float, float, float, float]:
    """A rotation matrix, shape (3, 3), as w x y z."""
    # Of the four the largest component is exact; the others follow from it (Shepperd 1978).
    r = rotation
    squares = np.array([
        1.0 + r[0, 0] + r[1, 1] + r[2, 2], 1.0 + r[0, 0] - r[1, 1] - r[2, 2],
        1.0 - r[0, 0] + r[1, 1] - r[2, 2], 1.0 - r[0, 0] - r[1, 1] + r[2, 2],
    ])  # fmt: skip
    largest = int(np.argmax(squares))
    twice = np.array([
        [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], squares[1], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
        [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], squares[2], r[1, 2] + r[2, 1]],
        [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[3]],
    ])[largest]  # fmt: skip
    w, x, y, z = (float(value) for value in twice / np.linalg.norm(twice))
    return w, x, y, z


def filled(outlines: Sequence[Corners]) -> tuple[FloatArray, NDArray[np.uint32]]:
    """Vertices, shape (V, 2), and counter-clockwise triangles, shape (F, 3), of what outlines enclose.

    By the even-odd rule: outlines inside of another are holes. In strips between the heights of corners, each a row
    of trapezoids.
    """
    starts = np.concatenate([np.asarray(outline, dtype=float) for outline in outlines])
    ends = np.concatenate([np.roll(np.asarray(outline, dtype=float), -1, axis=0) for outline in outlines])
    heights = np.unique(starts[:, 1])
    corners: list[list[float]] = []
    for low, high in itertools.pairwise(heights):
        crosses = (np.minimum(starts[:, 1], ends[:, 1]) <= low) & (np.maximum(starts[:, 1], ends[:, 1]) >= high)
        a, b = starts[crosses], ends[crosses]
        slope = (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
        below, above = a[:, 0] + slope * (low - a[:, 1]), a[:, 0] + slope * (high - a[:, 1])
        order = np.argsort(below + above, kind="stable")
        for left, right in zip(order[::2], order[1::2], strict=False):
            corners += [[below[left], low], [below[right], low], [above[right], high], [above[left], high]]
    quads = np.arange(len(corners)).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.uint32)
    return np.array(corners).reshape(-1, 2), faces


def _block_3d(collider: Collider, bounds: FloatArray) -> Block | None:
    if isinstance(collider, HalfSpace) and not collider.motion:
        return _plane(collider, bounds)
    solid = build_solid(collider, bounds)
    if solid is None:
        return None
    vertices, faces = _joined(solid.corners, solid.normals)
    if len(solid.ends):
        vertices, faces = _rod(solid.ends[0], float(solid.radius[0]))
    return Block(vertices, faces, _srgb(solid.tint), solid.pose, solid.motion is not None)


def _plane(collider: HalfSpace, bounds: FloatArray) -> Block:
    normal = np.asarray(collider.normal, dtype=float) / np.linalg.norm(collider.normal)
    middle, extent = bounds.mean(axis=0), _extent(bounds)
    place = middle - normal * float((middle - np.asarray(collider.point)) @ normal)
    rotation = np.stack([*plane_axes(normal), normal], axis=1)
    vertices = _REACH * extent * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    spacing = grid_spacing(extent) if is_ground(normal) else None
    color = _srgb(palette.tint(collider.color, GROUND))
    return Block(vertices, faces, color, lambda time: (place, rotation), False, spacing)


def _joined(corners: FloatArray, normals: FloatArray) -> tuple[FloatArray, NDArray[np.uint32]]:
    """Triangles with common vertices where both place and normal are the same, so that creases stay sharp."""
    both = np.concatenate([corners.reshape(-1, 3), normals.reshape(-1, 3)], axis=1)
    _, first, inverse = np.unique(np.round(both, 9), axis=0, return_index=True, return_inverse=True)
    return both[first, :3], inverse.reshape(-1, 3).astype(np.uint32)


def _rod(ends: FloatArray, radius: float) -> tuple[FloatArray, NDArray[np.uint32]]:
    """A capsule between two points, or a ball where they are one."""
    import trimesh.creation
    import trimesh.geometry

    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    if length == 0.0:
        shape = trimesh.creation.icosphere(subdivisions=4, radius=radius)
        return np.asarray(shape.vertices) + ends[0], np.asarray(shape.faces, dtype=np.uint32)
    shape = trimesh.creation.capsule(height=length, radius=radius, count=[_CIRCLE // 2, _CIRCLE // 2])
    turn = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], along)[:3, :3]
    # Where its z axis begins is a matter of the version.
    vertices = np.asarray(shape.vertices) - np.array([0.0, 0.0, float(np.mean(shape.bounds[:, 2]))])
    return vertices @ turn.T + ends.mean(axis=0), np.asarray(shape.faces, dtype=np.uint32)


def _block_2d(collider: Collider, bounds: FloatArray) -> Block | None:
    extent = _extent(bounds)
    match collider:
        case HalfSpace():
            outlines = [_half_plane(collider, bounds)]
        case SphereCollider():
            outlines = [_arc(np.zeros(2), collider.radius, 0.0, 2.0 * np.pi)]
        case BoxCollider():
            half = np.asarray(collider.size) / 2
            outlines = [half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])]
        case CapsuleCollider():
            along = np.subtract(collider.end, collider.start)
            angle = float(np.arctan2(along[1], along[0]))
            outlines = [np.concatenate([
                _arc(np.asarray(collider.end), collider.radius, angle - np.pi / 2, angle + np.pi / 2),
                _arc(np.asarray(collider.start), collider.radius, angle + np.pi / 2, angle + 1.5 * np.pi),
            ])]  # fmt: skip
        case PolygonCollider():
            outlines = [np.asarray(outline, dtype=float) for outline in (collider.points, *collider.holes)]
        case _:
            return None

    def place(time: float) -> tuple[FloatArray, FloatArray]:
        if isinstance(collider, HalfSpace) and not collider.motion:
            return np.array([0.0, 0.0, -_BEHIND * extent]), np.eye(3)
        where, turn = pose(collider, time)
        rotation = np.eye(3)
        rotation[:2, :2] = turn
        return np.array([*where, -_BEHIND * extent]), rotation

    flat, faces = filled(outlines)
    vertices = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
    return Block(vertices, faces, _srgb(palette.tint(collider.color, COLLIDER)), place, bool(collider.motion))


def _half_plane(collider: HalfSpace, bounds: FloatArray) -> FloatArray:
    """A large rectangle under the line: around the scene where it rests, in its own axes where it moves."""
    normal = np.asarray(collider.normal, dtype=float) / np.linalg.norm(collider.normal)
    along, reach = np.array([-normal[1], normal[0]]), _REACH * _extent(bounds)
    middle = np.zeros(2)
    if not collider.motion:
        middle = bounds.mean(axis=0)
        middle = middle - normal * float((middle - np.asarray(collider.point)) @ normal)
    return np.array([middle + reach * side for side in (along, -along, -along - normal, along - normal)])


def _arc(center: FloatArray, radius: float, start: float, end: float) -> FloatArray:
    angles = np.linspace(start, end, _CIRCLE, endpoint=False) if end - start > 6.0 else np.linspace(start, end, 32)
    return np.asarray(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))


def _extent(bounds: FloatArray) -> float:
    return float(np.max(bounds[1] - bounds[0])) or 1.0


def _srgb(linear: FloatArray) -> tuple[int, int, int]:
    red, green, blue = (round(255.0 * float(value)) for value in palette.to_srgb(linear))
    return red, green, blue
