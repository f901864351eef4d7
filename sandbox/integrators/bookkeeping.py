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
        """Book the step of particle i that ended at x, v; ``force`` is all that acted on it [N]."""
        m = self.state.mass[i]
        w = self.state.inverse_mass[i]
        start = self.state.x[slot, i]
        begun = self.state.v[slot, i]
        kicked = self.kick.apply(begun, w * force, decay, gain)
        duration = self.kick.duration(decay, gain)
        before = begun
        if ti.static(self.meets):
            along, across = self.ledger.take(ALONG, i), self.ledger.take(ACROSS, i)
            before = begun - w * (along + across)
            self.ledger.add(self.contact_term, i, along.dot(0.5 * (before + v)))
            self.ledger.add(self.friction_term, i, across.dot(0.5 * (before + v)))
        mean = 0.5 * (before + v)
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
                rubbed = self.ledger.take(RUBBED, i)
                self.ledger.add(self.friction_term, i, rubbed.dot(mean))
                # What a collider does to the place beyond the velocity, it does against the forces: half against
                # those before, half against those after.
                pushed = 0.0 * w
                if dt > 0.0:
                    pushed = 0.5 * conservative.dot(x - start - dt * v + self.ledger.take(MOVED, i))
                    self.ledger.hand_in(MOVED, i, x - start - dt * v)
                self.ledger.add(self.collision_term, i, (m * (v - kicked) - rubbed).dot(mean) - pushed)
        elif ti.static(self.carries):
            self.ledger.add(self.drive_term, i, 0.5 * m * (v - begun).dot(v + begun) - force.dot(way))
