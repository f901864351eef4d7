"""What a surface does to the velocity of a particle that meets it: restitution and Coulomb friction.

Normal: v_n -> -e v_n. Tangent: slowed by at most mu times the normal impulse, (1 + e) |v_n| a unit of
mass, and never reversed. A particle that already leaves keeps its velocity.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.scene.assemble import Assembly, ContactPair
from sandbox.state import place

_SLOWEST = 1e-12
"""Speed below which a direction is not worth a division [m/s]."""


@ti.func
def bounce(v, normal, restitution):
    """Velocity after meeting a surface without friction."""
    into = ti.min(v.dot(normal), 0.0)
    return v - (1.0 + restitution) * into * normal


@ti.func
def rub(v, normal, restitution, friction):
    """What friction takes from the velocity ``v`` that met the surface."""
    into = ti.min(v.dot(normal), 0.0)
    tangent = v - v.dot(normal) * normal
    speed = tangent.norm()
    slowed = ti.min(-friction * (1.0 + restitution) * into, speed)
    return slowed * tangent / ti.max(speed, _SLOWEST)


@ti.data_oriented
class UniformSurface:
    """The same restitution and friction for every body, known when kernels compile."""

    def __init__(self, pair: ContactPair) -> None:
        self.restitution = pair.restitution
        self.friction = pair.friction
        self.rough = pair.friction > 0.0
        """False where there is no friction to compute."""
        self.bouncy = pair.restitution > 0.0
        """False where there is no restitution."""

    def load(self, assembly: Assembly) -> None:
        """Nothing to upload."""

    @ti.func
    def restitution_of(self, i):
        return self.restitution

    @ti.func
    def friction_of(self, i):
        return self.friction

    @ti.func
    def bounce(self, i, v, normal):
        """Velocity after the meeting, but for friction."""
        return bounce(v, normal, self.restitution)

    @ti.func
    def rub(self, i, v, normal):
        """What friction takes from the velocity."""
        return rub(v, normal, self.restitution, self.friction)


@ti.data_oriented
class BodySurfaces:
    """Restitution and friction that depend on the body: one number of each a particle."""

    rough = True

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

    @ti.func
    def bounce(self, i, v, normal):
        """Velocity after the meeting, but for friction."""
        return bounce(v, normal, self.restitution[i])

    @ti.func
    def rub(self, i, v, normal):
        """What friction takes from the velocity."""
        return rub(v, normal, self.restitution[i], self.friction[i])


@ti.data_oriented
class SolvedSurface:
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
    def bounce(self, i, v, normal):
        """Velocity after the meeting, but for friction."""
        return v - self._taken(i, v, normal) * normal

    @ti.func
    def rub(self, i, v, normal):
        """What friction takes from the velocity."""
        tangent = v - v.dot(normal) * normal
        speed = tangent.norm()
        slowed = ti.min(-self.surface.friction_of(i) * self._taken(i, v, normal), speed)
        return slowed * tangent / ti.max(speed, _SLOWEST)

    @ti.func
    def _taken(self, i, v, normal):
        """Normal velocity that the surface takes [m/s]: none, or negative."""
        taken = ti.min(v.dot(normal), 0.0)
        if ti.static(self.bouncy):
            if taken < 0.0:
                taken += self.surface.restitution_of(i) * ti.min((v - self.solved[i]).dot(normal), 0.0)
        return taken
