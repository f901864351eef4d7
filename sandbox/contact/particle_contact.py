"""Contact of particles with particles, of one body or of several: discs in 2D, balls in 3D.

Pairs that touch exchange impulses along their line of centres, all at the same positions and at once:
linear and angular momentum are kept to rounding, in any heap. Where a particle touches several others, each
pair works with its share of the mass, m / n (mass splitting: Tonge, Benevolenski and Voroshilov, "Mass
splitting for jitter-free parallel rigid body simulation", ACM Trans. Graph. 31 (2012)): the shares of a
particle that part ways are averaged, which can only lose kinetic energy. A pair by itself is the textbook's.

Overlap is not pushed out, as moving particles under their velocities changes angular momentum: it makes
the speed at which a pair shall part, PUSH of the overlap a step, and a pair that parts just as a push had it
is slowed down again as the overlap vanishes, so that it comes to rest. A push thus never gives more than the
overlap is worth: as if the pair were a spring of stiffness PUSH m / (n_i + n_j) / dt^2 (equal masses m), damped
to death. A load F [N] on a pair makes it overlap by the F over that, so smaller steps make harder particles.

A pair that touches nobody else meets exactly: impulse at the instant of touching within the step, then on
with the new velocities. Up to 2 (r_i + r_j) of relative way a step two such particles that meet head-on are seen
and bounce; in a heap, up to r_i + r_j; a graze whose chord is shorter than a step's way can be missed.

Friction (Coulomb) acts on centres, as particles have no spin: linear momentum is exact with it, angular is not.
Particles at the very same place leave each other alone for that step; so do two pinned ones.
"""

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.contact.neighbours import ContactSetup, Neighbours
from sandbox.ledger import ACROSS, ALONG, Ledger
from sandbox.state import ParticleState, place

__all__ = ["PUSH", "PUSH_ACCELERATION", "ContactSetup", "ParticleContact"]

PUSH = 0.25
"""Part of an overlap that a step pushes apart [1]."""
PUSH_ACCELERATION = 20000.0
"""Most speed of parting that a push gives, for each second of a step [m/s^2]; a pair bears a quarter of it."""
_RELEASE = 1.02 / (1.0 - PUSH)
"""A pair that parts faster than so many times its push was not pushed, and leaves freely [1]."""
_RESTING = 2.0
"""Steps of gravity that an approach must be faster than to bounce [1]."""
_NO_DISTANCE = 1e-24
"""Square of a distance that gives no direction [m^2]."""
_SLOWEST = 1e-12
"""Speed below which a direction is not worth a division [m/s]."""


@ti.data_oriented
class ParticleContact:
    """Impulses between touching particles, from one slot of the state to the other.

    Parameters
    ----------
    setup : who is who; the same goes to :meth:`load` once the tree is finalised
    ledger : takes the impulses along and across lines of centres, to be booked as "contact" and "friction"
    """

    def __init__(
        self, builder: ti.FieldsBuilder, setup: ContactSetup, state: ParticleState, ledger: Ledger | None = None
    ) -> None:
        self.state = state
        self.neighbours = Neighbours(builder, setup, state)
        self.stride = self.neighbours.stride
        self.ledger = ledger
        self.booked = ledger is not None
        if ledger is not None:
            self.contact_term, self.friction_term = ledger.index("contact"), ledger.index("friction")
        first, second = setup.meeting_bodies()
        restitution, friction = setup.restitution[first, second], setup.friction[first, second]
        self.uniform = len({*zip(restitution, friction, strict=True)}) <= 1
        self.restitution, self.friction = (float(values.max(initial=0.0)) for values in (restitution, friction))
        self.rubs = self.friction > 0.0
        self.resting = _RESTING * setup.gravity
        self.real, self.vector = runtime.real(), runtime.vector(state.dimension)
        bodies = 1 if self.uniform else len(setup.self_contact)
        self.body = place(builder, ti.field(ti.i32), 1 if self.uniform else state.count)
        self.restitutions = place(builder, ti.field(self.real), bodies, bodies)
        self.frictions = place(builder, ti.field(self.real), bodies, bodies)
        self.met = place(builder, ti.field(ti.i32), state.count)
        self.share = place(builder, ti.field(self.real), state.count)
        self.partner = place(builder, ti.field(ti.i32), state.count * self.stride)
        self.overlap = place(builder, ti.field(self.real), 1)

    def load(self, setup: ContactSetup) -> None:
        """Upload what tells particles and bodies apart; lists are made at the next step."""
        self.neighbours.load(setup)
        if not self.uniform:
            tables = (np.ascontiguousarray(table, dtype=float) for table in (setup.restitution, setup.friction))
            self._write(setup.body.astype(np.int32), *tables)

    @ti.kernel
    def _write(self, body: ti.types.ndarray(), restitution: ti.types.ndarray(), friction: ti.types.ndarray()):
        for i in range(self.state.count):
            self.body[i] = body[i]
        for a, b in self.restitutions:
            self.restitutions[a, b] = restitution[a, b]
            self.frictions[a, b] = friction[a, b]

    def invalidate(self) -> None:
        """Have the lists made anew at the next step; to be called after the state was changed from outside."""
        self.neighbours.moved[0] = 1

    def overflowed(self) -> bool:
        """Whether a list was too short since :meth:`load`: steps since then may have missed contacts."""
        return bool(self.neighbours.full[0])

    def deepest_overlap(self) -> float:
        """Largest part of their touching distance by which two particles overlap now [1]; 0 where none do.

        Of those that were near in the last step; particles that may not meet do not count.
        """
        self._look_for_overlap(self.state.slot)
        return float(self.overlap[0])

    @ti.kernel
    def _look_for_overlap(self, slot: int):
        self.overlap[0] = 0.0
        for i in range(self.state.count):
            deepest = ti.cast(0.0, self.real)
            for entry in range(i * self.stride, i * self.stride + self.neighbours.listed[i]):
                j = self.neighbours.near[entry]
                apart = (self.state.x[slot, i] - self.state.x[slot, j]).norm()
                if self.state.inverse_mass[i] + self.state.inverse_mass[j] > 0.0:
                    deepest = ti.max(deepest, 1.0 - apart / self.neighbours.touching(i, j))
            ti.atomic_max(self.overlap[0], deepest)

    def resolve(self, source: int, target: int, dt: float) -> None:
        """Contacts of slot ``source``, where all have just drifted for dt [s]; the new state goes to ``target``."""
        if self.neighbours.moved[0]:
            self._build(source)
        self._exchange_all(source, target, dt)

    @ti.kernel
    def _build(self, source: int):
        self.neighbours.build(source)

    @ti.kernel
    def _exchange_all(self, source: int, target: int, dt: float):
        self.exchange_all(source, target, dt)

    @ti.func
    def resolve_serial(self, source, target, dt):
        """The same as :meth:`resolve`, for inside a serial loop of a kernel."""
        if self.neighbours.moved[0] == 1:
            self.neighbours.build(source)
        self.exchange_all(source, target, dt)

    @ti.func
    def watch(self, i, x):
        """Note that particle i has drifted to x [m]; for all particles, before contacts are resolved."""
        self.neighbours.watch(i, x)

    @ti.func
    def exchange_all(self, source, target, dt):
        for i in range(self.state.count):
            self.find(i, source, dt)
        for i in range(self.state.count):
            self.respond(i, source, target, dt)

    @ti.func
    def find(self, i, source, dt):
        """Note the partners of particle i by id, once each: who touches it and takes part."""
        row = i * self.stride
        x = self.state.x[source, i]
        touches = 0
        for entry in range(row, row + self.neighbours.listed[i]):
            j = self.neighbours.near[entry]
            d = x - self.state.x[source, j]
            touching = self.neighbours.touching(i, j)
            # Written always, kept by counting on: a branch would be taken half the time.
            self.partner[row + touches] = j
            touches += ti.cast(d.dot(d) < touching * touching, ti.i32)
        met, before = 0, -1
        for entry in range(row, row + touches):
            j = self.partner[entry]
            self.partner[row + met] = j
            met += ti.cast(self.takes_part(i, j, source, dt) & (j != before), ti.i32)
            before = j
        self.note(i, met)

    @ti.func
    def note(self, i, met):
        """Particle i has so many partners."""
        self.met[i] = met
        self.share[i] = met * self.state.inverse_mass[i]

    @ti.func
    def takes_part(self, i, j, source, dt):
        """Whether candidates i and j act on each other in this step."""
        d = self.state.x[source, i] - self.state.x[source, j]
        v = self.state.v[source, i] - self.state.v[source, j]
        r2 = d.dot(d)
        touching = self.neighbours.touching(i, j)
        before = d - dt * v
        r = ti.sqrt(r2)
        fresh = before.dot(before) >= touching * touching
        pushed = v.dot(d) < _RELEASE * self.push(touching - r, dt) * r
        movable = self.state.inverse_mass[i] + self.state.inverse_mass[j] > 0.0
        return (r2 < touching * touching) & (r2 > _NO_DISTANCE) & (fresh | pushed) & movable

    @ti.func
    def push(self, overlap, dt):
        """Speed at which particles that overlap shall part [m/s]."""
        return ti.min(PUSH * overlap / dt, PUSH_ACCELERATION * dt)

    @ti.func
    def respond(self, i, source, target, dt):
        """Sum up what the partners of particle i give it."""
        row = i * self.stride
        along, across, shift = self.vector(0.0), self.vector(0.0), self.vector(0.0)
        for entry in range(row, row + self.met[i]):
            normal_impulse, tangent_impulse, ago = self.exchange(i, self.partner[entry], source, dt)
            along += normal_impulse
            across += tangent_impulse
            shift += ago * (normal_impulse + tangent_impulse)
        self.give(i, source, target, along, across, shift)

    @ti.func
    def give(self, i, source, target, along, across, shift):
        """Particle i with its impulses [N s] and its shift [kg m]."""
        w = self.state.inverse_mass[i]
        v = self.state.v[source, i]
        change = w * (along + across)
        begun = self.state.v[target, i]
        self.state.x[target, i] = self.state.x[source, i] + w * shift
        self.state.v[target, i] = v + change
        if ti.static(self.state.predicts_velocity):
            self.state.force_velocity[target, i] = self.state.force_velocity[source, i] + change
        if ti.static(self.booked):
            if shift.dot(shift) > 0.0:
                self.ledger.add(self.contact_term, i, along.dot(0.5 * (begun + v + change)))
                self.ledger.add(self.friction_term, i, across.dot(0.5 * (begun + v + change)))
            elif w > 0.0:
                self.ledger.hand_in(ALONG, i, along)
                if ti.static(self.rubs):
                    self.ledger.hand_in(ACROSS, i, across)

    @ti.func
    def exchange(self, i, j, source, dt):
        """Impulses on i from its partner j, along and across the line of centres [N s], and how long ago they met [s].

        Seen from j every number is the same, or the opposite: sums of two terms and products alone stand here.
        """
        d = self.state.x[source, i] - self.state.x[source, j]
        v = self.state.v[source, i] - self.state.v[source, j]
        touching = self.neighbours.touching(i, j)
        restitution, friction = self.surface(i, j)
        r2 = d.dot(d)
        before = d - dt * v
        alone = self.met[i] == 1 and self.met[j] == 1 and before.dot(before) >= touching * touching
        ago = ti.cast(0.0, self.real)
        normal = d / ti.sqrt(r2)
        push = self.push(touching - ti.sqrt(r2), dt)
        if alone:
            ago = self.since_touching(d, v, touching * touching - r2)
            met_at = d - ago * v
            normal = met_at / ti.sqrt(met_at.dot(met_at))
            push = 0.0
        speed = v.dot(normal)
        wanted = push
        if -speed >= self.resting * dt:
            wanted = ti.max(push, -restitution * speed)
        if speed >= _RELEASE * push and speed >= 0.0:
            # It passed the other within the step, in a heap: too late to tell from where.
            wanted = speed
        given = (wanted - speed) / (self.share[i] + self.share[j])
        across = self.vector(0.0)
        if ti.static(self.rubs):
            sliding = v - speed * normal
            slide = sliding.norm()
            most = slide / (self.share[i] + self.share[j])
            across = -ti.min(friction * ti.max(given, 0.0), most) / ti.max(slide, _SLOWEST) * sliding
        return given * normal, across, ago

    @ti.func
    def since_touching(self, d, v, inside):
        """Time since a pair at d [m], with relative velocity v, touched: root of |d - t v|^2 = d^2 + inside [s]."""
        dv, v2 = d.dot(v), v.dot(v)
        root = ti.sqrt(dv * dv + v2 * inside)
        ago = inside / ti.max(root - dv, _SLOWEST)
        if dv > 0.0:
            ago = (root + dv) / v2
        return ago

    @ti.func
    def surface(self, i, j):
        """Restitution and friction of a pair."""
        restitution, friction = ti.cast(self.restitution, self.real), ti.cast(self.friction, self.real)
        if ti.static(not self.uniform):
            restitution = self.restitutions[self.body[i], self.body[j]]
            friction = self.frictions[self.body[i], self.body[j]]
        return restitution, friction
