"""Runs that are not done: what they keep while they go on, and how they are found to be gone on with.

A run is done when its folder is published. Until then an inner folder holds its files, which are whole as far as they
got, and a checkpoint that also knows what the run had gathered, where in those files it was, and the pictures that its
video does not hold yet. Killed, stopped or out of disk, it goes on from there to the same bits.
"""

import json
import time as clock
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox import checkpoint
from sandbox.errors import SceneError
from sandbox.output.folder import CHECKPOINT, is_running, left_over

_OLDEST = 2.0
"""Wall time that a checkpoint may be old [s]..."""
_SHARE = 0.02
"""... unless keeping that up took more than this part of the time [1]."""
_EAGER = 0.5
"""Part of that age from which on a moment is taken at which there is little to write [1]."""

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Unfinished:
    """A run to go on with."""

    folder: Path
    saved: checkpoint.Checkpoint
    note: dict[str, Any]
    """What it had gathered, as plain data."""
    is_done: bool = False
    """Whether nothing is left to do but to publish its folder."""

    @property
    def writer(self) -> Arrays:
        """The memory of its picture writer."""
        prefix = "writer."
        return {name.removeprefix(prefix): self.saved.run[name] for name in self.saved.run if name.startswith(prefix)}

    @property
    def poster(self) -> NDArray[np.uint8] | None:
        """Its picture of most merit."""
        return self.saved.run.get("poster")


def write(folder: Path, saved: checkpoint.Checkpoint, note: dict[str, Any], arrays: Arrays) -> None:
    """Put a checkpoint of a run into its folder, in place of an earlier one."""
    # Numbers that come from arrays are NumPy's own.
    run = {"note": np.array(json.dumps(note, default=lambda number: number.item())), **arrays}
    checkpoint.write(folder / CHECKPOINT, replace(saved, run=run), in_passing=True)


def find(path: Path, scene: str, options: Mapping[str, Any]) -> Unfinished | None:
    """The run that a run folder holds unfinished; None where it was killed before there was anything to go on from.

    ``scene`` is TOML. Raises SceneError where there is no run, or not of this scene with these options.
    """
    if is_running(path):
        raise SceneError(f"--resume {path}: a run is still going on there")
    killed = left_over(path)
    place = next((folder for folder in killed if (folder / CHECKPOINT).is_file()), None)
    if place is None and killed:
        return None
    if place is None and not (path / CHECKPOINT).is_file():
        raise SceneError(f"--resume {path}: holds no run to go on with")
    unfinished = _read(place or path)
    if unfinished.is_done:
        if place is not None:
            return unfinished
        hint = f"--resume {path / CHECKPOINT} goes on from its end, with --seconds and another --out"
        raise SceneError(f"--resume {path}: that run has ended; {hint}")
    for name, value in options.items():
        earlier = unfinished.note["options"].get(name)
        if earlier != value:
            raise SceneError(f"--resume {path}: was run with {name} = {earlier}, not {value}")
    if unfinished.note["scene"] != scene:
        key = _difference(tomllib.loads(unfinished.note["scene"]), tomllib.loads(scene), "")
        raise SceneError(f"--resume {path}: {key} is not as it was; only the same scene can be gone on with")
    return unfinished


def _read(folder: Path) -> Unfinished:
    """The run of a folder's checkpoint. Raises SceneError where that is damaged."""
    saved = checkpoint.read(folder / CHECKPOINT)
    if "note" not in saved.run:
        return Unfinished(folder, saved, {}, is_done=True)
    try:
        note = json.loads(str(saved.run["note"]))
        if not (isinstance(note["options"], dict) and tomllib.loads(note["scene"])):
            raise ValueError(note)
    except (ValueError, KeyError, TypeError):
        raise SceneError(f"{folder / CHECKPOINT}: is damaged") from None
    return Unfinished(folder, saved, note)


def _difference(one: Any, other: Any, place: str) -> str:
    """Where two scenes differ first; nothing where they do not."""
    if isinstance(one, dict) and isinstance(other, dict):
        keys = [*one, *(key for key in other if key not in one)]
        pairs = [(f"{place}.{key}" if place else str(key), one.get(key), other.get(key)) for key in keys]
    elif isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        pairs = [(f"{place}[{n}]", *pair) for n, pair in enumerate(zip(one, other, strict=True))]
    else:
        return "" if one == other else place
    return next((found for name, a, b in pairs if (found := _difference(a, b, name))), "")


class Pace:
    """When to write the next checkpoint of a run."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._looked = clock.perf_counter()
        self._cost = 0.0
        """Time that the last one took [s]."""

    def is_due(self, is_small: bool) -> bool:
        """Whether to write one now, between two pictures; ``is_small`` where there is little to write."""
        now = clock.perf_counter()
        picture, self._looked = now - self._looked, now
        if self._last is None:
            return True
        age = now - self._last
        if age < self._cost / _SHARE:
            return False
        # The next chance comes a picture later.
        return age + picture >= _OLDEST or (is_small and age >= _EAGER * _OLDEST)

    def took(self, seconds: float) -> None:
        """One was written."""
        self._last, self._cost = clock.perf_counter(), seconds
