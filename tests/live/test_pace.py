"""Real time by whole ticks, with a clock that does what it is told."""

import pytest

from sandbox.live.pace import LONGEST_PAUSE, Pace

TICK = 1.0 / 120.0


class Clock:
    """A clock that only goes on when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def play(pace: Pace, clock: Clock, cost: float, pictures: int, other: float = 0.0) -> int:
    """Ticks taken over some pictures, where each costs so much wall time [s], and each picture ``other`` more."""
    taken = 0
    for _ in range(pictures):
        ticks = pace.due()
        clock.now += ticks * cost
        pace.took(ticks, ticks * cost)
        clock.now += other
        taken += ticks
        clock.now += pace.wait()
    return taken


@pytest.mark.parametrize(("speed", "pictures"), [(1.0, 30.0), (0.25, 30.0), (0.1, 30.0), (1.0, 60.0), (1.0, 7.0)])
def test_a_fast_machine_holds_the_speed_that_is_asked_for(speed, pictures):
    clock = Clock()
    pace = Pace(TICK, pictures, clock)
    pace.speed = speed
    taken = play(pace, clock, cost=0.01 * TICK, pictures=int(10 * pictures))
    assert taken * TICK == pytest.approx(10.0 * speed, abs=2 * TICK)
    assert pace.lost == 0.0


def test_a_slow_machine_falls_behind_and_says_so():
    """A tick takes twice its own time: half of real time is simulated, and pictures are as many as ever."""
    clock = Clock()
    pace = Pace(TICK, 30.0, clock)
    start, taken = clock.now, play(pace, clock, cost=2.0 * TICK, pictures=300)
    assert taken * TICK == pytest.approx(0.5 * (clock.now - start), rel=0.02)
    assert clock.now - start == pytest.approx(10.0, rel=0.01)
    assert pace.real_time_factor == pytest.approx(0.5, rel=0.05)
    assert pace.lost == pytest.approx(5.0, rel=0.05)


def test_a_tick_that_is_longer_than_a_picture_is_still_taken():
    clock = Clock()
    pace = Pace(TICK, 30.0, clock)
    assert play(pace, clock, cost=0.1, pictures=20) >= 19


def test_a_hiccup_is_made_up_for_but_a_long_sleep_is_not():
    clock = Clock()
    pace = Pace(TICK, 30.0, clock)
    play(pace, clock, cost=0.1 * TICK, pictures=30)
    clock.now += 1.0 / 30.0
    assert pace.due() == 8
    clock.now += 60.0
    assert pace.due() <= LONGEST_PAUSE / TICK + 1
    assert pace.lost == pytest.approx(60.0 - LONGEST_PAUSE, abs=0.1)


def test_who_asks_before_a_picture_is_due_need_not_wait_longer_afterwards():
    clock = Clock()
    pace = Pace(TICK, 30.0, clock)
    for _ in range(100):
        pace.due()
        clock.now += 1e-3
    assert pace.wait() <= pace.picture


def test_the_speed_that_is_told_is_the_true_one_where_some_pictures_take_long():
    """One picture in three stalls: what is simulated over all of the time counts, not the mean over pictures."""
    clock = Clock()
    pace = Pace(TICK, 30.0, clock)
    ticks, start = 0, clock.now
    for picture in range(60):
        ticks += play(pace, clock, cost=0.5 * TICK, pictures=1, other=0.4 if picture % 3 == 0 else 0.0)
    truth = ticks * TICK / (clock.now - start)
    assert truth < 0.9
    assert pace.real_time_factor == pytest.approx(truth, rel=0.2)


def test_no_time_goes_by_while_paused_and_none_is_made_up_for():
    clock = Clock()
    pace = Pace(TICK, 30.0, clock)
    play(pace, clock, cost=0.1 * TICK, pictures=30)
    pace.paused = True
    assert play(pace, clock, cost=0.1 * TICK, pictures=300) == 0
    pace.paused = False
    assert pace.due() == 4
