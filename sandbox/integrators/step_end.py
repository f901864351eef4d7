"""What follows the free flight of a particle in every scheme: colliders, what carries it, and a word to contact."""

import taichi as ti

from sandbox.parts import Parts
from sandbox.state import ParticleState


@ti.data_oriented
class StepEnd:
    """Meets colliders and carriers at the end of a step. What a scene lacks is not compiled."""

    def __init__(self, state: ParticleState, parts: Parts, pinned: bool) -> None:
        self.state = state
        self.colliders = parts.colliders
        self.carriers = parts.carriers
        self.contact = parts.contact
        # Colliders must not push a pinned particle; without colliders a pinned one feels nothing anyway.
        self.guards_pinned = pinned and bool(parts.colliders)

    @ti.func
    def meet(self, i, start, end, v, dt):
        """Position and velocity of particle i, that flew from ``start`` to ``end`` in ``dt`` [s] and has v then."""
        x_new, v_new = end, v
        if ti.static(not self.guards_pinned) or self.state.inverse_mass[i] > 0.0:
            for collider in ti.static(self.colliders):
                x_new, v_new = collider.resolve(i, start, x_new, v_new, dt)
        for carrier in ti.static(self.carriers):
            x_new, v_new = carrier.carry(i, start, x_new, v_new, dt)
        for contact in ti.static(self.contact):
            contact.watch(i, x_new)
        return x_new, v_new
