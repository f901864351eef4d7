"""One number a particle, to colour it by: its speed, or the largest strain of its springs."""

import math
from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.scene.model import ColorBy
from sandbox.simulation import Simulation
from sandbox.state import place

_USUAL_STRAIN = 0.25
"""Top of the strain scale where the scene gives none [1]."""


@ti.data_oriented
class ParticleValues:
    """Speed [m/s] or strain [1] of every particle, in a field of its own."""

    def __init__(self, simulation: Simulation, shown: ColorBy) -> None:
        self.simulation = simulation
        self.state = simulation.state
        self.shown = shown
        self.by_speed = shown is ColorBy.SPEED
        self.strained: list[Any] = [law for law in simulation.laws if hasattr(law, "strain_on")]
        builder = runtime.fields_builder()
        self.values = place(builder, ti.field(runtime.real()), self.state.count)
        builder.finalize()

    def update(self) -> ti.Field:
        """Compute the values of the state now and return their field, shape (particle_count,)."""
        self._fill(self.state.slot)
        return self.values

    def expected_largest(self) -> float:
        """A round number that the values are likely to reach: a top for the colour scale."""
        if not self.by_speed:
            return _USUAL_STRAIN
        scene, assembly = self.simulation.scene, self.simulation.assembly
        strength = float(np.linalg.norm(scene.gravity or (0.0,)))
        low, high = assembly.appearance.bounds
        falling = math.sqrt(2.0 * strength * float((high - low).max()))
        start = float(np.linalg.norm(assembly.velocities, axis=1).max())
        return _round_up(max(start, falling, 1e-3))

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


def _round_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - 1e-9))
