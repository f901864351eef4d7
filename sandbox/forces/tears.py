"""Which springs have torn: one mark a spring, read by whatever a tear concerns."""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.state import place


@ti.data_oriented
class Tears:
    """Marks of all springs of a scene in which any can tear.

    Both ends of a spring set its mark, to the same value. Nothing may read marks in the pass that
    sets them: what depends on them is prepared in a pass of its own.
    """

    def __init__(self, builder: ti.FieldsBuilder, spring_count: int) -> None:
        self.count = spring_count
        self.torn = place(builder, ti.field(ti.i32), spring_count)
        """Nonzero where a spring has torn, shape (spring_count,)."""
        self._kept = place(builder, ti.field(ti.i32), spring_count)

    @ti.func
    def mark(self, spring):
        self.torn[spring] = 1

    def marks(self) -> NDArray[np.int32]:
        """Nonzero where a spring has torn, shape (spring_count,)."""
        marks = np.empty(self.count, dtype=np.int32)
        self._read(marks)
        return marks

    def torn_count(self) -> int:
        """Number of torn springs."""
        return int(np.count_nonzero(self.marks()))

    def keep(self) -> None:
        """Copy the marks into a backup."""
        self._copy_out()

    def restore(self) -> None:
        """Copy the backup back."""
        self._copy_back()

    def memory(self) -> dict[str, NDArray[np.float64]]:
        """What :meth:`remember` takes."""
        return {"springs.torn": self.marks().astype(np.float64)}

    def remember(self, values: dict[str, NDArray[np.float64]]) -> None:
        """Set the marks from :meth:`memory`."""
        self._write(np.ascontiguousarray(values["springs.torn"], dtype=np.int32))

    @ti.kernel
    def _read(self, marks: ti.types.ndarray()):
        for s in range(self.count):
            marks[s] = self.torn[s]

    @ti.kernel
    def _write(self, marks: ti.types.ndarray()):
        for s in range(self.count):
            self.torn[s] = marks[s]

    @ti.kernel
    def _copy_out(self):
        for s in range(self.count):
            self._kept[s] = self.torn[s]

    @ti.kernel
    def _copy_back(self):
        for s in range(self.count):
            self.torn[s] = self._kept[s]
