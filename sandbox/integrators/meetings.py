"""Colliders within sweeps: what a surface does to a particle that its springs hold, too.

A particle that a sweep moves answers an impulse J with A^-1 J, A being its matrix, and not with J / m. So Signorini's
and Coulomb's laws are solved with A: the normal velocity is what restitution wants of the velocity that the particle
arrived with, or more; the surface never pulls; friction holds the particle if that takes no more than mu times the
normal impulse, else it works against the sliding with just that. For a free particle this is what every other scheme
does. Source: Jean, "The non-smooth contact dynamics method", Comput. Methods Appl. Mech. Eng. 177 (1999). Why not as
other solves do: :mod:`sandbox.integrators.bearing`.
"""

from typing import Any

import taichi as ti

from sandbox.integrators.bearing import FREE, Bearing
from sandbox.integrators.small_systems import solved
from sandbox.state import ParticleState, place

ONE, SEVERAL = 1, 2
"""Surfaces that a particle met in its last move."""
_JAMMED = 0.05
"""Least part of its way out that friction may leave a sliding particle before it counts as held [1]."""
_SAME = 0.9999
"""Cosine of an angle between normals above which it is one surface, met again by rounding [1]."""
_SLOWEST = 1e-12
"""Speed below which a direction is not worth a division [m/s]."""


@ti.data_oriented
class Meetings(Bearing):
    """Moves of particles under a solver, from the start of a step to where colliders let them.

    A particle that met a surface in its last move met ONE or SEVERAL.

    Attributes
    ----------
    solved : what the solver gave to the velocity in this step [m/s], vectors; restitution leaves it out
    """

    def __init__(self, builder: ti.FieldsBuilder, state: ParticleState, colliders: list[Any]) -> None:
        super().__init__(builder, state)
        self.solved = place(builder, self.vector.field(), state.count)
        self.colliders = [collider.under_solver(self.solved).seen_by(self) for collider in colliders]

    @ti.func
    def note(self, i, before, after, normal, ground, restitution, friction):
        """Particle i met a surface with a relative velocity ``before``, and leaves it with ``after`` [m/s]."""
        if self.mode[i] == FREE:
            self.mode[i] = ONE
        elif normal.dot(self.normal[i]) < _SAME:
            self.mode[i] = SEVERAL
        self.note_surface(i, normal, ground, friction, after.dot(normal))

    @ti.func
    def move(self, i, slot, end, v, matrix, factor, dt):
        """Let particle i fly to ``end`` [m] at velocity v [m/s], where it would go without colliders."""
        start, trial = self.state.x[slot, i], 1 - slot
        before = self.mode[i]
        self.solved[i] = v - self.state.v[slot, i]
        self.mode[i] = FREE
        x_new, v_new = end, v
        for collider in ti.static(self.colliders):
            x_new, v_new = collider.resolve(i, start, x_new, v_new, 0.0 * v, 1.0, dt)
        if self.mode[i] == FREE and before == ONE:
            # What presses is not let go because its way, with what it was given, ends before the surface.
            if (v - self.ground[i]).dot(self.normal[i]) < self.rebound[i]:
                self.mode[i] = ONE
                x_new = self.state.x[trial, i]
                v_new = self.state.v[trial, i]
            else:
                x_new = start + dt * v
        if self.mode[i] == ONE:
            last = self.state.v[trial, i]
            if before != ONE:
                last = v
            held = self.answer(i, v, last, matrix, factor)
            # Along the surface it had that velocity all the time; how far it is from it, the collider has said.
            n = self.normal[i]
            way = start + dt * held
            x_new = way + (x_new - way).dot(n) * n
            v_new = held
        self.state.x[trial, i] = x_new
        self.state.v[trial, i] = v_new

    @ti.func
    def answer(self, i, v, last, matrix, factor):
        """Velocity of particle i that would have v without the surface, and had ``last`` in the sweep before."""
        n, mu = self.normal[i], self.friction[i]
        stuck = self.ground[i] + self.rebound[i] * n
        out = solved(factor, n)
        lacking = ti.max(n.dot(stuck - v), 0.0)
        result = v + lacking / n.dot(out) * out
        if mu > 0.0:
            needed = matrix @ (stuck - v)
            pressed = needed.dot(n)
            aside = needed - pressed * n
            if aside.norm() <= mu * pressed:
                result = stuck
            else:
                result = self.slowed(v, stuck, last - stuck, result, n, mu, lacking, n.dot(out), factor)
        return result

    @ti.func
    def slowed(self, v, stuck, slide, smooth, n, mu, lacking, least, factor):
        """Velocity of a sliding particle: ``stuck`` if it were held, ``smooth`` without friction.

        Friction works against the sliding that there is, which in the end is that of the sweep before, ``slide``.
        """
        way = smooth - stuck
        if slide.dot(way) > 0.0:
            way = slide
        way -= way.dot(n) * n
        way = way / ti.max(way.norm(), _SLOWEST)
        out = solved(factor, n - mu * way)
        result = stuck
        if n.dot(out) > _JAMMED * least:
            result = v + lacking / n.dot(out) * out
            if (result - stuck).dot(way) < 0.0:
                result = stuck
        return result

    @ti.func
    def excess(self, i, r):
        """What of an impulse r [N s], needed to hold particle i as it is, its surface cannot give."""
        rest = r
        if self.mode[i] == SEVERAL:
            rest = 0.0 * r
        elif self.mode[i] == ONE:
            n = self.normal[i]
            pressed = ti.max(r.dot(n), 0.0)
            along = r - r.dot(n) * n
            size = along.norm()
            along *= ti.max(size - self.friction[i] * pressed, 0.0) / ti.max(size, _SLOWEST)
            rest = along + (r.dot(n) - pressed) * n
        return rest
