"""Which bodies are in each other's place, and which are inside colliders: by names and depths. NumPy only.

Where the boxes around two bodies have nothing in common, which is nearly always, nothing else is looked at; and of
those that have, only particles in what is common. So a million particles cost little.
"""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.assemble import Assembly
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.mesh_file import load_mesh
from sandbox.scene.model import (
    BoxCollider,
    CapsuleCollider,
    Collider,
    HalfSpace,
    MeshCollider,
    PolygonCollider,
    SphereCollider,
)
from sandbox.scene.motion import motion_of, origin
from sandbox.scene.placement import rotation_matrix
from sandbox.scene.shapes.outlines import check_outline, inside
from sandbox.scene.winding import winding

_REACH = 0.75
"""Part of the larger spacing within which particles of bodies without cells are in each other's place [1]."""
_GRAZING = 0.1
"""Part of its spacing by which a body may be in another's cells [1]."""
_ALLOWED = 0.25
"""Part of the distance of touching that two bodies may start closer than that: contact soon parts them [1]."""
_MESH_NODES = 48
"""Nodes along the longest side of a mesh collider at which its depth is known."""


@dataclass(frozen=True)
class Overlap:
    """Two bodies in each other's place."""

    first: int
    second: int
    depth: float
    """How far [m]: from a particle of one inside the other to that one's surface, or less than particles' radii."""


class BodyPairs:
    """The bodies of a scene that may be in each other's place: neither attached to each other nor waiting to enter.

    ``touching`` tells which: pairs that contact keeps apart, or those that it cannot for want of a radius. There are
    none where contact is off.
    """

    def __init__(self, assembly: Assembly, touching: bool) -> None:
        self.touching = touching
        self.assembly = assembly
        bodies = assembly.scene.bodies
        count = len(bodies)
        self.radius = np.zeros(count)
        self.radius[assembly.particle_body] = assembly.radii
        has_radius = self.radius > 0.0
        both = has_radius[:, None] & has_radius[None, :]
        may = (both == touching) & (assembly.families[:, None] != assembly.families[None, :])
        moves = np.zeros(count, dtype=bool)
        moves[assembly.particle_body[assembly.inverse_masses > 0.0]] = True
        moves[list(assembly.plan.entering)] = True
        may &= moves[:, None] | moves[None, :]
        may &= np.tri(count, k=-1, dtype=bool).T & assembly.scene.contact.enabled
        self.may = may
        """True where the first of two bodies comes before the second and the pair is one of these, shape (B, B)."""
        self.forgotten: list[tuple[int, int]] = []
        """Pairs that were, and are looked at no more."""

    @functools.cached_property
    def members(self) -> list[NDArray[np.int64]]:
        """Particles of every body."""
        return members_of(self.assembly)

    @functools.cached_property
    def spacing(self) -> FloatArray:
        """Typical distance of neighbours in every body [m], shape (B,)."""
        return spacing_of(self.assembly)

    @functools.cached_property
    def solid(self) -> NDArray[np.bool_]:
        """True for bodies that have cells, shape (B,)."""
        return np.isin(np.arange(len(self.radius)), self.assembly.cells.body)

    def __bool__(self) -> bool:
        return bool(self.may.any())

    def forget(self, first: int, second: int) -> None:
        """Look at this pair no more."""
        self.may[first, second] = False
        self.forgotten.append((first, second))

    def overlaps(self, positions: FloatArray) -> list[Overlap]:
        """Those in each other's place, the deepest first; ``positions`` are internal [m], shape (N, d)."""
        inner = positions[np.concatenate(self.members)]
        starts = np.cumsum([0] + [len(own) for own in self.members[:-1]])
        low, high = np.minimum.reduceat(inner, starts), np.maximum.reduceat(inner, starts)
        found = []
        for first in np.flatnonzero(self.may.any(axis=1)):
            others = np.flatnonzero(self.may[first])
            reach = self._reach(first, others)[:, None]
            apart = (low[first] > high[others] + reach) | (high[first] < low[others] - reach)
            for second in others[~apart.any(axis=1)]:
                margin = float(self._reach(first, second))
                box = (np.maximum(low[first], low[second]) - margin, np.minimum(high[first], high[second]) + margin)
                depth = self._depth(positions, int(first), int(second), box)
                if depth > 0.0:
                    found.append(Overlap(int(first), int(second), depth))
        return sorted(found, key=lambda overlap: -overlap.depth)

    def _reach(self, first: Any, second: Any) -> FloatArray:
        """Distance of particles below which bodies are in each other's place [m]."""
        if self.touching:
            return np.asarray((1.0 - _ALLOWED) * (self.radius[first] + self.radius[second]))
        solid = self.solid[first] | self.solid[second]
        return np.asarray(np.where(solid, 0.0, _REACH * np.maximum(self.spacing[first], self.spacing[second])))

    def _depth(self, positions: FloatArray, first: int, second: int, box: tuple[FloatArray, FloatArray]) -> float:
        """How far two bodies are in each other's place [m], by particles in the box that both have in common."""
        from scipy.spatial import cKDTree

        one, other = (_within(positions[self.members[body]], box) for body in (first, second))
        reach, depth = float(self._reach(first, second)), 0.0
        if reach > 0.0 and len(one) and len(other):
            nearest = float(cKDTree(other).query(one, distance_upper_bound=reach)[0].min())
            touch = reach / (1.0 - _ALLOWED) if self.touching else reach
            depth = touch - nearest if nearest < reach else 0.0
        inner, outer = (self._drawn_in(positions, points, body) for points, body in ((one, first), (other, second)))
        return max(depth, self._depth_in(positions, inner, second), self._depth_in(positions, outer, first))

    def _drawn_in(self, positions: FloatArray, points: FloatArray, body: int) -> FloatArray:
        """Points of a body a little nearer to its middle, so that faces which lie on each other do not count."""
        way = positions[self.members[body]].mean(axis=0) - points
        far = np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
        return np.asarray(points + way * np.minimum(1.0, _GRAZING * self.spacing[body] / far))

    def _depth_in(self, positions: FloatArray, points: FloatArray, body: int) -> float:
        """How deep points are in the cells of a body [m]; 0 where none is, or it has none."""
        from scipy.spatial import cKDTree

        cells = self.assembly.cells
        corners = cells.corners[slice(*np.searchsorted(cells.body, [body, body + 1]))]
        if not len(corners) or not len(points):
            return 0.0
        _, nearest = cKDTree(positions[corners].mean(axis=1)).query(points)
        within = _in_cells(points, positions[corners[nearest]])
        if not within.any():
            return 0.0
        node, uses = np.unique(corners, return_counts=True)
        surface = positions[node[uses < corners.shape[1]]]
        return float(cKDTree(surface).query(points[within])[0].max())


def members_of(assembly: Assembly) -> list[NDArray[np.int64]]:
    """Particles of every body."""
    order = np.argsort(assembly.particle_body, kind="stable")
    ends = np.cumsum(np.bincount(assembly.particle_body, minlength=len(assembly.scene.bodies)))
    return np.split(order, ends[:-1])


def spacing_of(assembly: Assembly) -> FloatArray:
    """Typical distance from a particle to its nearest neighbour in every body [m], 0 without springs, shape (B,)."""
    springs = assembly.spring_set
    nearest = np.full(assembly.particle_count, np.inf)
    real = springs.rest_lengths > 0.0
    for end in range(2):
        np.minimum.at(nearest, springs.ends[real, end], springs.rest_lengths[real])
    found = [nearest[own][np.isfinite(nearest[own])] for own in members_of(assembly)]
    return np.array([float(np.median(own)) if len(own) else 0.0 for own in found])


def _in_cells(points: FloatArray, corners: FloatArray) -> NDArray[np.bool_]:
    """Whether each point is in the cell of these corners, shape (P, 2^d, d), as if its sides were parallel; (P,)."""
    dimension = points.shape[1]
    number = np.arange(2**dimension)
    halves = [(number >> axis) & 1 == 1 for axis in reversed(range(dimension))]
    edges = np.stack([corners[:, far].mean(axis=1) - corners[:, ~far].mean(axis=1) for far in halves], axis=2)
    flat = np.abs(np.linalg.det(edges)) <= 1e-12 * np.linalg.norm(edges, axis=1).prod(axis=1)
    edges[flat] = np.eye(dimension)
    place = np.linalg.solve(edges, (points - corners.mean(axis=1))[..., None])[..., 0]
    return np.asarray((np.abs(place) <= 0.5).all(axis=1) & ~flat)


def _within(points: FloatArray, box: tuple[FloatArray, FloatArray]) -> FloatArray:
    return np.asarray(points[((points >= box[0]) & (points <= box[1])).all(axis=1)])


# -- colliders -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sunk:
    """A body of which a free particle is inside a collider."""

    body: int
    collider: str
    depth: float
    """Of its deepest particle [m]."""


class Solids:
    """The colliders of a scene, as depths of points."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        self.members = members_of(assembly)
        self._depths: dict[int, _MeshDepth] = {}
        self.held_by: dict[int, set[int]] = {}
        """Bodies that a collider carries: those may reach into it."""
        carried = assembly.carried
        for index, body in zip(carried.collider, assembly.particle_body[carried.particles], strict=True):
            self.held_by.setdefault(int(index), set()).add(int(body))

    def sunk(
        self, positions: FloatArray, inverse_masses: FloatArray, time: float, least: FloatArray, radii: float
    ) -> Iterator[Sunk]:
        """Bodies with a free particle deeper than ``least`` [m], shape (B,), at a time [s]; deepest collider first.

        A particle's depth is that of its center, and ``radii`` times its radius more.
        """
        found: list[Sunk] = []
        for index, collider in enumerate(self.assembly.colliders):
            depth = self._depth(index, collider, positions, time) + radii * self.assembly.radii
            depth[inverse_masses == 0.0] = -np.inf
            for body in self.held_by.get(index, ()):
                depth[self.members[body]] = -np.inf
            name = f"collider {collider.name!r}" if collider.name else f"colliders[{index}]"
            deepest = np.array([depth[own].max() for own in self.members])
            found.extend(Sunk(int(b), name, float(deepest[b])) for b in np.flatnonzero(deepest > least))
        yield from sorted(found, key=lambda sunk: -sunk.depth)

    def _depth(self, index: int, collider: Collider, positions: FloatArray, time: float) -> FloatArray:
        """How deep points are in a collider [m], shape (N,); negative outside, not always by the true distance."""
        dimension = self.assembly.dimension
        motion = motion_of(collider, dimension)
        middle, turn = origin(collider, dimension), rotation_matrix(getattr(collider, "rotation", 0.0), dimension)
        if motion is not None:
            middle, turn = motion.pose(time)
        x = (positions - middle) @ turn
        match collider:
            case HalfSpace():
                return np.asarray(-x @ (np.asarray(collider.normal) / np.linalg.norm(collider.normal)))
            case SphereCollider():
                return np.asarray(collider.radius - np.linalg.norm(x, axis=1))
            case BoxCollider():
                beyond = np.abs(x) - 0.5 * np.asarray(collider.size)
                return np.asarray(
                    -np.linalg.norm(np.maximum(beyond, 0.0), axis=1) - np.minimum(beyond.max(axis=1), 0.0)
                )
            case CapsuleCollider():
                start, end = np.asarray(collider.start), np.asarray(collider.end)
                return collider.radius - _distance(x, start, end)
            case PolygonCollider():
                return _depth_in_outline(x, check_outline(collider.points, collider.holes))
            case MeshCollider():
                if index not in self._depths:
                    self._depths[index] = _MeshDepth(*load_mesh(collider.file, collider.scale))
                return self._depths[index].of(x)
            case _:
                raise TypeError(f"no depth for {type(collider).__name__}")


def _distance(x: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distance of points from a segment [m], shape (N,)."""
    along = end - start
    part = np.clip((x - start) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(x - start - part[:, None] * along, axis=1))


def _depth_in_outline(x: FloatArray, loops: Sequence[FloatArray]) -> FloatArray:
    depth = np.full(len(x), -np.inf)
    within = np.flatnonzero(inside(x, loops))
    if len(within):
        edges = [(a, b) for loop in loops for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True)]
        depth[within] = np.min([_distance(x[within], a, b) for a, b in edges], axis=0)
    return depth


class _MeshDepth:
    """Depth inside a closed mesh at the nodes of a coarse grid: never said to be more than it is by over a cell."""

    def __init__(self, vertices: FloatArray, triangles: IntArray) -> None:
        from scipy.ndimage import distance_transform_edt

        self.low = vertices.min(axis=0)
        extent = np.ptp(vertices, axis=0)
        self.cell = float(extent.max()) / _MESH_NODES
        nodes = tuple(int(n) + 2 for n in np.ceil(extent / self.cell))
        full = winding(vertices, triangles, self.low - self.cell, self.cell, tuple(n + 1 for n in nodes)) > 0  # type: ignore[arg-type]
        self.depth = (distance_transform_edt(full) - 1.0) * self.cell

    def of(self, x: FloatArray) -> FloatArray:
        """Depth of points [m], shape (N,); minus infinity outside."""
        place = np.round((x - self.low) / self.cell + 1.0)
        there = ((place >= 0) & (place < self.depth.shape)).all(axis=1)
        depth = np.full(len(x), -np.inf)
        found = self.depth[tuple(place[there].astype(int).T)]
        depth[there] = np.where(found > 0.0, found, -np.inf)
        return depth
