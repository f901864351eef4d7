"""What most Taichi soft-body code does: one spring a thread, forces added with atomics. For comparison only."""

import numpy as np
import taichi as ti

from sandbox.scene.assemble import Assembly


@ti.data_oriented
class Scatter:
    """Symplectic Euler on springs, f32, by scattering."""

    def __init__(self, assembly: Assembly, damped: bool) -> None:
        self.damped = damped
        count, springs = assembly.particle_count, assembly.spring_count
        self.x = ti.Vector.field(3, ti.f32, shape=count)
        self.v = ti.Vector.field(3, ti.f32, shape=count)
        self.force = ti.Vector.field(3, ti.f32, shape=count)
        self.inverse_mass = ti.field(ti.f32, shape=count)
        self.ends = ti.Vector.field(2, ti.i32, shape=springs)
        self.rest_length, self.stiffness, self.damping = (ti.field(ti.f32, shape=springs) for _ in range(3))
        self.x.from_numpy(assembly.positions.astype(np.float32))
        self.v.from_numpy(assembly.velocities.astype(np.float32))
        self.inverse_mass.from_numpy(assembly.inverse_masses.astype(np.float32))
        self.ends.from_numpy(assembly.springs)
        self.rest_length.from_numpy(assembly.spring_set.rest_lengths.astype(np.float32))
        self.stiffness.from_numpy(assembly.spring_set.stiffness.astype(np.float32))
        self.damping.from_numpy(assembly.spring_set.damping.astype(np.float32))

    @ti.kernel
    def step(self, dt: float):
        for i in self.force:
            self.force[i] = ti.Vector([0.0, 0.0, 0.0])
        for s in self.ends:
            a, b = self.ends[s][0], self.ends[s][1]
            d = self.x[b] - self.x[a]
            r = ti.max(d.norm(), 1e-12)
            tension = self.stiffness[s] * (r - self.rest_length[s])
            if ti.static(self.damped):
                tension += self.damping[s] * (self.v[b] - self.v[a]).dot(d) / r
            force = tension / r * d
            self.force[a] += force
            self.force[b] -= force
        for i in self.x:
            self.v[i] += dt * self.inverse_mass[i] * self.force[i]
            self.x[i] += dt * self.v[i]

    def advance(self, steps: int, dt: float) -> None:
        """Take ``steps`` steps of ``dt`` [s]."""
        for _ in range(steps):
            self.step(dt)
        ti.sync()
