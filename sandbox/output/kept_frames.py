"""Frames of a run that is not done, kept as they are, so that whoever writes them down can begin again."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sandbox.files import append_at, write_all
from sandbox.output.frames import Frame

KEPT_FRAMES = "states.raw"


class KeptFrames:
    """A file of frames, a record each; a frame writer.

    Parameters
    ----------
    path : of the file
    particle_count, dimension, spring_count : of the scene; ``spring_count`` is 0 where nothing can tear
    strains : whether frames have strains
    real : type of its numbers
    count : frames of an earlier file to go on with; what comes after them is dropped
    """

    def __init__(
        self, path: Path, particle_count: int, dimension: int, spring_count: int, strains: bool, real: Any, count: int
    ) -> None:
        vectors = (real, (particle_count, dimension))
        fields: list[Any] = [("number", "<i8"), ("time", "<f8"), ("merit", "<f8"), ("positions", *vectors)]
        fields += [("velocities", *vectors)]
        fields += [("strain", real, (particle_count,))] if strains else []
        fields += [("torn", np.bool_, (spring_count,))] if spring_count else []
        self._path, self._kind, self._count = path, np.dtype(fields), count
        self._names = [field[0] for field in fields]
        size = count * self._kind.itemsize
        self._file = append_at(path, size) if count else path.open("wb", buffering=0)

    def frames(self) -> Iterator[Frame]:
        """Those that were kept before."""
        with self._path.open("rb") as file:
            for _ in range(self._count):
                record = np.fromfile(file, dtype=self._kind, count=1)[0]
                yield Frame(
                    number=int(record["number"]),
                    time=float(record["time"]),
                    positions=record["positions"].astype(np.float64),
                    velocities=record["velocities"].astype(np.float64),
                    strain=record["strain"].astype(np.float64) if "strain" in self._names else None,
                    torn=record["torn"].copy() if "torn" in self._names else None,
                    merit=float(record["merit"]),
                )

    def write(self, frame: Frame) -> None:
        """Append one frame."""
        record = np.zeros(1, dtype=self._kind)
        for name in self._names:
            record[name] = getattr(frame, name)
        write_all(self._file, record.tobytes())

    def close(self) -> None:
        """Finish the file."""
        self._file.close()
