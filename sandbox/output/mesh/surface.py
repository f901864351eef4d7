"""What is drawn of every body, in vertices of its own, at any frame. Three dimensions always: 2D scenes lie in z = 0.

A vertex is a particle, or a point that particles carry. It is where that is, but beside a gap that has opened in a
solid body, where the surface lies in the gap. The renderer draws bodies that meet others a contact radius outside.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sandbox.output.frames import FloatArray, Frame
from sandbox.render import palette
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import ColorBy
from sandbox.scene.scale import usual_largest

IntArray = NDArray[np.int32]


@dataclass(frozen=True)
class BodyParts:
    """The drawn elements of one body: V vertices, T triangles, L lines, D dots."""

    name: str
    color: FloatArray
    """sRGB in [0, 1], shape (3,)."""
    two_sided: bool
    """True for an open surface."""
    points: IntArray
    """Point of the scene at every vertex, shape (V,): a particle, or particle_count + number of a carried point."""
    particles: IntArray
    """Particle at every vertex, shape (V,), in the scene's order; -1 for carried points."""
    triangles: IntArray
    """Vertices of the triangles, shape (T, 3)."""
    triangle_rows: IntArray
    """Which triangles of the appearance they are, shape (T,)."""
    lines: IntArray
    """Vertices of ropes, struts, and of outlines that nothing fills, shape (L, 2)."""
    line_rows: IntArray
    """Which of the appearance's capsules, then outline edges, they are, shape (L,)."""
    line_radius: FloatArray
    """How thick they are drawn [m], shape (L,); 0 for outlines."""
    dots: IntArray
    """Vertices that are drawn as balls, shape (D,)."""
    dot_radius: FloatArray
    """[m], shape (D,)."""


@dataclass(frozen=True)
class BodyShape:
    """One body at one frame; what has torn is left out."""

    parts: BodyParts
    particles: IntArray
    """Particle at every vertex, shape (V,), in the scene's order; -1 for carried points."""
    vertices: FloatArray
    """Where they are drawn [m], shape (V, 3): where particles are, but for the gaps that open in solid bodies."""
    velocities: FloatArray
    """[m/s], shape (V, 3)."""
    strain: FloatArray | None
    """Largest strain at every vertex [1], shape (V,); None in a scene without springs."""
    colors: FloatArray
    """sRGB in [0, 1] as the scene's render.color has it, shape (V, 3)."""
    triangles: IntArray
    """Shape (t, 3)."""
    lines: IntArray
    """Shape (l, 2)."""
    line_radius: FloatArray
    """[m], shape (l,)."""
    dots: IntArray
    """Shape (D,)."""
    present: bool
    """False for a body that has not entered yet."""

    def compact(self) -> "BodyShape":
        """The same without vertices that nothing uses, such as those inside of a body that has not torn."""
        used = np.unique(np.concatenate([self.triangles.ravel(), self.lines.ravel(), self.dots]))
        if len(used) == len(self.vertices):
            return self
        kept = {name: getattr(self, name)[used] for name in ("particles", "vertices", "velocities", "colors")}
        renumbered = {
            name: np.searchsorted(used, getattr(self, name)).astype(np.int32) for name in ("triangles", "lines", "dots")
        }
        return replace(self, **kept, **renumbered, strain=None if self.strain is None else self.strain[used])


class Surfaces:
    """The drawn surfaces of a scene."""

    def __init__(self, assembly: Assembly) -> None:
        """What is drawn of the scene of an assembly."""
        look = assembly.appearance
        self._assembly, self._look = assembly, look
        self.particle_count = assembly.particle_count
        carried = np.arange(self.particle_count, self.particle_count + len(look.carried_nodes))
        self._numbers = np.concatenate([assembly.order, carried]).astype(np.int32)
        """The scene's number of every point of the appearance."""
        self._nodes = assembly.order[look.carried_nodes]
        self.body_of_particle = np.empty(self.particle_count, dtype=np.int32)
        self.body_of_particle[assembly.order] = assembly.particle_body
        filled = np.isin(np.arange(len(assembly.scene.bodies)), look.triangle_body)
        edge = ~filled[look.outline_body]
        self._lines = self._numbers[np.concatenate([look.capsules, look.outline[edge]]).reshape(-1, 2)]
        self._line_body = np.concatenate([look.capsule_body, look.outline_body[edge]])
        self._edge = edge
        self._triangles = self._numbers[look.triangles.reshape(-1, 3)]
        self.bodies = tuple(self._parts(index) for index in range(len(assembly.scene.bodies)))
        """The drawn elements of every body."""
        by = assembly.scene.render.color
        self._by = by
        self._colormap = palette.colormap(palette.COLORMAPS[by]) if by is not ColorBy.BODY else np.zeros((1, 3))
        self._top = assembly.scene.render.color_max or usual_largest(by, assembly)
        away = np.linalg.norm(assembly.positions - assembly.home.positions, axis=1)
        self._waiting = {b: 0.5 * away[assembly.particle_body == b].min() for b in assembly.plan.entering}

    def _parts(self, body: int) -> BodyParts:
        look, assembly = self._look, self._assembly
        triangle_rows = np.nonzero(look.triangle_body == body)[0]
        line_rows = np.nonzero(self._line_body == body)[0]
        balls = look.sphere_body == body
        triangles, lines = self._triangles[triangle_rows], self._lines[line_rows]
        dots = self._numbers[look.spheres[balls]]
        points = np.unique(np.concatenate([triangles.ravel(), lines.ravel(), dots])).astype(np.int32)

        def own(numbers: IntArray) -> IntArray:
            return np.searchsorted(points, numbers).astype(np.int32)

        radius = np.concatenate([look.capsule_radius, np.zeros(int(self._edge.sum()))])
        return BodyParts(
            name=assembly.scene.bodies[body].name,
            color=look.body_colors[body],
            two_sided=bool(look.body_two_sided[body]) or assembly.dimension == 2,
            points=points,
            particles=np.where(points < self.particle_count, points, -1).astype(np.int32),
            triangles=own(triangles),
            triangle_rows=triangle_rows.astype(np.int32),
            lines=own(lines),
            line_rows=line_rows.astype(np.int32),
            line_radius=radius[line_rows],
            dots=own(dots),
            dot_radius=look.sphere_radius[balls],
        )

    @property
    def point_count(self) -> int:
        """Number of particles and carried points."""
        return len(self._numbers)

    @property
    def tears(self) -> bool:
        """True where triangles and lines may go."""
        return self._look.tears

    def everywhere(self, values: FloatArray) -> FloatArray:
        """Values of particles, shape (N,) or (N, d), at all points, shape (point_count,) or (point_count, 3)."""
        if len(self._nodes):
            weights = self._look.carried_weights
            weights = weights[..., None] if values.ndim == 2 else weights
            values = np.concatenate([values, (values[self._nodes] * weights).sum(axis=1)])
        return flat_to_space(values) if values.ndim == 2 else values

    def at(self, frame: Frame) -> list[BodyShape]:
        """Every body at a frame."""
        places, velocities = self._drawn(frame), self.everywhere(frame.velocities)
        strain = None if frame.strain is None else self.everywhere(frame.strain)
        shown = self._look.shown(_marks(frame))
        lines = np.concatenate([shown.capsules, shown.outline[self._edge]])
        return [
            BodyShape(
                parts=parts,
                particles=parts.particles,
                vertices=places[parts.points],
                velocities=velocities[parts.points],
                strain=None if strain is None else strain[parts.points],
                colors=self._colors(parts, velocities, strain),
                triangles=parts.triangles[shown.triangles[parts.triangle_rows]],
                lines=parts.lines[lines[parts.line_rows]],
                line_radius=parts.line_radius[lines[parts.line_rows]],
                dots=parts.dots,
                present=self._is_present(body, frame),
            )
            for body, parts in enumerate(self.bodies)
        ]

    def _drawn(self, frame: Frame) -> FloatArray:
        """Where all points are drawn [m], shape (point_count, 3)."""
        inside = self._look.drawn_points(self._assembly.internal_order(frame.positions), _marks(frame))
        places = np.empty_like(inside)
        places[self._numbers] = inside
        return flat_to_space(places)

    def _is_present(self, body: int, frame: Frame) -> bool:
        if body not in self._waiting:
            return True
        first = int(np.argmax(self._assembly.particle_body == body))
        place = frame.positions[self._assembly.order[first]]
        return bool(np.linalg.norm(place - self._assembly.positions[first]) > self._waiting[body])

    def _colors(self, parts: BodyParts, velocities: FloatArray, strain: FloatArray | None) -> FloatArray:
        if self._by is ColorBy.BODY:
            return np.broadcast_to(parts.color, (len(parts.points), 3))
        if self._by is ColorBy.SPEED:
            values = np.linalg.norm(velocities[parts.points], axis=1)
        else:
            values = np.zeros(len(parts.points)) if strain is None else strain[parts.points]
        steps = len(self._colormap) - 1
        return np.asarray(self._colormap[np.clip(np.round(values / self._top * steps), 0, steps).astype(int)])


def _marks(frame: Frame) -> IntArray | None:
    return None if frame.torn is None else frame.torn.astype(np.int32)


def flat_to_space(vectors: FloatArray) -> FloatArray:
    """Vectors of two or three components, shape (N, d), as vectors of three, shape (N, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))
