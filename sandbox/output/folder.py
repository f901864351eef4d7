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

_PREFIX = "unfinished-"
CHECKPOINT = "checkpoint.npz"
"""What a run can be gone on with from."""
SUMMARY = "summary.json"


_own: set[Path] = set()
"""Folders of runs of this process that are under way."""


class RunFolder:
    """Collects the files of a run in a folder inside ``path``, and publishes them at the end.

    Until ``publish`` the products of an earlier run stay as they were. A killed run leaves only that inner folder,
    which the next run of the same folder removes: at once where it holds no checkpoint, else when it publishes.
    Only what runs have left is ever replaced or removed: they mark it, see :mod:`sandbox.output.mark`.
    """

    def __init__(self, path: Path, names: Sequence[str] = (), earlier: Path | None = None) -> None:
        """``names`` are those of the files and folders that may come.

        ``earlier`` is a folder to begin with what it holds: moved where a killed run has left it, else copied.
        Raises SceneError where one of the names is there already and no run has left it, or nothing can be written.
        """
        self.path = path
        try:
            if os.path.lexists(path) and not path.is_dir():
                raise SceneError(f"{path}: is no folder; choose another --out")
            self.claim(names)
            self._made = not path.exists()
            path.mkdir(parents=True, exist_ok=True)
            for folder in left_over(path):
                if folder != earlier and not (folder / CHECKPOINT).is_file():
                    shutil.rmtree(folder, ignore_errors=True)
            self.partial = path / f"{_PREFIX}{os.getpid()}"
            # In a container the number may well be that of the process that was killed.
            while os.path.lexists(self.partial):
                self.partial = self.partial.with_name(f"{self.partial.name}_")
            if earlier is not None and earlier.name.startswith(_PREFIX) and earlier.parent.samefile(path):
                earlier.rename(self.partial)
            elif earlier is not None:
                hidden = shutil.ignore_patterns(f"{_PREFIX}*", ".*")
                shutil.copytree(earlier, self.partial, ignore=hidden)
            else:
                self.partial.mkdir()
            _own.add(self.partial)
            Mark(self.partial, {}).put()
        except OSError as error:
            raise SceneError(f"{path}: cannot be written: {error.strerror or error}") from None

    @contextlib.contextmanager
    def discarded_on_failure(self) -> Iterator[None]:
        """Leave nothing of this run behind if the block fails, unless there is a checkpoint to go on from.

        Trouble in writing is one line of an error.
        """
        try:
            yield
        except OSError as error:
            hint = self.discard_unless_kept()
            raise SandboxError(f"{self.path}: cannot be written: {error.strerror or error}{hint}") from None
        except BaseException:
            self.discard_unless_kept()
            raise

    def discard_unless_kept(self) -> str:
        """Drop what was collected, unless there is a checkpoint to go on from; what to tell of that."""
        _own.discard(self.partial)
        if (self.partial / CHECKPOINT).is_file():
            return f"; --resume {self.path} goes on from what was simulated until then"
        self.discard()
        return ""

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
        return sorted(entry.name for entry in self.partial.iterdir() if not entry.name.startswith("."))

    def publish(self, adds: bool = False) -> list[str]:
        """Give all files their final names, take away what an earlier run left, and return the names.

        ``adds`` leaves of the earlier run what is not replaced. What somebody has put there under one of the names
        while the run went on stays: the run is then in a folder of its own inside, and a SandboxError names it. Raises
        OSError where it cannot be written.
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
            # By its checkpoint a run is known to be all there, and by its summary what it came to.
            for name in sorted(names, key=lambda name: (name == CHECKPOINT, name == SUMMARY)):
                if (self.path / name).is_dir():
                    remove(self.path / name)
                (self.partial / name).replace(self.path / name)
            Mark(self.path, {**kept, **{name: [new] for name, new in left.items()}}).put()
            shutil.rmtree(self.partial)
            _own.discard(self.partial)
            for folder in left_over(self.path):
                shutil.rmtree(folder, ignore_errors=True)
        except SceneError as error:
            raise SandboxError(f"{error}; this run is in {self._set_aside()}") from None
        return names

    def _set_aside(self) -> Path:
        """Leave what was collected under a name that nobody clears away."""
        aside = self.path / f"run-{os.getpid()}"
        while os.path.lexists(aside):
            aside = aside.with_name(f"{aside.name}_")
        return self.partial.rename(aside)

    def discard(self) -> None:
        """Drop what was collected; an earlier run's files stay."""
        _own.discard(self.partial)
        shutil.rmtree(self.partial, ignore_errors=True)
        if self._made:
            with contextlib.suppress(OSError):
                self.path.rmdir()


def left_over(path: Path) -> list[Path]:
    """Folders within a run folder that killed runs have left, the newest first."""
    found = [folder for folder in _unfinished(path) if not _is_running(folder)]
    return sorted(found, key=lambda folder: (folder / MARK).stat().st_mtime, reverse=True)


def is_running(path: Path) -> bool:
    """Whether a run is under way in a run folder."""
    return any(_is_running(folder) for folder in _unfinished(path))


def _unfinished(path: Path) -> list[Path]:
    marked = [folder for folder in path.glob(f"{_PREFIX}*") if (folder / MARK).is_file()]
    return [folder for folder in marked if _process(folder).isdigit()]


def _process(folder: Path) -> str:
    return folder.name.removeprefix(_PREFIX).rstrip("_")


def _is_running(folder: Path) -> bool:
    """Whether the process that made a folder is still there."""
    process = int(_process(folder))
    if folder in _own or process == os.getpid():
        return folder in _own
    with contextlib.suppress(ProcessLookupError, PermissionError, OverflowError):
        os.kill(process, 0)
        return not _is_another(process, folder)
    return False


def _is_another(process: int, folder: Path) -> bool:
    """Whether a process has ended and nobody has asked about it yet, or its number is another's by now."""
    with contextlib.suppress(OSError, ValueError, StopIteration):
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        lines = Path("/proc/stat").read_text().splitlines()
        booted = float(next(line for line in lines if line.startswith("btime")).split()[1])
        begun = booted + float(fields[19]) / os.sysconf("SC_CLK_TCK")
        # The clock of starts is known to a second.
        return fields[0] == "Z" or begun > (folder / MARK).stat().st_mtime + 2.0
    return False


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    if isinstance(data, float) and not abs(data) < float("inf"):
        return None
    return data
