"""The bound of a reference, its cache, and the names of trials."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sandbox
from sandbox.scene.model import IntegratorName, Precision
from sandbox.trade.ladder import Prospects
from sandbox.trade.norms import Scale
from sandbox.trade.record import Record
from sandbox.trade.reference import Cache, Plan, Reference
from sandbox.trade.trial import Settings, Trial, engine_digest, even_samples, sources_digest
from tests.conftest import make_scene


def box(**more):
    body = {
        "name": "box",
        "shape": {"kind": "box", "size": [0.4, 0.4], "cells": [2, 2]},
        "material": {"stiffness": 500.0, "mass": 1.0},
    }
    return make_scene(dimension=2, bodies=[body], **more)


@pytest.fixture(scope="module")
def prospects() -> Prospects:
    return Prospects(box())


def levels(scale: Scale, errors: list[list[float]]) -> dict[int, Record]:
    """Records whose positions are off by so many body sizes at every sample."""
    exact = np.zeros((len(errors[0]), len(scale.sizes), 2))
    off = [exact + 0.4 * np.array(row)[:, None, None] * [1.0, 0.0] for row in errors]
    nothing = np.zeros((2, 1))
    return {k: Record(np.array([1, 2]), x, nothing, nothing, nothing) for k, x in enumerate(off)}


@pytest.mark.parametrize("order", [1, 2, 4, 0.5])
def test_the_bound_holds_whatever_the_order(prospects, order):
    scale = Scale.of(prospects.assembly)
    true = [[1e-3 * 2.0 ** (-order * k)] * 2 for k in range(4)]
    reference = Reference.of(Plan.of(prospects), scale, levels(scale, true))
    assert reference.level == 3 and reference.agreed == 2
    error = true[3][0]
    assert error * (1.0 - 1e-9) <= reference.bound <= (2.0**4 - 1.0) * error * 1.01


def test_trajectories_are_compared_as_far_as_references_agree(prospects):
    scale = Scale.of(prospects.assembly)
    reference = Reference.of(Plan.of(prospects), scale, levels(scale, [[0.0, 0.0], [1e-3, 0.3], [5e-4, 0.1]]))
    assert reference.agreed == 1
    assert reference.bound == pytest.approx(5e-4)


def test_halved_steps_are_of_one_ladder(prospects):
    plan = Plan.of(prospects)
    assert plan.integrator is IntegratorName.RK4
    steps = [1.0 / 30.0 / plan.settings(k).dt for k in range(3)]
    assert steps == pytest.approx([steps[0], 2 * steps[0], 4 * steps[0]])
    assert steps[0] == pytest.approx(round(steps[0]))


def test_a_stiff_scene_has_an_implicit_reference():
    stiff = {"kind": "custom", "points": [[0, 0], [1, 0], [1.001, 0], [2, 0]], "springs": [[0, 1], [1, 2], [2, 3]],
             "masses": [1, 1, 1e-6, 1e4], "pinned": [0]}  # fmt: skip
    scene = make_scene(dimension=2, bodies=[{"name": "b", "shape": stiff, "material": {"stiffness": 1e5}}])
    assert Plan.of(Prospects(scene)).integrator is IntegratorName.IMPLICIT_MIDPOINT


def test_names_of_trials():
    settings = Settings(IntegratorName.RK4, 1e-3, Precision.F64)
    trial = Trial(settings.applied_to(box()), 5, (5,))
    assert trial.key == Trial(settings.applied_to(box(title="another name")), 5, (5,)).key
    assert trial.key != Trial(settings.applied_to(box(drag=0.1)), 5, (5,)).key
    shorter = Trial(replace(settings, dt=5e-4).applied_to(box()), 5, (5,))
    assert trial.key != shorter.key and trial.group == shorter.group
    assert trial.group != Trial(replace(settings, precision=Precision.F32).applied_to(box()), 5, (5,)).group


def test_names_of_trials_know_what_is_in_mesh_files(tmp_path):
    """Same scene, same path, another mesh: not the same trial."""
    corners = [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    file = tmp_path / "box.obj"
    shape = {"kind": "mesh", "file": str(file), "cells": 3}
    collider = {"kind": "mesh", "file": str(file)}
    for parts in (
        {"bodies": [{"name": "box", "shape": shape, "material": {"youngs_modulus": 1e4}}]},
        {"bodies": [{"name": "point", "shape": {"kind": "custom", "points": [[0, 3, 0]]}}], "colliders": [collider]},
    ):
        keys = set()
        for height in ("", "v 0.5 2 0.5\n"):
            file.write_text("\n".join([*corners, height + "\n".join(f"f {quad}" for quad in quads)]) + "\n")
            keys.add(Trial(make_scene(dimension=3, **parts), 5, (5,)).key)
        assert len(keys) == 2


def test_every_source_file_of_the_package_is_in_the_digest(tmp_path):
    """Bytes, names and places of all of them, however deep."""
    package = Path(sandbox.__file__).parent
    for path in package.rglob("*.py"):
        copy = tmp_path / path.relative_to(package)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
    seen = {sources_digest(tmp_path)}
    assert seen == {engine_digest()}
    folders = {path.parent for path in tmp_path.rglob("*.py")}
    assert {"actions", "shapes", "trade"} <= {folder.name for folder in folders}
    for folder in folders:
        path = min(folder.glob("*.py"))
        contents = path.read_bytes()
        path.write_bytes(contents + b"#")
        seen.add(sources_digest(tmp_path))
        path.write_bytes(contents)
    assert len(seen) == 1 + len(folders)
    (tmp_path / "actions/actor.py").rename(tmp_path / "actions/other.py")
    assert sources_digest(tmp_path) not in seen


def test_samples_are_even_and_end_at_the_end():
    assert even_samples(30, 4) == (8, 15, 22, 30)
    assert even_samples(3, 24) == (1, 2, 3)


def test_the_cache_gives_back_what_it_took_and_survives_rubbish(tmp_path, prospects):
    cache, scale = Cache(tmp_path / "levels"), Scale.of(prospects.assembly)
    trial = Plan.of(prospects).trial(0, 2, (1, 2), "cpu")
    assert cache.load(trial) is None
    record = levels(scale, [[0.1, 0.2]])[0]
    cache.save(trial, record)
    again = cache.load(trial)
    assert again is not None and np.array_equal(again.positions, record.positions)
    next((tmp_path / "levels").iterdir()).write_bytes(b"not an archive")
    assert cache.load(trial) is None
