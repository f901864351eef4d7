"""PLY and OBJ: one file a picture, all bodies in it."""

from pathlib import Path
from typing import Any

import numpy as np

from sandbox.files import replace_when_whole
from sandbox.output.frames import Frame, Stem
from sandbox.output.mesh.surface import BodyShape, Surfaces


class PlyWriter:
    """PLY, binary: vertices with velocity, colour, body, particle and strain; triangles; lines as edges."""

    def __init__(self, folder: Path, stem: Stem, surfaces: Surfaces, real: Any, *, has_edges: bool = True) -> None:
        """``real``: type of numbers; ``has_edges``: whether lines are written, which not all programs know in a PLY."""
        folder.mkdir()
        self._folder, self._stem, self._surfaces, self._has_edges = folder, stem, surfaces, has_edges
        self._real = np.dtype(real).newbyteorder("<")

    def write(self, frame: Frame) -> None:
        """Write the file of one frame."""
        bodies = [(body, shape.compact()) for body, shape in enumerate(self._surfaces.at(frame))]
        shapes = [(body, shape) for body, shape in bodies if shape.present]
        # None of the first: there may be no body yet, and its columns are wanted all the same.
        none = _rows(*bodies[0], self._real)[:0]
        vertices = np.concatenate([none, *(_rows(body, shape, self._real) for body, shape in shapes)])
        first = np.cumsum([0] + [len(shape.vertices) for _, shape in shapes])
        triangles = _joined([shape.triangles for _, shape in shapes], first, 3)
        faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, triangles
        lines = _joined([shape.lines for _, shape in shapes if self._has_edges], first, 2)
        names = {"<f4": "float", "<f8": "double", "|u1": "uchar", "<i4": "int"}
        header = ["ply", "format binary_little_endian 1.0", f"comment time {frame.time!r}"]
        header += [f"element vertex {len(vertices)}"]
        header += [f"property {names[vertices.dtype[name].str]} {name}" for name in vertices.dtype.names or ()]
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        if len(lines):
            header += [f"element edge {len(lines)}", "property int vertex1", "property int vertex2"]
        target = self._folder / f"{self._stem.of(frame.number)}.ply"
        with replace_when_whole(target, syncs=False) as path, path.open("wb") as file:
            file.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
            for table in (vertices, faces, lines.astype("<i4")):
                file.write(table.tobytes())

    def close(self) -> None:
        """Nothing is left to do."""


class ObjWriter:
    """Wavefront OBJ: an object a body, vertices with colours, triangles and lines. The format has no velocities."""

    def __init__(self, folder: Path, stem: Stem, surfaces: Surfaces, digits: int) -> None:
        """``digits`` of coordinates are written."""
        folder.mkdir()
        self._folder, self._stem, self._surfaces = folder, stem, surfaces
        self._row = f"v %.{digits}g %.{digits}g %.{digits}g %.4g %.4g %.4g\n"

    def write(self, frame: Frame) -> None:
        """Write the file of one frame."""
        first = 1
        with replace_when_whole(self._folder / f"{self._stem.of(frame.number)}.obj", syncs=False) as path:
            with path.open("w", encoding="utf-8") as file:
                file.write(f"# time {frame.time!r} s\n")
                for shape in map(BodyShape.compact, self._surfaces.at(frame)):
                    if not shape.present:
                        continue
                    file.write(f"o {'_'.join(shape.parts.name.split()) or 'body'}\n")
                    file.write(_lines(self._row, np.concatenate([shape.vertices, shape.colors], axis=1)))
                    file.write(_lines("f %d %d %d\n", shape.triangles + first))
                    file.write(_lines("l %d %d\n", shape.lines + first))
                    if not len(shape.triangles) and not len(shape.lines):
                        file.write(_lines("p %d\n", shape.dots[:, None] + first))
                    first += len(shape.vertices)

    def close(self) -> None:
        """Nothing is left to do."""


def _lines(pattern: str, table: Any) -> str:
    return (pattern * len(table)) % tuple(table.ravel().tolist())


def _rows(body: int, shape: BodyShape, real: Any) -> Any:
    """The vertices of one body as PLY has them."""
    columns = [(name, real) for name in ("x", "y", "z", "vx", "vy", "vz")]
    columns += [(name, np.dtype("u1")) for name in ("red", "green", "blue")]
    columns += [(name, np.dtype("<i4")) for name in ("body", "particle")]
    if shape.strain is not None:
        columns.append(("strain", real))
    rows = np.zeros(len(shape.vertices), dtype=columns)
    for axis, letter in enumerate("xyz"):
        rows[letter] = shape.vertices[:, axis]
        rows[f"v{letter}"] = shape.velocities[:, axis]
    for channel, color in enumerate(("red", "green", "blue")):
        rows[color] = np.round(255.0 * shape.colors[:, channel])
    rows["body"], rows["particle"] = body, shape.particles
    if shape.strain is not None:
        rows["strain"] = shape.strain
    return rows


def _joined(elements: list[Any], first: Any, width: int) -> Any:
    return np.concatenate(
        [np.zeros((0, width), dtype=np.int32)] + [rows + offset for rows, offset in zip(elements, first, strict=False)]
    )
