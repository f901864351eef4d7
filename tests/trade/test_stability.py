"""Stable steps predicted and measured; the map; the command."""

import csv
import json
import math

import numpy as np
import pytest

from sandbox.scene.load import load_scene
from sandbox.scene.model import IntegratorName
from sandbox.trade import stability_map
from sandbox.trade.stability import stable_steps
from tests.conftest import left_in, make_scene, oscillator

OMEGA = math.sqrt(1000.0)
EXPLICIT = ("explicit_euler", "symplectic_euler", "velocity_verlet", "midpoint", "heun", "rk4")


@pytest.mark.parametrize(
    ("name", "zeta", "limit"),
    [
        ("symplectic_euler", 0.0, 2.0),
        ("symplectic_euler", 0.2, 2.0 * (math.sqrt(1.04) - 0.2)),
        ("velocity_verlet", 0.0, 2.0),
        ("rk4", 0.0, 2.0 * math.sqrt(2.0)),
        ("explicit_euler", 0.2, 0.4),
    ],
)
def test_measured_limits_of_an_oscillator_are_the_formulas(name, zeta, limit):
    scene = oscillator(name, 1e-3, zeta, start=1.0).model_copy(update={"duration": 40.0})
    (row,) = stable_steps(scene, [IntegratorName(name)], horizon=40.0)
    assert row.measured == pytest.approx(limit / OMEGA, rel=0.01)
    assert row.ratio == pytest.approx(1.0, abs=0.01)


def test_measured_limits_of_a_preset_are_near_the_predicted_ones():
    rows = stable_steps(load_scene("drop_2d"), [IntegratorName(name) for name in EXPLICIT], horizon=0.25)
    for row in rows:
        assert row.ratio == pytest.approx(1.0, abs=0.05), row.scheme
    by_name = {row.scheme: row.measured for row in rows}
    assert by_name["explicit_euler"] < by_name["symplectic_euler"] < by_name["rk4"]


def small():
    """A damped square of nine particles."""
    body = {
        "name": "square",
        "shape": {"kind": "box", "size": [0.2, 0.2], "cells": [2, 2]},
        "material": {"stiffness": 500.0, "mass": 1.0},
    }
    return make_scene(dimension=2, solver={"integrator": "velocity_verlet"}, bodies=[body])


def test_the_map_s_boundary_is_where_disturbances_begin_to_grow(tmp_path, monkeypatch):
    monkeypatch.setattr(stability_map, "STIFFNESS", (0.1, 1.0, 10.0))
    monkeypatch.setattr(stability_map, "DAMPING", (0.05, 1.0))
    monkeypatch.setattr(stability_map, "MASS_RATIOS", (1.0, 100.0))
    monkeypatch.setattr(stability_map, "STEPS", (0.5, 0.95, 1.05, 2.0))
    points = stability_map.stability_map(small())
    assert len(points) == 3 * 2 * 2 * 4
    for point in points:
        assert point.stable == (point.dt < point.predicted), point
    # Ten times the stiffness is sqrt(10) times the frequency.
    limit = {(p.mass_ratio, p.damping_ratio, p.stiffness): p.predicted for p in points}
    for mass_ratio in (1.0, 100.0):
        for damping in (0.05, 1.0):
            ratio = limit[mass_ratio, damping, 0.1] / limit[mass_ratio, damping, 10.0]
            assert ratio == pytest.approx(10.0, rel=0.01)
    assert limit[100.0, 0.05, 1.0] < 0.5 * limit[1.0, 0.05, 1.0]
    stability_map.write_csv(points, tmp_path / "map.csv")
    with (tmp_path / "map.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(points) and {"dt", "predicted", "growth", "stable"} <= set(rows[0])
    stability_map.draw(points, tmp_path / "map.png", r"no formula: $\frac$")
    import imageio.v3 as iio

    assert np.ptp(iio.imread(tmp_path / "map.png")) > 100


def test_the_command_leaves_a_folder_and_prints_json(run_cli, tmp_path):
    out = tmp_path / "study"
    code, printed, _ = run_cli(
        "stability", "drop_2d", "--schemes", "symplectic_euler", "--horizon", "0.1", "--out", out, "--json"
    )
    assert code == 0
    (row,) = json.loads(printed)["schemes"]
    assert row["scheme"] == "symplectic_euler" and row["measured"] == pytest.approx(row["predicted"], rel=0.05)
    assert left_in(out) == {"stability.json", "scene.toml"}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--schemes", "euler"), "--schemes euler: must be one of explicit_euler"),
        (("--horizon", "0"), "--horizon 0: must be > 0"),
        (("--arch", "abacus"), "abacus"),
    ],
)
def test_wrong_options_are_one_line(run_cli, tmp_path, arguments, complaint):
    code, _, errors = run_cli("stability", "drop_2d", *arguments, "--out", tmp_path / "x", "--quiet")
    assert code == 2 and complaint in errors and len(errors.strip().splitlines()) == 1
    assert not (tmp_path / "x").exists()
