"""Any collider in motion: the path of a particle is seen from the collider's own frame."""

from typing import Any

import taichi as ti

from sandbox.contact.colliders.solid import SolidCollider
from sandbox.contact.moving import END, MIDDLE, START, Motions


@ti.data_oriented
class MovingCollider(SolidCollider):
    """Solids about their own origins, at the poses of ``motions`` from row ``first`` on.

    A path starts in the frame at the start of the substep and ends in the one at its end, so a fast
    collider sweeps a resting particle just as a fast particle meets a resting collider. The surface
    responds to the velocity relative to its own in the middle of the substep.
    """

    def __init__(self, inner: SolidCollider, motions: Motions, first: int) -> None:
        super().__init__(inner.surface, inner.radius, inner.state)
        self.inner: Any = inner
        self.motions = motions
        self.first = first
        self.count = inner.count
        self.most_hits = inner.most_hits
        self.slack = inner.slack

    @ti.func
    def resolve_one(self, c, i, start, end, v, kick, lag, duration):
        """Position and velocity after a straight move from ``start`` to ``end`` = start + duration v."""
        row = self.first + c
        radius = self.radius.of(i)
        begin = self.motions.to_local(row, START, start)
        goal = self.motions.to_local(row, END, end)
        x_new, v_new = end, v
        done, hits = 0.0, 0
        out = 0.0 * v
        # Not a constant, or LLVM would write out every pass: the kernel then takes three times as long to compile.
        most = ti.select(duration >= 0.0, self.most_hits, 0)
        # One look more than hits: what turned under the particle meanwhile must not swallow it.
        while hits <= most:
            hit, fraction, place, normal = self.inner.entry(c, begin, goal, radius)
            hits = hits + 1
            if hit:
                done = done + (1.0 - done) * fraction
                early = self.motions.to_world(row, START, place)
                late = self.motions.to_world(row, END, place)
                before = out
                out = (1.0 - done) * self.motions.turned(row, START, normal) + done * self.motions.turned(
                    row, END, normal
                )
                out = out.normalized()
                ground = self.motions.velocity_at(row, MIDDLE, self.motions.turned(row, MIDDLE, place))
                v_new, onward = self.respond(i, v_new, ground, out, kick, lag, done)
                # Between both poses along the chord: an arc differs in the second order of the step.
                x_new = early + done * (late - early) + (1.0 - done) * duration * onward
                begin = place
                goal = self.motions.to_local(row, END, x_new)
                if ti.static(self.inner.most_hits > 1):
                    goal = self.inner.cleared(goal, normal)
                if hits > most:
                    x_new = late  # nothing more is looked for: it rides along until the next substep
                    if ti.static(self.inner.most_hits > 1):
                        led = self.motions.to_world(row, END, goal)
                        x_new, v_new = self.wedge(c, i, late, led, v_new, ground, before, out)
            else:
                hits = most + 1
        return x_new, v_new

    @ti.func
    def closest(self, c, x):
        """The same, and the direction away from the solid: where the last substep left it."""
        row = self.first + c
        distance, normal = self.inner.closest(c, self.motions.to_local(row, END, x))
        return distance, self.motions.turned(row, END, normal)

    @ti.func
    def signed_distance(self, c, x):
        """Distance from the surface where the last substep left it [m]."""
        return self.inner.signed_distance(c, self.motions.to_local(self.first + c, END, x))

    @ti.func
    def depth_in(self, c, i, x):
        return self.inner.depth_in(c, i, self.motions.to_local(self.first + c, END, x))
