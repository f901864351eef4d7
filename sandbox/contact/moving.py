"""Motion by keyframes on the device: poses of moving colliders every substep, and particles that they carry."""

from collections.abc import Mapping

import numpy as np
import taichi as ti

from sandbox import functions, runtime
from sandbox.scene.assemble import Assembly
from sandbox.scene.attachments import Carried
from sandbox.scene.motion import Motion
from sandbox.state import place

START, MIDDLE, END = 0, 1, 2
"""Moments of a substep at which poses are known."""
_MOMENTS = 3
_TURN = 2.0 * np.pi


@ti.data_oriented
class Motions:
    """Where moving colliders are and how fast, at the start, middle and end of the substep.

    Parameters
    ----------
    builder : takes the fields
    motions : the motion of every collider that moves, by its index

    A part that prepares: ``prepare_end(slot, time, dt)`` once a substep. Velocities come from the
    derivative of the interpolation, not from differences of poses, which time's rounding would spoil.
    """

    prepare_count = 0

    def __init__(self, builder: ti.FieldsBuilder, motions: Mapping[int, Motion]) -> None:
        self.rows = {index: row for row, index in enumerate(motions)}
        """Row of every moving collider, by its index in the scene."""
        self.motions = list(motions.values())
        self.count = len(self.motions)
        self.dimension = self.motions[0].dimension
        self.angles = 1 if self.dimension == 2 else 3
        # Time and angle grow without bound, and what counts is a small part of them.
        self.real = runtime.real()
        self.exact = ti.f64
        keys = sum(len(motion.times) for motion in self.motions)
        self.first = place(builder, ti.field(ti.i32), self.count + 1)
        self.smooth = place(builder, ti.field(ti.i32), self.count)
        self.key_time = place(builder, ti.field(self.exact), keys)
        self.key_position = place(builder, ti.types.vector(self.dimension, self.exact).field(), keys)
        self.key_angles = place(builder, ti.types.vector(self.angles, self.exact).field(), keys)
        vector, spin = runtime.vector(self.dimension), runtime.vector(self.angles)
        matrix = ti.types.matrix(self.dimension, self.dimension, runtime.real())
        self.origin = place(builder, vector.field(), _MOMENTS, self.count)
        self.turn = place(builder, matrix.field(), _MOMENTS, self.count)
        self.velocity = place(builder, vector.field(), _MOMENTS, self.count)
        self.spin = place(builder, spin.field(), _MOMENTS, self.count)

    def load(self, assembly: Assembly) -> None:
        """Upload the keyframes and take the poses of time 0."""
        first = np.cumsum([0] + [len(motion.times) for motion in self.motions]).astype(np.int32)
        self._write(
            first,
            np.array([motion.smooth for motion in self.motions], dtype=np.int32),
            np.concatenate([motion.times for motion in self.motions]),
            np.concatenate([motion.positions for motion in self.motions]),
            np.radians(np.concatenate([motion.angles for motion in self.motions])),
        )
        self.set_time(0.0)

    def set_time(self, time: float) -> None:
        """Take the poses of a time [s], for whoever looks before the next substep."""
        self._place(time)

    @ti.kernel
    def _write(
        self,
        first: ti.types.ndarray(),
        smooth: ti.types.ndarray(),
        times: ti.types.ndarray(),
        positions: ti.types.ndarray(),
        angles: ti.types.ndarray(),
    ):
        for row in range(self.count + 1):
            self.first[row] = first[row]
        for row in range(self.count):
            self.smooth[row] = smooth[row]
        for key in range(times.shape[0]):
            self.key_time[key] = times[key]
            for axis in ti.static(range(self.dimension)):
                self.key_position[key][axis] = positions[key, axis]
            for axis in ti.static(range(self.angles)):
                self.key_angles[key][axis] = angles[key, axis]

    @ti.kernel
    def _place(self, time: float):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.prepare_end(0, time, 0.0)

    @ti.func
    def prepare_end(self, slot, time, dt):
        """Poses and velocities of the substep from ``time`` to time + dt [s]."""
        for row in range(self.count):
            for moment in range(_MOMENTS):
                self._interpolate(row, moment, ti.cast(time, self.exact) + 0.5 * moment * ti.cast(dt, self.exact))

    @ti.func
    def _interpolate(self, row, moment, time):
        key = self.first[row]
        last = self.first[row + 1] - 1
        above = last
        while above - key > 1:
            between = (key + above) // 2
            if self.key_time[between] <= time:
                key = between
            else:
                above = between
        weight = ti.cast(0.0, self.exact)
        rate = ti.cast(0.0, self.exact)
        if last > self.first[row]:
            span = self.key_time[key + 1] - self.key_time[key]
            weight = ti.min(ti.max((time - self.key_time[key]) / span, 0.0), 1.0)
            if time >= self.key_time[self.first[row]] and time < self.key_time[last]:
                rate = 1.0 / span
            if self.smooth[row] == 1:
                rate = rate * 6.0 * weight * (1.0 - weight)
                weight = weight * weight * (3.0 - 2.0 * weight)
        following = ti.min(key + 1, last)
        position, angles = self.key_position[key], self.key_angles[key]
        way, turning = self.key_position[following] - position, self.key_angles[following] - angles
        # Both ends exactly: p + (q - p) w would miss q by rounding.
        self.origin[moment, row] = ti.cast((1.0 - weight) * position + weight * self.key_position[following], self.real)
        self.velocity[moment, row] = ti.cast(rate * way, self.real)
        angle = (1.0 - weight) * angles + weight * self.key_angles[following]
        angle = angle - _TURN * ti.round(angle / _TURN)
        self._rotate(moment, row, ti.cast(angle, self.real), ti.cast(rate * turning, self.real))

    @ti.func
    def _rotate(self, moment, row, angle, rate):
        """Rotation matrix and angular velocity [rad/s] from angles [rad] and their rates."""
        c, s = functions.cos(angle), functions.sin(angle)
        if ti.static(self.dimension == 2):
            self.turn[moment, row] = ti.Matrix([[c[0], -s[0]], [s[0], c[0]]])
            self.spin[moment, row] = rate
        else:
            about_x = ti.Matrix([[1.0, 0.0, 0.0], [0.0, c[0], -s[0]], [0.0, s[0], c[0]]])
            about_y = ti.Matrix([[c[1], 0.0, s[1]], [0.0, 1.0, 0.0], [-s[1], 0.0, c[1]]])
            about_z = ti.Matrix([[c[2], -s[2], 0.0], [s[2], c[2], 0.0], [0.0, 0.0, 1.0]])
            # The axes that the later turns carry along: R = Rz Ry Rx.
            inner = about_y @ ti.Vector([rate[0], 0.0, 0.0]) + ti.Vector([0.0, rate[1], 0.0])
            self.turn[moment, row] = about_z @ about_y @ about_x
            self.spin[moment, row] = about_z @ inner + ti.Vector([0.0, 0.0, rate[2]])

    @ti.func
    def to_local(self, row, moment, x):
        """A point of the world [m] in the frame of a collider."""
        return self.turn[moment, row].transpose() @ (x - self.origin[moment, row])

    @ti.func
    def to_world(self, row, moment, x):
        """A point of a collider's frame [m] in the world."""
        return self.origin[moment, row] + self.turn[moment, row] @ x

    @ti.func
    def turned(self, row, moment, direction):
        """A direction of a collider's frame in the world."""
        return self.turn[moment, row] @ direction

    @ti.func
    def velocity_at(self, row, moment, arm):
        """Velocity of a collider at ``arm`` [m], in the world's directions, from its origin [m/s]."""
        spin = self.spin[moment, row]
        result = self.velocity[moment, row]
        if ti.static(self.dimension == 2):
            result += spin[0] * ti.Vector([-arm[1], arm[0]])
        else:
            result += spin.cross(arm)
        return result


@ti.data_oriented
class Carrier:
    """Particles that moving colliders carry along, whatever acts on them.

    Parameters
    ----------
    builder : takes the fields
    motions : the motions of the scene
    particle_count : number of all particles
    carried : who is carried by which moving collider, and where in its frame
    """

    def __init__(self, builder: ti.FieldsBuilder, motions: Motions, particle_count: int, carried: Carried) -> None:
        self.motions = motions
        self.carried = carried
        self.particle_count = particle_count
        self.seat = place(builder, ti.field(ti.i32), particle_count)
        """Row of every particle below, -1 where it is not carried."""
        self.row = place(builder, ti.field(ti.i32), len(carried.particles))
        self.local = place(builder, runtime.vector(motions.dimension).field(), len(carried.particles))

    def load(self, assembly: Assembly) -> None:
        """Upload who is carried."""
        seats = np.full(self.particle_count, -1, dtype=np.int32)
        seats[self.carried.particles] = np.arange(len(self.carried.particles))
        rows = np.array([self.motions.rows[int(collider)] for collider in self.carried.collider], dtype=np.int32)
        self._write(seats, rows, np.ascontiguousarray(self.carried.local))

    @ti.kernel
    def _write(self, seats: ti.types.ndarray(), rows: ti.types.ndarray(), local: ti.types.ndarray()):
        for i in range(self.particle_count):
            self.seat[i] = seats[i]
        for c in range(rows.shape[0]):
            self.row[c] = rows[c]
            for axis in ti.static(range(self.motions.dimension)):
                self.local[c][axis] = local[c, axis]

    @ti.func
    def carry(self, i, start, end, v, duration):
        """Position and velocity of particle i at the end of the substep: its collider's, if one carries it."""
        x_new, v_new = end, v
        seat = self.seat[i]
        if seat >= 0:
            row = self.row[seat]
            arm = self.motions.turned(row, END, self.local[seat])
            x_new = self.motions.origin[END, row] + arm
            v_new = self.motions.velocity_at(row, END, arm)
        return x_new, v_new
