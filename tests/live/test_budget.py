"""What a picture costs, and the step that would hold real time."""

import math

import pytest

from sandbox.live.budget import Budget
from sandbox.live.pace import Pace

TICK = 1.0 / 120.0


def test_the_budget_names_the_step_that_would_fit():
    pace = Pace(TICK, 30.0)
    assert Budget.of(pace, 1e-3, 1.2e-3).line() == "not known yet"
    pace.took(4, 8 * TICK)
    budget = Budget.of(pace, 1e-3, 1.2e-3)
    assert budget.steps == 4 * math.ceil(TICK / 1e-3)
    assert not budget.is_enough
    assert budget.fitting_dt == pytest.approx(2e-3)
    assert "real time needs steps of 2 ms, stable are 1.2 ms" in budget.line()
    assert "stable" not in Budget.of(pace, 1e-3, math.inf).line()


def test_slow_motion_is_cheaper():
    pace = Pace(TICK, 30.0)
    pace.took(4, 8 * TICK)
    pace.speed = 0.25
    budget = Budget.of(pace, 1e-3, 1.2e-3)
    assert budget.is_enough and budget.steps == math.ceil(TICK / 1e-3)
    assert budget.line() == "9 steps of 1 ms take 16.7 ms of the 33.3 ms of a picture"
