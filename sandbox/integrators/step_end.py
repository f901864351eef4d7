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
    def meet(self, i, start, end, v, kick, lag, dt):
        """Position and velocity of particle i, that flew from ``start`` to ``end`` in ``dt`` [s] and has v then.

        v is its velocity at the part ``lag`` of the step, in which forces change it by ``kick`` [m/s].
        """
        x_new, v_new = self._keep_out(i, start, end, v, kick, lag, dt)
        return self._carry(i, start, x_new, v_new, dt)

    @ti.func
    def meet_pressed(self, i, start, end, v, kick, dt):
        """The same of a scheme whose ``end`` is not start + dt v.

        Whether a particle meets a surface is asked of start + dt v: one that is pressed on it has a velocity into
        it at the end, though the mean of its velocities may well lead along it. Where the surface is, it is left.
        """
        x_new, v_new = end, v
        if ti.static(self.colliders):
            led = start + dt * v
            x_met, v_new = self._keep_out(i, start, led, v, kick, 1.0, dt)
            out = x_met - led
            size = out.norm()
            if size > 0.0:
                n = out / size
                x_new = end + (x_met - end).dot(n) * n
        return self._carry(i, start, x_new, v_new, dt)

    @ti.func
    def _keep_out(self, i, start, end, v, kick, lag, dt):
        x_new, v_new = end, v
        if ti.static(not self.guards_pinned) or self.state.inverse_mass[i] > 0.0:
            for collider in ti.static(self.colliders):
                x_new, v_new = collider.resolve(i, start, x_new, v_new, kick, lag, dt)
        return x_new, v_new

    @ti.func
    def _carry(self, i, start, x, v, dt):
        x_new, v_new = x, v
        for carrier in ti.static(self.carriers):
            x_new, v_new = carrier.carry(i, start, x_new, v_new, dt)
        for contact in ti.static(self.contact):
            contact.watch(i, x_new)
        return x_new, v_new
