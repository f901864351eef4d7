"""How much of every cell of a grid lies inside a closed mesh."""

import itertools

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.lattice import FloatArray, IntArray

_CHUNK = 2_000_000  # pairs of a triangle and a ray looked at in one go
_TRIES = 4
# Rays beside the places that were asked for, by fractions of the distance between rays that make it all but
# impossible to meet an edge of a mesh made of round numbers.
_ASIDE = np.array([3.1e-5, -2.3e-5]) * np.sqrt([2.0, 3.0])


def inside_fraction(
    vertices: FloatArray, triangles: IntArray, low: FloatArray, spacing: float, cells: tuple[int, ...]
) -> FloatArray:
    """Fraction of each cell inside the closed mesh, from 2 x 2 x 2 samples [1], shape ``cells``.

    ``low`` is the grid's lower corner [m], ``spacing`` the edge length of its cells [m].
    """
    # Rays along the longest side are the fewest.
    axis = int(np.argmax(cells))
    order = [axis, (axis + 1) % 3, (axis + 2) % 3]
    turned = (vertices[:, order] - low[order]) / spacing
    shape = tuple(cells[k] for k in order)
    filled = np.zeros(shape)
    for shift in itertools.product((0.25, 0.75), repeat=2):
        winding = _winding_along_rays(turned, triangles, shape, np.asarray(shift))
        inside = (winding > 0).reshape(shape[1], shape[2], shape[0], 2)
        filled += inside.mean(axis=3).transpose(2, 0, 1) / 4.0
    return np.asarray(filled.transpose(np.argsort(order)))


def _winding_along_rays(
    vertices: FloatArray, triangles: IntArray, shape: tuple[int, ...], shift: FloatArray
) -> NDArray[np.int32]:
    """Winding number at 2 samples a cell along x, for rays at ``shift`` in every cell of y and z.

    Lengths are in cells. Shape (shape[1] * shape[2], 2 * shape[0]). A ray that passes through an edge may count a
    crossing twice or never; then its crossings do not cancel, and it is shot again a little aside.
    """
    samples = 2 * shape[0]
    winding = np.zeros((shape[1] * shape[2], samples), dtype=np.int32)
    open_rays = np.ones(len(winding), dtype=bool)
    for attempt in range(_TRIES):
        ray, height, sign = _crossings(vertices, triangles, shape, shift + (attempt + 1) * _ASIDE)
        wanted = open_rays[ray]
        ray, height, sign = ray[wanted], height[wanted], sign[wanted]
        # The crossing counts for all samples below it; sample s lies at (s + 1/2) / 2.
        below = np.clip(np.ceil(2.0 * height - 0.5), 0, samples).astype(np.int64)
        steps = np.bincount(ray * (samples + 1) + below, sign, minlength=len(winding) * (samples + 1))
        steps = steps.reshape(len(winding), samples + 1)
        total = steps[:, ::-1].cumsum(axis=1)[:, ::-1]
        winding[open_rays] = total[open_rays, 1:]
        open_rays = total[:, 0] != 0
        if not open_rays.any():
            break
    return winding


def _crossings(
    vertices: FloatArray, triangles: IntArray, shape: tuple[int, ...], shift: FloatArray
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Where rays along x leave (+1) or enter (-1) the mesh: number of the ray, x, sign."""
    corners = vertices[triangles]
    flat = corners[:, :, 1:] - shift
    first = np.clip(np.ceil(flat.min(axis=1)), 0, None).astype(np.int64)
    last = np.minimum(np.floor(flat.max(axis=1)), np.asarray(shape[1:]) - 1.0).astype(np.int64)
    span = np.maximum(last - first + 1, 0)
    pairs = span.prod(axis=1)
    found = []
    chunk = np.cumsum(pairs) // _CHUNK
    for number in np.unique(chunk):
        rows = np.nonzero((chunk == number) & (pairs > 0))[0]
        triangle = np.repeat(rows, pairs[rows])
        local = np.arange(len(triangle)) - np.repeat(np.cumsum(pairs[rows]) - pairs[rows], pairs[rows])
        y = first[triangle, 0] + local // span[triangle, 1]
        z = first[triangle, 1] + local % span[triangle, 1]
        inside, x, sign = _hits(corners[triangle, :, 0], flat[triangle], np.stack([y, z], axis=1))
        found.append((y[inside] * shape[2] + z[inside], x[inside], sign[inside]))
    if not found:
        return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
    ray, x, sign = (np.concatenate(part) for part in zip(*found, strict=True))
    return ray, x, sign


def _hits(
    heights: FloatArray, flat: FloatArray, points: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    """Whether each point of the y-z plane lies in its triangle, at which x, and the sign of the normal along x."""
    ends = flat - points[:, None, :]
    following = np.roll(ends, -1, axis=1)
    # Twice the areas of the triangles made of the point and each side: barycentric, once divided by their sum.
    parts = ends[:, :, 0] * following[:, :, 1] - ends[:, :, 1] * following[:, :, 0]
    total = parts.sum(axis=1)
    inside = ((parts > 0.0).all(axis=1) & (total > 0.0)) | ((parts < 0.0).all(axis=1) & (total < 0.0))
    # The side from corner k to k + 1 weighs the corner opposite, k + 2.
    weighted = (parts * np.roll(heights, -2, axis=1)).sum(axis=1)
    x = np.divide(weighted, total, out=np.zeros_like(total), where=inside)
    return inside, x, np.sign(total)
