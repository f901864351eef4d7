"""What Taichi's analysis of control flow costs and brings.

    python benchmarks/compiling.py [ROUNDS]

For some scenes, schemes and the renderer, with it and without it: the time until the first picture is simulated with
nothing compiled before, and the time of later pictures. In processes of their own, in turns; medians and ratios. The
sandbox keeps it, though scenes with many colliders would compile several times as soon without: kernels are rounded
otherwise then, and contact no longer comes to the bits of its all-pairs twin (tests/contact).
"""

import json
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import sandbox
from sandbox import runtime
from sandbox.render import create_renderer

CASES = (
    ("jelly", "symplectic_euler"), ("boxes_2d", "symplectic_euler"), ("boxes_2d", "rk4"), ("cloth", "symplectic_euler"),
    ("jelly", "implicit_euler"), ("balloon", "vbd"), ("balloon", "xpbd"), ("pile", "symplectic_euler"),
)  # fmt: skip
PICTURES = 8


def measure(scene: str, integrator: str, analyses: bool) -> dict[str, float]:
    """Times of one case in this process [s]."""
    start = runtime.ti.init

    def init(**options: object) -> None:
        start(**options | {"cfg_optimization": analyses, "offline_cache": False})

    runtime.ti.init = init
    begun = time.perf_counter()
    simulation = sandbox.Simulation(sandbox.load_scene(scene, overrides={"solver.integrator": integrator}))
    simulation.step_frame()
    simulation.measure()
    compiled = time.perf_counter() - begun
    steps = []
    for _ in range(PICTURES):
        begun = time.perf_counter()
        simulation.step_frame()
        steps.append(time.perf_counter() - begun)
    begun = time.perf_counter()
    renderer = create_renderer("taichi", simulation.assembly.appearance, simulation.scene.render)
    renderer.draw(simulation.state.x, simulation.state.slot)
    drawn = time.perf_counter() - begun
    draws = []
    for _ in range(PICTURES):
        begun = time.perf_counter()
        renderer.draw(simulation.state.x, simulation.state.slot)
        draws.append(time.perf_counter() - begun)
    return {"first": compiled, "picture": median(steps), "first drawn": drawn, "draw": median(draws)}


def main() -> None:
    """Measure every case in turns."""
    if len(sys.argv) > 3:
        print(json.dumps(measure(sys.argv[1], sys.argv[2], sys.argv[3] == "with")))
        return
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    print(f"{'':30}" + "".join(f"{name:>26}" for name in ("first [s]", "picture [ms]", "first drawn [s]", "draw [ms]")))
    for scene, integrator in CASES:
        found: dict[str, list[dict[str, float]]] = {"with": [], "without": []}
        for _ in range(rounds):
            for how, times in found.items():
                command = [sys.executable, __file__, scene, integrator, how]
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                times.append(json.loads(done.stdout.splitlines()[-1]))
        line = f"{scene + ' ' + integrator:30}"
        for name, scale in (("first", 1.0), ("picture", 1e3), ("first drawn", 1.0), ("draw", 1e3)):
            a, b = (median(times[name] for times in found[how]) for how in ("with", "without"))
            line += f"{scale * a:9.3g} {scale * b:7.3g} ({b / a:4.2f})"
        print(line, flush=True)


if __name__ == "__main__":
    main()
