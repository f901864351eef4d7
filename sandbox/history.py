"""What was noticed of a simulation on its way, beyond its state: for a run that goes on in another process."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from sandbox.simulation import Simulation
from sandbox.step_size import Rescue


def history(simulation: Simulation) -> dict[str, Any]:
    """Warnings and what leads to them, rescues, and how steps went so far, as plain data."""
    watch, energy = simulation.watch, simulation.energy_watch
    return {
        "warnings": simulation.warning_log.memory(),
        "watch": None if watch is None else watch.memory(),
        "energy_scale": None if energy is None else energy.scale,
        "rescues": [asdict(rescue) for rescue in simulation.rescues],
        "tallies": [field.to_numpy().tolist() for field in simulation.tallies],
    }


def recall(simulation: Simulation, earlier: Mapping[str, Any]) -> None:
    """Let a simulation of the same scene, at the state of then, go on from what :func:`history` gave.

    Raises KeyError, TypeError or ValueError where that is none.
    """
    for field, values in zip(simulation.tallies, earlier["tallies"], strict=True):
        field.from_numpy(np.array(values, dtype=field.to_numpy().dtype).reshape(field.shape))
    simulation.rescues[:] = [Rescue(**rescue) for rescue in earlier["rescues"]]
    if simulation.energy_watch is not None:
        simulation.energy_watch.scale = float(earlier["energy_scale"])
    if simulation.watch is not None:
        simulation.watch.remember(earlier["watch"])
    simulation.warning_log.remember(earlier["warnings"])
