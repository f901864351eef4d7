"""What a surface does to the velocity of a particle that meets it: restitution and Coulomb friction.

Normal: v_n -> -e v_n, of the velocity at the instant of the meeting. Tangent: slowed by at most mu times the normal
impulse, (1 + e) |v_n| a unit of mass, and never reversed. A particle that already leaves keeps its velocity.

A scheme's velocity is that of one moment of the step, and the meeting happens at another, between which the forces of
the step act. Restitution 1 keeps a particle's energy only if it is the velocity at the meeting that is reversed; a
stiff spring changes it by more than a bounce does within one step. And what forces press onto a surface is stopped
there, not thrown back. See :meth:`Surface.answer`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.scene.assemble import Assembly, ContactPair
from sandbox.state import place

_STEEP = 0.2
"""Part of its speed that forces may change in a step before what they do between meeting and step is uncertain [1]."""
_SLOWEST = 1e-12
"""Speed below which a direction is not worth a division [m/s]."""


@ti.func
def rub(v, normal, most):
    """What friction of at most ``most`` [m/s] takes from the velocity ``v``."""
    tangent = v - v.dot(normal) * normal
    speed = tangent.norm()
    return ti.min(most, speed) * tangent / ti.max(speed, _SLOWEST)


@ti.data_oriented
class Surface:
    """What all surfaces share: the answer to a particle.

    Attributes
    ----------
    rough : False where there is no friction to compute
    bouncy : False where there is no restitution
    """

    rough = True
    bouncy = True

    def restitution_of(self, i):
        """Restitution of particle i [1]: a ti.func of each kind."""
        raise NotImplementedError

    def friction_of(self, i):
        """Its coefficient of friction [1]: a ti.func of each kind."""
        raise NotImplementedError

    @ti.func
    def answer(self, i, v, normal, kick, lag, done):
        """Normal velocity that the surface gives, and the mean normal velocity from the meeting to the end [m/s].

        The particle would have the relative velocity ``v`` at the part ``lag`` of the step; forces change it by
        ``kick`` in a whole step [m/s]; it met the surface at the part ``done`` of it.
        """
        speed = v.dot(normal)
        given = -ti.min(speed, 0.0)
        onward = speed + given
        if ti.static(self.bouncy):
            if speed < 0.0:
                press = kick.dot(normal)
                rebound = -self.restitution_of(i) * ti.min(speed + (done - lag) * press, 0.0)
                onward = rebound + 0.5 * (1.0 - done) * press
                after = rebound + (lag - done) * press
                if ti.abs(press) > -_STEEP * speed:
                    # Forces change too much within the step to know the speed at the meeting: what is
                    # uncertain must not become energy from nothing.
                    after = ti.min(after, -self.restitution_of(i) * speed)
                if onward <= 0.0:
                    # It comes back within the step, or never left: it lies there.
                    onward = 0.0
                    after = ti.max(after, 0.0)
                given = ti.max(after - speed, 0.0)
        return given, onward


@ti.data_oriented
class UniformSurface(Surface):
    """The same restitution and friction for every body, known when kernels compile."""

    def __init__(self, pair: ContactPair) -> None:
        self.restitution = pair.restitution
        self.friction = pair.friction
        self.rough = pair.friction > 0.0
        self.bouncy = pair.restitution > 0.0

    def load(self, assembly: Assembly) -> None:
        """Nothing to upload."""

    @ti.func
    def restitution_of(self, i):
        return self.restitution

    @ti.func
    def friction_of(self, i):
        return self.friction


@ti.data_oriented
class BodySurfaces(Surface):
    """Restitution and friction that depend on the body: one number of each a particle."""

    def __init__(self, builder: ti.FieldsBuilder, assembly: Assembly, pairs: Sequence[ContactPair]) -> None:
        self.pairs = pairs
        self.bouncy = any(pair.restitution > 0.0 for pair in pairs)
        self.restitution = place(builder, ti.field(runtime.real()), assembly.particle_count)
        self.friction = place(builder, ti.field(runtime.real()), assembly.particle_count)

    def load(self, assembly: Assembly) -> None:
        restitution = np.array([pair.restitution for pair in self.pairs])
        friction = np.array([pair.friction for pair in self.pairs])
        self._write(restitution[assembly.particle_body], friction[assembly.particle_body])

    @ti.kernel
    def _write(self, restitution: ti.types.ndarray(), friction: ti.types.ndarray()):
        for i in range(restitution.shape[0]):
            self.restitution[i] = restitution[i]
            self.friction[i] = friction[i]

    @ti.func
    def restitution_of(self, i):
        return self.restitution[i]

    @ti.func
    def friction_of(self, i):
        return self.friction[i]


@ti.data_oriented
class SolvedSurface(Surface):
    """A surface for particles whose velocities a solver finds: what arrives bounces, what is pressed on does not.

    Parameters
    ----------
    surface : restitution and friction
    solved : what the solver gave to every particle's velocity [m/s], a field of vectors: left out of restitution;
        None for no restitution at all
    """

    def __init__(self, surface: Any, solved: Any = None) -> None:
        self.surface = surface
        self.solved = solved
        self.rough = surface.rough
        self.bouncy = surface.bouncy and solved is not None

    @ti.func
    def restitution_of(self, i):
        return self.surface.restitution_of(i)

    @ti.func
    def friction_of(self, i):
        return self.surface.friction_of(i)

    @ti.func
    def answer(self, i, v, normal, kick, lag, done):
        """Normal velocity that the surface gives, and the one that the particle goes on with [m/s]."""
        speed = v.dot(normal)
        taken = ti.min(speed, 0.0)
        if ti.static(self.bouncy):
            if taken < 0.0:
                taken += self.surface.restitution_of(i) * ti.min((v - self.solved[i]).dot(normal), 0.0)
        return -taken, speed - taken
