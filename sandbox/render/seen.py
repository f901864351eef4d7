"""Where in a scene shadows can be seen to fall: points along rays through the picture. NumPy only."""

from collections.abc import Sequence

import numpy as np

from sandbox.render.camera import PinholeCamera
from sandbox.scene.appearance import FloatArray
from sandbox.scene.model import Collider, HalfSpace

RAYS = (33, 19)
"""Rays across and down the picture, its edges included."""
FARTHEST = 14.0
"""Distance at which ground has faded, in extents of the bodies' box."""


def seen_points(
    camera: PinholeCamera, bounds: FloatArray, boxes: Sequence[FloatArray], colliders: Sequence[Collider]
) -> FloatArray:
    """Points in the picture on which a shadow may fall [m], shape (count, 3).

    Those are where rays meet half-spaces at rest, and where they enter and leave boxes, each of shape (2, 3) [m]: the
    bodies' `bounds`, and `boxes` around other colliders. What is hidden counts, too.
    """
    rays = _rays(camera)
    extent = float(np.max(bounds[1] - bounds[0])) or 1.0
    ways = [way for box in (bounds, *boxes) for way in _through(camera.eye, rays, box)]
    for collider in colliders:
        if isinstance(collider, HalfSpace) and not collider.motion:
            normal = np.array(collider.normal) / np.linalg.norm(collider.normal)
            falling, height = -rays @ normal, float((camera.eye - np.array(collider.point)) @ normal)
            ways.append(np.where(falling > 1e-9, height / np.maximum(falling, 1e-9), -1.0))
    kept = [(way >= 0.0) & (way < FARTHEST * extent) for way in ways]
    return np.concatenate([camera.eye + rays[k] * way[k, None] for way, k in zip(ways, kept, strict=True)])


def _through(eye: FloatArray, rays: FloatArray, box: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ways along unit rays to where they enter and leave a box [m], shape (count,); -1 where they miss it."""
    slopes = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    ends = (np.asarray(box, dtype=float)[:, None, :] - eye) / slopes
    enter, leave = np.maximum(ends.min(axis=0).max(axis=1), 0.0), ends.max(axis=0).min(axis=1)
    return np.where(enter <= leave, enter, -1.0), np.where(enter <= leave, leave, -1.0)


def _rays(camera: PinholeCamera) -> FloatArray:
    """Unit vectors from the eye through the picture, shape (count, 3)."""
    x, y = np.meshgrid(*(np.linspace(0.0, side, count) for side, count in zip(camera.size, RAYS, strict=True)))
    across, down = (x.ravel() - camera.center[0]) / camera.focal, (y.ravel() - camera.center[1]) / camera.focal
    rays = camera.forward + across[:, None] * camera.right - down[:, None] * camera.up
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=float)
