"""Looks at one law of a simulation by itself: its forces on all particles, at a time of one's choice."""

from typing import Any

import numpy as np
import taichi as ti

from sandbox import Simulation


def law_of(simulation: Simulation, kind: type) -> Any:
    """The law of a simulation that is of the given class."""
    return next(law for law in simulation.laws if isinstance(law, kind))


@ti.data_oriented
class Probe:
    """Forces of one law in the state now."""

    def __init__(self, simulation: Simulation, kind: type) -> None:
        self.simulation = simulation
        self.law = law_of(simulation, kind)
        self.state = simulation.state

    def forces(self, time: float = 0.0) -> np.ndarray:
        """Forces [N], shape (particle_count, dimension), in the scene's order."""
        result = np.empty((self.state.count, self.state.dimension))
        self._fill(result, self.state.slot, time)
        return self.simulation.assembly.scene_order(result)

    @ti.kernel
    def _fill(self, result: ti.types.ndarray(), slot: int, time: float):
        for k in range(self.law.prepare_count):
            self.law.prepare_at(k, slot, time, 0.0)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.law.prepare_end(slot, time, 0.0)
        for i in range(self.state.count):
            force = self.law.force_on(i, slot)
            for axis in ti.static(range(self.state.dimension)):
                result[i, axis] = force[axis]
