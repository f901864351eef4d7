"""What browsers ask for. Their callbacks only put these into a queue; the thread of the simulation obeys."""

import math
from dataclasses import dataclass
from typing import Any

Client = int
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Grab:
    """A client takes hold of the body that it sees at a point [m]."""

    client: Client
    point: Point


@dataclass(frozen=True)
class Drag:
    """Its pointer is at a point of the plane through what it took hold of [m]."""

    client: Client
    point: Point


@dataclass(frozen=True)
class Release:
    """It let go, or is gone."""

    client: Client


@dataclass(frozen=True)
class SetPause:
    """Stop time, or let it go on."""

    paused: bool


@dataclass(frozen=True)
class StepPicture:
    """Stop, and go on by one picture."""


@dataclass(frozen=True)
class Reset:
    """Back to the start."""


@dataclass(frozen=True)
class SetSpeed:
    """Simulated time for a second of real time [1]."""

    speed: float


@dataclass(frozen=True)
class SetStiffness:
    """How many times as stiff as the scene says a body is [1]."""

    body: str
    factor: float


@dataclass(frozen=True)
class SetSolver:
    """Another integrator, or another largest step: "auto", or seconds as text."""

    integrator: str | None = None
    dt: str | None = None


@dataclass(frozen=True)
class SetShadows:
    """Have things throw shadows, or not."""

    shadows: bool


@dataclass(frozen=True)
class SendRecording:
    """Have a client download what was done so far."""

    client: Client


Command = (
    Grab
    | Drag
    | Release
    | SetPause
    | StepPicture
    | Reset
    | SetSpeed
    | SetStiffness
    | SetSolver
    | SetShadows
    | SendRecording
)


def of_drag(event: Any) -> list[Command]:
    """What a drag event of viser asks for: nothing where its numbers are none, as no honest browser sends them."""
    if event.phase == "end":
        return [Release(event.client_id)]
    try:
        start, end = _point(event.start_position), _point(event.end_position)
    except (TypeError, ValueError):
        return []
    drag = Drag(event.client_id, end)
    return [Grab(event.client_id, start), drag] if event.phase == "start" else [drag]


def _point(values: Any) -> Point:
    x, y, z = (float(value) for value in values)
    if not all(math.isfinite(value) and abs(value) < 1e9 for value in (x, y, z)):
        raise ValueError
    return x, y, z
