"""Good inputs that absurd ones are made of: presets with few particles, and two scenes that have everything."""

import copy
import functools
import tomllib
from typing import Any

from sandbox.errors import SceneError
from sandbox.scene.assemble import assemble
from sandbox.scene.load import preset_paths, scene_from_data
from tests.scene.test_mesh_variants import obj

MESH_FILE = "block.obj"
"""A mesh file that lies beside every scene."""
MOST_PARTICLES = 1200
"""Of a seed; assembling larger ones takes longer than it tells."""


def mesh() -> bytes:
    """What that mesh file has in it."""
    return obj().encode()


@functools.cache
def scenes() -> tuple[dict[str, Any], ...]:
    """Data of scenes that can be built; not to be changed."""
    presets = (_coarse(tomllib.loads(path.read_text(encoding="utf-8"))) for path in preset_paths().values())
    return (*(found for found in presets if found is not None), FLAT, SOLID)


def _coarse(data: dict[str, Any]) -> dict[str, Any] | None:
    """A preset with as few cells as its shapes can do with; None where these are still many."""
    for factor in (8, 4, 3, 2, 1):
        coarser = copy.deepcopy(data)
        for body in coarser["bodies"]:
            _divide(body["shape"], factor)
        try:
            count = assemble(scene_from_data(coarser, None)).particle_count
        except SceneError:
            continue
        return coarser if count <= MOST_PARTICLES else None
    return None


def _divide(shape: dict[str, Any], factor: int) -> None:
    for key, least in (("cells", 1), ("segments", 3), ("levels", 1)):
        match shape.get(key):
            case list() as counts:
                shape[key] = [max(least, count // factor) for count in counts]
            case int() as count:
                shape[key] = max(least + (shape["kind"] == "ball"), count // factor)
    if "subdivisions" in shape:
        shape["subdivisions"] = max(0, shape["subdivisions"] - factor // 2)


_SOFT = {"stiffness": 500.0, "damping_ratio": 0.1, "mass": 2.0}
FLAT: dict[str, Any] = {
    "title": "Everything in 2D",
    "dimension": 2,
    "duration": 1.0,
    "gravity": [0.0, -9.81],
    "drag": 0.1,
    "solver": {"integrator": "symplectic_euler", "dt": 1e-3, "precision": "f64", "safety": 0.8},
    "diagnostics": {"ledger": True, "max_strain": 10.0, "max_speed": 1e5},
    "render": {"fps": 100.0, "size": [64, 64], "color": "strain", "camera": {"target": [0.0, 1.0], "height": 6.0}},
    "contact": {"skin": 0.3},
    "wind": {
        "velocity": [1.0, 0.0], "gust": {"strength": 1.0, "period": 1.0, "length": 2.0, "seed": 3},
        "vortices": [{"center": [0.0, 1.0], "speed": 2.0, "radius": 0.5}], "rise": 0.1, "end": 4.0,
    },
    "bodies": [
        {
            "name": "box", "position": [0.0, 2.0], "rotation": 20.0, "velocity": [0.1, 0.0], "angular_velocity": 1.0,
            "radius": "auto", "shape": {"kind": "box", "size": [0.6, 0.4], "cells": [3, 2], "bend": 0.1},
            "material": {
                "youngs_modulus": 1e4, "damping_ratio": 0.1, "density": 100.0, "friction": 0.3, "restitution": 0.2,
                "yield_strain": 0.1, "creep": 1.0, "max_plastic_strain": 0.5, "break_strain": 0.9,
            },
        },
        {
            "name": "ring", "position": [2.0, 2.0], "radius": 0.02, "self_contact": True,
            "shape": {"kind": "ring", "radius": 0.3, "segments": 10, "bend": 0.2}, "material": _SOFT,
            "pressure": {"gauge_pressure": 500.0, "ambient": 1e4, "temperature": 300.0, "leak": 0.1},
        },
        {
            "name": "rope", "position": [-2.0, 3.0], "wind": True, "color": "tomato",
            "shape": {"kind": "rope", "from": [0.0, 0.0], "to": [1.0, 0.0], "segments": 5, "thickness": 0.02},
            "material": {**_SOFT, "tension_only": True}, "pin": {"indices": [0]},
        },
        {
            "name": "ball", "position": [0.0, 4.0], "material": _SOFT,
            "shape": {"kind": "ball", "radius": 0.3, "cells": 4},
        },
        {
            "name": "plate", "position": [3.5, 2.0], "material": _SOFT,
            "shape": {
                "kind": "polygon", "points": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], "spacing": 0.3,
                "holes": [[[0.4, 0.4], [0.6, 0.4], [0.6, 0.6]]],
            },
        },
        {
            "name": "mast", "position": [-4.0, 0.0], "material": _SOFT,
            "shape": {"kind": "tower", "levels": 2, "height": 1.0, "width": 0.4, "top_width": 0.3},
            "pin": {"region": {"min": [-5.0, -0.1], "max": [-3.0, 0.1]}},
        },
        {
            "name": "pair", "position": [-3.0, 2.0], "material": {"stiffness": 100.0, "damping": 0.1},
            "shape": {
                "kind": "custom", "points": [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]], "springs": [[0, 1], [1, 2]],
                "rest_lengths": [0.5, 0.7], "masses": [1.0, 1.0, 2.0], "pinned": [0], "triangles": [[0, 1, 2]],
                "velocities": [[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]],
            },
        },
    ],
    "colliders": [
        {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "restitution": 0.5, "friction": 0.3},
        {"kind": "sphere", "name": "knob", "position": [0.0, 0.5], "radius": 0.2, "color": "#abc"},
        {
            "kind": "box", "name": "lift", "position": [5.0, 0.2], "size": [0.5, 0.2], "rotation": 10.0,
            "motion": [{"time": 0.1, "position": [5.0, 0.2]}, {"time": 0.5, "position": [5.0, 0.6], "rotation": 30.0}],
            "interpolation": "linear",
        },
        {"kind": "capsule", "from": [-1.0, 0.2], "to": [1.0, 0.2], "radius": 0.1, "position": [-6.0, 0.0]},
        {"kind": "polygon", "points": [[7.0, 0.0], [8.0, 0.0], [7.5, 1.0]]},
    ],
    "attachments": [
        {"body": "ball", "indices": [0], "to": "knob"},
        {
            "body": "rope", "region": {"min": [-1.1, 2.9], "max": [-0.9, 3.1]}, "to": "box", "stiffness": 50.0,
            "damping": 0.1, "break_strain": 2.0,
        },
    ],
    "actions": [
        {
            "kind": "grab", "start": 0.1, "end": 0.5, "point": [0.0, 2.0], "radius": 0.3, "body": "box",
            "path": [{"time": 0.3, "position": [0.2, 2.2]}], "stiffness": 100.0, "max_force": 50.0,
        },
        {"kind": "poke", "time": 0.1, "point": [2.0, 2.0], "radius": 0.4, "impulse": [0.1, 0.0]},
        {
            "kind": "push", "start": 0.0, "end": 0.2, "body": "box", "force": [1.0, 0.0],
            "region": {"min": [-1.0, 1.0], "max": [1.0, 3.0]},
        },
        {"kind": "shake", "start": 0.0, "end": 0.3, "amplitude": [0.01, 0.0], "frequency": 5.0},
        {"kind": "wind", "start": 0.2, "end": 0.6, "velocity": [3.0, 0.0], "rise": 0.1},
        {"kind": "cut", "time": 0.3, "point": [3.5, 2.0], "normal": [1.0, 0.2], "body": "plate"},
        {"kind": "cut", "start": 0.1, "end": 0.4, "from": [3.0, 2.0], "to": [4.0, 2.0]},
        {"kind": "pump", "body": "ring", "start": 0.1, "end": 0.2, "amount": 0.01},
        {"kind": "pin", "time": 0.2, "body": "box", "indices": [0]},
        {"kind": "unpin", "time": 0.3, "body": "rope"},
        {"kind": "spawn", "time": 0.2, "body": "plate"},
        {"kind": "move", "collider": "knob", "path": [{"time": 0.5, "position": [0.1, 0.5]}]},
        {"kind": "move", "body": "mast", "path": [{"time": 0.5, "position": [-4.0, 0.1]}], "interpolation": "smooth"},
        {"kind": "stiffen", "time": 0.2, "body": "ball", "factor": 2.0},
        {"kind": "soften", "start": 0.1, "end": 0.2, "body": "ring", "factor": 0.5},
        {"kind": "solver", "time": 0.4, "integrator": "velocity_verlet", "dt": 1e-3},
    ],
    "interaction": {"grips": 2, "pushes": 1, "shakes": 1},
}  # fmt: skip
SOLID: dict[str, Any] = {
    "title": "Everything in 3D",
    "dimension": 3,
    "duration": 1.0,
    "gravity": [0.0, -9.81, 0.0],
    "solver": {
        "integrator": "implicit_euler", "dt": "auto", "iterations": 5, "linear_iterations": 50, "tolerance": 1e-3,
        "accuracy": 0.2, "horizon": 1.0, "adapt": "rescue", "most_halvings": 4, "chebyshev": 0.5,
    },
    "render": {
        "fps": 100.0, "poster": 0.5, "particles": True, "struts": True, "color_max": 1.0,
        "camera": {"eye": [3.0, 2.0, 4.0], "target": [0.0, 1.0, 0.0], "field_of_view": 40.0},
    },
    "wind": {"velocity": [1.0, 0.0, 0.0], "vortices": [
        {"center": [0.0, 0.0, 0.0], "axis": [0.0, 1.0, 0.0], "speed": -1.0, "radius": 1.0}], "density": 1.2,
        "drag_coefficient": 1.0, "skin_coefficient": 0.1, "start": 0.1},
    "bodies": [
        {
            "name": "box", "position": [0.0, 2.0, 0.0], "rotation": [10.0, 20.0, 30.0], "velocity": [0.0, 0.1, 0.0],
            "angular_velocity": [0.0, 1.0, 0.0], "radius": "auto",
            "shape": {"kind": "box", "size": [0.4, 0.4, 0.2], "cells": [2, 2, 1], "bracing": "body"},
            "material": {"youngs_modulus": 1e4, "damping": 1.0, "density": 200.0},
        },
        {
            "name": "shell", "position": [2.0, 2.0, 0.0], "material": _SOFT,
            "shape": {"kind": "shell", "radius": 0.3, "subdivisions": 1, "thickness": 1e-3, "bend": 0.1},
            "pressure": {"amount": 5.0, "temperature": 300.0},
        },
        {
            "name": "sheet", "position": [-2.0, 2.0, 0.0], "material": {"youngs_modulus": 1e5, "density": 300.0},
            "shape": {"kind": "sheet", "size": [1.0, 0.5], "cells": [4, 2], "thickness": 1e-3, "bend": 0.05},
        },
        {
            "name": "block", "position": [0.0, 4.0, 0.0], "material": _SOFT,
            "shape": {"kind": "mesh", "file": MESH_FILE, "size": 0.5, "cells": 4, "fill": "lattice"},
        },
        {
            "name": "skin", "position": [0.0, 6.0, 0.0], "material": _SOFT,
            "shape": {"kind": "mesh", "file": MESH_FILE, "scale": 2.0, "fill": "shell", "center": False},
        },
        {"name": "ball", "position": [4.0, 2.0, 0.0], "material": _SOFT,
         "shape": {"kind": "ball", "radius": 0.3, "cells": 3}},
        {"name": "mast", "position": [6.0, 0.0, 0.0], "material": _SOFT,
         "shape": {"kind": "tower", "levels": 2, "bays": 1, "height": 1.0, "width": 0.4}},
    ],
    "colliders": [
        {"kind": "half_space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]},
        {"kind": "mesh", "name": "rock", "file": MESH_FILE, "size": 1.0, "position": [9.0, 0.5, 0.0], "resolution": 8},
        {
            "kind": "capsule", "from": [-1.0, 0.0, 0.0], "to": [1.0, 0.0, 0.0], "radius": 0.1,
            "rotation": [0.0, 9.0, 0.0],
        },
        {
            "kind": "box", "name": "lift", "position": [0.0, 1.0, 5.0], "size": [1.0, 0.1, 1.0],
            "motion": [{"time": 0.0}, {"time": 0.5, "position": [0.0, 1.2, 5.0], "rotation": [0.0, 45.0, 0.0]}],
        },
    ],
    "attachments": [{"body": "sheet", "indices": [0, 1], "to": "lift"}],
    "actions": [
        {"kind": "cut", "start": 0.1, "end": 0.3, "from": [0.0, 1.0, -1.0], "to": [0.0, 3.0, -1.0],
         "sweep": [0.0, 0.0, 2.0]},
        {"kind": "grab", "start": 0.1, "end": 0.5, "point": [0.0, 2.0, 5.0], "direction": [0.0, 0.0, -1.0]},
        {"kind": "push", "start": 0.1, "end": 0.2, "body": "ball", "force": [0.0, 5.0, 0.0]},
    ],
}  # fmt: skip
