"""Sky, ground and walls as triangles with their colours, seen from a camera. NumPy only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.render import palette
from sandbox.render.camera import PinholeCamera
from sandbox.render.colliders import GROUND, grid_spacing, is_ground, plane_axes
from sandbox.render.surface import BOUNCE, HORIZON, KEY, SKY, ZENITH
from sandbox.scene.appearance import FloatArray, IntArray
from sandbox.scene.model import Collider, HalfSpace

NEAREST_FADE, FARTHEST_FADE = 2.0, 14.0
"""Distances between which the ground fades into the sky, in extents of the bodies' box."""
SKY_REACH = 16.0
"""Radius of the sky, in the same."""
LINE_LIFT = 0.003
"""How much nearer to the eye lines are than the ground, as part of their distance; shadows are half as near."""
_SECTORS, _RINGS, _LINE_PIECES, _LINES_EACH_WAY = 72, 40, 24, 24
_WALL_OPACITY, _WALL_REACH = 0.35, 2.5


@dataclass(frozen=True)
class Plane:
    """A half-space at rest."""

    point: FloatArray
    """[m], shape (3,)."""
    normal: FloatArray
    """Unit vector out of the solid, shape (3,)."""
    tint: FloatArray
    """Linear colour, shape (3,)."""

    @property
    def is_ground(self) -> bool:
        """Whether things stand on it; else it is a wall, and translucent."""
        return is_ground(self.normal)


@dataclass(frozen=True)
class Surroundings:
    """Triangles that depend on nothing but the camera."""

    vertices: NDArray[np.float32]
    """World coordinates [m], then sRGB and opacity, shape (vertex_count, 7)."""
    behind: IntArray
    """Ground and sky, shape (count, 3)."""
    lines: IntArray
    """Lines on the ground, which let some of it through, shape (count, 3)."""
    walls: IntArray
    """Walls, through which one sees, shape (count, 3)."""


def planes_of(colliders: Sequence[Collider]) -> list[Plane]:
    """The half-spaces that do not move."""
    return [
        Plane(
            np.array(collider.point, dtype=float),
            np.array(collider.normal, dtype=float) / np.linalg.norm(collider.normal),
            palette.tint(collider.color, GROUND),
        )
        for collider in colliders
        if isinstance(collider, HalfSpace) and not collider.motion
    ]


def surroundings(camera: PinholeCamera, planes: Sequence[Plane], light: FloatArray, extent: float) -> Surroundings:
    """What a camera sees around the bodies, whose box has this longest side [m]; ``light`` is a unit vector to it.

    Numbers of vertices depend only on the number of planes.
    """
    parts = [_ground(camera, plane, light, extent) for plane in planes if plane.is_ground]
    parts.append(_sky(camera, extent))
    behind_count = len(parts)
    parts += [_lines(camera, plane, extent) for plane in planes if plane.is_ground]
    lines_count = len(parts)
    parts += [_wall(camera, plane, light, extent) for plane in planes if not plane.is_ground]
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    triangles = [own + offset for (_, own), offset in zip(parts, first, strict=False)]

    def joined(rows: list[IntArray]) -> IntArray:
        return np.concatenate([np.zeros((0, 3), dtype=np.int32), *rows]).astype(np.int32)

    return Surroundings(
        np.concatenate([vertices for vertices, _ in parts]).astype(np.float32),
        joined(triangles[:behind_count]),
        joined(triangles[behind_count:lines_count]),
        joined(triangles[lines_count:]),
    )


def sky_light(directions: FloatArray) -> FloatArray:
    """Linear light of the sky along unit directions, shape (count, 3) both."""
    t = _smoothstep(-0.05, 0.55, directions[:, 1])[:, None]
    return np.asarray((1.0 - t) * np.array(HORIZON) + t * np.array(ZENITH))


def plane_light(plane: Plane, light: FloatArray, seen: float) -> FloatArray:
    """Linear light that a plane sends back where the part ``seen`` of the key light arrives, shape (3,)."""
    up = 0.5 + 0.5 * plane.normal[1]
    ambient = plane.tint * (np.array(SKY) * up + np.array(BOUNCE) * (1.0 - up))
    return np.asarray(ambient + plane.tint * np.array(KEY) * max(float(plane.normal @ light), 0.0) * seen)


def _sky(camera: PinholeCamera, extent: float) -> tuple[FloatArray, IntArray]:
    """A sphere around the eye."""
    heights = np.sin(np.radians([-90.0, -30.0, -8.0, -3.0, 0.0, 4.0, 8.0, 12.0, 17.0, 22.0, 28.0, 35.0, 60.0, 90.0]))
    turns = 2.0 * np.pi * np.arange(24) / 24
    y, turn = np.meshgrid(heights, turns, indexing="ij")
    flat = np.sqrt(1.0 - y * y)
    directions = np.stack([flat * np.cos(turn), y, flat * np.sin(turn)], axis=-1).reshape(-1, 3)
    return _colored(camera.eye + SKY_REACH * extent * directions, sky_light(directions)), _quads(len(heights), 24, True)


def _ground(camera: PinholeCamera, plane: Plane, light: FloatArray, extent: float) -> tuple[FloatArray, IntArray]:
    """Rings around the point below the eye, as far as the ground is seen."""
    height = float((camera.eye - plane.point) @ plane.normal)
    farthest = FARTHEST_FADE * extent
    reach = np.sqrt(max(farthest**2 - height**2, 0.0)) if height > 0.0 else 0.0
    first, second = plane_axes(plane.normal)
    steps = np.linspace(0.0, 1.0, _RINGS) ** 2 * reach
    turns = 2.0 * np.pi * np.arange(_SECTORS) / _SECTORS
    radius, turn = np.meshgrid(steps, turns, indexing="ij")
    foot = camera.eye - height * plane.normal
    points = foot + (radius * np.cos(turn))[..., None] * first + (radius * np.sin(turn))[..., None] * second
    points = points.reshape(-1, 3)
    opacity, sky = _fading(camera, points, extent)
    colors = plane_light(plane, light, 1.0) * opacity[:, None] + sky * (1.0 - opacity[:, None])
    return _colored(points, colors), _quads(_RINGS, _SECTORS, True)


def _lines(camera: PinholeCamera, plane: Plane, extent: float) -> tuple[FloatArray, IntArray]:
    """The ground's grid, thin quads of black that let more through the farther they are."""
    spacing, axes = grid_spacing(extent), plane_axes(plane.normal)
    # Where the camera looks, more or less.
    ahead = camera.eye + camera.forward * 2.0 * extent - plane.point
    reach = _LINES_EACH_WAY * spacing
    vertices = []
    for along, across in ((axes[0], axes[1]), (axes[1], axes[0])):
        middle = round(float(ahead @ across) / spacing)
        numbers = np.arange(middle - _LINES_EACH_WAY, middle + _LINES_EACH_WAY + 1)
        steps = round(float(ahead @ along) / spacing) * spacing + np.linspace(-reach, reach, _LINE_PIECES + 1)
        points = plane.point + (numbers * spacing)[:, None, None] * across + steps[:, None] * along
        width = np.where(numbers % 5 == 0, 0.03, 0.012)[:, None] * spacing
        strength = np.where(numbers % 5 == 0, 0.28, 0.20)[:, None]
        vertices.append(_both_sides(camera, plane, points, across, width, strength, extent))
    count = 2 * (2 * _LINES_EACH_WAY + 1)
    first = np.arange(count)[:, None, None] * (2 * (_LINE_PIECES + 1))
    triangles = (_quads(2, _LINE_PIECES + 1, False) + first).reshape(-1, 3)
    return np.concatenate(vertices), triangles.astype(np.int32)


def _both_sides(
    camera: PinholeCamera, plane: Plane, points: FloatArray, across: FloatArray, width: FloatArray,
    strength: FloatArray, extent: float,
) -> FloatArray:  # fmt: skip
    """Vertices on one side, then on the other, of every line, shape (2 line_count point_count, 7).

    `points` have shape (line_count, point_count, 3), `width` [m] and `strength` (line_count, 1).
    """
    way, height = points - camera.eye, float((camera.eye - plane.point) @ plane.normal)
    distance = np.maximum(np.linalg.norm(way, axis=-1), 1e-9)
    sine = np.maximum(abs(height) / distance, 0.02)
    # A pixel covers more of the ground where it is seen at a flat angle, in the direction of sight.
    level = np.abs(way @ across) / distance
    pixel = distance / camera.focal * np.sqrt(1.0 + (level / sine) ** 2)
    drawn = np.maximum(width, 1.5 * pixel)
    opacity = 1.0 - _smoothstep(NEAREST_FADE, FARTHEST_FADE, distance / extent)
    shown = strength * opacity * width / drawn * (1.0 - _smoothstep(3.0, 6.0, distance / extent))
    # Opacity works on sRGB values.
    alpha = (1.0 - (1.0 - shown) ** (1.0 / 2.2)) * (height > 0.0)
    rows = np.zeros((len(points), 2, points.shape[1], 7))
    for side in range(2):
        moved = way + (side - 0.5) * drawn[..., None] * across
        rows[:, side, :, :3] = camera.eye + moved * (1.0 - LINE_LIFT)
        rows[:, side, :, 6] = alpha
    return rows.reshape(-1, 7)


def _wall(camera: PinholeCamera, plane: Plane, light: FloatArray, extent: float) -> tuple[FloatArray, IntArray]:
    """A disc around the plane's point, seen from its free side."""
    height = float((camera.eye - plane.point) @ plane.normal)
    first, second = plane_axes(plane.normal)
    radius, turn = np.meshgrid(
        np.linspace(0.0, _WALL_REACH * extent, 16), 2.0 * np.pi * np.arange(48) / 48, indexing="ij"
    )
    points = plane.point + (radius * np.cos(turn))[..., None] * first + (radius * np.sin(turn))[..., None] * second
    alpha = _WALL_OPACITY * (1.0 - _smoothstep(0.8, _WALL_REACH, radius / extent)) * (height > 0.0)
    colors = np.tile(plane_light(plane, light, 1.0), (radius.size, 1))
    return _colored(points.reshape(-1, 3), colors, alpha.ravel()), _quads(16, 48, True)


def _fading(camera: PinholeCamera, points: FloatArray, extent: float) -> tuple[FloatArray, FloatArray]:
    """How opaque the ground is at points, shape (count,), and the light of the sky behind them, shape (count, 3)."""
    way = points - camera.eye
    distance = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    return 1.0 - _smoothstep(NEAREST_FADE, FARTHEST_FADE, distance / extent), sky_light(way / distance[:, None])


def _colored(points: FloatArray, linear: FloatArray, alpha: FloatArray | None = None) -> FloatArray:
    opacity = np.ones(len(points)) if alpha is None else alpha
    return np.column_stack([points, palette.to_srgb(palette.tone_map(linear)), opacity])


def _quads(rows: int, columns: int, is_closed: bool) -> IntArray:
    """Triangles of a grid of vertices, row after row; where it is closed, the last column meets the first."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns if is_closed else columns - 1), indexing="ij")
    a, b = (i * columns + j).ravel(), (i * columns + (j + 1) % columns).ravel()
    c, d = a + columns, b + columns
    return np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)]).astype(np.int32)


def _smoothstep(low: float, high: float, x: FloatArray) -> FloatArray:
    t = np.clip((np.asarray(x) - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
