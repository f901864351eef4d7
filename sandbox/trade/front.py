"""Which settings no other one beats, as far as their timings tell.

Every row is timed several times. Two rows are in order where all times of the one are below all of the other; where
they overlap, the next timing may turn them round, and nothing is said of which is faster.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar


class Timed(Protocol):
    """What has been timed."""

    @property
    def seconds(self) -> tuple[float, float, float]:
        """Least, median and most wall time of a simulated second [s]; nan where there is none."""
        ...


@dataclass(frozen=True)
class Standing:
    """Where a row stands among others."""

    pareto: bool = False
    """Whether no other setting is at least as accurate and clearly faster."""
    certain: bool = True
    """False on the front where another setting is more accurate and may be as fast: better timings may take it off."""
    ties: int = 0
    """Number of other settings whose times overlap with its own."""

    @property
    def word(self) -> str:
        """For a table."""
        return "" if not self.pareto else "Pareto" if self.certain else "Pareto?"


class Judged(Timed, Protocol):
    """What is timed, and has an error."""

    error: Any
    standing: Any


_Row = TypeVar("_Row", bound=Any)


def is_faster(one: Timed, other: Timed) -> bool:
    """Whether all times of one row are below all of another."""
    return one.seconds[2] < other.seconds[0]


def is_tied(one: Timed, other: Timed) -> bool:
    """Whether two rows were timed, and their times do not tell which is faster."""
    timed = math.isfinite(one.seconds[1] + other.seconds[1])
    return timed and not is_faster(one, other) and not is_faster(other, one)


def with_standing(rows: Sequence[_Row]) -> list[_Row]:
    """The rows, each with where it stands among the others."""

    def standing(row: Any) -> Standing:
        if not math.isfinite(row.seconds[1]):
            return Standing()
        tied = [other for other in rows if other is not row and is_tied(row, other)]
        beaten = any(other.error <= row.error and is_faster(other, row) for other in rows)
        if beaten or not math.isfinite(row.error):
            return Standing(ties=len(tied))
        return Standing(True, not any(other.error < row.error for other in tied), len(tied))

    return [replace(row, standing=standing(row)) for row in rows]


def by_time(rows: Sequence[_Row]) -> list[tuple[_Row, bool]]:
    """Rows from the fastest to the slowest, each with whether its time is clearly above that of the one before.

    What has no error comes last, and is in no order.
    """
    ordered = sorted(rows, key=lambda row: (math.isnan(row.error), row.seconds[1] if row.seconds[1] > 0.0 else 0.0))
    pairs = zip([None, *ordered], ordered, strict=False)
    return [(row, before is None or not is_tied(before, row)) for before, row in pairs]
