"""Solid things that bodies meet, and how they move."""

import itertools
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from sandbox.scene.model.base import (
    COLOR_HELP,
    LONGEST_HELP,
    ROTATION_HELP,
    SCALE_HELP,
    Color,
    Direction,
    Flag,
    Fraction,
    Integer,
    Model,
    NonNegative,
    Outline,
    Positive,
    Rotation,
    Size,
    Vector,
    check_one_size,
)


class Keyframe(Model):
    """Where a moving collider is at one time."""

    time: NonNegative = Field(description="[s]")
    position: Vector | None = Field(None, description="as the collider's own [m]; default: unchanged")
    rotation: Rotation | None = Field(None, description=ROTATION_HELP + "; default: unchanged")


class Interpolation(StrEnum):
    """How a collider moves between keyframes."""

    LINEAR = "linear"
    SMOOTH = "smooth"


class Solid(Model):
    """What every collider has."""

    name: str | None = Field(None, description="name, for attachments and messages")
    motion: tuple[Keyframe, ...] = Field((), description="keyframes of position and rotation, in order of time")
    interpolation: Interpolation = Field(
        Interpolation.SMOOTH, description="between keyframes: smooth (starts and stops gently at each) or linear"
    )

    restitution: Fraction = Field(0.0, description="normal speed kept by a bounce [1]")
    friction: NonNegative = Field(0.0, description="Coulomb friction [1]")
    color: Color | None = Field(None, description=COLOR_HELP)

    @model_validator(mode="after")
    def _in_order(self) -> "Solid":
        for row, (before, after) in enumerate(itertools.pairwise(self.motion)):
            if after.time <= before.time:
                raise PydanticCustomError("order", f"motion[{row + 1}].time must be later than the one before", {})
        return self


class HalfSpace(Solid):
    """Everything below a plane is solid."""

    kind: Literal["half_space"]
    point: Vector = Field(description="a point of the surface [m]")
    normal: Direction = Field(description="out of the solid; any length")


class SphereCollider(Solid):
    """Solid sphere (3D) or disc (2D)."""

    kind: Literal["sphere"]
    position: Vector = Field(description="centre [m]")
    radius: Positive = Field(description="radius [m]")


class BoxCollider(Solid):
    """Solid box (3D) or rectangle (2D)."""

    kind: Literal["box"]
    position: Vector = Field(description="centre [m]")
    size: Size = Field(description="edge lengths [m]")
    rotation: Rotation = Field(0.0, description=ROTATION_HELP)


class CapsuleCollider(Solid):
    """Solid rod with round ends: every point within the radius of the line between two points."""

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True, serialize_by_alias=True)

    kind: Literal["capsule"]
    position: Vector | None = Field(None, description="origin of the two points [m]; default: the world's")
    rotation: Rotation = Field(0.0, description=ROTATION_HELP)
    start: Vector = Field(alias="from", description="one end, relative to position [m]")
    end: Vector = Field(alias="to", description="other end, relative to position [m]")
    radius: Positive = Field(description="radius [m]")


class PolygonCollider(Solid):
    """2D solid of any outline, convex or not, with holes if need be."""

    kind: Literal["polygon"]
    position: Vector | None = Field(None, description="origin of the corners [m]; default: the world's")
    rotation: Rotation = Field(0.0, description=ROTATION_HELP)
    points: Outline = Field(description="corners of the outline, relative to position, in order [m]")
    holes: tuple[Outline, ...] = Field((), description="outlines of holes, in which bodies can be [m]")


class MeshCollider(Solid):
    """3D solid inside a closed triangle mesh, which answers by its closest triangle, edge or corner."""

    kind: Literal["mesh"]
    file: str = Field(min_length=1, description="path (OBJ, PLY, STL, ...); relative ones start at the scene's folder")
    scale: Positive = Field(1.0, description=SCALE_HELP)
    size: Positive | None = Field(None, description=LONGEST_HELP)
    center: Flag = Field(
        False, description="what is at the position: the file's origin; true: the middle of the mesh's box"
    )
    position: Vector | None = Field(None, description="where the file's origin or middle is [m]; default: the world's")
    rotation: Rotation = Field(0.0, description=ROTATION_HELP)
    resolution: Annotated[Integer, Field(ge=4, le=512)] = Field(
        64, description="grid cells along the mesh's longest side, where searches begin; changes speed, not results"
    )

    @model_validator(mode="after")
    def _one_size(self) -> "MeshCollider":
        check_one_size(self.scale, self.size)
        return self


Collider = Annotated[
    HalfSpace | SphereCollider | BoxCollider | CapsuleCollider | PolygonCollider | MeshCollider,
    Field(discriminator="kind"),
]
