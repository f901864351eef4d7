"""Every preset runs headless and ends as its description says.

A check gets the simulation at its end, the measurement of every picture, and the positions of every
picture in the scene's order.
"""

import numpy as np
import pytest

from sandbox import Simulation, load_scene, preset_paths
from sandbox.balance import EnergyBalance
from sandbox.scene.assemble import assemble
from tests.presets.checks_a import CHECKS_A
from tests.presets.checks_b import CHECKS_B
from tests.presets.checks_c import CHECKS_C


def test_the_clamps_of_surgery_have_no_free_particle_inside():
    """It would be pushed out in the first step, with a strain of a fifth and energy from nothing."""
    assembly = assemble(load_scene("surgery"))
    free = assembly.positions[assembly.inverse_masses > 0.0]
    for clamp in assembly.scene.colliders[1:]:
        away = np.abs(free - np.asarray(clamp.position)) - 0.5 * np.asarray(clamp.size)
        assert (away > 0.0).any(axis=1).all()


def jelly_rests_on_the_ground(simulation: Simulation, history: list, snapshots: list) -> None:
    heights = simulation.positions()[:, 1]
    assert heights.min() > -1e-5
    assert 0.9 < heights.max() < 1.05  # it is back to a cube of 1 m, lying on a face
    assert simulation.measure().max_speed < 0.3
    assert max(measured.max_strain for measured in history) > 0.1  # and was well squashed on the way


def rope_hangs_from_its_pin(simulation: Simulation, history: list, snapshots: list) -> None:
    positions = simulation.positions()
    assert np.allclose(positions[0], [-0.55, 1.95, 0.0], atol=1e-6)
    assert simulation.measure().max_penetration < 1e-4
    assert simulation.measure().max_strain < 0.05
    assert positions[1:, 1].max() < 2.05


def boxes_lie_on_the_ground(simulation: Simulation, history: list, snapshots: list) -> None:
    assert simulation.measure().max_penetration < 1e-4
    assert simulation.positions()[:, 1].min() < 1e-3
    # Each body is in one piece: its area is what it was within a tenth.
    assembly = simulation.assembly
    triangles = assembly.appearance.triangles
    areas = []
    for points in (assembly.positions, assembly.internal_order(simulation.positions())):
        ab, ac = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
        twice = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
        areas.append(np.bincount(assembly.appearance.triangle_body, 0.5 * twice))
    assert areas[1] == pytest.approx(areas[0], rel=0.1)


CHECKS = {
    "jelly": jelly_rests_on_the_ground,
    "rope": rope_hangs_from_its_pin,
    "drop_2d": boxes_lie_on_the_ground,
    **CHECKS_A,
    **CHECKS_B,
    **CHECKS_C,
}


def test_every_preset_has_a_check():
    assert set(CHECKS) == set(preset_paths())


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(CHECKS))
def test_preset_ends_well_and_its_ledger_closes(name):
    # The ledger changes no bit of the motion (tests/test_ledger.py), so one run serves both.
    scene = load_scene(name, overrides={"diagnostics.ledger": True})
    with Simulation(scene) as simulation:
        assert simulation.dt < simulation.initial_stable_dt
        balance = EnergyBalance(simulation.measure())
        history, snapshots = [], []
        while simulation.time < scene.duration - 1e-9:
            simulation.step_frame()
            history.append(simulation.measure())
            snapshots.append(simulation.positions())
            balance.add(history[-1])
        CHECKS[name](simulation, history, snapshots)
        assert abs(balance.unexplained) < 0.01 * balance.moved
