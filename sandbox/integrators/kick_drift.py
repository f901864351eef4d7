"""The fused step of splitting schemes: gather forces, kick, drift, meet colliders, in one pass.

Two kernels share the same ``step`` of one particle. The serial one runs all steps of a frame in a
single launch, which is faster for small scenes: a parallel loop costs some 0.1 ms to start, whatever
its size. Which one a simulation uses depends on its size alone, so that the number of threads never
changes a result.
"""

import taichi as ti

from sandbox import runtime
from sandbox.integrators.bookkeeping import Bookkeeping
from sandbox.integrators.kick import DragKick, PlainKick
from sandbox.integrators.preparation import Preparation
from sandbox.integrators.schemes import SplittingScheme
from sandbox.integrators.step_end import StepEnd
from sandbox.parts import Parts
from sandbox.state import SLICE, ParticleState

# Work (particles + half-edges) below which one serial launch wins; see benchmarks/crossover.py.
SERIAL_WORK = 300_000


@ti.data_oriented
class KickDrift:
    """Advances a state by a splitting scheme with the given parts."""

    def __init__(
        self, scheme: SplittingScheme, state: ParticleState, parts: Parts, drag: float, pinned: bool, serial: bool
    ) -> None:
        self.scheme = scheme
        self.state = state
        self.laws = parts.laws
        self.slicing = [law for law in parts.laws if hasattr(law, "gather_slice")]
        self.evolving = [law for law in parts.laws if getattr(law, "changes", False)]
        self.preparation = Preparation(parts)
        self.slices = state.capacity // SLICE
        self.end = StepEnd(state, parts, pinned)
        self.contact = parts.contact
        self.kick = DragKick(drag) if drag > 0.0 else PlainKick()
        self.books = [Bookkeeping(state, parts, self.kick, ledger) for ledger in parts.ledger]
        self.serial = serial
        self.vector = runtime.vector(state.dimension)

    def advance(self, steps: int, dt: float, time: float) -> None:
        """Take ``steps`` steps of ``dt`` [s] from ``time`` [s]; afterwards x and v are of the same time."""
        lead = self.kick.factors(self.scheme.lead * dt)
        whole = self.kick.factors(dt)
        rest = self.kick.factors((1.0 - self.scheme.lead) * dt)
        ahead = 0.5 * dt
        for contact in self.contact:
            contact.invalidate()
        if self.serial:
            self._run_serial(self.state.slot, steps, *lead, *whole, *rest, dt, ahead, time)
        else:
            self._run_parallel(steps, lead, whole, rest, dt, ahead, time)
        # With contact a step ends in the slot that it began in.
        passes = (0 if self.contact else steps) + (self.scheme.lead < 1.0)
        self.state.slot = (self.state.slot + passes) % 2

    def _run_parallel(
        self,
        steps: int,
        lead: tuple[float, float],
        whole: tuple[float, float],
        rest: tuple[float, float],
        dt: float,
        ahead: float,
        time: float,
    ) -> None:
        slot = self.state.slot
        for step in range(steps):
            factors = lead if step == 0 else whole
            self._step_parallel(slot, *factors, dt, ahead, time + step * dt)
            if self.contact:
                self.contact[0].resolve(1 - slot, slot, dt)
            else:
                slot = 1 - slot
        if self.scheme.lead < 1.0:
            self._step_parallel(slot, *rest, 0.0, 0.0, time + steps * dt)

    @ti.kernel
    def _step_parallel(self, slot: int, decay: float, gain: float, dt: float, ahead: float, time: float):
        self.preparation.begin(slot, time, dt)
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
        time: float,
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
            source = (slot + n) % 2
            if ti.static(self.contact):
                source = slot
            self.preparation.begin(source, time + n * dt, step_dt)
            if ti.static(self.slicing):
                for index in range(self.slices):
                    self.step_slice(index, source, step_decay, step_gain, step_dt, step_ahead)
            else:
                for i in range(self.state.count):
                    self.step(i, source, step_decay, step_gain, step_dt, step_ahead)
            if ti.static(self.contact):
                if n < steps:
                    self.contact[0].resolve_serial(1 - source, source, dt)

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
        for law in ti.static(self.evolving):
            law.evolve(i, slot, dt)
        force = self.vector(0.0)
        for law in ti.static(self.laws):
            force += law.force_on(i, slot)
        a = self.state.inverse_mass[i] * force
        v = self.kick.apply(self.state.v[slot, i], a, decay, gain)
        start = self.state.x[slot, i]
        x = start + dt * v
        x, v = self.end.meet(i, start, x, v, dt)
        for books in ti.static(self.books):
            books.enter(i, slot, force, x, v, decay, gain, dt)
        self.state.x[1 - slot, i] = x
        self.state.v[1 - slot, i] = v
        if ti.static(self.state.predicts_velocity):
            # The kick that ends an advance repeats the acceleration of the one that begins the next.
            kept = self.state.force_velocity[slot, i]
            self.state.force_velocity[1 - slot, i] = ti.select(dt > 0.0, v + ahead * a, kept)
