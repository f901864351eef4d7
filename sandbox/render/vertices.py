"""Kernels that read the simulation's fields: the only ones that compile anew for every scene."""

import taichi as ti

from sandbox.render.types import Floats, Ints, Points, vec3
from sandbox.render.view import project, to_light


@ti.func
def position3(positions: ti.template(), slot, i):
    """Position of a particle as three f32 [m]."""
    return ti.cast(positions[slot, i], ti.f32)


@ti.kernel
def place_vertices(
    positions: ti.template(),
    slot: ti.i32,
    particles: Ints,
    ring_start: Ints,
    ring: Ints,
    view: Floats,
    world: Points,
    normal: Points,
    screen: Points,
    light: Points,
):
    """World, screen and light coordinates and the normal of every surface vertex."""
    for i in range(particles.shape[0]):
        p = position3(positions, slot, particles[i])
        n = vec3(0.0, 0.0, 0.0)
        for k in range(ring_start[i], ring_start[i + 1]):
            n += (position3(positions, slot, ring[2 * k]) - p).cross(position3(positions, slot, ring[2 * k + 1]) - p)
        world[i] = p
        normal[i] = n * (1.0 / ti.sqrt(ti.max(n.dot(n), 1e-30)))
        screen[i] = project(view, p)
        light[i] = to_light(view, p)


@ti.kernel
def place_rounds(positions: ti.template(), slot: ti.i32, ends: Ints, start: Points, end: Points):
    """World coordinates of both ends of every capsule; a sphere has one particle at both."""
    for i in range(start.shape[0]):
        start[i] = position3(positions, slot, ends[2 * i])
        end[i] = position3(positions, slot, ends[2 * i + 1])


@ti.kernel
def copy_values(values: ti.template(), scale: ti.f32, result: Floats):
    """Values of the particles in units of the colour scale's top, in [0, 1]."""
    for i in range(result.shape[0]):
        result[i] = ti.min(ti.max(ti.cast(values[i], ti.f32) * scale, 0.0), 1.0)
