"""Sweeps of XPBD over all springs: one serial launch for all steps against a launch a colour, by size.

    python benchmarks/xpbd_sweep.py

The engine picks by particles + half-edges alone (SERIAL_WORK in sandbox/integrators/xpbd.py).
"""

import statistics
import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import block, interleave
from sandbox import Scene, Simulation, runtime
from sandbox.integrators.xpbd import SERIAL_WORK

DT = 1e-3
ITERATIONS = 10


def solved(cells: int) -> Scene:
    """The block of the other benchmarks, by XPBD."""
    scene = block(cells, damped=True, bracing="face")
    solver = {"integrator": "xpbd", "dt": DT, "iterations": ITERATIONS}
    return type(scene).model_validate({**scene.model_dump(exclude_unset=True), "solver": solver})


def run(simulation: Simulation, steps: int) -> None:
    """Steps alone, without the checks that frames come with."""
    simulation._wake().stepper.advance(steps, DT, 0.0)
    runtime.ti.sync()


def main() -> None:
    """Print million springs a second for blocks of growing size."""
    runtime.start()
    print(f"{'particles':>10}{'work':>10}{'colours':>9}{'serial':>9}{'parallel':>10}   million springs/s   faster")
    for cells in (4, 9, 15, 24, 31, 40):
        scene = solved(cells)
        serial, parallel = Simulation(scene, serial=True), Simulation(scene, serial=False)
        work = serial.particle_count + 2 * serial.spring_count
        steps = max(1, 1_000_000 // work)
        times = interleave({"serial": partial(run, serial, steps), "parallel": partial(run, parallel, steps)}, rounds=7)
        swept = serial.spring_count * steps * ITERATIONS / 1e6
        rates = {name: swept / statistics.median(values) for name, values in times.items()}
        faster = max(rates, key=lambda name: rates[name])
        chosen = "serial" if work <= SERIAL_WORK else "parallel"
        mark = "" if faster == chosen else f", the engine takes {chosen}"
        colours = len(serial._wake().stepper.constraints[0].first) - 1
        print(
            f"{serial.particle_count:10}{work:10}{colours:9}{rates['serial']:9.1f}{rates['parallel']:10.1f}"
            f"{'':23}{faster}{mark}"
        )
        serial.suspend(), parallel.suspend()


if __name__ == "__main__":
    main()
