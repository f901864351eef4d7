"""Where one serial launch a frame stops being faster than a parallel launch a step.

    python benchmarks/crossover.py

The engine picks by particles + half-edges alone (SERIAL_WORK in sandbox/integrators/kick_drift.py).
"""

import statistics
import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import block, interleave
from benchmarks.springs import run
from sandbox import Simulation, runtime
from sandbox.integrators.kick_drift import SERIAL_WORK


def main() -> None:
    """Print microseconds a step for blocks of growing size."""
    runtime.start()
    print(f"{'particles':>10}{'work':>10}{'serial us':>12}{'parallel us':>12}   faster")
    for cells in (4, 7, 9, 12, 15, 19, 24, 31):
        scene = block(cells, damped=True, bracing="face")
        serial, parallel = Simulation(scene, serial=True), Simulation(scene, serial=False)
        work = serial.particle_count + 2 * serial.spring_count
        steps = max(60, 4_000_000 // work)
        times = interleave({"serial": partial(run, serial, steps), "parallel": partial(run, parallel, steps)})
        micro = {name: statistics.median(values) / steps * 1e6 for name, values in times.items()}
        faster = min(micro, key=lambda name: micro[name])
        chosen = "serial" if work <= SERIAL_WORK else "parallel"
        mark = "" if faster == chosen else f", the engine takes {chosen}"
        print(f"{serial.particle_count:10}{work:10}{micro['serial']:12.1f}{micro['parallel']:12.1f}   {faster}{mark}")
        serial.suspend(), parallel.suspend()


if __name__ == "__main__":
    main()
