"""Soft shadows: how much of the light a point sees, from the shadow map."""

import math

import taichi as ti

from sandbox.render.light import LIGHT_TILE
from sandbox.render.types import vec2
from sandbox.render.view import BLOCK, CELL, FADE, TEXELS

LIGHT_SPREAD = 0.09
"""Tangent of the angle under which the light's radius is seen: how fast shadows soften with distance."""
WIDEST = 26.0
"""Largest radius of the penumbra's filter [texels]."""
NARROWEST = 1.5
NARROW = 4.0
"""Radius of the filter up to which nothing fits between the taps of its rim [texels]."""
SEARCH_TAPS = 16
TAPS = 40


def _disk(count: int, reach: float) -> list[tuple[float, float]]:
    """Points spread evenly over a disk of radius `reach` by the golden angle."""
    golden = math.pi * (3.0 - math.sqrt(5.0))
    points = [(reach * math.sqrt((k + 0.5) / count), k * golden) for k in range(count)]
    return [(r * math.cos(angle), r * math.sin(angle)) for r, angle in points]


RIM_TAPS = 8
RIM = [(0.94 * math.cos(k * math.pi / 4), 0.94 * math.sin(k * math.pi / 4)) for k in range(RIM_TAPS)]
"""The taps that come first: penumbrae show in them, and pay for all taps."""
# Scattered over an eighth of a turn, after which the rim repeats.
TURNS = [((7 * k) % 16 + 0.5) / 16 * math.pi / 4 for k in range(16)]
_INSIDE = _disk(TAPS - len(RIM), 0.84)
SPARSE = len(RIM) + len(_INSIDE[::3])
"""Number of taps that are already spread over the whole disk."""
TABLE = _disk(SEARCH_TAPS, 1.0) + RIM + _INSIDE[::3] + _INSIDE[1::3] + _INSIDE[2::3]
TABLE += [(math.cos(a), math.sin(a)) for a in TURNS]
"""Taps of the search, taps of the filter, and cosine and sine of the turns."""


@ti.func
def height_at(heights: ti.template(), v, u):
    """Height of the caster nearest to the light in a cell [m]; far below everything outside of the map."""
    height = -1e30
    if v >= 0 and u >= 0 and v < heights.shape[0] and u < heights.shape[1]:
        height = ti.bit_cast(heights[v, u], ti.f32)
    return height


@ti.func
def blocker_height(shadow_block: ti.template(), at, slope, texel, disk: ti.template()):
    """Number and mean height of casters in the widest penumbra around a point; conservative by blocks."""
    count, total = 0, 0.0
    # A block keeps its highest caster, so a tilted surface would shade itself without this allowance.
    allowance = BLOCK * (ti.abs(slope.x) + ti.abs(slope.y)) + 1.5 * texel
    for k in range(SEARCH_TAPS):
        du, dv = disk[2 * k] * WIDEST, disk[2 * k + 1] * WIDEST
        height = height_at(shadow_block, ti.floor((at.y + dv) / BLOCK, ti.i32), ti.floor((at.x + du) / BLOCK, ti.i32))
        if height > at.z + slope.x * du + slope.y * dv + allowance:
            count += 1
            total += height
    return count, total / ti.cast(ti.max(count, 1), ti.f32)


@ti.func
def lit_tap(shadow_map: ti.template(), u, v, w):
    """Part of the four texels around (u, v) that do not cast on height w, by bilinear weights; all outside the map."""
    u0, v0 = ti.floor(u - 0.5, ti.i32), ti.floor(v - 0.5, ti.i32)
    lit = 1.0
    if u0 >= 0 and v0 >= 0 and u0 + 1 < shadow_map.shape[1] and v0 + 1 < shadow_map.shape[0]:
        # Heights are positive: their bits compare like the heights themselves, and select beats branching.
        bits = ti.bit_cast(ti.max(w, 0.0), ti.i32)
        fu, fv = u - 0.5 - ti.cast(u0, ti.f32), v - 0.5 - ti.cast(v0, ti.f32)
        low = ti.select(shadow_map[v0, u0] <= bits, 1.0 - fu, 0.0) + ti.select(shadow_map[v0, u0 + 1] <= bits, fu, 0.0)
        v1 = v0 + 1
        high = ti.select(shadow_map[v1, u0] <= bits, 1.0 - fu, 0.0) + ti.select(shadow_map[v1, u0 + 1] <= bits, fu, 0.0)
        lit = low + (high - low) * fv
    return lit


@ti.func
def turn_at(disk: ti.template(), x, y):
    """Cosine and sine by which a pixel turns its taps: neighbours differ, so that bands dissolve into fine grain."""
    k = 2 * (SEARCH_TAPS + TAPS + (x % 4) * 4 + ((y * 2 + x // 4) % 4))
    return vec2(disk[k], disk[k + 1])


@ti.func
def is_uniform(shadow_cells: ti.template(), at, slope, bias, radius, lit):
    """True where the cells around a point prove that within `radius` [texels] all casts on it, or nothing if `lit`."""
    rows, columns = ti.cast(shadow_cells.shape[0], ti.i32), ti.cast(shadow_cells.shape[1], ti.i32)
    u0, u1 = ti.floor((at.x - radius - 1.0) / CELL, ti.i32), ti.floor((at.x + radius + 1.0) / CELL, ti.i32)
    v0, v1 = ti.floor((at.y - radius - 1.0) / CELL, ti.i32), ti.floor((at.y + radius + 1.0) / CELL, ti.i32)
    # Nothing casts outside of the map.
    sure = lit or (u0 >= 0 and v0 >= 0 and u1 < columns and v1 < rows)
    # The surface itself may be in the map: in a cell it rises this much above its height in the middle.
    rise = bias + 0.5 * CELL * (ti.abs(slope.x) + ti.abs(slope.y))
    for v in range(ti.max(v0, 0), ti.min(v1, rows - 1) + 1):
        for u in range(ti.max(u0, 0), ti.min(u1, columns - 1) + 1):
            du, dv = (ti.cast(u, ti.f32) + 0.5) * CELL - at.x, (ti.cast(v, ti.f32) + 0.5) * CELL - at.y
            bits = ti.bit_cast(ti.max(at.z + slope.x * du + slope.y * dv + rise, 0.0), ti.i32)
            if not ti.select(lit, shadow_cells[v, u, 1] <= bits, shadow_cells[v, u, 0] > bits):
                sure = False
                break
        if not sure:
            break
    return sure


@ti.func
def from_edge(shadow_map: ti.template(), at, fade):
    """0 at the edges of the map and outside, 1 from `fade` inside of them on [texels]."""
    u, v = ti.min(at.x, shadow_map.shape[1] - at.x), ti.min(at.y, shadow_map.shape[0] - at.y)
    return ti.min(ti.max(ti.min(u, v) / fade, 0.0), 1.0)


@ti.func
def visibility(
    shadow_map: ti.template(), shadow_block: ti.template(), shadow_cells: ti.template(), view: ti.template(),
    disk: ti.template(), turn, at, slope,
):  # fmt: skip
    """Part of the key light that reaches the point of light coordinates `at`, in [0, 1]; `turn` turns the taps.

    `slope` is the change of height over a texel along u and v on the receiving surface: every tap is compared with
    the surface's own plane, which keeps wide filters from shading the surface itself.
    """
    texel = 1.0 / view[TEXELS]
    lit = 1.0
    count, mean = blocker_height(shadow_block, at, slope, texel, disk)
    if count > 0:
        distance = ti.max(mean - at.z, 0.0)
        radius = ti.min(ti.max(distance * LIGHT_SPREAD * view[TEXELS], NARROWEST), WIDEST)
        bias = 0.75 * texel + 0.5 * (ti.abs(slope.x) + ti.abs(slope.y))
        total, taken, last = 0.0, 0, RIM_TAPS
        while taken < last:
            tu = disk[2 * (SEARCH_TAPS + taken)] * radius
            tv = disk[2 * (SEARCH_TAPS + taken) + 1] * radius
            du, dv = tu * turn.x - tv * turn.y, tu * turn.y + tv * turn.x
            total += lit_tap(shadow_map, at.x + du, at.y + dv, at.z + slope.x * du + slope.y * dv + bias)
            taken += 1
            if taken == last and last < TAPS:
                if total > 0.0 and total < ti.cast(taken, ti.f32) - 1e-3:
                    last = TAPS
                elif last == RIM_TAPS and radius > NARROW:
                    # Thin casters, or gaps between them, may be where the rim has no taps.
                    if not is_uniform(shadow_cells, at, slope, bias, radius, total > 0.0):
                        last = SPARSE
        # Toward the map's edge shadows fade out: what is beyond it is not shaded.
        lit = 1.0 - (1.0 - total / ti.cast(taken, ti.f32)) * from_edge(shadow_map, at, view[FADE])
    return lit


@ti.func
def is_shadow_near(light_tiles: ti.template(), at):
    """True where something casts within the widest penumbra of a point."""
    u, v = ti.floor(at.x / LIGHT_TILE, ti.i32), ti.floor(at.y / LIGHT_TILE, ti.i32)
    found = 0
    if u >= 0 and v >= 0 and v < light_tiles.shape[0] and u < light_tiles.shape[1]:
        found = light_tiles[v, u]
    return found != 0
