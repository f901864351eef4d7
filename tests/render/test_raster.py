"""The visibility buffer against a brute-force rasteriser."""

import numpy as np
import taichi as ti

from sandbox.render import raster
from sandbox.render.arrays import upload, zeros
from sandbox.render.compiling import compiling
from sandbox.render.types import vec3
from sandbox.render.view import SAMPLE_X, SAMPLE_Y

WIDTH, HEIGHT, COUNT = 64, 48, 40


def test_every_sample_sees_the_nearest_triangle():
    random = np.random.default_rng(3)
    screen = np.concatenate(
        [random.uniform((-8, -8), (WIDTH + 8, HEIGHT + 8), (3 * COUNT, 2)), random.uniform(0.1, 1, (3 * COUNT, 1))], 1
    ).astype(np.float32)
    vertices, light = ti.ndarray(vec3, 3 * COUNT), ti.ndarray(vec3, 3 * COUNT)
    vertices.from_numpy(screen)
    light.from_numpy(np.full_like(screen, -100.0))
    samples = ti.ndarray(ti.u64, (HEIGHT, WIDTH, 4))
    samples.fill(0)
    is_open = upload([1], ti.i32)
    with compiling():
        raster.draw_triangles(
            False, is_open, upload(np.arange(3 * COUNT), ti.i32), upload(np.zeros(COUNT), ti.i32), is_open, vertices,
            light, samples, zeros(ti.i32, 3, 4), zeros(ti.i32, 32, 32), zeros(ti.i32, 8, 8), zeros(ti.i32, 1, 1),
        )  # fmt: skip
    keys = samples.to_numpy()
    expected, doubtful = brute_force(screen.astype(float).reshape(COUNT, 3, 3))
    identity = (keys & np.uint64(0xFFFFFFFF)).astype(int)
    assert np.array_equal(identity[~doubtful], expected[~doubtful])
    assert doubtful.mean() < 0.03 and len(np.unique(expected)) > 20


def brute_force(triangles):
    """Identity of the nearest triangle at every sample, and whether the sample is too near an edge or a tie to tell."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    sx, sy = x[..., None] + 0.5 + np.array(SAMPLE_X), y[..., None] + 0.5 + np.array(SAMPLE_Y)
    nearest, identity = np.zeros(sx.shape), np.zeros(sx.shape, dtype=int)
    doubtful = np.zeros(sx.shape, dtype=bool)
    for t, (a, b, c) in enumerate(triangles):
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        weights = []
        for p, q in ((b, c), (c, a), (a, b)):
            edge = ((q[0] - p[0]) * (sy - p[1]) - (q[1] - p[1]) * (sx - p[0])) / area
            doubtful |= np.abs(edge) * abs(area) / np.hypot(q[0] - p[0], q[1] - p[1]) < 5e-3
            weights.append(edge)
        depth = sum(w * corner[2] for w, corner in zip(weights, (a, b, c), strict=True))
        inside = np.min(weights, axis=0) >= 0
        doubtful |= inside & (np.abs(depth - nearest) < 1e-4)
        closer = inside & (depth > nearest)
        nearest, identity = np.where(closer, depth, nearest), np.where(closer, t + 1, identity)
    return identity, doubtful
