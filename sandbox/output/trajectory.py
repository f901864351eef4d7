"""Trajectories: the state at every picture of a run, and its scene, in one file (.npz) or one folder (.zarr)."""

import json
import os
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox import __version__
from sandbox.errors import SandboxError, SceneError
from sandbox.output.frame_arrays import ArrayReader, Layout, create_arrays, open_arrays, zarr_module
from sandbox.output.frames import FloatArray, Frame
from sandbox.scene.load import scene_from_data, to_toml
from sandbox.scene.model import Scene

_FORMAT = 1
_FILE = "file_"


class TrajectoryKind(StrEnum):
    """How trajectories are stored."""

    NPZ = "npz"
    ZARR = "zarr"


@dataclass(frozen=True)
class RunInfo:
    """What a trajectory says of the run that it is of."""

    name: str
    """Name of the scene: names files."""
    precision: str
    """f32 or f64: positions, velocities and strains are stored in it."""
    arch: str
    particle_count: int
    spring_count: int
    tears: bool
    """True where springs of the scene can tear."""


def check_kind(option: str, kind: str | None) -> TrajectoryKind | None:
    """The kind of that name, ready to be written. Raises SceneError where there is none, or its package is absent."""
    if kind is None:
        return None
    if kind not in tuple(TrajectoryKind):
        raise SceneError(f"{option} {kind}: must be one of {', '.join(TrajectoryKind)}")
    if kind == TrajectoryKind.ZARR:
        zarr_module()
    return TrajectoryKind(kind)


class TrajectoryWriter:
    """Writes frames to trajectory.npz or trajectory.zarr in a folder; the file appears when it is closed."""

    def __init__(self, folder: Path, kind: TrajectoryKind, scene: Scene, run: RunInfo) -> None:
        real, dimension = np.float64 if run.precision == "f64" else np.float32, scene.dimension
        layout: dict[str, tuple[Any, tuple[int, ...]]] = {
            "time": (np.float64, ()),
            "merit": (np.float64, ()),
            "positions": (real, (run.particle_count, dimension)),
            "velocities": (real, (run.particle_count, dimension)),
        }
        if run.spring_count:
            layout["strain"] = (real, (run.particle_count,))
        if run.tears:
            layout["torn"] = (np.uint8, (run.spring_count,))
        files = _files_of(scene)
        metadata = {
            "format": _FORMAT,
            "sandbox": __version__,
            "name": run.name,
            "precision": run.precision,
            "arch": run.arch,
            "units": {"time": "s", "positions": "m", "velocities": "m/s", "strain": "1"},
            "files": list(files),
        }
        self._layout: Layout = layout
        self._arrays = create_arrays(
            folder / f"trajectory.{kind}",
            layout,
            {"scene": to_toml(scene), "metadata": json.dumps(metadata)},
            {f"{_FILE}{number}": data for number, data in enumerate(files.values())},
        )

    def write(self, frame: Frame) -> None:
        """Append one frame."""
        self._arrays.append({name: getattr(frame, name) for name in self._layout})

    def close(self) -> None:
        """Finish the file."""
        self._arrays.close()


class Trajectory:
    """A stored run: its scene, and the state at the start and at every picture.

    >>> trajectory = Trajectory.open("outputs/jelly")   # or the file itself
    >>> trajectory.times[-1], trajectory.positions(-1)
    """

    def __init__(self, path: Path) -> None:
        """Open a trajectory.npz or trajectory.zarr. Raises SceneError, one line, where it is none."""
        self.path = path
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        if not path.exists():
            raise SceneError(f"{path}: cannot be read: No such file or directory")
        with self._reading():
            self._arrays: ArrayReader = open_arrays(path)
            metadata = json.loads(self._arrays.text("metadata"))
            if metadata["format"] != _FORMAT:
                raise SceneError(f"{path}: is a trajectory of format {metadata['format']}; this reads {_FORMAT}")
            self.name = str(metadata["name"])
            """Name of the scene."""
            self.precision = str(metadata["precision"])
            """f32 or f64."""
            self.arch = str(metadata["arch"])
            self.data = self._restore_files(tomllib.loads(self._arrays.text("scene")), metadata["files"])
            """The scene as plain data."""
            self.scene: Scene = scene_from_data(self.data, None, source=str(path))
            """The scene that was run."""
            self.times: FloatArray = np.asarray(self._arrays.whole("time"), dtype=np.float64)
            """Time of every frame [s], shape (frame_count,); the first is the start."""
            self.merits: FloatArray = np.asarray(self._arrays.whole("merit"), dtype=np.float64)
            """What every frame is worth as a poster, shape (frame_count,)."""
            self._check()

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> "Trajectory":
        """The trajectory of a run folder, or of a file. Raises SceneError where there is none."""
        place = Path(path)
        if place.is_dir() and place.suffix != ".zarr":
            found = [place / f"trajectory.{kind}" for kind in TrajectoryKind]
            there = [candidate for candidate in found if candidate.exists()]
            if not there:
                raise SceneError(f"{place}: holds no trajectory; run the scene with --trajectory npz")
            place = there[0]
        return cls(place)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def particle_count(self) -> int:
        """Number of particles of all bodies."""
        return self._arrays.shape("positions")[1]

    @property
    def spring_count(self) -> int | None:
        """Number of springs; None where none can tear, and so nothing is stored of them."""
        return self._arrays.shape("torn")[1] if "torn" in self._arrays else None

    @property
    def stored(self) -> tuple[str, ...]:
        """Names of what is stored of every frame."""
        names = ("time", "merit", "positions", "velocities", "strain", "torn")
        return tuple(name for name in names if name in self._arrays)

    @property
    def poster(self) -> int:
        """Number of the frame that is the run's poster."""
        return int(np.argmax(self.merits)) if len(self.times) > 1 else 0

    def positions(self, number: int) -> FloatArray:
        """Particle positions at a frame [m], shape (particle_count, dimension), in the scene's order."""
        return self._real("positions", number)

    def velocities(self, number: int) -> FloatArray:
        """Particle velocities at a frame [m/s], of the same shape."""
        return self._real("velocities", number)

    def strain(self, number: int) -> FloatArray | None:
        """Largest strain of the springs at every particle [1], shape (particle_count,); None without springs."""
        return self._real("strain", number) if "strain" in self._arrays else None

    def torn(self, number: int) -> NDArray[np.bool_] | None:
        """True where a spring has torn, shape (spring_count,); None where none can."""
        return self._row("torn", number) != 0 if "torn" in self._arrays else None

    def frame(self, number: int) -> Frame:
        """Everything of one frame."""
        number = self._place(number)
        return Frame(
            number=number,
            time=float(self.times[number]),
            positions=self.positions(number),
            velocities=self.velocities(number),
            strain=self.strain(number),
            torn=self.torn(number),
            merit=float(self.merits[number]),
        )

    def frames(self) -> Iterator[Frame]:
        """All frames, one after the other; only one is in memory."""
        for number in range(len(self)):
            yield self.frame(number)

    def close(self) -> None:
        """Close the file."""
        self._arrays.close()
        if self._folder is not None:
            self._folder.cleanup()

    def __enter__(self) -> "Trajectory":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _place(self, number: int) -> int:
        if not -len(self) <= number < len(self):
            raise IndexError(f"frame {number}: there are {len(self)}")
        return number % len(self)

    def _row(self, name: str, number: int) -> NDArray[Any]:
        with self._reading():
            return self._arrays.row(name, self._place(number))

    def _real(self, name: str, number: int) -> FloatArray:
        values = np.asarray(self._row(name, number), dtype=np.float64)
        if not np.isfinite(values).all():
            raise SceneError(f"{self.path}: is damaged: {name} of frame {self._place(number)} are not all numbers")
        return values

    def _check(self) -> None:
        """Raise ValueError where shapes or times do not fit together."""
        count = len(self.times)
        shape = self._arrays.shape("positions")
        wanted = {"positions": shape, "velocities": shape, "strain": shape[:2]}
        fits = len(shape) == 3 and shape[2] == self.scene.dimension and len(self.merits) == count > 0
        for name, expected in wanted.items():
            fits = fits and (name not in self._arrays or self._arrays.shape(name) == expected) and shape[0] == count
        if "torn" in self._arrays:
            fits = fits and len(self._arrays.shape("torn")) == 2 and self._arrays.shape("torn")[0] == count
        if not (fits and np.isfinite(self.times).all() and (np.diff(self.times) >= 0.0).all()):
            raise ValueError("shapes or times do not fit together")

    def _restore_files(self, data: dict[str, Any], names: list[str]) -> dict[str, Any]:
        """Let the scene's mesh files be those of the run: the same, or copies where they have changed or are gone."""
        places: dict[str, str] = {}
        for number, name in enumerate(names):
            content = np.asarray(self._arrays.whole(f"{_FILE}{number}"), dtype=np.uint8).tobytes()
            if not _holds(Path(name), content):
                if self._folder is None:
                    self._folder = tempfile.TemporaryDirectory(prefix="sandbox-")
                copy = Path(self._folder.name) / f"{number}{Path(name).suffix}"
                copy.write_bytes(content)
                places[name] = str(copy)
        for part in [body.get("shape", {}) for body in data.get("bodies", [])] + data.get("colliders", []):
            if part.get("file") in places:
                part["file"] = places[part["file"]]
        return data

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except (SandboxError, IndexError):
            raise
        except Exception as error:
            if isinstance(error, OSError) and error.strerror:
                raise SceneError(f"{self.path}: cannot be read: {error.strerror}") from None
            # Zip, zlib, JSON, TOML and zarr each have errors of their own for what is no such file.
            raise SceneError(f"{self.path}: is not a trajectory, or is damaged") from None


def _files_of(scene: Scene) -> dict[str, bytes]:
    """Mesh files that a scene names, and what is in them."""
    parts: list[Any] = [*(body.shape for body in scene.bodies), *scene.colliders]
    names = dict.fromkeys(str(part.file) for part in parts if getattr(part, "file", None))
    return {name: Path(name).read_bytes() for name in names}


def _holds(path: Path, content: bytes) -> bool:
    try:
        return path.read_bytes() == content
    except OSError:
        return False
