"""2D bodies of any outline: points inside at even distances, joined to triangles."""

import numpy as np

from sandbox.errors import SceneError
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.model import MOST_PARTICLES, Polygon
from sandbox.scene.shapes.geometry import Geometry, generate, lengths
from sandbox.scene.shapes.outlines import check_outline, inside, loop_area
from sandbox.scene.shapes.triangles import (
    counter_clockwise,
    find_edges,
    mass_shares,
    membrane_springs,
    open_edges,
    signed_areas,
)
from sandbox.scene.topology import pair_keys

MOST_POLYGON_POINTS = 2_000_000
"""Most particles of a polygon: triangles of more take minutes."""
_CLEARANCE = 0.65  # of the spacing: nearer to the outline, triangles there would be flat
_SMOOTHING_PASSES = 4
_REFINEMENTS = 12
_MANY, _JITTER = 4000, 1e-7
"""Points from which on Qhull gets them off their places, and by how much of the spacing: the equal circles of a grid
take it time with the square of their number where it is long and thin."""
_FLAT = 1e-9  # area over spacing^2 of what rounding leaves of a triangle between three points of a straight edge


@generate.register
def _polygon(shape: Polygon, dimension: int) -> Geometry:
    loops = check_outline(shape.points, shape.holes)
    area = sum(loop_area(loop) for loop in loops)
    cell = 0.5 * 3.0**0.5 * shape.spacing**2
    expected = area / cell + _boundary_length(loops) / shape.spacing
    if expected > MOST_POLYGON_POINTS:
        raise SceneError(f"spacing: makes {expected:.3g} particles, at most {MOST_POLYGON_POINTS:.3g} are taken")
    if (grid := float(np.ptp(loops[0], axis=0).prod()) / cell) > MOST_PARTICLES:
        raise SceneError(f"spacing: makes a grid of {grid:.3g} points, at most {MOST_PARTICLES:.3g} are taken")
    points, triangles, outline = fill(loops, shape.spacing)
    springs = membrane_springs(points, triangles, thickness=1.0)
    areas = signed_areas(points, triangles)
    return Geometry(
        points=points,
        springs=springs.springs,
        rest_lengths=lengths(points, springs.springs),
        spring_scale=springs.scale,
        mass_share=mass_shares(len(points), triangles, areas),
        volume=float(areas.sum()),
        triangles=triangles,
        outline=outline,
    )


def fill(loops: list[FloatArray], spacing: float) -> tuple[FloatArray, IntArray, IntArray]:
    """Points [m], (N, 2), counter-clockwise triangles, (T, 3), and outline edges, (E, 2), of a checked outline.

    The outline's points come first, loop by loop. Raises SceneError where no triangles keep to the outline.
    """
    boundary = [_sampled(loop, spacing) for loop in loops]
    for _ in range(_REFINEMENTS):
        edges = _loop_edges(boundary)
        rim = np.concatenate(boundary)
        points = np.concatenate([rim, _hexagonal(rim, edges, loops, spacing)])
        triangles = _triangles(points, loops, spacing)
        if not len(_missing(edges, triangles)):
            return *_smooth(points, triangles, edges, loops, spacing), edges
        # Edges that other points are too close to: in halves they hold out. What the check of open edges
        # finds missing without any such edge is a crack, which shorter edges close too.
        boundary = _refined(boundary, edges, _missing(edges, triangles))
    raise SceneError("points: no triangles keep to the outline (a corner too sharp?); take another spacing")


def _boundary_length(loops: list[FloatArray]) -> float:
    return float(sum(np.linalg.norm(loop - np.roll(loop, 1, axis=0), axis=1).sum() for loop in loops))


def _sampled(loop: FloatArray, spacing: float) -> FloatArray:
    """The corners of a loop, and points between them at about the spacing."""
    following = np.roll(loop, -1, axis=0)
    parts = np.maximum(np.round(np.linalg.norm(following - loop, axis=1) / spacing), 1).astype(int)
    start, step = np.repeat(loop, parts, axis=0), np.repeat((following - loop) / parts[:, None], parts, axis=0)
    within = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.asarray(start + within[:, None] * step)


def _loop_edges(boundary: list[FloatArray]) -> IntArray:
    first = np.cumsum([0] + [len(loop) for loop in boundary])
    edges = [
        np.stack([begin + np.arange(len(loop)), begin + np.roll(np.arange(len(loop)), -1)], axis=1)
        for begin, loop in zip(first, boundary, strict=False)
    ]
    return np.concatenate(edges).astype(np.int32)


def _hexagonal(rim: FloatArray, edges: IntArray, loops: list[FloatArray], spacing: float) -> FloatArray:
    """Points of equilateral triangles inside the loops, clear of the outline, shape (M, 2)."""
    from scipy.spatial import cKDTree

    low, high = loops[0].min(axis=0), loops[0].max(axis=0)
    rise = 0.5 * 3.0**0.5 * spacing
    columns, rows = np.ceil((high - low) / (spacing, rise)).astype(int) + 1
    row, column = np.indices((rows, columns)).reshape(2, -1)
    grid = np.stack([(column + 0.5 * (row % 2)) * spacing, row * rise], axis=1)
    grid += 0.5 * (low + high) - 0.5 * (grid.min(axis=0) + grid.max(axis=0))
    grid = grid[inside(grid, loops)]
    # Samples much closer together than the clearance stand for the outline itself.
    fine = (
        rim[edges[:, 0]][:, None]
        + np.linspace(0.0, 1.0, 8, endpoint=False)[:, None] * (rim[edges[:, 1]] - rim[edges[:, 0]])[:, None]
    )
    distance, _ = cKDTree(fine.reshape(-1, 2)).query(grid, distance_upper_bound=_CLEARANCE * spacing)
    return np.asarray(grid[np.isinf(distance)])


def _triangles(points: FloatArray, loops: list[FloatArray], spacing: float) -> IntArray:
    """Delaunay triangles of the points that lie inside the loops, counter-clockwise, shape (T, 3)."""
    from scipy.spatial import Delaunay, QhullError

    # Near the origin Qhull's circles keep more digits.
    centred = points - points.mean(axis=0)
    chance = np.random.default_rng(0)
    off = chance.uniform(-_JITTER * spacing, _JITTER * spacing, centred.shape) if len(points) > _MANY else 0.0
    try:
        triangles = np.asarray(Delaunay(centred + off).simplices, dtype=np.int32)
    except QhullError:
        raise SceneError("points: the outline is too thin to be filled") from None
    triangles = triangles[np.abs(signed_areas(centred, triangles)) > _FLAT * spacing**2]
    triangles = triangles[inside(points[triangles].mean(axis=1), loops)]
    return counter_clockwise(points, triangles)


def _missing(edges: IntArray, triangles: IntArray) -> IntArray:
    """Rows of outline edges that the triangles do not have as their open edges; every row if they have others."""
    keys, there = pair_keys(edges), pair_keys(open_edges(triangles))
    missing = np.nonzero(~np.isin(keys, there))[0]
    if not len(missing) and len(there) > len(keys):
        missing = np.arange(len(edges))
    return missing.astype(np.int32)


def _refined(boundary: list[FloatArray], edges: IntArray, rows: IntArray) -> list[FloatArray]:
    """The loops with the given edges cut in halves."""
    rim = np.concatenate(boundary)
    cut = np.zeros(len(edges), dtype=bool)
    cut[rows] = True
    refined, first = [], 0
    for loop in boundary:
        here = cut[first : first + len(loop)]
        middle = rim[edges[first : first + len(loop)]].mean(axis=1)
        refined.append(np.insert(loop, np.nonzero(here)[0] + 1, middle[here], axis=0))
        first += len(loop)
    return refined


def _smooth(
    points: FloatArray, triangles: IntArray, edges: IntArray, loops: list[FloatArray], spacing: float
) -> tuple[FloatArray, IntArray]:
    """Points inside moved to the middle of their neighbours a few times, with new triangles each time.

    Source: D. A. Field, "Laplacian smoothing and Delaunay triangulations", Comm. Appl. Num. Meth. 4, 1988.
    A pass after which the triangles no longer keep to the outline is the first that is not made.
    """
    for _ in range(_SMOOTHING_PASSES):
        pairs = find_edges(triangles).pairs
        at, to = np.concatenate([pairs, pairs[:, ::-1]]).T
        count = np.bincount(at, minlength=len(points))
        moved = np.zeros_like(points)
        for axis in range(2):
            moved[:, axis] = np.bincount(at, points[to, axis], len(points)) / count
        moved[: len(edges)] = points[: len(edges)]
        renewed = _triangles(moved, loops, spacing)
        if len(_missing(edges, renewed)):
            break
        points, triangles = moved, renewed
    return points, triangles
