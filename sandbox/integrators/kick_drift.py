"""The fused step of splitting schemes: gather forces, kick, drift, meet colliders, in one pass.

Two kernels share the same ``step`` of one particle. The serial one runs all steps of a frame in a
single launch, which is faster for small scenes: a parallel loop costs some 0.1 ms to start, whatever
its size. Which one a simulation uses depends on its size alone, so that the number of threads never
changes a result.
"""

from typing import Any

import taichi as ti

from sandbox import runtime
from sandbox.integrators.kick import DragKick, PlainKick
from sandbox.integrators.schemes import SplittingScheme
from sandbox.state import SLICE, ParticleState

# Work (particles + half-edges) below which one serial launch wins; see benchmarks/crossover.py.
SERIAL_WORK = 300_000


@ti.data_oriented
class KickDrift:
    """Advances a state by a splitting scheme with the given laws and colliders."""

    def __init__(
        self,
        scheme: SplittingScheme,
        state: ParticleState,
        laws: list[Any],
        colliders: list[Any],
        drag: float,
        pinned: bool,
        serial: bool,
    ) -> None:
        self.scheme = scheme
        self.state = state
        self.laws = laws
        self.slicing = [law for law in laws if hasattr(law, "gather_slice")]
        self.slices = state.capacity // SLICE
        self.colliders = colliders
        self.kick = DragKick(drag) if drag > 0.0 else PlainKick()
        # Colliders must not push a pinned particle; without colliders a pinned one feels nothing anyway.
        self.guards_pinned = pinned and bool(colliders)
        self.serial = serial
        self.vector = runtime.vector(state.dimension)

    def advance(self, steps: int, dt: float) -> None:
        """Take ``steps`` steps of ``dt`` [s]; afterwards positions and velocities are of the same time."""
        lead = self.kick.factors(self.scheme.lead * dt)
        whole = self.kick.factors(dt)
        rest = self.kick.factors((1.0 - self.scheme.lead) * dt)
        ahead = 0.5 * dt
        if self.serial:
            self._run_serial(self.state.slot, steps, *lead, *whole, *rest, dt, ahead)
            passes = steps + (self.scheme.lead < 1.0)
        else:
            passes = self._run_parallel(steps, lead, whole, rest, dt, ahead)
        self.state.slot = (self.state.slot + passes) % 2

    def _run_parallel(
        self,
        steps: int,
        lead: tuple[float, float],
        whole: tuple[float, float],
        rest: tuple[float, float],
        dt: float,
        ahead: float,
    ) -> int:
        slot = self.state.slot
        for step in range(steps):
            factors = lead if step == 0 else whole
            self._step_parallel((slot + step) % 2, *factors, dt, ahead)
        if self.scheme.lead == 1.0:
            return steps
        self._step_parallel((slot + steps) % 2, *rest, 0.0, 0.0)
        return steps + 1

    @ti.kernel
    def _step_parallel(self, slot: int, decay: float, gain: float, dt: float, ahead: float):
        if ti.static(self.slicing):
            for index in range(self.slices):
                self.step_slice(index, slot, decay, gain, dt, ahead)
        else:
            for i in range(self.state.count):
                self.step(i, slot, decay, gain, dt, ahead)

    @ti.kernel
    def _run_serial(
        self,
        slot: int,
        steps: int,
        lead_decay: float,
        lead_gain: float,
        decay: float,
        gain: float,
        rest_decay: float,
        rest_gain: float,
        dt: float,
        ahead: float,
    ):
        # One loop that takes the first, middle and last kicks by selection: the step is compiled once.
        passes = steps
        if ti.static(self.scheme.lead < 1.0):
            passes = steps + 1
        ti.loop_config(serialize=True)
        for n in range(passes):
            step_decay, step_gain, step_dt, step_ahead = decay, gain, dt, ahead
            if ti.static(self.scheme.lead < 1.0):
                if n == 0:
                    step_decay, step_gain = lead_decay, lead_gain
                if n == steps:
                    step_decay, step_gain, step_dt, step_ahead = rest_decay, rest_gain, 0.0, 0.0
            if ti.static(self.slicing):
                for index in range(self.slices):
                    self.step_slice(index, (slot + n) % 2, step_decay, step_gain, step_dt, step_ahead)
            else:
                for i in range(self.state.count):
                    self.step(i, (slot + n) % 2, step_decay, step_gain, step_dt, step_ahead)

    @ti.func
    def step_slice(self, index, slot, decay, gain, dt, ahead):
        """A slice of consecutive particles: what laws gather for all of them at once, then each by itself."""
        for law in ti.static(self.slicing):
            law.gather_slice(index, slot)
        for i in range(index * SLICE, ti.min((index + 1) * SLICE, self.state.count)):
            self.step(i, slot, decay, gain, dt, ahead)

    @ti.func
    def step(self, i, slot, decay, gain, dt, ahead):
        """Particle i from ``slot`` to the other one."""
        force = self.vector(0.0)
        for law in ti.static(self.laws):
            force += law.force_on(i, slot)
        a = self.state.inverse_mass[i] * force
        v = self.kick.apply(self.state.v[slot, i], a, decay, gain)
        start = self.state.x[slot, i]
        x = start + dt * v
        if ti.static(not self.guards_pinned) or self.state.inverse_mass[i] > 0.0:
            for collider in ti.static(self.colliders):
                x, v = collider.resolve(i, start, x, v, dt)
        self.state.x[1 - slot, i] = x
        self.state.v[1 - slot, i] = v
        if ti.static(self.state.predicts_velocity):
            # The kick that ends an advance repeats the acceleration of the one that begins the next.
            kept = self.state.force_velocity[slot, i]
            self.state.force_velocity[1 - slot, i] = ti.select(dt > 0.0, v + ahead * a, kept)
