"""One number a particle, to colour it by: its speed, or the largest strain of its springs."""

from typing import Any, Protocol

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import ColorBy
from sandbox.scene.scale import usual_largest
from sandbox.state import ParticleState, place

FloatArray = NDArray[np.float64]


class Valued(Protocol):
    """A simulation, or a stored run."""

    @property
    def state(self) -> ParticleState: ...

    @property
    def laws(self) -> list[Any]: ...

    @property
    def assembly(self) -> Assembly: ...


@ti.data_oriented
class ParticleValues:
    """Speed [m/s] or strain [1] of every particle, in a field of its own."""

    def __init__(self, simulation: Valued, shown: ColorBy) -> None:
        self.simulation = simulation
        self.state = simulation.state
        self.shown = shown
        self.by_speed = shown is ColorBy.SPEED
        self.strained: list[Any] = [law for law in simulation.laws if hasattr(law, "strain_on")]
        builder = runtime.fields_builder()
        self.values = place(builder, ti.field(runtime.real()), self.state.count)
        builder.finalize()

    def current(self) -> "ParticleValues":
        """These, or new ones where the simulation has built its fields anew since."""
        return self if self.simulation.state is self.state else ParticleValues(self.simulation, self.shown)

    def update(self) -> ti.Field:
        """Compute the values of the state now and return their field, shape (particle_count,)."""
        self._fill(self.state.slot)
        return self.values

    def show(self, values: FloatArray) -> ti.Field:
        """Take values from elsewhere, shape (particle_count,), in the order of the fields; return their field."""
        self._take(np.ascontiguousarray(values))
        return self.values

    def expected_largest(self) -> float:
        """A round number that the values are likely to reach: a top for the colour scale."""
        return usual_largest(self.shown, self.simulation.assembly)

    @ti.kernel
    def _fill(self, slot: int):
        for i in range(self.state.count):
            value = 0.0
            if ti.static(self.by_speed):
                value = self.state.v[slot, i].norm()
            else:
                for law in ti.static(self.strained):
                    value = ti.max(value, law.strain_on(i, slot))
            self.values[i] = value

    @ti.kernel
    def _take(self, values: ti.types.ndarray()):
        for i in range(self.state.count):
            self.values[i] = values[i]
