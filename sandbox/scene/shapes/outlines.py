"""Closed outlines in the plane: are they sound, what is inside, how far away."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.lattice import FloatArray
from sandbox.scene.model.base import LARGEST

_SAME = 1e-9  # of the outline's size: closer than this is touching
_CHUNK = 1_000_000  # pairs of edges looked at in one go


def check_outline(points: Sequence[Sequence[float]], holes: Sequence[Sequence[Sequence[float]]]) -> list[FloatArray]:
    """The outline counter-clockwise and its holes clockwise [m], each of shape (n, 2); repeated corners are gone.

    Either may be given in either direction. Raises SceneError where an outline has no area, touches itself or
    another, or a hole lies outside or in another hole.
    """
    given = [np.asarray(loop, dtype=float) for loop in (points, *holes)]
    names = ["points", *(f"holes[{row}]" for row in range(len(holes)))]
    if max(np.abs(loop).max() for loop in given) > LARGEST:
        raise SceneError(f"points: the outline is too large to compute with (above {LARGEST:g})")
    size = float(np.ptp(np.concatenate(given), axis=0).max())
    loops = [_distinct(loop, size) for loop in given]
    for name, loop in zip(names, loops, strict=True):
        # The smallest singular value is the size across the line that fits best.
        if len(loop) < 3 or np.linalg.svd(loop - loop.mean(axis=0), compute_uv=False)[-1] <= _SAME * size:
            raise SceneError(f"{name}: the outline has no area")
    _check_touching(loops, names, size)
    for row, hole in enumerate(loops[1:]):
        if not inside(hole[:1], loops[:1])[0]:
            raise SceneError(f"holes[{row}]: lies outside the outline")
        for other in range(len(holes)):
            if other != row and inside(hole[:1], [loops[1 + other]])[0]:
                raise SceneError(f"holes[{row}]: lies inside holes[{other}]")
    return [_turned(loop, 1.0 if row == 0 else -1.0) for row, loop in enumerate(loops)]


def loop_area(loop: FloatArray) -> float:
    """Signed area of a loop [m^2], positive counter-clockwise (shoelace formula)."""
    # Seen from a corner, so that a loop far from the origin keeps its digits.
    x, y = (loop - loop[0]).T
    return float(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def inside(points: FloatArray, loops: Sequence[FloatArray]) -> NDArray[np.bool_]:
    """Which points lie inside an odd number of loops, shape (N,). Even-odd ray casting along +x."""
    order = np.argsort(points[:, 1], kind="stable")
    x, y = points[order].T
    odd = np.zeros(len(points), dtype=bool)
    for loop in loops:
        for (xa, ya), (xb, yb) in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            # Half-open in y: a ray through a corner meets one of its two edges, or both or none.
            low, high = np.searchsorted(y, (min(ya, yb), max(ya, yb)))
            if low < high:
                crossing = xa + (y[low:high] - ya) * ((xb - xa) / (yb - ya))
                odd[low:high] ^= x[low:high] < crossing
    result = np.empty_like(odd)
    result[order] = odd
    return result


def _distinct(loop: FloatArray, size: float) -> FloatArray:
    """The loop without corners that repeat the one before; the first may be repeated at the end."""
    step = np.linalg.norm(loop - np.roll(loop, 1, axis=0), axis=1)
    return np.asarray(loop[step > _SAME * size])


def _turned(loop: FloatArray, direction: float) -> FloatArray:
    # The first corner stays the first.
    return loop if loop_area(loop) * direction > 0.0 else np.roll(loop[::-1], 1, axis=0)


def _check_touching(loops: list[FloatArray], names: list[str], size: float) -> None:
    """Raises SceneError where two edges meet that are not neighbours, or neighbours that turn straight back."""
    start = np.concatenate(loops)
    end = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    owner = np.repeat(np.arange(len(loops)), [len(loop) for loop in loops])
    number = np.concatenate([np.arange(len(loop)) for loop in loops])
    following = np.concatenate(
        [np.roll(np.nonzero(owner == row)[0], -1) for row in range(len(loops))]
    )  # edge that begins where each ends
    ahead = end - start
    turn = _cross(ahead, ahead[following])
    length = np.linalg.norm(ahead, axis=1)
    back = (np.abs(turn) <= _SAME * size * length) & ((ahead * ahead[following]).sum(axis=1) < 0.0)
    if back.any():
        edge = int(np.argmax(back))
        corner = tuple(float(c) for c in end[edge])
        raise SceneError(f"{names[owner[edge]]}: the outline turns straight back at {corner}")
    rows = max(1, _CHUNK // len(start))
    for first in range(0, len(start), rows):
        block = np.arange(first, min(first + rows, len(start)))
        others = np.arange(len(start))
        meets = _meet(start[block], end[block], start, end, _SAME * size)
        meets &= others[None] > block[:, None]
        meets &= (following[block][:, None] != others[None]) & (following[None] != block[:, None])
        if meets.any():
            row, other = np.argwhere(meets)[0]
            a, b = int(block[row]), int(other)
            what = "itself" if owner[a] == owner[b] else names[owner[b]]
            raise SceneError(f"{names[owner[a]]}: the outline meets {what} (edges {number[a]} and {number[b]})")


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, near: float) -> NDArray[np.bool_]:
    """Whether edges a-b, (M, 2), cross edges c-d, (N, 2), or come within ``near`` [m] of them, (M, N)."""
    a, b, c, d = a[:, None], b[:, None], c[None], d[None]
    # On which side of the other edge each end lies.
    of_c, of_d = _cross(b - a, c - a), _cross(b - a, d - a)
    of_a, of_b = _cross(d - c, a - c), _cross(d - c, b - c)
    crossing = (of_c * of_d < 0.0) & (of_a * of_b < 0.0)
    touching = _distance(a, c, d) <= near
    for end, p, q in ((b, c, d), (c, a, b), (d, a, b)):
        touching |= _distance(end, p, q) <= near
    return np.asarray(crossing | touching)


def _distance(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance of points from edges a-b [m], broadcast."""
    edge = b - a
    along = np.clip(((point - a) * edge).sum(axis=-1) / (edge**2).sum(axis=-1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(point - a - along[..., None] * edge, axis=-1))
