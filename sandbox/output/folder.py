"""The run folder: everything is written beside it first and takes its final name only when whole."""

import contextlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from sandbox.errors import SandboxError, SceneError
from sandbox.output.mark import MARK, Mark, fingerprint, remove

_PREFIX = ".partial-"


class RunFolder:
    """Collects the files of a run in a hidden folder inside ``path``, and publishes them at the end.

    Until ``publish`` the products of an earlier run stay as they were. A killed run leaves only its
    hidden folder, which the next run of the same folder removes. Only what runs have left is ever
    replaced or removed: they mark it, see :mod:`sandbox.output.mark`.
    """

    def __init__(self, path: Path, names: Sequence[str] = ()) -> None:
        """``names`` are those of the files and folders that may come.

        Raises SceneError where one of them is there already and no run has left it, or nothing can be written.
        """
        self.path = path
        try:
            if os.path.lexists(path) and not path.is_dir():
                raise SceneError(f"{path}: is no folder; choose another --out")
            self.claim(names)
            self._made = not path.exists()
            path.mkdir(parents=True, exist_ok=True)
            self._clear_left_over()
            self.partial = path / f"{_PREFIX}{os.getpid()}"
            shutil.rmtree(self.partial, ignore_errors=True)
            self.partial.mkdir()
            Mark(self.partial, {}).put()
        except OSError as error:
            raise SceneError(f"{path}: cannot be written: {error.strerror or error}") from None

    def _clear_left_over(self) -> None:
        for folder in self.path.glob(f"{_PREFIX}*"):
            process = folder.name.removeprefix(_PREFIX)
            if process.isdigit() and (folder / MARK).is_file() and not _is_running(int(process)):
                shutil.rmtree(folder, ignore_errors=True)

    @contextlib.contextmanager
    def discarded_on_failure(self) -> Iterator[None]:
        """Leave nothing of this run behind if the block fails; trouble in writing is one line of an error."""
        try:
            yield
        except OSError as error:
            self.discard()
            raise SandboxError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        except BaseException:
            self.discard()
            raise

    def write_text(self, name: str, text: str) -> None:
        """Add a text file."""
        (self.partial / name).write_text(text, encoding="utf-8")

    def write_json(self, name: str, data: Any) -> None:
        """Add a JSON file; numbers that are not finite become null, which JSON has and NaN is not."""
        self.write_text(name, json.dumps(_finite(data), indent=2, allow_nan=False) + "\n")

    def claim(self, names: Sequence[str]) -> None:
        """Raise SceneError where one of the files or folders that may come is there, and no run has left it."""
        Mark.read(self.path).check(names)

    def names(self) -> list[str]:
        """Names of what was collected so far, sorted."""
        return sorted(entry.name for entry in self.partial.iterdir() if entry.name != MARK)

    def publish(self, adds: bool = False) -> list[str]:
        """Give all files their final names, take away what an earlier run left, and return the names.

        ``adds`` leaves of the earlier run what is not replaced. What somebody has put there under one of the names
        while the run went on stays: the run is then in a folder of its own inside, and a SandboxError names it.
        """
        try:
            names = self.names()
            earlier = Mark.read(self.path)
            earlier.check(names)
            left = {name: fingerprint(self.partial / name) for name in names}
            kept = {name: prints for name, prints in earlier.prints.items() if adds and name not in left}
            # Killed on the way, it leaves a mark that knows the old files and the new ones.
            there = {name: [fingerprint(self.path / name)] for name in names if os.path.lexists(self.path / name)}
            both = {name: [*there.get(name, ()), new] for name, new in left.items()}
            Mark(self.path, {**earlier.prints, **both}).put()
            for name in earlier.prints:
                if name not in kept and name not in left and earlier.owns(name):
                    remove(self.path / name)
            for name in names:
                if (self.path / name).is_dir():
                    remove(self.path / name)
                (self.partial / name).replace(self.path / name)
            Mark(self.path, {**kept, **{name: [new] for name, new in left.items()}}).put()
            (self.partial / MARK).unlink()
            self.partial.rmdir()
        except SceneError as error:
            raise SandboxError(f"{error}; this run is in {self._set_aside()}") from None
        except OSError as error:
            raise SandboxError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        return names

    def _set_aside(self) -> Path:
        """Leave what was collected under a name that nobody clears away."""
        aside = self.path / f"run-{os.getpid()}"
        while os.path.lexists(aside):
            aside = aside.with_name(f"{aside.name}_")
        return self.partial.rename(aside)

    def discard(self) -> None:
        """Drop what was collected; an earlier run's files stay."""
        shutil.rmtree(self.partial, ignore_errors=True)
        if self._made:
            with contextlib.suppress(OSError):
                self.path.rmdir()


def _is_running(process: int) -> bool:
    if process == os.getpid():
        return False
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(process, 0)
        return not _is_dead(process)
    return False


def _is_dead(process: int) -> bool:
    """Whether a process has ended that nobody has asked about yet; it keeps its number until then."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    return False


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    if isinstance(data, float) and not abs(data) < float("inf"):
        return None
    return data
