"""Surfaces that particles met, as solves remember them; and why three solves bear colliders in three ways.

A step that met colliders only after its solve would not bear a load: what is stopped there weighs next to nothing
against the body behind it, and the body would sink until the springs of its lowest particles are as strong as if
they were the ground. So every solve takes colliders in, and by the same laws: a surface presses or lets go, it never
pulls (Signorini); friction holds up to its coefficient times what presses, and beyond that works against the sliding
with just that (Coulomb); and restitution is of the speed that a particle arrived with, not of what presses it on.
What differs is what a solve knows of its own answer to a push when it meets a surface:

- Newton with conjugate gradients moves all particles at once, by a matrix of which there are only products. What a push
  on one does to the others, another solve would have to say. So who rests, and how, is laid down for the time of
  a solve, as constraints on its vectors; its residual then is the reaction, which tells what to lay down
  differently: an active set, :mod:`sandbox.integrators.resting`.
- Vertex block descent moves one particle while all others wait, and has its matrix A: a push J moves it by A^-1 J,
  friction and pressing included. Both laws are solved on the spot: :mod:`sandbox.integrators.meetings`.
- XPBD gives impulses of one constraint after the other, to which a particle answers with J / m, whatever holds it. With
  A = m that solution is bounce and friction of the surface itself, :class:`sandbox.contact.surface.SolvedSurface`;
  the surface is one more constraint, which gives anew what it gave before: :mod:`sandbox.integrators.pushes`.
"""

import taichi as ti

from sandbox import runtime
from sandbox.ledger import RUBBED
from sandbox.state import ParticleState, place

FREE = 0
"""How a particle that meets no surface is borne; how those do that do is the solve's own."""


@ti.data_oriented
class Bearing:
    """The surface that bears every particle, if one does: a witness of collisions, see :meth:`SolidCollider.seen_by`.

    Attributes
    ----------
    mode : FREE, or how the particle is borne, shape (particle_count,)
    normal : of the surface that was met last, vectors
    ground : its velocity [m/s], vectors
    friction : its coefficient [1]
    rebound : speed at which the particle leaves it [m/s]
    """

    def __init__(self, builder: ti.FieldsBuilder, state: ParticleState) -> None:
        self.state = state
        self.real, self.vector, count = runtime.real(), runtime.vector(state.dimension), state.count
        self.mode = place(builder, ti.field(ti.i32), count)
        self.normal, self.ground = (place(builder, self.vector.field(), count) for _ in range(2))
        self.friction, self.rebound = (place(builder, ti.field(self.real), count) for _ in range(2))

    @ti.func
    def note_surface(self, i, normal, ground, friction, rebound):
        """Remember the surface that particle i met."""
        self.normal[i] = normal
        self.ground[i] = ground
        self.friction[i] = friction
        self.rebound[i] = rebound

    @ti.func
    def hand_in_friction(self, ledger: ti.template(), i, impulse):
        """Give the ledger what of a surface's whole impulse [N s] on particle i is friction."""
        if self.mode[i] != FREE and self.friction[i] > 0.0:
            n = self.normal[i]
            ledger.hand_in(RUBBED, i, impulse - impulse.dot(n) * n)
