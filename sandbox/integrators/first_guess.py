"""The first guess of an iterative step: inertia, and the part of gravity that a particle gives way to.

As in the paper on vertex block descent (see :mod:`sandbox.integrators.vbd`): what fell freely in the last step does
so in the next; what something held up stays. It matters where sweeps are few, as they spread news slowly.
"""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.state import ParticleState, place

FloatArray = NDArray[np.float64]

_ALWAYS = 1e6
"""Longer than any step [s]."""


@ti.data_oriented
class FirstGuess:
    """Velocities that particles will have at the end of a step, by what happened in the last one."""

    def __init__(self, builder: ti.FieldsBuilder, state: ParticleState, laws: list[Any]) -> None:
        self.state = state
        fall = np.zeros(state.dimension)
        for law in laws:
            if hasattr(law, "acceleration"):  # it accelerates all particles alike
                fall += np.array(law.acceleration, dtype=float)
        self.falls = bool(fall.any())
        vector = runtime.vector(state.dimension)
        self.fall = vector(fall.tolist())
        # No quotient of numbers that all particles share: compiled to a product in one path alone, it would round
        # differently there.
        self.fall_share = vector((fall / max(float(fall @ fall), 1e-300)).tolist())
        if self.falls:
            self.given_way = place(builder, ti.field(runtime.real()), 2, state.count)
            """For how long every particle gave way to gravity in its last step [s]: now, and a backup."""

    def load(self) -> None:
        """In the beginning everything falls."""
        if self.falls:
            self._write(np.full(self.state.count, _ALWAYS))

    @ti.func
    def velocity(self, i, slot, dt):
        """Guess for particle i [m/s], from the state in ``slot``."""
        v = self.state.v[slot, i]
        if ti.static(self.falls):
            if self.state.inverse_mass[i] > 0.0:
                v += ti.min(self.given_way[0, i], dt) * self.fall
        return v

    @ti.func
    def learn(self, i, slot):
        """A step of particle i led from ``slot`` to the other one."""
        if ti.static(self.falls):
            change = self.state.v[1 - slot, i] - self.state.v[slot, i]
            self.given_way[0, i] = ti.max(0.0, change.dot(self.fall_share))

    # -- memory -------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Copy what is known of the last step into a backup."""
        if self.falls:
            self._copy(0, 1)

    def restore(self) -> None:
        """Copy the backup back."""
        if self.falls:
            self._copy(1, 0)

    def memory(self) -> dict[str, FloatArray]:
        """For how long every particle gave way to gravity in its last step [s], internal order."""
        if not self.falls:
            return {}
        values = np.empty(self.state.count)
        self._read(values)
        return {"guess.given_way": values}

    def remember(self, values: dict[str, FloatArray]) -> None:
        """Set it from :meth:`memory`."""
        if self.falls:
            self._write(np.ascontiguousarray(values["guess.given_way"]))

    @ti.kernel
    def _write(self, values: ti.types.ndarray()):
        for i in range(self.state.count):
            self.given_way[0, i] = values[i]

    @ti.kernel
    def _read(self, values: ti.types.ndarray()):
        for i in range(self.state.count):
            values[i] = self.given_way[0, i]

    @ti.kernel
    def _copy(self, source: int, target: int):
        ti.loop_config(serialize=self.state.serialize)
        for i in range(self.state.count):
            self.given_way[target, i] = self.given_way[source, i]
