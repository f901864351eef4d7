"""What colliders bear: particles that met one in the last step, held to its surface while the next is solved for.

A particle that met a surface is constrained in the next solve, such that it ends on that surface: along the normal,
or, where friction holds it, in every direction. Once the solve has converged its residual is the reaction, which
decides: a surface does not pull, so a particle that it would have to pull at is let go; friction holds up to its
coefficient times the normal reaction (Coulomb), and beyond that pushes against the sliding with just that. Then the
solve goes on, a few rounds at most. Where they end in friction that drives what it should slow, that is taken back:
of a stiff body the reactions of one step may be a thousand times what stops its sliding. Why so, and not as other
solves do: :mod:`sandbox.integrators.bearing`.

What flies into a surface within the step is found by a look ahead along its path once the solve has converged.
Those that meet first are borne from then on, and all go back to the instant of that meeting: further layers of a
body that would have flown through the place of the first are stopped by those instead, and not flattened. Where a
change is small against all impulses of the step it is left to the next step.

Signorini's condition and Coulomb's law by an active set; constraints by filtering residuals and products, after
Baraff and Witkin, "Large steps in cloth simulation" (1998). A particle rests on one surface at a time.
"""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.integrators.bearing import FREE, Bearing
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState, place

SLIDING, HELD = 1, 2
"""How a particle rests on a surface: it may slide along, or friction holds it."""
NEVER = 2.0
"""Part of a step that stands for: not in this one."""
_STOPPED = 1e-4
"""Part of a sliding speed that is left where friction has stopped it [1]."""
_SAME_NORMAL = 0.01
"""Change of a normal below which it is taken for the same [1]: it comes from differences."""
_TOGETHER = 0.1
"""Part of a step within which particles meet a surface at once [1]."""
_NOTHING = 1e-30
_FAR = -1e30
"""Depth that all are deeper than [m]."""


@ti.data_oriented
class Resting(Bearing):
    """How every particle rests on the colliders of a scene: FREE, SLIDING or HELD.

    Attributes
    ----------
    rub : impulse of friction on a sliding particle [N s], vectors, shape (particle_count,)
    lift : speed across the surface that the solve aims at [m/s]
    fraction : when in the step a particle meets a surface that did not bear it yet [1], NEVER if it does not
    """

    def __init__(self, builder: ti.FieldsBuilder, state: ParticleState, colliders: list[Any]) -> None:
        super().__init__(builder, state)
        self.rounding = float(np.finfo("float64" if runtime.settings().precision == "f64" else "float32").eps)
        self.rub = place(builder, self.vector.field(), state.count)
        self.lift, self.fraction = (place(builder, ti.field(self.real), state.count) for _ in range(2))
        self.size = place(builder, ti.field(self.real), 1)
        self._kept: dict[str, NDArray[np.float64]] = {}
        self.colliders = [collider.seen_by(self, booked=True) for collider in colliders]
        """Those that the end of a step meets."""
        self.scouts = [collider.seen_by(self) for collider in colliders]

    def load(self, assembly: Assembly) -> None:
        """Take the size of the scene, which says how precisely places are known."""
        self.fraction.fill(NEVER)
        self.size.fill(max(float(np.abs(assembly.positions).max()), float(np.ptp(assembly.positions, axis=0).max())))

    # -- what happens between solves ------------------------------------------------------------------

    @ti.func
    def note(self, i, before, after, normal, ground, restitution, friction):
        """Particle i met a surface with a relative velocity ``before``, and leaves it with ``after`` [m/s]."""
        if self.mode[i] == FREE:
            sliding = after - after.dot(normal) * normal
            stopped = sliding.norm() <= _STOPPED * before.norm()
            self.mode[i] = ti.select(stopped and friction > 0.0, HELD, SLIDING)
            self.rub[i] = self.vector(0.0)
        self.note_surface(i, normal, ground, friction, -restitution * ti.min(before.dot(normal), 0.0))

    @ti.func
    def check(self, i, slot, dt):
        """Before a step of ``dt`` [s]: let go who is not near; for the others, where the surface is by now."""
        if self.mode[i] != FREE:
            x = self.state.x[slot, i]
            gap, turned = self._survey(x, i)
            reach = dt * (self.state.v[slot, i] - self.ground[i]).norm()
            reach += 64.0 * self.rounding * ti.max(self.size[0], ti.abs(x).max())
            if gap > reach:
                self.mode[i] = FREE
            else:
                self.rebound[i] = 0.0
                self.lift[i] = -ti.max(gap, -reach) / dt
                if (turned - self.normal[i]).norm() > _SAME_NORMAL and turned.norm() > 0.5:
                    self.normal[i] = turned.normalized()

    @ti.func
    def _survey(self, x, i):
        """Distance of a place from the nearest surface, and the direction away from it, not quite of length 1.

        By differences. Distances are long to look up, so one place in the code does all of it.
        """
        dimension = ti.static(self.state.dimension)
        step = ti.pow(self.rounding, 1.0 / 3.0) * self.size[0]
        slope = self.vector(0.0)
        gap = 0.0 * step
        for k in range(2 * dimension + 1):
            aside = self.vector(0.0)
            for axis in ti.static(range(dimension)):
                if k < 2 * dimension and k % dimension == axis:
                    aside[axis] = ti.select(k < dimension, step, -step)
            depth = ti.cast(_FAR, self.real)
            for collider in ti.static(self.colliders):
                depth = ti.max(depth, collider.depth(i, x + aside))
            slope -= depth * aside
            gap = -depth
        return gap, slope / (2.0 * step * step)

    # -- what the solve asks ----------------------------------------------------------------------------

    @ti.func
    def constrained(self, i, v):
        """Velocity v, but such that the step ends on the surface, or where the bounce off it leads."""
        return self._held_at(i, v, self.lift[i])

    @ti.func
    def stopped(self, i, v):
        """Velocity v, but along the surface where there is one, or with it where friction holds; or bounced off."""
        return self._held_at(i, v, self.rebound[i])

    @ti.func
    def _held_at(self, i, v, speed):
        result, n = v, self.normal[i]
        if self.mode[i] == HELD:
            result = self.ground[i] + speed * n
        elif self.mode[i] == SLIDING:
            result = v - (n.dot(v - self.ground[i]) - speed) * n
        return result

    @ti.func
    def filter(self, i, u):
        """The part of a vector in which particle i is free."""
        result = u
        if self.mode[i] == HELD:
            result = self.vector(0.0)
        elif self.mode[i] == SLIDING:
            result = u - self.normal[i].dot(u) * self.normal[i]
        return result

    @ti.func
    def confine(self, i, matrix, m):
        """A block without what couples the free directions of particle i to others; those get ``m`` instead."""
        result = matrix
        if self.mode[i] == SLIDING:
            n = self.normal[i]
            row = matrix @ n
            result = matrix - row.outer_product(n) - n.outer_product(row) + (n.dot(row) + m) * n.outer_product(n)
        return result

    @ti.func
    def revise(self, i, v, r, inertia):
        """Correct a reaction -r [N s] of a converged solve that the surface cannot give; by how much it changes [N s].

        The solve gave particle i a velocity v [m/s], which takes ``inertia`` [kg] to change within the step.
        """
        change = 0.0 * inertia
        n = self.normal[i]
        if self.mode[i] != FREE:
            pressed = -r.dot(n)
            if pressed < 0.0:
                self.mode[i] = FREE
                self.rub[i] = self.vector(0.0)
                change = r.norm()
            elif self.friction[i] > 0.0:
                most = self.friction[i] * pressed
                if self.mode[i] == HELD:
                    along = r + pressed * n
                    if along.norm() > most:
                        self.mode[i] = SLIDING
                        self.rub[i] = -most / along.norm() * along
                        change = along.norm() - most
                else:
                    change = self._rub(i, v, most, inertia)
        return change

    @ti.func
    def _rub(self, i, v, most, inertia):
        """Friction of at most ``most`` [N s] on a sliding particle: against its sliding, which it may stop."""
        change = 0.0 * inertia
        n = self.normal[i]
        sliding = v - self.ground[i]
        sliding -= sliding.dot(n) * n
        speed = sliding.norm()
        if speed <= 0.0 or sliding.dot(self.rub[i]) > 0.0:
            change = ti.min(inertia * speed, most)
            self.mode[i] = HELD
            self.rub[i] = self.vector(0.0)
        else:
            rub = -most / speed * sliding
            change = (rub - self.rub[i]).norm()
            self.rub[i] = rub
        return change

    @ti.func
    def drive(self, i, v):
        """Energy that friction gives sliding particle i in a step that ends with velocity v [J].

        It should take some. But it was laid down for another velocity than the solve then gave.
        """
        given = 0.0 * self.rebound[i]
        if self.mode[i] == SLIDING:
            given = self.rub[i].dot(v - self.ground[i])
        return given

    @ti.func
    def spare(self, i):
        """Leave a sliding particle to slide without friction."""
        if self.mode[i] == SLIDING:
            self.rub[i] = self.vector(0.0)

    @ti.func
    def look_ahead(self, i, start, begun, v, dt, inertia):
        """Whether free particle i meets a surface within the step; the impulse that this takes [N s].

        ``begun`` is its velocity at the start of the step, v [m/s] the one that it would have with no surface.
        """
        change = 0.0 * dt
        end, left = start + dt * v, v
        for scout in ti.static(self.scouts):
            end, left = scout.resolve(i, start, end, left, 0.0 * v, 1.0, dt)
        if self.mode[i] != FREE:
            n = self.normal[i]
            into = n.dot(v - self.ground[i])
            self.lift[i] = n.dot(end - start) / dt - n.dot(self.ground[i])
            fraction = (self.lift[i] - self.rebound[i]) / ti.min(into - self.rebound[i], -_NOTHING)
            self.fraction[i] = ti.min(ti.max(fraction, 0.0), 1.0)
            # It arrives with what it had or with what it is given, whichever is less: what springs press on within
            # the step must not be thrown back.
            came = ti.min(ti.max(n.dot(begun - self.ground[i]) / ti.min(into, -_NOTHING), 0.0), 1.0)
            self.lift[i] -= (1.0 - self.fraction[i]) * (1.0 - came) * self.rebound[i]
            self.rebound[i] *= came
            change = inertia * ti.max(self.lift[i] - into, 0.0)
        return change

    @ti.func
    def decline(self, i, latest):
        """Take back that particle i meets a surface, unless within the fraction ``latest`` of the step or about then.

        What it would fly into may not be in its way any more, once those are stopped that came first.
        """
        if self.fraction[i] < NEVER and self.fraction[i] > latest + _TOGETHER:
            self.mode[i] = FREE
        self.fraction[i] = NEVER

    # -- memory ---------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Remember how particles rest now."""
        self._kept = self.memory()

    def restore(self) -> None:
        """Go back to what was kept."""
        self.remember(self._kept)

    def memory(self) -> dict[str, NDArray[np.float64]]:
        """How every particle rests, for :meth:`remember`."""
        values = np.empty((self.state.count, 2 + 3 * self.state.dimension))
        self._read(values)
        return {"resting": values}

    def remember(self, values: dict[str, NDArray[np.float64]]) -> None:
        """Set it from :meth:`memory`."""
        self._write(np.ascontiguousarray(values["resting"], dtype=np.float64))

    @ti.kernel
    def _read(self, values: ti.types.ndarray()):
        for i in range(self.state.count):
            values[i, 0] = self.mode[i]
            values[i, 1] = self.friction[i]
            for axis in ti.static(range(self.state.dimension)):
                values[i, 2 + axis] = self.normal[i][axis]
                values[i, 2 + self.state.dimension + axis] = self.ground[i][axis]
                values[i, 2 + 2 * self.state.dimension + axis] = self.rub[i][axis]

    @ti.kernel
    def _write(self, values: ti.types.ndarray()):
        for i in range(self.state.count):
            self.mode[i] = ti.cast(values[i, 0], ti.i32)
            self.friction[i] = values[i, 1]
            for axis in ti.static(range(self.state.dimension)):
                self.normal[i][axis] = values[i, 2 + axis]
                self.ground[i][axis] = values[i, 2 + self.state.dimension + axis]
                self.rub[i][axis] = values[i, 2 + 2 * self.state.dimension + axis]
