"""Forces from outside that last for a time: pushes on some particles, and ground that shakes."""

import math

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import functions, runtime
from sandbox.state import ParticleState, place

FloatArray = NDArray[np.float64]


@ti.data_oriented
class Loads:
    """A push on every particle, and room for Q shakes. What a scene lacks of both is not compiled.

    Seen from ground that moves by A sin(2 pi f t) every particle feels m A (2 pi f)^2 sin(2 pi f t): the inertial
    force of an accelerated frame, from any textbook of mechanics.
    """

    dissipation_term = "action"
    damped = False
    prepare_count = 0

    def __init__(self, builder: ti.FieldsBuilder, pushes: int, shakes: int, state: ParticleState) -> None:
        self.state = state
        self.dimension = state.dimension
        self.pushes = pushes > 0
        self.shakes = shakes
        self.vector = runtime.vector(state.dimension)
        self.real = runtime.real()
        self.exact = ti.f64
        if pushes:
            self.push = place(builder, self.vector.field(), state.count)
            """[N]"""
        if shakes:
            self.shaken = place(builder, ti.field(self.real), shakes, state.count)
            """Mass where a particle feels a shake, else 0 [kg], shape (Q, N)."""
            self.peak = place(builder, self.vector.field(), shakes)
            """A (2 pi f)^2 [m/s^2]."""
            self.clock = place(builder, ti.field(self.exact), shakes, 2)
            """Start [s] and f [Hz]."""
            self.quake = place(builder, self.vector.field(), shakes)

    # -- from the host ------------------------------------------------------------------------------

    def push_by(self, forces: FloatArray) -> None:
        """Push every particle from now on [N], shape (N, d)."""
        self._push(np.ascontiguousarray(forces))

    def shake(self, row: int, masses: FloatArray, amplitude: FloatArray, frequency: float, start: float) -> None:
        """Shake particles of these masses [kg], 0 for none, shape (N,), by an amplitude [m] from ``start`` [s] on."""
        peak = amplitude * (2.0 * math.pi * frequency) ** 2
        self._shake(row, np.ascontiguousarray(masses), np.ascontiguousarray(peak), frequency, start)

    # -- memory -------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Nothing: loads change between steps only, where no state is given back."""

    def restore(self) -> None:
        """Nothing, likewise."""

    def memory(self) -> dict[str, FloatArray]:
        """What :meth:`remember` takes."""
        values: dict[str, FloatArray] = {}
        if self.pushes:
            values["loads.push"] = np.empty((self.state.count, self.dimension))
            self._read_push(values["loads.push"])
        if self.shakes:
            values["loads.shaken"] = np.empty((self.shakes, self.state.count))
            values["loads.shake"] = np.empty((self.shakes, 2 + self.dimension))
            self._read_shakes(values["loads.shaken"], values["loads.shake"])
        return values

    def remember(self, values: dict[str, FloatArray]) -> None:
        """Push and shake as :meth:`memory` said."""
        if self.pushes:
            self.push_by(values["loads.push"])
        if self.shakes:
            self._write_shakes(*(np.ascontiguousarray(values[f"loads.{name}"]) for name in ("shaken", "shake")))

    @ti.kernel
    def _push(self, forces: ti.types.ndarray()):
        for i in range(self.state.count):
            for axis in ti.static(range(self.dimension)):
                self.push[i][axis] = forces[i, axis]

    @ti.kernel
    def _read_push(self, forces: ti.types.ndarray()):
        for i in range(self.state.count):
            for axis in ti.static(range(self.dimension)):
                forces[i, axis] = self.push[i][axis]

    @ti.kernel
    def _shake(self, row: int, masses: ti.types.ndarray(), peak: ti.types.ndarray(), frequency: ti.f64, start: ti.f64):
        for i in range(self.state.count):
            self.shaken[row, i] = masses[i]
        self.clock[row, 0] = ti.cast(start, self.exact)
        self.clock[row, 1] = ti.cast(frequency, self.exact)
        for axis in ti.static(range(self.dimension)):
            self.peak[row][axis] = peak[axis]

    @ti.kernel
    def _read_shakes(self, masses: ti.types.ndarray(), table: ti.types.ndarray()):
        for i in range(self.state.count):
            for row in range(self.shakes):
                masses[row, i] = self.shaken[row, i]
        for row in range(self.shakes):
            table[row, 0] = self.clock[row, 0]
            table[row, 1] = self.clock[row, 1]
            for axis in ti.static(range(self.dimension)):
                table[row, 2 + axis] = self.peak[row][axis]

    @ti.kernel
    def _write_shakes(self, masses: ti.types.ndarray(), table: ti.types.ndarray()):
        for i in range(self.state.count):
            for row in range(self.shakes):
                self.shaken[row, i] = masses[row, i]
        for row in range(self.shakes):
            self.clock[row, 0] = table[row, 0]
            self.clock[row, 1] = table[row, 1]
            for axis in ti.static(range(self.dimension)):
                self.peak[row][axis] = table[row, 2 + axis]

    # -- the force ----------------------------------------------------------------------------------

    @ti.func
    def prepare_end(self, slot, time, dt):
        """How the ground accelerates at ``time`` [s]."""
        if ti.static(self.shakes > 0):
            for row in range(self.shakes):
                turns = (ti.cast(time, self.exact) - self.clock[row, 0]) * self.clock[row, 1]
                turns = turns - ti.floor(turns)
                wave = functions.sin(ti.cast(2.0 * math.pi * turns, self.real))
                self.quake[row] = wave * self.peak[row]

    @ti.func
    def force_on(self, i, slot):
        force = self.vector(0.0)
        if ti.static(self.pushes):
            force += self.push[i]
        if ti.static(self.shakes > 0):
            for row in range(self.shakes):
                force += self.shaken[row, i] * self.quake[row]
        return force

    @ti.func
    def dissipation_on(self, i, slot):
        """All of the force: what it works comes from outside [N]."""
        return self.force_on(i, slot)
