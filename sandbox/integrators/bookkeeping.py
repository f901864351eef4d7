"""What a step enters into the energy ledger.

All that changes a velocity from v to v' between two drifts, forces over the time of a kick and impulses
of collisions alike, changes the kinetic energy by exactly the sum of impulse times (v + v') / 2. So
that is the work of each, whatever the scheme. What potential energies do not give back of it is the
scheme's own error, and is left over on purpose.

A particle at rest under a load is kicked and stopped again in every step; as v = v' = 0, no work is
booked for either, which is how it should be.
"""

from typing import Any

import taichi as ti

from sandbox.ledger import ACROSS, ALONG, MOVED, RUBBED, Ledger
from sandbox.state import ParticleState


@ti.data_oriented
class Bookkeeping:
    """Books for every particle and step what is neither kinetic nor potential energy."""

    def __init__(self, state: ParticleState, parts: Any, kick: Any, ledger: Ledger) -> None:
        self.state = state
        self.kick = kick
        self.ledger = ledger
        self.dissipating = [law for law in parts.laws if hasattr(law, "dissipation_on")]
        self.terms = [ledger.index(law.dissipation_term) for law in self.dissipating]
        self.collides = bool(parts.colliders)
        self.meets = bool(parts.contact)
        self.carries = bool(parts.carriers)
        self.drags = hasattr(kick, "rate")
        self.contact_term, self.friction_term = ledger.index("contact"), ledger.index("friction")
        self.drag_term = ledger.index("drag")
        self.collision_term = ledger.index("collision")
        self.drive_term = ledger.index("drive")

    @ti.func
    def enter(self, i, slot, force, x, v, decay, gain, dt):
        """Book the kick and drift of particle i that ended at x, v; ``force`` is all that acted on it [N]."""
        m = self.state.mass[i]
        w = self.state.inverse_mass[i]
        start = self.state.x[slot, i]
        begun = self.state.v[slot, i]
        kicked = self.kick.apply(begun, w * force, decay, gain)
        duration = self.kick.duration(decay, gain)
        mean = 0.5 * (self.met(i, begun, v) + v)
        way = duration * mean
        if w == 0.0:
            way = x - start
        conservative = force
        for k in ti.static(range(len(self.dissipating))):
            lossy = self.dissipating[k].dissipation_on(i, slot)
            conservative -= lossy
            self.ledger.add(self.terms[k], i, lossy.dot(way))
        if w > 0.0:
            if ti.static(self.drags):
                self.ledger.add(self.drag_term, i, (m * (kicked - begun) - duration * force).dot(mean))
            if ti.static(self.collides):
                pushed = 0.0 * x
                if dt > 0.0:
                    pushed = x - start - dt * v
                self.collide(i, conservative, pushed, kicked, v, mean, dt)
        elif ti.static(self.carries):
            self.drive(i, begun, v, force.dot(way))

    @ti.func
    def met(self, i, begun, v):
        """Book what contact gave particle i after the last drift; the velocity that it had before that.

        The particle had ``begun`` [m/s] after it and has ``v`` now.
        """
        before = begun
        if ti.static(self.meets):
            along, across = self.ledger.take(ALONG, i), self.ledger.take(ACROSS, i)
            before = begun - self.state.inverse_mass[i] * (along + across)
            self.ledger.add(self.contact_term, i, along.dot(0.5 * (before + v)))
            self.ledger.add(self.friction_term, i, across.dot(0.5 * (before + v)))
        return before

    @ti.func
    def collide(self, i, conservative, pushed, kicked, v, mean, dt):
        """Book what colliders made of a velocity ``kicked``, at the mean velocity of the step [m/s].

        What a collider does to the place beyond the velocity, ``pushed`` [m], it does against the forces: half
        against those before, half against those after.
        """
        rubbed = self.ledger.take(RUBBED, i)
        self.ledger.add(self.friction_term, i, rubbed.dot(mean))
        work = 0.0 * mean[0]
        if dt > 0.0:
            work = 0.5 * conservative.dot(pushed + self.ledger.take(MOVED, i))
            self.ledger.hand_in(MOVED, i, pushed)
        self.ledger.add(self.collision_term, i, (self.state.mass[i] * (v - kicked) - rubbed).dot(mean) - work)

    @ti.func
    def drive(self, i, begun, v, work):
        """Book what moves a carried particle, on which forces did ``work`` [J]."""
        self.ledger.add(self.drive_term, i, 0.5 * self.state.mass[i] * (v - begun).dot(v + begun) - work)

    @ti.func
    def stage(self, i, slot, weight, force):
        """Book the forces at the state in ``slot``, for ``weight`` [s] of their power.

        Of all the ``force`` [N] on the particle the part that loses energy is returned.
        """
        v = self.state.v[slot, i]
        total = 0.0 * v
        for k in ti.static(range(len(self.dissipating))):
            lossy = self.dissipating[k].dissipation_on(i, slot)
            total += lossy
            self.ledger.add(self.terms[k], i, weight * lossy.dot(v))
        if ti.static(self.carries):
            if self.state.inverse_mass[i] == 0.0:
                self.ledger.add(self.drive_term, i, -weight * force.dot(v))
        return total

    @ti.func
    def finish(self, i, begun, conservative, moved, free, v, dt):
        """Book the end of a step whose forces :meth:`stage` booked.

        It began with a velocity ``begun`` and would have ended with ``free``; colliders and carriers made that v
        [m/s], and moved the particle by ``moved`` [m].
        """
        mean = 0.5 * (self.met(i, begun, v) + v)
        if self.state.inverse_mass[i] > 0.0:
            if ti.static(self.collides):
                self.collide(i, conservative, moved - dt * (v - free), free, v, mean, dt)
        elif ti.static(self.carries):
            self.drive(i, begun, v, 0.0)

    @ti.func
    def settle(self, i, conservative):
        """Book the second half of what colliders moved particle i by at the end of the last step, see below."""
        if ti.static(self.collides):
            work = 0.5 * conservative.dot(self.ledger.take(MOVED, i))
            self.ledger.add(self.collision_term, i, -work)

    @ti.func
    def land(self, i, begun, conservative, moved, free, v):
        """Book the end of a step that flies to its end as if there were no colliders, and is then put right by them.

        It began with a velocity ``begun`` and flew to one of ``free``; colliders and carriers made that v [m/s], and
        moved the particle by ``moved`` [m], against the forces before, ``conservative`` [N], and those behind: half
        each.
        """
        if ti.static(self.meets):
            self.met(i, begun, begun)
        if self.state.inverse_mass[i] > 0.0:
            if ti.static(self.collides):
                mean = 0.5 * (free + v)
                rubbed = self.ledger.take(RUBBED, i)
                self.ledger.add(self.friction_term, i, rubbed.dot(mean))
                given = self.state.mass[i] * (v - free) - rubbed
                self.ledger.add(self.collision_term, i, given.dot(mean) - 0.5 * conservative.dot(moved))
                self.ledger.hand_in(MOVED, i, moved)
        elif ti.static(self.carries):
            self.drive(i, begun, v, 0.0)
