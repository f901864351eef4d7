"""Kernels that write vertices as GGUI reads them, with the light that leaves them for the eye."""

import taichi as ti

from sandbox.render.shade import colormap_at, encode
from sandbox.render.surface import background, jelly, smoothstep, solid
from sandbox.render.types import Floats, Ints, Points, Rows, vec3
from sandbox.render.view import EYE, LIGHT, OPEN, SOLID, at3

STRIDE = 12
"""Numbers of a vertex: place, normal, place in a texture, colour and opacity."""
COLOR = 8
SEEN_IN_SHADOW = 0.10
"""Part of the key light that still arrives in a shadow."""
SHADOW_LIFT = 0.0015
"""How much nearer to the eye shadows are than the ground, as part of their distance."""


@ti.kernel
def take_positions(rows: Rows, positions: ti.template()):
    """Positions of the particles [m] from shape (particle_count, dimension)."""
    for i in range(rows.shape[0]):
        for axis in ti.static(range(positions.n)):
            positions[0, i][axis] = rows[i, axis]


@ti.func
def write_vertex(target: ti.template(), i, p, linear, table: ti.template()):
    """Enter a vertex with its linear light."""
    for axis in ti.static(range(3)):
        target[i, axis] = p[axis]
        target[i, COLOR + axis] = ti.cast(encode(table, linear[axis]), ti.f32) * (1.0 / 255.0)
    target[i, COLOR + 3] = 1.0


@ti.func
def sent_light(look, albedo, p, normal, view: ti.template()):
    """Light that leaves a surface for the eye; sheets show the eye the side that it sees."""
    to_eye, light, n = (at3(view, EYE) - p).normalized(1e-12), at3(view, LIGHT), normal
    if look & OPEN != 0 and n.dot(to_eye) < 0.0:
        n = -n
    color = vec3(0.0, 0.0, 0.0)
    if look & SOLID != 0:
        ambient, key = solid(albedo, n, -to_eye, light)
        color = ambient + key
    else:
        color = jelly(albedo, n, to_eye, light, 1.0, 1.0)
    return color


@ti.kernel
def light_surfaces(
    by_value: ti.template(),
    count: ti.i32,
    world: Points,
    normal: Points,
    owner: Ints,
    value_of: Ints,
    look: Ints,
    color: Floats,
    values: Floats,
    colormap: Floats,
    view: Floats,
    table: Ints,
    target: Rows,
):
    """Vertices of surfaces, from 0 on."""
    for i in range(count):
        which = owner[i]
        albedo = at3(color, 3 * which)
        if ti.static(by_value):
            if look[which] & SOLID == 0:
                albedo = colormap_at(colormap, ti.min(ti.max(values[value_of[i]], 0.0), 1.0))
        write_vertex(target, i, world[i], sent_light(look[which], albedo, world[i], normal[i], view), table)


@ti.func
def across(axis):
    """Two unit vectors that make a right-handed frame with a unit vector (Duff et al. 2017)."""
    side = 1.0
    if axis.z < 0.0:
        side = -1.0
    a = -1.0 / (side + axis.z)
    b = axis.x * axis.y * a
    one = vec3(1.0 + side * axis.x * axis.x * a, side * b, -side * axis.x)
    return one, vec3(b, side + axis.y * axis.y * a, -axis.y)


@ti.kernel
def light_rounds(
    by_value: ti.template(),
    count: ti.i32,
    first: ti.i32,
    pattern: Floats,
    start: Points,
    end: Points,
    radius: Floats,
    owner: Ints,
    ends: Ints,
    look: Ints,
    color: Floats,
    values: Floats,
    colormap: Floats,
    view: Floats,
    table: Ints,
    target: Rows,
):
    """Vertices of capsules and spheres, from `first` on."""
    size = pattern.shape[0] // 4
    for i in range(count):
        axis = vec3(0.0, 0.0, 1.0)
        between = end[i] - start[i]
        if between.dot(between) > 1e-20:
            axis = between.normalized()
        one, two = across(axis)
        which = owner[i]
        for k in range(size):
            d = at3(pattern, 4 * k)
            n = one * d.x + two * d.y + axis * d.z
            p, particle = start[i], ends[2 * i]
            if pattern[4 * k + 3] > 0.5:
                p, particle = end[i], ends[2 * i + 1]
            p += n * radius[i]
            albedo = at3(color, 3 * which)
            if ti.static(by_value):
                if look[which] & SOLID == 0:
                    albedo = colormap_at(colormap, ti.min(ti.max(values[particle], 0.0), 1.0))
            light = sent_light(look[which], albedo, p, n.normalized(), view)
            write_vertex(target, first + i * size + k, p, light, table)


@ti.kernel
def cast_shadows(count: ti.i32, first: ti.i32, extent: ti.f32, plane: Floats, view: Floats, table: Ints, target: Rows):
    """Shadows of the first `count` vertices on a plane (point, normal, light that it sends back), from `first` on."""
    for i in range(count):
        p = vec3(target[i, 0], target[i, 1], target[i, 2])
        eye, light, normal = at3(view, EYE), at3(view, LIGHT), at3(plane, 3)
        facing = ti.max(normal.dot(light), 0.05)
        # What is below the plane casts nothing: its shadow stays with it, out of sight.
        q = p - light * (ti.max((p - at3(plane, 0)).dot(normal), 0.0) / facing)
        way = q - eye
        distance = ti.max(way.norm(), 1e-9)
        # The ground fades into the sky, and with it what falls on it.
        opacity = 1.0 - smoothstep(2.0, 14.0, distance / extent)
        color = at3(plane, 6) * opacity + background(way / distance) * (1.0 - opacity)
        write_vertex(target, first + i, eye + way * (1.0 - SHADOW_LIFT), color, table)
