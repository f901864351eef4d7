"""Shapes of bodies."""

from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from sandbox.scene.model.base import (
    BEND_HELP,
    LONGEST_HELP,
    SCALE_HELP,
    Cells,
    Flag,
    Index,
    Integer,
    Model,
    NonNegative,
    Outline,
    Positive,
    Size,
    Vector,
    check_one_size,
)


class Bracing(StrEnum):
    """Which diagonals of a lattice cell carry a spring (2D cells always have both of theirs)."""

    NONE = "none"
    FACE = "face"
    BODY = "body"


class Box(Model):
    """Lattice of particles filling a box (3D) or a rectangle (2D)."""

    kind: Literal["box"]
    size: Size = Field(description="edge lengths [m]")
    cells: tuple[Cells, ...] = Field(description="lattice cells along each edge; one more particle than cells")
    bracing: Bracing = Field(Bracing.FACE, description="shear springs: none, face or body (face and body diagonals)")
    bend: NonNegative = Field(0.0, description=BEND_HELP)


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
    bracing: Bracing = Field(Bracing.FACE, description="shear springs: none or face")
    bend: NonNegative = Field(0.0, description=BEND_HELP)


class Ring(Model):
    """Closed loop of springs in 2D: with `pressure` a balloon."""

    kind: Literal["ring"]
    radius: Positive = Field(description="radius [m]")
    segments: Annotated[Integer, Field(ge=3, le=100_000)] = Field(description="springs around the ring")
    thickness: Positive = Field(1e-2, description="thickness of the wall, for density and Young's modulus [m]")
    bend: NonNegative = Field(0.0, description=BEND_HELP)


class Shell(Model):
    """Hollow sphere of triangles in 3D (a subdivided icosahedron): with `pressure` a balloon."""

    kind: Literal["shell"]
    radius: Positive = Field(description="radius [m]")
    subdivisions: Annotated[Integer, Field(ge=0, le=8)] = Field(
        description="times that the icosahedron's 20 triangles are divided into 4"
    )
    thickness: Positive = Field(1e-3, description="thickness of the wall, for density and Young's modulus [m]")
    bend: NonNegative = Field(
        0.0, description="bend springs across every edge: their stiffness over that of structural springs [1]; 0: none"
    )


class Polygon(Model):
    """2D outline, with holes if need be, filled with triangles."""

    kind: Literal["polygon"]
    points: Outline = Field(description="corners of the outline, in order [m]")
    holes: tuple[Outline, ...] = Field((), description="outlines of holes [m]")
    spacing: Positive = Field(description="wanted length of springs [m]")


class Tower(Model):
    """Truss: legs, horizontals and crosses, narrowing upward; square in plan in 3D. It stands on its position."""

    kind: Literal["tower"]
    levels: Annotated[Integer, Field(ge=1, le=1000)] = Field(description="storeys, one above the other")
    bays: Annotated[Integer, Field(ge=1, le=100)] = Field(1, description="crosses side by side on each face")
    height: Positive = Field(description="height [m]")
    width: Positive = Field(description="width at the foot [m]")
    top_width: Positive | None = Field(None, description="width at the top [m]; default: that of the foot")
    thickness: Positive = Field(0.02, description="diameter of members, for density and Young's modulus [m]")


class Fill(StrEnum):
    """What becomes of a surface mesh."""

    SHELL = "shell"
    LATTICE = "lattice"


class Mesh(Model):
    """Triangle mesh from a file (OBJ, PLY, STL, ...): a shell, or a lattice that fills and carries it."""

    kind: Literal["mesh"]
    file: str = Field(min_length=1, description="path; relative ones start at the scene file's folder")
    scale: Positive = Field(1.0, description=SCALE_HELP)
    size: Positive | None = Field(None, description=LONGEST_HELP)
    center: Flag = Field(
        True, description="what is at the body's position: the middle of the mesh's box; false: the file's origin"
    )
    fill: Fill = Field(Fill.LATTICE, description="shell: springs along edges; lattice: cells inside carry the surface")
    cells: Cells = Field(16, description="lattice cells along the longest side")
    thickness: Positive = Field(1e-3, description="thickness of a shell's wall [m]")
    bracing: Bracing = Field(Bracing.FACE, description="shear springs of the lattice: none, face or body")
    bend: NonNegative = Field(0.0, description="bend springs across every edge of a shell, over structural ones [1]")

    @model_validator(mode="after")
    def _one_size(self) -> "Mesh":
        check_one_size(self.scale, self.size)
        return self


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


Shape = Annotated[
    Box | Ball | Rope | Sheet | Ring | Shell | Polygon | Tower | Mesh | Custom, Field(discriminator="kind")
]
