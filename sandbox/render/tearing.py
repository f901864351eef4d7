"""What is not drawn because of what has torn: the rule of `sandbox.scene.cells`, where the marks are."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.render.arrays import upload, zeros
from sandbox.render.types import Ints
from sandbox.scene.cells import Cells, FaceCells


@ti.kernel
def break_cells(torn: ti.template(), start: Ints, springs: Ints, limit: Ints, broken: Ints) -> ti.i32:
    """1 for every cell that is broken; the number of cells of which that is new."""
    changed = 0
    for c in range(limit.shape[0]):
        count = 0
        for k in range(start[c], start[c + 1]):
            if torn[springs[k]] != 0:
                count += 1
        now = 0
        if count >= limit[c]:
            now = 1
        if broken[c] != now:
            broken[c] = now
            changed += 1
    return changed


@ti.kernel
def hide_faces(broken: Ints, start: Ints, owners: Ints, neighbour: Ints, hidden: Ints):
    """1 for every primitive of which a cell behind it is broken, or the cell in front of it is not."""
    for i in range(hidden.shape[0]):
        gone = 0
        for k in range(start[i], start[i + 1]):
            gone |= broken[owners[k]]
        front = neighbour[i]
        if front >= 0:
            gone |= 1 - broken[front]
        hidden[i] = gone


class Tearing:
    """The primitives of a scene that hang on springs."""

    def __init__(self, cells: Cells | None, groups: Sequence[tuple[FaceCells | None, int]]) -> None:
        """`groups`, in the order of drawing: the cells of primitives, or None where they hang on nothing; count."""
        self.is_possible = cells is not None and len(cells.springs) > 0
        """False where nothing can tear: kernels are then compiled without asking."""
        self.hidden: Any = upload(np.zeros(1), ti.i32)
        """Taichi array, nonzero for every primitive that is not drawn, shape (primitive_count,)."""
        self._has_torn = False
        if cells is not None and self.is_possible:
            faces = FaceCells.joined([_padded(one, count) for one, count in groups])
            self._cells = [upload(values, ti.i32) for values in (cells.start, cells.springs, cells.limit)]
            self._broken = zeros(ti.i32, len(cells.limit))
            self._faces = [upload(values, ti.i32) for values in (faces.start, faces.owners, faces.neighbour)]
            self.hidden = zeros(ti.i32, len(faces))
            hide_faces(self._broken, *self._faces, self.hidden)

    def update(self, torn: Any) -> None:
        """Read the field `torn` (spring_count,); None: nothing has torn."""
        if not self.is_possible:
            return
        if torn is not None:
            changed = break_cells(torn, *self._cells, self._broken) > 0
        else:
            changed = self._has_torn
            if changed:
                self._broken.fill(0)
        if changed:
            hide_faces(self._broken, *self._faces, self.hidden)
        self._has_torn = torn is not None

    def hide(self, hidden: NDArray[np.integer[Any]]) -> None:
        """Hide what is nonzero, shape (primitive_count,), instead of what the last `update` found."""
        if self.is_possible:
            self.hidden.from_numpy(hidden.astype(np.int32))


def _padded(faces: FaceCells | None, count: int) -> FaceCells:
    """The same faces, and after them those that hang on nothing, `count` in all."""
    known = 0 if faces is None else len(faces)
    rest = FaceCells.of(np.full(count - known, -1))
    return rest if faces is None else FaceCells.joined([faces, rest])
