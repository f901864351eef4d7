"""The run folder: everything is written beside it first and takes its final name only when whole."""

import contextlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from sandbox.errors import SandboxError, SceneError

_PREFIX = ".partial-"
_EXPORTS = "exports.json"
"""Names the files that belong to a run and are called after its scene."""
# What a run may leave in its folder; a later run replaces or removes these and touches nothing else.
_PRODUCTS = (
    "video.mp4", "video.webm", "video.gif", "frames", "poster.png", "metrics.csv", "summary.json", "scene.toml",
    "checkpoint.npz", "postmortem.png", "stability.json", "stability_map.csv", "stability_map.png", "trade.csv",
    "trade.json", "trade.png", "tune.json", "tuned.toml", "models.json",
    "models.csv", "trajectory.npz", "trajectory.zarr", "exports.json",
)  # fmt: skip


class RunFolder:
    """Collects the files of a run in a hidden folder inside ``path``, and publishes them at the end.

    Until ``publish`` the products of an earlier run stay as they were. A killed run leaves only its
    hidden folder, which the next run of the same folder removes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._made = not path.exists()
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._clear_left_over()
            self.partial = path / f"{_PREFIX}{os.getpid()}"
            shutil.rmtree(self.partial, ignore_errors=True)
            self.partial.mkdir()
        except OSError as error:
            raise SceneError(f"{path}: cannot be written: {error.strerror or error}") from None

    def _clear_left_over(self) -> None:
        for folder in self.path.glob(f"{_PREFIX}*"):
            process = folder.name.removeprefix(_PREFIX)
            if not (process.isdigit() and _is_running(int(process))):
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
        """Say which files or folders beside the usual ones will come, so that a later run takes them away.

        Raises SceneError where something is there already that no run has left.
        """
        earlier = exported(self.path)
        for name in names:
            if (self.path / name).exists() and name not in earlier:
                raise SceneError(f"{self.path / name}: is there already, not of an earlier run; choose another --out")
        self.write_json(_EXPORTS, {"files": [str(name) for name in names]})

    def publish(self, adds: bool = False) -> list[str]:
        """Give all files their final names, take away what an earlier run left, and return the names.

        ``adds`` leaves of the earlier run what is not replaced.
        """
        try:
            names = sorted(entry.name for entry in self.partial.iterdir())
            earlier = exported(self.path)
            if adds and _EXPORTS in names:
                self.write_json(_EXPORTS, {"files": sorted({*earlier, *exported(self.partial)})})
            for name in dict.fromkeys([*_PRODUCTS, *earlier]):
                if (name not in names and not adds) or (name in names and (self.path / name).is_dir()):
                    _remove(self.path / name)
            for name in names:
                (self.partial / name).replace(self.path / name)
            self.partial.rmdir()
        except OSError as error:
            raise SandboxError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        return names

    def discard(self) -> None:
        """Drop what was collected; an earlier run's files stay."""
        shutil.rmtree(self.partial, ignore_errors=True)
        if self._made:
            with contextlib.suppress(OSError):
                self.path.rmdir()


def exported(folder: Path) -> list[str]:
    """Files and folders of a run beside the usual ones."""
    try:
        names = json.loads((folder / _EXPORTS).read_text(encoding="utf-8"))["files"]
        return [name for name in names if Path(name).name == name and not name.startswith(".")]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


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
