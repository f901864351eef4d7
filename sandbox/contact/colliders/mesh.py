"""Solids inside a closed triangle mesh, by a grid of signed distances.

Between nodes the distance is interpolated in each cell. Distances at nodes differ by no more than
their places do, so the interpolated field climbs by at most sqrt(3) a metre: from a value d there is
no surface within d / sqrt(3), and that far a path may safely advance.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.contact.colliders.solid import NEVER, TINY, SolidCollider, outside_box, rounding
from sandbox.contact.distance_grid import DistanceGrid, bake, grid_frame, lost_share
from sandbox.errors import SceneError
from sandbox.scene.assemble import Assembly
from sandbox.scene.mesh_file import load_surface
from sandbox.scene.model import MeshCollider
from sandbox.scene.motion import origin
from sandbox.scene.placement import rotation_matrix
from sandbox.state import ParticleState, place

FloatArray = NDArray[np.float64]

_SAFE = 1.0 / math.sqrt(3.0)
_STRIDE = 0.125
"""Shortest advance [cells]: a corner that a path cuts off within less is not felt."""
_MOST_MARGIN = 8
"""Most cells that the grid grows by for the sake of large particles."""
_MOST_LOST = 0.05
"""Most of a mesh's surface that may be too thin for the grid [1]."""


@lru_cache(maxsize=4)
def _baked(vertices: bytes, triangles: bytes, resolution: int, margin: float, precision: str) -> DistanceGrid:
    """Grids of the latest meshes: simulations are often built again from the same scene."""
    return bake(
        np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(triangles, np.int32).reshape(-1, 3), resolution, margin
    )


@ti.data_oriented
class GridCollider(SolidCollider):
    """Solid inside a mesh; ``reach`` is the farthest from the origin that it may be moved [m].

    Raises SceneError where the mesh cannot be read or has no inside.
    """

    most_hits = 4

    def __init__(
        self,
        collider: MeshCollider,
        surface: Any,
        radius: Any,
        state: ParticleState,
        builder: Any,
        reach: float,
        where: str,
        largest_radius: float,
    ) -> None:
        super().__init__(surface, radius, state)
        self.where = where
        self.real = runtime.real()
        self.resolution = collider.resolution
        surface = load_surface(collider)
        self.vertices, self.triangles = surface.vertices, surface.triangles
        if surface.gaps:
            raise SceneError(
                f"{where}.file: {collider.file} is not closed, so it has no inside to collide with: "
                f"it has {surface.gaps}"
            )
        cell = float(np.ptp(self.vertices, axis=0).max()) / self.resolution
        self.margin = min(largest_radius, _MOST_MARGIN * cell)
        low, self.cell, nodes = grid_frame(self.vertices, self.resolution, self.margin)
        vector, matrix = runtime.vector(3), ti.types.matrix(3, 3, runtime.real())
        self.grid_low, self.grid_high = vector(low), vector(low + self.cell * (np.array(nodes) - 1))
        self.last_cell = ti.types.vector(3, ti.i32)([n - 2 for n in nodes])
        self.low, self.high = vector(self.vertices.min(axis=0)), vector(self.vertices.max(axis=0))
        turn = rotation_matrix(collider.rotation, 3)
        position = origin(collider, 3)
        self.placed = bool(position.any() or (turn != np.eye(3)).any())
        """True where the file's own frame is not the one that particles come in."""
        self.position, self.to_world, self.to_local = vector(position), matrix(turn), matrix(turn.T)
        size = float(np.abs(self.vertices).max() + np.abs(position).max()) + reach
        self.slack = 4.0 * rounding() * size
        """Distance within which a particle counts as touching [m]: what rounding leaves open."""
        self.most_strides = int(np.linalg.norm(nodes) / _STRIDE) + 64
        self.distance = place(builder, ti.field(runtime.real()), *nodes)

    def load(self, assembly: Assembly) -> None:
        """Make the grid, or find it made, and upload it."""
        vertices = np.ascontiguousarray(self.vertices, np.float64).tobytes()
        triangles = np.ascontiguousarray(self.triangles, np.int32).tobytes()
        grid = _baked(vertices, triangles, self.resolution, self.margin, runtime.settings().precision)
        lost = lost_share(grid, self.vertices, self.triangles)
        if lost > _MOST_LOST:
            raise SceneError(
                f"{self.where}.resolution: {100.0 * lost:.0f} % of the mesh's surface is thinner than a cell of "
                f"{self.cell:.2g} m and would be lost; raise it above {self.resolution}"
            )
        self._write(grid.values)

    @ti.kernel
    def _write(self, values: ti.types.ndarray()):
        for i, j, k in ti.ndrange(values.shape[0], values.shape[1], values.shape[2]):
            self.distance[i, j, k] = values[i, j, k]

    @ti.func
    def _local(self, x):
        result = x
        if ti.static(self.placed):
            result = self.to_local @ (x - self.position)
        return result

    @ti.func
    def _gap(self, x):
        """Distance from the mesh's bounding box [m]: its surface is no nearer."""
        return outside_box(self.low, self.high, x)

    @ti.func
    def _value(self, x):
        """Interpolated distance [m]; outside the grid that of its rim, and the way to it."""
        inner = ti.min(ti.max(x, self.grid_low), self.grid_high)
        at = (inner - self.grid_low) / self.cell
        base = ti.min(ti.cast(at, ti.i32), self.last_cell)
        w = at - ti.cast(base, self.real)
        i, j, k = base[0], base[1], base[2]
        near = self._along_z(i, j, k, w[2]) * (1.0 - w[1]) + self._along_z(i, j + 1, k, w[2]) * w[1]
        far = self._along_z(i + 1, j, k, w[2]) * (1.0 - w[1]) + self._along_z(i + 1, j + 1, k, w[2]) * w[1]
        return near * (1.0 - w[0]) + far * w[0] + (x - inner).norm()

    @ti.func
    def _along_z(self, i, j, k, w):
        return self.distance[i, j, k] * (1.0 - w) + self.distance[i, j, k + 1] * w

    @ti.func
    def _gradient(self, x):
        """Slope of the interpolated distance [1]: central differences in half a cell smooth the kinks of cells."""
        step = 0.25 * self.cell
        slope = 0.0 * x
        for k in range(6):  # one place in the code looks the distance up: it is long
            aside = 0.0 * x
            for axis in ti.static(range(3)):
                aside[axis] = ti.select(k % 3 == axis, ti.select(k < 3, step, -step), 0.0)
            slope += self._value(x + aside) * aside
        return slope / (2.0 * step * step)

    @ti.func
    def _normal(self, x):
        """Direction away from the solid; straight up where no direction is the shortest."""
        slope = self._gradient(x)
        steepness = slope.norm()
        normal = slope / ti.max(steepness, TINY)
        if steepness < 1e-3:
            normal = ti.Vector([0.0, 1.0, 0.0])
        return normal

    @ti.func
    def signed_distance(self, c, x):
        return self._value(self._local(x))

    @ti.func
    def entry(self, c, start, end, radius):
        a, b = self._local(start), self._local(end)
        path = b - a
        length = path.norm()
        hit = False
        fraction = 0.0
        spot = a
        normal = 0.0 * a
        if self._gap(a) - radius <= length:
            before = self._value(a) - radius
            if before < -self.slack:
                hit = True
            elif _SAFE * before <= length:
                if before <= self.slack:
                    hit = path.dot(self._normal(a)) < -self.grazing * length
                if not hit:
                    fraction = self._march(a, path, length, before, radius)
                    hit = fraction <= 1.0
            if hit:
                spot, normal = self._lift(a + fraction * path, radius)
        if ti.static(self.placed):
            spot = self.position + self.to_world @ spot
            normal = self.to_world @ normal
        return hit, fraction, spot, normal

    @ti.func
    def _march(self, a, path, length, before, radius):
        """Fraction of a path from outside at which it first goes in, by safe advances and then by halving."""
        fraction = NEVER
        done, distance, count = 0.0, before, 0
        while count < self.most_strides:
            count = count + 1
            free = ti.max(_SAFE * distance, self._gap(a + done / ti.max(length, TINY) * path) - radius)
            ahead = ti.min(done + ti.max(free, _STRIDE * self.cell), length)
            distance = self._value(a + ahead / ti.max(length, TINY) * path) - radius
            if distance < -self.slack:
                for _ in range(12):
                    between = 0.5 * (done + ahead)
                    if self._value(a + between / length * path) - radius < 0.0:
                        ahead = between
                    else:
                        done = between
                fraction = done / length
                count = self.most_strides
            elif ahead >= length:
                count = self.most_strides
            done = ahead
        return fraction

    @ti.func
    def _lift(self, x, radius):
        """The closest place to x at which a particle touches, and the normal there."""
        spot = x
        normal = 0.0 * x
        count = 0
        while count < 12:
            count = count + 1
            normal = self._normal(spot)
            off = self._value(spot) - radius
            spot = spot - off * normal
            if ti.abs(off) <= self.slack:
                count = 12
        return spot, normal
