"""PLY, ASCII and binary of either byte order: vertices, faces of any number of corners, triangle strips.

Source: G. Turk, "The PLY Polygon File Format", Stanford University, 1994.
"""

import codecs
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sandbox.scene.mesh_files.faces import BadFileError, Numbers, RawMesh, counted

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float16": "f2", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
_STEPS = {"f2": 2.0**-10, "f4": 2.0**-23}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")


@dataclass
class _Element:
    """One kind of thing in the file, as its head says, and then its numbers."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)
    """Name, type, and of a list the type of its length ("": no list) of every property."""
    values: dict[str, Any] = field(default_factory=dict)
    """Column of every property, shape (count,); of a list its entries and how many every row has."""


def read_ply(data: bytes) -> RawMesh:
    """The vertices and faces of a PLY. Raises BadFileError."""
    elements, order, body = _head(data.removeprefix(codecs.BOM_UTF8))
    rows = sum(element.count for element in elements if element.properties)
    stream = _Binary(body, order) if order else _Text(body, rows)
    for element in elements:
        try:
            stream.read(element)
        except (IndexError, ValueError, OverflowError, MemoryError):
            raise BadFileError(f"is damaged: its {element.name} data end early, or are no numbers") from None
    known = {element.name: element for element in elements}
    if "vertex" not in known or not {"x", "y", "z"} <= known["vertex"].values.keys():
        raise BadFileError("has no vertices with x, y and z")
    vertices = np.stack([known["vertex"].values[axis] for axis in "xyz"], axis=1).astype(float)
    corners, counts = _corners_of(known.get("face"))
    strips = _strips(*_corners_of(known.get("tristrips")))
    faces = [np.concatenate([corners, strips.reshape(-1)]), np.concatenate([counts, np.full(len(strips), 3)])]
    left_out = Counter({"face of fewer than 3 corners": int((counts < 3).sum())})
    if "edge" in known:
        left_out["edge"] = known["edge"].count
    kinds = [_STEPS.get(kind, 0.0) for name, kind, _ in known["vertex"].properties if name in ("x", "y", "z")]
    return RawMesh(vertices, faces[0], faces[1], max(kinds), counted(+left_out))


def _head(data: bytes) -> tuple[list[_Element], str, bytes]:
    """Elements, byte order ("" for text), and what follows the head."""
    end = re.search(rb"(?m)(?:^|\r)[ \t]*end_header[ \t]*(\r\n|\n|\r)", data)
    if not data.startswith(b"ply") or end is None:
        raise BadFileError("is no PLY: its head does not begin with ply or does not end")
    order, elements = None, []
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            match words:
                case ["format", kind, *_]:
                    order = _FORMATS[kind]
                case ["element", name, count]:
                    elements.append(_Element(name, int(count)))
                case ["property", "list", length, kind, name]:
                    elements[-1].properties.append((name, _TYPES[kind], _TYPES[length]))
                case ["property", kind, name]:
                    elements[-1].properties.append((name, _TYPES[kind], ""))
                case ["element" | "property" | "format", *_]:
                    raise ValueError
        except (KeyError, ValueError, IndexError):
            said = "".join(letter if letter.isprintable() else "?" for letter in " ".join(words)[:80])
            raise BadFileError(f"has a line in its head that is no PLY: {said}") from None
    if order is None or any(element.count < 0 for element in elements):
        raise BadFileError("is no PLY: its head names no format, or fewer than no elements")
    return elements, order, data[end.end() :]


class _Binary:
    """Reads elements one after the other out of bytes."""

    def __init__(self, data: bytes, order: str) -> None:
        self._data, self._order, self._at = data, order, 0

    def read(self, element: _Element) -> None:
        """Take the element's numbers. Raises ValueError where there are too few."""
        lists = [name for name, _, length in element.properties if length]
        # Most lists are as long in all rows as in the first.
        lengths = self._row(element) if lists and element.count else {}
        rows = self._table(element, lengths)
        if rows is None or any((rows[f"{name}#"] != lengths.get(name, 0)).any() for name in lists):
            self._ragged(element)
            return
        self._at += rows.nbytes
        for name, _, length in element.properties:
            column = rows[name]
            element.values[name] = (column.reshape(-1), np.full(len(rows), lengths.get(name, 0))) if length else column

    def _table(self, element: _Element, lengths: dict[str, int]) -> Any:
        """All rows if every list is as long as that, or None where so much is not there."""
        fields: list[tuple[Any, ...]] = []
        for name, kind, length in element.properties:
            if length:
                fields += [(f"{name}#", self._order + length), (name, self._order + kind, (lengths.get(name, 0),))]
            else:
                fields.append((name, self._order + kind))
        layout = np.dtype(fields)
        if layout.itemsize * element.count > len(self._data) - self._at:
            if not lengths:
                raise ValueError
            return None
        return np.frombuffer(self._data, layout, element.count, self._at) if layout.itemsize else np.zeros(0, layout)

    def _row(self, element: _Element) -> dict[str, int]:
        """Length of every list in the row that is next; goes nowhere."""
        at, lengths = self._at, {}
        for name, kind, length in element.properties:
            if length:
                own = np.dtype(self._order + length)
                lengths[name] = _length(np.frombuffer(self._data, own, 1, at)[0])
                at += own.itemsize + lengths[name] * int(kind[1])
            else:
                at += int(kind[1])
        return lengths

    def _ragged(self, element: _Element) -> None:
        """Row by row."""
        data, at, sign = self._data, self._at, {"<": "little", ">": "big"}[self._order]
        columns: dict[str, list[bytes]] = {name: [] for name, _, _ in element.properties}
        counts: dict[str, list[int]] = {name: [] for name, _, length in element.properties if length}
        plan = [
            (name, int(kind[1]), length, int(length[1]) if length else 0) for name, kind, length in element.properties
        ]
        for _ in range(element.count):
            for name, width, length, own in plan:
                number = 1
                if length:
                    # Lengths are whole numbers in every file that there is.
                    number = int.from_bytes(data[at : at + own], sign)  # type: ignore[arg-type]
                    counts[name].append(number)
                    at += own
                columns[name].append(data[at : at + number * width])
                at += number * width
            if at > len(data):
                raise ValueError
        self._at = at
        for name, kind, length in element.properties:
            column = np.frombuffer(b"".join(columns[name]), self._order + kind)
            element.values[name] = (column, np.array(counts[name], dtype=int)) if length else column


class _Text:
    """Reads elements one after the other out of lines, of which every row should be one, or else out of words."""

    def __init__(self, data: bytes, rows: int) -> None:
        """``rows``: number of rows of all elements."""
        lines = [words for words in map(bytes.split, data.splitlines()) if words]
        self._has_rows = len(lines) >= rows
        self._lines = lines if self._has_rows else [[word for words in lines for word in words]]
        self._row = self._at = 0

    def read(self, element: _Element) -> None:
        """Take the element's numbers. Raises ValueError or IndexError where there are too few."""
        columns: dict[str, list[bytes]] = {name: [] for name, _, _ in element.properties}
        counts: dict[str, list[int]] = {name: [] for name, _, length in element.properties if length}
        plan = [(columns[name], counts.get(name)) for name, _, _ in element.properties]
        for _ in range(element.count if plan else 0):
            words, at = self._lines[self._row], self._at
            for column, own in plan:
                number = 1
                if own is not None:
                    number = _length(float(words[at]))
                    own.append(number)
                    at += 1
                column += words[at : at + number]
                at += number
            if at > len(words):
                raise ValueError
            # Some programs write more in a row than they say in the head.
            self._row, self._at = (self._row + 1, 0) if self._has_rows else (0, at)
        for name, _, length in element.properties:
            values = np.array([float(word) for word in columns[name]])
            element.values[name] = (values, np.array(counts[name], dtype=int)) if length else values


def _length(value: Any) -> int:
    """The length of a list. Raises ValueError where it is none."""
    if not (value >= 0 and value == int(value)):
        raise ValueError
    return int(value)


def _corners_of(element: _Element | None) -> tuple[Numbers, Numbers]:
    """Vertices of all faces and how many each has; none of no element."""
    lists = [] if element is None else [name for name, _, length in element.properties if length]
    if element is None or element.count == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    name = next((name for name in _CORNERS if name in lists), lists[0] if len(lists) == 1 else None)
    if name is None:
        raise BadFileError(f"its {element.name} data have no list vertex_indices")
    corners, counts = element.values[name]
    whole = np.asarray(corners, dtype=np.int64)
    if (whole != corners).any():
        raise BadFileError(f"its {element.name} data name vertices that are no whole numbers")
    return whole, np.asarray(counts, dtype=np.int64)


def _strips(corners: Numbers, counts: Numbers) -> Numbers:
    """Triangles of strips, in which every vertex makes one with the two before it, and -1 begins anew; (T, 3)."""
    count = len(corners)
    if count < 3:
        return np.zeros((0, 3), dtype=np.int64)
    begins = np.zeros(count, dtype=bool)
    ends = np.cumsum(counts)
    begins[ends[ends < count]] = True
    begins[0] = True
    begins[1:] |= corners[:-1] == -1
    since = np.arange(count) - np.maximum.accumulate(np.where(begins, np.arange(count), 0))
    last = np.nonzero((since >= 2) & (corners != -1))[0]
    odd = since[last] % 2 == 1
    first, second = np.where(odd, last - 1, last - 2), np.where(odd, last - 2, last - 1)
    triangles = np.stack([corners[first], corners[second], corners[last]], axis=1)
    # Vertices twice in a row only turn the strip.
    return triangles[(np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)]
