"""Cameras that a hand turns: around a target in three dimensions, over the plane in two. NumPy only."""

import math
from dataclasses import dataclass

import numpy as np

from sandbox.render.camera import FlatCamera, PinholeCamera
from sandbox.scene.appearance import FloatArray

STEEPEST = math.radians(89.0)
"""Largest elevation: straight from above, which way is up would be anybody's guess."""
NEAREST, FARTHEST = 0.02, 50.0
"""Distances from the target, in those of the first view."""


@dataclass
class OrbitView:
    """A pinhole camera on a sphere around a target; y is up."""

    target: FloatArray
    """Point that it turns around, in the middle of the picture [m], shape (3,)."""
    distance: float
    """Of the eye from the target [m]."""
    azimuth: float
    """Of the eye, from the z axis toward the x axis [rad]."""
    elevation: float
    """Of the eye above the target's level [rad]."""
    tangent: float
    """Of half the vertical angle of view [1]."""
    size: tuple[int, int]
    """Of the picture [pixels]."""

    def __post_init__(self) -> None:
        self._first = (self.target.copy(), self.distance, self.azimuth, self.elevation)

    @classmethod
    def of(cls, camera: PinholeCamera, bounds: FloatArray) -> "OrbitView":
        """The view of a camera; it turns around what it sees of a box [m], shape (2, 3)."""
        distance = float((np.asarray(bounds).mean(axis=0) - camera.eye) @ camera.forward)
        if distance <= 0.0:
            distance = float(np.linalg.norm(bounds[1] - bounds[0])) or 1.0
        back = -camera.forward
        return cls(
            target=camera.eye + distance * camera.forward,
            distance=distance,
            azimuth=math.atan2(back[0], back[2]),
            elevation=max(-STEEPEST, min(STEEPEST, math.asin(max(-1.0, min(1.0, back[1]))))),
            tangent=0.5 * camera.size[1] / camera.focal,
            size=camera.size,
        )

    @property
    def camera(self) -> PinholeCamera:
        """Where it looks from now."""
        level = math.cos(self.elevation)
        back = np.array([level * math.sin(self.azimuth), math.sin(self.elevation), level * math.cos(self.azimuth)])
        right = np.array([math.cos(self.azimuth), 0.0, -math.sin(self.azimuth)])
        eye = self.target + self.distance * back
        return PinholeCamera(eye, right, np.cross(back, right), -back, 0.5 * self.size[1] / self.tangent, self.size)

    def turn(self, across: float, up: float) -> None:
        """Turn the scene with the hand, by parts of the picture's height; half a turn is one height."""
        self.azimuth -= math.pi * across
        self.elevation = max(-STEEPEST, min(STEEPEST, self.elevation - math.pi * up))

    def shift(self, across: float, up: float) -> None:
        """Move the scene with the hand, by parts of the picture's height."""
        camera, height = self.camera, 2.0 * self.tangent * self.distance
        self.target = self.target - (across * camera.right + up * camera.up) * height

    def zoom(self, factor: float) -> None:
        """Come nearer by a factor [1]."""
        first = self._first[1]
        self.distance = max(NEAREST * first, min(FARTHEST * first, self.distance / factor))

    def resize(self, size: tuple[int, int]) -> None:
        """Fill a picture of another size [pixels]."""
        self.size = size

    def reset(self) -> None:
        """Look from where it first did."""
        target, self.distance, self.azimuth, self.elevation = self._first
        self.target = target.copy()


@dataclass
class FlatView:
    """An orthographic view of the plane."""

    center: FloatArray
    """Point in the middle of the picture [m], shape (2,)."""
    height: float
    """Of the picture [m]."""
    size: tuple[int, int]
    """Of the picture [pixels]."""

    def __post_init__(self) -> None:
        self._first = (self.center.copy(), self.height)

    @classmethod
    def of(cls, camera: FlatCamera) -> "FlatView":
        """The view of a camera."""
        return cls(np.asarray(camera.center, dtype=float), camera.size[1] / camera.scale, camera.size)

    @property
    def camera(self) -> FlatCamera:
        """What it sees now."""
        return FlatCamera(self.center, self.size[1] / self.height, self.size)

    def turn(self, across: float, up: float) -> None:
        """As :meth:`shift`: a plane is not turned."""
        self.shift(across, up)

    def shift(self, across: float, up: float) -> None:
        """Move the scene with the hand, by parts of the picture's height."""
        self.center = self.center - np.array([across, up]) * self.height

    def zoom(self, factor: float) -> None:
        """Come nearer by a factor [1]."""
        first = self._first[1]
        self.height = max(NEAREST * first, min(FARTHEST * first, self.height / factor))

    def resize(self, size: tuple[int, int]) -> None:
        """Fill a picture of another size [pixels]."""
        self.size = size

    def reset(self) -> None:
        """Look where it first did."""
        center, self.height = self._first
        self.center = center.copy()


View = OrbitView | FlatView


def view_of(camera: PinholeCamera | FlatCamera, bounds: FloatArray) -> View:
    """The view that turns a camera."""
    return OrbitView.of(camera, bounds) if isinstance(camera, PinholeCamera) else FlatView.of(camera)
