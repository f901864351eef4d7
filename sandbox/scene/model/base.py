"""What all parts of a scene share: the base model, and the kinds of numbers, with their bounds."""

import math
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict
from pydantic_core import PydanticCustomError

MOST_PARTICLES = 20_000_000
"""Most particles or cells of one body: what fits into some 10 GB with its springs."""
LARGEST = 1e15
"""Largest number that is computed with, in any unit; its square is still far from the end of f32."""


class Model(BaseModel):
    """Base of all parts of a scene: immutable, no unknown keys, no infinities."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)


def _vector(value: tuple[float, ...]) -> tuple[float, ...]:
    if len(value) not in (2, 3):
        raise PydanticCustomError("vector", "must have 2 or 3 components, got {n}", {"n": len(value)})
    return value


def _positive_components(value: tuple[float, ...]) -> tuple[float, ...]:
    for component in value:
        if component <= 0:
            raise PydanticCustomError("positive", "must be > 0 in every direction, got {v}", {"v": component})
    return value


def _nonzero(value: tuple[float, ...]) -> tuple[float, ...]:
    if math.hypot(*value) == 0.0:
        raise PydanticCustomError("nonzero", "must not be the zero vector", {})
    return value


def check_one_size(scale: float, size: float | None) -> None:
    """Raise PydanticCustomError where a mesh file is given two sizes."""
    if size is not None and scale != 1.0:
        raise PydanticCustomError("two_sizes", "give scale or size, not both", {})


# Strict: text or a boolean where a number belongs is a mistake to report, not to convert.
Real = Annotated[float, Strict()]
Integer = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
Vector = Annotated[tuple[Real, ...], AfterValidator(_vector)]
Size = Annotated[Vector, AfterValidator(_positive_components)]
Direction = Annotated[Vector, AfterValidator(_nonzero)]
Outline = Annotated[tuple[Vector, ...], Field(min_length=3)]
Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Fraction = Annotated[Real, Field(ge=0, le=1)]
Index = Annotated[Integer, Field(ge=0)]
Cells = Annotated[Integer, Field(ge=1, le=4096)]
Color = Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$", description="colour as #rrggbb (sRGB)")]
Rotation = Real | tuple[Real, Real, Real]

BEND_HELP = (
    "bend springs, which skip one particle along each edge direction: their stiffness over that of structural "
    "springs [1]; 0: none"
)
SCALE_HELP = "factor from the file's units to metres"
LONGEST_HELP = "length of the longest side of the mesh's box, whatever the file's units are [m]; instead of scale"
ROTATION_HELP = "2D: angle [degrees], counter-clockwise; 3D: angles about x, then y, then z [degrees]"
