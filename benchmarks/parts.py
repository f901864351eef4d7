"""What a part costs where it is switched on, and that it costs nothing where it is not.

    python benchmarks/parts.py

For the `jelly` preset, and for it with one part more at a time: the kernels that a picture launches,
and the time of a step next to that of the plain preset, measured in turns in the same process.
"""

import collections
import copy
import sys
import time
from statistics import median
from typing import Any

import sandbox
from sandbox.runtime import ti
from sandbox.scene.load import find_scene, read_toml, scene_from_data

ROUNDS = 7
STEPS = 40

WIND = {"velocity": [1.0, 0.0, 0.0]}
GUSTS = {**WIND, "gust": {"strength": 0.5}}
NEVER = 1e3
HAND = {"kind": "grab", "start": 0.0, "end": NEVER, "point": [0.0, 1.6, 0.0]}
PUSH = {"kind": "push", "start": 0.0, "end": NEVER, "body": "jelly", "force": [1.0, 0.0, 0.0]}
CUT = {"kind": "cut", "time": NEVER, "point": [0.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}
SHELL = {
    "name": "shell", "position": [5.0, 5.0, 0.0],
    "shape": {"kind": "shell", "radius": 0.3, "subdivisions": 2},
    "material": {"stiffness": 50.0, "mass": 1.0},
    "pressure": {"gauge_pressure": 100.0},
}  # fmt: skip


def variants() -> dict[str, dict[str, Any]]:
    """The preset as data, plain and with one part more."""
    plain = read_toml(find_scene("jelly"))

    def jelly(change: Any) -> dict[str, Any]:
        data = copy.deepcopy(plain)
        change(data, data["bodies"][0])
        # The same step for all, so that only the work of a step differs.
        data["solver"] = {"dt": 3e-4}
        return data

    moving = {"kind": "sphere", "position": [4.0, 1.0, 0.0], "radius": 0.2,
              "motion": [{"time": 0.0}, {"time": 9.0, "position": [4.0, 2.0, 0.0]}]}  # fmt: skip
    rod = {"kind": "capsule", "from": [4.0, 0.0, 0.0], "to": [4.0, 1.0, 0.0], "radius": 0.1}
    return {
        "plain": jelly(lambda data, body: None),
        "energy ledger": jelly(lambda data, body: data.update(diagnostics={"ledger": True})),
        "plasticity": jelly(lambda data, body: body["material"].update(yield_strain=NEVER)),
        "tearing": jelly(lambda data, body: body["material"].update(break_strain=NEVER)),
        "tension only": jelly(lambda data, body: body["material"].update(tension_only=True)),
        "bend springs": jelly(lambda data, body: body["shape"].update(bend=0.1)),
        "wind": jelly(lambda data, body: (data.update(wind=WIND), body.update(wind=True))),
        "wind with gusts": jelly(lambda data, body: (data.update(wind=GUSTS), body.update(wind=True))),
        "capsule collider": jelly(lambda data, body: data["colliders"].append(rod)),
        "moving collider": jelly(lambda data, body: data["colliders"].append(moving)),
        "self-contact": jelly(lambda data, body: body.update(radius=0.02, self_contact=True)),
        "a hand": jelly(lambda data, body: data.update(actions=[HAND])),
        "a push": jelly(lambda data, body: data.update(actions=[PUSH])),
        "a cut to come": jelly(lambda data, body: data.update(actions=[CUT])),
        "room to be played with": jelly(lambda data, body: data.update(interaction={})),
        "a shell with gas beside it": jelly(lambda data, body: data["bodies"].append(SHELL)),
        "the same shell without gas": jelly(
            lambda data, body: data["bodies"].append({k: v for k, v in SHELL.items() if k != "pressure"})
        ),
    }


class Launches:
    """Counts kernel launches by name while it is open."""

    def __enter__(self) -> "Launches":
        self.names: collections.Counter[str] = collections.Counter()
        self.original = ti.lang.kernel_impl.Kernel.__call__

        def call(kernel: Any, *args: Any, **kwargs: Any) -> Any:
            self.names[kernel.func.__qualname__] += 1
            return self.original(kernel, *args, **kwargs)

        ti.lang.kernel_impl.Kernel.__call__ = call
        return self

    def __exit__(self, *_: Any) -> None:
        ti.lang.kernel_impl.Kernel.__call__ = self.original


def main() -> None:
    chosen = {name: data for name, data in variants().items() if len(sys.argv) < 2 or name in ("plain", *sys.argv[1:])}
    simulations = {}
    for name, data in chosen.items():
        simulations[name] = sandbox.Simulation(scene_from_data(data, None))
        simulations[name].advance(simulations[name].dt * STEPS)
    times: dict[str, list[float]] = collections.defaultdict(list)
    for _ in range(ROUNDS):
        for name, simulation in simulations.items():
            start = time.perf_counter()
            simulation.advance(simulation.dt * STEPS)
            times[name].append((time.perf_counter() - start) / STEPS)
    base = median(times["plain"])
    for name, simulation in simulations.items():
        with Launches() as launches:
            simulation.advance(simulation.dt * STEPS)
        ratio = median(one / other for one, other in zip(times[name], times["plain"], strict=True))
        print(f"{name}: {1e3 * ratio * base:.3f} ms a step, {ratio:.2f} of plain")
        print("    " + ", ".join(f"{count} {kernel}" for kernel, count in sorted(launches.names.items())))


if __name__ == "__main__":
    main()
