"""Heavy bodies on light ones: known before the run, borne at the automatic step, and told where no step will do."""

import numpy as np
import pytest

from sandbox import SceneWarning
from sandbox.contact.particle_contact import PUSH
from sandbox.contact_limits import elastic_share, worst_load
from sandbox.scene.assemble import assemble
from sandbox.warning_log import WarningKind
from tests.conftest import make_scene

FLOOR = {"kind": "half_space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]}
G = 9.81


def _column(*masses, dt="auto", gravity=(0.0, -G, 0.0), gap=0.0, **more):
    """Points of radius 0.1 m, one on the other on a floor."""
    bodies = [
        {
            "name": f"point {number}",
            "radius": 0.1,
            "shape": {"kind": "custom", "points": [[0.0, 0.1 + number * (0.2 + gap), 0.0]], "masses": [mass]},
        }
        for number, mass in enumerate(masses)
    ]
    solver = {"dt": dt, "integrator": more.pop("integrator", "symplectic_euler")}
    return make_scene(
        dimension=3, duration=2.0, gravity=list(gravity), bodies=bodies, colliders=[FLOOR], solver=solver, **more
    )


@pytest.mark.parametrize(("masses", "integrator"), [((1.0, 130.0), "symplectic_euler"), ((1.0, 900.0), "rk4")])
def test_a_heavy_one_stays_above_a_light_one(simulate, masses, integrator):
    simulation = simulate(_column(*masses, integrator=integrator))
    gaps = []
    for _ in range(20):
        simulation.advance(0.1)
        x = simulation.positions()
        gaps.append(float(x[1, 1] - x[0, 1]))
    assert min(gaps) > 0.1
    assert gaps[-1] == pytest.approx(0.2, abs=0.05)
    assert simulation.warnings == []


def test_the_step_is_that_at_which_the_overlap_is_a_quarter():
    load = worst_load(assemble(_column(1.0, 400.0)))
    assert load is not None
    assert (load.heavy, load.light) == ("point 1", "point 0")
    # At rest an overlap d pushes with PUSH m d / dt^2; on arrival it goes 1.75 times as deep.
    assert 400.0 * G * load.step**2 / (PUSH * 1.0) * 1.75 == pytest.approx(0.25 * 0.2)
    assert not load.too_heavy
    light_on_heavy = worst_load(assemble(_column(400.0, 1.0)))
    assert light_on_heavy is not None
    assert light_on_heavy.step == pytest.approx(load.step)  # nobody knows before which one will be on top


@pytest.mark.parametrize("scene", [_column(1.0, 400.0, gravity=(0.0, 0.0, 0.0)), _column(1.0)])
def test_what_does_not_press_asks_for_nothing(scene):
    assert worst_load(assemble(scene)) is None


def test_bodies_of_many_particles_share_a_load():
    def block(name, height, density):
        shape = {"kind": "box", "size": [0.3, 0.3, 0.3], "cells": [9, 9, 9]}
        material = {"youngs_modulus": 1e5, "density": density}
        place = [0.0, height, 0.0]
        return {"name": name, "radius": 0.02, "position": place, "shape": shape, "material": material}

    bodies = [block("low", 0.2, 1000.0), block("high", 0.6, 3000.0)]
    scene = make_scene(dimension=3, gravity=[0.0, -G, 0.0], bodies=bodies, colliders=[FLOOR])
    load = worst_load(assemble(scene))
    assert load is not None
    # 81 kg on a quarter of a face of 100 particles, the lightest of which is the eighth of a cell of 37 g.
    corner = 27.0 / 9**3 / 8.0
    assert load.ratio == pytest.approx(81.0 * G / 25.0 / corner, rel=1e-6)


@pytest.mark.filterwarnings("ignore::sandbox.SceneWarning")
@pytest.mark.parametrize(
    ("masses", "dt", "told"),
    [((1.0, 5000.0), "auto", "at any step"), ((1.0, 130.0), 4e-3, "steps up to"), ((1.0, 130.0), 1e-3, None)],
)
def test_what_cannot_be_borne_is_told_before_the_run(simulate, masses, dt, told):
    simulation = simulate(_column(*masses, dt=dt))
    lines = [line for line in simulation.warnings if "lie on" in line]
    assert len(lines) == (told is not None)
    if told is not None:
        assert told in lines[0]
        assert "'point 1' may come to lie on 'point 0'" in lines[0]
        assert WarningKind.OVERLOADED in simulation.warning_log.kinds()
        with pytest.warns(SceneWarning, match="may come to lie on"):
            simulate(_column(*masses, dt=dt))


@pytest.mark.filterwarnings("ignore::sandbox.SceneWarning")
def test_particles_deep_in_each_other_are_told_of(simulate):
    deep = simulate(_column(1.0, 5000.0))
    deep.advance(1.0)
    assert deep.measure().max_overlap > 0.5
    assert WarningKind.OVERLAPPING in deep.warning_log.kinds()
    assert deep.measure().max_overlap == pytest.approx(1.0 - np.ptp(deep.positions()[:, 1]) / 0.2, abs=1e-5)
    shallow = simulate(_column(1.0, 2.0))
    shallow.advance(1.0)
    assert 0.0 <= shallow.measure().max_overlap < 0.1
    assert shallow.warnings == []


def _falling(integrator, restitution, dt):
    shape = {"kind": "box", "size": [0.2, 0.2], "cells": [3, 3]}
    material = {"youngs_modulus": 1e5, "density": 1000.0, "damping_ratio": 0.01}
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "restitution": restitution}
    body = {"name": "block", "position": [0.0, 0.5], "shape": shape, "material": material}
    solver = {"integrator": integrator, "dt": dt}
    return make_scene(dimension=2, gravity=[0.0, -G], bodies=[body], colliders=[floor], solver=solver)


@pytest.mark.filterwarnings("ignore::sandbox.SceneWarning")
@pytest.mark.parametrize(
    ("integrator", "restitution", "dt", "told"),
    [
        ("implicit_euler", 0.5, 1e-2, True),
        ("xpbd", 0.5, 1e-2, True),
        ("vbd", 0.5, 5e-3, True),
        ("implicit_euler", 0.0, 1e-2, False),
        ("implicit_euler", 0.5, 2e-4, False),
        ("implicit_midpoint", 0.5, 1e-2, False),
        ("symplectic_euler", 0.5, 5e-4, False),
    ],
)
def test_a_bounce_that_the_scheme_damps_is_told(simulate, integrator, restitution, dt, told):
    kinds = simulate(_falling(integrator, restitution, dt)).warning_log.kinds()
    assert (WarningKind.IMPLICIT_BOUNCE in kinds) == told


@pytest.mark.filterwarnings("ignore::sandbox.SceneWarning")
@pytest.mark.parametrize(
    ("integrator", "restitution", "dt", "told"),
    [
        ("implicit_midpoint", 1.0, 4e-3, True),
        ("implicit_midpoint", 1.0, 1e-5, False),
        ("implicit_midpoint", 0.5, 4e-3, False),
        ("velocity_verlet", 1.0, 1e-5, False),
    ],
)
def test_a_bounce_that_may_gain_energy_is_told(simulate, integrator, restitution, dt, told):
    lines = simulate(_falling(integrator, restitution, dt)).warnings
    assert [line for line in lines if "may gain energy where they bounce" in line] == lines
    assert len(lines) == told


@pytest.mark.parametrize(("restitution", "damping", "share"), [(1.0, 0.0, 0.02), (0.6, 0.0, 1.0), (1.0, 0.1, 1.0)])
def test_only_bounces_without_loss_ask_for_short_steps(restitution, damping, share):
    scene = _falling("symplectic_euler", restitution, "auto")
    material = scene.bodies[0].material.model_copy(update={"damping_ratio": damping})
    body = scene.bodies[0].model_copy(update={"material": material})
    got = elastic_share(assemble(scene.model_copy(update={"bodies": (body,)})))
    assert got == pytest.approx(share) if share < 1.0 else got >= 1.0
