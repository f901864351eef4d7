"""Scenes of which every number is allowed, simulated for a few pictures: fine, an error with a name, or a warning."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from sandbox import Simulation
from sandbox.errors import DivergedError
from sandbox.scene.load import load_scene
from sandbox.scene.model import IntegratorName
from sandbox.step_size import EnergyWatch
from tests.fuzz import odd, seeds
from tests.fuzz.inputs import Input, Kind, Wrong, check_message, start_taichi
from tests.fuzz.scene_files import size_of

_MOST_PARTICLES = 2000
_MOST_STEPS = 2000
_PICTURES = 4
_ROUNDING = 1e-6
"""Part of a coordinate by which springs of f32 are off their lengths [1]."""
_GAS_CONSTANT = 8.314
"""[J/(mol K)]"""
_BLOWN_UP = 2.0
"""Energy of motion over all that there was to be had, from which on a run has blown up [1]."""
_powers = st.integers(-12, 24).map(lambda quarter: 10.0 ** (quarter / 4.0))
_shapes = st.sampled_from(
    [
        {"kind": "box", "size": [1.0, 1.0], "cells": [3, 3]},
        {"kind": "ring", "radius": 0.5, "segments": 8},
        {"kind": "rope", "from": [-0.5, 0.0], "to": [0.5, 0.0], "segments": 5},
    ]
)
_SEEDS = [
    {
        **{key: scene[key] for key in ("dimension", "gravity", "render")},
        "solver": {"dt": "auto", "precision": "f64"},
        "bodies": [body],
        "colliders": scene["colliders"][:1],
    }
    for scene, names in ((seeds.FLAT, ("box", "ring", "pair", "ball")), (seeds.SOLID, ("box", "sheet", "shell")))
    for body in scene["bodies"]
    if body["name"] in names
]


@st.composite
def _absurd(draw: Any) -> dict[str, Any]:
    """A scene whose every number is allowed, and most of which are absurd."""
    shape = draw(_shapes)
    body: dict[str, Any] = {
        "name": "box",
        "shape": shape,
        "position": [draw(st.sampled_from([-2.0, 0.0, 0.3])), draw(st.sampled_from([0.0, 0.4, 1.0, 3.0]))],
        "velocity": [draw(st.sampled_from([0.0, 1.0, -1e3, 1e3])), 0.0],
        "material": {"stiffness": draw(_powers), "mass": draw(_powers), "damping": draw(_powers)},
    }
    if shape["kind"] == "ring":
        body["pressure"] = {"gauge_pressure": draw(st.sampled_from([-1e5, 0.0, 1e3, 1e6, 1e9]))}
    return {
        "dimension": 2,
        "gravity": [0.0, draw(st.sampled_from([0.0, -9.81, -1e6]))],
        "drag": draw(st.sampled_from([0.0, 1e6])),
        "solver": {
            "integrator": str(draw(st.sampled_from([*["symplectic_euler"] * 6, *IntegratorName]))),
            "dt": draw(st.sampled_from(["auto", "auto", 1e-3, 0.1])),
            "precision": draw(st.sampled_from(["f32", "f64"])),
        },
        "render": {"fps": 100.0},
        "bodies": [body],
        "colliders": [{"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "restitution": 1.0}],
        "actions": draw(st.lists(st.sampled_from(seeds.FLAT["actions"]), max_size=1)),
    }


def _drawn() -> Any:
    return (
        st.one_of(_absurd(), odd.changed(_SEEDS, most=3, ways=odd.GENTLE_WAYS))
        .map(odd.toml)
        .map(lambda data: Input(".toml", data))
    )


def _take(path: Path) -> str:
    scene = load_scene(path)
    if size_of(scene) > _MOST_PARTICLES:
        return "left out"
    simulation = Simulation(scene, threads=1)
    try:
        return _run(simulation)
    finally:
        simulation.suspend()


def _run(simulation: Simulation) -> str:
    most, stopped = _energy_at_hand(simulation), False
    for _ in range(_PICTURES):
        try:
            simulation.advance(min(1.0 / simulation.scene.render.fps, _MOST_STEPS * simulation.dt))
        except DivergedError as error:
            check_message(error)
            stopped = True
            break
    if not (np.isfinite(simulation.positions()).all() and np.isfinite(simulation.velocities()).all()):
        raise Wrong("ran to a state that is not finite")
    if not math.isfinite(simulation.energy().total):
        raise Wrong("ran to an energy that is not finite")
    if stopped:
        return "stopped"
    if simulation.energy().kinetic > _BLOWN_UP * (most + _of_free_fall(simulation)) and not simulation.warnings:
        raise Wrong("blew up, and nothing was said")
    return "warned" if simulation.warnings else "fine"


def _of_free_fall(simulation: Simulation) -> float:
    """Energy of what has fallen freely until now [J]."""
    speed = float(np.linalg.norm(simulation.scene.gravity or 0.0)) * simulation.time
    return 0.5 * float(simulation.assembly.masses.sum()) * speed**2


def _energy_at_hand(simulation: Simulation) -> float:
    """More than can come to be motion in a few pictures [J]; infinity where something is driven."""
    watch = EnergyWatch.of(simulation.assembly)
    if watch is None:
        return math.inf
    start = simulation.energy()
    fall = abs(start.gravity) + watch.scale
    assembly = simulation.assembly
    gas = sum(one.ambient * one.rest_volume + _GAS_CONSTANT * one.amount * one.temperature for one in assembly.gases)
    rounding = (_ROUNDING * float(np.abs(assembly.positions).max())) ** 2 * float(assembly.spring_set.stiffness.sum())
    return fall + start.kinetic + start.elastic + gas + rounding


RUNS = Kind("runs", _drawn, _take, short=4, prepare=start_taichi)
