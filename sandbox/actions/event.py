"""Moments of actions, what they find, and what they change."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Solver

FloatArray = NDArray[np.float64]
Memory = dict[str, FloatArray]

CLOCK = 1.0 / 120.0
"""Time between the parts of what happens little by little [s]: cuts, and springs that become stiffer."""
ENDS, BEGINS = 0, 1
"""Of events at one time those that end something come first."""


@dataclass(frozen=True, order=True)
class Event:
    """A moment of an action. Of those at one time the ends come first, then the others in the scene's order."""

    time: float
    """[s]"""
    order: int
    action: int
    """Which one."""
    part: int = 0
    """How many of the same kind came before: waypoints, parts of a cut."""


@dataclass
class Situation:
    """What an event finds."""

    assembly: Assembly
    state: tuple[FloatArray, FloatArray, FloatArray]
    """Positions [m], velocities and those that forces see [m/s], each (N, d), in internal order."""
    parts: Parts
    dt: float
    """Longest step [s]."""
    memory: Memory
    """What parts remember."""
    solver: Solver


@dataclass
class Change:
    """What an event changes beyond hands and loads; None: nothing."""

    assembly: Assembly | None = None
    state: tuple[FloatArray, FloatArray, FloatArray] | None = None
    memory: Memory = field(default_factory=dict)
    """What parts remember otherwise."""
    solver: Solver | None = None
    stiffer: bool = False
    """Whether the stability limit may be another one."""


def moments(start: float, end: float) -> Sequence[float]:
    """Times at which the parts of a gradual action begin, and its end [s]: two at least."""
    parts = max(1, math.ceil((end - start) / CLOCK - 1e-6))
    return [start + (end - start) * part / parts for part in range(parts)] + [end]
