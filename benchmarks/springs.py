"""Whole steps of a spring lattice: gathering (this engine) against scattering with atomics, interleaved.

    python benchmarks/springs.py

Prints million springs a second. The large block is stepped by parallel launches, the small one in
one serial launch a frame; both also the other way, for comparison.
"""

import statistics
import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from benchmarks.common import block, interleave, middle
from benchmarks.scatter import Scatter
from sandbox import Simulation, runtime

DT = 1e-5


def run(simulation: Simulation, steps: int) -> None:
    """Steps alone, without the checks that frames come with."""
    simulation._wake().stepper.advance(steps, DT, 0.0)
    runtime.ti.sync()


def agree(simulation: Simulation, twin: Scatter) -> None:
    """Both compute the same motion, or the comparison is worth nothing."""
    simulation.restore()
    run(simulation, 20)
    twin.advance(20, DT)
    assert np.allclose(simulation._read()[0], twin.x.to_numpy(), atol=1e-5)


def compare(cells: int, steps: int, rounds: int) -> None:
    """One block, undamped and damped: scatter, parallel and serial gather in turns."""
    for damped in (False, True):
        scene = block(cells, damped=damped)
        parallel, serial = Simulation(scene, serial=False), Simulation(scene, serial=True)
        twin = Scatter(parallel.assembly, damped)
        agree(parallel, twin)
        candidates = {
            "scatter with atomics": partial(twin.advance, steps, DT),
            "gather, a parallel launch a step": partial(run, parallel, steps),
            "gather, one serial launch": partial(run, serial, steps),
        }
        times = interleave(candidates, rounds)
        report(f"{cells + 1}^3, {'damped' if damped else 'undamped'}", times, parallel.spring_count * steps)


def main() -> None:
    """Print the table."""
    runtime.start()
    print(f"{'':44}{'million springs/s':>28}   against scatter")
    compare(cells=31, steps=40, rounds=15)
    compare(cells=9, steps=100, rounds=31)


def report(title: str, times: dict[str, list[float]], springs: int) -> None:
    reference = times["scatter with atomics"]
    for name, values in times.items():
        rates = [springs / value / 1e6 for value in values]
        ratio = statistics.median(r / v for r, v in zip(reference, values, strict=True))
        print(f"{title:16}{name:32}{middle(rates):>28}   {ratio:5.1f}x")


if __name__ == "__main__":
    main()
