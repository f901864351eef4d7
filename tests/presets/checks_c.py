"""What must be true of the presets tug, surgery and pump_up, in which something is done to bodies.

A check takes the simulation at its end, a measurement and the positions [m] of every picture.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sandbox import Simulation
from sandbox.diagnostics import Measurement
from tests.presets.checks_b import Check, Positions, _centres, _particles, _picture


def _pieces(simulation: Simulation) -> tuple[int, np.ndarray]:
    """Number of pieces that springs hold together, and the piece of every particle in the scene's order."""
    assembly = simulation.assembly
    ends = assembly.order[assembly.springs[simulation.torn.to_numpy() == 0]]
    joined = coo_array((np.ones(len(ends)), ends.T), shape=(assembly.particle_count,) * 2)
    count, piece = connected_components(joined, directed=False)
    return int(count), piece


def jelly_is_in_two(simulation: Simulation, history: Sequence[Measurement], snapshots: Sequence[Positions]) -> None:
    scored = history[_picture(simulation, 0.5)].torn
    assert 0 < scored == history[_picture(simulation, 1.0)].torn < history[-1].torn
    assert history[_picture(simulation, 1.5)].work["action"] > 0.0
    _, piece = _pieces(simulation)
    halves = np.argsort(np.bincount(piece))[-2:]
    sizes = np.bincount(piece)[halves] / len(piece)
    assert sizes.min() > 0.3 and sizes.sum() > 0.9
    centres = [simulation.positions()[piece == half].mean(axis=0) for half in halves]
    assert np.linalg.norm(centres[0] - centres[1]) > 1.2
    assert max(centre[1] for centre in centres) < 0.4
    assert simulation.measure().max_penetration < 1e-3


def wound_is_open(simulation: Simulation, history: Sequence[Measurement], snapshots: Sequence[Positions]) -> None:
    torn = [history[_picture(simulation, time)].torn for time in (1.0, 1.5, 1.95, 2.65, 3.25, 5.9)]
    assert torn[0] == 0 and all(later > earlier for earlier, later in itertools.pairwise(torn[:5]))
    assert torn[5] == torn[4]
    start = snapshots[0]
    lips = [(np.abs(start[:, 0] - side * 0.05) < 0.03) & (np.abs(start[:, 2]) < 0.2) for side in (-1.0, 1.0)]

    def gape(time: float) -> float:
        x = snapshots[_picture(simulation, time)][:, 0]
        return float(x[lips[1]].mean() - x[lips[0]].mean())

    assert gape(1.0) < 0.15 < gape(3.3) < gape(4.6)
    assert gape(4.6) > 0.4
    assert simulation.positions()[:, 1].min() > 0.1  # the clamps still hold it


def beam_rises_and_tilts(
    simulation: Simulation, history: Sequence[Measurement], snapshots: Sequence[Positions]
) -> None:
    beam = _particles(simulation)["beam"]
    height = _centres(snapshots, beam)[:, 1]
    flat, lifted = height[_picture(simulation, 0.8)], height[_picture(simulation, 4.6)]
    assert lifted > flat + 0.08
    left, right = beam[simulation.positions()[beam, 0] < -0.8], beam[simulation.positions()[beam, 0] > 0.8]
    ends = [simulation.positions()[end, 1].mean() for end in (left, right)]
    assert ends[0] + 0.1 < ends[1]
    assert simulation.measure().max_penetration < 5e-3


CHECKS_C: dict[str, Check] = {"tug": jelly_is_in_two, "surgery": wound_is_open, "pump_up": beam_rises_and_tilts}
