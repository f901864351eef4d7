"""What is odd: values, words and bytes that no file should have, and trees of data with some of them put in.

Everything is drawn from lists: threads of Taichi flush subnormal numbers, and hypothesis makes none in their process.
"""

import copy
import datetime
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import tomli_w
from hypothesis import strategies as st

_RAW = "\ue000raw:"
"""Begins texts that are written without quotes: TOML that no value of Python is written as."""
NUMBERS: tuple[Any, ...] = (
    0, -1, 1, 2, 3, 7, 10**6, 2**31, 2**63, 2**64, -(2**63), 10**15, 10**16, 10**30, 10**400, -(10**400), 0.0, -0.0,
    0.5, -0.5, 1e-3, 1e3, 1e6, -1e6, 1e9, 1e15, -1e15, 1e-18, 1e-19, 1e-9, 5e-324, -5e-324, 2.2e-308, 1e38, 3.5e38,
    1e308, -1e308, math.inf, -math.inf, math.nan, 0.1 + 0.2, 1.0000000000000002, 4096, 4097, 100_001, 20_000_000,
)  # fmt: skip
TEXTS: tuple[str, ...] = (
    "", " ", "\u00b2", "\u0661", "1", "-1", "nan", "auto", "none", "true", "\x00", "\x1b[31mred\x1b[0m", "a\nb",
    "a\r\nb", "\u2028", "\u0085", "\u202e\u05d0\u05d1", "\ufeff", "\U0001f600", "e\u0301" * 40, "x" * 10_000, "\ud7ff",
    "a.b", "a[0]", "..", "../../etc/passwd", "/dev/null", "/dev/zero", "~", "%s%n", "{got}", "{0}", "'", '"', "\\",
    "#fff", "box", "block.obj", "BLOCK.OBJ", ".", "file\x00.obj", "x" * 300 + ".obj",
    "__class__", "f32", "rescue", "\x7f", "\x9b31m",
)  # fmt: skip
OTHERS: tuple[Any, ...] = (
    True, False, [], {}, [[]], [{}], [1.0], [0.0, 0.0], [0.0, 1.0], [0.0, 0.0, 0.0], [1e15, -1e15], [math.nan, 0.0],
    [1, "a", True], [[0, 1]], {"kind": "box"}, {"kind": []}, {"": ""}, {"a": {"b": {}}}, ["x"] * 300, [0.0] * 3000,
    {"min": [0.0, 0.0], "max": [1.0, 1.0]}, {"min": [1.0, 1.0], "max": [0.0, 0.0]},
    datetime.date(1979, 5, 27), datetime.time(7, 32), datetime.datetime(1979, 5, 27, 7, 32),
)  # fmt: skip
_TOML_ONLY = tuple(
    _RAW + text
    for text in (
        "9" * 5000, "-" + "9" * 4299, "0x" + "f" * 5000, "0b1", "0o777", "1e99999", "-nan", "1_000", "9" * 4000 + ".0",
        "[" * 40 + "]" * 40, "[" * 70 + "]" * 70, "[" * 3000 + "]" * 3000, "{a=" * 60 + "1" + "}" * 60, '"\\ud800"',
        "0." + "0" * 4000 + "1", "'''a\nb'''",
    )
)  # fmt: skip
KEYS = (
    "",
    "name",
    "kind",
    "a b",
    "\u00b2",
    "x" * 500,
    "a.b",
    "bodies",
    "from",
    "start",
    "\x1b[31m",
    "__proto__",
    "é",
    "size",
)
WAYS = ("odd", "odd", "odd", "scale", "scale", "like", "like", "like", "delete", "double", "swap", "add", "wrap")
GENTLE_WAYS = ("number", "number", "scale", "like", "like", "delete", "double")
"""Ways that often make another good tree."""
_ALLOWED = (
    0.0, 1.0, -1.0, 0.5, 2.0, 1e15, -1e15, 1e-18, 1e-12, 1e-6, 1e-3, 1e3, 1e6, 1e9, 1e12, 0, 1, 2, 3, 4, 8, 16, 50,
)  # fmt: skip
"""Numbers that most places of a scene may have."""
_FACTORS = (-1.0, 0.0, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 2.0, 10.0, 1e3, 1e6, 1e12)

values = st.one_of(*(st.sampled_from(some) for some in (NUMBERS, NUMBERS, TEXTS, OTHERS)))
"""Values of any type."""
toml_values = st.one_of(values, values, st.sampled_from(_TOML_ONLY))
"""The same, and what only TOML can say; for :func:`toml`."""


def changed(seeds: Sequence[Any], odd: Any = toml_values, most: int = 4, ways: Sequence[str] = WAYS) -> Any:
    """Draws one of some trees of tables and lists, with up to so many changes made to it, in some ways."""
    pool = _pool(seeds)

    @st.composite
    def tree_of(draw: Any) -> Any:
        tree = copy.deepcopy(seeds[draw(st.integers(0, len(seeds) - 1))])
        for _ in range(draw(st.sampled_from([n for n in (1, 1, 1, 2, 2, 3, 4) if n <= most]))):
            spots = list(_spots(tree))
            if not spots:
                return copy.deepcopy(draw(odd))
            node, key = spots[draw(st.integers(0, len(spots) - 1))]
            _change(draw, node, key, pool, odd, ways)
        return tree

    return tree_of()


def _spots(node: Any) -> Iterator[tuple[Any, Any]]:
    """Every place of a tree: the table or list, and the key in it."""
    for key, value in list(node.items() if isinstance(node, dict) else enumerate(node)):
        yield node, key
        if isinstance(value, dict | list):
            yield from _spots(value)


def _change(draw: Any, node: Any, key: Any, pool: dict[str, list[Any]], odd: Any, ways: Sequence[str]) -> None:
    """Put something else at a place of a tree, take it away, or move it."""
    value = node[key]
    match draw(st.sampled_from(ways)):
        case "scale" if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300:
            scaled = value * draw(st.sampled_from(_FACTORS))
            node[key] = type(value)(scaled) if math.isfinite(scaled) else value
        case "number" if isinstance(value, int | float) and not isinstance(value, bool):
            node[key] = draw(st.sampled_from([number for number in _ALLOWED if type(number) is type(value)]))
        case "like" | "number" if key in pool:
            # What other scenes have there fits, so that what is odd comes to those who look deeper.
            node[key] = copy.deepcopy(pool[key][draw(st.integers(0, len(pool[key]) - 1))])
        case "add" if isinstance(value, dict):
            name = draw(st.sampled_from(sorted(pool)))
            value[name] = copy.deepcopy(pool[name][draw(st.integers(0, len(pool[name]) - 1))])
        case "delete":
            del node[key]
        case "double" if isinstance(node, list):
            node.insert(key, copy.deepcopy(value))
        case "double":
            node[draw(st.sampled_from(KEYS))] = copy.deepcopy(value)
        case "swap":
            others = list(node) if isinstance(node, dict) else range(len(node))
            other = others[draw(st.integers(0, len(others) - 1))]
            node[key], node[other] = node[other], node[key]
        case "wrap":
            several = draw(st.sampled_from([0, 1, 2, 50]))
            node[key] = [copy.deepcopy(value) for _ in range(several)] if several else {"a": value}
        case _:
            node[key] = copy.deepcopy(draw(odd))


def _pool(seeds: Sequence[Any]) -> dict[str, list[Any]]:
    """Every value that a key has in some trees."""
    pool: dict[str, list[Any]] = {}
    for node, key in itertools.chain.from_iterable(map(_spots, seeds)):
        if isinstance(node, dict):
            pool.setdefault(key, []).append(node[key])
    return pool


def toml(data: Any) -> bytes:
    """Data as TOML, with what is raw as it is; of what is no table, its own text."""
    if not isinstance(data, dict):
        return repr(data).encode("utf-8", "replace")
    texts: list[str] = []
    text = tomli_w.dumps(_marked(data, texts))
    for number, raw in enumerate(texts):
        text = text.replace(f'"{_RAW}{number}:"', raw)
    return text.encode("utf-8", "surrogatepass")


def _marked(node: Any, texts: list[str]) -> Any:
    """The same data with numbered marks for what is raw, and for numbers too long to be written as others are."""
    if isinstance(node, dict):
        return {str(key): _marked(value, texts) for key, value in node.items()}
    if isinstance(node, list | tuple):
        return [_marked(value, texts) for value in node]
    if isinstance(node, str) and node.startswith(_RAW):
        texts.append(node.removeprefix(_RAW))
        return f"{_RAW}{len(texts) - 1}:"
    return node


BYTES = (
    b"", b"\x00", b"\xff", b"\xff\xfe", b"\n", b"\r", b"=", b"[", b"]", b"[[", b"{", b'"', b"'''", b"#", b".", b"-",
    b"e9", b"9999999999", b"nan", b"\xed\xa0\x80", b"\xe2\x80\xae", b"\x1b[2J", b"0x", b"\\u0000", b"\\", b" " * 300,
)  # fmt: skip


def broken(contents: Sequence[bytes], words: Sequence[bytes] = BYTES) -> Any:
    """Draws one of some files with bytes changed, put in, taken out, repeated or cut off."""

    @st.composite
    def file(draw: Any) -> bytes:
        return damaged(draw, contents[draw(st.integers(0, len(contents) - 1))], words)

    return file()


def damaged(draw: Any, content: bytes, words: Sequence[bytes] = BYTES) -> bytes:
    """A file with some damage."""
    data = bytearray(content)
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3, 8]))):
        at = draw(st.integers(0, len(data)))
        length = draw(st.sampled_from([0, 1, 1, 2, 5, 30, 200]))
        match draw(st.sampled_from(["flip", "word", "word", "delete", "repeat", "move", "end"])):
            case "flip" if at < len(data):
                data[at] ^= 1 << draw(st.integers(0, 7))
            case "word":
                data[at : at + length] = draw(st.sampled_from(words))
            case "delete":
                del data[at : at + length]
            case "repeat":
                data[at:at] = data[at : at + length] * draw(st.sampled_from([1, 2, 50]))
            case "move":
                other = draw(st.integers(0, len(data)))
                data[other:other] = data[at : at + length]
            case "end" if draw(st.booleans()):
                del data[at:]
    return bytes(data)
