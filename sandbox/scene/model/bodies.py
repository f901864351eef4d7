"""Bodies: what they are made of, what is inside, and what holds them."""

from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from sandbox.scene.model.base import (
    COLOR_HELP,
    ROTATION_HELP,
    Color,
    Flag,
    Fraction,
    Index,
    Model,
    NonNegative,
    Positive,
    Real,
    Rotation,
    Vector,
)
from sandbox.scene.model.shapes import Shape


class Material(Model):
    """What a body is made of. Springs come from `stiffness`, or from `youngs_modulus` through the lattice."""

    stiffness: Positive | None = Field(None, description="stiffness k of every spring [N/m]")
    youngs_modulus: Positive | None = Field(
        None,
        description="Young's modulus E [Pa]; refining the body changes its stiffness in bending only, by about 1/n^2",
    )
    damping: NonNegative | None = Field(None, description="damping c of every spring [N s/m]")
    damping_ratio: NonNegative | None = Field(
        None, description="damping ratio of every spring with its two masses [1]: c = 2 zeta sqrt(k m_reduced)"
    )
    density: Positive | None = Field(None, description="mass density [kg/m^3]; 1000 when no mass is given")
    mass: Positive | None = Field(None, description="total mass of the body [kg]")
    friction: NonNegative | None = Field(
        None, description="Coulomb friction [1]; with a collider's own: the geometric mean of both"
    )
    restitution: Fraction | None = Field(None, description="restitution [1]; with a collider's own: the larger of both")
    tension_only: Flag = Field(False, description="springs that pull and never push: ropes go slack")
    yield_strain: Positive | None = Field(None, description="elastic strain beyond which the rest length flows [1]")
    creep: Positive | None = Field(
        None, description="rate at which strain beyond yield turns plastic [1/s]; default: at once"
    )
    max_plastic_strain: Positive | None = Field(
        None, description="most that the rest length may change, over the original one [1]; default: no bound"
    )
    break_strain: Positive | None = Field(None, description="strain of stretch beyond which a spring tears [1]")

    @model_validator(mode="after")
    def _plastic(self) -> "Material":
        for name in ("creep", "max_plastic_strain"):
            if getattr(self, name) is not None and self.yield_strain is None:
                raise PydanticCustomError("needs_yield", f"{name} needs yield_strain", {})
        return self

    @model_validator(mode="after")
    def _one_of_each(self) -> "Material":
        for one, other in (("stiffness", "youngs_modulus"), ("damping", "damping_ratio"), ("density", "mass")):
            if getattr(self, one) is not None and getattr(self, other) is not None:
                raise PydanticCustomError("exclusive", f"give {one} or {other}, not both", {})
        return self


class Region(Model):
    """Axis-aligned box in the world."""

    min: Vector = Field(description="lower corner [m]")
    max: Vector = Field(description="upper corner [m]")


class Pin(Model):
    """Particles that never move: by index in the body, or all inside a world region at the start."""

    indices: tuple[Index, ...] = Field((), description="particle indices within the body")
    region: Region | None = Field(None, description="world box [m]; every particle of the body in it is pinned")

    @model_validator(mode="after")
    def _some(self) -> "Pin":
        if not self.indices and self.region is None:
            raise PydanticCustomError("pins_nothing", "give indices or a region", {})
        return self


class Pressure(Model):
    """Ideal gas in a closed body (ring, shell, closed mesh): p = n R T / V against the ambient pressure."""

    amount: NonNegative | None = Field(None, description="amount of gas n [mol]")
    temperature: Annotated[Positive, Field(le=1e6)] = Field(293.15, description="temperature T [K]")
    gauge_pressure: Real | None = Field(None, description="pressure above the ambient in the shape at rest [Pa]")
    ambient: NonNegative = Field(101325.0, description="pressure outside [Pa]")
    leak: NonNegative = Field(0.0, description="rate at which gas above the ambient pressure escapes [1/s]")

    @model_validator(mode="after")
    def _one(self) -> "Pressure":
        if (self.amount is None) == (self.gauge_pressure is None):
            raise PydanticCustomError("exclusive", "give either amount or gauge_pressure", {})
        if self.gauge_pressure is not None and self.gauge_pressure + self.ambient < 0.0:
            raise PydanticCustomError("vacuum", "gauge_pressure is below vacuum: ambient + gauge_pressure < 0", {})
        return self


class Body(Model):
    """One soft body: a shape, where it starts, what it is made of."""

    name: str = Field(min_length=1, description="name, for messages and tables")
    shape: Shape = Field(description="what the body looks like and which springs it has")
    position: Vector | None = Field(None, description="where the shape's centre starts [m]; default: the origin")
    rotation: Rotation = Field(0.0, description=ROTATION_HELP)
    velocity: Vector | None = Field(None, description="initial velocity [m/s]")
    angular_velocity: Rotation | None = Field(
        None, description="initial angular velocity about the position [rad/s]; one number in 2D, three in 3D"
    )
    radius: NonNegative | Literal["auto"] = Field(
        0.0,
        description="radius of the body's particles [m]; bodies with radii meet each other, with 0 only colliders; "
        '"auto": half the distance of neighbours, so that the body has no gaps',
    )
    self_contact: Flag = Field(False, description="particles of this body meet each other, by their radius")
    pressure: Pressure | None = Field(None, description="gas inside the body, which must be closed")
    wind: Flag | None = Field(
        None, description="whether wind blows on its faces; by default on sheets, shells, rings and 2D ropes"
    )
    color: Color | None = Field(None, description=COLOR_HELP + "; by default from a palette")
    material: Material = Material()
    pin: Pin | None = Field(None, description="particles that never move")

    @model_validator(mode="after")
    def _touches(self) -> "Body":
        if self.self_contact and not self.has_radius:
            raise PydanticCustomError("needs_radius", "self_contact needs radius > 0", {})
        return self

    @property
    def has_radius(self) -> bool:
        """Whether other bodies meet this one."""
        return self.radius == "auto" or self.radius > 0.0


class Attachment(Model):
    """Particles of one body held to another body by springs, or carried by a collider."""

    body: str = Field(description="name of the body whose particles are attached")
    indices: tuple[Index, ...] = Field((), description="particle indices within the body")
    region: Region | None = Field(None, description="world box [m]; every particle of the body in it at the start")
    to: str = Field(description="name of the body (its nearest particles), or of the collider")
    stiffness: Positive | None = Field(
        None, description="of the springs to a body [N/m]; default: the mean of both bodies' springs"
    )
    damping: NonNegative = Field(0.0, description="of the springs to a body [N s/m]")
    break_strain: Positive | None = Field(None, description="strain of stretch beyond which the spring tears [1]")

    @model_validator(mode="after")
    def _chooses(self) -> "Attachment":
        if not self.indices and self.region is None:
            raise PydanticCustomError("nothing", "give indices or region", {})
        return self
