"""Arrays that grow by a row a picture, in one .npz file or one .zarr folder, and texts beside them.

An .npz is a zip of whole arrays. Rows are therefore spooled to files without a name on the same disk, and
packed at the end: memory holds one picture, whatever the length of the run.
"""

import math
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError, missing_extra

Array = NDArray[Any]
Layout = Mapping[str, tuple[Any, tuple[int, ...]]]
"""Of every array: type of its numbers, and shape of a row."""

_COPIED = 4 << 20
_CHUNK = 1 << 20
"""Bytes that a zarr chunk holds, or one row where that is more."""


class ArrayWriter(Protocol):
    """Takes one row of every array at a time."""

    def append(self, rows: Mapping[str, Any]) -> None: ...

    def close(self) -> None: ...


class ArrayReader(Protocol):
    """Gives texts, and rows of arrays."""

    def __contains__(self, name: object) -> bool: ...

    def text(self, name: str) -> str: ...

    def whole(self, name: str) -> Array: ...

    def shape(self, name: str) -> tuple[int, ...]: ...

    def row(self, name: str, number: int) -> Array: ...

    def close(self) -> None: ...


def create_arrays(path: Path, layout: Layout, texts: Mapping[str, str], blobs: Mapping[str, bytes]) -> ArrayWriter:
    """A writer for ``path``, by whose ending it is a zip or a folder."""
    return (ZarrWriter if path.suffix == ".zarr" else NpzWriter)(path, layout, texts, blobs)


def open_arrays(path: Path) -> ArrayReader:
    """A reader of what such a writer left."""
    return (ZarrReader if path.suffix == ".zarr" else NpzReader)(path)


def zarr_module() -> Any:
    """The zarr package. Raises SceneError where it is not installed."""
    try:
        import zarr
    except ImportError:
        raise SceneError(missing_extra("--trajectory zarr", "zarr", "zarr")) from None
    return zarr


class NpzWriter:
    """One .npz file; what is in it is ``numpy.load``'s to read."""

    def __init__(self, path: Path, layout: Layout, texts: Mapping[str, str], blobs: Mapping[str, bytes]) -> None:
        self._path, self._layout, self._count = path, layout, 0
        self._plain: dict[str, Array] = {name: np.array(text) for name, text in texts.items()}
        self._plain.update({name: np.frombuffer(data, dtype=np.uint8) for name, data in blobs.items()})
        self._spools = {name: tempfile.TemporaryFile(dir=path.parent) for name in layout}

    def append(self, rows: Mapping[str, Any]) -> None:
        """Add one row to every array."""
        for name, (kind, _) in self._layout.items():
            self._spools[name].write(np.ascontiguousarray(rows[name], dtype=kind).data)
        # Last: a row that was interrupted does not count.
        self._count += 1

    def close(self) -> None:
        """Write the file."""
        with zipfile.ZipFile(self._path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
            for name, array in self._plain.items():
                with packed.open(f"{name}.npy", "w") as entry:
                    np.lib.format.write_array(entry, array, allow_pickle=False)
            for name, (kind, shape) in self._layout.items():
                with packed.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    self._pack(entry, name, np.dtype(kind), (self._count, *shape))

    def _pack(self, entry: Any, name: str, kind: np.dtype[Any], shape: tuple[int, ...]) -> None:
        descr = np.lib.format.dtype_to_descr(kind)
        header = {"descr": descr, "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(entry, header)
        left = math.prod(shape) * kind.itemsize
        with self._spools[name] as spool:
            spool.seek(0)
            while left > 0:
                data = spool.read(min(left, _COPIED))
                if not data:
                    raise OSError(f"{name}: the spooled rows end early")
                entry.write(data)
                left -= len(data)


class NpzReader:
    """Reads rows of the arrays of an .npz file one by one; going forward is quick, going back begins anew."""

    def __init__(self, path: Path) -> None:
        self._zip = zipfile.ZipFile(path)
        self._open: dict[str, tuple[Any, int, np.dtype[Any], tuple[int, ...]]] = {}

    def __contains__(self, name: object) -> bool:
        return f"{name}.npy" in self._zip.namelist()

    def text(self, name: str) -> str:
        """A text."""
        return str(self.whole(name))

    def whole(self, name: str) -> Array:
        """A whole array."""
        with self._zip.open(f"{name}.npy") as entry:
            return np.asarray(np.lib.format.read_array(entry, allow_pickle=False))

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of an array; its first entry is the number of rows."""
        return self._entry(name)[3]

    def row(self, name: str, number: int) -> Array:
        """One row of an array."""
        entry, first, kind, shape = self._entry(name)
        size = math.prod(shape[1:]) * kind.itemsize
        entry.seek(first + number * size)
        data = entry.read(size)
        if len(data) != size:
            raise ValueError(f"{name} ends early")
        return np.frombuffer(data, dtype=kind).reshape(shape[1:])

    def _entry(self, name: str) -> tuple[Any, int, np.dtype[Any], tuple[int, ...]]:
        if name not in self._open:
            entry = self._zip.open(f"{name}.npy")
            version = np.lib.format.read_magic(entry)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, fortran, kind = read(entry)
            if fortran or kind.hasobject:
                raise ValueError(f"{name} is not an array of numbers by rows")
            self._open[name] = (entry, entry.tell(), kind, shape)
        return self._open[name]

    def close(self) -> None:
        """Close the file."""
        for entry, *_ in self._open.values():
            entry.close()
        self._zip.close()


class ZarrWriter:
    """A zarr group (format 3), Blosc with bit shuffling: some rows a chunk, written as they come."""

    def __init__(self, path: Path, layout: Layout, texts: Mapping[str, str], blobs: Mapping[str, bytes]) -> None:
        zarr = zarr_module()
        packing = zarr.codecs.BloscCodec(cname="zstd", clevel=3, shuffle="bitshuffle")
        group = zarr.open_group(path, mode="w", zarr_format=3)
        group.attrs.update(dict(texts))
        for name, data in blobs.items():
            group.create_array(name, data=np.frombuffer(data, dtype=np.uint8))
        self._kinds = {name: np.dtype(kind) for name, (kind, _) in layout.items()}
        size = max((math.prod(shape) * self._kinds[name].itemsize for name, (_, shape) in layout.items()), default=1)
        self._rows = max(1, _CHUNK // max(1, size))
        self._arrays = {
            name: group.create_array(
                name,
                shape=(0, *shape),
                chunks=(self._rows, *(max(1, n) for n in shape)),
                dtype=self._kinds[name],
                compressors=packing,
                # A chunk that is lost is then seen to be.
                fill_value=np.nan if self._kinds[name].kind == "f" else 0,
            )
            for name, (_, shape) in layout.items()
        }
        self._waiting: list[dict[str, Array]] = []
        self._count = 0

    def append(self, rows: Mapping[str, Any]) -> None:
        """Add one row to every array; rows wait until they fill a chunk."""
        self._waiting.append({name: np.array(rows[name], dtype=kind) for name, kind in self._kinds.items()})
        if len(self._waiting) >= self._rows:
            self._flush()

    def _flush(self) -> None:
        if not self._waiting:
            return
        end = self._count + len(self._waiting)
        for name, array in self._arrays.items():
            array.resize((end, *array.shape[1:]))
            array[self._count : end] = np.stack([row[name] for row in self._waiting])
        self._count, self._waiting = end, []

    def close(self) -> None:
        """Write the rows that are left."""
        self._flush()
        for array in self._arrays.values():
            array.resize((self._count, *array.shape[1:]))


class ZarrReader:
    """Reads rows of the arrays of a zarr group; the chunk last read of each is kept."""

    def __init__(self, path: Path) -> None:
        self._group = zarr_module().open_group(path, mode="r")
        self._arrays: dict[str, Any] = {}
        self._kept: dict[str, tuple[int, Array]] = {}

    def __contains__(self, name: object) -> bool:
        return name in self._group

    def text(self, name: str) -> str:
        """A text."""
        return str(self._group.attrs[name])

    def whole(self, name: str) -> Array:
        """A whole array."""
        return np.asarray(self._array(name)[...])

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of an array; its first entry is the number of rows."""
        return tuple(self._array(name).shape)

    def row(self, name: str, number: int) -> Array:
        """One row of an array."""
        array = self._array(name)
        rows = int(array.chunks[0])
        chunk = number // rows
        if name not in self._kept or self._kept[name][0] != chunk:
            self._kept[name] = (chunk, np.asarray(array[chunk * rows : (chunk + 1) * rows]))
        return np.asarray(self._kept[name][1][number - chunk * rows])

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            self._arrays[name] = self._group[name]
        return self._arrays[name]

    def close(self) -> None:
        """Nothing is left to do."""
