"""What is done to a live scene: calls of a session, one after the other, while it runs.

An input is a JSON list of messages ``[name, {argument: value}]``, as a front end would send them. The names are those
of ``ENTRANCES``; what a browser sends comes through a gate before, see ``pages``.
"""

import functools
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from sandbox.errors import DivergedError, SandboxError
from sandbox.scene.load import scene_from_data
from sandbox.session import Session
from tests.fuzz import odd, seeds
from tests.fuzz.inputs import Input, Kind, Wrong, check_message, start_taichi

_SOFT = {"stiffness": 500.0, "damping_ratio": 0.1, "mass": 2.0}
SCENE = {
    **{key: seeds.FLAT[key] for key in ("dimension", "gravity", "render")},
    "solver": {"dt": 1e-3, "precision": "f64"},
    "bodies": [
        {
            "name": "box", "position": [0.0, 2.0], "material": _SOFT,
            "shape": {"kind": "box", "size": [0.6, 0.4], "cells": [3, 2]},
        },
        {
            "name": "rope", "position": [-2.0, 3.0], "material": _SOFT, "pin": {"indices": [0]},
            "shape": {"kind": "rope", "from": [0.0, 0.0], "to": [1.0, 0.0], "segments": 5},
        },
    ],
    "colliders": seeds.FLAT["colliders"][:1],
    "interaction": {"grips": 2, "pushes": 1, "shakes": 1},
    "diagnostics": {"max_speed": 1e4},
}  # fmt: skip
"""As little as lets everything happen: what a scene has is compiled."""
_TICKS = 8
"""Time that goes on at the end, a few pictures."""


class _Table:
    """A live session and the hands on it."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.grips: list[Any] = []

    def grab(self, point: Any, direction: Any = None, radius: Any = None) -> None:
        grip = self.session.grab(point, direction, radius)
        if grip is not None:
            self.grips.append(grip)

    def drag(self, target: Any) -> None:
        for grip in self.grips[-1:]:
            self.session.drag(grip, target)

    def release(self) -> None:
        for grip in self.grips[-1:]:
            self.session.release(grip)


ENTRANCES: dict[str, Callable[[_Table, dict[str, Any]], object]] = {
    "act": lambda table, given: table.session.act(given),
    "grab": lambda table, given: table.grab(**given),
    "drag": lambda table, given: table.drag(**given),
    "release": lambda table, _: table.release(),
    "solver": lambda table, given: table.session.change_solver(**given),
    "material": lambda table, given: table.session.scale_material(**given),
    "advance": lambda table, given: table.session.advance(**given),
}


_place = st.tuples(*[st.sampled_from([-3.0, -0.3, 0.0, 0.2, 0.5, 2.0, 2.1, 3.0])] * 2).map(list)
_point = st.one_of(_place, _place, st.lists(st.sampled_from(odd.NUMBERS), min_size=1, max_size=4), odd.values)
_number = st.one_of(st.sampled_from([0.5, 1.0, 2.0, 100.0]), odd.values)
_body = st.sampled_from(["box", "box", "rope", "nobody", "", "\ud800", 3])
_actions = odd.changed([[action] for action in seeds.FLAT["actions"] if action["kind"] != "solver"], odd.values, most=2)


@st.composite
def _message(draw: Any) -> list[Any]:
    name = draw(st.sampled_from(["act"] * 6 + ["grab", "drag", "drag", "release", "advance", "material"]))
    given: Any = {}
    match name:
        case "act":
            action = draw(_actions)
            given = (
                action[0] if isinstance(action, list) and action and isinstance(action[0], dict) else {"kind": action}
            )
        case "grab":
            given = {"point": draw(_point)}
            if draw(st.booleans()):
                given[draw(st.sampled_from(["direction", "radius"]))] = draw(st.one_of(_point, _number))
        case "drag":
            given = {"target": draw(_point)}
        case "material":
            given = {"body": draw(_body), "stiffness": draw(_number)}
        case "advance":
            given = {"ticks": draw(st.integers(1, 3))}
    return [name, given]


_schemes = st.sampled_from([None, None, "symplectic_euler", "velocity_verlet", "nonsense", 3, "", [], "\ud800"])
_steps = st.one_of(st.sampled_from([None, "auto", 1e-3, 0.1, 1e-6]), odd.values)
_solver = st.tuples(_schemes, _steps).map(lambda both: ["solver", {"integrator": both[0], "dt": both[1]}])
"""Rare, and of few schemes: each compiles, for seconds."""


def _drawn() -> Any:
    some = st.lists(_message(), min_size=1, max_size=6)
    rare = st.tuples(some, _solver).map(lambda both: [*both[0], both[1]])
    several = st.integers(0, 49).flatmap(lambda chance: rare if chance < 2 else some)
    return several.map(lambda messages: Input(".json", json.dumps(messages, default=str).encode()))


@functools.cache
def _session() -> Session:
    return Session(scene_from_data(SCENE, None), threads=1)


def _take(path: Path) -> str:
    table = _Table(_session())
    table.session.reset()
    refused = 0
    for name, given in json.loads(path.read_bytes()):
        try:
            ENTRANCES[name](table, given)
        except DivergedError:
            break
        except SandboxError as error:
            check_message(error)
            refused += 1
    simulation = table.session.simulation
    try:
        table.session.advance(_TICKS)
    finally:
        if not (np.isfinite(simulation.positions()).all() and np.isfinite(simulation.velocities()).all()):
            raise Wrong("is a state that is not finite")
        if not math.isfinite(simulation.energy().total):
            raise Wrong("is an energy that is not finite")
    table.session.recording()
    return "refused in part" if refused else "accepted"


MESSAGES = Kind("messages", _drawn, _take, short=15, prepare=start_taichi)
