"""Kernels that find out which primitive is in front: seen from the camera, and seen from the light."""

import taichi as ti

from sandbox.render.light import LIGHT_TILE
from sandbox.render.types import Floats, Ints, Ints2, Points, Samples, vec2
from sandbox.render.view import (
    BLOCK,
    EYE,
    FOCAL,
    FORWARD,
    LIGHT,
    LIGHT_U,
    LIGHT_V,
    MOVING,
    NEAR,
    OPEN,
    ROUND_BIT,
    SAMPLE_X,
    SAMPLE_Y,
    TEXELS,
    TILE,
    at3,
    project,
    ray,
    to_light,
)

# Triangles are grown by this part of a pixel, so that rounding leaves no pinholes along shared edges.
GROWTH = 1.0e-3
REACH = 0.376


@ti.func
def sample_key(inverse_depth, identity):
    """Depth and identity in 64 bits: the nearer is the larger; equal depths go to the larger identity."""
    return (ti.cast(ti.bit_cast(inverse_depth, ti.u32), ti.u64) << ti.u64(32)) | ti.cast(identity, ti.u64)


@ti.func
def identity_of(key):
    """Identity half of a sample."""
    return ti.cast(key & ti.u64(0xFFFFFFFF), ti.i32)


@ti.func
def nearness_of(key):
    """Inverse depth half of a sample [1/m]."""
    return ti.bit_cast(ti.cast(key >> ti.u64(32), ti.u32), ti.f32)


@ti.func
def is_whole(can_tear: ti.template(), hidden: ti.template(), i):
    """True where a primitive has not torn."""
    whole = True
    if ti.static(can_tear):
        whole = hidden[i] == 0
    return whole


@ti.func
def raise_sample(samples: ti.template(), y, x, s, key):
    """Keep the nearer; reading first spares most of the slow atomics."""
    if samples[y, x, s] < key:
        ti.atomic_max(samples[y, x, s], key)


@ti.func
def raise_light(shadow_map: ti.template(), shadow_block: ti.template(), v, u, w):
    """Keep the height nearest to the light, in its texel and its block."""
    bits = ti.bit_cast(w, ti.i32)
    if shadow_map[v, u] < bits:
        ti.atomic_max(shadow_map[v, u], bits)
        if shadow_block[v // BLOCK, u // BLOCK] < bits:
            ti.atomic_max(shadow_block[v // BLOCK, u // BLOCK], bits)


@ti.func
def mark_tiles(tiles: ti.template(), x0, x1, y0, y1, side: ti.template()):
    """Mark the tiles that a rectangle of pixels touches."""
    for ty in range(y0 // side, y1 // side + 1):
        for tx in range(x0 // side, x1 // side + 1):
            if tiles[ty, tx] & MOVING == 0:
                tiles[ty, tx] |= MOVING


@ti.func
def mark_shadow(light_tiles: ti.template(), u0, u1, v0, v1):
    """Mark the tiles of the shadow map within the widest penumbra of a rectangle of texels."""
    low_u, low_v = ti.max(u0 - LIGHT_TILE, 0), ti.max(v0 - LIGHT_TILE, 0)
    high_u = ti.min(u1 + LIGHT_TILE, light_tiles.shape[1] * LIGHT_TILE - 1)
    high_v = ti.min(v1 + LIGHT_TILE, light_tiles.shape[0] * LIGHT_TILE - 1)
    mark_tiles(light_tiles, low_u, high_u, low_v, high_v, LIGHT_TILE)


@ti.func
def cover_screen(a, b, c, area, identity, samples: ti.template(), tiles: ti.template()):
    """Enter a triangle of screen corners (x, y, inverse depth) into the samples that it covers."""
    x0 = ti.max(ti.floor(ti.min(a.x, b.x, c.x), ti.i32), 0)
    y0 = ti.max(ti.floor(ti.min(a.y, b.y, c.y), ti.i32), 0)
    x1 = ti.min(ti.floor(ti.max(a.x, b.x, c.x), ti.i32), samples.shape[1] - 1)
    y1 = ti.min(ti.floor(ti.max(a.y, b.y, c.y), ti.i32), samples.shape[0] - 1)
    if x0 <= x1 and y0 <= y1:
        mark_tiles(tiles, x0, x1, y0, y1, TILE)
        inverse = 1.0 / area
        bx, by = (c.y - a.y) * inverse, -(c.x - a.x) * inverse
        cx, cy = -(b.y - a.y) * inverse, (b.x - a.x) * inverse
        ax, ay = -(bx + cx), -(by + cy)
        wide_a, wide_b, wide_c = ti.abs(ax) + ti.abs(ay), ti.abs(bx) + ti.abs(by), ti.abs(cx) + ti.abs(cy)
        depth_x = bx * (b.z - a.z) + cx * (c.z - a.z)
        depth_y = by * (b.z - a.z) + cy * (c.z - a.z)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                px, py = ti.cast(x, ti.f32) + 0.5 - a.x, ti.cast(y, ti.f32) + 0.5 - a.y
                wb, wc = bx * px + by * py, cx * px + cy * py
                wa = 1.0 - wb - wc
                if wa > -REACH * wide_a and wb > -REACH * wide_b and wc > -REACH * wide_c:
                    depth = a.z + depth_x * px + depth_y * py
                    for s in ti.static(range(4)):
                        dx, dy = ti.static(SAMPLE_X[s]), ti.static(SAMPLE_Y[s])
                        inside_a = wa + ax * dx + ay * dy > -GROWTH * wide_a
                        inside_b = wb + bx * dx + by * dy > -GROWTH * wide_b
                        inside_c = wc + cx * dx + cy * dy > -GROWTH * wide_c
                        if inside_a and inside_b and inside_c:
                            nearness = ti.max(depth + depth_x * dx + depth_y * dy, 1e-12)
                            raise_sample(samples, y, x, s, sample_key(nearness, identity))


@ti.func
def cover_light(a, b, c, area, shadow_map: ti.template(), shadow_block: ti.template(), tiles: ti.template()):
    """Enter a triangle of light coordinates (u, v, w) into the shadow map."""
    u0 = ti.max(ti.ceil(ti.min(a.x, b.x, c.x) - 0.5, ti.i32), 0)
    v0 = ti.max(ti.ceil(ti.min(a.y, b.y, c.y) - 0.5, ti.i32), 0)
    u1 = ti.min(ti.floor(ti.max(a.x, b.x, c.x) - 0.5, ti.i32), shadow_map.shape[1] - 1)
    v1 = ti.min(ti.floor(ti.max(a.y, b.y, c.y) - 0.5, ti.i32), shadow_map.shape[0] - 1)
    if u0 <= u1 and v0 <= v1:
        mark_shadow(tiles, u0, u1, v0, v1)
        inverse = 1.0 / area
        bx, by = (c.y - a.y) * inverse, -(c.x - a.x) * inverse
        cx, cy = -(b.y - a.y) * inverse, (b.x - a.x) * inverse
        tolerance = -GROWTH * (ti.abs(bx) + ti.abs(by) + ti.abs(cx) + ti.abs(cy))
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                pu, pv = ti.cast(u, ti.f32) + 0.5 - a.x, ti.cast(v, ti.f32) + 0.5 - a.y
                wb, wc = bx * pu + by * pv, cx * pu + cy * pv
                if wb > tolerance and wc > tolerance and 1.0 - wb - wc > tolerance:
                    raise_light(shadow_map, shadow_block, v, u, a.z + wb * (b.z - a.z) + wc * (c.z - a.z))


@ti.kernel
def draw_triangles(
    can_tear: ti.template(),
    hidden: Ints,
    triangles: Ints,
    triangle_body: Ints,
    body_look: Ints,
    screen: Points,
    light: Points,
    samples: Samples,
    tiles: Ints2,
    shadow_map: Ints2,
    shadow_block: Ints2,
    light_tiles: Ints2,
):
    """Enter every whole triangle that faces the camera (or the light); those of open surfaces always."""
    for t in range(triangle_body.shape[0]):
        if is_whole(can_tear, hidden, t):
            i, j, k = triangles[3 * t], triangles[3 * t + 1], triangles[3 * t + 2]
            look = body_look[triangle_body[t]]
            a, b, c = screen[i], screen[j], screen[k]
            area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
            is_faced = area < -1e-7 or (look & OPEN != 0 and area > 1e-7)
            if a.z > 0.0 and b.z > 0.0 and c.z > 0.0 and is_faced:
                cover_screen(a, b, c, area, t + 1, samples, tiles)
            # New names: Taichi 1.7.4 loses a tuple of vectors that is assigned twice around a branch.
            la, lb, lc = light[i], light[j], light[k]
            area_lit = (lb.x - la.x) * (lc.y - la.y) - (lb.y - la.y) * (lc.x - la.x)
            # Colliders cast with both sides: some of their plates have but one.
            if area_lit > 1e-7 or (look != 0 and area_lit < -1e-7):
                cover_light(la, lb, lc, area_lit, shadow_map, shadow_block, light_tiles)


@ti.func
def hit_capsule(origin, direction, a, b, radius):
    """Ray parameter of the first hit of a capsule (a sphere where a = b); negative: a miss.

    Valid for origins near the capsule; the parameter may then be negative as well, so it comes with a flag.
    """
    axis, from_a = b - a, origin - a
    aa, ad, ao = axis.dot(axis), axis.dot(direction), axis.dot(from_a)
    dd, do = direction.dot(direction), direction.dot(from_a)
    qa = aa * dd - ad * ad
    qb = aa * do - ao * ad
    qc = aa * from_a.dot(from_a) - ao * ao - radius * radius * aa
    h = qb * qb - qa * qc
    found, t = 0, 0.0
    along_axis = qa <= 1e-7 * aa * dd
    if not along_axis and h >= 0.0:
        t = (-qb - ti.sqrt(h)) / qa
        along = ao + t * ad
        if along > 0.0 and along < aa:
            found = 1
        else:
            ao = along
    if found == 0 and (h >= 0.0 or along_axis):
        cap = from_a
        if aa > 0.0 and ((ao > 0.0 and not along_axis) or (ad < 0.0 and along_axis)):
            cap = origin - b
        cb, cc = direction.dot(cap), cap.dot(cap) - radius * radius
        ch = cb * cb - dd * cc
        if ch >= 0.0:
            t = (-cb - ti.sqrt(ch)) / dd
            found = 1
    return found, t


@ti.func
def is_near_segment(p, axis, reach):
    """True where p is within `reach` of the segment from the origin to `axis`: spares the empty corners of its box."""
    off = p - axis * ti.min(ti.max(p.dot(axis) / ti.max(axis.dot(axis), 1e-12), 0.0), 1.0)
    return off.dot(off) <= reach * reach


@ti.func
def in_front(p, other, eye, forward, least):
    """p, or where the way from there to `other` comes to lie `least` in front of the eye [m]."""
    depth, ahead = (p - eye).dot(forward), (other - eye).dot(forward)
    part = 0.0
    if depth < least and ahead > least:
        part = (least - depth) / (ahead - depth)
    return p + (other - p) * part


@ti.func
def cover_screen_round(a, b, radius, identity, view: ti.template(), samples: ti.template(), tiles: ti.template()):
    """Enter a capsule into the samples that its ray-cast image covers."""
    eye, forward = at3(view, EYE), at3(view, FORWARD)
    # What reaches behind the eye is looked for where the rest of it is.
    near_a = in_front(a, b, eye, forward, 2.0 * radius + view[NEAR])
    near_b = in_front(b, a, eye, forward, 2.0 * radius + view[NEAR])
    pa, pb = project(view, near_a), project(view, near_b)
    nearest = ti.min((near_a - eye).dot(forward), (near_b - eye).dot(forward)) - radius
    if nearest > view[NEAR]:
        grow = 1.15 * view[FOCAL] * radius / nearest + 1.0
        x0 = ti.max(ti.floor(ti.min(pa.x, pb.x) - grow, ti.i32), 0)
        y0 = ti.max(ti.floor(ti.min(pa.y, pb.y) - grow, ti.i32), 0)
        x1 = ti.min(ti.floor(ti.max(pa.x, pb.x) + grow, ti.i32), samples.shape[1] - 1)
        y1 = ti.min(ti.floor(ti.max(pa.y, pb.y) + grow, ti.i32), samples.shape[0] - 1)
        if x0 <= x1 and y0 <= y1:
            mark_tiles(tiles, x0, x1, y0, y1, TILE)
            middle = (0.5 * (a + b) - eye).dot(forward)
            axis = vec2(pb.x - pa.x, pb.y - pa.y)
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    cx, cy = ti.cast(x, ti.f32) + 0.5, ti.cast(y, ti.f32) + 0.5
                    if is_near_segment(vec2(cx - pa.x, cy - pa.y), axis, grow):
                        for s in range(4):
                            dx, dy = sample_offset(s)
                            direction = ray(view, cx + dx, cy + dy)
                            # Starting near the capsule keeps f32 exact enough for thin ones.
                            found, t = hit_capsule(eye + direction * middle, direction, a, b, radius)
                            if found == 1:
                                raise_sample(samples, y, x, s, sample_key(1.0 / (middle + t), identity))


@ti.func
def sample_offset(s):
    """Where sample s lies, relative to the pixel's centre [pixels]."""
    dx, dy = ti.static(SAMPLE_X[0]), ti.static(SAMPLE_Y[0])
    for k in ti.static(range(1, 4)):
        if s == k:
            dx, dy = ti.static(SAMPLE_X[k]), ti.static(SAMPLE_Y[k])
    return dx, dy


@ti.func
def cover_light_round(
    a, b, radius, view: ti.template(), shadow_map: ti.template(), shadow_block: ti.template(), tiles: ti.template()
):
    """Enter a capsule into the shadow map; never thinner than the map can hold."""
    scale = view[TEXELS]
    wide = ti.max(radius, 0.75 / scale)
    la, lb = to_light(view, a), to_light(view, b)
    grow = wide * scale
    u0 = ti.max(ti.floor(ti.min(la.x, lb.x) - grow, ti.i32), 0)
    v0 = ti.max(ti.floor(ti.min(la.y, lb.y) - grow, ti.i32), 0)
    u1 = ti.min(ti.floor(ti.max(la.x, lb.x) + grow, ti.i32), shadow_map.shape[1] - 1)
    v1 = ti.min(ti.floor(ti.max(la.y, lb.y) + grow, ti.i32), shadow_map.shape[0] - 1)
    if u0 <= u1 and v0 <= v1:
        mark_shadow(tiles, u0, u1, v0, v1)
        down = -at3(view, LIGHT)
        axis = vec2(lb.x - la.x, lb.y - la.y)
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                du, dv = ti.cast(u, ti.f32) + 0.5 - la.x, ti.cast(v, ti.f32) + 0.5 - la.y
                if is_near_segment(vec2(du, dv), axis, grow + 0.1):
                    origin = a + (at3(view, LIGHT_U) * du + at3(view, LIGHT_V) * dv) / scale
                    found, t = hit_capsule(origin, down, a, b, wide)
                    if found == 1:
                        raise_light(shadow_map, shadow_block, v, u, la.z - t)


@ti.kernel
def draw_rounds(
    can_tear: ti.template(),
    hidden: Ints,
    first: ti.i32,
    start: Points,
    end: Points,
    radius: Floats,
    view: Floats,
    samples: Samples,
    tiles: Ints2,
    shadow_map: Ints2,
    shadow_block: Ints2,
    light_tiles: Ints2,
):
    """Enter every whole capsule and sphere; `hidden` tells of them from `first` on."""
    for i in range(start.shape[0]):
        if is_whole(can_tear, hidden, first + i):
            a, b, r = start[i], end[i], radius[i]
            cover_screen_round(a, b, r, i + ROUND_BIT, view, samples, tiles)
            cover_light_round(a, b, r, view, shadow_map, shadow_block, light_tiles)
