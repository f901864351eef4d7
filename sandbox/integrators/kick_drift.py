"""The fused step of splitting schemes: gather forces, kick, drift, meet colliders, in one pass."""

import taichi as ti

from sandbox.integrators.kick import kick_with
from sandbox.integrators.schemes import SplittingScheme
from sandbox.integrators.step_end import StepEnd
from sandbox.integrators.stepper import Setup, Stepper
from sandbox.state import SLICE

# Work (particles + half-edges) below which one serial launch wins; see benchmarks/crossover.py.
SERIAL_WORK = 300_000
# A load and the friction that it makes possible, over the load: enough for coefficients up to 1.7.
_MOST_BORNE = 2.0
_NOTHING = 1e-30
MIDDLE = 0.5
"""Part of a step at which its velocity is that of a splitting scheme's drift [1]: half a kick before, half behind."""


@ti.data_oriented
class KickDrift(Stepper):
    """Advances a state by a splitting scheme."""

    def __init__(self, setup: Setup, scheme: SplittingScheme) -> None:
        self.kick = kick_with(setup.drag)
        super().__init__(setup, self.kick)
        self.scheme = scheme
        self.end = StepEnd(setup.state, setup.parts, setup.pinned)
        self.closing = 1 if scheme.lead < 1.0 else 0
        """Passes beyond the last step: the rest of its kick, without a drift."""

    def advance(self, steps: int, dt: float, time: float) -> None:
        """Take ``steps`` steps of ``dt`` [s] from ``time`` [s]; afterwards x and v are of the same time."""
        super().advance(steps, dt, time)
        if self.closing:
            if not self.serial:
                rest = self.kick.factors((1.0 - self.scheme.lead) * dt)
                self._pass(self.state.slot, 0, *rest, 0.0, time + steps * dt)
            self.state.slot = 1 - self.state.slot

    def take_step(self, step: int, steps: int, slot: int, dt: float, time: float) -> None:
        """One step in one launch."""
        factors = self.kick.factors(self.scheme.lead * dt if step == 0 else dt)
        self._pass(slot, step, *factors, dt, time)

    def run_serial(self, slot: int, steps: int, dt: float, time: float) -> None:
        """All steps in one launch, and the closing kick."""
        lead = self.kick.factors(self.scheme.lead * dt)
        whole = self.kick.factors(dt)
        rest = self.kick.factors((1.0 - self.scheme.lead) * dt)
        self._run_serial(slot, steps, *lead, *whole, *rest, dt, time)

    @ti.kernel
    def _pass(self, slot: int, step: int, decay: float, gain: float, dt: float, time: float):
        self.pass_over(slot, decay, gain, dt, time + step * dt)

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
        time: float,
    ):
        # One loop that takes the first, middle and last kicks by selection: the step is compiled once.
        ti.loop_config(serialize=True)
        for n in range(steps + self.closing):
            step_decay, step_gain, step_dt = decay, gain, dt
            if ti.static(self.closing):
                if n == 0:
                    step_decay, step_gain = lead_decay, lead_gain
                if n == steps:
                    step_decay, step_gain, step_dt = rest_decay, rest_gain, 0.0
            begun = self.slot_at(slot, n)
            self.pass_over(begun, step_decay, step_gain, step_dt, time + n * dt)
            if ti.static(self.contact):
                if n < steps:
                    self.meet_others_serial(begun, dt)

    @ti.func
    def pass_over(self, slot, decay, gain, dt, time):
        """All particles from ``slot`` to the other one, slice by slice where laws gather for several at once."""
        self.preparation.begin(slot, time, dt)
        if ti.static(self.slicing):
            for index in range(self.slices):
                for law in ti.static(self.slicing):
                    law.gather_slice(index, slot)
                for i in range(index * SLICE, ti.min((index + 1) * SLICE, self.state.count)):
                    self.step(i, slot, decay, gain, dt)
        else:
            for i in range(self.state.count):
                self.step(i, slot, decay, gain, dt)

    @ti.func
    def step(self, i, slot, decay, gain, dt):
        """Particle i from ``slot`` to the other one; with a ``dt`` of 0 it is kicked, but does not drift."""
        for law in ti.static(self.evolving):
            law.evolve(i, slot, dt)
        force = self.vector(0.0)
        for law in ti.static(self.laws):
            force += law.force_on(i, slot)
        a = self.state.inverse_mass[i] * force
        v = self.kick.apply(self.state.v[slot, i], a, decay, gain)
        start = self.state.x[slot, i]
        x, free = start + dt * v, v
        x, v = self.end.meet(i, start, x, v, dt * a, MIDDLE, dt)
        for books in ti.static(self.books):
            books.enter(i, slot, force, x, v, decay, gain, dt)
        self.state.x[1 - slot, i] = x
        self.state.v[1 - slot, i] = v
        if ti.static(self.state.predicts_velocity):
            # The kick that ends an advance repeats the acceleration of the one that begins the next.
            kept = self.state.force_velocity[slot, i]
            ahead = 0.5 * dt * a
            if ti.static(self.end.colliders):
                ahead += self.borne(v - free, ahead)
            self.state.force_velocity[1 - slot, i] = ti.select(dt > 0.0, v + ahead, kept)

    @ti.func
    def borne(self, given, ahead):
        """What colliders will take of the velocity ``ahead`` of a particle, to which they gave so much in the step.

        Without it dampers would see what presses on a surface sink into it. What a surface gives against a load is
        twice what it takes of half a step; a blow is over with the step, so no more than the load with its friction.
        """
        most = _MOST_BORNE * ahead.norm()
        return ti.min(0.5, most / ti.max(given.norm(), _NOTHING)) * given
