"""Every combination of values that a sweep gives to keys of a scene, checked before the first one runs."""

import contextlib
import copy
import hashlib
import itertools
import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandbox.errors import SceneError
from sandbox.scene.assemble import assemble
from sandbox.scene.load import scene_from_data
from sandbox.scene.model import Scene
from sandbox.scene.overrides import change, dotted, dotted_key, steps

MOST = 10_000
"""Most combinations of a sweep."""
_LONGEST_NAME = 120
# What of a scene no shape, mass or spring depends on.
_NO_MATTER = {"title", "description", "solver", "diagnostics"}


@dataclass(frozen=True)
class Variation:
    """A key of the scene, and what it is to be."""

    key: str
    """Dotted, such as bodies.0.material.stiffness."""
    texts: tuple[str, ...]
    """Values as the user wrote them."""
    values: tuple[Any, ...]


@dataclass(frozen=True)
class SceneData:
    """Where the scenes of a sweep come from: what :func:`sandbox.scene.load.scene_from_data` takes."""

    data: Mapping[str, Any]
    overrides: Mapping[str, Any]
    source: str
    options: Mapping[str, str]
    folder: Path


@dataclass(frozen=True)
class Combination:
    """One value for every key."""

    values: dict[str, Any]
    """By dotted key."""
    texts: tuple[str, ...]
    """The same as the user wrote them."""
    label: str
    """For people: ``dt=1e-3, cells=[2,3]``."""
    name: str
    """For folders: safe everywhere, and of its own."""
    scene: Scene
    work: float
    """About how much there is to do, in arbitrary units."""


def parse_variation(text: str) -> Variation:
    """``KEY=A,B,C`` of the command line. Values are TOML, with their own commas in brackets and quotes, or bare words.

    Raises SceneError where there is no key or a value is empty.
    """
    key, equals, rest = text.partition("=")
    key = dotted_key(key)
    if not equals or not key:
        raise SceneError(f"--vary {text}: must be KEY=VALUE,VALUE, such as solver.dt=1e-4,1e-3")
    texts = _split(rest)
    if not any(texts):
        raise SceneError(f"--vary {text}: has no values")
    if not all(texts):
        raise SceneError(f"--vary {text}: has an empty value")
    values = tuple(map(_value, texts))
    seen: set[Any] = set()
    for value, written in zip(values, texts, strict=True):
        plain = (type(value) is bool, value) if isinstance(value, str | float | int) else json.dumps(value, default=str)
        if plain in seen:
            raise SceneError(f"--vary {text}: has {written} twice")
        seen.add(plain)
    return Variation(key, texts, values)


def _split(text: str) -> tuple[str, ...]:
    """Parts between the commas outside of brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter == "," and depth == 0:
            parts.append("")
            continue
        depth += 0 if quote else (letter in "[{") - (letter in "]}")
        parts[-1] += letter
    return tuple(part.strip() for part in parts)


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return text


def combinations(base: SceneData, variations: Sequence[Variation]) -> list[Combination]:
    """All of them, the last key varying fastest; each scene is checked and assembled once.

    Raises SceneError where a key or a value is wrong, saying in which combination.
    """
    _check_keys(base, variations)
    count = math.prod(len(variation.values) for variation in variations)
    if count > MOST:
        raise SceneError(f"--vary makes {count} combinations, at most {MOST} are taken")
    keys = [variation.key for variation in variations]
    short = short_names(keys)
    taken: set[str] = set()
    works: dict[str, float] = {}
    found = []
    for numbers in itertools.product(*(range(len(variation.values)) for variation in variations)):
        chosen = list(zip(variations, numbers, strict=True))
        values = {variation.key: variation.values[number] for variation, number in chosen}
        texts = tuple(variation.texts[number] for variation, number in chosen)
        parts = [f"{name}={text}" for name, text in zip(short, texts, strict=True)]
        label = ", ".join(parts)
        scene, work = _scene(base, values, texts, label, works)
        found.append(Combination(values, texts, label, _folder_name(parts, taken), scene, work))
    return found


def _check_keys(base: SceneData, variations: Sequence[Variation]) -> None:
    if not variations:
        raise SceneError("--vary is required, such as --vary solver.dt=1e-4,1e-3")
    data = copy.deepcopy(dict(base.data))
    given = {change(data, key, value): base.options.get(key, f"--set {key}") for key, value in base.overrides.items()}
    varied: dict[str, str] = {}
    for variation in variations:
        key = variation.key
        with contextlib.suppress(SceneError):  # of what is not there its first scene tells
            key = dotted(steps(data, key))
        for other, option in given.items():
            if _within(other, key):
                raise SceneError(f"--vary {variation.key}: {option} gives it too")
        for other, name in varied.items():
            if _within(other, key) or _within(key, other):
                raise SceneError(f"--vary {variation.key}: --vary {name} gives it too")
        varied[key] = variation.key


def _within(key: str, other: str) -> bool:
    """Whether a key is another one, or a part of it."""
    return f"{key}.".startswith(f"{other}.")


def _scene(
    base: SceneData, values: dict[str, Any], texts: tuple[str, ...], label: str, works: dict[str, float]
) -> tuple[Scene, float]:
    """The scene of a combination, and how much work it is; ``works`` remembers what was assembled."""
    options = {key: f"--vary {key}={text}" for key, text in zip(values, texts, strict=True)}
    where = f" ({label})" if len(values) > 1 else ""
    try:
        scene = scene_from_data(
            base.data, {**base.overrides, **values}, base.source, {**base.options, **options}, base.folder
        )
    except SceneError as error:
        message = str(error)
        named = next((key for key in options if message.startswith(f"--set {key}:")), None)
        if named is not None:
            message = options[named] + message.removeprefix(f"--set {named}")
        raise SceneError(f"{message}{where}") from None
    built = scene.model_dump_json(exclude=_NO_MATTER)
    if built not in works:
        try:
            assembly = assemble(scene)
        except SceneError as error:
            raise SceneError(f"{base.source}: {error} ({label})") from None
        works[built] = float(assembly.particle_count + 2 * assembly.spring_count)
    dt = scene.solver.dt
    steps = scene.duration / (1e-3 if dt == "auto" else dt)
    return scene, works[built] * steps


def short_names(keys: Sequence[str]) -> list[str]:
    """The shortest ends of dotted keys that tell them apart."""
    names = []
    for key in keys:
        parts = key.split(".")
        ends = [".".join(parts[start:]) for start in range(len(parts) - 1, -1, -1)]
        others = [other for other in keys if other != key]
        names.append(next((end for end in ends if not any(_ends_with(other, end) for other in others)), key))
    return names


def _ends_with(key: str, end: str) -> bool:
    return f".{key}".endswith(f".{end}")


def _folder_name(parts: Sequence[str], taken: set[str]) -> str:
    """A readable name for a folder, safe on every system, and not ``taken`` yet."""
    whole = ",".join(parts)
    name = re.sub(r"[^A-Za-z0-9._+=,-]+", "_", re.sub(r"[\[\]{}\"'\s]", "", whole)).strip(".")
    if name.casefold() in taken or len(name) > _LONGEST_NAME:
        name = f"{name[: _LONGEST_NAME - 9]}-{hashlib.sha256(whole.encode()).hexdigest()[:8]}"
    taken.add(name.casefold())
    return name
