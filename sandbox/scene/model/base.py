"""What all parts of a scene share: the base model, and the kinds of numbers, with their bounds."""

import math
import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict
from pydantic_core import PydanticCustomError

from sandbox.errors import did_you_mean

MOST_PARTICLES = 20_000_000
"""Most particles or cells of one body: what fits into some 10 GB with its springs."""
LARGEST = 1e15
"""Largest number that is computed with, in any unit; its square is still far from the end of f32."""
LEAST = 1e-18
"""Least positive number that is, likewise."""


class Model(BaseModel):
    """Base of all parts of a scene: immutable, no unknown keys, no infinities."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)


def _sized(value: float) -> float:
    if abs(value) > LARGEST:
        text = "must not be beyond {most}, got {v}"
        raise PydanticCustomError("too_large", text, {"most": f"{LARGEST:g}", "v": f"{value:g}"})
    return value


def _not_tiny(value: float) -> float:
    if 0.0 < value < LEAST:
        text = "is too small to compute with (below {least}), got {v}"
        raise PydanticCustomError("too_small", text, {"least": f"{LEAST:g}", "v": f"{value:g}"})
    return value


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


def _color(value: str) -> str:
    """A color as #rrggbb."""
    if re.fullmatch("#[0-9a-fA-F]{6}", value):
        return value
    from PIL import ImageColor  # only scenes that name colors wait for it

    if value.casefold() not in ImageColor.colormap and not re.fullmatch("#[0-9a-fA-F]{3}", value):
        hint = did_you_mean(value, ImageColor.colormap)
        text = "must be a color such as #e8604c or a CSS name such as tomato, got {got}"
        raise PydanticCustomError("color", text + hint, {"got": repr(value)})  # type: ignore[arg-type]
    red, green, blue = ImageColor.getrgb(value)[:3]
    return f"#{red:02x}{green:02x}{blue:02x}"


# Strict: text or a boolean where a number belongs is a mistake to report, not to convert.
Real = Annotated[float, Strict(), AfterValidator(_sized)]
Integer = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
Vector = Annotated[tuple[Real, ...], AfterValidator(_vector)]
Size = Annotated[Vector, AfterValidator(_positive_components)]
Direction = Annotated[Vector, AfterValidator(_nonzero)]
Outline = Annotated[tuple[Vector, ...], Field(min_length=3)]
Positive = Annotated[Real, Field(gt=0), AfterValidator(_not_tiny)]
NonNegative = Annotated[Real, Field(ge=0), AfterValidator(_not_tiny)]
Fraction = Annotated[Real, Field(ge=0, le=1)]
Index = Annotated[Integer, Field(ge=0)]
Cells = Annotated[Integer, Field(ge=1, le=4096)]
COLOR_HELP = "color (sRGB) as #rrggbb, or by its CSS name, such as tomato"
Color = Annotated[
    str,
    AfterValidator(_color),
    Field(description=COLOR_HELP, json_schema_extra={"pattern": "^(#[0-9a-fA-F]{6}|#[0-9a-fA-F]{3}|[a-zA-Z]+)$"}),
]
Rotation = Real | tuple[Real, Real, Real]

BEND_HELP = (
    "bend springs, which skip one particle along each edge direction: their stiffness over that of structural "
    "springs [1]; 0: none"
)
SCALE_HELP = "factor from the file's units to metres"
LONGEST_HELP = "length of the longest side of the mesh's box, whatever the file's units are [m]; instead of scale"
ROTATION_HELP = "2D: angle [degrees], counter-clockwise; 3D: angles about x, then y, then z [degrees]"
