"""Uniform gravity."""

import taichi as ti

from sandbox import runtime
from sandbox.state import ParticleState


@ti.data_oriented
class Gravity:
    """Force m g on every particle; potential energy -m g x, zero at the origin."""

    term = "gravity"
    """Which entry of the energies this law's potential belongs to."""

    def __init__(self, state: ParticleState, acceleration: tuple[float, ...]) -> None:
        self.state = state
        self.acceleration = runtime.vector(state.dimension)(acceleration)

    @ti.func
    def force_on(self, i, slot):
        return self.state.mass[i] * self.acceleration

    @ti.func
    def energy_on(self, i, slot):
        return -self.state.mass[i] * self.acceleration.dot(self.state.x[slot, i])
