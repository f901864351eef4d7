"""Arrays that two processes see. NumPy only."""

import contextlib
import mmap
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

_ALIGNMENT = 64


@dataclass(frozen=True)
class Layout:
    """Which arrays lie where in a mapped file."""

    path: str
    size: int
    """[bytes]"""
    arrays: dict[str, tuple[str, tuple[int, ...], int]]
    """Element type, shape and offset [bytes] of every array."""


class SharedArrays:
    """Arrays in a file that is mapped by both processes, in memory where the machine has a place for such files."""

    def __init__(self, layout: Layout) -> None:
        """Map a file that is there."""
        self.layout = layout
        with open(layout.path, "r+b") as file:
            self._map = mmap.mmap(file.fileno(), layout.size)

    @classmethod
    def create(cls, arrays: dict[str, tuple[Any, tuple[int, ...]]]) -> "SharedArrays":
        """A new file of zeros, for arrays of these element types and shapes. Raises OSError where there is no room."""
        placed, size = {}, 0
        for name, (element, shape) in arrays.items():
            placed[name] = (np.dtype(element).str, shape, size)
            used = int(np.prod(shape)) * np.dtype(element).itemsize
            size += -(-max(1, used) // _ALIGNMENT) * _ALIGNMENT
        path = _new_file(size)
        try:
            return cls(Layout(path, size, placed))
        except BaseException:
            Path(path).unlink(missing_ok=True)
            raise

    def __getitem__(self, name: str) -> Any:
        """The array of a name; it lives as long as this object."""
        element, shape, offset = self.layout.arrays[name]
        count = int(np.prod(shape))
        return np.frombuffer(self._map, dtype=element, count=count, offset=offset).reshape(shape)

    def forget_name(self) -> None:
        """Take the file's name away, once both have mapped it: it goes with the processes, however those end."""
        # Windows keeps the names of files that are in use.
        with contextlib.suppress(OSError):
            os.unlink(self.layout.path)


def _new_file(size: int) -> str:
    """A file of zeros, in memory if there is room."""
    for place in ("/dev/shm", None):
        if place is not None and not os.path.isdir(place):
            continue
        handle, path = tempfile.mkstemp(prefix="sandbox-", suffix=".shared", dir=place)
        try:
            if hasattr(os, "posix_fallocate"):
                # Without this, too small a file system would be noticed by a signal that kills.
                os.posix_fallocate(handle, 0, size)
            else:
                os.truncate(path, size)
            return path
        except OSError:
            os.unlink(path)
            if place is None:
                raise
        finally:
            os.close(handle)
    raise OSError("no place for a shared file")
