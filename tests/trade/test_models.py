"""What could be left out of scenes, how runs on different lattices are compared, and what the study says of both."""

import contextlib
import json
import math
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest

from sandbox.errors import SceneError
from sandbox.scene.assemble import assemble
from sandbox.scene.model import Scene
from sandbox.trade import models, norms
from sandbox.trade.correspondence import correspondence, mapped
from sandbox.trade.measure import Options
from sandbox.trade.record import ENERGIES, Record
from sandbox.trade.reference import Cache
from sandbox.trade.store import Store
from sandbox.trade.variants import Change, coarser_shape, find_variants, variants
from tests.conftest import falling_point, make_scene

MATERIAL = {"stiffness": 50.0, "mass": 1.0}
BY_MODULUS = {"youngs_modulus": 1e5, "density": 500.0}


def body(kind, material=MATERIAL, **more):
    shape = {"kind": kind, **SHAPES[kind]}
    return {"name": kind, "shape": shape, "material": material, **more}


SHAPES = {
    "box": {"size": [0.3, 0.2, 0.4], "cells": [4, 3, 5]},
    "ball": {"radius": 0.2, "cells": 6},
    "sheet": {"size": [1.0, 0.5], "cells": [7, 4]},
    "shell": {"radius": 0.3, "subdivisions": 2},
    "rope": {"from": [0.0, 0.0, 0.0], "to": [1.0, 0.5, -0.2], "segments": 9},
    "ring": {"radius": 0.5, "segments": 31},
    "polygon": {"points": [[0, 0], [1, 0], [1, 0.4], [0.4, 0.4], [0.4, 1], [0, 1]], "spacing": 0.1},
    "tower": {"levels": 3, "height": 1.0, "width": 0.3},
}
FLAT = ("ring", "polygon")


def scene_of(*kinds, material=MATERIAL, **more):
    dimension = 2 if kinds[0] in FLAT else 3
    turn = 25.0 if dimension == 2 else [20.0, -40.0, 65.0]
    bodies = [
        body(kind, material, position=[0.2, 3.0 * row, 0.1][:dimension], rotation=turn)
        for row, kind in enumerate(kinds)
    ]
    return make_scene(dimension=dimension, bodies=bodies, **more)


def by_name(scene):
    return {variant.name: variant for variant in variants(scene)}


# -- which variants there are -----------------------------------------------------------------------------


def test_only_what_a_scene_has_is_left_out():
    assert list(by_name(falling_point())) == ["f32"]
    plain = scene_of("box", material={"stiffness": 100.0, "mass": 1.0, "damping": 0.0})
    assert list(by_name(plain)) == ["f64", "no shear springs", "coarser"]


def everything():
    """A scene with all that can be left out."""
    material = {"stiffness": 200.0, "mass": 1.0, "damping": 0.5, "yield_strain": 0.1, "creep": 2.0, "break_strain": 1.0}
    sheets = [
        body("sheet", material, name=name, position=[0.0, y, 0.0], radius=0.02, self_contact=True)
        for name, y in (("low", 1.0), ("high", 1.2))
    ]
    for sheet in sheets:
        sheet["shape"] = {**sheet["shape"], "bend": 0.1}
    ground = {"kind": "half_space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "friction": 0.5}
    corner = {"min": [-0.6, 0.9, -0.3], "max": [-0.4, 1.1, 0.3]}
    return make_scene(
        dimension=3,
        drag=0.3,
        gravity=[0.0, -9.81, 0.0],
        bodies=sheets,
        colliders=[ground],
        diagnostics={"ledger": True},
        attachments=[{"body": "low", "to": "high", "region": corner, "damping": 0.2, "break_strain": 2.0}],
        wind={"velocity": [1.0, 0.0, 0.0], "start": 0.5, "gust": {"strength": 0.5}},
    )


def test_every_part_can_be_left_out_of_all_bodies_at_once():
    found = by_name(everything())
    assert list(found) == [
        "no spring damping", "no plasticity", "no tearing", "no self-contact", "no particle contact",
        "contact skin x2", "contact skin x0.5", "no collider friction", "no drag", "no wind", "no gusts", "no ledger",
        "f64", "no shear springs", "no bend springs", "coarser",
    ]  # fmt: skip
    undamped = assemble(found["no spring damping"].scene).spring_set
    assert not undamped.damping.any()
    assert not np.isfinite(assemble(found["no plasticity"].scene).spring_set.yield_strain).any()
    assert not assemble(found["no tearing"].scene).spring_set.tears
    assert not any(one.self_contact for one in found["no self-contact"].scene.bodies)
    assert not assemble(found["no particle contact"].scene).meets_particles
    assert found["contact skin x2"].scene.contact.skin == 0.5
    assert all(pair.friction == 0.0 for pair in assemble(found["no collider friction"].scene).contacts[0])
    assert "0.5 s" in found["no wind"].what
    assert found["no gusts"].scene.wind == everything().wind.model_copy(update={"gust": None})
    assert found["coarser"].change is Change.COARSENS
    for variant in found.values():
        again = Scene.model_validate(variant.scene.model_dump(by_alias=True))
        assert again == variant.scene != everything()
        assert set(by_name(variant.scene)) != set(found) or variant.change is not Change.REMOVES


def test_what_cannot_be_left_out_is_told_with_the_reason():
    scene = scene_of("ball", "tower", material=BY_MODULUS)
    (reason,) = find_variants(assemble(scene)).left_out
    assert reason.startswith("no shear springs: material.youngs_modulus")
    assert reason.endswith("(ball)")
    coarse = by_name(scene)["coarser"]
    assert coarse.what.endswith("(not of tower)")
    pinned = make_scene(dimension=3, bodies=[body("rope", pin={"indices": [0]})])
    (reason,) = find_variants(assemble(pinned)).left_out
    assert reason.startswith("coarser: pinned by index")
    with pytest.raises(SceneError):
        variants(make_scene(dimension=3, bodies=[body("box", material={"mass": 1.0})]))


def test_a_region_that_holds_no_particle_of_the_coarse_body_leaves_it_as_it_is():
    # Segments of 1/9 m: the second particle is in the region, of segments of 1/5 m none is.
    rope = body("rope", pin={"region": {"min": [0.05, 0.0, -0.1], "max": [0.15, 0.1, 0.0]}})
    (reason,) = find_variants(assemble(make_scene(dimension=3, bodies=[rope]))).left_out
    assert "holds no particle" in reason


@pytest.mark.parametrize("kind", ["box", "sheet", "rope", "shell"])
@pytest.mark.parametrize("material", [{"stiffness": 50.0, "damping": 0.3}, {"stiffness": 50.0, "damping_ratio": 0.2}])
def test_coarse_bodies_are_of_the_same_material(kind, material):
    """Stretched evenly they store and dissipate the same: sums of k L^2 and c L^2."""
    scene = scene_of(kind, material={**material, "mass": 2.0})
    fine, coarse = (assemble(one).spring_set for one in (scene, by_name(scene)["coarser"].scene))
    assert len(coarse) < len(fine)
    for name in ("stiffness", "damping"):
        sums = [getattr(springs, name) @ springs.rest_lengths**2 for springs in (fine, coarse)]
        assert sums[1] == pytest.approx(sums[0], rel=1e-12)


def test_a_cube_of_half_the_cells_has_springs_twice_as_stiff():
    shape = {"kind": "box", "size": [1.0, 1.0, 1.0], "cells": [8, 8, 8], "bracing": "none"}
    cube = {"name": "cube", "shape": shape, "material": {"stiffness": 10.0, "mass": 1.0}}
    (coarse,) = by_name(make_scene(dimension=3, bodies=[cube]))["coarser"].scene.bodies
    # Springs along an edge of n cells: n (n + 1)^2 of length 1/n in each direction.
    assert coarse.material.stiffness == pytest.approx(10.0 * (81 / 8) / (25 / 4), rel=1e-12)
    assert coarser_shape(coarse.shape).cells == (2, 2, 2)


# -- between lattices -------------------------------------------------------------------------------------


def pair(*kinds, **more):
    """Assemblies of a scene and of its coarse variant."""
    scene = scene_of(*kinds, **more)
    return assemble(scene), assemble(by_name(scene)["coarser"].scene)


def starts(*assemblies):
    return [one.scene_order(one.positions) for one in assemblies]


@pytest.mark.parametrize(
    ("kinds", "allowed"),
    [(("box", "sheet"), 0.0), (("ball", "rope"), 0.0), (("shell",), 0.0), (("polygon",), 0.0), (("ring",), 5.2e-3)],
    ids=str,
)
def test_start_positions_carry_over_to_within_the_curvature_between_particles(kinds, allowed):
    fine, coarse = pair(*kinds)
    weights = correspondence(fine, coarse)
    ours, theirs = starts(fine, coarse)
    assert weights.shape == (len(theirs), len(ours))
    assert len(theirs) < len(ours)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    # A ring's chords of angle a lie r (1 - cos(a / 2)) within it at most.
    apart = np.linalg.norm(weights @ ours - theirs, axis=1)
    assert apart.max() <= allowed / 2.0 + 1e-12
    assert apart.max() >= 0.4 * allowed


@pytest.mark.parametrize("kinds", [("box", "sheet", "rope"), ("ball", "shell"), ("polygon",)], ids=str)
def test_linear_motions_carry_over_exactly(kinds):
    fine, coarse = pair(*kinds)
    ours, theirs = starts(fine, coarse)
    rng = np.random.default_rng(5)
    linear, shift = rng.normal(size=(fine.dimension,) * 2), rng.normal(size=fine.dimension)
    moved = correspondence(fine, coarse) @ (ours @ linear.T + shift)
    np.testing.assert_allclose(moved, theirs @ linear.T + shift, atol=1e-11)


def test_weights_stay_within_a_body_and_do_not_amplify():
    fine, coarse = pair("box", "ball", "sheet")
    weights = correspondence(fine, coarse)
    ours, theirs = (one.scene_order(one.particle_body.astype(float)) for one in (fine, coarse))
    rows, columns = weights.nonzero()
    assert (ours[columns] == theirs[rows]).all()
    assert weights.data.min() > -0.1
    assert abs(weights).sum(axis=1).max() < 1.3


def test_bodies_that_stay_as_they_are_carry_over_particle_by_particle():
    fine, coarse = pair("box", "tower")
    weights, count = correspondence(fine, coarse), int((fine.particle_body == 1).sum())
    assert (weights[-count:, -count:] != np.eye(count)).sum() == 0
    assert correspondence(fine, fine) is None


def still(assembly, energies):
    """The record of a scene in which nothing happens, for one picture."""
    bodies = len(assembly.scene.bodies)
    return Record(
        samples=np.array([1]),
        positions=starts(assembly)[0][None],
        energies=np.array([energies, energies], dtype=float),
        centres=np.zeros((2, bodies, assembly.dimension)),
        volumes=np.full((2, bodies), np.nan),
    )


def test_potential_energies_are_compared_from_the_same_level_and_motion_is_not():
    fine, coarse = pair("box")
    reference, run = still(fine, [3.0, 0.0, 50.0, 7.0]), still(coarse, [1.0, 0.0, 48.0, 9.0])
    seen = mapped(reference, run, correspondence(fine, coarse))
    np.testing.assert_array_equal(seen.energies - run.energies, [[2.0, 0.0, 0.0, 0.0]] * 2)
    assert ENERGIES[0] == "kinetic"
    assert norms.errors_over_time(norms.Scale.of(coarse), run, seen).max() < 1e-12
    assert mapped(reference, run, None) is reference


# -- the study --------------------------------------------------------------------------------------------


class Here:
    """A slot that does its jobs in this process."""

    def submit(self, job):
        future = Future()
        future.set_result(job.task(*job.arguments))
        return future

    def ready(self):
        return True

    def check(self):
        pass


@pytest.fixture
def study_of(tmp_path, monkeypatch):
    """Measures the models of a scene in this process."""
    monkeypatch.setattr(models, "open_crew", lambda *_: contextlib.nullcontext([Here()]))

    def measure(scene, horizon=0.1, times=False, progress=lambda *_: None):
        options = Options(horizon=horizon, times=times, cache=Cache(tmp_path / "cache"))
        return models.measure_models(scene, options, Store(tmp_path / "store"), progress)

    return measure


def spinning_box(**more):
    """A box that flies and turns, without anything that acts on it."""
    material = {"youngs_modulus": 1e6, "density": 100.0}
    shape = {"kind": "box", "size": [0.4, 0.4], "cells": [4, 4]}
    box = {"name": "box", "shape": shape, "material": material, "velocity": [1.0, 0.5], "angular_velocity": 3.0}
    return make_scene(dimension=2, bodies=[box], **more)


def test_a_coarse_lattice_is_as_good_for_a_rigid_motion(study_of):
    """The centrifugal strain of about rho (omega r)^2 / E = 7e-5 is all that lattices could differ in."""
    trade = study_of(spinning_box(solver={"integrator": "velocity_verlet"}))
    rows = {row.name: row for row in trade.rows}
    assert list(rows) == [models.WHOLE, "f64", "coarser"]
    assert trade.predictable == pytest.approx(trade.horizon) == pytest.approx(0.1)
    assert rows["coarser"].particles == 9
    assert rows["coarser"].settings.dt > 1.5 * rows[models.WHOLE].settings.dt
    assert rows["coarser"].error < 3e-5
    assert rows["coarser"].statistics.centre < 1e-5
    # Both make the same error in time; only f32 rounds.
    whole, double = rows[models.WHOLE], rows["f64"]
    assert double.error == pytest.approx(whole.error, rel=0.05)
    assert double.statistics.centre < 1e-12 < 1e-9 < whole.statistics.centre < 1e-6
    assert all(math.isnan(row.saved) for row in trade.rows)


def test_the_error_of_a_scene_without_drag_is_what_drag_does(study_of):
    """v exp(-gamma t) against v: apart by v (t - (1 - exp(-gamma t)) / gamma), at every sample.

    The scene itself is apart by what symplectic Euler makes of it: steps of h with the speed at their ends.
    """
    gamma, speed, size = 2.0, 1.0, 1.0
    points = {"kind": "custom", "points": [[0.0, 0.0], [size, 0.0]], "masses": [1.0, 1.0]}
    flying = {"name": "pair", "shape": points, "velocity": [0.0, speed]}
    scene = make_scene(dimension=2, drag=gamma, solver={"precision": "f64"}, bodies=[flying])
    said = []
    trade = study_of(scene, times=True, progress=lambda part, what: said.append((part, what)))
    whole, free = trade.rows[0], {row.name: row for row in trade.rows}["no drag"]
    # Three pictures in 0.1 s are all looked at.
    times = np.arange(1, 4) / 30.0
    apart = speed * (times - (1.0 - np.exp(-gamma * times)) / gamma)
    assert free.error == pytest.approx(np.sqrt((apart**2).mean()) / size, rel=1e-3)
    assert free.energy_error == pytest.approx(1.0 - math.exp(-2.0 * gamma * 0.1), rel=1e-3)
    kept = math.exp(-gamma * whole.settings.dt)
    stepped = speed * whole.settings.dt * kept * (1.0 - np.exp(-gamma * times)) / (1.0 - kept)
    late = stepped - speed * (1.0 - np.exp(-gamma * times)) / gamma
    assert whole.error == pytest.approx(np.sqrt((late**2).mean()) / size, rel=1e-3)
    assert whole.saved == 0.0
    assert all(row.seconds[0] > 0.0 for row in trade.rows)
    parts = [part for part, _ in said]
    assert parts == sorted(parts)
    assert said[-1] == (1.0, "done")
    check_output(trade)


def check_output(trade):
    lines = models.table(trade)
    assert {len(line) for line in lines} == {len(models.COLUMNS)}
    assert lines[0][0] == models.WHOLE
    assert {line[0] for line in lines[1:]} == {variant.name for variant in trade.variants}
    plain = json.loads(json.dumps(trade.plain()))
    assert [row["model"] for row in plain["rows"]] == [row.name for row in trade.rows]
    assert len({tuple(row) for row in plain["rows"]}) == 1


def test_steps_of_models_that_diverge_are_halved_where_the_scene_leaves_them_open(study_of, monkeypatch):
    real = models.ModelStudy._model

    def reckless(self, name, *rest):
        model = real(self, name, *rest)
        model.settings = replace(model.settings, dt=4.0 * model.settings.dt)
        return model

    monkeypatch.setattr(models.ModelStudy, "_model", reckless)
    shaken = {"kind": "custom", "points": [[0.0, 0.0], [1.5, 0.0]], "springs": [[0, 1]], "rest_lengths": [1.0]}
    one = {"name": "pair", "shape": {**shaken, "masses": [1.0, 1.0]}, "material": {"stiffness": 1e5}}
    scene = make_scene(dimension=2, solver={"precision": "f64"}, bodies=[one])
    whole = study_of(scene).rows[0]
    assert whole.status == "done"
    # 3.2 times the limit diverges, 1.6 times too; 0.8 times does not.
    assert whole.settings.dt == pytest.approx(0.8 * 2.0 / math.sqrt(2e5), rel=0.1)
    fixed = study_of(scene.model_copy(update={"solver": scene.solver.model_copy(update={"dt": 2e-3})})).rows[0]
    assert fixed.status == "diverged"
    assert math.isnan(fixed.error)
