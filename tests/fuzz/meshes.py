"""Mesh files of every format that is read, as bodies and as colliders."""

import functools
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from hypothesis import strategies as st

from sandbox.scene.assemble import assemble
from sandbox.scene.load import scene_from_data
from sandbox.scene.mesh_file import load_surface
from tests.fuzz import odd
from tests.fuzz.inputs import Input, Kind, Wrong
from tests.scene.test_mesh_variants import POINTS, REFUSED, TRIANGLES, VARIANTS

_WORDS = (
    b"-1", b"0", b"1e400", b"nan", b"-inf", b"99999999999999999999", b"4294967295",
    b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"f ", b"v ", b"f 1 2 3 4 5 6 7 8 9\n",
    b"\n", b"\\\n", b"#", b"\x00", b"\xff", b"1_0", b"end_header\n", b"solid",
    b"property list uchar int q\n", b"property list double double vertex_indices\n", b"element face 999999999\n",
    b"element vertex 1000000000000\n", b"element face -1\n", b"format ascii 1.0\n", b"endfacet\n", b"endsolid",
    b"/", b"//", b"mtllib /dev/zero\n", b"0x1p3", b"1e-320", b"\xc2\xb2", b'"count":1000000000', b'"byteLength":-1',
    b'"uri":"x.bin"',    b'"uri":"/dev/zero"', b"VEC3", b"5126", b"null", b"[", b"]", b"{", b"}",
)  # fmt: skip


@functools.cache
def files() -> tuple[Input, ...]:
    """Meshes in all ways that programs write them, good ones and bad ones."""
    own = [
        (f".{ending}", content.encode("latin-1") if isinstance(content, str) else content)
        for ending, content, _ in [*VARIANTS.values(), *REFUSED.values()]
    ]
    block = trimesh.Trimesh(POINTS, np.array(TRIANGLES), process=False)
    others = [(f".{ending}", block.export(file_type=ending)) for ending in ("off", "glb")]
    parts = trimesh.Scene([block]).export(file_type="gltf")
    buffers = {name: data for name, data in parts.items() if name != "model.gltf"}
    others.append((".gltf", _embedded(parts["model.gltf"], buffers)))
    odd_ones = [
        (".zip", b"PK\x05\x06" + bytes(18)),
        (".xyz", b"0 0 0\n1 0 0\n"),
        (".dxf", b"0\nSECTION\n"),
        (".stl", b""),
    ]
    written = [*own, *others, *odd_ones, (".exe", b"MZ"), ("", b"v 0 0 0\n"), (".OBJ", own[0][1])]
    return tuple(Input(suffix, data.encode() if isinstance(data, str) else bytes(data)) for suffix, data in written)


def _embedded(model: bytes, buffers: dict[str, bytes]) -> bytes:
    """A glTF with its buffers inside."""
    import base64

    for name, data in buffers.items():
        coded = b"data:application/octet-stream;base64," + base64.b64encode(data)
        model = model.replace(name.encode(), coded)
    return bytes(model)


@st.composite
def _broken(draw: Any) -> Input:
    found = files()[draw(st.integers(0, len(files()) - 1))]
    suffix = draw(st.sampled_from([found.suffix] * 19 + [".ply"]))
    return Input(suffix, odd.damaged(draw, found.data, _WORDS))


def _take(path: Path) -> None:
    """As a body that is filled, as one that is a shell, and as a collider, of a size that suits."""
    part = {"kind": "mesh", "file": str(path), "size": 1.0}
    soft = {"stiffness": 100.0, "mass": 1.0}
    shell = {"name": "shell", "shape": {**part, "fill": "shell", "bend": 0.1}, "material": soft}
    scene = scene_from_data({"dimension": 3, "bodies": [shell], "colliders": [part]}, None)
    surface = load_surface(scene.bodies[0].shape)  # type: ignore[arg-type]
    if not np.isfinite(surface.vertices).all() or surface.triangles.max() >= len(surface.vertices):
        raise Wrong("is a mesh that is not finite, or of vertices that are not there")
    _check(assemble(scene))
    solid = {"name": "solid", "shape": {**part, "cells": 6}, "material": soft}
    _check(assemble(scene_from_data({"dimension": 3, "bodies": [solid]}, None)))


def _check(assembly: Any) -> None:
    if not (
        np.isfinite(assembly.positions).all() and np.isfinite(assembly.masses).all() and (assembly.masses > 0.0).all()
    ):
        raise Wrong("is a body whose places or masses are none")


def _prepare() -> None:
    import scipy.ndimage
    import scipy.sparse.csgraph
    import scipy.spatial  # noqa: F401


MESHES = Kind("meshes", _broken, _take, short=60, prepare=_prepare)
