"""One solid, written in all the ways that programs write mesh files: always the same volume, or a true reason."""

import itertools
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sandbox.errors import SceneError
from sandbox.scene.assemble import assemble
from sandbox.scene.model import Scene

# An L of two bars with a hole through one of them: outer corners, then those of the hole, counter-clockwise [m].
AROUND = [(0, 0), (0.31, 0), (0.31, 0.12), (0.13, 0.12), (0.13, 0.27), (0, 0.27)]
PLAN = np.array([*AROUND, (0.03, 0.05), (0.08, 0.05), (0.08, 0.2), (0.03, 0.2)])
HEIGHT = 0.11
VOLUME = (0.31 * 0.12 + 0.13 * 0.15 - 0.05 * 0.15) * HEIGHT
"""[m^3]"""
POINTS = np.array([[x, y, z] for z in (0.0, HEIGHT) for x, y in PLAN])
OUTER, HOLE = [*range(6)], [9, 8, 7, 6]
SIDES = [[a, b, b + 10, a + 10] for loop in (OUTER, HOLE) for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)]
CAP = [[0, 1, 7], [0, 7, 6], [1, 3, 7], [1, 2, 3], [7, 3, 8], [3, 4, 8], [4, 5, 9], [4, 9, 8], [5, 0, 6], [5, 6, 9]]
KEYHOLE = [0, 1, 2, 3, 4, 5, 0, 6, 9, 8, 7, 6]
"""The cap as one face, with a bridge to the hole."""
Faces = Sequence[Sequence[int]]


def both_caps(cap: Faces) -> list[list[int]]:
    return [[c + 10 for c in face] for face in cap] + [list(face)[::-1] for face in cap]


TRIANGLES = both_caps(CAP) + [t for a, b, c, d in SIDES for t in ([a, b, c], [a, c, d])]
QUADS = both_caps(CAP) + SIDES
POLYGONS = both_caps([KEYHOLE]) + SIDES


def obj(faces: Faces = TRIANGLES, points: Any = POINTS, form: str = "{}", first: int = 1, number: str = "{!r}") -> str:
    lines = ["v " + " ".join(number.format(float(x)) for x in point) for point in points]
    lines += ["f " + " ".join(form.format(corner + first) for corner in face) for face in faces]
    return "\n".join(lines) + "\n"


def in_blocks(faces: Faces = TRIANGLES) -> str:
    """Every face after vertices of its own, named from the last one back."""
    return "".join(obj([range(-len(face), 0)], POINTS[list(face)], first=0) for face in faces)


def stl(
    points: Any = POINTS, triangles: Faces = TRIANGLES, header: bytes = b"made by hand", tail: bytes = b""
) -> bytes:
    corners = np.asarray(points, dtype="<f4")[np.asarray(triangles)]
    rows = [np.zeros(3, "<f4").tobytes() + own.tobytes() + b"\0\0" for own in corners]
    return header.ljust(80, b"\0") + struct.pack("<I", len(rows)) + b"".join(rows) + tail


def nudged(steps: int) -> bytes:
    """Binary STL whose corners are off by so many steps of single precision, each triangle by its own."""
    corners = (POINTS + 0.07).astype("<f4")[np.array(TRIANGLES)]
    ways = np.random.default_rng(3).integers(-1, 2, corners.shape)
    for _ in range(steps):
        corners = np.where(ways > 0, np.nextafter(corners, np.float32(9)), corners)
    return stl(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3).tolist())


def stl_text(name: str = "block", number: str = "{:.6e}", upper: bool = False, end: str = "\n") -> bytes:
    lines = [f"solid {name}"]
    for face in TRIANGLES:
        lines += ["facet normal 0 0 0", "  outer loop"]
        lines += ["    vertex " + " ".join(number.format(x) for x in POINTS[corner]) for corner in face]
        lines += ["  endloop", "endfacet"]
    text = end.join([*lines, f"endsolid {name}", ""])
    return (text.upper() if upper else text).encode("latin-1")


def ply(
    faces: Faces = TRIANGLES,
    form: str = "ascii",
    points: Any = POINTS,
    name: str = "vertex_indices",
    real: str = "double",
    more: str = "",
    extra: tuple[str, list[list[float]]] = ("", []),
    end: str = "\n",
) -> bytes:
    """A PLY; ``more`` are whole-number properties of vertices before x, ``extra`` a head and rows of an element."""
    mark = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    head = ["ply", f"format {form} 1.0", "comment by hand", "obj_info none", f"element vertex {len(points)}"]
    head += [f"property int {own}" for own in more.split()] + [f"property {real} {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", f"property list uchar int {name}"]
    head += [extra[0]] if extra[0] else []
    code = {"double": "d", "float": "f"}[real]
    plan = [("i" * len(more.split()) + code * 3, [*[7] * len(more.split()), *point]) for point in points]
    plan += [("B" + "i" * len(face), [len(face), *face]) for face in faces]
    plan += [("i" * len(row), row) for row in extra[1]]
    if mark:
        body = b"".join(struct.pack(mark + codes, *values) for codes, values in plan)
    else:
        body = "".join(
            " ".join(map(repr, map(float, row) if "d" in codes else row)) + end for codes, row in plan
        ).encode()
    return (end.join([*head, "end_header", ""])).encode() + body


def flipped(share: float, faces: Faces = TRIANGLES) -> list[Sequence[int]]:
    random = np.random.default_rng(5).random(len(faces))
    return [face[::-1] if r < share else face for face, r in zip(faces, random, strict=True)]


def unmerged(faces: Faces = TRIANGLES) -> tuple[Any, list[list[int]]]:
    corners = [corner for face in faces for corner in face]
    starts = np.cumsum([0] + [len(face) for face in faces])
    return POINTS[corners], [list(range(a, b)) for a, b in itertools.pairwise(starts)]


def split(sliver: bool) -> str:
    """One edge divided on one of its sides: a T-joint, which a triangle without area may close."""
    a, b, c = TRIANGLES[0]
    middle = len(POINTS)
    faces = [[a, middle, c], [middle, b, c], *TRIANGLES[1:], *([[a, b, middle]] if sliver else [])]
    return obj(faces, np.vstack([POINTS, 0.5 * (POINTS[a] + POINTS[b])]))


MOVED = POINTS @ np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]]) + 0.3
EDGES = ("element edge 2\nproperty int vertex1\nproperty int vertex2", [[0, 1], [1, 2]])
BODY = "ply"
VARIANTS: dict[str, tuple[str, str | bytes, float]] = {
    "triangles": ("obj", obj(), 1.0),
    "quads and triangles": ("obj", obj(QUADS), 1.0),
    "faces of any number of corners": ("obj", obj(POLYGONS), 1.0),
    "polygons askew in space, rounded": ("obj", obj(POLYGONS, MOVED, number="{:.5f}"), 1.0),
    "relative indices": ("obj", obj(POLYGONS, first=-20), 1.0),
    "relative indices in blocks": ("obj", in_blocks(), 1.0),
    "relative indices in blocks of polygons": ("obj", in_blocks(POLYGONS), 1.0),
    "textures and normals": ("obj", "vt 0 0\nvn 0 0 1\n" + obj(QUADS, form="{}/1/1"), 1.0),
    "normals only": ("obj", "vn 0 0 1\n" + obj(form="{}//1"), 1.0),
    "relative textures": ("obj", "vt 0 0\n" + obj(form="{}/-1"), 1.0),
    "faces before vertices": ("obj", "".join(sorted(obj().splitlines(True), key=lambda row: row[0])), 1.0),
    "colors": ("obj", obj().replace("\nf", " 1 0 0\nf", 1), 1.0),
    "weights": ("obj", "\n".join(f"{row} 1.0" if row[:1] == "v" else row for row in obj().split("\n")), 1.0),
    "scientific numbers": ("obj", obj(number="{:+.17E}"), 1.0),
    "numbers without a zero": ("obj", obj().replace(" 0.", " ."), 1.0),
    "comments at ends": ("obj", obj().replace("\n", " # v 9 9 9 \\\n"), 1.0),
    "tabs": ("obj", obj().replace(" ", "\t \t"), 1.0),
    "indents and blank lines": ("obj", obj().replace("\n", "\n\n \t"), 1.0),
    "ends of lines of Windows": ("obj", obj().replace("\n", "\r\n"), 1.0),
    "ends of lines of old Macs": ("obj", obj().replace("\n", "\r"), 1.0),
    "no end of the last line": ("obj", obj().rstrip(), 1.0),
    "byte order mark": ("obj", b"\xef\xbb\xbf" + obj().encode(), 1.0),
    "sixteen bits a character": ("obj", obj().encode("utf-16"), 1.0),
    "Latin-1 names": ("obj", "o Gehäuse\n# größe\n".encode("latin-1") + obj().encode(), 1.0),
    "names of all bytes": ("obj", b"g " + bytes(range(128, 256)) + b"\n" + obj().encode(), 1.0),
    "continued lines": ("obj", obj(POLYGONS).replace(" 1 ", " \\\n1 \\\r\n ").replace("0.31", "\\\n0.31"), 1.0),
    "groups and materials": ("obj", "mtllib none.mtl\no a\ng b c\ns off\nusemtl m\n" + obj(), 1.0),
    "lines and points": ("obj", obj() + "l 1 2 3\np 4\n", 1.0),
    "vertices of nothing": ("obj", "v 7 7 7\n" + obj(first=2) + "v nan 0 0\n", 1.0),
    "corners twice in a row": ("obj", obj([[*face, face[-1]] for face in TRIANGLES]), 1.0),
    "unmerged": ("obj", obj(unmerged()[1], unmerged()[0]), 1.0),
    "unmerged polygons": ("obj", obj(unmerged(POLYGONS)[1], unmerged(POLYGONS)[0]), 1.0),
    "faces twice": ("obj", obj(TRIANGLES + TRIANGLES[3:20]), 1.0),
    "all faces from both sides": ("obj", obj(TRIANGLES + flipped(1.0)), 1.0),
    "inside out": ("obj", obj(flipped(1.0)), 1.0),
    "some faces inside out": ("obj", obj(flipped(0.3)), 1.0),
    "a sheet with two faces beside it": ("obj", obj([*TRIANGLES, [0, 1, 9], [9, 1, 0]]), 1.0),
    "triangles without area": ("obj", obj([*TRIANGLES, [0, 0, 1], [3, 4, 3], [2, 2, 2]]), 1.0),
    "a sliver in a joint": ("obj", split(True), 1.0),
    "millimetres": ("obj", obj(points=1e3 * POINTS), 1e-3),
    "kilometres": ("obj", obj(points=1e-3 * POINTS), 1e3),
    "far from the origin": ("obj", obj(points=POINTS + 1e4), 1.0),
    "STL": ("stl", stl(), 1.0),
    "STL that begins as text does": ("stl", stl(header=b"solid but binary"), 1.0),
    "STL and more behind it": ("stl", stl(tail=b"more"), 1.0),
    "STL one step apart": ("stl", nudged(1), 1.0),
    "STL three steps apart": ("stl", nudged(3), 1.0),
    "STL in millimetres": ("stl", stl(1e3 * POINTS), 1e-3),
    "STL inside out": ("stl", stl(triangles=flipped(1.0)), 1.0),
    "STL as text": ("stl", stl_text(), 1.0),
    "STL as text of four digits": ("stl", stl_text(number="{:.4g}"), 1.0),
    "STL as text, names of keywords": ("stl", stl_text("vertex facet endsolid normal"), 1.0),
    "STL as text, Latin-1": ("stl", stl_text("Gehäuse"), 1.0),
    "STL as text, capitals": ("stl", stl_text(upper=True), 1.0),
    "STL as text of Windows": ("stl", stl_text(end="\r\n"), 1.0),
    "PLY": (BODY, ply(), 1.0),
    "PLY of Windows": (BODY, ply(end="\r\n"), 1.0),
    "PLY, least byte first": (BODY, ply(form="binary_little_endian"), 1.0),
    "PLY, greatest byte first": (BODY, ply(form="binary_big_endian"), 1.0),
    "PLY of single precision": (BODY, ply(form="binary_big_endian", real="float"), 1.0),
    "PLY of mixed faces": (BODY, ply(POLYGONS + TRIANGLES[:1] * 0), 1.0),
    "PLY of mixed faces, binary": (BODY, ply(QUADS, form="binary_little_endian"), 1.0),
    "PLY of polygons, greatest byte first": (BODY, ply(POLYGONS, form="binary_big_endian"), 1.0),
    "PLY with vertex_index": (BODY, ply(name="vertex_index"), 1.0),
    "PLY with a list of another name": (BODY, ply(name="corners", form="binary_little_endian"), 1.0),
    "PLY with more numbers": (BODY, ply(more="id flags", form="binary_little_endian"), 1.0),
    "PLY with edges": (BODY, ply(extra=EDGES), 1.0),
    "PLY with edges, binary": (BODY, ply(extra=EDGES, form="binary_big_endian"), 1.0),
    "PLY with faces of two and one corners": (BODY, ply([[0], [0, 1], *TRIANGLES], form="binary_little_endian"), 1.0),
    "PLY unmerged": (BODY, ply(unmerged()[1], points=unmerged()[0], form="binary_little_endian"), 1.0),
    "PLY of strips": (BODY, ply([*TRIANGLES[4:]], "ascii",
                                extra=("element tristrips 1\nproperty list int int vertex_indices",
                                       [[15, *(i for t in TRIANGLES[:4] for i in (*t, -1))][:16]])), 1.0),
}  # fmt: skip


def write(folder: Path, ending: str, content: str | bytes) -> str:
    path = folder / f"solid.{ending}"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return str(path)


def assembled(file: str, **shape: Any) -> Any:
    body = {
        "name": "solid",
        "shape": {"kind": "mesh", "file": file, "cells": 9, **shape},
        "material": {"youngs_modulus": 1e5, "density": 700.0},
    }
    return assemble(Scene.model_validate({"dimension": 3, "duration": 1.0, "bodies": [body]}))


@pytest.mark.parametrize("variant", VARIANTS)
def test_one_solid_in_many_files(variant: str, tmp_path: Path) -> None:
    ending, content, scale = VARIANTS[variant]
    assembly = assembled(write(tmp_path, ending, content), scale=scale)
    digits = 2e-3 if "four digits" in variant else 2e-4 if "rounded" in variant else 1e-6
    assert assembly.masses.sum() / 700.0 == pytest.approx(VOLUME, rel=digits)


REFUSED: dict[str, tuple[str, str | bytes, str]] = {
    "a face missing": ("obj", obj(TRIANGLES[1:]), r"3 edges with a triangle on one side only, one near \("),
    "a T-joint": ("obj", split(False), r"3 edges with a triangle on one side only, one near \("),
    "a wall inside": ("obj", obj([*TRIANGLES, [0, 1, 15]]), r"where 3 triangles meet whose sides do not pair up"),
    "vertex 0": ("obj", obj(first=0), r"line \d+ names vertex 0; the first is 1"),
    "a vertex too many": ("obj", obj(first=3), r"line \d+ names a vertex that is not there; there are 20"),
    "back too far": ("obj", obj(first=-24), r"line \d+ counts back to a vertex before the first"),
    "decimal commas": ("obj", obj().replace("0.", "0,"), r"line 1 is no vertex: it needs three numbers"),
    "two numbers": ("obj", "# first\nv 0 0\n" + obj(), r"line 2 is no vertex: it needs three numbers"),
    "names for corners": ("obj", obj() + "f one two three\n", r"line \d+ is no face: it needs numbers of vertices"),
    "not finite": ("obj", obj().replace("0.31", "inf"), r"has a vertex that is not finite"),
    "STL cut off": ("stl", stl()[:-60], r"ends early: it has room for \d+ of 40 triangles"),
    "STL as text cut off": ("stl", stl_text()[:-90], r"is damaged: it has \d+ corners of \d+ triangles"),
    "PLY cut off": (BODY, ply(form="binary_little_endian")[:-7], r"is damaged: its face data end early"),
    "PLY as text cut off": (BODY, ply()[:-9], r"is damaged: its face data end early"),
    "PLY without faces": (BODY, ply([]), r"has no triangles"),
    "PLY with a vertex too many": (BODY, ply([*TRIANGLES, [0, 1, 20]]), r"a face names a vertex that is not there"),
}


@pytest.mark.parametrize("variant", REFUSED)
def test_what_is_refused_is_refused_by_its_reason(variant: str, tmp_path: Path) -> None:
    ending, content, reason = REFUSED[variant]
    with pytest.raises(SceneError, match=reason) as error:
        assembled(write(tmp_path, ending, content))
    assert "\n" not in str(error.value)
