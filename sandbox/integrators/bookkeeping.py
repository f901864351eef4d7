"""What a step enters into the energy ledger.

A kick over h from v to v' changes the kinetic energy by exactly F h (v + v') / 2, so that is the work
of each force, whatever the scheme. What potential energies do not give back of it is the scheme's own
error, and is left over on purpose.
"""

from typing import Any

import taichi as ti

from sandbox.ledger import Ledger
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
        self.carries = bool(parts.carriers)
        self.drags = hasattr(kick, "rate")
        self.drag_term = ledger.index("drag")
        self.collision_term = ledger.index("collision")
        self.drive_term = ledger.index("drive")

    @ti.func
    def enter(self, i, slot, force, x, v, decay, gain, dt):
        """Book the step of particle i that ended at x, v; ``force`` is all that acted on it [N]."""
        m = self.state.mass[i]
        before = self.state.v[slot, i]
        start = self.state.x[slot, i]
        inverse = self.state.inverse_mass[i]
        kicked = self.kick.apply(before, inverse * force, decay, gain)
        way = self.kick.duration(decay, gain) * 0.5 * (before + kicked)
        if inverse == 0.0:
            way = x - start
        for k in ti.static(range(len(self.dissipating))):
            self.ledger.add(self.terms[k], i, self.dissipating[k].dissipation_on(i, slot).dot(way))
        if inverse > 0.0:
            if ti.static(self.drags):
                change = 0.5 * m * (kicked - before).dot(kicked + before)
                self.ledger.add(self.drag_term, i, change - force.dot(way))
            if ti.static(self.collides):
                # What a collider does to the place, it does against the forces.
                change = 0.5 * m * (v - kicked).dot(v + kicked)
                self.ledger.add(self.collision_term, i, change - force.dot(x - start - dt * kicked))
        elif ti.static(self.carries):
            self.ledger.add(self.drive_term, i, 0.5 * m * (v - before).dot(v + before) - force.dot(way))
