"""VTU, XML with compressed binary data, and PVD, the list of all times: what ParaView opens.

The files hold every particle, in the scene's order, as a point, then the points that particles carry; cells are
the drawn surface, or the springs. Beside gaps that have opened in solid bodies, too, points are where particles are.
"""

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from sandbox.files import replace_when_whole
from sandbox.output.frames import FloatArray, Frame, Stem
from sandbox.output.mesh.surface import Surfaces, flat_to_space
from sandbox.scene.assemble import Assembly

VERTEX, LINE, TRIANGLE = 1, 3, 5
_TYPES = {"<f4": "Float32", "<f8": "Float64", "<i4": "Int32", "<i8": "Int64", "|u1": "UInt8"}
Table = Mapping[str, NDArray[Any]]


class VtuSurfaceWriter:
    """The drawn surface: triangles, lines, and single particles; velocity, strain, body and particle at every point."""

    def __init__(self, folder: Path, stem: Stem, surfaces: Surfaces, real: Any, pvd: Path) -> None:
        """``real``: type of numbers; ``pvd`` is written at the end."""
        self._series, self._surfaces, self._real = _Series(folder, stem, pvd), surfaces, real
        particles = np.arange(surfaces.point_count, dtype=np.int32)
        particles[surfaces.particle_count :] = -1
        body = np.zeros(surfaces.point_count, dtype=np.int32)
        for index, parts in enumerate(surfaces.bodies):
            body[parts.points] = index
        body[: surfaces.particle_count] = surfaces.body_of_particle
        self._fixed = {"body": body, "particle": particles}

    def write(self, frame: Frame) -> None:
        """Write the file of one frame."""
        surfaces = self._surfaces
        groups = [(0, VERTEX, np.zeros((0, 1), np.int32))]
        for body, shape in enumerate(surfaces.at(frame)):
            if shape.present:
                points, dots = shape.parts.points, shape.dots[:, None]
                kinds = ((TRIANGLE, shape.triangles), (LINE, shape.lines), (VERTEX, dots))
                groups += [(body, kind, points[rows]) for kind, rows in kinds]
        data: dict[str, NDArray[Any]] = {"velocity": surfaces.everywhere(frame.velocities).astype(self._real)}
        if frame.strain is not None:
            data["strain"] = surfaces.everywhere(frame.strain).astype(self._real)
        self._series.write(
            frame,
            points=surfaces.everywhere(frame.positions).astype(self._real),
            point_data={**data, **self._fixed},
            connectivity=np.concatenate([rows.ravel() for _, _, rows in groups]),
            widths=np.concatenate([np.full(len(rows), rows.shape[1]) for _, _, rows in groups]),
            kinds=np.concatenate([np.full(len(rows), kind) for _, kind, rows in groups]),
            cell_data={"body": np.concatenate([np.full(len(rows), body, np.int32) for body, _, rows in groups])},
        )

    def close(self) -> None:
        """Write the list of times."""
        self._series.close()


class VtuSpringWriter:
    """The springs as lines, less those torn; each with its stretch over its first rest length, and its body."""

    def __init__(self, folder: Path, stem: Stem, assembly: Assembly, real: Any, pvd: Path) -> None:
        """``real``: type of numbers; ``pvd`` is written at the end."""
        springs = assembly.spring_set
        self._series, self._real = _Series(folder, stem, pvd), real
        self._ends = assembly.order[springs.ends].astype(np.int32)
        self._rest = springs.rest_lengths
        self._body = np.where(springs.body < len(assembly.scene.bodies), springs.body, -1).astype(np.int32)

    def write(self, frame: Frame) -> None:
        """Write the file of one frame."""
        kept = np.ones(len(self._ends), dtype=bool) if frame.torn is None else ~frame.torn
        ends, rest = self._ends[kept], self._rest[kept]
        length = np.linalg.norm(frame.positions[ends[:, 1]] - frame.positions[ends[:, 0]], axis=1)
        stretch = np.divide(length - rest, rest, out=np.zeros_like(length), where=rest > 0.0)
        self._series.write(
            frame,
            points=flat_to_space(frame.positions).astype(self._real),
            point_data={"velocity": flat_to_space(frame.velocities).astype(self._real)},
            connectivity=ends.ravel(),
            widths=np.full(len(ends), 2),
            kinds=np.full(len(ends), LINE),
            cell_data={"stretch": stretch.astype(self._real), "body": self._body[kept]},
        )

    def close(self) -> None:
        """Write the list of times."""
        self._series.close()


class _Series:
    """Files of one series, and their list."""

    def __init__(self, folder: Path, stem: Stem, pvd: Path) -> None:
        folder.mkdir()
        self._folder, self._stem, self._pvd = folder, stem, pvd
        self._entries: list[str] = []

    def write(
        self,
        frame: Frame,
        *,
        points: FloatArray,
        point_data: Table,
        connectivity: NDArray[Any],
        widths: NDArray[Any],
        kinds: NDArray[Any],
        cell_data: Table,
    ) -> None:
        """Write the file of one frame."""
        file = _Appended(len(points), len(kinds))
        file.section("FieldData", {"TimeValue": np.array([frame.time])}, tuples=True)
        file.begin_piece()
        file.section("PointData", point_data)
        file.section("CellData", cell_data)
        file.section("Points", {"points": points})
        offsets = np.cumsum(widths, dtype=np.int64)
        cells: dict[str, NDArray[Any]] = {
            "connectivity": connectivity.astype(np.int64),
            "offsets": offsets,
            "types": kinds.astype(np.uint8),
        }
        file.section("Cells", cells)
        name = f"{self._stem.of(frame.number)}.vtu"
        with replace_when_whole(self._folder / name, syncs=False) as path:
            path.write_bytes(file.finished())
        place = quoteattr(f"{self._folder.name}/{name}")
        self._entries.append(f'    <DataSet timestep="{frame.time!r}" part="0" file={place}/>\n')

    def close(self) -> None:
        """Write the list of times."""
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n'
        text = f"{head}  <Collection>\n{''.join(self._entries)}  </Collection>\n</VTKFile>\n"
        self._pvd.write_text(text, encoding="utf-8")


class _Appended:
    """A VTU file in the making: its XML, and the data that is appended to it."""

    def __init__(self, point_count: int, cell_count: int) -> None:
        self._counts = f'NumberOfPoints="{point_count}" NumberOfCells="{cell_count}"'
        self._xml = [
            '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt64" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
        ]
        self._data: list[bytes] = []
        self._length = 0

    def begin_piece(self) -> None:
        """What follows belongs to the one piece of the file."""
        self._xml.append(f"<Piece {self._counts}>\n")

    def section(self, name: str, arrays: Table, tuples: bool = False) -> None:
        """Add arrays, shape (count,) or (count, 3); ``tuples`` says how many rows they have, as field data must."""
        self._xml.append(f"<{name}>\n")
        for label, values in arrays.items():
            kind = _TYPES[values.dtype.newbyteorder("<").str]
            width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
            width += f' NumberOfTuples="{len(values)}"' if tuples else ""
            self._xml.append(
                f'<DataArray type="{kind}" Name="{label}"{width} format="appended" offset="{self._length}"/>\n'
            )
            self._append(np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes())
        self._xml.append(f"</{name}>\n")

    def _append(self, plain: bytes) -> None:
        """One compressed block: number of blocks, their size, that of a last shorter one, packed sizes, the data."""
        packed = zlib.compress(plain, 1)
        header = [1, len(plain), 0, len(packed)] if plain else [0, 0, 0]
        block = np.array(header, dtype="<u8").tobytes() + (packed if plain else b"")
        self._data.append(block)
        self._length += len(block)

    def finished(self) -> bytes:
        """The whole file."""
        end = '</Piece>\n</UnstructuredGrid>\n<AppendedData encoding="raw">\n_'
        xml = "".join([*self._xml, end]).encode("ascii")
        return b"".join([xml, *self._data, b"\n</AppendedData>\n</VTKFile>\n"])
