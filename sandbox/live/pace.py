"""How many ticks a live picture is worth: real time where that can be had, and else what there is time for.

Time that there was no time for is left out, in whole ticks: the simulation falls behind the clock, and says so. Steps
are never fewer or longer than the solver has them.
"""

import time as clock
from collections.abc import Callable

LONGEST_PAUSE = 0.25
"""Longest time between two pictures that is made up for [s]: who was elsewhere for longer goes on from there."""
_MEMORY = 0.9
"""How much of what was measured is kept from picture to picture [1]."""


class Pace:
    """Holds pictures to their time, and the simulation to the clock as far as it can follow."""

    def __init__(self, tick: float, pictures: float = 60.0, now: Callable[[], float] = clock.perf_counter) -> None:
        """``tick`` is simulated time [s]; ``pictures`` are wanted a second; ``now`` tells the wall time [s]."""
        self.tick = tick
        self.picture = 1.0 / pictures
        """Wall time of a picture [s]."""
        self.speed = 1.0
        """Simulated seconds a second of wall time that are asked for [1]: less than 1 is slow motion."""
        self.paused = False
        """Whether time stands still."""
        self.lost = 0.0
        """Simulated time that was left out since the start [s]: there was no time for it."""
        self.tick_cost = 0.0
        """Wall time of a tick, lately [s]; 0 while not known."""
        self._simulated = self._passed = 0.0
        self._now = now
        self._debt = 0.0
        self._looked: float | None = None
        self._next: float | None = None

    def due(self) -> int:
        """Ticks for the picture that begins now."""
        now = self._now()
        passed = self.picture if self._looked is None else now - self._looked
        since = min(passed, LONGEST_PAUSE)
        self._looked = now
        # Who asks before a picture is due, as one who is behind does, need not wait the longer afterwards.
        self._next = now + self.picture if self._next is None else max(self._next, now - self.picture) + self.picture
        self._next = min(self._next, now + self.picture)
        if self.paused:
            self._debt = 0.0
            return 0
        self._debt += self.speed * since
        wanted = int(self._debt / self.tick + 1e-6)
        taken = min(wanted, self._affordable)
        self.lost += (wanted - taken) * self.tick + self.speed * (passed - since)
        # What is less than a tick waits for the next picture.
        self._debt -= wanted * self.tick
        # Each apart: a mean of quotients would make little of the pictures that took long.
        self._simulated = _MEMORY * self._simulated + taken * self.tick
        self._passed = _MEMORY * self._passed + passed
        return taken

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds a second of wall time, lately [1]; 0 while not known."""
        return self._simulated / self._passed if self._passed > 0.0 else 0.0

    @property
    def _affordable(self) -> int:
        """Ticks that a picture has time for; at least one, or nothing would move."""
        if self.tick_cost <= 0.0:
            return max(1, round(self.speed * self.picture / self.tick))
        return max(1, int(self.picture / self.tick_cost))

    def took(self, ticks: int, seconds: float) -> None:
        """So many ticks took so long [s]."""
        if ticks > 0:
            self.tick_cost = _mean(self.tick_cost, seconds / ticks)

    def wait(self) -> float:
        """Time until the next picture is due [s]; 0 where it is late."""
        return 0.0 if self._next is None else max(0.0, self._next - self._now())

    def rest(self) -> None:
        """Forget the clock and what was measured: nobody looked, or the solver has become another one."""
        self._debt, self._looked, self._next = 0.0, None, None
        self.tick_cost = self._simulated = self._passed = 0.0


def _mean(before: float, now: float) -> float:
    """A running mean that begins with the first value."""
    return now if before == 0.0 else _MEMORY * before + (1.0 - _MEMORY) * now
