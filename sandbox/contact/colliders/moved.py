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

    @ti.func
    def resolve_one(self, c, i, start, end, v, duration):
        """Position and velocity after a straight move from ``start`` to ``end`` = start + duration v."""
        row = self.first + c
        radius = self.radius.of(i)
        begin = self.motions.to_local(row, START, start)
        goal = self.motions.to_local(row, END, end)
        x_new, v_new = end, v
        done, hits = 0.0, 0
        # Not a constant, or LLVM would write out every pass: the kernel then takes three times as long to compile.
        most = ti.select(duration >= 0.0, self.most_hits, 0)
        # One look more than hits: what turned under the particle meanwhile must not swallow it.
        while hits <= most:
            hit, fraction, place, normal = self.inner.entry(c, begin, goal, radius)
            hits = hits + 1
            if hit:
                done = done + (1.0 - done) * fraction
                late = self.motions.to_world(row, END, place)
                # Where nothing more is looked for, it rides along until the next substep.
                x_new = late
                if hits <= most:
                    early = self.motions.to_world(row, START, place)
                    v_new = self._meet(row, i, v_new, place, normal, done)
                    if ti.static(self.inner.most_hits == 1) or hits < most:
                        # Between both poses along the chord: an arc differs in the second order of the step.
                        x_new = early + done * (late - early) + (1.0 - done) * duration * v_new
                    begin = place
                    goal = self.motions.to_local(row, END, x_new)
                    if hits == most:
                        begin = goal
            else:
                hits = most + 1
        return x_new, v_new

    @ti.func
    def _meet(self, row, i, v, place, normal, fraction):
        """Velocity of a particle after it met the surface at a fraction of the substep."""
        out = (1.0 - fraction) * self.motions.turned(row, START, normal)
        out += fraction * self.motions.turned(row, END, normal)
        ground = self.motions.velocity_at(row, MIDDLE, self.motions.turned(row, MIDDLE, place))
        return self.respond(i, v, ground, out.normalized())

    @ti.func
    def signed_distance(self, c, x):
        """Distance from the surface where the last substep left it [m]."""
        return self.inner.signed_distance(c, self.motions.to_local(self.first + c, END, x))

    @ti.func
    def depth_in(self, c, i, x):
        return self.inner.depth_in(c, i, self.motions.to_local(self.first + c, END, x))
