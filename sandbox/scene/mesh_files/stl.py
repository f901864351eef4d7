"""STL, binary and ASCII: triangles that have their corners each to themselves.

Source: Stereolithography Interface Specification, 3D Systems, 1989.
"""

import re

import numpy as np

from sandbox.scene.lattice import FloatArray
from sandbox.scene.mesh_files.faces import BadFileError, RawMesh

_HEADER = 84
_SINGLE = 2.0**-23
_DIGITS = 1e-6
"""Of numbers in text: most programs write six or seven digits of each."""
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"(?mi)^[ \t]*vertex[ \t]+([^\r\n]*)")


def read_stl(data: bytes) -> RawMesh:
    """The triangles of an STL. Raises BadFileError."""
    count = int.from_bytes(data[80:_HEADER], "little")
    size = _HEADER + count * _FACET.itemsize
    is_text = data.lstrip(b"\xef\xbb\xbf \t\r\n")[:5].lower() == b"solid"
    if len(data) >= _HEADER and (len(data) == size or (not is_text and len(data) > size)):
        facets = np.frombuffer(data, dtype=_FACET, count=count, offset=_HEADER)
        spare = len(data) - size
        left_out = (f"{spare} bytes behind its end",) if spare else ()
        return _of(facets["corners"].astype(float).reshape(-1, 3), _SINGLE, left_out)
    if not is_text:
        if len(data) < _HEADER:
            raise BadFileError("is no STL: it is shorter than the head of one")
        raise BadFileError(
            f"ends early: it has room for {(len(data) - _HEADER) // _FACET.itemsize} of {count} triangles"
        )
    return _of(_text(data), _DIGITS)


def _text(data: bytes) -> FloatArray:
    """Corners of all facets, shape (3 T, 3)."""
    lines = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    rows = [row.split() for row in _VERTEX.findall(lines)]
    facets = len(re.findall(rb"(?mi)^[ \t]*endfacet", lines))
    try:
        corners = np.array([[float(word) for word in row] for row in rows]).reshape(-1, 3)
        if any(len(row) != 3 for row in rows):
            raise ValueError
    except ValueError:
        raise BadFileError("has a vertex that is not three numbers") from None
    if len(corners) != 3 * facets:
        raise BadFileError(f"is damaged: it has {len(corners)} corners of {facets} triangles")
    return corners


def _of(corners: FloatArray, step: float, left_out: tuple[str, ...] = ()) -> RawMesh:
    count = len(corners) // 3
    return RawMesh(corners, np.arange(3 * count), np.full(count, 3), step, left_out)
