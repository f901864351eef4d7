"""What acts on bodies from outside: air, and each other."""

from typing import Annotated

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from sandbox.scene.model.base import Direction, Flag, Index, Model, NonNegative, Positive, Real, Vector


class Gust(Model):
    """Waves of stronger and weaker wind that travel with it; the same for the same seed."""

    strength: Positive = Field(description="root mean square of what gusts add along each axis [m/s]")
    period: Positive = Field(2.0, description="typical time between gusts at one place [s]")
    length: Positive = Field(3.0, description="typical distance between gusts [m]")
    seed: Index = Field(0, description="which gusts")


class Vortex(Model):
    """Wind that turns about a line (3D) or a point (2D): Rankine's vortex."""

    center: Vector = Field(description="a point of the axis [m]")
    axis: Direction | None = Field(None, description="direction of the axis, 3D; default: +y")
    speed: Real = Field(description="largest speed, at the radius [m/s]; negative turns the other way")
    radius: Positive = Field(description="radius of the core [m]")


class Wind(Model):
    """Air that moves: force 1/2 rho C A |u| (u n) n on every face, with u the wind relative to the face."""

    velocity: Vector | None = Field(None, description="uniform part [m/s]; default: none")
    gust: Gust | None = Field(None, description="irregular part")
    vortices: tuple[Vortex, ...] = Field((), description="turning parts")
    density: Positive = Field(1.2, description="density of the air [kg/m^3]")
    drag_coefficient: Positive = Field(1.2, description="C of a face across the wind [1]")
    skin_coefficient: NonNegative = Field(0.0, description="C along a face [1]")
    start: NonNegative = Field(0.0, description="when it begins to blow [s]")
    end: Positive | None = Field(None, description="when it ends [s]; default: never")
    rise: NonNegative = Field(0.0, description="time to rise to full strength, and to fall at the end [s]")

    @model_validator(mode="after")
    def _lasts(self) -> "Wind":
        if self.end is not None and self.end <= self.start:
            raise PydanticCustomError("ends_first", "end must be later than start", {})
        return self


class Contact(Model):
    """How particles meet particles."""

    enabled: Flag = Field(True, description="false: bodies meet colliders only, whatever their radii")
    skin: Annotated[Positive, Field(le=100)] = Field(
        0.25, description="extra reach of neighbour lists over the largest radius [1]; wider ones are made less often"
    )
