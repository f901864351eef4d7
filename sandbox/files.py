"""Files that are whole or not there."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def replace_when_whole(path: Path, syncs: bool = True) -> Iterator[Path]:
    """A temporary file beside ``path`` that takes its name when the block ends well, and goes when it does not.

    ``syncs`` waits until it is on the disk, so that it outlives the machine and not only the process.
    """
    temporary = path.with_name(f".{path.name}.part")
    try:
        yield temporary
        if syncs:
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def append_at(path: Path, size: int) -> Any:
    """A file to append to, cut to a size. Raises ValueError where it is shorter."""
    if path.stat().st_size < size:
        raise ValueError(f"{path} ends early")
    file = path.open("rb+", buffering=0)
    file.truncate(size)
    file.seek(size)
    return file


def write_all(file: Any, data: bytes) -> None:
    """Write to a file without a buffer, which may take less than it is given."""
    view = memoryview(data)
    while view:
        view = view[file.write(view) :]
