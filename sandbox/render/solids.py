"""Colliders as triangles and rods: those that move, and triangle meshes. NumPy only."""

from dataclasses import dataclass

import numpy as np

from sandbox.render import palette
from sandbox.render.colliders import COLLIDER, GROUND, is_ground, plane_axes
from sandbox.scene.appearance import FloatArray, IntArray
from sandbox.scene.model import BoxCollider, CapsuleCollider, Collider, HalfSpace, MeshCollider, SphereCollider
from sandbox.scene.motion import Motion, motion_of, origin
from sandbox.scene.placement import rotation_matrix

CREASE = 35.0
"""Angle between faces of a mesh from which on their common edge is sharp [degrees]."""
POSES = 12
"""Poses between two keyframes at which a moving collider's extent is taken."""
BOX_CELLS, PLATE_CELLS = 4, 20
"""Cells along the edges of boxes and plates: a triangle that reaches behind the eye is not drawn."""
PLATE_REACH, GROUND_REACH, PLATE_THICKNESS = 0.65, 2.0, 0.04
"""Half-width and thickness of the plate that stands for a moving half-space, as part of the scene's extent."""


@dataclass(frozen=True)
class Solid:
    """A collider in its own axes, and where it is."""

    corners: FloatArray
    """Corners of every triangle, counter-clockwise from outside [m], shape (triangle_count, 3, 3)."""
    normals: FloatArray
    """Unit normals at the corners, shape (triangle_count, 3, 3)."""
    ends: FloatArray
    """Both ends of every rod, equal for a sphere [m], shape (rod_count, 2, 3)."""
    radius: FloatArray
    """Radius of every rod [m], shape (rod_count,)."""
    tint: FloatArray
    """Linear colour, shape (3,)."""
    origin: FloatArray
    """Where it stands if it does not move [m], shape (3,)."""
    rotation: FloatArray
    """How it stands if it does not move, shape (3, 3)."""
    motion: Motion | None
    """How it moves."""
    is_casting: bool = True
    """False for ground, under which nothing is that its shadow could fall on."""

    def pose(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Origin [m], shape (3,), and rotation matrix, shape (3, 3), at a time [s]."""
        return (self.origin, self.rotation) if self.motion is None else self.motion.pose(time)

    def places(self) -> FloatArray:
        """Corners, and ends of rods, wherever they come to [m], shape (count, 3)."""
        points = np.concatenate([self.corners.reshape(-1, 3), self.ends.reshape(-1, 3)])
        times = [0.0] if self.motion is None else _times(self.motion)
        return np.concatenate([points @ rotation.T + place for place, rotation in map(self.pose, times)])

    def extent(self) -> FloatArray:
        """Lower and upper corner of all places that it comes to [m], shape (2, 3)."""
        places, grown = self.places(), self.radius.max(initial=0.0)
        return np.array([places.min(axis=0) - grown, places.max(axis=0) + grown])


def build_solid(collider: Collider, bounds: FloatArray) -> Solid | None:
    """A collider as triangles and rods; None for half-spaces at rest, and what three dimensions do not know.

    `bounds` is the box that the bodies move in [m], shape (2, 3).
    """
    motion = motion_of(collider, 3)
    corners, normals = np.zeros((0, 3, 3)), np.zeros((0, 3, 3))
    ends, radius = np.zeros((0, 2, 3)), np.zeros(0)
    match collider:
        case HalfSpace() if motion is not None:
            corners, normals = _plate(collider, motion, bounds)
        case SphereCollider():
            ends, radius = np.zeros((1, 2, 3)), np.array([collider.radius])
        case CapsuleCollider():
            ends, radius = np.array([[collider.start, collider.end]], dtype=float), np.array([collider.radius])
        case BoxCollider():
            corners, normals = _box(np.array(collider.size) / 2, (BOX_CELLS,) * 3)
        case MeshCollider():
            corners, normals = _mesh(collider)
        case _:
            return None
    tint = palette.tint(collider.color, GROUND if isinstance(collider, HalfSpace) else COLLIDER)
    rotation = rotation_matrix(getattr(collider, "rotation", 0.0), 3)
    is_casting = not (isinstance(collider, HalfSpace) and is_ground(_normal(collider)))
    return Solid(corners, normals, ends, radius, tint, origin(collider, 3), rotation, motion, is_casting)


def corner_normals(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """Unit normals of a mesh's corners, smooth but across creases, shape (triangle_count, 3, 3).

    Each is the mean, by angle, over those faces around the vertex that are turned less than `CREASE` against its own.
    """
    corner = vertices[triangles]
    face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    face /= np.maximum(np.linalg.norm(face, axis=1, keepdims=True), 1e-300)
    ahead, behind = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    lengths = np.linalg.norm(ahead, axis=2) * np.linalg.norm(behind, axis=2)
    cosine = (ahead * behind).sum(axis=2) / np.maximum(lengths, 1e-300)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0)).ravel()
    # All pairs of corners at one vertex.
    vertex = triangles.ravel()
    order = np.argsort(vertex, kind="stable")
    count = np.bincount(vertex, minlength=len(vertices))
    start = np.cumsum(count) - count
    pairs = count[vertex]
    one = np.repeat(np.arange(len(vertex)), pairs)
    within = np.arange(len(one)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    other = order[start[vertex[one]] + within]
    is_smooth = (face[one // 3] * face[other // 3]).sum(axis=1) > np.cos(np.radians(CREASE))
    one, other = one[is_smooth], other[is_smooth]
    weighted = face[other // 3] * angle[other, None]
    total = np.stack([np.bincount(one, weighted[:, k], minlength=len(vertex)) for k in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(length > 1e-12, total / np.maximum(length, 1e-12), np.repeat(face, 3, axis=0))
    return np.asarray(total.reshape(-1, 3, 3), dtype=float)


def _times(motion: Motion) -> FloatArray:
    fractions = np.arange(POSES) / POSES
    between = motion.times[:-1, None] + np.diff(motion.times)[:, None] * fractions
    return np.append(between.ravel(), motion.times[-1])


def _mesh(collider: MeshCollider) -> tuple[FloatArray, FloatArray]:
    from sandbox.scene.mesh_file import load_surface

    surface = load_surface(collider)
    return surface.vertices[surface.triangles], corner_normals(surface.vertices, surface.triangles)


def _box(half: FloatArray, cells: tuple[int, int, int]) -> tuple[FloatArray, FloatArray]:
    """Corners and normals of a box of half edge lengths `half` [m], its faces cut into cells."""
    corners, normals = [], []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        m, n = cells[first], cells[second]
        u, v = np.meshgrid(np.linspace(-1, 1, m + 1), np.linspace(-1, 1, n + 1), indexing="ij")
        for side in (-1.0, 1.0):
            grid = np.empty((m + 1, n + 1, 3))
            grid[..., axis], grid[..., first], grid[..., second] = side, u, v
            grid *= half
            a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
            faces = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)
            corners.append(faces if side > 0 else faces[:, ::-1])
            normals.append(np.broadcast_to(side * np.eye(3)[axis], faces.shape))
    return np.concatenate(corners), np.concatenate(normals)


def _normal(collider: HalfSpace) -> FloatArray:
    return np.array(collider.normal, dtype=float) / np.linalg.norm(collider.normal)


def _plate(collider: HalfSpace, motion: Motion, bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A plate whose upper face lies in the plane, in front of the bodies' box."""
    low, high = np.asarray(bounds, dtype=float)
    extent = float((high - low).max()) or 1.0
    normal = _normal(collider)
    axes = np.array([*plane_axes(normal), normal])
    place, rotation = motion.pose(0.0)
    # The middle of the box, dropped onto the plane at the start.
    middle = rotation.T @ ((low + high) / 2 - place)
    middle -= normal * (middle @ normal)
    width = (GROUND_REACH if is_ground(normal) else PLATE_REACH) * extent
    thickness = PLATE_THICKNESS * extent
    corners, normals = _box(np.array([width, width, thickness / 2]), (PLATE_CELLS, PLATE_CELLS, 1))
    if not is_ground(normal) and not is_ground(-normal):
        # Walls are seen from their free side only, as they are at rest: they would hide what they push.
        is_kept = normals[:, 0, 2] > -0.5
        corners, normals = corners[is_kept], normals[is_kept]
    return (corners - np.array([0.0, 0.0, thickness / 2])) @ axes + middle, normals @ axes
