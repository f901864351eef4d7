"""How a scene is shown."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from sandbox.scene.model.base import Flag, Integer, Model, NonNegative, Positive, Real, Vector


class ColorBy(StrEnum):
    """What the colour of a body shows."""

    BODY = "body"
    SPEED = "speed"
    STRAIN = "strain"


class Camera(Model):
    """Where the picture is taken from. What is not given is chosen so that the scene fits."""

    eye: Vector | None = Field(None, description="camera position [m], 3D")
    target: Vector | None = Field(None, description="point in the middle of the picture [m]")
    field_of_view: Annotated[Real, Field(gt=1, lt=150)] = Field(35.0, description="vertical angle [degrees], 3D")
    height: Positive | None = Field(None, description="height of the picture [m], 2D")

    @model_validator(mode="after")
    def _looks_somewhere(self) -> "Camera":
        if self.eye is not None and self.eye == self.target:
            raise PydanticCustomError("same_point", "eye and target are the same point", {})
        return self


class Render(Model):
    """How the scene is shown."""

    fps: Annotated[Real, Field(gt=0, le=1000)] = Field(30.0, description="pictures a simulated second [1/s]")
    size: tuple[Annotated[Integer, Field(ge=16, le=7680)], Annotated[Integer, Field(ge=16, le=7680)]] = Field(
        (1280, 720), description="width and height [pixels], even numbers"
    )
    color: ColorBy = Field(ColorBy.BODY, description="colour by body, speed or strain")
    color_max: Positive | None = Field(
        None, description="value at the top of the colour scale: speed [m/s] or strain [1]; default: chosen"
    )
    particles: Flag = Field(False, description="draw every particle as a sphere")
    struts: Flag = Field(False, description="draw every spring")
    poster: NonNegative | None = Field(None, description="time of the poster [s]; default: the largest deformation")
    camera: Camera = Camera()

    @model_validator(mode="after")
    def _even(self) -> "Render":
        if self.size[0] % 2 or self.size[1] % 2:
            raise PydanticCustomError("even", "size must be even in both directions (video needs it)", {})
        return self
