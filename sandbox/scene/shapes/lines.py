"""Ropes and rings: chains of particles, open and closed."""

import numpy as np

from sandbox.scene.lattice import IntArray
from sandbox.scene.model import Ring, Rope
from sandbox.scene.shapes.geometry import Geometry, generate, lengths, no_elements
from sandbox.scene.shapes.triangles import counter_clockwise


@generate.register
def _rope(shape: Rope, dimension: int) -> Geometry:
    along = np.linspace(0.0, 1.0, shape.segments + 1)[:, None]
    points = (1.0 - along) * np.asarray(shape.start) + along * np.asarray(shape.end)
    springs = np.stack([np.arange(shape.segments), np.arange(1, shape.segments + 1)], axis=1).astype(np.int32)
    share = np.full(len(points), 1.0 / shape.segments)
    share[[0, -1]] *= 0.5
    length = float(np.linalg.norm(np.subtract(shape.end, shape.start)))
    area = shape.thickness if dimension == 2 else np.pi / 4.0 * shape.thickness**2
    with np.errstate(divide="ignore"):
        scale = np.full(shape.segments, area * shape.segments / np.float64(length))
    return Geometry(
        points=points,
        springs=springs,
        rest_lengths=lengths(points, springs),
        spring_scale=scale,
        mass_share=share,
        volume=area * length,
        capsules=springs,
        capsule_radius=0.5 * shape.thickness,
        membrane=True,
    )


@generate.register
def _ring(shape: Ring, dimension: int) -> Geometry:
    count = shape.segments
    angles = 2.0 * np.pi * np.arange(count) / count
    points = shape.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    edges = np.stack([np.arange(count), np.roll(np.arange(count), -1)], axis=1).astype(np.int32)
    bend = _ring_bend_springs(count) if shape.bend > 0.0 else no_elements(2)
    springs = np.concatenate([edges, bend])
    ratio = np.repeat([1.0, shape.bend], [count, len(bend)])
    rest = lengths(points, springs)
    # Both kinds of springs share the wall's tension: all stretched alike, they store what the wall would.
    wall = shape.thickness * rest[:count].sum()
    return Geometry(
        points=points,
        springs=springs,
        rest_lengths=rest,
        spring_scale=ratio * wall / (ratio * rest**2).sum(),
        spring_ratio=ratio if shape.bend > 0.0 else None,
        mass_share=np.full(count, 1.0 / count),
        volume=float(wall),
        triangles=counter_clockwise(points, _strip(count)),
        outline=edges,
        membrane=True,
    )


def _ring_bend_springs(count: int) -> IntArray:
    """Springs that skip one particle of a ring, each once, shape (B, 2); a triangle has none."""
    if count == 3:
        return no_elements(2)
    # In a square the springs from opposite corners are the same.
    start = np.arange(2 if count == 4 else count)
    return np.stack([start, (start + 2) % count], axis=1).astype(np.int32)


def _strip(count: int) -> IntArray:
    """Zig-zag triangles between both sides of a ring, shape (count - 2, 3); they depend on no single point."""
    order = np.zeros(count, dtype=np.int32)
    order[1::2] = np.arange(1, count // 2 + 1)
    order[2::2] = np.arange(count - 1, count // 2, -1)
    return np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
