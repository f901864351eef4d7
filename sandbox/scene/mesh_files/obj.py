"""Wavefront OBJ: vertices and faces; names, materials and texture coordinates are no geometry.

Source: "Object Files (.obj)", appendix B1 of the Advanced Visualizer manual, Wavefront Technologies, 1995.
"""

import codecs
import re
from collections import Counter

import numpy as np

from sandbox.scene.lattice import FloatArray
from sandbox.scene.mesh_files.faces import BadFileError, Numbers, RawMesh, counted

_NO_GEOMETRY = set(
    "v f fo vt vn vp vw g s o mg mtllib usemtl maplib usemap bevel c_interp d_interp lod shadow_obj trace_obj "
    "cstype deg bmat step end parm trim hole scrv sp con ctech stech".split()
)
"""Words whose lines are faces and vertices, or say nothing of where a surface is."""
_NAMES = {
    "l": "line",
    "p": "point",
    "curv": "curve of free form",
    "curv2": "curve of free form",
    "surf": "surface of free form",
    "call": "call of another file",
}
_STATEMENT = r"(?m)^[ \t\f\v]*%s[ \t\f\v]+([^\n]*)"
_SPACE = r"[ \t\f\v]"


def read_obj(data: bytes) -> RawMesh:
    """The vertices and faces of an OBJ. Raises BadFileError."""
    text = _plain(data)
    rows = list(re.finditer(_STATEMENT % "v", text))
    vertices = _vertices(text, rows)
    faces = list(re.finditer(_STATEMENT % "fo?", text))
    corners, counts = _faces(text, faces)
    if "-" in text and len(corners) and corners.min() < 0:
        # -1 is the last vertex so far, not of the file.
        so_far = np.searchsorted([row.start() for row in rows], [face.start() for face in faces])
        corners = np.where(corners < 0, corners + np.repeat(so_far, counts) + 1, corners)
        _check(text, faces, counts, corners >= 1, "counts back to a vertex before the first")
    _check(text, faces, counts, corners != 0, "names vertex 0; the first is 1")
    _check(
        text, faces, counts, corners <= len(vertices), f"names a vertex that is not there; there are {len(vertices)}"
    )
    others = Counter(re.findall(rf"(?m)^{_SPACE}*([^\s]+)", text))
    left_out = Counter({"face of fewer than 3 corners": int((counts < 3).sum())})
    for word, count in others.items():
        if word not in _NO_GEOMETRY:
            left_out[_NAMES.get(word, f"line of {word[:20]!r}")] += count
    return RawMesh(vertices, corners - 1, counts, left_out=counted(+left_out))


def _plain(data: bytes) -> str:
    """The text with comments and line continuations blanked out; every other character stays at its place."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = data.decode("utf-16", errors="replace")
    else:
        # Names may be in any encoding. Latin-1 knows every byte, and all have the same digits.
        text = data.removeprefix(codecs.BOM_UTF8).decode("latin-1")
    text = text.replace("\r\n", " \n").replace("\r", "\n")
    if "#" in text:
        text = re.sub(r"#[^\n]*", lambda found: " " * len(found[0]), text)
    return re.sub(rf"\\({_SPACE}*)\n", r" \1 ", text) if "\\" in text else text


def _vertices(text: str, rows: list[re.Match[str]]) -> FloatArray:
    """Places of all vertices, shape (V, 3); what follows the third number is a weight or a color."""
    words = [row[1].split() for row in rows]
    try:
        # Python, but no file format, reads 1_000 as a number.
        if any(len(own) < 3 for own in words) or ("_" in text and any("_" in w for own in words for w in own[:3])):
            raise ValueError
        numbers = np.fromiter((float(word) for row in words for word in row[:3]), float, 3 * len(rows))
    except ValueError:
        for row, own in zip(rows, words, strict=True):
            if len(own) < 3 or not all(map(_is_number, own[:3])):
                raise BadFileError(f"{_line(text, row)} is no vertex: it needs three numbers") from None
        raise
    return numbers.reshape(-1, 3)


def _faces(text: str, faces: list[re.Match[str]]) -> tuple[Numbers, Numbers]:
    """Vertices of all faces as they are written, and how many each has; texture and normal are left out."""
    words = [face[1].split() for face in faces]
    counts = np.array([len(own) for own in words], dtype=np.int64)
    try:
        if "_" in text and any("_" in word for own in words for word in own):
            raise ValueError
        numbers = np.fromiter((int(word.partition("/")[0]) for own in words for word in own), np.int64, counts.sum())
    except (ValueError, OverflowError):
        for face, own in zip(faces, words, strict=True):
            if not all(re.fullmatch(r"[-+]?[0-9]{1,18}(/.*)?", word) for word in own):
                raise BadFileError(f"{_line(text, face)} is no face: it needs numbers of vertices") from None
        raise
    return numbers, counts


def _check(text: str, faces: list[re.Match[str]], counts: Numbers, holds: np.ndarray, problem: str) -> None:
    """Raise BadFileError that names the first face with a corner for which something does not hold."""
    if not holds.all():
        face = int(np.searchsorted(np.cumsum(counts), np.argmin(holds), side="right"))
        raise BadFileError(f"{_line(text, faces[face])} {problem}")


def _line(text: str, found: re.Match[str]) -> str:
    return f"line {text.count(chr(10), 0, found.start()) + 1}"


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word
