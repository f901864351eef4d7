"""Sweeps of vertex block descent: one serial launch a frame, against a parallel launch a colour.

    python benchmarks/vbd_sweep.py

The engine picks by particles + half-edges alone (VBD_SERIAL_WORK in sandbox/integrators/vbd.py).
"""

import statistics
import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import block, interleave
from sandbox import Scene, Simulation, runtime
from sandbox.integrators.vbd import VBD_SERIAL_WORK

SWEEPS = 10
STEP = 1.0 / 240.0


def main() -> None:
    """Print millions of springs a second and sweep for blocks of growing size."""
    runtime.start()
    print(f"{'particles':>10}{'springs':>10}{'work':>10}{'serial':>10}{'parallel':>10}   faster (million springs/s)")
    for cells in (4, 9, 15, 23, 31, 47):
        scene = swept(block(cells, damped=True))
        serial, parallel = Simulation(scene, serial=True), Simulation(scene, serial=False)
        springs = serial.spring_count
        work = serial.particle_count + 2 * springs
        steps = max(1, 1_000_000 // work)
        times = interleave({"serial": partial(run, serial, steps), "parallel": partial(run, parallel, steps)}, 5)
        # The round that measures the residual counts as a sweep.
        rate = {name: springs * steps * (SWEEPS + 1) / statistics.median(t) / 1e6 for name, t in times.items()}
        faster = max(rate, key=lambda name: rate[name])
        chosen = "serial" if work <= VBD_SERIAL_WORK else "parallel"
        mark = "" if faster == chosen else f", the engine takes {chosen}"
        rates = f"{rate['serial']:10.1f}{rate['parallel']:10.1f}"
        print(f"{serial.particle_count:10}{springs:10}{work:10}{rates}   {faster}{mark}", flush=True)
        serial.suspend(), parallel.suspend()


def swept(scene: Scene) -> Scene:
    """The same scene for this scheme."""
    solver = {"integrator": "vbd", "dt": STEP, "iterations": SWEEPS}
    return scene.model_copy(update={"solver": scene.solver.model_validate(solver)})


def run(simulation: Simulation, steps: int) -> None:
    """Some steps, without looking at the state in between."""
    simulation._wake().stepper.advance(steps, STEP, 0.0)


if __name__ == "__main__":
    main()
