"""What does not move: colliders and background, ray-cast once and kept."""

import taichi as ti

from sandbox.render.colliders import (
    AXES,
    BOX,
    CAPSULE,
    FADE,
    KIND,
    MISS,
    POINT,
    ROW,
    SHAPE,
    SPACING,
    SPHERE,
    TINT,
    WALL,
)
from sandbox.render.light import LIGHT_TILE
from sandbox.render.raster import hit_capsule, identity_of, nearness_of, sample_key, sample_offset
from sandbox.render.shade import corner_weights
from sandbox.render.surface import KEY, ambient_light, background, constant3, smoothstep, solid
from sandbox.render.types import (
    Floats,
    Image2,
    Image3,
    Image4,
    Ints,
    Ints2,
    Points,
    SampleDepths,
    Samples,
    vec2,
    vec3,
    vec4,
)
from sandbox.render.view import (
    BLOCK,
    EYE,
    LIGHT,
    LIGHT_ORIGIN,
    LIGHT_U,
    LIGHT_V,
    MOVING,
    STILL,
    TEXELS,
    TILE,
    TOP,
    at3,
    light_slope,
    ray,
    to_light,
)


@ti.func
def row3(rows: ti.template(), i, start: ti.template()):
    """Three numbers of a collider as a vector."""
    return vec3(rows[i * ROW + start], rows[i * ROW + start + 1], rows[i * ROW + start + 2])


@ti.func
def to_local(rows: ti.template(), i, p):
    """A vector in the axes of a box."""
    return vec3(row3(rows, i, AXES).dot(p), row3(rows, i, AXES + 3).dot(p), row3(rows, i, AXES + 6).dot(p))


@ti.func
def hit_collider(rows: ti.template(), i, origin, direction):
    """Ray parameter of the first hit from outside, MISS without one."""
    kind = ti.cast(rows[i * ROW + KIND], ti.i32)
    point = row3(rows, i, POINT)
    t = MISS
    if kind <= WALL:
        normal = row3(rows, i, SHAPE)
        height, falling = (origin - point).dot(normal), direction.dot(normal)
        if height > 0.0 and falling < -1e-6:
            t = -height / falling
    elif kind == SPHERE:
        offset = origin - point
        a, b = direction.dot(direction), direction.dot(offset)
        # The distance of the centre from the ray, computed without cancellation for far origins.
        nearest = offset - direction * (b / a)
        h = rows[i * ROW + SHAPE] * ti.abs(rows[i * ROW + SHAPE]) - nearest.dot(nearest)
        if h >= 0.0:
            t = -b / a - ti.sqrt(h / a)
    elif kind == CAPSULE:
        end = row3(rows, i, AXES)
        # Starting near the capsule keeps f32 exact enough for thin ones.
        skipped = (0.5 * (point + end) - origin).dot(direction) / direction.dot(direction)
        found, ahead = hit_capsule(origin + direction * skipped, direction, point, end, rows[i * ROW + SHAPE])
        if found == 1:
            t = skipped + ahead
    else:
        half = row3(rows, i, SHAPE)
        o, d = to_local(rows, i, origin - point), to_local(rows, i, direction)
        enter, leave = -MISS, MISS
        for k in ti.static(range(3)):
            slab = d[k]
            if ti.abs(slab) < 1e-9:
                slab = 1e-9
            first, second = (-half[k] - o[k]) / slab, (half[k] - o[k]) / slab
            enter, leave = ti.max(enter, ti.min(first, second)), ti.min(leave, ti.max(first, second))
        if enter <= leave:
            t = enter
    if t <= 0.0:
        t = MISS
    return t


@ti.func
def collider_normal(rows: ti.template(), i, p):
    """Unit normal at a point of a collider's surface."""
    kind = ti.cast(rows[i * ROW + KIND], ti.i32)
    normal = row3(rows, i, SHAPE)
    if kind == SPHERE:
        normal = (p - row3(rows, i, POINT)).normalized()
    elif kind == CAPSULE:
        from_start, axis = p - row3(rows, i, POINT), row3(rows, i, AXES) - row3(rows, i, POINT)
        along = ti.min(ti.max(from_start.dot(axis) / ti.max(axis.dot(axis), 1e-20), 0.0), 1.0)
        normal = (from_start - axis * along).normalized()
    elif kind == BOX:
        half = row3(rows, i, SHAPE)
        local = to_local(rows, i, p - row3(rows, i, POINT))
        best = -MISS
        for k in ti.static(range(3)):
            if ti.abs(local[k]) - half[k] > best:
                best = ti.abs(local[k]) - half[k]
                normal = row3(rows, i, AXES + 3 * k) * ti.math.sign(local[k])
    return normal


@ti.func
def grid_lines(at, wide, spacing, thickness):
    """Coverage of a grid's lines at plane coordinates `at`, filtered over a pixel `wide` [m], in [0, 1]."""
    clear = 1.0
    for k in ti.static(range(2)):
        drawn = ti.max(thickness, wide[k])
        distance = ti.abs(at[k] / spacing - ti.round(at[k] / spacing)) * spacing
        edge = 1.0 - smoothstep(0.5 * drawn - 0.5 * wide[k], 0.5 * drawn + 0.5 * wide[k], distance)
        edge *= thickness / drawn
        # Lines closer than pixels merge into their mean.
        merge = smoothstep(0.25, 0.6, wide[k] / spacing)
        edge = edge * (1.0 - merge) + thickness / spacing * merge
        clear *= 1.0 - edge
    return 1.0 - clear


@ti.func
def plane_tint(rows: ti.template(), i, p, beside, beneath, eye):
    """Colour of a plane with its grid, filtered over the pixel between the rays to the right and below."""
    normal, point = row3(rows, i, SHAPE), row3(rows, i, POINT)
    first, second = row3(rows, i, AXES), row3(rows, i, AXES + 3)
    height = (eye - point).dot(normal)
    right = eye + beside * (height / ti.max(-beside.dot(normal), 1e-6)) - p
    lower = eye + beneath * (height / ti.max(-beneath.dot(normal), 1e-6)) - p
    wide = vec2(
        ti.abs(right.dot(first)) + ti.abs(lower.dot(first)), ti.abs(right.dot(second)) + ti.abs(lower.dot(second))
    )
    at = vec2((p - point).dot(first), (p - point).dot(second))
    spacing = rows[i * ROW + SPACING]
    fine = grid_lines(at, wide, spacing, 0.012 * spacing)
    coarse = grid_lines(at, wide, 5.0 * spacing, 0.03 * spacing)
    return row3(rows, i, TINT) * (1.0 - 0.20 * fine) * (1.0 - 0.28 * coarse)


@ti.func
def first_hits(rows: ti.template(), eye, direction):
    """Index and ray parameter of the nearest opaque collider, then of the nearest wall before it; index -1: none."""
    which, nearest, wall, veiled = -1, MISS, -1, MISS
    for i in range(rows.shape[0] // ROW):
        t = hit_collider(rows, i, eye, direction)
        if ti.cast(rows[i * ROW + KIND], ti.i32) == WALL:
            if t < veiled:
                veiled, wall = t, i
        elif t < nearest:
            nearest, which = t, i
    if veiled >= nearest:
        wall = -1
    return which, nearest, wall, veiled


@ti.func
def look(rows: ti.template(), view: ti.template(), direction, beside, below, which, depth):
    """Ambient and key part (unshadowed) of the light from a collider along a ray, how opaque it is, and its normal."""
    eye = at3(view, EYE)
    unit = direction.normalized()
    p = eye + direction * depth
    kind = ti.cast(rows[which * ROW + KIND], ti.i32)
    normal = collider_normal(rows, which, p)
    tint, opacity = row3(rows, which, TINT), 1.0
    ambient, key = solid(tint, normal, unit, at3(view, LIGHT))
    if kind <= WALL:
        tint = plane_tint(rows, which, p, beside, below, eye)
        extent = rows[which * ROW + FADE]
        # Ground fades into the horizon; walls, translucent, fade around their point.
        opacity = 1.0 - smoothstep(2.0, 14.0, (p - eye).norm() / extent)
        if kind == WALL:
            opacity = 0.35 * (1.0 - smoothstep(0.8, 2.5, (p - row3(rows, which, POINT)).norm() / extent))
        ambient = tint * ambient_light(normal)
        key = tint * constant3(KEY) * ti.max(normal.dot(at3(view, LIGHT)), 0.0)
    return ambient, key, opacity, normal


@ti.kernel
def cast_static_shadow(rows: Floats, view: Floats, still_map: Ints2, still_block: Ints2, light_tiles: Ints2):
    """Fill the shadow map with what does not move; planes cast nothing."""
    for v, u in ti.ndrange(still_map.shape[0], still_map.shape[1]):
        scale = 1.0 / view[TEXELS]
        across = at3(view, LIGHT_U) * ((ti.cast(u, ti.f32) + 0.5) * scale)
        along = at3(view, LIGHT_V) * ((ti.cast(v, ti.f32) + 0.5) * scale)
        origin = at3(view, LIGHT_ORIGIN) + across + along + at3(view, LIGHT) * view[TOP]
        # Meshes may be there already.
        height = ti.bit_cast(still_map[v, u], ti.f32)
        for i in range(rows.shape[0] // ROW):
            if ti.cast(rows[i * ROW + KIND], ti.i32) >= SPHERE:
                height = ti.max(height, view[TOP] - ti.min(hit_collider(rows, i, origin, -at3(view, LIGHT)), view[TOP]))
        if height > 0.0:
            bits = ti.bit_cast(height, ti.i32)
            still_map[v, u] = bits
            ti.atomic_max(still_block[v // BLOCK, u // BLOCK], bits)
            tv, tu = v // LIGHT_TILE, u // LIGHT_TILE
            for nv in range(ti.max(tv - 1, 0), ti.min(tv + 2, light_tiles.shape[0])):
                for nu in range(ti.max(tu - 1, 0), ti.min(tu + 2, light_tiles.shape[1])):
                    if light_tiles[nv, nu] == 0:
                        light_tiles[nv, nu] = STILL


@ti.kernel
def settle_shadow(light_tiles: Ints2):
    """Take what was entered into the shadow map so far for what does not move."""
    for v, u in ti.ndrange(light_tiles.shape[0], light_tiles.shape[1]):
        if light_tiles[v, u] & MOVING != 0:
            light_tiles[v, u] = STILL


@ti.func
def mesh_look(
    view: ti.template(), corners: ti.template(), normals: ti.template(), owner: ti.template(), tints: ti.template(),
    direction, t, x, y,
):  # fmt: skip
    """Ambient and key part (unshadowed) of the light from triangle t of a mesh at rest, and its normal."""
    w = corner_weights(corners[3 * t], corners[3 * t + 1], corners[3 * t + 2], x, y)
    normal = (normals[3 * t] * w.x + normals[3 * t + 1] * w.y + normals[3 * t + 2] * w.z).normalized(1e-12)
    ambient, key = solid(at3(tints, 3 * owner[t]), normal, direction.normalized(), at3(view, LIGHT))
    return ambient, key, normal


@ti.func
def first_seen(has_meshes: ti.template(), rows: ti.template(), eye, direction, entered):
    """As `first_hits`, but a mesh's triangle, counted after the colliders, where it was entered before them."""
    which, depth, wall, veiled = first_hits(rows, eye, direction)
    if ti.static(has_meshes):
        if identity_of(entered) > 0 and nearness_of(entered) * depth > 1.0:
            which, depth = rows.shape[0] // ROW + identity_of(entered) - 1, 1.0 / nearness_of(entered)
            if veiled >= depth:
                wall = -1
    return which, depth, wall, veiled


@ti.func
def seen_light(
    has_meshes: ti.template(), rows: ti.template(), mesh_corners: ti.template(), mesh_normals: ti.template(),
    mesh_owner: ti.template(), mesh_tints: ti.template(), view: ti.template(), direction, which, depth, wall, veiled,
    x, y,
):  # fmt: skip
    """Ambient and key part (unshadowed) of what `first_seen` found along the ray through (x, y), and its normal."""
    row_count = ti.cast(rows.shape[0] // ROW, ti.i32)
    one, two, normal = background(direction.normalized()), vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0)
    if ti.static(has_meshes):
        if which >= row_count:
            ma, mk, mn = mesh_look(
                view, mesh_corners, mesh_normals, mesh_owner, mesh_tints, direction, which - row_count, x, y
            )
            one, two, normal = ma, mk, mn
    beside, below = ray(view, x + 1.0, y), ray(view, x, y + 1.0)
    for layer in range(2):
        seen, t = which, depth
        if layer == 1:
            seen, t = wall, veiled
        if seen >= 0 and seen < row_count:
            a, k, opacity, n = look(rows, view, direction, beside, below, seen, t)
            one = one * (1.0 - opacity) + a * opacity
            two = two * (1.0 - opacity) + k * opacity
            if layer == 1:
                # The light on a wall is not shadowed: what casts onto it lies behind its veil.
                one, two = one + k * opacity, two - k * opacity
            else:
                normal = n
    return one, two, normal


@ti.kernel
def cast_static_picture(
    has_meshes: ti.template(),
    rows: Floats,
    mesh_corners: Points,
    mesh_normals: Points,
    mesh_owner: Ints,
    mesh_tints: Floats,
    view: Floats,
    shadow_width: ti.f32,
    shadow_height: ti.f32,
    samples: Samples,
    depths: SampleDepths,
    ambient: Image3,
    key: Image3,
    place: Image3,
    slope: Image2,
    tile_reach: Image4,
):
    """The picture without bodies, a pixel at a time: shaded once where its samples agree.

    Meshes have been entered into `samples` before, which then hold only depths.
    """
    for ty, tx in ti.ndrange(tile_reach.shape[0], tile_reach.shape[1]):
        eye = at3(view, EYE)
        reach = vec4(1e9, 1e9, -1e9, -1e9)
        for y in range(ty * TILE, ti.min((ty + 1) * TILE, ambient.shape[0])):
            for x in range(tx * TILE, ti.min((tx + 1) * TILE, ambient.shape[1])):
                color, light = vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0)
                p, normal = vec3(0.0, 0.0, 0.0), at3(view, LIGHT)
                one, two, before, wall_before = vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0), -2, -2
                for s in range(4):
                    dx, dy = sample_offset(s)
                    px, py = ti.cast(x, ti.f32) + 0.5 + dx, ti.cast(y, ti.f32) + 0.5 + dy
                    direction = ray(view, px, py)
                    which, depth, wall, veiled = first_seen(has_meshes, rows, eye, direction, samples[y, x, s])
                    depths[y, x, s] = 1.0 / depth
                    samples[y, x, s] = sample_key(1.0 / depth, 0)
                    if which != before or wall != wall_before:
                        before, wall_before = which, wall
                        one, two, n = seen_light(
                            has_meshes, rows, mesh_corners, mesh_normals, mesh_owner, mesh_tints, view, direction,
                            which, depth, wall, veiled, px, py,
                        )  # fmt: skip
                        if which >= 0:
                            p, normal = eye + direction * depth, n
                        if which >= rows.shape[0] // ROW:
                            # Shadow maps are coarse: from a texel above, a curved surface does not shade itself.
                            p += n * (1.0 / view[TEXELS])
                    color += one
                    light += two
                at, tilt = to_light(view, p), light_slope(view, normal)
                ambient[y, x], key[y, x] = color * 0.25, light * 0.25
                place[y, x], slope[y, x] = at, vec2(tilt.x, tilt.y)
                # Nothing is shaded outside of the map.
                inside = ti.min(at.x, at.y) > 0.0 and at.x < shadow_width and at.y < shadow_height
                if light.x > 0.0 and inside:
                    reach = vec4(
                        ti.min(reach[0], at.x), ti.min(reach[1], at.y), ti.max(reach[2], at.x), ti.max(reach[3], at.y)
                    )
        tile_reach[ty, tx] = reach
