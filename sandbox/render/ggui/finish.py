"""The last pass over a picture of GGUI: the right way up, as bytes, with smooth edges."""

import taichi as ti

from sandbox.render.types import Image, Picture3, vec3

SIDE = 16
"""Side of the blocks that are turned at once [pixels]: columns of one picture are rows of the other."""
CONTRAST = 0.04
"""Difference of brightness around a pixel from which on it is on an edge, in parts of white."""
REACH = 8.0
"""Most that the direction of an edge is stretched by [pixels]."""


@ti.func
def pixel(image: ti.template(), x, y):
    """Colour of a pixel; beyond the edges that of the nearest."""
    i = ti.min(ti.max(x, 0), ti.cast(image.shape[0], ti.i32) - 1)
    j = ti.min(ti.max(y, 0), ti.cast(image.shape[1], ti.i32) - 1)
    return vec3(image[i, j, 0], image[i, j, 1], image[i, j, 2])


@ti.func
def between(image: ti.template(), x, y):
    """Colour at a place between the middles of pixels, by bilinear interpolation."""
    i, j = ti.floor(x, ti.i32), ti.floor(y, ti.i32)
    u, v = x - ti.floor(x), y - ti.floor(y)
    lower = pixel(image, i, j) * (1.0 - u) + pixel(image, i + 1, j) * u
    upper = pixel(image, i, j + 1) * (1.0 - u) + pixel(image, i + 1, j + 1) * u
    return lower * (1.0 - v) + upper * v


@ti.func
def luma(color):
    """Brightness of an sRGB colour."""
    return color.dot(vec3(0.299, 0.587, 0.114))


@ti.func
def smoothed(image: ti.template(), x, y):
    """Colour of a pixel, on an edge mixed with colours along it (fast approximate antialiasing, Lottes 2009)."""
    middle = pixel(image, x, y)
    color, m = middle, luma(middle)
    nw, ne = luma(pixel(image, x - 1, y + 1)), luma(pixel(image, x + 1, y + 1))
    sw, se = luma(pixel(image, x - 1, y - 1)), luma(pixel(image, x + 1, y - 1))
    low, high = ti.min(m, nw, ne, sw, se), ti.max(m, nw, ne, sw, se)
    if high - low > CONTRAST:
        dx, dy = (nw + ne) - (sw + se), (nw + sw) - (ne + se)
        # Along the edge: across the gradient, which points along (-dy, dx).
        along_x, along_y = dx, dy
        scale = 1.0 / (ti.min(ti.abs(dx), ti.abs(dy)) + 0.03 * (nw + ne + sw + se) + 1.0 / 128.0)
        along_x = ti.min(ti.max(along_x * scale, -REACH), REACH)
        along_y = ti.min(ti.max(along_y * scale, -REACH), REACH)
        px, py = ti.cast(x, ti.f32), ti.cast(y, ti.f32)
        near = 0.5 * (
            between(image, px - along_x / 6.0, py - along_y / 6.0)
            + between(image, px + along_x / 6.0, py + along_y / 6.0)
        )
        far = 0.5 * near + 0.25 * (
            between(image, px - along_x / 2.0, py - along_y / 2.0)
            + between(image, px + along_x / 2.0, py + along_y / 2.0)
        )
        color = far
        if luma(far) < low or luma(far) > high:
            color = near
    return color


@ti.kernel
def finish_picture(image: Image, picture: Picture3):
    """Write an image of GGUI, (width, height, 4) and y up, as a picture, (height, width, 3) and y down."""
    height, width = ti.cast(picture.shape[0], ti.i32), ti.cast(picture.shape[1], ti.i32)
    for ty, tx in ti.ndrange((height + SIDE - 1) // SIDE, (width + SIDE - 1) // SIDE):
        for x in range(tx * SIDE, ti.min((tx + 1) * SIDE, width)):
            for y in range(ty * SIDE, ti.min((ty + 1) * SIDE, height)):
                color = smoothed(image, x, height - 1 - y)
                for channel in ti.static(range(3)):
                    value = ti.min(ti.max(color[channel], 0.0), 1.0)
                    picture[y, x, channel] = ti.cast(value * 255.0 + 0.5, ti.u8)
