"""How a search proposes steps, on lines whose errors and times are formulas."""

import json
import math
import tomllib

import pytest

from sandbox.cli_options import part_of_one
from sandbox.scene.model import IntegratorName, Precision
from sandbox.trade.ladder import Prospect, whole_steps
from sandbox.trade.tune import Line, _proposals

FRAME = 1.0 / 30.0
CHAIN = """
dimension = 2
gravity = [0.0, -9.81]
[[bodies]]
name = "chain"
shape = { kind = "rope", start = [0.0, 0.0], end = [1.0, 0.0], segments = 6 }
material = { stiffness = 2000.0, damping = 0.2, mass = 1.0 }
pin = { indices = [0] }
"""


def line(integrator: IntegratorName, limit: float, step_seconds: float = 1e-4) -> Line:
    dt = 0.8 * limit if math.isfinite(limit) else 1.0 / 240.0
    return Line(Prospect(integrator, limit, dt, step_seconds), Precision.F32, None, FRAME)


def search(of: Line, made, error: float) -> int:
    """Try what the line proposes until it has nothing left; number of trials."""
    trials = 0
    while (dt := of.next(error)) is not None:
        of.tried[dt] = made(dt)
        trials += 1
        assert trials <= 7
    return trials


def test_a_longest_step_that_is_good_enough_is_all_that_is_tried():
    of = line(IntegratorName.SYMPLECTIC_EULER, 1e-3)
    assert search(of, lambda dt: 1e-3, 1e-2) == 1
    assert of.met(1e-2) == whole_steps(0.8e-3, FRAME)


@pytest.mark.parametrize(
    "integrator, order", [(IntegratorName.SYMPLECTIC_EULER, 1), (IntegratorName.VELOCITY_VERLET, 2)]
)
def test_the_order_leads_to_the_step_in_few_trials(integrator, order):
    of = line(integrator, 1e-3)
    exact = 1e-3 * (1e-3 / 0.5) ** (1.0 / order)  # 0.5 at 1e-3
    trials = search(of, lambda dt: 0.5 * (dt / 1e-3) ** order, 1e-3)
    assert exact / 1.25 <= of.met(1e-3) <= exact * (1.0 + 1e-9)
    assert trials <= 5


def test_a_slope_that_is_not_the_order_is_learnt():
    of = line(IntegratorName.RK4, 1e-3)
    assert search(of, lambda dt: 0.1 * (dt / 1e-3), 2e-3) <= 6
    assert 1e-5 < of.met(2e-3) <= 2e-5 * (1.0 + 1e-9)


def test_schemes_without_a_limit_go_to_longer_steps_too():
    of = line(IntegratorName.IMPLICIT_MIDPOINT, math.inf)
    search(of, lambda dt: 1e-9, 1e-2)
    assert of.met(1e-2) == FRAME


def test_a_step_that_diverges_is_halved():
    of = line(IntegratorName.RK4, 1e-3)
    first = of.next(1e-2)
    of.tried[first] = math.inf
    assert of.next(1e-2) == whole_steps(0.5 * first, FRAME)


def test_what_would_take_longer_than_the_best_is_not_tried():
    cheap, dear = line(IntegratorName.SYMPLECTIC_EULER, 1e-3), line(IntegratorName.RK4, 1e-3, step_seconds=1e-2)
    assert set(_proposals([cheap, dear], 1e-2)) == {0, 1}
    cheap.tried[cheap.first] = 1e-3
    assert _proposals([cheap, dear], 1e-2) == {}


@pytest.mark.parametrize(("text", "part"), [("1%", 0.01), ("150%", 1.5), ("0.5", 0.5), (".02", 0.02), ("1e-3", 1e-3)])
def test_errors_in_percent_and_as_parts_of_one(text, part):
    assert part_of_one("--error", text) == pytest.approx(part)


@pytest.mark.slow
def test_the_command_writes_settings_that_run_takes(tmp_path, run_cli, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "chain.toml").write_text(CHAIN)
    choice = ("--schemes", "symplectic_euler,velocity_verlet", "--horizon", "0.3", "--workers", "1", "--quiet")
    code, printed, errors = run_cli("tune", "chain.toml", "--error", "0.1%", "--write", "fast.toml", *choice)
    assert (code, errors) == (0, "")
    found = tomllib.loads(printed)["solver"]
    assert tomllib.loads((tmp_path / "fast.toml").read_text())["solver"] == found
    data = json.loads((tmp_path / "outputs/chain-tune/tune.json").read_text())
    assert data["found"]["error"] + data["reference_bound"] <= 1e-3
    assert data["trials"] < data["grid"] and data["warnings"] == []
    written = (tmp_path / "outputs/chain-tune/tuned.toml").read_text()
    assert written == (tmp_path / "fast.toml").read_text() == printed
    assert written.startswith("# the cheapest of those within 0.1 % of the body's size, over 0.3 s\n")
    out = ("--out", "out", "--renderer", "none", "--seconds", "0.1", "--quiet")
    assert run_cli("run", "chain.toml", "--with", "fast.toml", *out) == (0, "", "")
    assert json.loads((tmp_path / "out/summary.json").read_text())["integrator"] == found["integrator"]
    # The same search again begins from its cached reference, and ends the same; a budget takes all of it for accuracy.
    code, printed, errors = run_cli("tune", "chain.toml", "--budget", "20ms", *choice)
    assert (code, errors) == (0, "")
    data = json.loads((tmp_path / "outputs/chain-tune/tune.json").read_text())
    assert data["found"]["error"] < 1e-3
    assert 0.0 < data["found"]["frame_95"] <= 0.020


@pytest.mark.parametrize(
    "arguments, message",
    [
        ([], "tune: give either --error, such as 1%, or --budget, such as 16ms"),
        (["--error", "1%", "--budget", "16ms"], "tune: give either --error, such as 1%, or --budget, such as 16ms"),
        (["--error", "1ms"], "--error 1ms: must be a number with %, no unit"),
        (["--error", "1"], "--error 1: 1 is 100 %; write 1% or 0.01"),
        (["--error", "2.5"], "--error 2.5: 2.5 is 250 %; write 2.5% or 0.025"),
        (["--error", "1.0 "], "--error 1.0 : 1 is 100 %; write 1% or 0.01"),
        (["--error", "0%"], "--error 0%: must be > 0"),
        (["--error", "nan"], "--error nan: must be > 0"),
        (["--budget", "16"], "--budget 16: must be a number with ms, s, us"),
        (["--budget", "-1ms"], "--budget -1ms: must be > 0"),
    ],
)
def test_wrong_targets_are_one_line(arguments, message, refuses):
    refuses(message, "tune", "rope", *arguments)
