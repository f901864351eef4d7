"""The scene as a user writes it: frozen pydantic models, every quantity with its unit.

What a scene does not give is not modelled. Unknown keys are errors. This file knows neither NumPy
shapes nor Taichi: :mod:`sandbox.scene.assemble` turns a scene into numbers.
"""

import math
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, model_validator
from pydantic_core import PydanticCustomError


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


# Strict: text or a boolean where a number belongs is a mistake to report, not to convert.
Real = Annotated[float, Strict()]
Integer = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
Vector = Annotated[tuple[Real, ...], AfterValidator(_vector)]
Size = Annotated[Vector, AfterValidator(_positive_components)]
Direction = Annotated[Vector, AfterValidator(_nonzero)]
Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Fraction = Annotated[Real, Field(ge=0, le=1)]
Index = Annotated[Integer, Field(ge=0)]
Cells = Annotated[Integer, Field(ge=1, le=4096)]
Color = Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$", description="colour as #rrggbb (sRGB)")]
Rotation = Real | tuple[Real, Real, Real]

ROTATION_HELP = "2D: angle [degrees], counter-clockwise; 3D: angles about x, then y, then z [degrees]"


class IntegratorName(StrEnum):
    """Time integration schemes, by the field's names."""

    SYMPLECTIC_EULER = "symplectic_euler"
    VELOCITY_VERLET = "velocity_verlet"


class Precision(StrEnum):
    """Floating-point format of every field and kernel."""

    F32 = "f32"
    F64 = "f64"


class Bracing(StrEnum):
    """Which diagonals of a lattice cell carry a spring (2D cells always have both of theirs)."""

    NONE = "none"
    FACE = "face"
    BODY = "body"


class Solver(Model):
    """How time is stepped."""

    integrator: IntegratorName = Field(IntegratorName.SYMPLECTIC_EULER, description="time integration scheme")
    dt: Positive | Literal["auto"] = Field(
        "auto", description='largest step [s], or "auto": `safety` times the stability limit of the scheme'
    )
    safety: Annotated[Real, Field(gt=0, le=1)] = Field(
        0.8, description='fraction of the stability limit that dt = "auto" takes'
    )
    precision: Precision = Field(Precision.F32, description="floating-point format of every field and kernel")


class Diagnostics(Model):
    """Bounds past which a run counts as diverged."""

    max_strain: Positive = Field(10.0, description="largest spring strain |r - L| / L before the run stops [1]")
    max_speed: Positive = Field(1e5, description="largest particle speed before the run stops [m/s]")


class Box(Model):
    """Lattice of particles filling a box (3D) or a rectangle (2D)."""

    kind: Literal["box"]
    size: Size = Field(description="edge lengths [m]")
    cells: tuple[Cells, ...] = Field(description="lattice cells along each edge; one more particle than cells")
    bracing: Bracing = Field(Bracing.FACE, description="diagonal springs: none, face or body (face and body)")


class Ball(Model):
    """Lattice of particles inside a sphere (3D) or a disc (2D), its rim drawn onto the sphere."""

    kind: Literal["ball"]
    radius: Positive = Field(description="radius [m]")
    cells: Annotated[Integer, Field(ge=2, le=4096)] = Field(description="lattice cells across the diameter")
    bracing: Bracing = Field(Bracing.FACE, description="diagonal springs: none, face or body (face and body)")


class Rope(Model):
    """Chain of particles from one point to another."""

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True, serialize_by_alias=True)

    kind: Literal["rope"]
    start: Vector = Field(alias="from", description="first particle, relative to the body's position [m]")
    end: Vector = Field(alias="to", description="last particle, relative to the body's position [m]")
    segments: Cells = Field(description="springs along the rope; one more particle than segments")
    thickness: Positive = Field(0.02, description="diameter, for density, Young's modulus and drawing [m]")


class Sheet(Model):
    """Square-lattice membrane in 3D, flat in the x-z plane until rotated (its normal is +y)."""

    kind: Literal["sheet"]
    size: Size = Field(description="edge lengths along x and z [m]")
    cells: tuple[Cells, Cells] = Field(description="lattice cells along x and z")
    thickness: Positive = Field(1e-3, description="thickness, for density and Young's modulus [m]")
    bracing: Bracing = Field(Bracing.FACE, description="diagonal springs: none or face")


class Custom(Model):
    """Particles and springs, one by one; points are relative to the body's position."""

    kind: Literal["custom"]
    points: tuple[Vector, ...] = Field(min_length=1, description="particle positions [m]")
    springs: tuple[tuple[Index, Index], ...] = Field((), description="pairs of point indices")
    rest_lengths: tuple[NonNegative, ...] | None = Field(
        None, description="rest length of every spring [m]; by default the length as placed"
    )
    masses: tuple[Positive, ...] | None = Field(None, description="mass of every point [kg]; default: see material")
    pinned: tuple[Index, ...] = Field((), description="indices of points that never move")
    triangles: tuple[tuple[Index, Index, Index], ...] = Field(
        (), description="surface triangles to draw, as point indices; counter-clockwise from outside"
    )
    velocities: tuple[Vector, ...] | None = Field(None, description="velocity of every point [m/s]")

    @model_validator(mode="after")
    def _consistent(self) -> "Custom":
        count = len(self.points)
        for name in ("springs", "triangles"):
            for row, indices in enumerate(getattr(self, name)):
                _check_indices(f"{name}[{row}]", indices, count)
        _check_indices("pinned", self.pinned, count)
        for row, (a, b) in enumerate(self.springs):
            if a == b:
                raise PydanticCustomError("self_spring", f"springs[{row}] joins point {a} to itself", {})
        _check_length("rest_lengths", self.rest_lengths, len(self.springs), "spring")
        _check_length("masses", self.masses, count, "point")
        _check_length("velocities", self.velocities, count, "point")
        return self


def _check_indices(name: str, indices: tuple[int, ...], count: int) -> None:
    for index in indices:
        if index >= count:
            raise PydanticCustomError(
                "missing_point", f"{name} names point {index}, but there are only {count} (0 to {count - 1})", {}
            )


def _check_length(name: str, values: tuple[Any, ...] | None, count: int, what: str) -> None:
    if values is not None and len(values) != count:
        raise PydanticCustomError("length", f"{name} must have one entry a {what} ({count}), got {len(values)}", {})


Shape = Annotated[Box | Ball | Rope | Sheet | Custom, Field(discriminator="kind")]


class Material(Model):
    """What a body is made of. Springs come from `stiffness`, or from `youngs_modulus` through the lattice."""

    stiffness: Positive | None = Field(None, description="stiffness k of every spring [N/m]")
    youngs_modulus: Positive | None = Field(
        None, description="Young's modulus E [Pa]; refining the body does not change how stiff it is"
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
    radius: NonNegative = Field(0.0, description="radius of the body's particles, for contact and drawing [m]")
    color: Color | None = Field(None, description="colour as #rrggbb; by default from a palette")
    material: Material = Material()
    pin: Pin | None = Field(None, description="particles that never move")


class Solid(Model):
    """What every collider has."""

    restitution: Fraction = Field(0.0, description="normal speed kept by a bounce [1]")
    friction: NonNegative = Field(0.0, description="Coulomb friction [1]")
    color: Color | None = Field(None, description="colour as #rrggbb (sRGB)")


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


Collider = Annotated[HalfSpace | SphereCollider | BoxCollider, Field(discriminator="kind")]


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
    camera: Camera = Camera()

    @model_validator(mode="after")
    def _even(self) -> "Render":
        if self.size[0] % 2 or self.size[1] % 2:
            raise PydanticCustomError("even", "size must be even in both directions (video needs it)", {})
        return self


class Scene(Model):
    """A soft-body scene in SI units; 2D bodies are 1 m thick."""

    title: str = Field("", description="one line, for lists and captions")
    description: str = Field("", description="what to look for")
    dimension: Literal[2, 3] = Field(description="2 or 3")
    duration: Positive = Field(3.0, description="simulated time [s]")
    gravity: Vector | None = Field(None, description="gravitational acceleration [m/s^2]; none by default")
    drag: NonNegative = Field(0.0, description="drag rate gamma [1/s]: force -gamma m v on every particle")
    solver: Solver = Solver()
    diagnostics: Diagnostics = Diagnostics()
    render: Render = Render()
    bodies: tuple[Body, ...] = Field(min_length=1, description="the soft bodies")
    colliders: tuple[Collider, ...] = Field((), description="solid things that bodies meet")
