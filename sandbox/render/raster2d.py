"""Kernels for two dimensions: flat fills, lines with round ends and discs, eight samples a pixel; later ones on top."""

import taichi as ti

from sandbox.render.paper2d import CENTER_X, CENTER_Y, MIDDLE_X, MIDDLE_Y, SCALE
from sandbox.render.raster import is_whole, mark_tiles
from sandbox.render.shade import colormap_at, encode
from sandbox.render.types import Floats, Image3, Ints, Ints2, Keys, Picture3, Points2, vec2, vec3
from sandbox.render.view import TILE, at3

SAMPLES = 8
# Every row and every column of an 8 x 8 grid holds one sample.
SAMPLE_X = (0.0625, -0.0625, 0.3125, -0.1875, -0.3125, -0.4375, 0.1875, 0.4375)
SAMPLE_Y = (-0.1875, 0.1875, 0.0625, -0.3125, 0.3125, -0.0625, 0.4375, -0.4375)
GROWTH = 1.0e-3
FARTHEST = 1.5
"""Distance by which a corner of an outline is moved outward, in radii, at most."""


@ti.kernel
def place_points(positions: ti.template(), slot: ti.i32, view: Floats, screen: Points2):
    """Pixel coordinates of every particle."""
    for i in range(screen.shape[0]):
        p = ti.cast(positions[slot, i], ti.f32)
        screen[i] = vec2(
            view[MIDDLE_X] + (p[0] - view[CENTER_X]) * view[SCALE],
            view[MIDDLE_Y] - (p[1] - view[CENTER_Y]) * view[SCALE],
        )


@ti.func
def point_at(positions: ti.template(), slot, i):
    """First two coordinates of a particle [m]."""
    p = ti.cast(positions[slot, i], ti.f32)
    return vec2(p[0], p[1])


@ti.kernel
def push_outline(positions: ti.template(), slot: ti.i32, corners: Ints, radius: Floats, view: Floats, screen: Points2):
    """Move the particles of outlines outward by their radius [pixels].

    A corner is the particle before it, its own, and the one after it, with the body to the left.
    """
    for k in range(radius.shape[0]):
        i = corners[3 * k + 1]
        p = point_at(positions, slot, i)
        one, two = p - point_at(positions, slot, corners[3 * k]), point_at(positions, slot, corners[3 * k + 2]) - p
        # Both edges move out by the radius: the corner goes farther, but not without end where it is sharp.
        along = one * (1.0 / ti.max(one.norm(), 1e-20)) + two * (1.0 / ti.max(two.norm(), 1e-20))
        push = radius[k] * ti.min(2.0 / ti.max(along.norm(), 1e-6), FARTHEST)
        along *= push / ti.max(along.norm(), 1e-20)
        # Down in the picture is down in the world.
        screen[i] += vec2(along.y, along.x)


@ti.func
def sample_offset(s):
    """Where sample s lies, relative to the pixel's centre [pixels]."""
    dx, dy = ti.static(SAMPLE_X[0]), ti.static(SAMPLE_Y[0])
    for k in ti.static(range(1, SAMPLES)):
        if s == k:
            dx, dy = ti.static(SAMPLE_X[k]), ti.static(SAMPLE_Y[k])
    return dx, dy


@ti.kernel
def draw_flat_triangles(
    can_tear: ti.template(),
    hidden: Ints,
    triangles: Ints,
    triangle_body: Ints,
    screen: Points2,
    keys: Keys,
    tiles: Ints2,
):
    """Enter every whole triangle, whichever way it turns."""
    for t in range(triangle_body.shape[0]):
        a, b, c = screen[triangles[3 * t]], screen[triangles[3 * t + 1]], screen[triangles[3 * t + 2]]
        area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
        x0 = ti.max(ti.floor(ti.min(a.x, b.x, c.x), ti.i32), 0)
        y0 = ti.max(ti.floor(ti.min(a.y, b.y, c.y), ti.i32), 0)
        x1 = ti.min(ti.floor(ti.max(a.x, b.x, c.x), ti.i32), keys.shape[1] - 1)
        y1 = ti.min(ti.floor(ti.max(a.y, b.y, c.y), ti.i32), keys.shape[0] - 1)
        if x0 <= x1 and y0 <= y1 and ti.abs(area) > 1e-6 and is_whole(can_tear, hidden, t):
            mark_tiles(tiles, x0, x1, y0, y1, TILE)
            inverse = 1.0 / area
            bx, by = (c.y - a.y) * inverse, -(c.x - a.x) * inverse
            cx, cy = -(b.y - a.y) * inverse, (b.x - a.x) * inverse
            wide_b, wide_c = ti.abs(bx) + ti.abs(by), ti.abs(cx) + ti.abs(cy)
            wide_a = ti.abs(bx + cx) + ti.abs(by + cy)
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    for s in range(SAMPLES):
                        dx, dy = sample_offset(s)
                        px, py = ti.cast(x, ti.f32) + 0.5 + dx - a.x, ti.cast(y, ti.f32) + 0.5 + dy - a.y
                        wb, wc = bx * px + by * py, cx * px + cy * py
                        if wb > -GROWTH * wide_b and wc > -GROWTH * wide_c and 1.0 - wb - wc > -GROWTH * wide_a:
                            if keys[y, x, s] < t + 1:
                                ti.atomic_max(keys[y, x, s], t + 1)


@ti.kernel
def draw_flat_rounds(
    can_tear: ti.template(),
    hidden: Ints,
    first: ti.i32,
    ends: Ints,
    radius: Floats,
    screen: Points2,
    keys: Keys,
    tiles: Ints2,
):
    """Enter every whole line and disc, with keys after the `first` of triangles; radii are in pixels."""
    for i in range(radius.shape[0]):
        a, b, r = screen[ends[2 * i]], screen[ends[2 * i + 1]], radius[i]
        x0 = ti.max(ti.floor(ti.min(a.x, b.x) - r, ti.i32), 0)
        y0 = ti.max(ti.floor(ti.min(a.y, b.y) - r, ti.i32), 0)
        x1 = ti.min(ti.floor(ti.max(a.x, b.x) + r, ti.i32), keys.shape[1] - 1)
        y1 = ti.min(ti.floor(ti.max(a.y, b.y) + r, ti.i32), keys.shape[0] - 1)
        if x0 <= x1 and y0 <= y1 and is_whole(can_tear, hidden, first + i):
            mark_tiles(tiles, x0, x1, y0, y1, TILE)
            axis = b - a
            inverse = 1.0 / ti.max(axis.dot(axis), 1e-12)
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    for s in range(SAMPLES):
                        dx, dy = sample_offset(s)
                        p = vec2(ti.cast(x, ti.f32) + 0.5 + dx, ti.cast(y, ti.f32) + 0.5 + dy) - a
                        off = p - axis * ti.min(ti.max(p.dot(axis) * inverse, 0.0), 1.0)
                        if off.dot(off) <= r * r and keys[y, x, s] < first + i + 1:
                            ti.atomic_max(keys[y, x, s], first + i + 1)


@ti.func
def flat_color(
    by_value: ti.template(), triangles: ti.template(), triangle_body: ti.template(), triangle_count,
    body_color: ti.template(), screen: ti.template(), round_ends: ti.template(), round_body: ti.template(),
    round_shade: ti.template(), values: ti.template(), colormap: ti.template(), key, p,
):  # fmt: skip
    """Linear colour of what is entered under `key`, at the middle p of a pixel."""
    body, shade, value = 0, 1.0, 0.0
    if key <= triangle_count:
        t = key - 1
        body = triangle_body[t]
        if ti.static(by_value):
            i, j, k = triangles[3 * t], triangles[3 * t + 1], triangles[3 * t + 2]
            a, b, c = screen[i], screen[j] - screen[i], screen[k] - screen[i]
            inverse = 1.0 / (b.x * c.y - b.y * c.x)
            wb = ((p.x - a.x) * c.y - (p.y - a.y) * c.x) * inverse
            wc = ((p.y - a.y) * b.x - (p.x - a.x) * b.y) * inverse
            value = values[i] * (1.0 - wb - wc) + values[j] * wb + values[k] * wc
    else:
        r = key - 1 - triangle_count
        body, shade = round_body[r], round_shade[r]
        if ti.static(by_value):
            i, j = round_ends[2 * r], round_ends[2 * r + 1]
            axis = screen[j] - screen[i]
            along = (p - screen[i]).dot(axis) / ti.max(axis.dot(axis), 1e-12)
            along = ti.min(ti.max(along, 0.0), 1.0)
            value = values[i] * (1.0 - along) + values[j] * along
    color = at3(body_color, 3 * body)
    if ti.static(by_value):
        color = colormap_at(colormap, ti.min(ti.max(value, 0.0), 1.0))
    return color * shade


@ti.kernel
def color_tiles(
    by_value: ti.template(),
    tile_list: Ints,
    tiles: Ints2,
    keys: Keys,
    paper: Image3,
    table: Ints,
    triangles: Ints,
    triangle_body: Ints,
    triangle_count: ti.i32,
    body_color: Floats,
    screen: Points2,
    round_ends: Ints,
    round_body: Ints,
    round_shade: Floats,
    values: Floats,
    colormap: Floats,
    picture: Picture3,
):
    """Colour every pixel of the listed tiles, write it, and empty its samples."""
    for entry in range(tile_list[0]):
        tile = tile_list[entry + 1]
        ty, tx = tile // tiles.shape[1], tile % tiles.shape[1]
        for y in range(ty * TILE, ti.min((ty + 1) * TILE, keys.shape[0])):
            for x in range(tx * TILE, ti.min((tx + 1) * TILE, keys.shape[1])):
                total, color, before = vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0), -1
                for s in range(SAMPLES):
                    key = keys[y, x, s]
                    keys[y, x, s] = 0
                    if key != before:
                        before = key
                        color = paper[y, x]
                        if key > 0:
                            p = vec2(ti.cast(x, ti.f32) + 0.5, ti.cast(y, ti.f32) + 0.5)
                            color = flat_color(
                                by_value, triangles, triangle_body, triangle_count, body_color, screen, round_ends,
                                round_body, round_shade, values, colormap, key, p,
                            )  # fmt: skip
                    total += color
                total *= ti.static(1.0 / SAMPLES)
                for channel in ti.static(range(3)):
                    picture[y, x, channel] = encode(table, total[channel])
