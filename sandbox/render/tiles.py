"""Kernels around a frame: which tiles of the picture may have changed, and the shadow map put back."""

import taichi as ti

from sandbox.render.light import LIGHT_TILE
from sandbox.render.types import Image4, Ints, Ints2, Keys
from sandbox.render.view import BLOCK, CELL, MOVING, STILL


@ti.func
def is_shadow_possible(light_tiles: ti.template(), reach):
    """True where a rectangle (u0, v0, u1, v1) of the shadow map meets a tile that something moving may shade."""
    found = 0
    if reach[0] <= reach[2]:
        last_u, last_v = ti.cast(light_tiles.shape[1], ti.i32) - 1, ti.cast(light_tiles.shape[0], ti.i32) - 1
        u0, v0 = ti.floor(reach[0] / LIGHT_TILE, ti.i32), ti.floor(reach[1] / LIGHT_TILE, ti.i32)
        u1, v1 = ti.floor(reach[2] / LIGHT_TILE, ti.i32), ti.floor(reach[3] / LIGHT_TILE, ti.i32)
        u0, v0, u1, v1 = ti.max(u0, 0), ti.max(v0, 0), ti.min(u1, last_u), ti.min(v1, last_v)
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                found |= light_tiles[v, u] & MOVING
    return found


@ti.kernel
def choose_tiles(tiles: Ints2, tiles_before: Ints2, tile_list: Ints, tile_reach: Image4, light_tiles: Ints2):
    """List the tiles that something moving covers or may shade, now or in the frame before; entry 0 is their number."""
    ti.loop_config(serialize=True)
    for k in range(1):
        count = 0
        for ty in range(tiles.shape[0]):
            for tx in range(tiles.shape[1]):
                changed = tiles[ty, tx]
                if changed == 0:
                    changed = is_shadow_possible(light_tiles, tile_reach[ty, tx])
                if changed != 0 or tiles_before[ty, tx] != 0:
                    count += 1
                    tile_list[count] = ty * tiles.shape[1] + tx
                tiles_before[ty, tx] = changed
                tiles[ty, tx] = 0
        tile_list[k] = count


@ti.func
def bound_cell(shadow_map: ti.template(), shadow_cells: ti.template(), cv, cu):
    """Write down the lowest and the highest height in a cell, as bits; 0 where nothing casts."""
    low, high = shadow_map[cv * CELL, cu * CELL], 0
    for v in range(cv * CELL, (cv + 1) * CELL):
        for u in range(cu * CELL, (cu + 1) * CELL):
            bits = shadow_map[v, u]
            low, high = ti.min(low, bits), ti.max(high, bits)
    shadow_cells[cv, cu, 0] = low
    shadow_cells[cv, cu, 1] = high


@ti.kernel
def bound_shadow(mark: ti.i32, shadow_map: Ints2, shadow_cells: Keys, light_tiles: Ints2):
    """Bring the cells up to date in all tiles that bear the mark."""
    side = ti.static(LIGHT_TILE // CELL)
    for tv, tu in ti.ndrange(light_tiles.shape[0], light_tiles.shape[1]):
        if light_tiles[tv, tu] & mark != 0:
            for cv in range(tv * side, (tv + 1) * side):
                for cu in range(tu * side, (tu + 1) * side):
                    bound_cell(shadow_map, shadow_cells, cv, cu)


@ti.kernel
def restore_shadow_map(
    still_map: Ints2,
    still_block: Ints2,
    still_cells: Keys,
    shadow_map: Ints2,
    shadow_block: Ints2,
    shadow_cells: Keys,
    light_tiles: Ints2,
):
    """Put back what does not move wherever something moving was entered."""
    for tv, tu in ti.ndrange(light_tiles.shape[0], light_tiles.shape[1]):
        if light_tiles[tv, tu] & MOVING != 0:
            light_tiles[tv, tu] &= STILL
            for v in range(tv * LIGHT_TILE, (tv + 1) * LIGHT_TILE):
                for u in range(tu * LIGHT_TILE, (tu + 1) * LIGHT_TILE):
                    shadow_map[v, u] = still_map[v, u]
            side = ti.static(LIGHT_TILE // BLOCK)
            for v in range(tv * side, (tv + 1) * side):
                for u in range(tu * side, (tu + 1) * side):
                    shadow_block[v, u] = still_block[v, u]
            wide = ti.static(LIGHT_TILE // CELL)
            for v in range(tv * wide, (tv + 1) * wide):
                for u in range(tu * wide, (tu + 1) * wide):
                    for k in ti.static(range(2)):
                        shadow_cells[v, u, k] = still_cells[v, u, k]
