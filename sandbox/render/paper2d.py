"""Kernels for what lies under the bodies in two dimensions: a background with its grid, and colliders on it."""

import taichi as ti

from sandbox.render.colliders2d import AXIS, EDGE, KIND, LINE, POINT, POLYGON, RECTANGLE, ROD, ROW, SHAPE, TINT
from sandbox.render.types import Floats, Image3, Ints2, vec2, vec3
from sandbox.render.view import MOVING, TILE, at3

CENTER_X, CENTER_Y, SCALE, MIDDLE_X, MIDDLE_Y = 0, 1, 2, 3, 4
HALF_DIAGONAL = 0.75 * TILE
"""A little more than half of a tile's diagonal [pixels]."""
NEAR_EDGES = 48
"""Room for edges of a polygon near a tile."""


@ti.func
def world_point(view: ti.template(), x, y):
    """World coordinates [m] of picture coordinates [pixels]."""
    across, down = (x - view[MIDDLE_X]) / view[SCALE], (y - view[MIDDLE_Y]) / view[SCALE]
    return vec2(view[CENTER_X] + across, view[CENTER_Y] - down)


@ti.func
def list_edges(edges: ti.template(), near: ti.template(), tile, first, count, q, reach):
    """List the edges that tell the distance of points within `reach` of q [m]; -1 where they are too many.

    Those are the edges that may be within reach, and those that a ray to the right may cross.
    """
    listed = 0
    for k in range(first, first + count):
        at = k * EDGE
        low, high = ti.min(edges[at + 1], edges[at + 3]), ti.max(edges[at + 1], edges[at + 3])
        if low < q.y + reach and high > q.y - reach and ti.max(edges[at], edges[at + 2]) > q.x - reach:
            if listed >= 0 and listed < near.shape[1]:
                near[tile, listed] = k
                listed += 1
            else:
                listed = -1
    return listed


@ti.func
def polygon_distance(edges: ti.template(), near: ti.template(), tile, listed, first, count, q):
    """Signed distance of a point from a polygon in its own axes [m], negative inside by the even-odd rule.

    Takes the `listed` edges of a tile, all of the polygon's where that is -1.
    """
    nearest, sign = 1e30, 1.0
    for entry in range(ti.select(listed < 0, count, listed)):
        k = first + entry
        if listed >= 0:
            k = near[tile, entry]
        at = k * EDGE
        a, b = vec2(edges[at], edges[at + 1]), vec2(edges[at + 2], edges[at + 3])
        off, along = q - a, b - a
        beside = off - along * ti.min(ti.max(off.dot(along) * edges[at + 4], 0.0), 1.0)
        nearest = ti.min(nearest, beside.dot(beside))
        # Heights compare alike for both edges at a corner: a ray through it crosses an even number, or an odd one.
        crosses = (a.y > q.y) != (b.y > q.y) and off.x < off.y * edges[at + 5]
        sign = ti.select(crosses, -sign, sign)
    return sign * ti.sqrt(nearest)


@ti.func
def to_local(rows: ti.template(), i, p):
    """A point in the axes of collider i [m]."""
    at = i * ROW
    q = p - vec2(rows[at + POINT], rows[at + POINT + 1])
    cosine, sine = rows[at + AXIS], rows[at + AXIS + 1]
    return vec2(q.x * cosine + q.y * sine, q.y * cosine - q.x * sine)


@ti.func
def collider_distance(rows: ti.template(), edges: ti.template(), near: ti.template(), tile, listed, i, p):
    """Signed distance of a point from collider i [m], negative inside; of a polygon's edges those `listed`."""
    at = i * ROW
    kind = ti.cast(rows[at + KIND], ti.i32)
    q, local = p - vec2(rows[at + POINT], rows[at + POINT + 1]), to_local(rows, i, p)
    distance = q.norm() - rows[at + SHAPE]
    if kind == LINE:
        distance = local.x
    elif kind == RECTANGLE:
        across, along = ti.abs(local.x) - rows[at + SHAPE], ti.abs(local.y) - rows[at + SHAPE + 1]
        out = vec2(ti.max(across, 0.0), ti.max(along, 0.0))
        distance = out.norm() + ti.min(ti.max(across, along), 0.0)
    elif kind == ROD:
        axis = vec2(rows[at + AXIS], rows[at + AXIS + 1])
        off = q - axis * ti.min(ti.max(local.x / ti.max(axis.dot(axis), 1e-20), 0.0), 1.0)
        distance = off.norm() - rows[at + SHAPE]
    elif kind == POLYGON:
        first, count = ti.cast(rows[at + SHAPE], ti.i32), ti.cast(rows[at + SHAPE + 1], ti.i32)
        distance = polygon_distance(edges, near, tile, listed, first, count, local)
    return distance


@ti.kernel
def cast_paper(view: Floats, spacing: ti.f32, paper: Image3):
    """Background with its grid, lines every `spacing` [m]."""
    for y, x in ti.ndrange(paper.shape[0], paper.shape[1]):
        p = world_point(view, ti.cast(x, ti.f32) + 0.5, ti.cast(y, ti.f32) + 0.5)
        color = vec3(0.93, 0.94, 0.95)
        for k in ti.static(range(2)):
            near = ti.abs(p[k] / spacing - ti.round(p[k] / spacing)) * spacing * view[SCALE]
            major = ti.abs(p[k] / spacing / 5.0 - ti.round(p[k] / spacing / 5.0)) * spacing * 5.0 * view[SCALE]
            color *= 1.0 - 0.07 * ti.max(0.0, 1.0 - near) - 0.07 * ti.max(0.0, 1.0 - major)
        paper[y, x] = color


@ti.func
def copy_tile(under: ti.template(), over: ti.template(), ty, tx):
    """Copy the pixels of a tile."""
    for y in range(ty * TILE, ti.min((ty + 1) * TILE, over.shape[0])):
        for x in range(tx * TILE, ti.min((tx + 1) * TILE, over.shape[1])):
            over[y, x] = under[y, x]


@ti.func
def lay_on_tile(
    rows: ti.template(), edges: ti.template(), view: ti.template(), line, over: ti.template(), near: ti.template(),
    ty, tx, middle, i, is_deep,
):  # fmt: skip
    """Fill collider i on a tile, all of it where `is_deep`, and outline it, by analytic coverage."""
    tint, tile, listed = at3(rows, i * ROW + TINT), ty * ((over.shape[1] - 1) // TILE + 1) + tx, -1
    if not is_deep and ti.cast(rows[i * ROW + KIND], ti.i32) == POLYGON:
        first, count = ti.cast(rows[i * ROW + SHAPE], ti.i32), ti.cast(rows[i * ROW + SHAPE + 1], ti.i32)
        reach = (HALF_DIAGONAL + 2.0 * line + 1.0) / view[SCALE]
        listed = list_edges(edges, near, tile, first, count, to_local(rows, i, middle), reach)
    for y in range(ty * TILE, ti.min((ty + 1) * TILE, over.shape[0])):
        for x in range(tx * TILE, ti.min((tx + 1) * TILE, over.shape[1])):
            if is_deep:
                over[y, x] = tint
            else:
                p = world_point(view, ti.cast(x, ti.f32) + 0.5, ti.cast(y, ti.f32) + 0.5)
                distance = collider_distance(rows, edges, near, tile, listed, i, p) * view[SCALE]
                inside = ti.min(ti.max(0.5 - distance, 0.0), 1.0)
                edge = ti.min(ti.max(0.5 + line - ti.abs(distance + line), 0.0), 1.0)
                color = over[y, x] * (1.0 - inside) + tint * inside
                over[y, x] = color * (1.0 - edge) + tint * (0.45 * edge)


@ti.kernel
def lay_colliders(
    rows: Floats,
    edges: Floats,
    view: Floats,
    line: ti.f32,
    under: Image3,
    over: Image3,
    near: Ints2,
    laid: Ints2,
    tiles: Ints2,
):
    """Copy `under` to `over`, with colliders on it.

    Only tiles that a collider touches are written, and those that `laid` tells were touched before; they are marked
    in `tiles`. `line` is half of the outlines' width [pixels]; `near` has room for a list of edges for every tile.
    """
    for ty, tx in ti.ndrange(tiles.shape[0], tiles.shape[1]):
        middle = world_point(view, (ti.cast(tx, ti.f32) + 0.5) * TILE, (ti.cast(ty, ti.f32) + 0.5) * TILE)
        # No point of a tile is further from its middle.
        reach = HALF_DIAGONAL + 1.0
        touched = 0
        for i in range(rows.shape[0] // ROW):
            distance = collider_distance(rows, edges, near, 0, -1, i, middle) * view[SCALE]
            if distance < reach:
                if touched == 0:
                    touched = 1
                    copy_tile(under, over, ty, tx)
                is_deep = distance < -(reach + 2.0 * line)
                lay_on_tile(rows, edges, view, line, over, near, ty, tx, middle, i, is_deep)
        if touched == 0 and laid[ty, tx] != 0:
            copy_tile(under, over, ty, tx)
        if touched != 0 or laid[ty, tx] != 0:
            tiles[ty, tx] |= MOVING
        laid[ty, tx] = touched
