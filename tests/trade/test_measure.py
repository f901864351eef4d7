"""The trade of a small scene, end to end: orders, bounds, interruptions, and what the command leaves."""

import csv
import json
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from sandbox.scene.model import IntegratorName, Precision
from sandbox.trade import norms
from sandbox.trade.crew import open_crew
from sandbox.trade.ladder import Choice
from sandbox.trade.measure import Options, Study, measure
from sandbox.trade.reference import Cache
from sandbox.trade.store import Store
from sandbox.trade.trial import Settings
from sandbox.trade.worker import Status
from tests.conftest import left_in, make_scene

STEPS = (1 / 150, 1 / 300, 1 / 600)
CHAIN = """
title = "A swinging chain"
dimension = 2
gravity = [0.0, -9.81]
[[bodies]]
name = "chain"
shape = { kind = "rope", start = [0.0, 0.0], end = [1.0, 0.0], segments = 6 }
material = { stiffness = 2000.0, damping = 0.2, mass = 1.0 }
pin = { indices = [0] }
"""


def chain():
    import tomllib

    return make_scene(**tomllib.loads(CHAIN))


@pytest.fixture(scope="module")
def options(tmp_path_factory) -> Options:
    choice = Choice(
        schemes=(IntegratorName.SYMPLECTIC_EULER, IntegratorName.VELOCITY_VERLET, IntegratorName.RK4),
        dts=STEPS,
        precisions=(Precision.F32, Precision.F64),
    )
    cache = Cache(tmp_path_factory.mktemp("cache"))
    return Options(choice, horizon=0.4, workers=2, threads=1, cache=cache, times=False)


@pytest.fixture(scope="module")
def trade(options, tmp_path_factory):
    return measure(chain(), options, Store(tmp_path_factory.mktemp("store")))


@pytest.mark.slow
def test_slopes_are_the_orders_down_to_the_floor_of_the_precision(trade):
    for integrator, order in (("symplectic_euler", 1), ("velocity_verlet", 2), ("rk4", 4)):
        errors = [row.error for row in trade.rows if row.settings.integrator == integrator]
        single, double = errors[:3], errors[3:]
        slope = np.polyfit(np.log(STEPS), np.log(double), 1)[0]
        assert slope == pytest.approx(order, abs=0.2), integrator
        if order < 4:
            assert single == pytest.approx(double, rel=0.2)
        else:
            # f32 rounds places to 6e-8 of them; what that adds up to in a run is far above rk4's own error.
            assert double[2] < 3e-8 < single[2] / 3.0


@pytest.mark.slow
def test_the_bound_holds_against_a_quarter_of_the_step(options, trade, tmp_path):
    study = Study(chain(), options, Store(tmp_path))
    reference = trade.reference
    with open_crew(1) as slots:
        study.run(slots, (), (reference.level + 2,))
    finer = study.levels[reference.level + 2]
    apart = norms.rms(norms.errors_over_time(study.scale, reference.record, finer))
    assert 0.0 < apart <= reference.bound
    # It is a tenth of the smallest error that is told apart.
    assert all(row.error >= 10.0 * reference.bound for row in trade.rows)


@pytest.mark.slow
def test_finished_rows_are_not_run_again(options, trade, tmp_path):
    store = Store(tmp_path / "store")
    study = Study(chain(), options, store)
    half = study.rungs[: len(study.rungs) // 2]
    with open_crew(1) as slots:
        study.run(slots, half)
    marked = store.outcome(study.trial(half[0]).key)
    assert marked is not None and marked.record is not None
    again = measure(chain(), options, store)
    assert [row.error for row in again.rows] == [row.error for row in trade.rows]
    assert [row.energy_error for row in again.rows] == [row.energy_error for row in trade.rows]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_killed_command_goes_on_where_it_was(tmp_path, run_cli, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    scene = tmp_path / "chain.toml"
    scene.write_text(CHAIN)
    arguments = ("measure", scene, "--schemes", "velocity_verlet,rk4", "--dts", "2e-3,1e-3", "--horizon", "0.3",
                 "--workers", "1", "--quiet")  # fmt: skip
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "sandbox", *map(str, arguments), "--out", str(out)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        _wait_for(lambda: len(list((out / ".study").glob("*.npz"))) >= 2)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    finished = len(list((out / ".study").glob("*.npz")))
    code, printed, errors = run_cli(*arguments, "--out", out)
    assert (code, errors) == (0, "")
    assert "Pareto" in printed and finished >= 2
    assert left_in(out) == {"scene.toml", "trade.csv", "trade.json", "trade.png"}
    other = tmp_path / "other"
    assert run_cli(*arguments, "--out", other)[0] == 0
    rows, others = (_rows(folder) for folder in (out, other))
    assert [(row["error"], row["energy_error"]) for row in rows] == [
        (row["error"], row["energy_error"]) for row in others
    ]
    data = json.loads((out / "trade.json").read_text())
    assert data["reference"]["bound"] > 0.0 and len(data["rows"]) == 5
    assert all(float(row["seconds"]) > 0.0 for row in rows)


def _rows(folder):
    with (folder / "trade.csv").open() as file:
        return list(csv.DictReader(file))


def _wait_for(condition) -> None:
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.slow
def test_a_blow_up_is_a_row(options, tmp_path):
    study = Study(chain(), options, Store(tmp_path))
    unstable = Settings(IntegratorName.VELOCITY_VERLET, 1.0 / 30.0, Precision.F64)
    with open_crew(1) as slots:
        study.run(slots, [unstable], range(2))
    row = study.row(unstable, study.reference())
    assert row.status is Status.DIVERGED and "diverged" in row.message
    assert math.isnan(row.error) and math.isnan(row.seconds[1])


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--schemes", "rk5"], "--schemes rk5: must be one of"),
        (["--dts", "1e-3,x"], "--dts x: must be numbers, such as 1,2"),
        (["--dts", "0"], "--dts 0: must be > 0"),
        (["--dts", "nan"], "--dts nan: must be > 0"),
        (["--iterations", "1.5"], "--iterations 1.5: must be numbers, such as 1,2"),
        (["--precisions", "f16"], "--precisions f16: must be one of f32, f64"),
        (["--horizon", "-1"], "--horizon -1: must be > 0"),
        (["--workers", "0"], "--workers 0: must be between 1 and 256"),
        (["--arch", "tpu"], "arch 'tpu': must be one of"),
        (["--with", "nowhere.toml"], "nowhere.toml: cannot be read"),
    ],
)
def test_wrong_options_are_one_line(arguments, message, refuses):
    refuses(message, "measure", "rope", *arguments)
