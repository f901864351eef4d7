"""Checkpoints: a scene and its state in one .npz file."""

import os
import tomllib
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.files import replace_when_whole
from sandbox.scene.load import scene_from_data, to_toml
from sandbox.scene.model import Scene

_FORMAT = 2
_MEMORY = "memory."


@dataclass(frozen=True)
class Checkpoint:
    """A scene at an instant. Numbers of f32 simulations are exact in f64."""

    scene: Scene
    time: float
    """Simulated time [s]."""
    positions: NDArray[np.float64]
    """[m], shape (particle_count, dimension), scene order."""
    velocities: NDArray[np.float64]
    """[m/s], shape (particle_count, dimension), scene order."""
    force_velocities: NDArray[np.float64]
    """Velocities that forces see [m/s]: ``velocities``, or the scheme's prediction of them."""
    arch: str
    precision: str
    steps: tuple[float, ...] = ()
    """The step taken now [s], and what its choice goes by; empty for what the scene says."""
    memory: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """What parts remember beyond that, by name: rest lengths, amounts of gas, torn springs."""


def write(path: str | os.PathLike[str], checkpoint: Checkpoint) -> None:
    """Write a checkpoint; the file appears under its name only once it is whole."""
    with replace_when_whole(Path(path)) as temporary, temporary.open("wb") as file:
        memory: dict[str, Any] = {_MEMORY + name: values for name, values in checkpoint.memory.items()}
        np.savez_compressed(
            file,
            format=_FORMAT,
            scene=np.array(to_toml(checkpoint.scene)),
            time=checkpoint.time,
            positions=checkpoint.positions,
            velocities=checkpoint.velocities,
            force_velocities=checkpoint.force_velocities,
            arch=np.array(checkpoint.arch),
            precision=np.array(checkpoint.precision),
            steps=np.array(checkpoint.steps, dtype=np.float64),
            **memory,
        )


def read(path: str | os.PathLike[str]) -> Checkpoint:
    """Read a checkpoint. Raises SceneError where the file is missing or is none."""
    try:
        with np.load(path, allow_pickle=False) as data:
            if int(data["format"]) != _FORMAT:
                raise SceneError(f"{path}: is a checkpoint of format {int(data['format'])}; this reads {_FORMAT}")
            return Checkpoint(
                scene=scene_from_data(tomllib.loads(str(data["scene"])), None, source=str(path)),
                time=float(data["time"]),
                positions=np.asarray(data["positions"], dtype=np.float64),
                velocities=np.asarray(data["velocities"], dtype=np.float64),
                force_velocities=np.asarray(data["force_velocities"], dtype=np.float64),
                arch=str(data["arch"]),
                precision=str(data["precision"]),
                steps=tuple(float(value) for value in data["steps"]) if "steps" in data.files else (),
                memory={
                    name.removeprefix(_MEMORY): np.asarray(data[name], dtype=np.float64)
                    for name in data.files
                    if name.startswith(_MEMORY)
                },
            )
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}") from None
    except SceneError:
        raise
    except (KeyError, ValueError, TypeError, EOFError, AttributeError, zipfile.BadZipFile):
        raise SceneError(f"{path}: is not a checkpoint") from None
