"""The key light and the frame of its shadow map. NumPy only."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sandbox.render.camera import PinholeCamera, corners, padded_bounds
from sandbox.scene.appearance import FloatArray

LIGHT_TILE = 32
"""Side of a tile of the shadow map [texels]: at least the widest penumbra."""
SHADOW_TEXELS = 1 << 20
"""Number of texels of the shadow map, at most."""
SHADOW_MARGIN = 28
"""Texels kept free around what casts, at least the widest penumbra."""
COARSEST = 0.4
"""How fine a map that holds all there is to see must be, in the resolution of one that holds the bodies alone."""
ROOM = 0.15
"""Room for bodies beside the box that they are expected in, where it is seen, in longest sides of the box."""
WIDE_FADE = 96
"""Texels along the edges in which shadows fade where they go on outside of the map."""
LONGEST = 8.0
"""Ratio of the sides of a map, at most."""
FARTHEST = 50.0
"""Height above and below the bodies up to which colliders cast, in heights of the bodies' box."""
TURNS = np.radians(np.arange(0.0, 90.0, 3.0))
"""Angles by which the axes of the map are turned, to see which fits best."""


@dataclass(frozen=True)
class LightFrame:
    """Directional light: texel (u, v) and height w toward the light [m] of a point p are linear in p."""

    direction: FloatArray
    """Unit vector toward the light, shape (3,)."""
    u_axis: FloatArray
    """Unit vector of growing u, shape (3,)."""
    v_axis: FloatArray
    """Unit vector of growing v, shape (3,); u x v points toward the light."""
    origin: FloatArray
    """Point at u = v = w = 0 [m], shape (3,): below all that casts, so that heights are positive."""
    texels_per_metre: float
    """Resolution of the shadow map [1/m]."""
    size: tuple[int, int]
    """Texels of the map along u and v, whole tiles."""
    top: float
    """Height above all that casts [m]."""
    fade: float
    """Distance from the map's edges within which shadows fade out [texels]."""

    def locate(self, points: FloatArray) -> FloatArray:
        """Texel u, texel v and height w [m] of points [m], shape (..., 3) to (..., 3)."""
        relative = np.asarray(points, dtype=float) - self.origin
        scale = self.texels_per_metre
        return np.stack(
            [relative @ self.u_axis * scale, relative @ self.v_axis * scale, relative @ self.direction], axis=-1
        )


def key_light(
    camera: PinholeCamera, bounds: FloatArray, casters: Sequence[tuple[FloatArray, float]], seen: FloatArray
) -> LightFrame:
    """Light from above, to the left of and a little behind the camera.

    Its map holds the box `bounds` [m], and what `casters` may shade of what is `seen`. Casters are the points that a
    collider is made of, wherever it comes to [m], shape (count, 3), and the radius around them [m]. `seen` are points
    in the picture on which shadows may fall [m], shape (count, 3).
    """
    direction, across = _directions(camera)
    along = np.cross(direction, across)
    box = corners(padded_bounds(bounds))
    aside = np.array([1.0, 0.0, 1.0]) * ROOM * float(np.max(bounds[1] - bounds[0]))
    casters = [*casters, (corners(bounds + np.array([-aside, aside])), 0.0)]
    best: tuple[float, FloatArray, bool, FloatArray, FloatArray] | None = None
    for turn in TURNS:
        u_axis = math.cos(turn) * across + math.sin(turn) * along
        axes = np.array([u_axis, np.cross(direction, u_axis)])
        rectangle, is_whole = _fit(
            box @ axes.T, [(points @ axes.T, radius) for points, radius in casters], seen @ axes.T
        )
        area = float(np.prod(rectangle[1] - rectangle[0]))
        # Equally good turns: the first, whatever the rounding.
        if best is None or area < best[0] * (1.0 - 1e-6):
            best = area, rectangle, is_whole, axes[0], axes[1]
    assert best is not None
    _, rectangle, is_whole, u_axis, v_axis = best
    scale, size = _resolution(rectangle[1] - rectangle[0])
    low, high = _heights(box @ direction, [(points @ direction, radius) for points, radius in casters])
    # Heights start well below the lowest caster: they are compared as the bits of positive floats.
    depth = low - float((rectangle[1] - rectangle[0]).max())
    corner = rectangle.mean(axis=0) - np.array(size) / 2 / scale
    origin = corner[0] * u_axis + corner[1] * v_axis + depth * direction
    fade = float(SHADOW_MARGIN if is_whole else WIDE_FADE)
    return LightFrame(direction, u_axis, v_axis, origin, scale, size, high - depth, fade)


def _directions(camera: PinholeCamera) -> tuple[FloatArray, FloatArray]:
    """Unit vectors toward the light, and level across it, shape (3,)."""
    up = np.array([0.0, 1.0, 0.0])
    right = camera.right - up * (camera.right @ up)
    right /= np.linalg.norm(right)
    back = np.cross(right, up)
    direction = 1.0 * up - 0.50 * right + 0.33 * back
    direction /= np.linalg.norm(direction)
    across = np.cross(up, direction)
    return direction, across / np.linalg.norm(across)


def _fit(box: FloatArray, casters: Sequence[tuple[FloatArray, float]], seen: FloatArray) -> tuple[FloatArray, bool]:
    """Lower and upper corner of the map's rectangle [m], shape (2, 2), from what is given in its axes [m].

    The flag is False where not all that there is to see found room.
    """
    least = np.array([box.min(axis=0), box.max(axis=0)])
    low, high = least
    if len(seen):
        view = np.minimum(seen.min(axis=0), low), np.maximum(seen.max(axis=0), high)
        for points, radius in casters:
            first = np.maximum(points.min(axis=0) - radius, view[0])
            last = np.minimum(points.max(axis=0) + radius, view[1])
            if np.all(last > first):
                low, high = np.minimum(low, first), np.maximum(high, last)
    full = np.array([low, high])
    # Too coarse a map would spoil all shadows for the sake of some far ones.
    largest = float(np.prod(least[1] - least[0])) / COARSEST**2
    part = 1.0
    while part > 0.0 and np.prod(np.diff(least + part * (full - least), axis=0)) > largest:
        part -= 1.0 / 64
    return least + max(part, 0.0) * (full - least), part == 1.0


def _heights(box: FloatArray, casters: Sequence[tuple[FloatArray, float]]) -> tuple[float, float]:
    """Heights between which all casts that matters [m], from the heights of what is given [m], with room to spare."""
    reach = float(np.ptp(box))
    low = min([float(box.min()), *(float(heights.min()) - radius for heights, radius in casters)])
    high = max([float(box.max()), *(float(heights.max()) + radius for heights, radius in casters)])
    return max(low, box.min() - FARTHEST * reach) - reach, min(high, box.max() + FARTHEST * reach) + reach


def _resolution(extent: FloatArray) -> tuple[float, tuple[int, int]]:
    """Texels a metre, and texels along u and v, of a map that holds a rectangle of sides `extent` [m], shape (2,)."""
    extent = np.maximum(extent, extent.max() / LONGEST)
    margin = 2.0 * SHADOW_MARGIN
    # (scale a + margin) (scale b + margin) = SHADOW_TEXELS.
    area, half = float(np.prod(extent)), 0.5 * margin * float(extent.sum())
    scale = (math.sqrt(half * half + area * (SHADOW_TEXELS - margin * margin)) - half) / area
    tiles = np.maximum((scale * extent + margin) // LIGHT_TILE, 3).astype(int)
    scale = float(np.min((tiles * LIGHT_TILE - margin) / extent))
    return scale, (int(tiles[0]) * LIGHT_TILE, int(tiles[1]) * LIGHT_TILE)
