"""Which settings are tried: what theory says of each scheme, and what the user asks for."""

import math

import pytest

from sandbox.scene.model import IntegratorName, Precision
from sandbox.trade.ladder import DEAREST, ITERATIONS, Choice, Prospects, ladder, whole_steps
from tests.conftest import make_scene, oscillator


@pytest.fixture(scope="module")
def prospects() -> Prospects:
    body = {"name": "box", "shape": {"kind": "box", "size": [1.0, 1.0], "cells": [4, 4]}}
    return Prospects(make_scene(dimension=2, bodies=[{**body, "material": {"youngs_modulus": 1e5, "density": 100.0}}]))


def test_prospects_of_an_oscillator():
    found = Prospects(oscillator("symplectic_euler", "auto"))
    omega = math.sqrt(1000.0)
    assert found.of(IntegratorName.VELOCITY_VERLET).limit == pytest.approx(2.0 / omega, rel=1e-9)
    assert found.of(IntegratorName.RK4).limit == pytest.approx(2.0 * math.sqrt(2.0) / omega, rel=0.02)
    assert found.of(IntegratorName.IMPLICIT_EULER).limit == math.inf
    assert found.of(IntegratorName.RK4).order == 4


def test_steps_divide_pictures_evenly():
    assert whole_steps(0.01, 1 / 30) == pytest.approx(1 / 120)
    assert whole_steps(1 / 30, 1 / 30) == 1 / 30
    assert whole_steps(1 / 60, 1 / 30) == 1 / 60
    assert whole_steps(1.0, 1 / 30) == 1 / 30


def test_by_default_every_scheme_has_its_longest_stable_step_and_none_is_dear(prospects):
    rungs = ladder(prospects, Choice())
    own = prospects.of(IntegratorName.SYMPLECTIC_EULER)
    for integrator in IntegratorName:
        prospect = prospects.of(integrator)
        own_rungs = [rung for rung in rungs if rung.integrator is integrator]
        longest = max(rung.dt for rung in own_rungs)
        assert all(max(r.dt for r in own_rungs if r.iterations == rung.iterations) == longest for rung in own_rungs)
        if integrator is IntegratorName.EXPLICIT_EULER:
            # Without damping its stable steps are tiny: one row shows that it diverges at the scene's own.
            assert [rung.dt for rung in own_rungs] == [whole_steps(own.dt, 1 / 30)]
            continue
        if math.isfinite(prospect.limit):
            assert longest <= prospect.limit
        for rung in own_rungs:
            dear = prospect.seconds(rung.dt, rung.iterations) / own.seconds(own.dt, None)
            assert rung.dt == longest or dear <= DEAREST * 1.2  # steps are rounded to whole ones afterwards
        assert {rung.iterations for rung in own_rungs} == (set(ITERATIONS) if prospect.iterates else {None})
    doubles = {rung.integrator for rung in rungs if rung.precision is Precision.F64}
    assert doubles == {IntegratorName.RK4}


def test_what_is_asked_for_is_tried_whatever_it_costs(prospects):
    choice = Choice(
        schemes=(IntegratorName.RK4, IntegratorName.VBD),
        dts=(1e-2, 1e-6, 1.0 / 100.0),
        iterations=(3, 5),
        precisions=(Precision.F32, Precision.F64),
    )
    rungs = ladder(prospects, choice)
    steps = {whole_steps(1e-2, 1 / 30), whole_steps(1e-6, 1 / 30)}
    assert len(rungs) == len(set(rungs)) == 2 * 2 + 2 * 2 * 2
    assert {rung.dt for rung in rungs} == steps
    assert {rung.iterations for rung in rungs} == {None, 3, 5}
