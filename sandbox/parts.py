"""The parts that act in a simulation, by how they act."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Parts:
    """What acts in a scene; what it does not have is not in the lists."""

    laws: list[Any] = field(default_factory=list)
    """Forces: ``force_on(i, slot)``; some also gather by slices, evolve, or prepare."""
    colliders: list[Any] = field(default_factory=list)
    """Solids: ``resolve(i, start, end, v, dt)``."""
    movers: list[Any] = field(default_factory=list)
    """Parts that only prepare: what moves colliders."""
    carriers: list[Any] = field(default_factory=list)
    """What moves particles by itself: ``carry(i, start, end, v, dt)``."""
    contact: list[Any] = field(default_factory=list)
    """Contact of particles with particles: one part or none."""
    tears: list[Any] = field(default_factory=list)
    """Marks of torn springs: one or none."""
    grips: list[Any] = field(default_factory=list)
    """Hands: one part or none; it is among the laws too."""
    loads: list[Any] = field(default_factory=list)
    """Pushes and shakes, likewise."""
    ledger: list[Any] = field(default_factory=list)
    """The energy ledger: one or none."""
