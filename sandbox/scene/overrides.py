"""Changes of a scene's plain data by dotted keys: entries of lists by number, or by name where they have one."""

import copy
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from sandbox.errors import SceneError

_BRACKETS = re.compile(r"\[([^\[\]]*)\]")
_NUMBER = re.compile("[0-9]{1,9}")
_LISTS = ("bodies", "colliders", "attachments", "actions")
"""Lists of a scene; empty where it does not name them."""
TOO_LONG = "has a number of more digits than are read"
"""What is wrong where Python does not turn text into a whole number, which takes long from some thousand digits on."""
MOST_DEEP = 64
"""Most levels of tables and lists in a scene's data, which has nine."""
_MOST_BITS = 1024
"""Most binary digits of a whole number; decimal ones are counted where TOML is read."""
_MOST_NAMED = 20
"""Names that an error lists."""


def parse_assignment(text: str) -> tuple[str, Any]:
    """``KEY=VALUE`` of the command line -> (dotted key, value). The value is TOML; a bare word is text."""
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not key:
        raise SceneError(f"--set {text}: must be KEY=VALUE, such as solver.dt=1e-4")
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return key, value.strip()
    except ValueError:
        raise SceneError(f"--set {key}: {TOO_LONG}") from None


def check_data(data: Mapping[str, Any], source: str) -> None:
    """Raise SceneError where data have more levels than any scene, or numbers that cannot be written out again.

    Whoever goes through the levels may be recursive.
    """
    level: list[Any] = [data]
    for _ in range(MOST_DEEP):
        lists = (node.values() if isinstance(node, Mapping) else node for node in level)
        values = [value for nodes in lists for value in nodes]
        if any(isinstance(value, int) and value.bit_length() > _MOST_BITS for value in values):
            raise SceneError(f"{source}: {TOO_LONG}")
        level = [value for value in values if isinstance(value, Mapping | list | tuple)]
        if not level:
            return
    raise SceneError(f"{source}: is nested more than {MOST_DEEP} levels deep")


def change(data: dict[str, Any], key: str, value: Any) -> str:
    """Give a key of a scene's data another value; the key by numbers alone, such as bodies.0.color.

    Raises SceneError where the key leads nowhere.
    """
    parts: list[Any] = steps(data, key)
    node: Any = data
    for depth, part in enumerate(parts):
        if not isinstance(node, dict | list):
            raise SceneError(f"--set {key}: {dotted(parts[:depth])} is not a table")
        if depth == len(parts) - 1:
            node[part] = copy.deepcopy(value)
        elif isinstance(node, dict):
            node = node.setdefault(part, {})
        else:
            node = node[part]
    return dotted(parts)


def steps(data: Any, key: str) -> list[int | str]:
    """The parts of a dotted key, with numbers for the entries of lists.

    Raises SceneError where a part is empty, or a list has no entry of that number or name.
    """
    words = dotted_key(key).split(".")
    if "" in words:
        raise SceneError(f"--set {key}: has an empty part")
    if len(words) > MOST_DEEP:
        raise SceneError(f"--set {key}: has more than {MOST_DEEP} parts")
    parts: list[int | str] = []
    node, at = data, 0
    while at < len(words):
        part, taken = _step(node, words[at:], parts, key)
        parts.append(part)
        at += taken
        node = node.get(part) if isinstance(node, dict) else node[int(part)] if isinstance(node, list) else None
        if node is None and len(parts) == 1 and part in _LISTS:
            node = []
    return parts


def dotted_key(key: str) -> str:
    """A key with dots for brackets: bodies[0].color is bodies.0.color."""
    return _BRACKETS.sub(r".\1", key.strip())


def dotted(parts: list[int | str]) -> str:
    """Parts of a key as text: bodies.0.color."""
    return ".".join(map(str, parts))


def _step(node: Any, words: list[str], before: list[int | str], key: str) -> tuple[int | str, int]:
    """The next part of a key, and how many words it takes: names may have dots in them."""
    if not isinstance(node, list):
        return words[0], 1
    if _NUMBER.fullmatch(words[0]) and int(words[0]) < len(node):
        return int(words[0]), 1
    names = [dotted_key(_name(entry)) for entry in node]
    for taken in range(len(words), 0, -1):
        if (name := ".".join(words[:taken])) and name in names:
            return names.index(name), taken
    known = [name for entry in node if (name := _name(entry))]
    listed = ", ".join(known[:_MOST_NAMED]) + (", ..." if len(known) > _MOST_NAMED else "")
    where = f"--set {key}: {dotted([*before, words[0]])}"
    raise SceneError(f"{where}: there is no such entry; the list has {len(node)}{': ' if known else ''}{listed}")


def _name(entry: Any) -> str:
    """The name of a list's entry; empty where it has none."""
    name = entry.get("name") if isinstance(entry, dict) else None
    return name if isinstance(name, str) else ""
