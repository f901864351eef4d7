"""From a preset's name, a path or plain data to a :class:`Scene`; dotted overrides; one-line errors."""

import copy
import json
import math
import os
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import BaseModel, ValidationError

from sandbox.errors import SceneError, did_you_mean
from sandbox.scene import model
from sandbox.scene.action_checks import action_problems
from sandbox.scene.model import MOST_PARTICLES, Action, Scene
from sandbox.scene.overrides import TOO_LONG, change, check_data, dotted

_PACKAGE = Path(__file__).resolve().parent.parent
# In a wheel the scenes lie inside the package, in a checkout beside it.
_PRESET_FOLDERS = (_PACKAGE / "scenes", _PACKAGE.parent / "scenes")

# What pydantic calls the mistake -> what the user is told. `got` is the input, shortened.
_MESSAGES = {
    "greater_than": "must be > {gt:g}, got {got}",
    "greater_than_equal": "must be >= {ge:g}, got {got}",
    "less_than": "must be < {lt:g}, got {got}",
    "less_than_equal": "must be <= {le:g}, got {got}",
    "missing": "is required",
    "float_type": "must be a number, got {got}",
    "int_type": "must be a whole number, got {got}",
    "bool_type": "must be true or false, got {got}",
    "string_type": "must be text, got {got}",
    "tuple_type": "must be a list, got {got}",
    "model_type": "must be a table, got {got}",
    "model_attributes_type": "must be a table, got {got}",
    "dict_type": "must be a table, got {got}",
    "finite_number": "must be a finite number, got {got}",
    "too_short": "must have at least {min_length} entries, got {actual_length}",
    "too_long": "must have at most {max_length} entries, got {actual_length}",
    "string_too_short": "must not be empty",
    "string_pattern_mismatch": "must look like {pattern}, got {got}",
    "enum": "must be {expected}, got {got}",
    "literal_error": "must be {expected}, got {got}",
    "union_tag_not_found": "needs a {discriminator}",
    "union_tag_invalid": "kind must be one of {expected_tags}, got {tag!r}",
}


def preset_paths() -> dict[str, Path]:
    """Every preset that ships with the sandbox: name -> file, sorted by name."""
    for folder in _PRESET_FOLDERS:
        if folder.is_dir():
            return {path.stem: path for path in sorted(folder.glob("*.toml"))}
    return {}


def load_scene(source: str | os.PathLike[str], overrides: Mapping[str, Any] | None = None) -> Scene:
    """The scene of a preset's name or of a TOML file's path.

    ``overrides`` maps dotted keys to values, e.g. ``{"solver.dt": 1e-4, "bodies.0.material.stiffness": 50.0}``; a
    body or collider is meant by its number or its name. Relative paths of mesh files start at the file's folder.
    Raises SceneError, with one line that says where the mistake is.
    """
    path = find_scene(source)
    return scene_from_data(read_toml(path), overrides, source=str(source), folder=path.parent)


def find_scene(source: str | os.PathLike[str]) -> Path:
    """The file of a preset's name or path. Raises SceneError that suggests the nearest preset."""
    text = os.fspath(source)
    presets = preset_paths()
    if text in presets:
        return presets[text]
    if text.endswith(".toml") or os.sep in text or Path(text).exists():
        return Path(text)
    hint = did_you_mean(text, presets) or f"; there are {', '.join(presets)}"
    raise SceneError(f"{text}: no such preset or file{hint}")


def read_toml(path: Path) -> dict[str, Any]:
    """The data of a TOML file. Raises SceneError where it cannot be read or is not TOML."""
    try:
        data = tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: is not TOML: not UTF-8 text at byte {error.start}") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: is not TOML: {error}") from None
    except ValueError:
        raise SceneError(f"{path}: {TOO_LONG}") from None
    check_data(data, str(path))
    return data


def scene_from_data(
    data: Mapping[str, Any],
    overrides: Mapping[str, Any] | None,
    source: str = "scene",
    options: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> Scene:
    """A validated scene from plain data.

    ``source`` begins the text of errors; ``options`` tells for an override which option it came from;
    relative paths of mesh files, in overrides too, start at ``folder``, by default the working directory.
    """
    check_data(data, source)
    for key, value in (overrides or {}).items():
        check_data({key: value}, (options or {}).get(key, f"--set {key}"))
    raw: dict[str, Any] = copy.deepcopy(dict(data))
    options = options or {}
    given = {change(raw, key, value): options.get(key, f"--set {key}") for key, value in (overrides or {}).items()}
    _anchor_files(raw, folder or Path())
    try:
        scene = Scene.model_validate(raw)
    except ValidationError as error:
        raise SceneError(describe(error, raw, source, given)) from None
    check_dimensions(scene, source)
    return scene


def _anchor_files(data: dict[str, Any], folder: Path) -> None:
    """Make the paths of mesh files absolute, so that the scene can be written anywhere."""
    for key, nested in (("bodies", "shape"), ("colliders", None)):
        entries = data.get(key)
        for entry in entries if isinstance(entries, list | tuple) else ():
            part = entry.get(nested) if nested and isinstance(entry, dict) else entry
            if isinstance(part, dict) and isinstance(part.get("file"), str) and part["file"]:
                part["file"] = os.path.abspath(folder / Path(part["file"]).expanduser())


def lay_over(data: Mapping[str, Any], fragment: Mapping[str, Any]) -> dict[str, Any]:
    """Scene data with the values of a fragment in their places: tables are merged, all else is replaced."""
    merged = dict(data)
    for key, value in fragment.items():
        below = merged.get(key)
        merged[key] = lay_over(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged


def to_toml(part: BaseModel) -> str:
    """A scene as TOML that :func:`load_scene` reads back to an equal one, defaults written out; so of any part."""
    return tomli_w.dumps(part.model_dump(mode="json", exclude_none=True))


def json_schema() -> str:
    """JSON Schema of a scene file, for editors."""
    return json.dumps(Scene.model_json_schema(), indent=2)


def describe(error: ValidationError, data: Any, source: str, overridden: Mapping[str, str]) -> str:
    """One line for what pydantic found: where, what, what was there. ``overridden`` maps keys to their options."""
    errors = error.errors(include_url=False)
    first = errors[0]
    # A list with a wrong entry is called too short as well.
    errors = [e for e in errors if e is first or e["type"] != "too_short"]
    parts = _real_location(first["loc"], data)
    where = _dotted(parts)
    here = f"{dotted(parts)}."
    source = next(
        (how for key, how in overridden.items() if here.startswith(f"{key}.") or key.startswith(here)), source
    )
    more = len({_dotted(_real_location(e["loc"], data)) for e in errors}) - 1
    tail = f" (and {more} more)" if more else ""
    message = _message(first)
    for other in errors[1:]:
        # The other way to write a union, such as solver.dt = "auto".
        if other["type"] == "literal_error" and _real_location(other["loc"], data) == parts:
            message = message.replace(", got", f" or {other['ctx']['expected']}, got")
    return f"{source}: {where}{': ' if where else ''}{message}{tail}"


def _real_location(location: tuple[int | str, ...], data: Any) -> list[int | str]:
    """Pydantic's location less the names of union members, which are not in the user's file."""
    parts: list[int | str] = []
    node = data
    for part in location:
        if isinstance(node, Mapping):
            if part in node:
                node = node[part]
            elif node.get("kind") == part or not str(part).isidentifier():
                continue  # the tag of a discriminated union, or the name of another one's branch
        elif isinstance(node, list | tuple) and isinstance(part, int) and part < len(node):
            node = node[part]
        else:
            continue  # the name of a union's branch, such as "float"
        parts.append(part)
    return parts


def _dotted(parts: Iterable[int | str]) -> str:
    text = ""
    for part in parts:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _message(error: Any) -> str:
    kind = error["type"]
    if kind == "extra_forbidden":
        key = str(error["loc"][-1])
        if key in _known_keys():
            return "unknown key here"
        return f"unknown key{did_you_mean(key, _known_keys())}"
    template = _MESSAGES.get(kind)
    if template is None:
        return str(error["msg"])
    got = repr(error["input"])
    got = got if len(got) <= 60 else got[:57] + "..."
    return template.format(got=got, **error.get("ctx", {}))


def _known_keys() -> list[str]:
    keys: set[str] = set()
    for part in vars(model).values():
        if isinstance(part, type) and issubclass(part, BaseModel):
            keys.update(field.alias or name for name, field in part.model_fields.items())
    return sorted(keys)


def check_action(scene: Scene, action: Action) -> None:
    """Raises SceneError where an action does not fit a scene."""
    for where, problem in _dimension_problems(scene.model_copy(update={"actions": (action,)})):
        raise SceneError(f"{where.replace('actions[0]', 'action')}: {problem}")


def check_dimensions(scene: Scene, source: str) -> None:
    """Raises SceneError where a vector, shape or angle does not fit the scene's dimension."""
    for where, problem in _dimension_problems(scene):
        raise SceneError(f"{source}: {where}: {problem}")


def _dimension_problems(scene: Scene) -> Iterable[tuple[str, str]]:
    dimension = scene.dimension
    for where, name, value in _walk(scene):
        if name in _VECTOR_KEYS and isinstance(value, tuple) and len(value) != dimension:
            yield where, f"must have {dimension} components in a {dimension}D scene, got {len(value)}"
        if name in ("points", "velocities", "holes") and isinstance(value, tuple):
            yield from _point_problems(where, value, dimension)
        if name in ("rotation", "angular_velocity") and value is not None:
            if dimension == 2 and isinstance(value, tuple):
                yield where, "must be one number in a 2D scene"
            if dimension == 3 and not isinstance(value, tuple) and value != 0.0:
                yield where, "must be three numbers in a 3D scene"
    for index, body in enumerate(scene.bodies):
        yield from _shape_problems(f"bodies[{index}].shape", body.shape, dimension)
    if (count := particle_estimate(scene)) > MOST_PARTICLES:
        yield "bodies", f"make {count:.3g} particles together, at most {MOST_PARTICLES:.3g} are taken"
    for index, collider in enumerate(scene.colliders):
        yield from _kind_problem(f"colliders[{index}].kind", collider, dimension)
    yield from _name_problems(scene)


def _point_problems(where: str, rows: tuple[Any, ...], dimension: int) -> Iterable[tuple[str, str]]:
    for row, vector in enumerate(rows):
        if vector and isinstance(vector[0], tuple):
            yield from _point_problems(f"{where}[{row}]", vector, dimension)
        elif len(vector) != dimension:
            yield f"{where}[{row}]", f"must have {dimension} components in a {dimension}D scene, got {len(vector)}"


# What there is in one dimension only, and what to take in the other.
_ONLY: dict[type, tuple[int, str]] = {
    model.Sheet: (3, "in 2D use a box or a rope"),
    model.Shell: (3, "in 2D use a ring"),
    model.Mesh: (3, "in 2D use a polygon"),
    model.Ring: (2, "in 3D use a shell"),
    model.Polygon: (2, "in 3D use a mesh"),
    model.PolygonCollider: (2, "in 3D use a mesh"),
    model.MeshCollider: (3, "in 2D use a polygon"),
}


def _kind_problem(where: str, part: Any, dimension: int) -> Iterable[tuple[str, str]]:
    only, instead = _ONLY.get(type(part), (dimension, ""))
    if only != dimension:
        yield where, f"a {part.kind} needs a {only}D scene; {instead}"


def _shape_problems(where: str, shape: Any, dimension: int) -> Iterable[tuple[str, str]]:
    if isinstance(shape, model.Box) and len(shape.cells) != dimension:
        yield f"{where}.cells", f"must have {dimension} entries in a {dimension}D scene, got {len(shape.cells)}"
    yield from _kind_problem(f"{where}.kind", shape, dimension)
    count, key = _count(shape, dimension)
    if count > MOST_PARTICLES:
        yield f"{where}.{key}", f"makes {count:.3g} particles, at most {MOST_PARTICLES:.3g} are taken"


def particle_estimate(scene: Scene) -> float:
    """About how many particles a scene has at most, meshes from files left out: what it costs to build it."""
    return sum(_count(body.shape, scene.dimension)[0] for body in scene.bodies)


def _count(shape: Any, dimension: int) -> tuple[float, str]:
    """About how many particles a shape makes at most, where that can be told, and which of its keys says so."""
    if isinstance(shape, model.Box | model.Ball | model.Sheet):
        cells = (shape.cells,) * dimension if isinstance(shape.cells, int) else shape.cells
        return math.prod(n + 1 for n in cells), "cells"
    if isinstance(shape, model.Polygon):
        extent = [max(axis) - min(axis) for axis in zip(*shape.points, strict=False)]
        return math.prod(length / shape.spacing + 1.0 for length in extent), "spacing"
    if isinstance(shape, model.Rope | model.Ring):
        return shape.segments + 1, "segments"
    if isinstance(shape, model.Shell):
        return 10 * 4**shape.subdivisions + 2, "subdivisions"
    if isinstance(shape, model.Tower):
        return (shape.levels + 1) * (shape.bays + 1 if dimension == 2 else 4 * shape.bays), "levels"
    return len(shape.points) if isinstance(shape, model.Custom) else 0.0, ""


def _name_problems(scene: Scene) -> Iterable[tuple[str, str]]:
    names = [(f"bodies[{index}].name", body.name) for index, body in enumerate(scene.bodies)]
    names += [(f"colliders[{index}].name", c.name) for index, c in enumerate(scene.colliders) if c.name]
    taken: set[str] = set()
    for where, name in names:
        if name in taken:
            yield where, f"{name!r} is the name of an earlier body or collider too"
        taken.add(name)
    yield from action_problems(scene)


_VECTOR_KEYS = {
    "gravity", "position", "velocity", "point", "normal", "size", "start", "end", "eye", "target", "min", "max",
    "center", "axis", "force", "impulse", "amplitude", "direction", "edge_start", "edge_end", "sweep",
}  # fmt: skip


def _walk(node: BaseModel, where: str = "") -> Iterable[tuple[str, str, Any]]:
    """Every field of every part of the scene: dotted place, key, value. Pictures have sizes of their own."""
    for name, field in type(node).model_fields.items():
        value = getattr(node, name)
        here = f"{where}.{field.alias or name}" if where else field.alias or name
        if isinstance(value, BaseModel):
            yield from _walk(value, here)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            for index, item in enumerate(value):
                yield from _walk(item, f"{here}[{index}]")
        elif not isinstance(node, model.Render) and not (isinstance(node, model.Sheet) and name == "size"):
            yield here, name, value
        elif isinstance(node, model.Sheet) and len(value) != 2:
            yield here, "size", value[:1]  # a sheet has two edges in any dimension
