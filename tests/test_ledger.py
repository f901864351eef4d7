"""The energy ledger closes, and what it leaves over is the scheme's error."""

import math

import numpy as np
import pytest

from sandbox.balance import EnergyBalance
from tests.conftest import make_scene

SMOOTH = {
    "damped rope with drag": {
        "gravity": [0.0, -9.81],
        "drag": 0.7,
        "bodies": [
            {
                "name": "rope",
                "shape": {"kind": "rope", "from": [0.0, 0.0], "to": [1.0, 0.1], "segments": 8, "thickness": 0.02},
                "material": {"stiffness": 400.0, "damping": 0.3, "mass": 0.5},
                "pin": {"indices": [0]},
            }
        ],
    },
    "gas ring in wind": {
        "drag": 0.2,
        "wind": {"velocity": [3.0, 1.0], "gust": {"strength": 1.0, "period": 0.7, "length": 1.0}},
        "bodies": [
            {
                "name": "ring",
                "velocity": [0.0, 2.0],
                "shape": {"kind": "ring", "radius": 0.5, "segments": 24},
                "material": {"stiffness": 500.0, "damping": 0.5, "mass": 2.0},
                "pressure": {"gauge_pressure": 300.0, "ambient": 1000.0},
            }
        ],
    },
    "leaking and pumped": {
        "bodies": [
            {
                "name": "ring",
                "shape": {"kind": "ring", "radius": 0.5, "segments": 24},
                "material": {"stiffness": 500.0, "damping": 0.5, "mass": 2.0},
                "pressure": {"gauge_pressure": 300.0, "ambient": 1000.0, "leak": 0.5},
            }
        ],
        "actions": [{"kind": "pump", "body": "ring", "start": 0.1, "end": 0.3, "amount": 0.1}],
    },
    "carried and yielding": {
        "gravity": [0.0, -9.81],
        "bodies": [
            {
                "name": "rope",
                "shape": {"kind": "rope", "from": [0.0, 0.0], "to": [1.0, 0.1], "segments": 8, "thickness": 0.02},
                "material": {
                    "stiffness": 400.0, "damping": 0.3, "mass": 0.5, "yield_strain": 0.01, "creep": 3.0,
                    "tension_only": True,
                },
            }
        ],
        "colliders": [
            {
                "name": "hand", "kind": "sphere", "position": [0.0, 0.5], "radius": 0.05,
                "motion": [{"time": 0.0}, {"time": 0.5, "position": [0.4, 0.7], "rotation": 90.0}],
            }
        ],
        "attachments": [{"body": "rope", "indices": [0], "to": "hand"}],
    },
}  # fmt: skip


def unexplained(simulate, name: str, integrator: str, dt: float) -> tuple[float, float]:
    """What the ledger leaves over after half a second, and what moved [J]."""
    scene = make_scene(
        dimension=2,
        solver={"integrator": integrator, "dt": dt, "precision": "f64"},
        diagnostics={"ledger": True},
        **SMOOTH[name],
    )
    simulation = simulate(scene)
    balance = EnergyBalance(simulation.measure())
    for _ in range(10):
        simulation.advance(0.05)
        balance.add(simulation.measure())
    simulation.close()
    return balance.unexplained, balance.moved


@pytest.mark.parametrize("integrator, order", [("symplectic_euler", 1), ("velocity_verlet", 2)])
@pytest.mark.parametrize("name", sorted(SMOOTH))
def test_what_is_left_over_shrinks_with_the_order_of_the_scheme(simulate, name, integrator, order):
    steps = (5e-4, 2.5e-4, 1.25e-4)
    left, moved = zip(*(unexplained(simulate, name, integrator, dt) for dt in steps), strict=True)
    assert abs(left[0]) < 0.01 * moved[0]
    if name in ("carried and yielding", "leaking and pumped"):
        # Flow is done once a step, and where springs go slack the force has a kink: that is of first order.
        order = 1
    slope = math.log(abs(left[0] / left[-1])) / math.log(steps[0] / steps[-1])
    assert slope == pytest.approx(order, abs=0.3)


def test_bounces_and_friction_are_booked(simulate):
    """A point falls onto a rough slope: what it loses is restitution and friction, to the last joule."""
    scene = make_scene(
        dimension=2,
        gravity=[0.0, -9.81],
        solver={"dt": 1e-4, "precision": "f64"},
        diagnostics={"ledger": True},
        bodies=[
            {
                "name": "point",
                "position": [0.0, 1.0],
                "velocity": [1.0, 0.0],
                "shape": {"kind": "custom", "points": [[0.0, 0.0]], "masses": [2.0]},
            }
        ],
        colliders=[{"kind": "half_space", "point": [0, 0], "normal": [0.0, 1.0], "restitution": 0.5, "friction": 0.1}],
    )
    simulation = simulate(scene)
    before = simulation.energy().total
    simulation.advance(0.5)  # one bounce, at 0.4515 s
    work = simulation.measure().work
    speed = math.sqrt(2.0 * 9.81)
    assert work["collision"] == pytest.approx(-0.5 * 2.0 * (1.0 - 0.25) * speed**2, rel=1e-3)
    tangent = 1.0 - 0.1 * 1.5 * speed
    assert work["friction"] == pytest.approx(0.5 * 2.0 * (tangent**2 - 1.0), rel=1e-3)
    assert simulation.energy().total - before == pytest.approx(sum(work.values()), rel=1e-3)


def test_collisions_of_particles_are_booked(simulate):
    def disc(name, x, velocity):
        shape = {"kind": "custom", "points": [[0.0, 0.0]], "masses": [1.0]}
        material = {"restitution": 0.5}
        return {
            "name": name, "position": [x, 0.0], "velocity": [velocity, 0.0], "radius": 0.1, "shape": shape,
            "material": material,
        }  # fmt: skip

    scene = make_scene(
        dimension=2,
        solver={"dt": 1e-3, "precision": "f64"},
        diagnostics={"ledger": True},
        bodies=[disc("a", 0.0, 1.0), disc("b", 0.5, -1.0)],
    )
    simulation = simulate(scene)
    simulation.advance(0.5)
    measured = simulation.measure()
    assert measured.work["contact"] == pytest.approx(-0.75, rel=1e-9)
    assert measured.energy.kinetic == pytest.approx(0.25, rel=1e-9)


def test_the_ledger_changes_no_bit_of_the_motion(simulate):
    results = []
    for ledger in (False, True):
        scene = make_scene(
            dimension=2,
            solver={"dt": 1e-3, "precision": "f64"},
            diagnostics={"ledger": ledger},
            **SMOOTH["gas ring in wind"],
        )
        simulation = simulate(scene)
        simulation.advance(0.3)
        results.append(simulation.positions())
        assert (simulation.measure().work is not None) == ledger
    assert np.array_equal(*results)


def test_books_survive_a_checkpoint_and_growing_lists_of_neighbours(simulate, tmp_path):
    """Many points in one place overflow the first lists: the parts are built anew, and nothing is lost."""
    rng = np.random.default_rng(1)
    shape = {"kind": "custom", "points": (0.04 * rng.random((60, 2))).tolist(), "masses": [1.0] * 60}
    scene = make_scene(
        dimension=2,
        gravity=[0.0, -9.81],
        drag=0.5,
        solver={"dt": 1e-3, "precision": "f64"},
        diagnostics={"ledger": True},
        bodies=[{"name": "points", "position": [0.0, 0.3], "radius": 0.03, "self_contact": True, "shape": shape}],
        colliders=[{"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0]}],
    )
    simulation = simulate(scene)
    roomy = simulate(scene)
    roomy._neighbours = 256
    roomy.suspend()
    for one in (simulation, roomy):
        one.advance(0.3)
    assert np.array_equal(simulation.positions(), roomy.positions())
    assert simulation.measure().work == roomy.measure().work
    simulation.save(tmp_path / "half.npz")
    resumed = type(simulation).load(tmp_path / "half.npz")
    assert resumed.measure().work == pytest.approx(simulation.measure().work)
    resumed.suspend()
