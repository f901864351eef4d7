"""Solids inside a closed triangle mesh: they answer by the closest triangle, edge or corner.

A grid tells what is far away, and where a search near the surface begins; what is found is exact, however coarse the
grid is. What starts inside leaves at the closest place; what comes from outside is swept against faces, and edges and
corners that stick out, each rounded by the particle's radius.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.contact.colliders.solid import BLUNT, SolidCollider, outside_box, rounding
from sandbox.contact.distance_grid import DistanceGrid, grid_frame, nodes_inside
from sandbox.contact.mesh_surface import MeshSurface, loose_surface, mesh_surface
from sandbox.contact.mesh_union import outer_parts
from sandbox.contact.triangle_search import TriangleSearch
from sandbox.contact.triangle_tree import FloatArray
from sandbox.errors import SceneError
from sandbox.scene.assemble import Assembly
from sandbox.scene.lattice import IntArray
from sandbox.scene.mesh_file import load_surface
from sandbox.scene.model import MeshCollider
from sandbox.scene.motion import origin
from sandbox.scene.placement import rotation_matrix
from sandbox.state import ParticleState

_MOST_MARGIN = 4
"""Most cells that the grid grows by for the sake of large particles."""
_EXACT = 4
"""Cells from a particle within which its depth is exact; farther away it is at most what is said."""


@dataclass(frozen=True)
class _Solid:
    """What is found out about a mesh once, for all simulations with it."""

    surface: MeshSurface
    """All triangles."""
    pieces: MeshSurface | None
    """Those that bound the solid, where parts of the mesh overlap."""
    vertices: FloatArray
    triangles: IntArray
    grids: dict[Any, Any] = field(default_factory=dict)


@lru_cache(maxsize=4)
def _solid(vertices: bytes, triangles: bytes) -> _Solid | None:
    """The latest meshes: simulations are often built again from the same scene. None where nothing is solid."""
    points, faces = np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(triangles, np.int32).reshape(-1, 3)
    faces, pieces = outer_parts(points, faces)
    if len(faces) == 0:
        return None
    loose = None if pieces is None else loose_surface(pieces)
    return _Solid(mesh_surface(points, faces), loose, points, faces)


@ti.data_oriented
class MeshSolidCollider(SolidCollider):
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
        mesh = load_surface(collider)
        if mesh.gaps:
            raise SceneError(
                f"{where}.file: {collider.file} is not closed, so it has no inside to collide with: it has {mesh.gaps}"
            )
        vertices, triangles = (np.ascontiguousarray(mesh.vertices, float), np.ascontiguousarray(mesh.triangles, "i4"))
        solid = _solid(vertices.tobytes(), triangles.tobytes())
        if solid is None:
            raise SceneError(f"{where}.file: {collider.file} has no inside to collide with")
        vector, matrix = runtime.vector(3), ti.types.matrix(3, 3, runtime.real())
        turn = rotation_matrix(collider.rotation, 3)
        position = origin(collider, 3)
        self.placed = bool(position.any() or (turn != np.eye(3)).any())
        """True where the file's own frame is not the one that particles come in."""
        self.position, self.to_world, self.to_local = vector(position), matrix(turn), matrix(turn.T)
        size = float(np.abs(vertices).max() + np.abs(position).max()) + reach
        self.slack = 4.0 * rounding() * size
        """Distance within which a particle counts as touching [m]: what rounding leaves open."""
        self.unsure = (2.0 if self.placed or reach > 0.0 else 0.75) * rounding() * size
        """By how much a path along the surface may seem to go into it [m]: its ends are rounded."""
        self.low, self.high = vector(vertices.min(axis=0)), vector(vertices.max(axis=0))
        cell = float(np.ptp(vertices, axis=0).max()) / collider.resolution
        frame = grid_frame(vertices, collider.resolution, min(largest_radius, _MOST_MARGIN * cell))
        self.overlaps = solid.pieces is not None
        """True where parts of the mesh overlap: then not every triangle bounds the solid."""
        self.solid = solid
        self.search = TriangleSearch(builder, solid.surface, self.slack)
        self.pieces: Any = None
        inside = None
        if solid.pieces is not None:
            self.pieces = TriangleSearch(builder, solid.pieces, self.slack)
            inside = nodes_inside(solid.vertices, solid.triangles, frame)
        self.grid = DistanceGrid(builder, self.search, frame, inside)

    def load(self, assembly: Assembly) -> None:
        """Upload the triangles; make the grid, or find it made, and upload it."""
        self.search.load()
        if self.overlaps:
            self.pieces.load()
        self.grid.load(self.solid.grids, (self.grid.nodes, self.grid.cell, runtime.settings().precision))

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
    def _closest(self, x):
        """Signed distance of a place in the file's frame from the surface [m], and the direction away from the solid.

        Two places in the code look for what is closest only where parts overlap: a search is long.
        """
        value, away, leaf = self.grid.look(x)
        spot, triangle, part, _ = self.search.closest(x, leaf)
        distance = (x - spot).norm()
        outward = self.search.outward_at(triangle, part)
        flat = self.search.is_flat(triangle, part)
        inside = (x - spot).dot(outward) < 0.0
        normal = self.search.normal[triangle]
        if ti.static(self.overlaps):
            # Nothing is between x and a node that is nearer than the surface.
            inside = value < 0.0
            if distance <= away:
                inside = self.search.winding(x) != 0
            if inside:
                spot, triangle, part, _ = self.pieces.closest(x, 0)
                distance = (x - spot).norm()
                outward = self.pieces.normal[triangle]
                normal = outward
                flat = part == 0
        out = outward
        if distance > BLUNT * self.slack:  # nearer than that, the difference is rounding
            out = ti.select(inside, spot - x, x - spot) / distance
            if flat:
                out = normal
        return ti.select(inside, -distance, distance), out

    @ti.func
    def signed_distance(self, c, x):
        distance, _ = self._closest(self._local(x))
        return distance

    @ti.func
    def depth_in(self, c, i, x):
        """How far particle i is inside [m]; where it is far outside, at most this."""
        a = self._local(x)
        radius = self.radius.of(i)
        far = radius + _EXACT * self.grid.cell
        value, away, _ = self.grid.look(a)
        distance = far
        if value - away < far:
            distance, _ = self._closest(a)
            distance = ti.min(distance, far)
        return radius - ti.max(distance, self._gap(a))

    @ti.func
    def closest(self, c, x):
        """Signed distance from the surface [m], and the direction away from the solid there."""
        distance, out = self._closest(self._local(x))
        if ti.static(self.placed):
            out = self.to_world @ out
        return distance, out

    @ti.func
    def entry(self, c, start, end, radius):
        a, b = self._local(start), self._local(end)
        path = b - a
        length = path.norm()
        hit = False
        fraction = 0.0
        spot = a
        normal = 0.0 * a
        value, away, _ = self.grid.look(a)
        if ti.max(self._gap(a), value - away) - radius <= length:
            distance, out = self._closest(a)
            before = distance - radius
            along = self.grazing * length + self.unsure
            spot = a - before * out
            normal = out
            if before < -self.slack:
                hit = True
            elif before <= self.slack and -path.dot(out) > along:
                hit = True
            elif before <= length:
                fraction, spot, normal = self.search.sweep(a, path, radius, along)
                hit = fraction <= 1.0
        if ti.static(self.placed):
            spot = self.position + self.to_world @ spot
            normal = self.to_world @ normal
        return hit, fraction, spot, normal
