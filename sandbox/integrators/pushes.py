"""What colliders give to particles within the iterations of constraints: velocities that are found anew every time.

After each iteration every particle's velocity without what colliders gave it so far meets them anew, without
restitution but with friction. So a push is never more than the load, and gone with it, and a body bears its own weight
however long the step. The end of the step does the same once more, and there what had arrived by itself, at the
velocity that forces alone led to, bounces. Why not as other solves do: :mod:`sandbox.integrators.bearing`.
"""

from dataclasses import replace

import taichi as ti

from sandbox import runtime
from sandbox.integrators.step_end import StepEnd
from sandbox.parts import Parts
from sandbox.state import ParticleState, place


@ti.data_oriented
class Pushes:
    """What the colliders of a scene give to every particle in a trial state."""

    def __init__(self, builder: ti.FieldsBuilder, state: ParticleState, parts: Parts, pinned: bool) -> None:
        self.state = state
        self.vector = runtime.vector(state.dimension)
        self.push = place(builder, self.vector.field(), state.count)
        """Part of the trial velocity [m/s]."""
        bouncy = any(collider.surface.bouncy for collider in parts.colliders)
        self.bounces = [place(builder, self.vector.field(), state.count)] if bouncy else []
        """What constraints gave to velocities in the step [m/s]; only where there is restitution."""
        given = self.bounces[0] if bouncy else None
        self.ends = [collider.under_solver(given, booked=True) for collider in parts.colliders]
        """The colliders as the end of the step meets them."""
        trials = [collider.under_solver() for collider in parts.colliders]
        self.trial_end = StepEnd(state, replace(parts, colliders=trials, carriers=[], contact=[]), pinned)

    @ti.func
    def begin(self, i):
        """Nothing has pushed particle i in this step."""
        self.push[i] = self.vector(0.0)

    @ti.func
    def renew(self, i, slot, dt):
        """Find anew what colliders must give to the velocity of particle i."""
        if self.state.inverse_mass[i] > 0.0:
            start = self.state.x[slot, i]
            free = self.state.v[1 - slot, i] - self.push[i]
            end = start + dt * free
            kept, _ = self.trial_end.meet(i, start, end, free, 0.0 * free, 1.0, dt)
            push = (kept - end) / dt
            self.push[i] = push
            self.state.v[1 - slot, i] = free + push

    @ti.func
    def end(self, i, given):
        """Let what arrives bounce, but not what constraints gave to velocities in the step, ``given`` [m/s]."""
        for bounces in ti.static(self.bounces):
            bounces[i] = given
