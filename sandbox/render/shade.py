"""The last pass: shade the pixels of the tiles that may have changed."""

import taichi as ti

from sandbox.render.palette import ENCODE_MAX, ENCODE_SIZE
from sandbox.render.raster import hit_capsule, identity_of, nearness_of, sample_key, sample_offset
from sandbox.render.shadow import is_shadow_near, turn_at, visibility
from sandbox.render.surface import SEEP_ABOVE, SEEP_BELOW, jelly, smoothstep, solid
from sandbox.render.types import (
    Floats,
    Image2,
    Image3,
    Ints,
    Ints2,
    Keys,
    Picture3,
    Points,
    SampleDepths,
    Samples,
    vec2,
    vec3,
)
from sandbox.render.view import (
    EYE,
    FOCAL,
    FORWARD,
    LIGHT,
    OPEN,
    ROUND_BIT,
    SOLID,
    TEXELS,
    TILE,
    at3,
    light_slope,
    ray,
    to_light,
)

STEEP = 8.0
"""Depth over a pixel, in widths of a pixel, above which its samples are taken to be different surfaces."""


@ti.func
def corner_weights(a, b, c, x, y):
    """Perspective-correct weights of a triangle's screen corners at (x, y), drawn inside where it is outside."""
    area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
    px, py = x - a.x, y - a.y
    wb = (px * (c.y - a.y) - py * (c.x - a.x)) / area
    wc = (py * (b.x - a.x) - px * (b.y - a.y)) / area
    w = vec3(ti.max(1.0 - wb - wc, 0.0) * a.z, ti.max(wb, 0.0) * b.z, ti.max(wc, 0.0) * c.z)
    return w / (w.x + w.y + w.z)


@ti.func
def colormap_at(colormap: ti.template(), value):
    """Colour of a value in [0, 1]."""
    last = colormap.shape[0] // 3 - 1
    at = value * ti.cast(last, ti.f32)
    k = ti.min(ti.cast(at, ti.i32), last - 1)
    f = at - ti.cast(k, ti.f32)
    return at3(colormap, 3 * k) * (1.0 - f) + at3(colormap, 3 * k + 3) * f


@ti.func
def encode(table: ti.template(), linear):
    """8-bit sRGB of linear light."""
    at = ti.sqrt(ti.min(ti.max(linear, 0.0), ENCODE_MAX) * (1.0 / ENCODE_MAX)) * (ENCODE_SIZE - 1.0)
    return ti.cast(table[ti.cast(at + 0.5, ti.i32)], ti.u8)


@ti.func
def round_surface(start: ti.template(), end: ti.template(), radius: ti.template(), view: ti.template(), i, x, y):
    """Point and normal of a capsule along the ray through (x, y), and how far along its axis that is, in [0, 1]."""
    a, b = start[i], end[i]
    eye, direction = at3(view, EYE), ray(view, x, y)
    middle = (0.5 * (a + b) - eye).dot(at3(view, FORWARD))
    origin = eye + direction * middle
    found, t = hit_capsule(origin, direction, a, b, radius[i])
    p = origin + direction * t * ti.cast(found, ti.f32)
    axis = b - a
    along = ti.min(ti.max((p - a).dot(axis) / ti.max(axis.dot(axis), 1e-20), 0.0), 1.0)
    n = p - (a + axis * along)
    return p, n * (1.0 / ti.sqrt(ti.max(n.dot(n), 1e-20))), along


@ti.func
def triangle_surface(
    by_value: ti.template(),
    triangles: ti.template(),
    world: ti.template(),
    normal: ti.template(),
    screen: ti.template(),
    value_of: ti.template(),
    values: ti.template(),
    t,
    x,
    y,
):
    """Point, normal, normal of its plane, value and turning sense (< 0: seen from outside) of a triangle at (x, y)."""
    i, j, k = triangles[3 * t], triangles[3 * t + 1], triangles[3 * t + 2]
    a, b, c = screen[i], screen[j], screen[k]
    w = corner_weights(a, b, c, x, y)
    p = world[i] * w.x + world[j] * w.y + world[k] * w.z
    n = (normal[i] * w.x + normal[j] * w.y + normal[k] * w.z).normalized(1e-12)
    value = 0.0
    if ti.static(by_value):
        value = values[value_of[i]] * w.x + values[value_of[j]] * w.y + values[value_of[k]] * w.z
    face = (world[j] - world[i]).cross(world[k] - world[i]).normalized(1e-20)
    return p, n, face, value, (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)


@ti.func
def body_surface(
    by_value: ti.template(),
    triangles: ti.template(),
    triangle_body: ti.template(),
    body_look: ti.template(),
    body_color: ti.template(),
    world: ti.template(),
    normal: ti.template(),
    screen: ti.template(),
    value_of: ti.template(),
    round_start: ti.template(),
    round_end: ti.template(),
    round_radius: ti.template(),
    round_body: ti.template(),
    round_ends: ti.template(),
    values: ti.template(),
    colormap: ti.template(),
    view: ti.template(),
    identity,
    x,
    y,
):
    """Point, normal, normal of its plane, colour and look of what is drawn at (x, y)."""
    p, n, face = vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0)
    body, look, value = 0, 0, 0.0
    if identity < ROUND_BIT:
        body = triangle_body[identity - 1]
        look = body_look[body]
        q, m, f, v, turning = triangle_surface(
            by_value, triangles, world, normal, screen, value_of, values, identity - 1, x, y
        )
        p, n, face, value = q, m, f, v
        if look & OPEN != 0 and turning > 0.0:
            n, face = -m, -f
    else:
        i = identity - ROUND_BIT
        body = round_body[i]
        look = body_look[body]
        q, m, along = round_surface(round_start, round_end, round_radius, view, i, x, y)
        p, n, face = q, m, m
        if ti.static(by_value):
            value = values[round_ends[2 * i]] * (1.0 - along) + values[round_ends[2 * i + 1]] * along
    albedo = at3(body_color, 3 * body)
    if ti.static(by_value):
        if look & SOLID == 0:
            albedo = colormap_at(colormap, value)
    return p, n, face, albedo, look


@ti.func
def body_light(has_solids: ti.template(), look, albedo, normal, to_eye, light, seen):
    """Light that leaves a body, or a collider that moves, of whose key light the part `seen` arrives."""
    color = vec3(0.0, 0.0, 0.0)
    is_solid = False
    if ti.static(has_solids):
        is_solid = look & SOLID != 0
        if is_solid:
            ambient, key = solid(albedo, normal, -to_eye, light)
            color = ambient + key * seen
    if not is_solid:
        color = jelly(albedo, normal, to_eye, light, seen, 1.0)
    return color


@ti.func
def is_one_surface(
    has_solids: ti.template(),
    samples: ti.template(),
    triangle_body: ti.template(),
    body_look: ti.template(),
    view: ti.template(),
    y,
    x,
):
    """True where the four samples of a pixel lie on one smooth surface."""
    first = samples[y, x, 0]
    one = identity_of(first)
    same, near, far = True, nearness_of(first), nearness_of(first)
    for s in ti.static(range(1, 4)):
        key = samples[y, x, s]
        other = identity_of(key)
        near, far = ti.max(near, nearness_of(key)), ti.min(far, nearness_of(key))
        if other != one:
            if one <= 0 or other <= 0 or one >= ROUND_BIT or other >= ROUND_BIT:
                same = False
            elif triangle_body[one - 1] != triangle_body[other - 1]:
                same = False
            elif ti.static(has_solids):
                # Colliders have sharp edges.
                if body_look[triangle_body[one - 1]] & SOLID != 0:
                    same = False
    return same and (one == 0 or (near - far) * view[FOCAL] < STEEP * near)


@ti.kernel
def shade_tiles(
    by_value: ti.template(),
    has_solids: ti.template(),
    tile_list: Ints,
    tiles: Ints2,
    light_tiles: Ints2,
    samples: Samples,
    depths: SampleDepths,
    shadow_map: Ints2,
    shadow_block: Ints2,
    shadow_cells: Keys,
    ambient: Image3,
    key: Image3,
    place: Image3,
    slope: Image2,
    view: Floats,
    disk: Floats,
    table: Ints,
    triangles: Ints,
    triangle_body: Ints,
    body_look: Ints,
    body_color: Floats,
    world: Points,
    normal: Points,
    screen: Points,
    value_of: Ints,
    round_start: Points,
    round_end: Points,
    round_radius: Floats,
    round_body: Ints,
    round_ends: Ints,
    values: Floats,
    colormap: Floats,
    picture: Picture3,
):
    """Shade every pixel of the listed tiles, write it, and take what moves out of its samples."""
    for entry in range(tile_list[0]):
        tile = tile_list[entry + 1]
        ty, tx = tile // tiles.shape[1], tile % tiles.shape[1]
        eye, light = at3(view, EYE), at3(view, LIGHT)
        for y in range(ty * TILE, ti.min((ty + 1) * TILE, samples.shape[0])):
            for x in range(tx * TILE, ti.min((tx + 1) * TILE, samples.shape[1])):
                count = 4
                if is_one_surface(has_solids, samples, triangle_body, body_look, view, y, x):
                    count = 1
                total, color, before = vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0), -1
                for s in range(count):
                    identity = identity_of(samples[y, x, s])
                    if identity != before:
                        before = identity
                        p, n, face, albedo, look = eye, light, light, vec3(0.0, 0.0, 0.0), 0
                        at, tilt, shaded, depth = place[y, x], slope[y, x], key[y, x].x > 0.0, 1.0
                        if identity != 0:
                            dx, dy = 0.0, 0.0
                            if count == 4:
                                dx, dy = sample_offset(s)
                            p, n, face, albedo, look = body_surface(
                                by_value, triangles, triangle_body, body_look, body_color, world, normal, screen,
                                value_of, round_start, round_end, round_radius, round_body, round_ends, values,
                                colormap, view, identity, ti.cast(x, ti.f32) + 0.5 + dx, ti.cast(y, ti.f32) + 0.5 + dy,
                            )  # fmt: skip
                            # Shadows fall on the plane of a facet: a smooth normal's would cut through it.
                            facing = light_slope(view, face)
                            at = to_light(view, p + n * (1.0 / view[TEXELS]))
                            tilt, shaded = vec2(facing.x, facing.y), ti.min(facing.z, n.dot(light)) > SEEP_BELOW
                            # A facet that turns away shades itself wherever a smooth surface would not yet.
                            depth = smoothstep(SEEP_BELOW, SEEP_ABOVE, facing.z)
                        seen = 1.0
                        if shaded and is_shadow_near(light_tiles, at):
                            seen = visibility(
                                shadow_map, shadow_block, shadow_cells, view, disk, turn_at(disk, x, y), at, tilt
                            )
                            seen = 1.0 - (1.0 - seen) * depth
                        if identity == 0:
                            color = ambient[y, x] + key[y, x] * seen
                        else:
                            color = body_light(has_solids, look, albedo, n, (eye - p).normalized(), light, seen)
                    total += color
                total *= 1.0 / ti.cast(count, ti.f32)
                for channel in ti.static(range(3)):
                    picture[y, x, channel] = encode(table, total[channel])
                for s in range(4):
                    samples[y, x, s] = sample_key(depths[y, x, s], 0)
