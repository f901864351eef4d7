"""Draws inputs of a kind, has them judged, counts, and keeps what failed."""

import hashlib
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.court import Court, Verdict
from tests.fuzz.inputs import Input, Kind

FOLDER = Path("outputs/fuzz")
"""Where inputs that failed are kept."""
_ROUND = 500
"""Inputs after which hypothesis begins anew: what it remembers of them grows."""
_MOST_KEPT = 3
"""Inputs kept of those that fail alike."""


@dataclass
class Tally:
    """What became of the inputs of a kind."""

    kind: Kind
    seed: int
    outcomes: Counter[str] = field(default_factory=Counter)
    places: Counter[str] = field(default_factory=Counter)
    """Failures, by name and where in the code."""
    slowest: float = 0.0
    """[s]"""
    slow: Input | None = None
    """That one."""
    largest: float = 0.0
    """[MB]"""

    @property
    def count(self) -> int:
        return sum(self.outcomes.values())

    def add(self, tried: Input, verdict: Verdict) -> Path | None:
        """Count an input; where it failed, and few did alike, the file that it is kept in."""
        self.outcomes[verdict.outcome] += 1
        if verdict.seconds > self.slowest:
            self.slowest, self.slow = verdict.seconds, tried
        self.largest = max(self.largest, verdict.megabytes)
        if not verdict.failed:
            return None
        self.places[verdict.place] += 1
        return keep(self.kind, tried, verdict) if self.places[verdict.place] <= _MOST_KEPT else None

    def line(self) -> str:
        """All of it in a line."""
        outcomes = ", ".join(f"{count} {name}" for name, count in sorted(self.outcomes.items()))
        return (
            f"{self.kind.name}: {self.count} inputs (seed {self.seed}): {outcomes}; "
            f"at most {self.slowest:.2f} s and {self.largest:.0f} MB"
        )


def keep(kind: Kind, tried: Input, verdict: Verdict) -> Path:
    """Write an input and what is wrong with it; the file of the input."""
    folder = FOLDER / kind.name
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{hashlib.sha256(tried.data).hexdigest()[:12]}{tried.suffix}"
    path.write_bytes(tried.data)
    path.with_name(f"{path.name}.txt").write_text(f"{verdict.place}\n\n{verdict.message}\n", errors="replace")
    return path


def explore(
    kind: Kind, court: Court, count: int, first_seed: int, seconds: float, tell: Callable[[str], object]
) -> Tally:
    """Have so many inputs judged, or as many as there is time for [s], and go on past failures."""
    tally, begin, rounds = Tally(kind, first_seed), time.perf_counter(), 0

    def judge(tried: Input) -> None:
        if time.perf_counter() - begin >= seconds:
            return  # what is left of the round is only drawn
        verdict = court.judge(kind, tried)
        kept = tally.add(tried, verdict)
        if kept is not None:
            tell(f"{kind.name}: {verdict.place}: {kept}")

    while tally.count < count and time.perf_counter() - begin < seconds:
        draw_all(kind, judge, min(_ROUND, count - tally.count), first_seed + rounds)
        rounds += 1
    return tally


def draw_all(kind: Kind, judge: Callable[[Input], None], count: int, first_seed: int, shrinks: bool = False) -> None:
    """Call a function with so many inputs of a seed; with the smallest one for which it raises where it shrinks."""

    @seed(first_seed)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=(Phase.generate, Phase.shrink) if shrinks else (Phase.generate,),
        suppress_health_check=list(HealthCheck),
        report_multiple_bugs=False,
    )
    @given(kind.drawn())
    def each(tried: Input) -> None:
        judge(tried)

    each()
