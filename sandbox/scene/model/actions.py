"""What is done to bodies, and when: by hand, by tool, by air."""

import itertools
from typing import Annotated, Literal, Union

from pydantic import ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from sandbox.scene.model.base import Direction, Index, Model, NonNegative, Positive, Real, Vector
from sandbox.scene.model.bodies import Region
from sandbox.scene.model.colliders import Interpolation, Keyframe
from sandbox.scene.model.solver import IntegratorName

Name = Annotated[str, Field(min_length=1)]


class _Span(Model):
    """Something that lasts."""

    start: NonNegative = Field(description="[s]")
    end: Positive = Field(description="[s]")

    @model_validator(mode="after")
    def _lasts(self) -> "_Span":
        if self.end <= self.start:
            raise PydanticCustomError("order", "end must be later than start", {})
        return self


class _Moment(Model):
    """Something that happens at once, or little by little over a span."""

    time: NonNegative | None = Field(None, description="when it happens at once [s]")
    start: NonNegative | None = Field(None, description="when it begins, if it takes time [s]")
    end: Positive | None = Field(None, description="when it ends [s]")

    @model_validator(mode="after")
    def _when(self) -> "_Moment":
        spans = self.start is not None and self.end is not None
        if (self.time is None) != spans or (self.start is None) != (self.end is None):
            raise PydanticCustomError("when", "give either time, or start and end", {})
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise PydanticCustomError("order", "end must be later than start", {})
        return self

    @property
    def span(self) -> tuple[float, float]:
        """When it begins and ends [s]; the same twice where it happens at once."""
        if self.start is None or self.end is None:
            return self.time or 0.0, self.time or 0.0
        return self.start, self.end


class Choice(Model):
    """Particles that something is done to: of one body or of all, in a box, in a ball, or all of them."""

    body: Name | None = Field(None, description="name of the body; default: all bodies")
    region: Region | None = Field(None, description="world box [m]: the particles in it when the action begins")
    point: Vector | None = Field(None, description="centre of a ball [m]: the particles in it when the action begins")
    radius: Positive | None = Field(None, description="radius of that ball [m]")

    @model_validator(mode="after")
    def _place(self) -> "Choice":
        if (self.point is None) != (self.radius is None):
            raise PydanticCustomError("ball", "point and radius go together", {})
        if self.region is not None and self.point is not None:
            raise PydanticCustomError("exclusive", "give region, or point and radius, not both", {})
        return self


class _Somewhere(Choice):
    @model_validator(mode="after")
    def _somewhere(self) -> "_Somewhere":
        if self.body is None and self.region is None and self.point is None:
            raise PydanticCustomError("nowhere", "give body, region, or point and radius", {})
        return self


class Waypoint(Model):
    """Where a grip is led."""

    time: NonNegative = Field(description="[s]")
    position: Vector = Field(description="[m]")


class Grab(_Span):
    """A hand takes particles near a point, or those that a ray meets first, and leads them: damped springs to a
    place that moves, in straight lines from where the grip was at the start through the waypoints."""

    kind: Literal["grab"]
    body: Name | None = Field(None, description="name of the body; default: whichever is nearest")
    point: Vector = Field(description="where it grabs, or where the ray begins [m]")
    direction: Direction | None = Field(None, description="direction of a ray, as from an eye; default: none")
    radius: Positive | None = Field(
        None, description="reach of the grip around the nearest particle [m]; default: an eighth of the body's size"
    )
    path: tuple[Waypoint, ...] = Field((), description="where the middle of the grip is led; default: held in place")
    stiffness: Positive | None = Field(
        None,
        description="of all springs of the grip together [N/m]; default: what swings the body twice a second, at most "
        "what any scheme can take",
    )
    damping_ratio: NonNegative = Field(1.0, description="of the grip with the body's mass [1]")
    max_force: Positive | None = Field(
        None, description="most that the grip pulls with [N]; default: five times the body's weight on Earth"
    )

    @model_validator(mode="after")
    def _rises(self) -> "Grab":
        times = [waypoint.time for waypoint in self.path]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)) or (times and times[0] < self.start):
            raise PydanticCustomError("order", "times of the path must rise, and not come before start", {})
        return self


class Poke(Choice):
    """A blow: an impulse that all particles of a ball share by their masses."""

    kind: Literal["poke"]
    time: NonNegative = Field(description="[s]")
    point: Vector = Field(description="centre of the ball [m]")
    radius: Positive = Field(description="radius of the ball [m]")
    impulse: Vector = Field(description="in all [N s]")


class Push(_Span, _Somewhere):
    """An even force for a time, shared in equal parts by the particles that are there when it begins."""

    kind: Literal["push"]
    force: Vector = Field(description="in all [N]")


class Shake(_Span):
    """The ground shakes: seen from it, every free particle feels m A (2 pi f)^2 sin(2 pi f (t - start))."""

    kind: Literal["shake"]
    body: Name | None = Field(None, description="the one body that feels it; default: all")
    amplitude: Vector = Field(description="of the ground's displacement A [m]")
    frequency: Annotated[Real, Field(gt=0, le=1e6)] = Field(description="f [Hz]")


class Breeze(_Span):
    """Air that blows for a time, in addition to the scene's wind."""

    kind: Literal["wind"]
    velocity: Vector = Field(description="[m/s]")
    rise: NonNegative = Field(0.0, description="time to rise to full strength, and to fall at the end [s]")


class Cut(_Moment):
    """Parts springs: those that cross a plane, or those that a blade, an edge swept along, passes through.

    In 2D the blade is a point that goes from one end of an edge to the other.
    """

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True, serialize_by_alias=True)

    kind: Literal["cut"]
    body: Name | None = Field(None, description="name of the body; default: all")
    point: Vector | None = Field(None, description="a point of the plane [m]")
    normal: Direction | None = Field(None, description="normal of the plane; any length")
    region: Region | None = Field(None, description="world box outside of which the plane does not cut [m]")
    edge_start: Vector | None = Field(None, alias="from", description="one end of the blade's edge [m]")
    edge_end: Vector | None = Field(None, alias="to", description="its other end [m]")
    sweep: Vector | None = Field(None, description="3D: the way of the edge, from start to end of the action [m]")

    @model_validator(mode="after")
    def _tool(self) -> "Cut":
        plane, blade = (self.point, self.normal), (self.edge_start, self.edge_end)
        if (None in plane) == (None in blade) or any(part is not None for part in (plane if None in plane else blade)):
            raise PydanticCustomError("tool", "give a plane (point, normal) or a blade (from, to)", {})
        if None in blade and (self.sweep is not None or self.time is None):
            raise PydanticCustomError("plane", "a plane cuts at one time, and is not swept", {})
        if None in plane and self.region is not None:
            raise PydanticCustomError("blade", "region belongs to a plane", {})
        return self


class Pump(_Span):
    """Lets gas into a body with pressure, or out of it, at an even rate."""

    kind: Literal["pump"]
    body: Name = Field(description="name of the body")
    amount: Real = Field(description="gas let in between start and end [mol]; negative: out")


class Hold(_Somewhere):
    """What pins and lets go have in common."""

    time: NonNegative = Field(description="[s]")
    indices: tuple[Index, ...] = Field((), description="particle indices within the body; default: all that are chosen")

    @model_validator(mode="after")
    def _indexed(self) -> "Hold":
        if self.indices and self.body is None:
            raise PydanticCustomError("indices", "indices need a body", {})
        return self


class PinDown(Hold):
    """Stops particles where they are; they move no more."""

    kind: Literal["pin"]


class Unpin(Hold):
    """Lets particles go that were pinned, held by a collider or led."""

    kind: Literal["unpin"]


class Spawn(Model):
    """A body of the scene enters only now, where and as fast as it says."""

    kind: Literal["spawn"]
    time: Positive = Field(description="[s]")
    body: Name = Field(description="name of the body")


class Move(Model):
    """Leads a collider, or the particles of a body that are pinned from the start, by keyframes."""

    kind: Literal["move"]
    collider: Name | None = Field(None, description="name of a collider without a motion of its own")
    body: Name | None = Field(None, description="name of a body with pinned particles")
    path: tuple[Keyframe, ...] = Field(
        min_length=1, description="where the collider, or the middle of the pinned particles, is at some times"
    )
    interpolation: Interpolation = Field(Interpolation.LINEAR, description="how it moves between keyframes")

    @model_validator(mode="after")
    def _what(self) -> "Move":
        if (self.collider is None) == (self.body is None):
            raise PydanticCustomError("exclusive", "give either collider or body", {})
        times = [keyframe.time for keyframe in self.path]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise PydanticCustomError("order", "times of the path must rise", {})
        return self


class _Reform(_Moment, Choice):
    """Springs with both ends among the chosen particles; their damping ratio stays."""


class Stiffen(_Reform):
    """Makes springs stiffer."""

    kind: Literal["stiffen"]
    factor: Annotated[Real, Field(ge=1, le=1e6)] = Field(description="stiffness afterwards over that before [1]")


class Soften(_Reform):
    """Makes springs softer."""

    kind: Literal["soften"]
    factor: Annotated[Real, Field(gt=0, le=1, ge=1e-6)] = Field(description="stiffness afterwards over that before [1]")


class Switch(Model):
    """Solves the scene another way from now on."""

    kind: Literal["solver"]
    time: NonNegative = Field(description="[s]")
    integrator: IntegratorName | None = Field(None, description="time integration scheme; default: as before")
    dt: Positive | Literal["auto"] | None = Field(None, description='largest step [s] or "auto"; default: as before')
    iterations: Annotated[int, Field(ge=1, le=100_000)] | None = Field(None, description="default: as before")


Action = Annotated[
    Union[  # noqa: UP007 - a union of so many reads better one a line
        Grab, Poke, Push, Shake, Breeze, Cut, Pump, PinDown, Unpin, Spawn, Move, Stiffen, Soften, Switch,
    ],
    Field(discriminator="kind"),
]  # fmt: skip
