"""Actions as scenes have them: those that are there from the start, and how runs go on from the middle of them."""

import numpy as np
import pytest

from sandbox import Simulation
from tests.conftest import make_scene

_HAND = {"kind": "grab", "start": 0.1, "end": 0.6, "point": [0.5, 0.5], "path": [{"time": 0.4, "position": [1.0, 0.8]}]}
_BLADE = {"kind": "cut", "start": 0.2, "end": 0.5, "from": [0.1, -0.6], "to": [0.1, 0.9]}


def _scene(*actions, dt=1e-3, precision="f64", **more):
    box = {"kind": "box", "size": [1.0, 1.0], "cells": [4, 4]}
    bodies = [{"name": "box", "shape": box, "material": {"youngs_modulus": 1e4, "mass": 10.0, "damping_ratio": 0.1}}]
    return make_scene(
        **{"dimension": 2, "solver": {"dt": dt, "precision": precision}, "bodies": bodies, "actions": actions} | more
    )


def _ring(name="ring", **more):
    shape = {"kind": "ring", "radius": 0.3, "segments": 16}
    return {"name": name, "shape": shape, "material": {"stiffness": 2e3, "mass": 0.5, "damping_ratio": 0.2}} | more


def test_the_middle_of_everything_is_saved(simulate, tmp_path):
    """Hands, pushes, blades, pins and stiffness go on from a checkpoint to the same bits."""
    push = {"kind": "push", "start": 0.1, "end": 0.4, "body": "box", "force": [3.0, 1.0]}
    shake = {"kind": "shake", "start": 0.2, "end": 0.6, "amplitude": [0.01, 0.0], "frequency": 3.0}
    stiffen = {"kind": "stiffen", "start": 0.1, "end": 0.5, "factor": 2.0}
    pin = {"kind": "pin", "time": 0.25, "body": "box", "indices": [0, 3]}
    scene = _scene(_HAND, _BLADE, push, shake, stiffen, pin, dt="auto", precision="f32")
    whole = simulate(scene)
    whole.advance(0.3)
    whole.save(tmp_path / "middle.npz")
    whole.advance(0.4)
    again = Simulation.load(tmp_path / "middle.npz")
    again.advance(0.4)
    assert again.state_hash() == whole.state_hash()
    assert again.measure().torn == whole.measure().torn > 0
    again.restore()
    again.advance(0.3)
    again.advance(0.4)
    assert again.state_hash() == whole.state_hash()
    again.suspend()


@pytest.mark.parametrize("serial", [True, False])
def test_threads_change_nothing(simulate, serial):
    hashes = set()
    for threads in (1, 2):
        simulation = simulate(_scene(_HAND, _BLADE, precision="f32"), threads=threads, serial=serial)
        simulation.advance(0.5)
        hashes.add(simulation.state_hash())
        simulation.suspend()
    assert len(hashes) == 1


def test_a_body_that_enters_is_not_there_before(simulate):
    """It waits far away without moving, with its gas as it is, and then flies as if it had been thrown there."""
    ring = _ring(position=[0.0, 2.0], velocity=[1.0, 0.0], pressure={"gauge_pressure": 20.0})
    scene = _scene(
        {"kind": "spawn", "time": 0.3, "body": "ring"},
        gravity=[0.0, -10.0],
        bodies=[*_scene().model_dump(exclude_none=True)["bodies"], ring],
        diagnostics={"ledger": True},
        solver={"dt": 1e-3, "precision": "f64", "integrator": "velocity_verlet"},
    )
    verlet = {"dt": 1e-3, "precision": "f64", "integrator": "velocity_verlet"}
    alone = simulate(_scene(gravity=[0.0, -10.0], bodies=[ring], solver=verlet))
    alone.advance(0.2)
    expected = alone.positions()
    alone.suspend()
    simulation = simulate(scene)
    simulation.advance(0.3)
    assert (np.linalg.norm(simulation.positions()[25:], axis=1) > 50.0).all()
    assert not simulation.velocities()[25:].any()
    simulation.advance(0.2)
    assert simulation.positions()[25:] == pytest.approx(expected, abs=1e-9)
    measured = simulation.measure()
    first = measured.energy.total - sum(measured.work.values())
    simulation.restore()
    assert first == pytest.approx(simulation.energy().total, rel=1e-4)


def test_keyframes_lead_colliders_and_pinned_particles(simulate):
    tray = {"name": "tray", "kind": "box", "position": [0.0, -1.0], "size": [4.0, 1.0]}
    pinned = {"region": {"min": [-0.6, 0.4], "max": [0.6, 0.6]}}
    bodies = _scene().model_dump(exclude_none=True)["bodies"]
    scene = _scene(
        {"kind": "move", "collider": "tray", "path": [{"time": 0.5, "position": [0.0, -0.8]}]},
        {"kind": "move", "body": "box", "path": [{"time": 0.5, "position": [0.3, 0.7]}], "interpolation": "linear"},
        bodies=[bodies[0] | {"pin": pinned}],
        colliders=[tray],
    )
    simulation = simulate(scene)
    top = simulation.positions()[:, 1] > 0.45
    before = simulation.positions()[top]
    simulation.advance(0.25)
    assert simulation.positions()[top] == pytest.approx(before + np.array([0.15, 0.1]), abs=1e-12)
    assert simulation.velocities()[top] == pytest.approx(np.broadcast_to([0.6, 0.4], before.shape), abs=1e-12)
    simulation.advance(0.5)
    assert simulation.positions()[top] == pytest.approx(before + np.array([0.3, 0.2]), abs=1e-12)
    assert simulation.assembly.scene.colliders[0].motion


def test_who_is_led_can_be_let_go(simulate):
    pinned = {"region": {"min": [-0.6, 0.4], "max": [0.6, 0.6]}}
    bodies = _scene().model_dump(exclude_none=True)["bodies"]
    lead = {"kind": "move", "body": "box", "path": [{"time": 2.0, "position": [4.0, 0.5]}], "interpolation": "linear"}
    free = simulate(_scene(lead, {"kind": "unpin", "time": 0.5, "body": "box"}, bodies=[bodies[0] | {"pin": pinned}]))
    free.advance(0.5)
    thrown = free.momentum()[0]
    free.advance(0.5)
    assert free.momentum()[0] == pytest.approx(thrown, rel=0.2)
    assert free.momentum()[0] > 10.0
    assert free.positions()[:, 0].mean() > 0.3


def test_a_breeze_blows_between_its_times(simulate):
    scene = _scene({"kind": "wind", "start": 0.2, "end": 0.4, "velocity": [5.0, 0.0]}, bodies=[_ring()])
    simulation = simulate(scene)
    momenta = []
    for _ in range(4):
        simulation.advance(0.2)
        momenta.append(simulation.momentum()[0])
    assert momenta[0] == 0.0
    # The air that blew stands still afterwards, and slows down what flies through it.
    assert momenta[1] > momenta[2] > momenta[3] > 0.1


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ({"kind": "grab", "start": 1.0, "end": 0.5, "point": [0, 0]}, "actions[0]: end must be later than start"),
        (
            {"kind": "cut", "time": 0.1, "point": [0, 0]},
            "actions[0]: give a plane (point, normal) or a blade (from, to)",
        ),
        (
            {"kind": "cut", "start": 0.1, "point": [0, 0], "normal": [1, 0]},
            "actions[0]: give either time, or start and",
        ),
        ({"kind": "cut", "time": 0.1, "from": [0, 0], "to": [1, 0], "sweep": [0, 1]}, "actions[0].sweep: is for 3D"),
        ({"kind": "push", "start": 0, "end": 1, "force": [0, 1]}, "actions[0]: give body, region, or point and radius"),
        ({"kind": "move", "collider": "x", "path": [{"time": 1.0}]}, "actions[0].collider: there is no collider 'x'"),
        (
            {"kind": "move", "body": "box", "path": [{"time": 1.0}]},
            "'box' has no particles that are pinned from the st",
        ),
        ({"kind": "spawn", "time": 1.0, "body": "nobody"}, "actions[0].body: there is no body 'nobody'"),
        ({"kind": "soften", "time": 1.0, "factor": 2.0}, "actions[0].factor: must be <= 1, got 2"),
        ({"kind": "pin", "time": 1.0, "body": "box", "indices": [99]}, "actions[0].indices: there is no particle 99"),
        ({"kind": "tickle", "time": 1.0}, "actions[0]: kind must be one of"),
    ],
)
def test_what_does_not_fit_is_one_line(refuses, tmp_path, action, message):
    import tomli_w

    data = _scene().model_dump(mode="json", exclude_none=True)
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(data | {"actions": [action]}))
    refuses(message, "validate", tmp_path / "scene.toml")
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(data))
    (tmp_path / "acts.toml").write_text(tomli_w.dumps({"actions": [action]}))
    refuses(message, "run", tmp_path / "scene.toml", "--actions", tmp_path / "acts.toml", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
