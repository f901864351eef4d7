"""What there is to draw: index lists into the particles, colours, colliders. NumPy only."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.cells import Cells, gap_points
from sandbox.scene.model import Collider

IntArray = NDArray[np.int32]
FloatArray = NDArray[np.float64]


class Shown(NamedTuple):
    """What of a scene is drawn: a mask each."""

    triangles: NDArray[np.bool_]
    """Shape (triangle_count,)."""
    outline: NDArray[np.bool_]
    """Shape (edge_count,)."""
    capsules: NDArray[np.bool_]
    """Shape (capsule_count,)."""


@dataclass(frozen=True)
class Appearance:
    """Drawable elements of a scene. Indices are into the particle order of the simulation's fields."""

    dimension: int
    """2 or 3."""
    triangles: IntArray
    """Filled surface triangles, counter-clockwise from outside (2D: counter-clockwise), shape (triangle_count, 3)."""
    triangle_body: IntArray
    """Body of every triangle, shape (triangle_count,)."""
    outline: IntArray
    """2D only: outline edges, shape (edge_count, 2)."""
    outline_body: IntArray
    """Body of every outline edge, shape (edge_count,)."""
    capsules: IntArray
    """Ropes and struts: pairs of particles, shape (capsule_count, 2)."""
    capsule_radius: FloatArray
    """Radius of every capsule [m], shape (capsule_count,)."""
    capsule_body: IntArray
    """Body of every capsule, shape (capsule_count,)."""
    spheres: IntArray
    """Particles drawn as spheres, shape (sphere_count,)."""
    sphere_radius: FloatArray
    """Radius of every sphere [m], shape (sphere_count,)."""
    sphere_body: IntArray
    """Body of every sphere, shape (sphere_count,)."""
    body_colors: FloatArray
    """sRGB colour of every body in [0, 1], shape (body_count, 3)."""
    body_two_sided: NDArray[np.bool_]
    """True where a body is an open surface (a sheet), seen from both sides, shape (body_count,)."""
    colliders: tuple[Collider, ...]
    """Solid things; where one has a ``motion``, :func:`sandbox.scene.motion.motion_of` tells where it is."""
    bounds: FloatArray
    """Lower and upper corner of all particles over the expected motion [m], shape (2, dimension)."""
    element_size: float
    """Typical spring length [m]: a scale for outline widths."""
    particle_count: int
    """Number of particles. Triangles may name points past them: entry ``i - particle_count`` of ``carried_nodes``."""
    carried_nodes: IntArray
    """Particles that carry every extra surface point, shape (carried_count, nodes)."""
    carried_weights: FloatArray
    """Their weights, which add up to 1, shape (carried_count, nodes)."""
    body_radius: FloatArray | None = None
    """Radius of every body's particles, by which it meets others [m], shape (body_count,); None: all 0."""
    cells: Cells | None = None
    """What hangs on which springs; the last triangles and outline edges are then those between cells, inside of
    bodies. None in a scene where nothing tears."""

    @property
    def tears(self) -> bool:
        """True where what is drawn depends on what has torn; elsewhere all is drawn, always."""
        return self.cells is not None

    def shown(self, torn: IntArray | None = None) -> Shown:
        """Which triangles, outline edges and capsules are drawn.

        ``torn`` is nonzero where a spring has torn, shape (spring_count,); None: nothing has torn.
        """
        cells = self.cells
        if cells is None:
            return Shown(*(np.ones(len(rows), dtype=bool) for rows in (self.triangles, self.outline, self.capsules)))
        broken = cells.broken(torn)
        return Shown(*(faces.shown(broken) for faces in (cells.triangles, cells.outline, cells.capsules)))

    def drawn_points(self, positions: FloatArray, torn: IntArray | None = None) -> FloatArray:
        """Where the points are drawn that triangles and outline edges name [m].

        ``positions`` are those of the particles in the simulation's order [m], shape (particle_count, dimension). The
        result has the carried points after the particles. Beside what has torn, as ``torn`` says in the way of
        :meth:`shown`, surfaces pass half a cell from their particles, in the gap, so that nothing seems lost.
        """
        points = positions
        if self.cells is not None and torn is not None:
            flat = self.dimension == 2
            faces, of = (self.outline, self.cells.outline) if flat else (self.triangles, self.cells.triangles)
            seen, moves = of.shown(self.cells.broken(torn)), of.depth > 0.0
            outer = faces[seen & ~moves]
            # Carried points are at no rim: they have no faces inside.
            outer = outer[np.all(outer < self.particle_count, axis=1)]
            if np.any(seen & moves):
                points = gap_points(positions, faces[seen & moves], of.depth[seen & moves], outer)
        if len(self.carried_nodes) == 0:
            return points
        return np.concatenate([points, np.einsum("cn,cnd->cd", self.carried_weights, positions[self.carried_nodes])])
