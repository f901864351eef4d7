"""What browsers draw of the bodies, as arrays: patches of surface, rods and balls. NumPy only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.render.skin import body_offsets
from sandbox.scene.appearance import Appearance, FloatArray, Shown

Vertices = NDArray[np.float32]
Faces = NDArray[np.uint32]

_LINE = 0.06
"""Half-width of a 2D outline, where the body has no radius, as part of the typical spring length [1]."""


@dataclass(frozen=True)
class Patch:
    """The surface of a body, in vertices of its own: those of outer and inner faces are apart, and so are lit apart."""

    body: int
    points: NDArray[np.int64]
    """Drawn point of every vertex, shape (V,)."""
    faces: Faces
    """Vertices of every triangle, shape (F, 3)."""
    is_outer: NDArray[np.bool_]
    """True for vertices of what is outside while all is whole, shape (V,)."""
    offset: float
    """How far outside of its points the surface is drawn [m]."""

    @classmethod
    def of(cls, appearance: Appearance, body: int, shown: Shown) -> "Patch":
        """The shown triangles of a body that has some."""
        mine = appearance.triangle_body == body
        is_inner = np.zeros(len(mine), dtype=bool) if appearance.cells is None else appearance.cells.triangles.is_inner
        chosen = mine & shown.triangles
        triangles, inner = appearance.triangles[chosen].astype(np.int64), is_inner[chosen]
        if len(triangles) == 0:
            # Browsers want at least one; this has no area.
            triangles, inner = np.repeat(appearance.triangles[mine][:1, :1], 3, axis=1), np.zeros(1, dtype=bool)
        keys, faces = np.unique(2 * triangles + inner[:, None], return_inverse=True)
        is_sheet = bool(appearance.body_two_sided[body]) or appearance.dimension == 2
        offset = 0.0 if is_sheet else float(body_offsets(appearance)[body])
        return cls(body, keys // 2, faces.reshape(-1, 3).astype(np.uint32), keys % 2 == 0, offset)

    def vertices(self, drawn: FloatArray) -> Vertices:
        """Where the vertices are [m], shape (V, 3), for drawn points of shape (P, d)."""
        own = drawn[self.points]
        if self.offset > 0.0:
            own = own + self.offset * self._normals(own)
        return in_space(own)

    def _normals(self, own: FloatArray) -> FloatArray:
        """Unit normals of the outer faces, 0 at vertices of inner ones, shape (V, 3)."""
        faces = self.faces[self.is_outer[self.faces[:, 0]]]
        corner = own[faces]
        area = np.repeat(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), 3, axis=0)
        total = np.stack([np.bincount(faces.ravel(), area[:, axis], len(own)) for axis in range(3)], axis=1)
        return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300))


def patches(appearance: Appearance, shown: Shown) -> list[Patch]:
    """The surfaces of all bodies that have one."""
    return [Patch.of(appearance, int(body), shown) for body in np.unique(appearance.triangle_body)]


@dataclass(frozen=True)
class Rods:
    """The ropes and struts of a body, or its outline in 2D; R of them, between J joints."""

    body: int
    ends: NDArray[np.int64]
    """Drawn points, shape (R, 2)."""
    radius: FloatArray
    """[m], shape (R,)."""
    is_outline: bool
    rows: NDArray[np.int64]
    """Which capsules or outline edges of the appearance they are, shape (R,)."""
    joints: NDArray[np.int64]
    """Drawn point of every joint, shape (J,)."""
    joint_radius: FloatArray
    """[m], shape (J,)."""

    @classmethod
    def of(cls, appearance: Appearance, body: int, is_outline: bool) -> "Rods":
        """Those of a body."""
        bodies = appearance.outline_body if is_outline else appearance.capsule_body
        rows = np.nonzero(bodies == body)[0]
        if is_outline:
            ends = appearance.outline[rows].astype(np.int64)
            radius = np.full(len(rows), body_offsets(appearance)[body] or _LINE * appearance.element_size)
        else:
            ends, radius = appearance.capsules[rows].astype(np.int64), appearance.capsule_radius[rows]
        joints, where = np.unique(ends, return_inverse=True)
        joint_radius = np.zeros(len(joints))
        np.maximum.at(joint_radius, where.ravel(), np.repeat(radius, 2))
        return cls(body, ends, radius, is_outline, rows, joints, joint_radius)

    def placed(self, drawn: FloatArray, shown: Shown) -> tuple[Vertices, Vertices, Vertices]:
        """Start [m], shape (R, 3), turn as quaternion w x y z, shape (R, 4), and size [m], shape (R, 3).

        Of rods that stand on the origin along z, of radius and length 1; those not shown have no size.
        """
        start, end = in_space(drawn[self.ends[:, 0]]), in_space(drawn[self.ends[:, 1]])
        mask = (shown.outline if self.is_outline else shown.capsules)[self.rows]
        length = np.linalg.norm(end - start, axis=1)
        width = np.where(mask, self.radius, 0.0)
        size = np.stack([width, width, np.where(mask, length, 0.0)], axis=1).astype(np.float32)
        return start, turns(end - start), size

    def joint_sizes(self, shown: Shown) -> Vertices:
        """Radius of every joint [m], shape (J, 3): 0 where no rod is shown that ends there."""
        mask = (shown.outline if self.is_outline else shown.capsules)[self.rows]
        seen = np.isin(self.joints, self.ends[mask])
        return np.repeat(np.where(seen, self.joint_radius, 0.0)[:, None], 3, axis=1).astype(np.float32)


def rods(appearance: Appearance) -> list[Rods]:
    """Those of all bodies that have some."""
    return [
        Rods.of(appearance, int(body), is_outline)
        for is_outline, bodies in ((False, appearance.capsule_body), (True, appearance.outline_body))
        for body in np.unique(bodies)
    ]


@dataclass(frozen=True)
class Balls:
    """The particles of a body that are drawn as spheres; B of them."""

    body: int
    particles: NDArray[np.int64]
    """Shape (B,)."""
    radius: FloatArray
    """[m], shape (B,)."""


def balls(appearance: Appearance) -> list[Balls]:
    """Those of all bodies that have some."""
    return [
        Balls(int(body), appearance.spheres[mine].astype(np.int64), appearance.sphere_radius[mine])
        for body in np.unique(appearance.sphere_body)
        for mine in [appearance.sphere_body == body]
    ]


def in_space(points: FloatArray) -> Vertices:
    """Points of a scene [m], shape (N, d), in three dimensions, shape (N, 3)."""
    result = np.zeros((len(points), 3), dtype=np.float32)
    result[:, : points.shape[1]] = points
    return result


def turns(directions: NDArray[np.floating]) -> Vertices:
    """Quaternions w x y z, shape (N, 4), that turn the z axis into directions of any length, shape (N, 3)."""
    length = np.maximum(np.linalg.norm(directions, axis=1), 1e-30)
    x, y, z = (directions / length[:, None]).T
    result = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=1)
    result[z < -0.999999] = (0.0, 1.0, 0.0, 0.0)
    return np.asarray(result / np.linalg.norm(result, axis=1, keepdims=True), dtype=np.float32)
