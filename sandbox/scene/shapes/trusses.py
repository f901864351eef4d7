"""Towers of straight members."""

import numpy as np

from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.model import Tower
from sandbox.scene.shapes.geometry import Geometry, generate, lengths


@generate.register
def _tower(shape: Tower, dimension: int) -> Geometry:
    points = _tower_points(shape, dimension)
    members = _tower_members(shape.levels, shape.bays, dimension)
    length = lengths(points, members)
    section = shape.thickness if dimension == 2 else np.pi / 4.0 * shape.thickness**2
    ends = np.bincount(members.reshape(-1), np.repeat(0.5 * length, 2), minlength=len(points))
    return Geometry(
        points=points,
        springs=members,
        rest_lengths=length,
        spring_scale=section / length,
        mass_share=ends / length.sum(),
        volume=float(section * length.sum()),
        capsules=members,
        capsule_radius=0.5 * shape.thickness,
    )


def _tower_points(shape: Tower, dimension: int) -> FloatArray:
    """Nodes level by level from the foot, each level in the order of its face (2D) or round its square (3D)."""
    top = shape.width if shape.top_width is None else shape.top_width
    along = np.arange(shape.bays + (dimension == 2)) / shape.bays - 0.5
    if dimension == 2:
        plan = along[:, None]
    else:
        edge = np.full(shape.bays, 0.5)
        # Round the square, each side without its last corner.
        plan = np.concatenate([np.stack(side, 1) for side in _sides(along, edge)])
    height = np.linspace(0.0, 1.0, shape.levels + 1)
    width = (1.0 - height) * shape.width + height * top
    points = np.zeros((len(height), len(plan), dimension))
    points[:, :, 0] = width[:, None] * plan[:, 0]
    points[:, :, 1] = (shape.height * height)[:, None]
    if dimension == 3:
        points[:, :, 2] = width[:, None] * plan[:, 1]
    return points.reshape(-1, dimension)


def _sides(along: FloatArray, edge: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """x and z along the four sides of the unit square, one after the other."""
    return [(along, -edge), (edge, along), (-along, edge), (-edge, -along)]


def _tower_members(levels: int, bays: int, dimension: int) -> IntArray:
    """Pairs of nodes: uprights and crosses of every storey, horizontals (3D: and plan bracing) of every level."""
    size = bays + 1 if dimension == 2 else 4 * bays
    here = np.arange(size)
    # A face is open in 2D; in 3D the last panel closes the square.
    panel = here[:bays] if dimension == 2 else here
    following = (panel + 1) % size
    storey = np.concatenate(
        [
            np.stack([here, here + size], axis=1),
            np.stack([panel, following + size], axis=1),
            np.stack([following, panel + size], axis=1),
        ]
    )
    level = np.stack([panel, following], axis=1)
    if dimension == 3:
        level = np.concatenate([level, _plan_bracing(bays)])
    foot = size * np.arange(levels + 1)[:, None, None]
    return np.concatenate([(level + foot).reshape(-1, 2), (storey + foot[:-1]).reshape(-1, 2)]).astype(np.int32)


def _plan_bracing(bays: int) -> IntArray:
    """Members inside the square of one level, (6 * bays - 4, 2), for nodes numbered round it.

    A member from every node to the one opposite, through the middle, and one from every node between corners
    round each corner to the next side. Diagonals of the square alone would leave nodes between corners free to
    move out of their face; members round the corners alone would let opposite sides move out while the others
    move in; members to the mirrored node of the opposite side would let both, one node out and the next in.
    """
    size = 4 * bays
    through = np.stack([np.arange(2 * bays), np.arange(2 * bays) + 2 * bays], axis=1)
    between = np.arange(1, bays)
    round_corners = [np.stack([c + between, (c - between) % size], axis=1) for c in bays * np.arange(4)]
    return np.concatenate([through, *round_corners]).astype(np.int32)
