"""Surfaces from mesh files: read, made sound, facing outward, and placed.

SciPy and trimesh take half a second each to import, and most scenes need neither: the functions that do import them.
"""

import hashlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.mesh_files.faces import BadFileError, RawMesh, counted
from sandbox.scene.mesh_files.facing import encloses, face_outward, gaps, is_closed, signed_volume
from sandbox.scene.mesh_files.obj import read_obj
from sandbox.scene.mesh_files.ply import read_ply
from sandbox.scene.mesh_files.stl import read_stl
from sandbox.scene.mesh_files.welding import distinct, welded, without_slivers
from sandbox.scene.model import Mesh, MeshCollider
from sandbox.scene.model.base import LARGEST

__all__ = ["Surface", "is_closed", "load_mesh", "load_surface", "signed_volume"]

MOST_TRIANGLES = 5_000_000
"""Most triangles of a mesh file."""
_USUAL = (1e-3, 50.0)
"""Sizes of things that people make and simulate [m]; others are as likely in other units."""
_MOST_KEPT = 4
"""Files kept as they were read: a collider is asked for by what checks, meets and draws it."""
_OTHERS = {"PointCloud": "cloud of points", "Path2D": "path", "Path3D": "path"}
_READERS: dict[str, Callable[[bytes], RawMesh]] = {".obj": read_obj, ".ply": read_ply, ".stl": read_stl}

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class Surface:
    """Triangles of a mesh file."""

    vertices: FloatArray
    """[m], shape (V, 3)."""
    triangles: IntArray
    """Shape (T, 3). Neighbors face the same way, and what is closed faces outward (walls of a hollow inward)."""
    gaps: str
    """Why it is not closed, and near which place of the file; "" where it is."""
    remarks: tuple[str, ...]
    """What is odd about it, one line each, beginning with the file's name."""

    @property
    def middle(self) -> FloatArray:
        """Middle of its box [m], shape (3,)."""
        return np.asarray(0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0)))


_kept: dict[tuple[str, bytes], Surface] = {}


def load_surface(part: Mesh | MeshCollider) -> Surface:
    """The surface of a body's or a collider's file, in metres and in its own frame.

    Its origin is the file's own, or the middle of its box where ``center`` says so.
    Raises SceneError ``FILE: what is wrong``.
    """
    found = _load(part.file)
    extent = float(np.ptp(found.vertices, axis=0).max())
    scale = part.scale if part.size is None else part.size / extent
    remarks = found.remarks
    if part.size is None and not _USUAL[0] <= extent * scale <= _USUAL[1]:
        remarks += (
            f"{part.file}: is {extent * scale:.3g} m long; if it is not meant to be, give size (its longest side)",
        )
    surface = Surface(found.vertices * scale, found.triangles, found.gaps, remarks)
    if not np.isfinite(surface.vertices).all():
        raise SceneError(f"{part.file}: is too large to compute with at a scale of {scale:.3g}")
    if not part.center:
        return surface
    return Surface(surface.vertices - surface.middle, surface.triangles, surface.gaps, surface.remarks)


def load_mesh(file: str, scale: float) -> tuple[FloatArray, IntArray]:
    """Vertices [m], shape (V, 3), and triangles, shape (T, 3), of a mesh file (OBJ, PLY, STL, ...).

    ``scale`` leads from the file's units to metres; the file's own origin is kept. All parts of the file make one
    mesh; vertices at the same place are one; triangles without area and repeated ones are gone, as far as that
    opens no gap. Neighboring triangles face the same way, and a closed mesh faces outward (the walls of a hollow
    inside it inward). Raises SceneError ``FILE: what is wrong``.
    """
    found = _load(file)
    return found.vertices * scale, found.triangles


def _load(file: str) -> Surface:
    """The surface of a file, in the file's own units. Raises SceneError."""
    path = Path(file)
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise SceneError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        # Other formats may name further files, which can change as well.
        return _sound(file, lambda: _read_other(file))
    key = (file, hashlib.sha256(data).digest())
    if key not in _kept:
        surface = _sound(file, lambda: reader(data))
        while len(_kept) >= _MOST_KEPT:
            _kept.pop(next(iter(_kept)))
        _kept[key] = surface
    return _kept[key]


def _sound(file: str, read: Callable[[], RawMesh]) -> Surface:
    """What a file has as one surface. Raises SceneError."""
    try:
        with np.errstate(all="ignore"):  # what overflows is found below
            raw = read()
            corners = raw.triangles()
    except BadFileError as error:
        raise SceneError(f"{file}: {error}") from None
    except Exception as error:  # readers of broken files raise whatever broke
        said = " ".join(str(error).split()) or type(error).__name__
        raise SceneError(f"{file}: is not a mesh that can be read: {said}") from None
    if len(corners) == 0:
        raise SceneError(f"{file}: has no triangles")
    if len(corners) > MOST_TRIANGLES:
        raise SceneError(f"{file}: has {len(corners)} triangles, at most {MOST_TRIANGLES} are taken")
    if not np.isfinite(raw.vertices[corners]).all():
        raise SceneError(f"{file}: has a vertex that is not finite")
    largest = float(np.abs(raw.vertices[corners]).max())
    if largest > LARGEST or 0.0 < largest < 1.0 / LARGEST:
        word = "large" if largest > 1.0 else "small"
        raise SceneError(f"{file}: its numbers reach {largest:.3g}, which is too {word} to compute with")
    vertices, triangles = welded(raw.vertices, corners.astype(np.int32), raw.step)
    vertices, triangles, hollows = _facing(vertices, triangles)
    if len(triangles):
        vertices, triangles = without_slivers(vertices, triangles)
    if len(triangles) == 0:
        raise SceneError(f"{file}: has no triangle with an area")
    remarks = []
    if raw.left_out:
        remarks.append(f"{file}: left out {', '.join(raw.left_out)}")
    if hollows:
        remarks.append(
            f"{file}: {hollows} closed part{'s' if hollows > 1 else ''} inside another taken as hollow; "
            "if it is solid there, take the inner one out of the file"
        )
    for values in (vertices, triangles):
        values.flags.writeable = False
    return Surface(vertices, triangles, gaps(vertices, triangles), tuple(remarks))


def _facing(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray, int]:
    """Repeated triangles taken out as far as that opens no gap, and all facing outward; and the number of hollows."""
    once = distinct(triangles, each_way=False)
    faced = face_outward(vertices, once) if len(once) else (once, 0)
    if len(once) == len(triangles) or is_closed(faced[0]):
        return vertices, *faced
    # Parts that touch in a face have it twice, once each way, and parts that share one even twice the same way.
    for candidate in (distinct(triangles, each_way=True), triangles):
        if encloses(vertices, candidate):
            return vertices, *face_outward(vertices, candidate)
    return vertices, *faced


def _read_other(file: str) -> RawMesh:
    """All triangles of a scene in any other format that trimesh reads."""
    import trimesh

    scene = trimesh.load(file, force="scene", process=False)
    vertices, triangles, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    left_out: Counter[str] = Counter()
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        part = scene.geometry[name]
        if not isinstance(part, trimesh.Trimesh):
            left_out[_OTHERS.get(type(part).__name__, "part without triangles")] += 1
            continue
        vertices.append(np.asarray(part.vertices, dtype=float) @ matrix[:3, :3].T + matrix[:3, 3])
        triangles.append(np.asarray(part.faces, dtype=np.int64).reshape(-1, 3) + count)
        count += len(vertices[-1])
    rows = np.concatenate(triangles)
    # Most such formats have numbers of single precision.
    return RawMesh(
        np.concatenate(vertices), rows.reshape(-1), np.full(len(rows), 3), 2.0**-23, left_out=counted(left_out)
    )
