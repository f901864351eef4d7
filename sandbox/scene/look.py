"""What of a scene is drawn, and the box of the world that a picture should hold."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.appearance import Appearance
from sandbox.scene.insides import Inside, find_inside
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.model import HalfSpace, Scene
from sandbox.scene.shapes import Geometry, lengths
from sandbox.scene.spring_set import SpringSet

# Okabe and Ito's colour-blind safe palette, reordered so that neighbours differ most.
PALETTE = ("#E8604C", "#3D9BE0", "#F2B134", "#2FB58A", "#B678D8", "#6BC8E8", "#E88AAE", "#8C9A3C")

_STRUT_RADIUS = 0.08  # of the typical spring length
_BALL_RADIUS = 0.16


def build_appearance(
    scene: Scene,
    geometries: Sequence[Geometry],
    positions: FloatArray,
    internal: NDArray[np.int64],
    springs: SpringSet,
    can_tear: bool,
    radii: FloatArray,
) -> Appearance:
    """Drawable elements in internal particle indices. ``positions`` are in scene order [m], springs internal.

    ``radii`` are those of the bodies' particles [m], shape (B,). Where springs ``can_tear``, by themselves or by being
    cut, the insides of bodies are among the elements.
    """
    first = np.cumsum([0] + [len(g.points) for g in geometries])
    element = _element_size(geometries)

    carried_first = np.cumsum([len(positions)] + [len(g.carried_nodes) for g in geometries])
    # A body's own points by their internal indices, then its carried ones, which come after all particles.
    numbers = [
        np.concatenate([internal[a:b], np.arange(c, c + len(g.carried_nodes))])
        for g, a, b, c in zip(geometries, first, first[1:], carried_first, strict=False)
    ]

    def gather(name: str, width: int) -> tuple[IntArray, IntArray]:
        rows = [getattr(g, name) for g in geometries]
        bodies = np.repeat(np.arange(len(rows), dtype=np.int32), [len(r) for r in rows])
        indices = [own[r.reshape(-1, width).astype(np.int64)] for r, own in zip(rows, numbers, strict=True)]
        return np.concatenate(indices).astype(np.int32), bodies

    triangles, triangle_body = gather("triangles", 3)
    outline, outline_body = gather("outline", 2)
    rods = "springs" if scene.render.struts else "capsules"
    capsules, capsule_body = gather(rods, 2)
    inside: Inside | None = None
    if can_tear:
        is_bare = [bool(scene.render.particles or scene.render.struts or g.show_particles) for g in geometries]
        inside = find_inside(geometries, [getattr(g, rods) for g in geometries], numbers, springs.ends, is_bare)
        triangles = np.concatenate([triangles, inside.triangles])
        triangle_body = np.concatenate([triangle_body, inside.triangle_body])
        outline = np.concatenate([outline, inside.outline])
        outline_body = np.concatenate([outline_body, inside.outline_body])
    shown = [
        np.arange(len(g.points)) if scene.render.particles or g.show_particles else np.zeros(0, int) for g in geometries
    ]
    spheres = np.concatenate([s + offset for s, offset in zip(shown, first, strict=False)])
    sphere_body = np.repeat(np.arange(len(shown), dtype=np.int32), [len(s) for s in shown])
    rod = np.array([g.capsule_radius or _STRUT_RADIUS * element for g in geometries])
    bead = np.where(radii > 0.0, radii, _BALL_RADIUS * element)
    carried_nodes, carried_weights = _carried(geometries, first, internal)
    return Appearance(
        dimension=scene.dimension,
        triangles=triangles,
        triangle_body=triangle_body,
        outline=outline,
        outline_body=outline_body,
        capsules=capsules,
        capsule_radius=rod[capsule_body],
        capsule_body=capsule_body,
        spheres=internal[spheres].astype(np.int32),
        sphere_radius=bead[sphere_body],
        sphere_body=sphere_body,
        body_colors=np.array([_rgb(b.color or PALETTE[i % len(PALETTE)]) for i, b in enumerate(scene.bodies)]),
        body_two_sided=np.array([g.two_sided for g in geometries]),
        colliders=scene.colliders,
        bounds=_expected_bounds(scene, positions, first)
        + np.array([[-1.0], [1.0]]) * bead[sphere_body].max(initial=0.0),
        element_size=element,
        particle_count=len(positions),
        carried_nodes=carried_nodes,
        carried_weights=carried_weights,
        body_radius=radii,
        cells=None if inside is None else inside.cells,
    )


def _carried(
    geometries: Sequence[Geometry], first: NDArray[np.int64], internal: NDArray[np.int64]
) -> tuple[IntArray, FloatArray]:
    """Nodes and weights of all carried points; bodies of fewer nodes a point are filled with weight 0."""
    width = max(g.carried_nodes.shape[1] for g in geometries)
    nodes = [np.zeros((0, width), dtype=np.int64)]
    weights = [np.zeros((0, width))]
    for geometry, offset in zip(geometries, first, strict=False):
        missing = ((0, 0), (0, width - geometry.carried_nodes.shape[1]))
        nodes.append(internal[np.pad(geometry.carried_nodes, missing, mode="edge").astype(np.int64) + offset])
        weights.append(np.pad(geometry.carried_weights, missing))
    return np.concatenate(nodes).astype(np.int32), np.concatenate(weights)


def _rgb(color: str) -> tuple[float, float, float]:
    red, green, blue = (int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


def _element_size(geometries: Sequence[Geometry]) -> float:
    joined = [lengths(g.points, g.springs) for g in geometries if len(g.springs)]
    if joined and (typical := float(np.median(np.concatenate(joined)))) > 0.0:
        return typical
    extent = max(float(np.ptp(g.points, axis=0).max()) for g in geometries)
    return 0.1 * extent or 0.1


def _expected_bounds(scene: Scene, positions: FloatArray, first: NDArray[np.int64]) -> FloatArray:
    """World box that bodies are likely to move in [m], shape (2, d): pinned ones swing, free ones fall."""
    corners = [positions]
    for index, body in enumerate(scene.bodies):
        own = positions[first[index] : first[index + 1]]
        if body.pin is None and not getattr(body.shape, "pinned", ()):
            corners.append(own + _fall(scene, own))
        else:
            reach = np.ptp(own, axis=0).max()
            corners.append(own - reach * _up(scene))
    both = np.concatenate(corners)
    low, high = both.min(axis=0), both.max(axis=0)
    pad = 0.02 * float((high - low).max()) + 1e-3
    return np.stack([low - pad, high + pad])


def _up(scene: Scene) -> FloatArray:
    gravity = np.zeros(scene.dimension) if scene.gravity is None else np.asarray(scene.gravity)
    strength = float(np.linalg.norm(gravity))
    return -gravity / strength if strength > 0.0 else gravity


def _fall(scene: Scene, points: FloatArray) -> FloatArray:
    """How far a body moves until it meets a half-space, or over the run if there is none [m], shape (d,)."""
    gravity = np.zeros(scene.dimension) if scene.gravity is None else np.asarray(scene.gravity)
    strength = float(np.linalg.norm(gravity))
    if strength == 0.0:
        return gravity
    way = gravity / strength
    extent = float(np.ptp(points, axis=0).max())
    distance = min(0.5 * strength * scene.duration**2, 4.0 * extent + 2.0)
    for collider in scene.colliders:
        if isinstance(collider, HalfSpace):
            normal = np.asarray(collider.normal) / np.linalg.norm(collider.normal)
            approach = -float(normal @ way)
            if approach > 1e-6:
                gap = float(((points - np.asarray(collider.point)) @ normal).min())
                distance = min(distance, max(0.0, gap) / approach)
    return way * distance
