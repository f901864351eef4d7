"""What the benchmarks share: a block of springs as a scene, interleaved timing, one line of results."""

import statistics
import time
from collections.abc import Callable

from sandbox import Scene
from sandbox.scene.load import scene_from_data


def block(cells: int, *, damped: bool, bracing: str = "body") -> Scene:
    """A free cube of (cells + 1)^3 particles: springs alone, no gravity, no colliders."""
    material = {"stiffness": 1000.0, "mass": 1000.0, "damping": 0.1 if damped else 0.0}
    shape = {"kind": "box", "size": [1.0, 1.0, 1.0], "cells": [cells] * 3, "bracing": bracing}
    return scene_from_data(
        {
            "dimension": 3,
            "solver": {"dt": 1e-5},
            "bodies": [{"name": "block", "shape": shape, "material": material, "velocity": [0.1, 0.0, 0.0]}],
        },
        None,
    )


def interleave(candidates: dict[str, Callable[[], object]], rounds: int = 15) -> dict[str, list[float]]:
    """Seconds of every call, taken in turns, so that a slow spell of the machine meets all alike."""
    for run in candidates.values():
        run()  # compiles
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, run in candidates.items():
            start = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - start)
    return times


def middle(values: list[float]) -> str:
    """Median, and the range of the middle half."""
    low, _, high = statistics.quantiles(values, n=4)
    return f"{statistics.median(values):8.1f} ({low:.1f} to {high:.1f})"
