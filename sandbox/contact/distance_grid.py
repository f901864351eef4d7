"""A coarse look at a mesh from every node of a grid: how far the surface is, on which side, and by which triangles.

It answers what is far away by one look, and tells a search near the surface where to begin.
"""

from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.contact.triangle_search import TriangleSearch
from sandbox.contact.triangle_tree import FloatArray
from sandbox.scene.lattice import IntArray
from sandbox.scene.winding import winding
from sandbox.state import place

_MOST_NODES = 2_000_000
"""Most nodes of a grid: a finer one would hardly be faster to search, but takes longer to make."""


def grid_frame(vertices: FloatArray, resolution: int, margin: float) -> tuple[FloatArray, float, tuple[int, int, int]]:
    """Lowest node [m], cell [m] and node counts of a grid around a mesh, ``margin`` [m] wider and a little more."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    longest = float((high - low).max())
    while True:
        cell = longest / resolution
        extra = 1 + int(np.ceil(margin / cell))
        nodes = np.ceil((high - low) / cell).astype(int) + 1 + 2 * extra
        if nodes.prod() <= _MOST_NODES:
            break
        resolution = int(0.9 * resolution)
    # What rounding up adds goes to both sides alike: a symmetric mesh makes a symmetric grid.
    return 0.5 * (low + high) - 0.5 * cell * (nodes - 1), cell, (int(nodes[0]), int(nodes[1]), int(nodes[2]))


@ti.data_oriented
class DistanceGrid:
    """Signed distances at the nodes of a cubic grid [m], and the leaves of the tree that hold what is closest to them.

    ``inside`` says which nodes are, shape (nx, ny, nz); None where the normals of ``search`` tell.
    """

    def __init__(
        self,
        builder: ti.FieldsBuilder,
        search: TriangleSearch,
        frame: tuple[FloatArray, float, tuple[int, int, int]],
        inside: NDArray[np.bool_] | None,
    ) -> None:
        low, self.cell, self.nodes = frame
        self.search = search
        self.inside = inside
        self.told = inside is not None
        self.real = runtime.real()
        self.low = runtime.vector(3)(low)
        self.highest = ti.types.vector(3, ti.i32)([n - 1 for n in self.nodes])
        self.distance = place(builder, ti.field(self.real), *self.nodes)
        self.leaf = place(builder, ti.field(ti.i32), *self.nodes)

    def load(self, known: dict[Any, Any], key: Any) -> None:
        """Upload what is ``known`` under a key, or find and keep it there."""
        if key in known:
            self._write(*known[key])
            return
        values, leaves = np.empty(self.nodes), np.empty(self.nodes, dtype=np.int32)
        inside = np.zeros((1, 1, 1), dtype=np.int8) if self.inside is None else self.inside.astype(np.int8)
        self._fill(inside)
        self._read(values, leaves)
        known[key] = (values, leaves)

    @ti.kernel
    def _fill(self, inside: ti.types.ndarray()):
        for i, j in ti.ndrange(self.nodes[0], self.nodes[1]):
            leaf = 0
            for k in range(self.nodes[2]):
                x = self.low + self.cell * ti.Vector([i, j, k])
                spot, triangle, part, found = self.search.closest(x, leaf)
                leaf = found
                behind = (x - spot).dot(self.search.outward_at(triangle, part)) < 0.0
                if ti.static(self.told):
                    behind = inside[i, j, k] != 0
                distance = (x - spot).norm()
                self.distance[i, j, k] = ti.select(behind, -distance, distance)
                self.leaf[i, j, k] = leaf

    @ti.kernel
    def _read(self, values: ti.types.ndarray(), leaves: ti.types.ndarray()):
        for i, j, k in ti.ndrange(*self.nodes):
            values[i, j, k] = self.distance[i, j, k]
            leaves[i, j, k] = self.leaf[i, j, k]

    @ti.kernel
    def _write(self, values: ti.types.ndarray(), leaves: ti.types.ndarray()):
        for i, j, k in ti.ndrange(*self.nodes):
            self.distance[i, j, k] = values[i, j, k]
            self.leaf[i, j, k] = leaves[i, j, k]

    @ti.func
    def look(self, x):
        """Signed distance of the node next to x [m], how far x is from it [m], and the leaf closest to it."""
        at = ti.cast((x - self.low) / self.cell + 0.5, ti.i32)
        node = ti.min(ti.max(at, 0), self.highest)
        i, j, k = node[0], node[1], node[2]
        away = x - self.low - self.cell * ti.cast(node, self.real)
        return self.distance[i, j, k], away.norm(), self.leaf[i, j, k]


def nodes_inside(
    vertices: FloatArray, triangles: IntArray, frame: tuple[FloatArray, float, tuple[int, int, int]]
) -> NDArray[np.bool_]:
    """Which nodes a mesh winds around, shape (nx, ny, nz)."""
    return np.asarray(winding(vertices, triangles, *frame) != 0)
