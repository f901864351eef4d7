"""Every kind of scheme meets every feature that presets have: in a few pictures of two of them.

The balloons are flat: gas, a pump, and contact of bodies, on a polygon. The tissue is a sheet in space that yields and
tears, which moving colliders carry; wind is added to it here.
"""

import numpy as np
import pytest

from sandbox import Simulation, load_scene
from sandbox.balance import EnergyBalance

PRESETS = {"balloons_2d": {}, "tissue": {"wind": {"velocity": [0.0, 0.0, 2.0]}}}
LOSS = {"rk4": 0.01, "implicit_midpoint": 0.03, "implicit_euler": 0.6, "vbd": 0.6, "xpbd": 0.6}
"""Most energy that a scheme may take out by its own error, as part of what moved [1]: what solves implicit Euler damps
the vibrations of balloons that are let go; none may put any in."""
GAIN = 0.01
# The balloons meet all schemes; tissue, which takes long to compile, those that solve by Newton and by descent.
PAIRS = [("balloons_2d", scheme) for scheme in LOSS] + [("tissue", "implicit_euler"), ("tissue", "vbd")]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "integrator"), PAIRS)
def test_a_preset_begins_well_by_another_scheme_and_its_ledger_closes(name, integrator):
    overrides = {"solver.integrator": integrator, "diagnostics.ledger": True, **PRESETS[name]}
    with Simulation(load_scene(name, overrides=overrides)) as simulation:
        balance = EnergyBalance(simulation.measure())
        for _ in range(3):
            simulation.step_frame()
            balance.add(simulation.measure())
        measured = simulation.measure()
        assert np.isfinite(simulation.positions()).all() and np.isfinite(simulation.velocities()).all()
        assert 0.0 < measured.max_strain < 0.1 and measured.max_penetration < 1e-4
        assert -LOSS[integrator] * balance.moved < balance.unexplained < GAIN * balance.moved
