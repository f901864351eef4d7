"""Moments of actions, what they find, and what they change."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Solver

FloatArray = NDArray[np.float64]
Memory = dict[str, FloatArray]

CLOCK = 1.0 / 120.0
"""Time between the parts of what happens little by little [s]: cuts, and springs that become stiffer."""
_MOST_PARTS = 20_000
"""Parts of one action; where it takes longer than some minutes, they are longer."""
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


class Situation:
    """What an event finds; read from the device only where somebody asks.

    Parameters
    ----------
    simulation : the :class:`sandbox.Simulation` that something happens to
    """

    def __init__(self, simulation: Any) -> None:
        self._simulation = simulation
        self.assembly: Assembly = simulation.assembly
        self.parts: Parts = simulation.parts
        self.dt: float = simulation.dt
        """Longest step [s]."""
        self.solver: Solver = simulation.scene.solver

    @functools.cached_property
    def state(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions [m], velocities and those that forces see [m/s], each (N, d), in internal order."""
        x, v, seen = self._simulation.state.read()
        return x, v, seen

    @functools.cached_property
    def memory(self) -> Memory:
        """What parts remember."""
        return dict(self._simulation.memory)


@dataclass
class Change:
    """What an event changes beyond hands and loads; None: nothing."""

    assembly: Assembly | None = None
    state: tuple[FloatArray, FloatArray, FloatArray] | None = None
    memory: Memory = field(default_factory=dict)
    """What parts remember otherwise."""
    solver: Solver | None = None
    found_nothing: str = ""
    """A line that says so, of an action that found nothing to act on."""
    stiffer: bool = False
    """Whether the stability limit may be another one."""


def moments(start: float, end: float) -> Sequence[float]:
    """Times at which the parts of a gradual action begin, and its end [s]: two at least."""
    parts = min(max(1, math.ceil((end - start) / CLOCK - 1e-6)), _MOST_PARTS)
    return [start + (end - start) * part / parts for part in range(parts)] + [end]
