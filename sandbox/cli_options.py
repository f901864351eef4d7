"""What several commands take: the scene, its changes, lists of things."""

import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from sandbox.errors import DivergedError, SandboxError, SceneError
from sandbox.scene.load import find_scene, lay_over, read_toml, scene_from_data
from sandbox.scene.model import Scene
from sandbox.scene.overrides import parse_assignment
from sandbox.warning_log import WARNING

SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A preset's name, or a path to a TOML file.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value of the scene, e.g. solver.dt=1e-4 or bodies.jelly.color=tomato. Repeatable.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="JSON on standard output, and nothing else there.")]
WithOption = Annotated[
    list[Path] | None,
    typer.Option("--with", metavar="FILE", help="TOML laid over the scene, such as what tune writes. Repeatable."),
]
ActionsOption = Annotated[
    Path | None,
    typer.Option("--actions", metavar="FILE", help="What is done to the bodies: a file of actions, or a recording."),
]
_SHORTCUTS = {"duration": "seconds", "render.fps": "fps", "render.size": "size"}
_Item = TypeVar("_Item")
_Name = TypeVar("_Name", bound=StrEnum)


def load(
    source: str,
    assignments: list[str] | None,
    shortcuts: dict[str, Any] | None = None,
    fragments: list[Path] | None = None,
) -> Scene:
    """The scene of a name or path, with fragments laid over it, then ``KEY=VALUE`` changes, then options.

    Raises SceneError, with one line that says where the mistake is.
    """
    return scene_from_data(*scene_data(source, assignments, shortcuts, fragments))


def scene_data(
    source: str,
    assignments: list[str] | None,
    shortcuts: dict[str, Any] | None = None,
    fragments: list[Path] | None = None,
) -> tuple[dict[str, Any], dict[str, Any], str, dict[str, str], Path]:
    """The same, not made into a scene yet: what ``scene_from_data`` takes."""
    path = find_scene(source)
    data = read_toml(path)
    for fragment in fragments or []:
        data = lay_over(data, read_toml(fragment))
    overrides = dict(parse_assignment(text) for text in assignments or [])
    given = {key: value for key, value in (shortcuts or {}).items() if value is not None}
    options = {key: f"--{_SHORTCUTS[key]}" for key in given}
    name = " with ".join([source, *map(str, fragments or [])])
    return data, {**overrides, **given}, name, options, path.parent


@contextlib.contextmanager
def naming(scene: str) -> Iterator[None]:
    """Errors that say where in a scene something is wrong begin with that scene."""
    try:
        yield
    except SceneError as error:
        named = str(error).startswith(("actions", "bodies", "diagnostics", "solver"))
        raise SceneError(f"{scene}: {error}" if named else str(error)) from None


@contextlib.contextmanager
def ending(folder: Path) -> Iterator[None]:
    """A run that ends early says what it could not do until then, and where its results are."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        tell(getattr(interrupt, "__notes__", []))
        from sandbox.output.folder import CHECKPOINT, left_over

        if not (folder / CHECKPOINT).is_file() and not left_over(folder):
            raise SandboxError("interrupted before the first picture; nothing is kept") from None
        hint = f"--resume {folder} goes on from there"
        raise SandboxError(f"interrupted; {folder} holds what was simulated until then: {hint}") from None
    except DivergedError as error:
        tell(getattr(error, "__notes__", []))
        raise


told: set[str] = set()
"""Warnings that the command has printed."""


def tell(lines: Iterable[str]) -> None:
    """Print warnings on standard error, each once."""
    for line in lines:
        if line not in told:
            told.add(line)
            print(f"{WARNING}{line}", file=sys.stderr)


def act_on(scene: Scene, file: Path, seconds: float | None) -> tuple[Scene, Any]:
    """The scene with what a file does to it, and the header of that where it is a recording.

    A recording lasts as long as it did, unless ``seconds`` says otherwise.
    """
    from sandbox.recording import read, with_actions

    actions = read(file)
    acted = with_actions(scene, actions, str(file))
    if seconds is not None:
        acted = acted.model_copy(update={"duration": seconds})
    return acted, actions.recording


def contents(folder: Path) -> str:
    """What can be seen in a folder, for the last line of a command."""
    return ", ".join(sorted(path.name for path in folder.iterdir() if not path.name.startswith(".")))


def picture_size(text: str) -> list[int]:
    """WIDTHxHEIGHT as two numbers."""
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit()):
        raise SceneError(f"--size {text}: must be WIDTHxHEIGHT, such as 1280x720")
    return [int(width), int(height)]


def names(option: str, text: str | None, kind: type[_Name]) -> tuple[_Name, ...] | None:
    """A list of names, NAME,NAME; None where there is none."""
    if text is None:
        return None
    found = [name.strip() for name in text.split(",")]
    for name in found:
        if name not in tuple(kind):
            raise SceneError(f"{option} {name}: must be one of {', '.join(kind)}")
    return tuple(dict.fromkeys(kind(name) for name in found))


def numbers(option: str, text: str | None, parse: Callable[[str], _Item]) -> tuple[_Item, ...] | None:
    """A list of positive numbers, A,B; None where there is none."""
    if text is None:
        return None
    found = []
    for part in text.split(","):
        try:
            value = parse(part)
        except ValueError:
            raise SceneError(f"{option} {part.strip()}: must be numbers, such as 1,2") from None
        if not 0 < value < 1e9:  # type: ignore[operator]
            raise SceneError(f"{option} {part.strip()}: must be > 0")
        found.append(value)
    return tuple(dict.fromkeys(found))


def quantity(option: str, text: str | None, units: dict[str, float]) -> float | None:
    """A positive number with a unit, as a number of the unit that stands for 1; None where there is none."""
    if text is None:
        return None
    number = text.strip().rstrip("".join(units))
    unit = text.strip()[len(number) :]
    try:
        value = float(number) * units[unit]
    except (ValueError, KeyError):
        known = ", ".join(name or "no unit" for name in units)
        raise SceneError(f"{option} {text}: must be a number with {known}") from None
    if not 0.0 < value < 1e6:
        raise SceneError(f"{option} {text}: must be > 0")
    return value


def part_of_one(option: str, text: str | None) -> float | None:
    """A part of one, in percent or as a number below 1; None where there is none.

    Raises SceneError for a number of 1 and more without a unit: it may well be meant in percent.
    """
    part = quantity(option, text, {"%": 0.01, "": 1.0})
    if text is not None and part is not None and part >= 1.0 and not text.strip().endswith("%"):
        raise SceneError(f"{option} {text}: {part:g} is {100.0 * part:g} %; write {part:g}% or {0.01 * part:g}")
    return part
