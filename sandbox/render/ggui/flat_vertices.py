"""Kernels that write the vertices of flat pictures as GGUI reads them: places in parts of the picture, y up."""

import taichi as ti

from sandbox.render.ggui.lighting import COLOR
from sandbox.render.shade import colormap_at, encode
from sandbox.render.types import Background, Floats, Ints, Picture3, Points2, Rows, vec2, vec3
from sandbox.render.view import at3

SIDE = 16
"""Side of the blocks that are turned at once [pixels]: rows of one picture are columns of the other."""


@ti.kernel
def take_background(picture: Picture3, background: Background):
    """A picture, (height, width, 3) and y down, as four bytes a pixel, (width, height) and y up."""
    height, width = ti.cast(picture.shape[0], ti.i32), ti.cast(picture.shape[1], ti.i32)
    for ty, tx in ti.ndrange((height + SIDE - 1) // SIDE, (width + SIDE - 1) // SIDE):
        for y in range(ty * SIDE, ti.min((ty + 1) * SIDE, height)):
            for x in range(tx * SIDE, ti.min((tx + 1) * SIDE, width)):
                red, green = ti.cast(picture[y, x, 0], ti.u32), ti.cast(picture[y, x, 1], ti.u32)
                blue = ti.cast(picture[y, x, 2], ti.u32)
                background[x, height - 1 - y] = (
                    red | (green << ti.u32(8)) | (blue << ti.u32(16)) | (ti.u32(255) << ti.u32(24))
                )


@ti.func
def write_point(target: ti.template(), i, p, linear, table: ti.template(), width, height):
    """Enter a vertex at a place in the picture [pixels, y down] with its linear colour."""
    target[i, 0] = p.x / width
    target[i, 1] = 1.0 - p.y / height
    for axis in ti.static(range(3)):
        target[i, COLOR + axis] = ti.cast(encode(table, linear[axis]), ti.f32) * (1.0 / 255.0)
    target[i, COLOR + 3] = 1.0


@ti.func
def value_color(colormap: ti.template(), value):
    """Linear colour of a value, in [0, 1] or brought there."""
    return colormap_at(colormap, ti.min(ti.max(value, 0.0), 1.0))


@ti.kernel
def color_triangles(
    by_value: ti.template(),
    count: ti.i32,
    triangles: Ints,
    triangle_body: Ints,
    screen: Points2,
    body_color: Floats,
    values: Floats,
    colormap: Floats,
    table: Ints,
    width: ti.f32,
    height: ti.f32,
    target: Rows,
):
    """Corners of all triangles, from 0 on."""
    for i in range(3 * count):
        color = at3(body_color, 3 * triangle_body[i // 3])
        if ti.static(by_value):
            color = value_color(colormap, values[triangles[i]])
        write_point(target, i, screen[triangles[i]], color, table, width, height)


@ti.kernel
def color_rounds(
    by_value: ti.template(),
    count: ti.i32,
    first: ti.i32,
    pattern: Floats,
    ends: Ints,
    radius: Floats,
    body: Ints,
    shade: Floats,
    screen: Points2,
    body_color: Floats,
    values: Floats,
    colormap: Floats,
    table: Ints,
    width: ti.f32,
    height: ti.f32,
    target: Rows,
):
    """Vertices of lines and discs, from `first` on."""
    size = pattern.shape[0] // 3
    for i in range(count):
        a, b = screen[ends[2 * i]], screen[ends[2 * i + 1]]
        axis = vec2(1.0, 0.0)
        if (b - a).dot(b - a) > 1e-12:
            axis = (b - a).normalized()
        for k in range(size):
            x, y = pattern[3 * k] * radius[i], pattern[3 * k + 1] * radius[i]
            p, particle = a, ends[2 * i]
            if pattern[3 * k + 2] > 0.5:
                p, particle = b, ends[2 * i + 1]
            p += vec2(axis.x * x - axis.y * y, axis.y * x + axis.x * y)
            color = at3(body_color, 3 * body[i])
            if ti.static(by_value):
                color = value_color(colormap, values[particle])
            write_point(target, first + i * size + k, p, vec3(color * shade[i]), table, width, height)
