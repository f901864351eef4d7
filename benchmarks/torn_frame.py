"""What it costs to draw a jelly that can tear: whole, and cut in two, against one that cannot.

python benchmarks/torn_frame.py [--cells 16] [--rounds 40]
"""

import argparse
import statistics

import numpy as np
import taichi as ti

from benchmarks.common import interleave
from sandbox import load_scene, runtime
from sandbox.render.software import SoftwareRenderer
from sandbox.scene.assemble import assemble
from sandbox.scene.model import Scene

NORMAL = np.array([0.27, 0.91, 0.18])
"""Of the plane of the cut, through the middle of the cube."""


def jelly(cells: int, **material: float) -> Scene:
    """The preset, of as many cells along an edge."""
    changes = {f"bodies.0.material.{name}": value for name, value in material.items()}
    return load_scene("jelly", overrides={"bodies.0.shape.cells": [cells] * 3, **changes})


def field_of(positions: np.ndarray) -> ti.Field:
    """Positions [m], shape (particle_count, 3), as a renderer reads them."""
    field = ti.Vector.field(3, ti.f32, shape=(1, len(positions)))
    field.from_numpy(positions[None].astype(np.float32))
    return field


def measure(cells: int, rounds: int) -> None:
    """Print the time of a picture of each kind, and what it is of that of a jelly that cannot tear."""
    plain, tearing = assemble(jelly(cells)), assemble(jelly(cells, break_strain=0.5))
    positions, ends = plain.positions, tearing.spring_set.ends
    front = (positions - positions.mean(axis=0)) @ NORMAL > 0.01
    whole, cut = (ti.field(ti.i32, tearing.spring_count) for _ in range(2))
    cut.from_numpy((front[ends[:, 0]] != front[ends[:, 1]]).astype(np.int32))
    together, apart = field_of(positions), field_of(positions + 0.3 * front[:, None] * NORMAL)
    renderers = [SoftwareRenderer(one.appearance, one.scene.render) for one in (plain, plain, tearing, tearing)]
    times = interleave(
        {
            "cannot tear": lambda: renderers[0].draw(together, 0),
            "cannot tear, stretched": lambda: renderers[1].draw(apart, 0),
            "can tear": lambda: renderers[2].draw(together, 0, torn=whole),
            "cut in two": lambda: renderers[3].draw(apart, 0, torn=cut),
        },
        rounds,
    )
    triangles = len(tearing.appearance.triangles), len(plain.appearance.triangles)
    print(f"{cells}^3 cells, {triangles[1]} triangles outside, {triangles[0] - triangles[1]} inside")
    first = statistics.median(times["cannot tear"])
    for name, values in times.items():
        median = statistics.median(values)
        print(f"  {name:24s} {1e3 * median:6.1f} ms   {median / first:5.2f}")


def main() -> None:
    """Measure the preset, and one of eight times as many cells."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="*", default=[16, 32])
    parser.add_argument("--rounds", type=int, default=40)
    options = parser.parse_args()
    runtime.start(arch="cpu", precision="f32")
    for cells in options.cells:
        measure(cells, options.rounds)


if __name__ == "__main__":
    main()
