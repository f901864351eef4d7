"""What all colliders share: radii of particles, numbers of several solids, the response, the sweep against a ball."""

import copy
from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.contact.surface import SolvedSurface, rub
from sandbox.ledger import RUBBED
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState, place

TINY = 1e-12
BLUNT = 16.0
"""Distance from a corner that still gives no direction, over that which counts as touching [1]."""
NEVER = 2.0
"""Fraction of a path that stands for: not on this path."""


def rounding() -> float:
    """Relative rounding error of the current precision [1]."""
    return float(np.finfo("float64" if runtime.settings().precision == "f64" else "float32").eps)


@ti.func
def enter_ball(arm, path, reach):
    """Fraction of ``path`` at which it enters a ball [1]; ``arm`` leads from the centre to its start.

    By the point of closest approach: that does not cancel where the start is far away.
    """
    fraction = NEVER
    a = path.dot(path)
    b = arm.dot(path)
    if b < 0.0:
        middle = -b / a
        nearest = (arm + middle * path).norm()
        if nearest < reach:
            fraction = ti.max(middle - ti.sqrt((reach - nearest) * (reach + nearest) / a), 0.0)
    return fraction


@ti.func
def outside_box(low, high, x):
    """Distance of a point from an axis-aligned box [m]; 0 inside."""
    return ti.max(ti.max(low - x, x - high), 0.0).norm()


@ti.data_oriented
class ParticleRadius:
    """Contact radius of every particle [m]."""

    def __init__(self, builder: ti.FieldsBuilder, count: int) -> None:
        self.radius = place(builder, ti.field(runtime.real()), count)

    def load(self, assembly: Assembly) -> None:
        """Upload the radii."""
        self._write(assembly.radii)

    @ti.kernel
    def _write(self, radii: ti.types.ndarray()):
        for i in range(radii.shape[0]):
            self.radius[i] = radii[i]

    @ti.func
    def of(self, i):
        return self.radius[i]


@ti.data_oriented
class UniformRadius:
    """One contact radius for all particles [m], known when kernels compile."""

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def load(self, assembly: Assembly) -> None:
        """Nothing to upload."""

    @ti.func
    def of(self, i):
        return self.radius


@ti.data_oriented
class Constant:
    """A number, vector or matrix of the one solid there is, known when kernels compile."""

    def __init__(self, value: Any) -> None:
        self.value = value

    @ti.func
    def of(self, c):
        return self.value


@ti.data_oriented
class Column:
    """A number, vector or matrix of each of several solids, from consecutive columns of a table."""

    def __init__(self, table: Any, first: int, shape: tuple[int, ...]) -> None:
        self.table = table
        self.first = first
        self.shape = shape

    @ti.func
    def of(self, c):
        if ti.static(len(self.shape) == 0):
            return self.table[c, self.first]
        elif ti.static(len(self.shape) == 1):
            return ti.Vector([self.table[c, self.first + k] for k in ti.static(range(self.shape[0]))])
        else:
            return ti.Matrix(
                [
                    [self.table[c, self.first + row * self.shape[1] + k] for k in ti.static(range(self.shape[1]))]
                    for row in ti.static(range(self.shape[0]))
                ]
            )


@ti.data_oriented
class Numbers:
    """What tells the solids of one kind from each other; every array given has a row a solid.

    Each becomes an attribute with a function ``of(c)``: of one solid a constant, of several a look into
    a table. Kernels do not grow with the number of solids: Taichi's time to compile grows with its square.
    """

    def __init__(self, builder: ti.FieldsBuilder, **arrays: Any) -> None:
        values = {name: np.asarray(array, dtype=float) for name, array in arrays.items()}
        self.count = len(next(iter(values.values())))
        self.rows = np.concatenate([array.reshape(self.count, -1) for array in values.values()], axis=1)
        self.several = self.count > 1
        if self.several:
            self.table = place(builder, ti.field(runtime.real()), *self.rows.shape)
        first = 0
        for name, array in values.items():
            setattr(self, name, Column(self.table, first, array.shape[1:]) if self.several else _constant(array[0]))
            first += array[0].size

    def load(self) -> None:
        """Upload the table."""
        if self.several:
            self._write(np.ascontiguousarray(self.rows))

    @ti.kernel
    def _write(self, rows: ti.types.ndarray()):
        for c, k in ti.ndrange(rows.shape[0], rows.shape[1]):
            self.table[c, k] = rows[c, k]


def _constant(value: Any) -> Constant:
    if value.ndim == 0:
        return Constant(float(value))
    if value.ndim == 1:
        return Constant(runtime.vector(len(value))(value))
    return Constant(ti.types.matrix(*value.shape, runtime.real())(value))


@ti.data_oriented
class SolidCollider:
    """What all colliders share: one solid, or several of a kind and surface, met one after the other.

    A kind gives ``entry`` and ``signed_distance``, for solid ``c`` of its ``count``.

    With ``booked`` set and a ``ledger`` given before kernels compile, the ledger takes the impulses of friction,
    which the step books apart from all else that colliders do.
    """

    booked = False
    ledger: Any = None
    witnesses: tuple[Any, ...] = ()
    """Who is told of every meeting, see :meth:`seen_by`: one or none."""
    count = 1
    slack = 0.0
    """Distance within which a particle counts as touching [m]."""
    reach = 0.0
    """Farthest from the origin that the solid may be moved [m]."""
    most_hits = 1
    """How often a particle can meet the solid within one substep: a hollow one several times."""

    def __init__(self, surface: Any, radius: Any, state: ParticleState) -> None:
        self.surface = surface
        self.radius = radius
        self.state = state
        self.grazing = 8.0 * rounding()
        """Part of a path that may go into a surface and still counts as along it [1]."""

    def under_solver(self, solved: Any = None, booked: bool = False) -> "SolidCollider":
        """The same solid for particles whose velocities a solver finds, see :class:`SolvedSurface`.

        Only what ends a step is ``booked``; trial states are not.
        """
        twin = copy.copy(self)
        twin.surface = SolvedSurface(self.surface, solved)
        twin.booked = self.booked and booked
        return twin

    def seen_by(self, witness: Any, booked: bool = False) -> "SolidCollider":
        """The same solid, which tells ``witness.note`` of every meeting: for a solve that the surface shall bear."""
        twin = copy.copy(self)
        twin.witnesses = (witness,)
        twin.booked = self.booked and booked
        return twin

    @ti.func
    def resolve(self, i, start, end, v, kick, lag, duration):
        """Position and velocity after a straight move from ``start`` to ``end`` = start + duration v.

        ``v`` is the velocity at the part ``lag`` of the substep, in which forces change it by ``kick`` [m/s].
        """
        x_new, v_new = end, v
        if ti.static(self.count == 1):
            x_new, v_new = self.resolve_one(0, i, start, end, v, kick, lag, duration)
        else:
            for c in range(self.count):
                x_new, v_new = self.resolve_one(c, i, start, x_new, v_new, kick, lag, duration)
        return x_new, v_new

    @ti.func
    def resolve_one(self, c, i, start, end, v, kick, lag, duration):
        """The same with solid c alone."""
        x_new, v_new = end, v
        if ti.static(self.most_hits == 1):
            hit, fraction, place, normal = self.entry(c, start, end, self.radius.of(i))
            if hit:
                v_new, onward = self.respond(i, v, 0.0 * v, normal, kick, lag, fraction)
                x_new = place + (1.0 - fraction) * duration * onward
        else:
            x_new, v_new = self.resolve_hollow(c, i, start, end, v, kick, lag, duration)
        return x_new, v_new

    @ti.func
    def resolve_hollow(self, c, i, start, end, v, kick, lag, duration):
        """The same with a solid that a particle can meet several times within a substep."""
        x_new, v_new = end, v
        begin, done, hits = start, 0.0, 0
        normal = 0.0 * v
        # One look more than hits: what still is in the way then is a wedge, or a bow of many short edges.
        while hits <= self.most_hits:
            hit, fraction, place, met = self.entry(c, begin, self.cleared(x_new, normal), self.radius.of(i))
            hits = hits + 1
            if hit:
                done = done + (1.0 - done) * fraction
                before = normal
                normal = met
                v_new, onward = self.respond(i, v_new, 0.0 * v, normal, kick, lag, done)
                begin = place
                x_new = place + (1.0 - done) * duration * onward
                if hits > self.most_hits:
                    x_new, v_new = self.wedge(c, i, place, x_new, v_new, 0.0 * v, before, normal)
            else:
                hits = self.most_hits + 1
        return x_new, v_new

    @ti.func
    def cleared(self, x, normal):
        """The end of a path off the surface with this normal, and off what rounding leaves of a meeting with it."""
        return x + 0.25 * self.grazing * (ti.abs(x).max() + self.reach) * normal

    @ti.func
    def wedge(self, c, i, place, end, v, ground, before, normal):
        """Where a particle ends that met too many surfaces in one substep, the last two with these normals.

        Around a bow of short edges it goes on, at the place nearest to where it was led. Between two walls it stays,
        and so does its velocity: a step must not take the place and leave the speed.
        """
        x_new, v_new = end, v
        radius = self.radius.of(i)
        distance, out = self.closest(c, end)
        if distance < radius:
            x_new = end + (radius - distance) * out
            v_new = v - ti.min((v - ground).dot(out), 0.0) * out
            distance, out = self.closest(c, x_new)
            if distance < radius - 4.0 * BLUNT * self.slack:
                x_new = place
                v_new = v
                if (v - ground).dot(before) < 0.0:
                    v_new = ground
                    if ti.static(self.state.dimension == 3):
                        # Along the edge between the two it may go on.
                        edge = before.cross(normal)
                        v_new += (v - ground).dot(edge) / ti.max(edge.dot(edge), TINY) * edge
        return x_new, v_new

    @ti.func
    def respond(self, i, v, ground, normal, kick, lag, done):
        """Velocity of particle i after it met a surface that moves at ``ground``, and the one it goes on with [m/s].

        The second is the mean until the end of the substep; the others are as :meth:`resolve` has them.
        """
        relative = v - ground
        given, onward = self.surface.answer(i, relative, normal, kick, lag, done)
        bounced = v + given * normal
        after = bounced
        if ti.static(self.surface.rough):
            after = bounced - rub(relative, normal, self.surface.friction_of(i) * given)
            if ti.static(self.booked):
                self.ledger.hand_in(RUBBED, i, self.state.mass[i] * (after - bounced))
        for witness in ti.static(self.witnesses):
            bounce, friction = self.surface.restitution_of(i), self.surface.friction_of(i)
            witness.note(i, relative, after - ground, normal, ground, bounce, friction)
        mean = after
        if ti.static(self.surface.bouncy):
            mean = after + (onward - (relative.dot(normal) + given)) * normal
        return after, mean

    def entry(self, c, start, end, radius):
        """Whether the path enters the solid, at which fraction, where, and the normal there: a ti.func of each kind."""
        raise NotImplementedError

    def signed_distance(self, c, x):
        """Distance of a point from the surface [m], negative inside: a ti.func of each kind."""
        raise NotImplementedError

    def closest(self, c, x):
        """The same, and the direction away from the solid: a ti.func of each kind that is met several times."""
        raise NotImplementedError

    @ti.func
    def depth(self, i, x):
        """How far particle i is inside [m]; negative outside."""
        deepest = self.depth_in(0, i, x)
        if ti.static(self.count > 1):
            for c in range(1, self.count):
                deepest = ti.max(deepest, self.depth_in(c, i, x))
        return deepest

    @ti.func
    def depth_in(self, c, i, x):
        """How far particle i is inside solid c [m]."""
        return self.radius.of(i) - self.signed_distance(c, x)
