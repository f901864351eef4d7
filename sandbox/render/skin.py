"""Surfaces as they meet each other: a contact radius outside of the particles. NumPy only."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sandbox.render.topology import Surface, build_surface
from sandbox.scene.appearance import Appearance, FloatArray, IntArray


@dataclass(frozen=True)
class Skin:
    """The surfaces of all bodies, each its contact radius outside of the points that it hangs on."""

    surface: Surface
    triangle_body: IntArray
    """Body of every triangle, shape (triangle_count,)."""
    radius: FloatArray
    """How far outside of its point a vertex lies [m], shape (vertex_count,)."""
    vertex_place: IntArray
    """Number of the place of every vertex, shape (vertex_count,); a face inside a body has vertices of its own at the
    places of others. Counted from 0 along ``place_point``."""
    place_point: IntArray
    """Point at every place, shape (place_count,)."""


def body_offsets(appearance: Appearance) -> FloatArray:
    """How far outside of its particles a body is drawn [m], shape (body_count,).

    That is its contact radius; 0 where its particles are drawn, since they show it themselves.
    """
    if appearance.body_radius is None:
        return np.zeros(len(appearance.body_colors))
    result = np.array(appearance.body_radius, dtype=float)
    result[appearance.sphere_body] = 0.0
    return result


def has_two_skins(appearance: Appearance) -> NDArray[np.bool_]:
    """True for sheets with a contact radius, shape (body_count,): they are drawn with a skin on either side.

    Sheets that may tear are not: a tear would show that there is nothing between the skins.
    """
    has_two = appearance.body_two_sided & (body_offsets(appearance) > 0.0)
    return has_two if appearance.cells is None else has_two & ~appearance.cells.body_opens


def is_inner(appearance: Appearance) -> NDArray[np.bool_]:
    """True for triangles between cells, inside of bodies that can tear, shape (triangle_count,)."""
    if appearance.cells is None:
        return np.zeros(len(appearance.triangles), dtype=bool)
    return appearance.cells.triangles.is_inner


def outline_corners(appearance: Appearance) -> tuple[IntArray, IntArray]:
    """Particles of closed outlines, each between those before and after it, shape (count, 3), and their bodies.

    Where an outline ends, or meets itself or another, it has no corners.
    """
    edges = appearance.outline.astype(np.int64)
    count = appearance.particle_count
    starts, ends = np.bincount(edges[:, 0], minlength=count), np.bincount(edges[:, 1], minlength=count)
    is_corner = (starts == 1) & (ends == 1)
    after, before, body = (np.zeros(count, dtype=np.int32) for _ in range(3))
    after[edges[:, 0]], before[edges[:, 1]], body[edges[:, 0]] = edges[:, 1], edges[:, 0], appearance.outline_body
    corners = np.stack([before, np.arange(count, dtype=np.int32), after], axis=1)
    return corners[is_corner], body[is_corner]


def build_skin(appearance: Appearance) -> Skin:
    """Triangles in the order of the appearance; then the other sides of sheets, and the rims that join both."""
    triangles, bodies = appearance.triangles, appearance.triangle_body
    offsets = body_offsets(appearance)
    # A sheet that is drawn with one skin stays where it is: both of its sides are seen.
    offsets = np.where(appearance.body_two_sided & ~has_two_skins(appearance), 0.0, offsets)
    is_double = has_two_skins(appearance)[bodies]
    point_count = appearance.particle_count + len(appearance.carried_nodes)
    # Past the second skins: edges between the outside and the inside are sharp.
    triangles = (triangles + np.int32(2 * point_count) * is_inner(appearance)[:, None]).astype(np.int32)
    if np.any(is_double):
        back = triangles[is_double][:, ::-1] + np.int32(point_count)
        rim, rim_body = _rims(triangles[is_double], bodies[is_double], point_count)
        triangles = np.concatenate([triangles, back]).astype(np.int32)
        bodies = np.concatenate([bodies, bodies[is_double], rim_body]).astype(np.int32)
    surface = build_surface(triangles, point_count)
    names = np.unique(triangles)
    names -= np.int32(2 * point_count) * (names >= 2 * point_count)
    places, inverse = np.unique(names, return_inverse=True)
    if np.any(is_double):
        # Normals do not know of rims: each skin ends at its edge.
        rim = np.searchsorted(np.unique(triangles), rim).astype(np.int32)
        surface = replace(surface, triangles=np.concatenate([surface.triangles, rim]))
    radius = np.zeros(len(surface.points))
    radius[surface.triangles.ravel()] = np.repeat(offsets[bodies], 3)
    vertex_place = inverse.reshape(-1).astype(np.int32)
    return Skin(surface, bodies, radius, vertex_place, (places % point_count).astype(np.int32))


def _rims(triangles: IntArray, bodies: IntArray, point_count: int) -> tuple[IntArray, IntArray]:
    """Triangles between both skins along the open edges of sheets, and their bodies."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    keys = edges.min(axis=1) * point_count + edges.max(axis=1)
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    is_open = counts[inverse.ravel()] == 1
    a, b = edges[is_open].T
    rim = np.concatenate(
        [np.stack([a + point_count, b + point_count, b], axis=1), np.stack([a + point_count, b, a], axis=1)]
    )
    return rim.astype(np.int32), np.tile(np.tile(bodies, 3)[is_open], 2)
