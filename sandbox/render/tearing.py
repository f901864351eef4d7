"""What is not drawn because it has torn."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from sandbox.render.arrays import upload, zeros
from sandbox.render.types import Ints
from sandbox.scene.appearance import IntArray


@ti.kernel
def hide_torn(torn: ti.template(), springs: Ints, hidden: Ints):
    """1 for every primitive of which one of three springs has torn."""
    for i in range(hidden.shape[0]):
        gone = 0
        for k in range(3 * i, 3 * i + 3):
            if springs[k] >= 0:
                if torn[springs[k]] != 0:
                    gone = 1
        hidden[i] = gone


class Tearing:
    """The primitives of a scene that hang on springs."""

    def __init__(self, groups: Sequence[tuple[IntArray | None, int]]) -> None:
        """`groups`, in the order of drawing: springs, shape (count, 1 or 3) or (count,), -1 or None for none; count."""
        self.is_possible = any(springs is not None and np.any(springs >= 0) for springs, _ in groups)
        """False where nothing can tear: kernels are then compiled without asking."""
        self.hidden: Any = upload(np.zeros(1), ti.i32)
        """Taichi array, nonzero for every primitive that has torn, shape (primitive_count,)."""
        self._has_torn = False
        if self.is_possible:
            rows = np.full((sum(count for _, count in groups), 3), -1, dtype=np.int32)
            first = 0
            for springs, count in groups:
                if springs is not None and count:
                    springs = springs.reshape(count, -1)
                    rows[first : first + count, : springs.shape[1]] = springs
                first += count
            self._springs = upload(rows, ti.i32)
            self.hidden = zeros(ti.i32, len(rows))

    def update(self, torn: Any) -> None:
        """Read the field `torn` (spring_count,); None: nothing has torn."""
        if not self.is_possible:
            return
        if torn is not None:
            hide_torn(torn, self._springs, self.hidden)
        elif self._has_torn:
            self.hidden.fill(0)
        self._has_torn = torn is not None
