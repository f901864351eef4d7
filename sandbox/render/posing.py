"""Puts colliders made of triangles and rods into the arrays that bodies are drawn from."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from sandbox.render.arrays import upload
from sandbox.render.solids import Solid
from sandbox.render.types import Floats, Ints, Points, vec3
from sandbox.render.view import at3, project, to_light
from sandbox.scene.appearance import IntArray

POSE = 12
"""Numbers of a pose: the rows of its rotation, and its origin [m]."""


@ti.func
def turned(poses: ti.template(), i, p):
    """A vector turned as collider i is."""
    return vec3(at3(poses, i * POSE).dot(p), at3(poses, i * POSE + 3).dot(p), at3(poses, i * POSE + 6).dot(p))


@ti.kernel
def pose_solids(
    poses: Floats,
    first_vertex: ti.i32,
    corner_count: ti.i32,
    corners: Floats,
    normals: Floats,
    corner_owner: Ints,
    first_round: ti.i32,
    rod_count: ti.i32,
    ends: Floats,
    rod_owner: Ints,
    view: Floats,
    world: Points,
    normal: Points,
    screen: Points,
    light: Points,
    start: Points,
    end: Points,
):
    """World, screen and light coordinates of every corner, its normal, and both ends of every rod."""
    for i in range(corner_count):
        owner, k = corner_owner[i], first_vertex + i
        p = turned(poses, owner, at3(corners, 3 * i)) + at3(poses, owner * POSE + 9)
        world[k] = p
        normal[k] = turned(poses, owner, at3(normals, 3 * i))
        screen[k] = project(view, p)
        light[k] = to_light(view, p)
    for i in range(rod_count):
        owner, k = rod_owner[i], first_round + i
        start[k] = turned(poses, owner, at3(ends, 6 * i)) + at3(poses, owner * POSE + 9)
        end[k] = turned(poses, owner, at3(ends, 6 * i + 3)) + at3(poses, owner * POSE + 9)


class PosedSolids:
    """Colliders whose triangles and rods stand where their poses say."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        """`solids` are drawn in this order."""
        self._solids = tuple(solids)
        corner_counts = [3 * len(solid.corners) for solid in solids]
        rod_counts = [len(solid.ends) for solid in solids]
        self.corner_count, self.rod_count = sum(corner_counts), sum(rod_counts)
        self.triangle_owner: IntArray = _owners([len(solid.corners) for solid in solids])
        """Solid of every triangle, shape (triangle_count,)."""
        self.rod_owner: IntArray = _owners(rod_counts)
        """Solid of every rod, shape (rod_count,)."""
        self.rod_radius = np.concatenate([solid.radius for solid in solids] or [np.zeros(0)])
        """[m], shape (rod_count,)."""
        self.tints = np.array([solid.tint for solid in solids]).reshape(-1, 3)
        """Linear colours, shape (solid_count, 3)."""
        if solids:
            self._corners = upload(np.concatenate([solid.corners.ravel() for solid in solids]), ti.f32)
            self._normals = upload(np.concatenate([solid.normals.ravel() for solid in solids]), ti.f32)
            self._corner_owner = upload(_owners(corner_counts), ti.i32)
            self._ends = upload(np.concatenate([solid.ends.ravel() for solid in solids]), ti.f32)
            self._rod_owner = upload(self.rod_owner, ti.i32)
            self._poses = upload(np.zeros((len(solids), POSE)), ti.f32)

    def __len__(self) -> int:
        return len(self._solids)

    def place(self, time: float, view: Any, vertices: Sequence[Any], first_vertex: int, rounds: Sequence[Any],
              first_round: int) -> None:  # fmt: skip
        """Enter all as they are at a time [s].

        `vertices` are the arrays of world coordinates, normals, screen and light coordinates, written from
        `first_vertex` on; `rounds` those of starts and ends, written from `first_round` on.
        """
        rows = [np.concatenate([turn.ravel(), place]) for place, turn in (solid.pose(time) for solid in self._solids)]
        self._poses.from_numpy(np.concatenate(rows).astype(np.float32))
        pose_solids(
            self._poses, first_vertex, self.corner_count, self._corners, self._normals, self._corner_owner,
            first_round, self.rod_count, self._ends, self._rod_owner, view, *vertices, *rounds,
        )  # fmt: skip


def _owners(counts: Sequence[int]) -> IntArray:
    return np.repeat(np.arange(len(counts), dtype=np.int32), counts)
