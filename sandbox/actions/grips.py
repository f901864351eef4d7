"""Hands: damped springs that lead some particles to a place that moves, each with at most its share of a force."""

from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.state import ParticleState, place

FloatArray = NDArray[np.float64]

ROUNDING = 1e-6
"""Error of a time in f32, relative to it, at most [1]."""


@dataclass(frozen=True)
class Segment:
    """A straight part of the way of a grip: from one place and time to another."""

    start: float
    """[s]"""
    end: float
    """[s]; the target rests before the start and after the end."""
    origin: FloatArray
    """[m], shape (d,)."""
    goal: FloatArray
    """[m], shape (d,)."""


@ti.data_oriented
class Grips:
    """Room for G grips, in every one of which any of the N particles may be.

    A particle in a grip feels k (p + o - x) + c (w - v) with p and w the place and velocity of the grip, o where the
    particle was from its middle when it was taken, no more than its share of the largest force. What a grip does not
    hold has k = 0. The force is nobody's potential: its work is that of an action.
    """

    dissipation_term = "action"
    damped = True
    prepare_count = 0

    def __init__(self, builder: ti.FieldsBuilder, count: int, state: ParticleState) -> None:
        self.count = count
        self.state = state
        self.dimension = state.dimension
        self.real = runtime.real()
        self.vector = runtime.vector(state.dimension)
        self.matrix = ti.types.matrix(state.dimension, state.dimension, runtime.real())
        # Time grows without bound, and what counts is a small part of it.
        self.exact = ti.f64
        self.stiffness = place(builder, ti.field(self.real), count, state.count)
        self.damping = place(builder, ti.field(self.real), count, state.count)
        self.offset = place(builder, self.vector.field(), count, state.count)
        self.most = place(builder, ti.field(self.real), count)
        """Largest force on every particle of a grip [N]."""
        self.times = place(builder, ti.field(self.exact), count, 2)
        self.ends = place(builder, ti.types.vector(state.dimension, self.exact).field(), count, 2)
        self.target = place(builder, self.vector.field(), count)
        self.velocity = place(builder, self.vector.field(), count)

    # -- from the host ------------------------------------------------------------------------------

    def lead(self, grip: int, segment: Segment) -> None:
        """Lead a grip along a segment from now on."""
        self._lead(grip, segment.start, segment.end, np.stack([segment.origin, segment.goal]))

    def take(self, grip: int, stiffness: FloatArray, damping: FloatArray, offset: FloatArray, most: float) -> None:
        """Fill a grip: stiffness [N/m] and damping [N s/m], shape (N,), offset [m], shape (N, d), force [N]."""
        self._take(grip, stiffness, damping, np.ascontiguousarray(offset), most)

    def let_go(self, grip: int) -> None:
        """Empty a grip."""
        nothing = np.zeros(self.state.count)
        self.take(grip, nothing, nothing, np.zeros((self.state.count, self.dimension)), 0.0)

    # -- memory -------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Nothing: grips change between steps only, where no state is given back."""

    def restore(self) -> None:
        """Nothing, likewise."""

    def memory(self) -> dict[str, FloatArray]:
        """What :meth:`remember` takes."""
        held = np.empty((self.count, self.state.count, self.dimension + 2))
        led = np.empty((self.count, 3 + 2 * self.dimension))
        self._read(held, led)
        return {"grips.held": held, "grips.led": led}

    def remember(self, values: dict[str, FloatArray]) -> None:
        """Hold and lead as :meth:`memory` said."""
        self._write(np.ascontiguousarray(values["grips.held"]), np.ascontiguousarray(values["grips.led"]))

    @ti.kernel
    def _lead(self, grip: int, start: ti.f64, end: ti.f64, ends: ti.types.ndarray()):
        self.times[grip, 0] = ti.cast(start, self.exact)
        self.times[grip, 1] = ti.cast(end, self.exact)
        for axis in ti.static(range(self.dimension)):
            self.ends[grip, 0][axis] = ends[0, axis]
            self.ends[grip, 1][axis] = ends[1, axis]

    @ti.kernel
    def _take(
        self,
        grip: int,
        stiffness: ti.types.ndarray(),
        damping: ti.types.ndarray(),
        offset: ti.types.ndarray(),
        most: float,
    ):
        for i in range(self.state.count):
            self.stiffness[grip, i] = stiffness[i]
            self.damping[grip, i] = damping[i]
            for axis in ti.static(range(self.dimension)):
                self.offset[grip, i][axis] = offset[i, axis]
        self.most[grip] = most

    @ti.kernel
    def _read(self, held: ti.types.ndarray(), led: ti.types.ndarray()):
        for i in range(self.state.count):
            for g in range(self.count):
                held[g, i, 0] = self.stiffness[g, i]
                held[g, i, 1] = self.damping[g, i]
                for axis in ti.static(range(self.dimension)):
                    held[g, i, 2 + axis] = self.offset[g, i][axis]
        for g in range(self.count):
            led[g, 0] = self.most[g]
            for end in ti.static(range(2)):
                led[g, 1 + end] = self.times[g, end]
                for axis in ti.static(range(self.dimension)):
                    led[g, 3 + end * self.dimension + axis] = self.ends[g, end][axis]

    @ti.kernel
    def _write(self, held: ti.types.ndarray(), led: ti.types.ndarray()):
        for i in range(self.state.count):
            for g in range(self.count):
                self.stiffness[g, i] = held[g, i, 0]
                self.damping[g, i] = held[g, i, 1]
                for axis in ti.static(range(self.dimension)):
                    self.offset[g, i][axis] = held[g, i, 2 + axis]
        for g in range(self.count):
            self.most[g] = led[g, 0]
            for end in ti.static(range(2)):
                self.times[g, end] = led[g, 1 + end]
                for axis in ti.static(range(self.dimension)):
                    self.ends[g, end][axis] = led[g, 3 + end * self.dimension + axis]

    # -- the force ----------------------------------------------------------------------------------

    @ti.func
    def prepare_end(self, slot, time, dt):
        """Where every grip is at ``time`` [s]."""
        for g in range(self.count):
            now = ti.cast(time, self.exact)
            lasts = self.times[g, 1] - self.times[g, 0]
            part = ti.cast(1.0, self.exact)
            speed = ti.cast(0.0, self.exact)
            if lasts > 0.0:
                # Time comes in the precision of the rest: what is the end but for rounding is the end, and the grip
                # rests there, whether or not a segment follows that says so.
                if now < self.times[g, 1] * (1.0 - ROUNDING):
                    part = ti.min(ti.max((now - self.times[g, 0]) / lasts, 0.0), 1.0)
                    if now >= self.times[g, 0]:
                        speed = 1.0 / lasts
            way = self.ends[g, 1] - self.ends[g, 0]
            # Both ends exactly: p + (q - p) w would miss q by rounding.
            self.target[g] = ti.cast((1.0 - part) * self.ends[g, 0] + part * self.ends[g, 1], self.real)
            self.velocity[g] = ti.cast(speed * way, self.real)

    @ti.func
    def _pull(self, g, i, slot):
        pull = self.stiffness[g, i] * (self.target[g] + self.offset[g, i] - self.state.x[slot, i])
        return pull + self.damping[g, i] * (self.velocity[g] - self.state.force_velocity[slot, i])

    @ti.func
    def _part(self, g, pull):
        """Part of a pull that the hand is strong enough for."""
        size = pull.norm()
        return ti.select(size > self.most[g], self.most[g] / ti.max(size, 1e-30), 1.0)

    @ti.func
    def force_on(self, i, slot):
        force = self.vector(0.0)
        for g in range(self.count):
            if self.stiffness[g, i] > 0.0:
                pull = self._pull(g, i, slot)
                force += self._part(g, pull) * pull
        return force

    @ti.func
    def dissipation_on(self, i, slot):
        """All of the force: what it works comes from outside [N]."""
        return self.force_on(i, slot)

    @ti.func
    def product_on(self, i, slot, u: ti.template(), stiff, damp):
        """Row i of (``stiff`` K + ``damp`` C) u; of a hand at the end of its strength only what it still gives."""
        return self._slope(i, slot, stiff, damp) * u[i]

    @ti.func
    def block_on(self, i, slot, stiff, damp):
        """Diagonal block of the same matrix, of particle i."""
        block = self.matrix(0.0)
        slope = self._slope(i, slot, stiff, damp)
        for axis in ti.static(range(self.dimension)):
            block[axis, axis] += slope
        return block

    @ti.func
    def _slope(self, i, slot, stiff, damp):
        slope = 0.0 * self.most[0]
        for g in range(self.count):
            if self.stiffness[g, i] > 0.0:
                part = self._part(g, self._pull(g, i, slot))
                slope += part * (stiff * self.stiffness[g, i] + damp * self.damping[g, i])
        return slope
