"""Two runs that are stored in every way: a solid, a sheet that tears and a rope; and a flat scene."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from sandbox import RunOptions, Scene, Simulation, run
from sandbox.exports import ExportFormat
from sandbox.output.trajectory import Trajectory
from tests.conftest import make_scene

SOLID, SHEET, ROPE = range(3)


def solid_scene(**more) -> Scene:
    """A box over a ramp that moves, a sheet under a load that it does not bear, a rope, a point."""
    return make_scene(
        dimension=3,
        duration=0.2,
        gravity=[0.0, -9.81, 0.0],
        solver={"dt": 1e-3},
        render={"fps": 20, "size": [160, 96], **more},
        bodies=[
            {
                "name": "the box",
                "position": [0.0, 0.5, 0.0],
                "rotation": [10.0, 20.0, 30.0],
                "velocity": [0.0, -2.0, 0.0],
                "color": "#ff8000",
                "shape": {"kind": "box", "size": [0.4, 0.4, 0.4], "cells": [2, 2, 2]},
                "material": {"stiffness": 2000.0, "damping": 1.0, "mass": 1.0},
            },
            {
                "name": "sheet",
                "position": [1.5, 1.0, 0.0],
                "shape": {"kind": "sheet", "size": [1.0, 1.0], "cells": [4, 4]},
                "velocity": [0.0, -8.0, 0.0],
                "pin": {"indices": [0, 4, 20, 24]},
                "material": {"stiffness": 400.0, "damping": 0.5, "mass": 1.0, "break_strain": 0.1},
            },
            {
                "name": "rope",
                "shape": {"kind": "rope", "from": [-1.0, 1.5, 0.0], "to": [-0.5, 1.5, 0.2], "segments": 5},
                "pin": {"indices": [0]},
                "material": {"stiffness": 5000.0, "damping": 1.0, "mass": 0.2},
            },
            {
                "name": "point",
                "shape": {"kind": "custom", "points": [[0.0, 2.0, 0.0]], "masses": [1.0]},
                "radius": 0.05,
            },
        ],
        colliders=[
            {"kind": "half_space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]},
            {"kind": "capsule", "from": [0.0, 0.1, -1.0], "to": [0.0, 0.1, 1.0], "radius": 0.1},
            {
                "kind": "box",
                "name": "ramp",
                "position": [2.0, 0.2, 2.0],
                "size": [0.2, 0.2, 0.2],
                "motion": [{"time": 0.0}, {"time": 0.2, "position": [2.5, 0.2, 2.0], "rotation": [0.0, 90.0, 0.0]}],
            },
        ],
    )


def flat_scene(**more) -> Scene:
    """A square, a ring, and a rope."""
    rope = {"kind": "rope", "from": [-1.0, 1.0], "to": [-0.5, 1.0], "segments": 2}
    square = {"kind": "box", "size": [0.5, 0.5], "cells": [2, 2]}
    ring = {"kind": "ring", "radius": 0.3, "segments": 8}
    material = {"stiffness": 1000.0, "damping": 1.0, "mass": 1.0}
    return make_scene(
        dimension=2,
        duration=0.15,
        gravity=[0.0, -9.81],
        solver={"dt": 1e-3, "precision": "f64"},
        render={"fps": 20, "size": [160, 96], **more},
        bodies=[
            {"name": "square", "position": [0.0, 0.3], "rotation": 10.0, "shape": square, "material": material},
            {"name": "ring", "position": [1.0, 0.5], "shape": ring, "material": material},
            {"name": "rope", "shape": rope, "material": material},
        ],
        colliders=[
            {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.1, 1.0]},
            {"kind": "sphere", "position": [1.0, -0.3], "radius": 0.4},
        ],
    )


@dataclass(frozen=True)
class Stored:
    """A run, and what the same simulation says of every frame."""

    folder: Path
    positions: list[np.ndarray]
    velocities: list[np.ndarray]
    torn: list[np.ndarray]

    def trajectory(self) -> Trajectory:
        return Trajectory.open(self.folder)

    def rows(self, body: int) -> slice:
        """Particles of a body in the scene's order."""
        with self.trajectory() as trajectory, Simulation(trajectory.scene) as simulation:
            owner = simulation.assembly.scene_order(simulation.assembly.particle_body.astype(float))
        mine = np.nonzero(owner == body)[0]
        return slice(int(mine[0]), int(mine[-1]) + 1)


def store(scene: Scene, folder: Path) -> Stored:
    """Run a scene with everything written down, and once more by hand."""
    formats = tuple(str(kind) for kind in ExportFormat)
    run(scene, RunOptions("scene", folder, renderer="none", trajectory="npz", exports=formats))
    positions, velocities, torn = [], [], []
    with Simulation(scene) as simulation:
        frames = round(scene.duration * scene.render.fps)
        for number in range(frames + 1):
            simulation.advance(number / scene.render.fps - simulation.time)
            positions.append(simulation.positions())
            velocities.append(simulation.velocities())
            torn.append(np.zeros(0) if simulation.torn is None else simulation.torn.to_numpy() != 0)
    return Stored(folder, positions, velocities, torn)


@pytest.fixture(scope="session")
def solid_run(tmp_path_factory) -> Stored:
    pytest.importorskip("pxr", reason="usd-core is not installed")
    return store(solid_scene(), tmp_path_factory.mktemp("solid"))


@pytest.fixture(scope="session")
def flat_run(tmp_path_factory) -> Stored:
    pytest.importorskip("pxr", reason="usd-core is not installed")
    return store(flat_scene(), tmp_path_factory.mktemp("flat"))
