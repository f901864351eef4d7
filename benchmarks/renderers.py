"""Times pictures of presets by the software renderer and by GGUI, taken in turns.

Run `python benchmarks/renderers.py [--size 1280x720] [--pictures 15]`. Medians, and the range of the middle half, in
milliseconds; and the time from asking for a renderer to its first picture with kernels cached, in seconds. What the
Vulkan driver runs on decides: say so with the figures.
"""

import argparse
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import interleave, middle
from sandbox import Simulation, load_scene
from sandbox.render import Renderer, RendererName, create_renderer

PRESETS = ("jelly", "cloth", "pile", "tower", "boxes_2d")
NAMES = (RendererName.TAICHI, RendererName.GGUI)
MOMENT = 0.5
"""Simulated time of the picture [s]."""


def draw(renderer: Renderer, simulation: Simulation) -> np.ndarray:
    """One picture."""
    state = simulation.state
    return renderer.draw(state.x, state.slot, None, simulation.time, simulation.torn)


def open_renderer(name: str, simulation: Simulation) -> tuple[Renderer, float]:
    """A renderer, and the time to its first picture [s]."""
    start = time.perf_counter()
    renderer = create_renderer(name, simulation.assembly.appearance, simulation.scene.render)
    draw(renderer, simulation)
    return renderer, time.perf_counter() - start


def measure(preset: str, size: tuple[int, int], pictures: int) -> None:
    """Print one preset."""
    simulation = Simulation(load_scene(preset, overrides={"render.size": list(size)}))
    simulation.advance(MOMENT)
    opened = {}
    for name in NAMES:
        open_renderer(name, simulation)[0].close()  # compiles
        opened[name] = open_renderer(name, simulation)
    times = interleave({name: partial(draw, opened[name][0], simulation) for name in NAMES}, pictures)
    for name in NAMES:
        renderer, start = opened[name]
        print(f"{preset:10s} {name:8s} {middle([1e3 * t for t in times[name]])} ms   first after {start:.2f} s")
        renderer.close()


def main() -> None:
    """Measure all presets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--pictures", type=int, default=15)
    options = parser.parse_args()
    width, height = (int(part) for part in options.size.split("x"))
    for preset in PRESETS:
        measure(preset, (width, height), options.pictures)


if __name__ == "__main__":
    main()
