"""Sweeps: a row and a folder for every combination, here or on a cluster; killed, and gone on with; wrong input."""

import csv
import json
import logging
import os
import signal
import subprocess
import sys
import time

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image

from sandbox import load_scene
from sandbox.errors import SceneError
from sandbox.output.contact_sheet import Grid, Panel, draw_sheet
from sandbox.trade import crew
from sandbox.trade import sweep as sweeping
from sandbox.trade.combinations import parse_variation, short_names
from tests.conftest import heed_interrupts

SCENE = """
title = "Square"
dimension = 2
duration = 0.2
gravity = [0.0, -9.81]
solver = { dt = 1e-3, precision = "f64" }
[[bodies]]
name = "square"
position = [0.0, 0.11]
shape = { kind = "box", size = [0.2, 0.2], cells = [2, 2] }
material = { stiffness = 500.0, damping = 0.5, mass = 1.0 }
velocity = [0.0, -1.0]
[[colliders]]
kind = "half_space"
point = [0.0, 0.0]
normal = [0.0, 1.0]
"""
STIFFNESS = "bodies.0.material.stiffness"
VARY = ("--vary", f"{STIFFNESS}=200,8e3", "--vary", "solver.dt=1e-3,0.02")
TIMES = ("seconds", "real_time_factor")


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "square.toml").write_text(SCENE)
    return tmp_path / "square.toml"


def rows_of(folder):
    """Rows without what differs from one run of the same to the next."""
    rows = json.loads((folder / "sweep.json").read_text())["rows"]
    return [{key: value for key, value in row.items() if key not in TIMES} for row in rows]


def test_a_sweep_is_a_folder_a_row_and_a_sheet(run_cli, scene, tmp_path):
    out = tmp_path / "sweep"
    arguments = ("sweep", scene, *VARY, "--out", out, "--posters", "--size", "160x90", "--workers", 2)
    code, printed, errors = run_cli(*arguments, "--json")
    assert code == 0 and errors == ""
    data = json.loads(printed)
    assert data["vary"] == {STIFFNESS: [200, 8000.0], "solver.dt": [0.001, 0.02]}
    rows = data["rows"]
    assert [tuple(row["values"].values()) for row in rows] == [(200, 1e-3), (200, 0.02), (8e3, 1e-3), (8e3, 0.02)]
    assert [row["status"] for row in rows] == ["done", "done", "done", "diverged"]
    assert "spring" in rows[-1]["message"] and rows[-1]["simulated"] < 0.2
    for row in rows:
        summary = json.loads((out / row["folder"] / "summary.json").read_text())
        for key in ("status", "state_sha256", "max_strain", "dt", "energy_end"):
            assert row[key] == summary[key]
        again = load_scene(out / row["folder"] / "scene.toml")
        assert (again.bodies[0].material.stiffness, again.solver.dt) == tuple(row["values"].values())
        assert iio.imread(out / row["folder"] / "poster.png").shape == (90, 160, 3)
    assert len({row["state_sha256"] for row in rows}) == 4
    lines = list(csv.DictReader((out / "sweep.csv").open()))
    assert [line["folder"] for line in lines] == [row["folder"] for row in rows]
    assert [float(line["energy_total"]) for line in lines] == [row["energy_end"]["total"] for row in rows]
    sheet = iio.imread(out / "sweep.png")
    assert sheet.shape[0] > 180 and sheet.shape[1] > 320
    assert (sheet == (214, 39, 40)).all(axis=-1).sum() > 500  # the frame of the one that diverged

    # All is there: the table again, and nothing is run.
    written = {path: path.stat().st_mtime_ns for path in out.glob("*/*")}
    code, printed, errors = run_cli(*arguments, "--quiet")
    assert code == 0 and errors == "" and "diverged" in printed and "stiffness" in printed
    assert {path: path.stat().st_mtime_ns for path in out.glob("*/*")} == written
    # A run folder that somebody wrote into is run again, and one value more costs one row more.
    first = out / rows[0]["folder"] / "summary.json"
    first.write_text(first.read_text().replace("done", "gone"))
    arguments = ("sweep", scene, "--vary", f"{STIFFNESS}=200,8e3", "--vary", "solver.dt=1e-3", *arguments[6:])
    assert run_cli(*arguments, "--quiet")[0] == 0
    changed = {path.parent.name for path, before in written.items() if path.stat().st_mtime_ns != before}
    assert changed == {rows[0]["folder"]}
    assert rows_of(out) == [
        {key: value for key, value in rows[number].items() if key not in TIMES} for number in (0, 2)
    ]


def test_a_sweep_killed_half_way_goes_on_to_the_same_numbers(run_cli, scene, tmp_path):
    vary = ("--vary", "solver.dt=1e-3,5e-4,1e-4,5e-5,2e-5,1e-5", "--seconds", "2", "--workers", "1", "--quiet")
    half, whole = tmp_path / "half", tmp_path / "whole"
    assert run_cli("sweep", scene, *vary, "--out", whole)[0] == 0
    command = [sys.executable, "-m", "sandbox", "sweep", str(scene), *vary, "--out", str(half)]
    begun = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def finished():
        return [path for path in half.glob(f"*/{sweeping.STAMP}") if "key" in path.read_text()]

    end = time.monotonic() + 60.0
    while len(finished()) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    begun.send_signal(signal.SIGKILL)
    begun.wait()
    kept = {path: path.stat().st_mtime_ns for path in finished()}
    assert 2 <= len(kept) < 6 and not (half / "sweep.csv").exists()
    code, printed, errors = run_cli("sweep", scene, *vary, "--out", half)
    assert (code, errors) == (0, "") and "6 runs" in printed
    assert rows_of(half) == rows_of(whole)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert not list(half.glob("*/unfinished-*"))


def test_an_interrupted_sweep_says_how_to_go_on(scene, tmp_path):
    out = tmp_path / "sweep"
    command = [sys.executable, "-m", "sandbox", "sweep", str(scene), "--vary", "drag=0,1", "--workers", "2"]
    begun = subprocess.Popen(
        [*command, "--seconds", "1e6", "--out", str(out), "--quiet"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, text=True,
        preexec_fn=heed_interrupts,
    )  # fmt: skip
    end = time.monotonic() + 60.0
    while len(list(out.glob("*/unfinished-*"))) < 2 and time.monotonic() < end:
        time.sleep(0.05)
    os.killpg(begun.pid, signal.SIGINT)
    printed, errors = begun.communicate(timeout=30.0)
    assert begun.returncode == 1 and printed == ""
    assert errors == f"sandbox: interrupted; {out} holds 0 of 2 runs: the same command goes on from there\n"
    assert not out.exists()


def test_a_crash_is_a_row_and_a_cluster_gives_the_same_rows(run_cli, scene, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="Dask's distributed is not installed")
    monkeypatch.setattr(sweeping, "run_task", crash_or_run)
    monkeypatch.setattr(crew, "_LOOK_AGAIN", 0.2)
    here, there = tmp_path / "here", tmp_path / "there"
    vary = (*VARY, "--quiet")
    code, printed, errors = run_cli("sweep", scene, *vary, "--out", here)
    assert code == 1 and "crashed" in printed
    assert errors == "stiffness=200, dt=0.02: crashed: its worker died (SIGSEGV)\n"
    assert not (here / "stiffness=200,dt=0.02").exists()
    with distributed.LocalCluster(
        n_workers=2, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
    ) as local:
        code, _, errors = run_cli("sweep", scene, *vary, "--out", there, "--cluster", local.scheduler_address)
    assert code == 1 and errors == "stiffness=200, dt=0.02: crashed: its worker died\n"
    mine, theirs = rows_of(here), rows_of(there)
    assert [row["status"] for row in theirs] == ["done", "crashed", "done", "diverged"]
    assert theirs[1].pop("message") and mine[1].pop("message")
    assert mine == theirs
    folder = mine[0]["folder"]
    assert {path.name for path in (here / folder).iterdir()} == {path.name for path in (there / folder).iterdir()}
    assert json.loads((there / folder / "summary.json").read_text())["folder"] == str(there / folder)
    # What crashed is run again, and nothing else.
    monkeypatch.undo()
    before = {path: path.stat().st_mtime_ns for path in here.glob("*/summary.json")}
    assert run_cli("sweep", scene, *vary, "--out", here)[0] == 0
    assert len(before) == 3 and before.items() < {p: p.stat().st_mtime_ns for p in here.glob("*/summary.json")}.items()


def crash_or_run(task):
    """One of the runs takes its worker with it."""
    if task.combination.label == "stiffness=200, dt=0.02":
        os.kill(os.getpid(), signal.SIGSEGV)
        time.sleep(60.0)  # the signal may come to another thread, a moment later
    return sweeping.run_task(task)


WRONG = [
    ((), "--vary is required"),
    (("--vary", "dt"), "--vary dt: must be KEY=VALUE,VALUE"),
    (("--vary", "solver.dt="), "--vary solver.dt=: has no values"),
    (("--vary", "solver.dt=1,,2"), "has an empty value"),
    (("--vary", "solver.dt=1e-3,0.001"), "has 0.001 twice"),
    (("--vary", "solver.foo=1,2"), "--vary solver.foo=1: solver.foo: unknown key"),
    (("--vary", "bodies.3.name=a"), "--vary bodies.3.name=a: bodies.3: there is no such entry"),
    (("--vary", "bodies.round.name=a"), "bodies.round: there is no such entry; the list has 1: square"),
    (("--vary", "bodies.square.color=red,blu"), "--vary bodies.square.color=blu: bodies[0].color: must be a color"),
    (("--vary", "bodies.square.name=a", "--set", "bodies.0.name=b"), "bodies.square: there is no such entry"),
    (("--vary", "bodies.square.color=red", "--set", "bodies.0.color=red"), "--set bodies.0.color gives it too"),
    (("--vary", "bodies.square={}", "--vary", "bodies.0.name=a"), "--vary bodies.square gives it too"),
    (("--vary", "solver.dt=1e-3,-1", "--vary", "drag=0,1"), "must be > 0 or 'auto', got -1 (dt=-1, drag=0)"),
    (("--vary", "solver.dt=1e-3", "--vary", "solver.dt=1e-4"), "--vary solver.dt: --vary solver.dt gives it too"),
    (("--vary", "bodies[0]={}", "--vary", "bodies.0.name=a"), "--vary bodies.0 gives it too"),
    (("--vary", "solver.dt=1e-3", "--set", "solver.dt=1e-4"), "--set solver.dt gives it too"),
    (("--vary", "duration=1,2", "--seconds", "3"), "--seconds gives it too"),
    (("--vary", "bodies.0.shape.cells=[2,2],[3,3]", "--vary", "bodies.0.pin={indices=[12]}"), "(cells=[2,2], pin="),
    (("--vary", f"drag={','.join(map(str, range(10001)))}"), "makes 10001 combinations, at most 10000"),
    (("--vary", "drag=0,1", "--workers", "0"), "--workers 0: must be between 1 and 256"),
    (("--vary", "drag=0,1", "--video", "avi"), "--video avi: must be one of mp4"),
    (("--vary", "drag=0,1", "--arch", "abacus"), "arch 'abacus'"),
    (("--vary", "drag=0,1", "--cluster", "nowhere"), "--cluster nowhere: no Dask scheduler answers there"),
]


@pytest.mark.parametrize(("arguments", "complaint"), WRONG, ids=[complaint for _, complaint in WRONG])
def test_wrong_input_is_one_line_and_leaves_nothing(run_cli, scene, tmp_path, arguments, complaint):
    code, printed, errors = run_cli("sweep", scene, *arguments, "--out", tmp_path / "x", "--quiet")
    assert code == 2 and printed == ""
    assert complaint in errors and len(errors.strip().splitlines()) == 1
    assert not (tmp_path / "x").exists()


def test_other_people_s_folders_are_left_alone(run_cli, scene, tmp_path):
    (tmp_path / "x" / "drag=1").mkdir(parents=True)
    (tmp_path / "x" / "drag=1" / "summary.json").write_text("mine")
    code, _, errors = run_cli("sweep", scene, "--vary", "drag=0,1", "--out", tmp_path / "x", "--quiet")
    assert code == 2 and "holds something that is of no sweep" in errors
    assert [path.name for path in (tmp_path / "x").iterdir()] == ["drag=1"]
    (tmp_path / "x" / "drag=1" / "summary.json").rename(tmp_path / "x" / "drag=1" / f".{sweeping.STAMP}.part")
    assert run_cli("sweep", scene, "--vary", "drag=0,1", "--out", tmp_path / "x", "--quiet", "--workers", 1)[0] == 0
    (tmp_path / "y").mkdir()
    (tmp_path / "y" / sweeping.STAMP).write_text(json.dumps({"name": "other", "keys": ["solver.dt"]}))
    code, _, errors = run_cli("sweep", scene, "--vary", "drag=0,1", "--out", tmp_path / "y", "--quiet")
    assert code == 2 and "holds another sweep, of other over solver.dt" in errors


def test_values_are_toml_and_bare_words_are_text():
    found = parse_variation("bodies[0].shape.cells=[2,3], [3, 4],5")
    assert found.key == "bodies.0.shape.cells"
    assert found.values == ([2, 3], [3, 4], 5) and found.texts == ("[2,3]", "[3, 4]", "5")
    assert parse_variation("solver.integrator=rk4,vbd").values == ("rk4", "vbd")
    assert parse_variation("solver.dt=auto,1e-3").values == ("auto", 1e-3)
    assert parse_variation("""title="a,b",'c]',d""").values == ("a,b", "c]", "d")
    assert parse_variation("solver={dt=1,adapt='rescue'},{}").values == ({"dt": 1, "adapt": "rescue"}, {})
    assert parse_variation("x=1,true").values == (1, True)
    with pytest.raises(SceneError, match=r"has 1\.0 twice"):
        parse_variation("x=1,1.0")


def test_short_names_tell_keys_apart():
    assert short_names(["solver.dt", "drag"]) == ["dt", "drag"]
    keys = ["bodies.0.material.stiffness", "bodies.1.material.stiffness"]
    assert short_names(keys) == ["0.material.stiffness", "1.material.stiffness"]
    assert short_names(["a.b", "b"]) == ["a.b", "b"]


def test_a_sheet_without_common_columns_is_about_a_square(tmp_path):
    Image.new("RGB", (200, 100), (0, 0, 255)).save(tmp_path / "blue.png")
    panels = [Panel(f"run {number}", tmp_path / "blue.png") for number in range(4)] + [Panel("lost", None, "crashed")]
    sheet = draw_sheet(panels, Grid(), "All")
    blue = (np.asarray(sheet) == (0, 0, 255)).all(axis=-1).sum() / (200 * 100)
    assert blue == pytest.approx(4.0, abs=0.01)
    assert 600 < sheet.width < 660 and 200 < sheet.height < 400
