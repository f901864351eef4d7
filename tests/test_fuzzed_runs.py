"""Scenes of anything that is allowed are simulated, or refused, or stop with one line: never a NaN."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sandbox import Simulation
from sandbox.errors import SandboxError
from sandbox.scene.load import scene_from_data
from tests.actions.test_recording import actions

_powers = st.floats(-3.0, 6.0).map(lambda power: 10.0**power)
_shapes = st.sampled_from(
    [
        {"kind": "box", "size": [1.0, 1.0], "cells": [3, 3]},
        {"kind": "ring", "radius": 0.5, "segments": 8},
        {"kind": "rope", "from": [-0.5, 0.0], "to": [0.5, 0.0], "segments": 5},
    ]
)


@st.composite
def _scenes(draw):
    """A scene whose every number is allowed, and most of which are absurd."""
    shape = draw(_shapes)
    body = {
        "name": "box",
        "shape": shape,
        "position": [draw(st.floats(-2.0, 2.0)), draw(st.floats(0.0, 3.0))],
        "velocity": [draw(st.floats(-1e3, 1e3)), 0.0],
        "material": {"stiffness": draw(_powers), "mass": draw(_powers), "damping": draw(_powers)},
    }
    if shape["kind"] == "ring":
        body["pressure"] = {"gauge_pressure": draw(st.floats(-1e5, 1e9))}
    return {
        "dimension": 2,
        "gravity": [0.0, draw(st.sampled_from([0.0, -9.81, -1e6]))],
        "drag": draw(st.sampled_from([0.0, 1e6])),
        "solver": {
            "integrator": draw(st.sampled_from(["symplectic_euler", "implicit_euler"])),
            "dt": draw(st.sampled_from(["auto", 1e-3, 0.1])),
            "precision": draw(st.sampled_from(["f32", "f64"])),
        },
        "render": {"fps": 100.0},
        "bodies": [body],
        "colliders": [{"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "restitution": 1.0}],
        "actions": draw(st.lists(actions(), max_size=2)),
        "interaction": {},
    }


@pytest.mark.slow
@settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(_scenes())
def test_any_scene_runs_or_stops_with_one_line(data):
    simulation = None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            simulation = Simulation(scene_from_data(data, None))
            simulation.advance(0.05)
        except SandboxError as error:
            assert "\n" not in str(error)
    if simulation is not None:
        assert np.isfinite(simulation.positions()).all()
        assert np.isfinite(simulation.velocities()).all()
        assert math.isfinite(simulation.energy().total)
        simulation.suspend()
