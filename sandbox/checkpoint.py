"""Checkpoints: a scene and its state in one .npz file."""

import math
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
from sandbox.scene.model.base import LARGEST

_FORMAT, _STEPS = 2, 4
_MEMORY, _RUN = "memory.", "run."
_MOST_UNPACKED, _MOST_RATIO = 1 << 26, 200
"""Bytes that a file may always unpack to, and to how many times its size it may beyond: a state is no repetition."""


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
    run: dict[str, NDArray[Any]] = field(default_factory=dict)
    """Of a run that is not done: what it has gathered, by name, see :mod:`sandbox.unfinished`."""


def write(path: str | os.PathLike[str], checkpoint: Checkpoint, in_passing: bool = False) -> None:
    """Write a checkpoint; the file appears under its name only once it is whole.

    ``in_passing`` takes little time: it does not compress, nor wait for the disk.
    """
    with replace_when_whole(Path(path), syncs=not in_passing) as temporary, temporary.open("wb") as file:
        memory: dict[str, Any] = {_MEMORY + name: values for name, values in checkpoint.memory.items()}
        run: dict[str, Any] = {_RUN + name: values for name, values in checkpoint.run.items()}
        save = np.savez if in_passing else np.savez_compressed
        save(
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
            **run,
        )


def read(path: str | os.PathLike[str]) -> Checkpoint:
    """Read a checkpoint. Raises SceneError where the file is missing or is none."""
    try:
        _check_size(path)
        with np.load(path, allow_pickle=False) as data:
            if int(data["format"]) != _FORMAT:
                raise SceneError(f"{path}: is a checkpoint of format {int(data['format'])}; this reads {_FORMAT}")
            found = Checkpoint(
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
                run={name.removeprefix(_RUN): data[name] for name in data.files if name.startswith(_RUN)},
            )
        _check_values(found)
        return found
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}") from None
    except SceneError:
        raise
    except Exception:  # readers of broken files raise whatever broke
        raise SceneError(f"{path}: is not a checkpoint, or is damaged") from None


def _check_size(path: str | os.PathLike[str]) -> None:
    """Raise ValueError where the file would unpack to far more than a state takes."""
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(part.file_size for part in archive.infolist())
    if unpacked > max(_MOST_UNPACKED, _MOST_RATIO * os.path.getsize(path)):
        raise ValueError(unpacked)


def _check_values(found: Checkpoint) -> None:
    """Raise ValueError where a state is none that a run can have left."""
    states = (found.positions, found.velocities, found.force_velocities)
    shape = (len(found.positions), found.scene.dimension)
    if not all(values.shape == shape and (np.abs(values) <= LARGEST).all() for values in states):
        raise ValueError(shape)
    if not 0.0 <= found.time <= LARGEST:
        raise ValueError(found.time)
    if len(found.steps) not in (0, _STEPS) or not all(math.isfinite(step) and step >= 0.0 for step in found.steps):
        raise ValueError(found.steps)
