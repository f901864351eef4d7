"""The mark in a run folder: which files runs have left there, and what they were, so that nothing else is replaced."""

import contextlib
import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandbox.errors import SceneError
from sandbox.files import replace_when_whole

MARK = ".sandbox-run.json"
_WHOLE = 1 << 20
"""Of files up to so many bytes the mark knows the content, of larger ones the size."""
# What folders that have no mark yet are known by: the keys of a file, and what runs that wrote it left beside it.
_EARLIER: dict[str, tuple[set[str], tuple[str, ...]]] = {
    "stability.json": ({"name", "schemes"}, ("scene.toml", "stability_map.csv", "stability_map.png")),
    "trade.json": ({"name", "horizon", "reference", "rows"}, ("scene.toml", "trade.csv", "trade.png")),
    "models.json": ({"name", "horizon", "left_out", "rows"}, ("scene.toml", "models.csv")),
    "tune.json": ({"name", "found", "trials", "grid"}, ("tuned.toml",)),
    "sweep.json": ({"name", "vary", "rows"}, ("sweep.csv", "sweep.png")),
}


@dataclass(frozen=True)
class Mark:
    """What runs have left in a folder."""

    folder: Path
    prints: Mapping[str, Sequence[str]]
    """By name of a file or folder: its fingerprints. Empty where only the name is known."""

    @classmethod
    def read(cls, folder: Path) -> "Mark":
        """The mark of a folder. Raises SceneError where there is a file of that name that is none."""
        path = folder / MARK
        if not os.path.lexists(path):
            return cls(folder, dict.fromkeys(_left_without_mark(folder), ()))
        data = _json(path).get("files")
        known = data if isinstance(data, dict) else {}
        if data is None or not all(_is_name(name) and _is_texts(prints) for name, prints in known.items()):
            raise SceneError(f"{path}: does not say what runs have left here; choose another --out")
        return cls(folder, known)

    def owns(self, name: str) -> bool:
        """Whether a run has left what is there under this name, and it is still that."""
        prints = self.prints.get(name)
        return prints is not None and (not prints or fingerprint(self.folder / name) in prints)

    def check(self, names: Iterable[str]) -> None:
        """Raise SceneError where something is there under one of the names that is not as a run has left it."""
        for name in names:
            path = self.folder / name
            if os.path.lexists(path) and not self.owns(name):
                changed = "was changed since a run left it"
                what = changed if name in self.prints else "is there already, not of an earlier run"
                raise SceneError(f"{path}: {what}; move it away or choose another --out")

    def put(self) -> None:
        """Write the mark into the folder."""
        with replace_when_whole(self.folder / MARK) as temporary:
            data = {"files": {name: list(prints) for name, prints in sorted(self.prints.items())}}
            temporary.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")


def fingerprint(path: Path) -> str:
    """What tells whether somebody has changed a file, or added to a folder: hash of its content or of its list."""
    if path.is_symlink():
        return f"link {path.readlink()}"
    if path.is_dir():
        inside = (entry for entry in path.rglob("*") if entry.is_symlink() or not entry.is_dir())
        lines = sorted(f"{entry.relative_to(path).as_posix()} {entry.lstat().st_size}" for entry in inside)
        return "folder " + hashlib.sha256("\n".join(lines).encode(errors="surrogateescape")).hexdigest()
    size = path.stat().st_size
    return f"file {size} " + (hashlib.sha256(path.read_bytes()).hexdigest() if size <= _WHOLE else "")


def remove(path: Path) -> None:
    """Take away a file, a link or a folder with all that is in it."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _left_without_mark(folder: Path) -> list[str]:
    """Names that versions before there was a mark have left, by what their own files say."""
    names: list[str] = []
    summary = _json(folder / "summary.json")
    if {"status", "state_sha256", "files", "versions"} <= summary.keys() and _is_texts(summary["files"]):
        names += [*summary["files"], "summary.json"]
    exports = _json(folder / "exports.json")
    if exports.keys() == {"files"} and _is_texts(exports["files"]):
        names += [*exports["files"], "exports.json"]
    for file, (keys, others) in _EARLIER.items():
        if keys <= _json(folder / file).keys():
            names += [file, *others]
    return [name for name in dict.fromkeys(names) if _is_name(name)]


def _json(path: Path) -> dict[str, Any]:
    with contextlib.suppress(OSError, ValueError, RecursionError):
        data = json.loads(path.read_text(encoding="utf-8"))
        return data if isinstance(data, dict) else {}
    return {}


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(text, str) for text in value)


def _is_name(name: str) -> bool:
    """Whether a name is that of something in the folder itself, and not hidden."""
    return Path(name).name == name and not name.startswith(".")
