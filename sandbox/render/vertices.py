"""Kernels that read the simulation's fields: the only ones that compile anew for every scene."""

import taichi as ti

from sandbox.render.types import Floats, Ints, Points, vec3
from sandbox.render.view import project, to_light

FARTHEST = 1.75
"""Distance of a vertex from its point, in radii, at most: a little more than at the corner of a cube."""


@ti.func
def position3(positions: ti.template(), slot, i):
    """Position of a particle as three f32 [m]."""
    return ti.cast(positions[slot, i], ti.f32)


@ti.func
def point3(has_carried: ti.template(), positions: ti.template(), slot, particle_count, carried: ti.template(), i):
    """Position of a particle, or of a carried point past the particles [m]: the field may have more rows than those."""
    p = vec3(0.0, 0.0, 0.0)
    if ti.static(has_carried):
        if i < particle_count:
            p = position3(positions, slot, i)
        else:
            p = carried[i - particle_count]
    else:
        p = position3(positions, slot, i)
    return p


@ti.kernel
def carry_points(positions: ti.template(), slot: ti.i32, nodes: Ints, weights: Floats, carried: Points):
    """Positions of the points that particles carry [m]: weighted sums."""
    width = nodes.shape[0] // carried.shape[0]
    for i in carried:
        p = vec3(0.0, 0.0, 0.0)
        for k in range(i * width, (i + 1) * width):
            p += position3(positions, slot, nodes[k]) * weights[k]
        carried[i] = p


@ti.kernel
def place_vertices(
    has_carried: ti.template(),
    can_tear: ti.template(),
    is_thick: ti.template(),
    positions: ti.template(),
    slot: ti.i32,
    particle_count: ti.i32,
    carried: Points,
    points: Ints,
    radius: Floats,
    ring_start: Ints,
    ring: Ints,
    ring_triangle: Ints,
    hidden: Ints,
    view: Floats,
    world: Points,
    normal: Points,
    screen: Points,
    light: Points,
):
    """World, screen and light coordinates of every surface vertex, and its normal from the triangles that are left.

    Where `is_thick`, every vertex lies its `radius` [m] outside of its point.
    """
    for i in range(points.shape[0]):
        p = point3(has_carried, positions, slot, particle_count, carried, points[i])
        n, area, along = vec3(0.0, 0.0, 0.0), 0.0, vec3(0.0, 0.0, 0.0)
        for k in range(ring_start[i], ring_start[i + 1]):
            one = point3(has_carried, positions, slot, particle_count, carried, ring[2 * k])
            two = point3(has_carried, positions, slot, particle_count, carried, ring[2 * k + 1])
            face = (one - p).cross(two - p)
            if ti.static(can_tear):
                if hidden[ring_triangle[k]] != 0:
                    face = vec3(0.0, 0.0, 0.0)
            n += face
            if ti.static(is_thick):
                area += face.norm()
                along += two - one
        length = ti.sqrt(ti.max(n.dot(n), 1e-30))
        n *= 1.0 / length
        if ti.static(is_thick):
            # Farther out at edges and corners, so that the faces beside them move out by the radius.
            p += n * (radius[i] * ti.min(area / length, FARTHEST))
            # Around a vertex inside of a surface the opposite edges add up to nothing; at a rim it is rounded outward.
            if along.dot(along) > 1e-3 * area:
                n = (n + n.cross(along.normalized())).normalized()
        world[i] = p
        normal[i] = n
        screen[i] = project(view, p)
        light[i] = to_light(view, p)


@ti.kernel
def place_rounds(positions: ti.template(), slot: ti.i32, ends: Ints, start: Points, end: Points):
    """World coordinates of both ends of every capsule; a sphere has one particle at both."""
    for i in range(ends.shape[0] // 2):
        start[i] = position3(positions, slot, ends[2 * i])
        end[i] = position3(positions, slot, ends[2 * i + 1])


@ti.kernel
def copy_values(values: ti.template(), scale: ti.f32, result: Floats):
    """Values of the particles in units of the colour scale's top, in [0, 1]."""
    for i in range(result.shape[0]):
        result[i] = ti.min(ti.max(ti.cast(values[i], ti.f32) * scale, 0.0), 1.0)
