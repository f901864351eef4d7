"""Isotropic spring lattices: which springs a set of cells carries, and how stiff each is.

Central springs between lattice neighbours make an isotropic solid when the elastic constants, summed
over the springs of one cell, c_ijkl = (1/V) sum k L^2 n_i n_j n_k n_l, satisfy c_1111 = 3 c_1122
(then Poisson's ratio is 1/4 in 3D and 1/3 in 2D). Source: Born and Huang, Dynamical Theory of
Crystal Lattices, 1954, section 11; the conditions are solved here for cells that need not be cubes.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.model import Bracing

IntArray = NDArray[np.int32]
FloatArray = NDArray[np.float64]
Offset = tuple[int, ...]

# Share of Lame's constant that body diagonals carry when a lattice has them: stiffness 4:2:1 for
# axial : face : body springs of a cube times 1/3, so that no kind dominates.
_BODY_SHARE = 1.0 / 3.0


@dataclass(frozen=True)
class Lattice:
    """Particles and springs of a set of occupied cells."""

    points: FloatArray
    """Particle positions, the grid's centre at the origin [m], shape (particle_count, dimension)."""
    springs: IntArray
    """Pairs of particles, shape (spring_count, 2)."""
    spring_scale: FloatArray
    """Spring stiffness over Young's modulus, k / E [m] (2D: times 1 m thickness), shape (spring_count,)."""
    spring_ratio: FloatArray | None
    """Stiffness over that of structural springs where all of those are equal [1]; None without bend springs."""
    mass_share: FloatArray
    """Fraction of the mass at every particle, shape (particle_count,)."""
    faces: IntArray
    """Boundary: outward triangles in 3D, counter-clockwise edges in 2D; shape (face_count, dimension)."""
    cells: IntArray
    """2D only: counter-clockwise triangles that fill the cells, shape (2 * cell_count, 3)."""
    corners: IntArray
    """Particles at the corners of every cell, which count up in binary, x first, shape (cell_count, 2^dimension)."""


def spring_offsets(dimension: int, bracing: Bracing) -> list[Offset]:
    """Neighbour offsets of one spring each, in cells; the first nonzero component is positive."""
    reach = {Bracing.NONE: 1, Bracing.FACE: 2, Bracing.BODY: 3}[bracing]
    return [
        offset
        for offset in itertools.product((-1, 0, 1), repeat=dimension)
        if offset > (0,) * dimension and sum(map(abs, offset)) <= reach
    ]


def isotropic_scales(spacing: tuple[float, ...], bracing: Bracing) -> dict[Offset, float]:
    """Stiffness over Young's modulus, by the absolute offset, for an interior spring.

    Square of side a: axial 3/4, diagonals 3/8. Cube: axial and face diagonals 0.4 a (bracing "face").
    Without diagonals (bracing "none") there is no isotropic solution: each spring is a bar of its
    cell's cross-section. Raises SceneError where cells are too far from cubes.
    """
    dimension = len(spacing)
    squares = np.square(spacing)
    volume = float(np.prod(spacing))
    units = [tuple(int(i == axis) for i in range(dimension)) for axis in range(dimension)]
    if bracing is Bracing.NONE:
        return {unit: volume / squares[axis] for axis, unit in enumerate(units)}
    lame = 3.0 / 8.0 if dimension == 2 else 1.0 / 2.5  # over Young's modulus, with Poisson's ratio 1/3 or 1/4
    pairs = list(itertools.combinations(range(dimension), 2))
    scales: dict[Offset, float] = {}
    body = 0.0
    if bracing is Bracing.BODY and dimension == 3:
        largest = max(squares[i] * squares[j] for i, j in pairs)
        body = _BODY_SHARE * lame * squares.sum() * volume / (4.0 * largest)
        scales[(1, 1, 1)] = body
    axial = 3.0 * lame * volume / squares - 4.0 * body * squares / squares.sum() * (dimension == 3)
    for i, j in pairs:
        both = squares[i] + squares[j]
        diagonal = (lame * volume / (squares[i] * squares[j]) - 4.0 * body / squares.sum()) * both / 2.0
        scales[tuple(int(axis in (i, j)) for axis in range(dimension))] = diagonal
        axial[i] -= 2.0 * diagonal * squares[i] / both
        axial[j] -= 2.0 * diagonal * squares[j] / both
    if axial.min() <= 0.0:
        ratio = max(spacing) / min(spacing)
        raise SceneError(f"cells are too far from cubes (edges differ by {ratio:.2g} times) for youngs_modulus")
    scales.update({unit: float(axial[axis]) for axis, unit in enumerate(units)})
    return scales


def build_lattice(
    occupied: NDArray[np.bool_], spacing: tuple[float, ...], bracing: Bracing, bend: float = 0.0
) -> Lattice:
    """Particles at the corners of the occupied cells, springs weighted by the cells that share them.

    A spring inside is shared by 4 (axial, 3D) or 2 cells; on a free surface it stands for those that
    exist. ``occupied`` has one entry a cell; ``spacing`` is the cell's size [m]. With ``bend`` > 0 there
    are also bend springs, that many times as stiff as the axial ones beside them.
    """
    dimension = occupied.ndim
    node_cells = _cells_around_nodes(occupied)
    node_index = np.full(node_cells.shape, -1, dtype=np.int64)
    used = node_cells > 0
    node_index[used] = np.arange(used.sum())
    corner = -0.5 * np.asarray(occupied.shape) * spacing
    points = np.argwhere(used) * np.asarray(spacing) + corner
    scales = _scales_or_unit(spacing, bracing)
    springs, weights = [], []
    bend_springs, bend_weights = [], []
    for offset in spring_offsets(dimension, bracing):
        share = _shares(occupied, offset)
        there = share > 0.0
        scale = scales[tuple(abs(component) for component in offset)]
        if bend > 0.0 and sum(map(abs, offset)) == 1:
            share, bend_share = _with_bend(share, offset.index(1), bend)
            bend_springs.append(_pairs(node_index, tuple(2 * o for o in offset), bend_share > 0.0))
            bend_weights.append(bend_share[bend_share > 0.0] * scale)
        springs.append(_pairs(node_index, offset, there))
        weights.append(share[there] * scale)
    structural_count = sum(map(len, springs))
    all_springs = np.concatenate(springs + bend_springs).astype(np.int32)
    return Lattice(
        points=points,
        springs=all_springs,
        spring_scale=np.concatenate(weights + bend_weights),
        spring_ratio=np.where(np.arange(len(all_springs)) < structural_count, 1.0, bend) if bend > 0.0 else None,
        mass_share=node_cells[used] / node_cells.sum(),
        faces=_boundary(occupied, node_index),
        cells=_fill(occupied, node_index) if dimension == 2 else np.zeros((0, 3), np.int32),
        corners=_corners(occupied, node_index),
    )


def _scales_or_unit(spacing: tuple[float, ...], bracing: Bracing) -> dict[Offset, float]:
    """Scales; NaN where cells are too uneven, which only youngs_modulus minds (see assemble)."""
    try:
        return isotropic_scales(spacing, bracing)
    except SceneError:
        return {
            tuple(abs(component) for component in offset): np.nan for offset in spring_offsets(len(spacing), bracing)
        }


def _cells_around_nodes(occupied: NDArray[np.bool_]) -> NDArray[np.int64]:
    counts = np.zeros(tuple(n + 1 for n in occupied.shape), dtype=np.int64)
    for corner in itertools.product((0, 1), repeat=occupied.ndim):
        counts[tuple(slice(c, c + n) for c, n in zip(corner, occupied.shape, strict=True))] += occupied
    return counts


def _ends(nodes: tuple[int, ...], offset: Offset) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of a grid of nodes with the first and the second ends of all springs of one offset."""
    start = tuple(slice(max(0, -o), max(0, n - max(0, o))) for o, n in zip(offset, nodes, strict=True))
    end = tuple(slice(max(0, o), max(0, n - max(0, -o))) for o, n in zip(offset, nodes, strict=True))
    return start, end


def _pairs(node_index: NDArray[np.int64], offset: Offset, there: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Springs of one offset that are there, as pairs of nodes."""
    start, end = _ends(node_index.shape, offset)
    return np.stack([node_index[start][there], node_index[end][there]], axis=1)


def _shares(occupied: NDArray[np.bool_], offset: Offset) -> FloatArray:
    """Fraction of the cells that share a spring which are occupied, for all springs of one offset, on a grid."""
    start, _ = _ends(tuple(n + 1 for n in occupied.shape), offset)
    shape = tuple(s.stop - s.start for s in start)
    shared = np.zeros(shape, dtype=np.int64)
    padded = np.pad(occupied, 1)
    free = [axis for axis, o in enumerate(offset) if o == 0]
    for sides in itertools.product((-1, 0), repeat=len(free)):
        window = []
        for axis, o in enumerate(offset):
            # Cell c spans nodes c and c + 1; +1 for the padding.
            shift = 1 if o != 0 else 1 + sides[free.index(axis)]
            window.append(slice(shift, shift + shape[axis]))
        shared += padded[tuple(window)]
    return shared / 2.0 ** len(free)


def _with_bend(share: FloatArray, axis: int, bend: float) -> tuple[FloatArray, FloatArray]:
    """Shares of the axial springs of a line, less what bend springs take over, and shares of the bend springs.

    A line stretched evenly by strain e pulls with k a e; a bend spring of stiffness q k that skips a node adds
    2 a q k e to both axial springs under it. Each axial spring gives up just that, so that the pull, and Young's
    modulus with it, stays the same everywhere: inside k / (1 + 4 bend) remains, at the ends more.
    """
    before = tuple(slice(0, -1) if i == axis else slice(None) for i in range(share.ndim))
    after = tuple(slice(1, None) if i == axis else slice(None) for i in range(share.ndim))
    bend_share = np.minimum(share[before], share[after]) * (bend / (1.0 + 4.0 * bend))
    axial = share.copy()
    axial[before] -= 2.0 * bend_share
    axial[after] -= 2.0 * bend_share
    return axial, bend_share


def _boundary(occupied: NDArray[np.bool_], node_index: NDArray[np.int64]) -> IntArray:
    padded = np.pad(occupied, 1)
    faces = []
    for axis in range(occupied.ndim):
        for side in (0, 1):
            neighbour = np.roll(padded, 1 - 2 * side, axis=axis)
            cells = np.argwhere(padded & ~neighbour) - 1
            faces.append(_face_elements(cells, axis, side, node_index))
    return np.concatenate(faces).astype(np.int32)


def _face_elements(cells: NDArray[np.int64], axis: int, side: int, node_index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Outward triangles (3D) or counter-clockwise edges (2D) of one side of the given cells."""
    dimension = node_index.ndim
    others = [(axis + 1) % dimension, (axis + 2) % dimension][: dimension - 1]

    def corner(*steps: int) -> NDArray[np.int64]:
        node = cells.copy()
        node[:, axis] += side
        for other, step in zip(others, steps, strict=True):
            node[:, other] += step
        return np.asarray(node_index[tuple(node.T)])

    if dimension == 2:
        # Seen along +x the next axis is y: the right side runs up; along +y it is x, mirrored.
        forward = (side == 1) == (axis == 0)
        first, second = (corner(0), corner(1)) if forward else (corner(1), corner(0))
        return np.stack([first, second], axis=1)
    quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]
    if side == 0:
        quad.reverse()
    return np.concatenate([np.stack([quad[0], quad[1], quad[2]], 1), np.stack([quad[0], quad[2], quad[3]], 1)])


def _fill(occupied: NDArray[np.bool_], node_index: NDArray[np.int64]) -> IntArray:
    x, y = np.nonzero(occupied)
    a, b = node_index[x, y], node_index[x + 1, y]
    c, d = node_index[x + 1, y + 1], node_index[x, y + 1]
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def _corners(occupied: NDArray[np.bool_], node_index: NDArray[np.int64]) -> IntArray:
    cells = np.argwhere(occupied)
    steps = itertools.product((0, 1), repeat=occupied.ndim)
    return np.stack([node_index[tuple((cells + step).T)] for step in steps], axis=1).astype(np.int32)
