"""Springs that go slack, flow and tear."""

import numpy as np
import pytest

from tests.conftest import make_scene

STIFFNESS = 1000.0


def pulled(material: dict, speed: float = 1.0, seconds: float = 0.1, **more):
    """A spring of 1 m from a pinned point to one that a collider carries away (or towards it) at ``speed``."""
    end = [1.0 + speed * seconds, 0.0]
    return make_scene(
        dimension=2,
        duration=seconds,
        solver={"dt": 1e-4, "precision": "f64"},
        diagnostics={"ledger": True},
        bodies=[
            {
                "name": "spring",
                "shape": {
                    "kind": "custom",
                    "points": [[0.0, 0.0], [1.0, 0.0]],
                    "springs": [[0, 1]],
                    "masses": [1.0, 1.0],
                    "pinned": [0],
                },
                "material": {"stiffness": STIFFNESS, **material},
            }
        ],
        colliders=[
            {
                "name": "hand",
                "kind": "sphere",
                "position": [1.0, 0.0],
                "radius": 0.01,
                "interpolation": "linear",
                "motion": [{"time": 0.0}, {"time": seconds, "position": end}],
            }
        ],
        attachments=[{"body": "spring", "indices": [1], "to": "hand"}],
        **more,
    )


def test_ideal_plasticity_keeps_what_is_beyond_yield(simulate):
    simulation = simulate(pulled({"yield_strain": 0.02}))
    simulation.advance(0.1)
    # Pulled to 1.1 m: the elastic strain stays at yield, the rest is in the rest length.
    assert simulation.memory["springs0.rest_length"][0] == pytest.approx(1.08, abs=2e-4)
    assert simulation.energy().elastic == pytest.approx(0.5 * STIFFNESS * 0.02**2, rel=0.02)
    # The work of plastic flow is the yield force times the plastic way.
    assert simulation.measure().work["plastic"] == pytest.approx(-STIFFNESS * 0.02 * 0.08, rel=0.02)


def test_compression_flows_too_but_not_in_a_rope(simulate):
    pushed = simulate(pulled({"yield_strain": 0.02}, speed=-1.0))
    rope = simulate(pulled({"yield_strain": 0.02, "tension_only": True}, speed=-1.0))
    for simulation in (pushed, rope):
        simulation.advance(0.1)
    assert pushed.memory["springs0.rest_length"][0] == pytest.approx(0.92, abs=2e-4)
    assert rope.memory["springs0.rest_length"][0] == 1.0
    assert rope.energy().elastic == 0.0


def test_creep_is_exact_in_time_for_any_step(simulate):
    # Held at strain 0.1 - 0 plastic: the excess decays as exp(-creep t).
    results = []
    for dt in (1e-3, 1e-2):
        scene = pulled({"yield_strain": 0.02, "creep": 5.0}, seconds=1e-6, speed=1e5)
        simulation = simulate(scene)
        simulation.advance(1e-6)
        simulation.dt = dt
        simulation.advance(0.2)
        results.append(simulation.memory["springs0.rest_length"][0])
    expected = 1.0 + 0.08 * (1.0 - np.exp(-5.0 * 0.2))
    assert results == pytest.approx([expected, expected], abs=1e-5)


def test_plastic_strain_has_its_bound(simulate):
    simulation = simulate(pulled({"yield_strain": 0.02, "max_plastic_strain": 0.05}))
    simulation.advance(0.1)
    assert simulation.memory["springs0.rest_length"][0] == 1.05
    assert simulation.energy().elastic == pytest.approx(0.5 * STIFFNESS * 0.05**2, rel=1e-6)


def test_a_spring_tears_at_its_strain_and_its_energy_is_booked(simulate):
    simulation = simulate(pulled({"break_strain": 0.05}))
    simulation.advance(0.049)
    assert simulation.measure().torn == 0
    simulation.advance(0.002)
    measured = simulation.measure()
    assert measured.torn == 1
    assert measured.energy.elastic == 0.0
    assert measured.work["tearing"] == pytest.approx(-0.5 * STIFFNESS * 0.05**2, rel=0.01)
    assert simulation.stable_dt() == np.inf  # nothing is left that could oscillate


def test_what_springs_remember_survives_a_checkpoint_bit_for_bit(simulate, tmp_path):
    material = {"yield_strain": 0.01, "creep": 20.0, "break_strain": 0.3, "damping": 1.0}
    scene = pulled(material, speed=2.0, seconds=0.2)
    straight = simulate(scene)
    straight.advance(0.1)
    straight.save(tmp_path / "half.npz")
    resumed = type(straight).load(tmp_path / "half.npz")
    for simulation in (straight, resumed):
        simulation.advance(0.1)
    assert straight.measure().torn == 1
    for name, values in straight.memory.items():
        # Sums of work are cut in two by the checkpoint, which may show in their last bit.
        assert np.allclose(values, resumed.memory[name], rtol=0.0 if name.startswith("springs") else 1e-12, atol=0.0)
    assert np.array_equal(straight.positions(), resumed.positions())
    resumed.restore()
    assert resumed.measure().torn == 0
    assert resumed.memory["springs0.rest_length"][0] == 1.0
    resumed.suspend()


def test_behaviours_live_in_laws_of_their_own(simulate):
    """A scene with a plain, a yielding and a slack rope: three laws, and each rope does as if it were alone."""

    def rope(name, x, **material):
        shape = {"kind": "rope", "from": [x, 0.0], "to": [x + 1.0, 0.0], "segments": 8, "thickness": 0.02}
        return {
            "name": name,
            "shape": shape,
            "material": {"stiffness": 500.0, "damping": 0.2, "mass": 0.2, **material},
            "pin": {"indices": [0]},
        }

    ropes = [rope("plain", 0.0), rope("yields", 2.0, yield_strain=0.01), rope("slack", 4.0, tension_only=True)]
    scenes = [
        make_scene(dimension=2, gravity=[0.0, -9.81], solver={"dt": 5e-4, "precision": "f64"}, bodies=bodies)
        for bodies in (ropes, *([one] for one in ropes))
    ]
    together, *alone = [simulate(scene) for scene in scenes]
    assert len([law for law in together.laws if hasattr(law, "strain_on")]) == 3
    for simulation in (together, *alone):
        simulation.advance(0.5)
    assert np.array_equal(together.positions(), np.concatenate([one.positions() for one in alone]))


def test_a_slack_rope_has_no_energy_and_no_force(simulate):
    scene = pulled({"tension_only": True, "damping": 5.0}, speed=-2.0)
    simulation = simulate(scene)
    simulation.advance(0.05)
    measured = simulation.measure()
    assert measured.energy.elastic == 0.0
    assert measured.work["damping"] == 0.0
    assert measured.max_strain == 0.0
