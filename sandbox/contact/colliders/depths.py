"""How deep every particle is in every collider of a scene, for those who only look."""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox.contact.colliders.build import collider_order
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState

FloatArray = NDArray[np.float64]


@ti.data_oriented
class Depths:
    """Reads them from a state and the solids that act on it."""

    def __init__(self, state: ParticleState, solids: list[Any], assembly: Assembly) -> None:
        self.state, self.solids = state, solids
        self.firsts = [int(first) for first in np.cumsum([0] + [solid.count for solid in solids])]
        self.order = collider_order(assembly)

    def read(self) -> FloatArray:
        """Depth of every particle in every collider [m], negative outside, shape (N, C).

        Particles in the internal order, colliders in that of the scene.
        """
        table = np.empty((self.state.count, self.firsts[-1]))
        self._write(self.state.slot, table)
        depths = np.empty_like(table)
        depths[:, self.order] = table
        return depths

    @ti.kernel
    def _write(self, slot: int, table: ti.types.ndarray()):
        for i in range(self.state.count):
            x = self.state.x[slot, i]
            for k in ti.static(range(len(self.solids))):
                for c in range(self.solids[k].count):
                    table[i, self.firsts[k] + c] = self.solids[k].depth_in(c, i, x)
