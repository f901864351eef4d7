"""Times the software renderer: start, first frame, and the stages of a frame, for a wobbling jelly cube.

Run `python benchmarks/render_frame.py [--size 1280x720] [--frames 60]`. Medians and minima, in milliseconds.
"""

import argparse
import itertools
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.render import palette, raster, shade, tiles, vertices
from sandbox.render.software import SoftwareRenderer
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import HalfSpace, Render

STAGES = (
    (vertices, "place_vertices"),
    (raster, "draw_triangles"),
    (tiles, "choose_tiles"),
    (shade, "shade_tiles"),
    (tiles, "restore_shadow_map"),
)
SLOTS = 8


def cube_surface(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (count, 3) of the surface of a unit cube around the origin, and its outward triangles."""
    steps = np.arange(cells + 1) / cells - 0.5
    points, triangles = [], []
    for axis, side in itertools.product(range(3), (-0.5, 0.5)):
        first, second = np.meshgrid(steps, steps, indexing="ij")
        face = np.empty((first.size, 3))
        face[:, axis], face[:, (axis + 1) % 3], face[:, (axis + 2) % 3] = side, first.ravel(), second.ravel()
        i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
        a = (i * (cells + 1) + j).ravel() + len(points) * len(face)
        quads = np.stack([a, a + cells + 1, a + cells + 2, a + 1], axis=1)
        halves = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        points.append(face)
        triangles.append(halves if side > 0 else halves[:, ::-1])
    merged, inverse = np.unique(np.round(np.concatenate(points), 9), axis=0, return_inverse=True)
    return merged, inverse.ravel()[np.concatenate(triangles)].astype(np.int32)


def wobbling(points: np.ndarray, phase: float) -> np.ndarray:
    """The cube standing on an edge, swaying, above the ground."""
    angle = np.radians(38.0)
    turned = points @ np.array(
        [[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    turned[:, 0] += 0.06 * np.sin(5.0 * turned[:, 1] + phase)
    turned[:, 1] += 0.95 + 0.1 * np.sin(phase)
    return turned


def cube_appearance(triangles: np.ndarray) -> Appearance:
    """One body over the ground."""
    none, pairs = np.zeros(0, dtype=np.int32), np.zeros((0, 2), dtype=np.int32)
    ground = HalfSpace(kind="half_space", point=(0.0, 0.0, 0.0), normal=(0.0, 1.0, 0.0))
    return Appearance(
        dimension=3, triangles=triangles, triangle_body=np.zeros(len(triangles), dtype=np.int32), outline=pairs,
        outline_body=none, capsules=pairs, capsule_radius=np.zeros(0), capsule_body=none, spheres=none,
        sphere_radius=np.zeros(0), sphere_body=none, body_colors=palette.body_palette(1),
        body_two_sided=np.array([False]), colliders=(ground,), bounds=np.array([[-0.8, 0.0, -0.7], [0.8, 1.8, 0.7]]),
        element_size=1 / 16, particle_count=int(triangles.max()) + 1,
        carried_nodes=np.zeros((0, 1), dtype=np.int32), carried_weights=np.zeros((0, 1)),
    )  # fmt: skip


def timed(call: Callable[..., Any], record: list[float]) -> Callable[..., Any]:
    """`call`, waiting for its kernels and writing down how long that took [ms]."""

    def wrapper(*arguments: Any) -> Any:
        start = time.perf_counter()
        result = call(*arguments)
        ti.sync()
        record.append((time.perf_counter() - start) * 1e3)
        return result

    return wrapper


def measure(cells: int, size: tuple[int, int], frames: int) -> None:
    """Print the times of one cube."""
    points, triangles = cube_surface(cells)
    rows = np.stack([wobbling(points, 2 * np.pi * k / SLOTS) for k in range(SLOTS)]).astype(np.float32)
    field = ti.Vector.field(3, ti.f32, rows.shape[:2])
    field.from_numpy(rows)
    ti.sync()
    start = time.perf_counter()
    renderer = SoftwareRenderer(cube_appearance(triangles), Render(size=size))
    ti.sync()
    created = time.perf_counter()
    renderer.draw(field, 0)
    drawn = time.perf_counter()
    print(f"\n{len(triangles)} triangles, {size[0]}x{size[1]}")
    print(f"  create {created - start:.2f} s, first frame {drawn - created:.2f} s (with compiling, or loading kernels)")
    record: dict[str, list[float]] = defaultdict(list)
    draw = timed(renderer.draw, record["frame"])
    for k in range(frames):
        draw(field, k % SLOTS)
    # Stages apart, since waiting after each makes the frame slower.
    originals = [(module, name, getattr(module, name)) for module, name in STAGES]
    for module, name, kernel in originals:
        setattr(module, name, timed(kernel, record[name]))
    for k in range(frames):
        renderer.draw(field, k % SLOTS)
    for module, name, kernel in originals:
        setattr(module, name, kernel)
    for name, times in record.items():
        print(f"  {name:20s} median {np.median(times):6.2f} ms   min {np.min(times):6.2f} ms")
    renderer.close()


def main() -> None:
    """Measure a cube of 17^3 particles, and one of about 19,000 triangles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--threads", type=int, default=None)
    options = parser.parse_args()
    width, height = (int(part) for part in options.size.split("x"))
    runtime.start(arch="cpu", precision="f32", threads=options.threads)
    for cells in (16, 40):
        measure(cells, (width, height), options.frames)


if __name__ == "__main__":
    main()
