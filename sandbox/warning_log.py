"""What a run could not do, in one list: printed at its end, kept in its summary, and in ``Simulation.warnings``."""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

WARNING = "warning: "
"""What a warning's line begins with where it is printed."""


class SceneWarning(UserWarning):
    """Something about a scene that is known before its first step, and will not be as its author expects."""


class StabilityWarning(SceneWarning):
    """A fixed step is longer than the scheme can take in this scene."""


class WarningKind(StrEnum):
    """All warnings that there are; docs/warnings.md says of each what it means and what helps."""

    STEP_ABOVE_LIMIT = "step above limit"
    """A fixed step is longer than the scheme is stable with."""
    UNCONVERGED = "unconverged"
    """An iterating scheme left more of its equations unsolved than it should."""
    REPLACED = "replaced"
    """The implicit midpoint rule took some steps as implicit Euler."""
    RESCUED = "rescued"
    """The run went back and on with shorter steps."""
    INVERTED = "inverted"
    """Cells of a body are inside out."""
    PENETRATED = "penetrated"
    """A particle got deep into a collider."""
    OVERLAPPING = "overlapping"
    """Particles in contact got deep into each other."""
    OVERLOADED = "overloaded"
    """A body is too heavy for what it may come to lie on, at the step as it is."""
    CANNOT_MEET = "cannot meet"
    """Bodies without a contact radius pass through each other."""
    STARTS_OVERLAPPING = "starts overlapping"
    """Two bodies overlap at the start."""
    STARTS_INSIDE = "starts inside"
    """A body starts inside of a collider, or so near that its contact radius reaches far into it."""
    RADIUS = "radius"
    """A contact radius is far above the distance of its body's particles."""
    IMPLICIT_BOUNCE = "implicit bounce"
    """Restitution under a scheme whose step decides how high bodies bounce, by damping or by gaining energy."""
    ACTION = "action"
    """An action found nothing to act on, or comes too late."""
    IDLE = "idle"
    """Something that the scene asks for does nothing."""
    MESH = "mesh"
    """A mesh file is of an odd size, or not well covered by its lattice."""


@dataclass(frozen=True)
class Remark:
    """A warning that has not been given yet."""

    kind: WarningKind
    line: str
    about: str = ""
    """What it is about, where there may be several of a kind."""


class WarningLog:
    """Warnings of one simulation, in the order in which they first arose."""

    def __init__(self) -> None:
        self._lines: dict[tuple[WarningKind, str], str] = {}
        self._first: dict[tuple[WarningKind, str], str] = {}

    def open(self, remarks: Iterable[Remark], stacklevel: int = 3) -> None:
        """Say what is known before the first step, as Python warnings of the caller's caller too."""
        for remark in remarks:
            self._first[remark.kind, remark.about] = remark.line
            category = StabilityWarning if remark.kind is WarningKind.STEP_ABOVE_LIMIT else SceneWarning
            warnings.warn(remark.line, category, stacklevel=stacklevel)
        self.begin_again()

    def begin_again(self) -> None:
        """Forget all but what was known before the first step."""
        self._lines = dict(self._first)

    def note(self, kind: WarningKind, line: str, about: str = "") -> None:
        """Say ``line``; it takes the place of what was said of that kind ``about`` the same thing."""
        self._lines[kind, about] = line

    def memory(self) -> list[tuple[str, str, str]]:
        """Kind, what it is about, and line of all, for :meth:`remember`."""
        return [(str(kind), about, line) for (kind, about), line in self._lines.items()]

    def remember(self, memory: Iterable[tuple[str, str, str]]) -> None:
        """Say what was said before, and nothing else. Raises ValueError where that is no memory."""
        self._lines = {(WarningKind(kind), about): line for kind, about, line in memory}

    @property
    def lines(self) -> list[str]:
        """One line a warning."""
        return list(self._lines.values())

    def kinds(self) -> set[WarningKind]:
        """Of which kinds there are warnings."""
        return {kind for kind, _ in self._lines}
