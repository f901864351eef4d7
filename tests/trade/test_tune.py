"""How a search proposes steps, on lines whose errors and times are formulas."""

import math

import pytest

from sandbox.scene.model import IntegratorName, Precision
from sandbox.trade.ladder import Prospect, whole_steps
from sandbox.trade.tune import Line, _proposals

FRAME = 1.0 / 30.0


def line(integrator: IntegratorName, limit: float, step_seconds: float = 1e-4) -> Line:
    dt = 0.8 * limit if math.isfinite(limit) else 1.0 / 240.0
    return Line(Prospect(integrator, limit, dt, step_seconds), Precision.F32, None, FRAME)


def search(of: Line, made, error: float) -> int:
    """Try what the line proposes until it has nothing left; number of trials."""
    trials = 0
    while (dt := of.next(error)) is not None:
        of.tried[dt] = made(dt)
        trials += 1
        assert trials <= 7
    return trials


def test_a_longest_step_that_is_good_enough_is_all_that_is_tried():
    of = line(IntegratorName.SYMPLECTIC_EULER, 1e-3)
    assert search(of, lambda dt: 1e-3, 1e-2) == 1
    assert of.met(1e-2) == whole_steps(0.8e-3, FRAME)


@pytest.mark.parametrize(
    "integrator, order", [(IntegratorName.SYMPLECTIC_EULER, 1), (IntegratorName.VELOCITY_VERLET, 2)]
)
def test_the_order_leads_to_the_step_in_few_trials(integrator, order):
    of = line(integrator, 1e-3)
    exact = 1e-3 * (1e-3 / 0.5) ** (1.0 / order)  # 0.5 at 1e-3
    trials = search(of, lambda dt: 0.5 * (dt / 1e-3) ** order, 1e-3)
    assert exact / 1.25 <= of.met(1e-3) <= exact * (1.0 + 1e-9)
    assert trials <= 5


def test_a_slope_that_is_not_the_order_is_learnt():
    of = line(IntegratorName.RK4, 1e-3)
    assert search(of, lambda dt: 0.1 * (dt / 1e-3), 2e-3) <= 6
    assert 1e-5 < of.met(2e-3) <= 2e-5 * (1.0 + 1e-9)


def test_schemes_without_a_limit_go_to_longer_steps_too():
    of = line(IntegratorName.IMPLICIT_MIDPOINT, math.inf)
    search(of, lambda dt: 1e-9, 1e-2)
    assert of.met(1e-2) == FRAME


def test_a_step_that_diverges_is_halved():
    of = line(IntegratorName.RK4, 1e-3)
    first = of.next(1e-2)
    of.tried[first] = math.inf
    assert of.next(1e-2) == whole_steps(0.5 * first, FRAME)


def test_what_would_take_longer_than_the_best_is_not_tried():
    cheap, dear = line(IntegratorName.SYMPLECTIC_EULER, 1e-3), line(IntegratorName.RK4, 1e-3, step_seconds=1e-2)
    assert set(_proposals([cheap, dear], 1e-2)) == {0, 1}
    cheap.tried[cheap.first] = 1e-3
    assert _proposals([cheap, dear], 1e-2) == {}
