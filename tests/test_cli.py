"""The command line: what it leaves, what it prints, its exit codes, one line for every mistake."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import typer

from sandbox import cli, load_scene
from sandbox.output.folder import RunFolder
from tests.conftest import left_in

SMALL = ("--seconds", "0.2", "--size", "320x180")


def test_run_leaves_the_whole_folder(run_cli, tmp_path):
    out = tmp_path / "deep" / "drop"
    code, printed, errors = run_cli("run", "drop_2d", *SMALL, "--out", out, "--json")
    assert code == 0 and errors == ""
    summary = json.loads(printed)
    assert summary["status"] == "done" and summary["simulated"] == pytest.approx(0.2)
    expected = {"video.mp4", "poster.png", "metrics.csv", "summary.json", "scene.toml", "checkpoint.npz"}
    assert left_in(out) == expected == set(summary["files"])
    frames = iio.imread(out / "video.mp4")
    assert frames.shape == (6, 180, 320, 3)
    meta = iio.immeta(out / "video.mp4")
    assert meta["codec"] == "h264" and meta["fps"] == 30.0 and "yuv420p" in meta["video_format"]
    assert iio.imread(out / "poster.png").shape == (180, 320, 3)
    rows = list(csv.DictReader((out / "metrics.csv").open()))
    assert [int(row["frame"]) for row in rows] == list(range(7))
    assert float(rows[-1]["time_s"]) == pytest.approx(0.2)
    for row in rows:
        parts = sum(float(row[f"{name}_J"]) for name in ("kinetic", "elastic", "gravity", "gas"))
        assert parts == pytest.approx(float(row["total_J"]), rel=1e-6)
    again = load_scene(out / "scene.toml")
    assert again.duration == 0.2 and again.render.size == (320, 180)


def test_resume_ends_where_the_whole_run_ends(run_cli, tmp_path):
    common = ("--renderer", "none", "--quiet")
    run_cli("run", "drop_2d", "--seconds", "0.4", "--out", tmp_path / "whole", *common)
    run_cli("run", "drop_2d", "--seconds", "0.2", "--out", tmp_path / "half", *common)
    code, printed, _ = run_cli(
        "run", "drop_2d", "--seconds", "0.4", "--out", tmp_path / "rest", *common,
        "--resume", tmp_path / "half" / "checkpoint.npz",
    )  # fmt: skip
    assert code == 0 and printed == ""
    whole, rest = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("whole", "rest"))
    assert whole["state_sha256"] == rest["state_sha256"]
    code, _, errors = run_cli(
        "run", "drop_2d", "--seconds", "0.1", "--out", tmp_path / "x", "--resume", tmp_path / "half" / "checkpoint.npz"
    )
    assert code == 2 and "is at 0.2 s already" in errors


@pytest.mark.filterwarnings("always::sandbox.warning_log.StabilityWarning")
def test_a_blow_up_is_exit_code_3_and_loses_nothing(run_cli, tmp_path):
    out = tmp_path / "boom"
    code, _, errors = run_cli("run", "drop_2d", "--set", "solver.dt=0.002", *SMALL, "--out", out, "--quiet")
    assert code == 3
    lines = errors.strip().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("warning: solver.dt = 0.002 s is above the stability limit")
    assert re.match(r"warning: cells inside out: \d+ of 16 of 'stiff'", lines[1])
    assert "diverged at t = " in lines[2] and "spring" in lines[2] and "omega dt" in lines[2]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "diverged" and summary["message"] in lines[2]
    assert [f"warning: {line}" for line in summary["warnings"]] == lines[:2]
    # The element that left its bounds first is marked with a red ring.
    assert "postmortem.png" in summary["files"]
    red = (iio.imread(out / "postmortem.png") == (214, 39, 40)).all(axis=-1)
    assert 20 < red.sum() < 0.02 * red.size
    frames = iio.imread(out / "video.mp4") if summary["pictures"] else []
    assert len(frames) == summary["pictures"]
    with np.load(out / "checkpoint.npz") as checkpoint:
        assert np.isfinite(checkpoint["positions"]).all()
        assert float(checkpoint["time"]) == pytest.approx(summary["simulated"])
    assert "nan" not in (out / "metrics.csv").read_text()


@pytest.mark.parametrize("kind", ["webm", "gif", "png", "none"])
def test_other_kinds_of_video(run_cli, tmp_path, kind):
    arguments = ("run", "drop_2d", "--seconds", "0.1", "--size", "320x180", "--quiet", "--video", kind)
    earlier = RunFolder(tmp_path)
    earlier.write_text("video.mp4", "of an earlier run")
    earlier.publish()
    (tmp_path / "notes.txt").write_text("mine")
    code, _, _ = run_cli(*arguments, "--out", tmp_path)
    assert code == 0
    names = left_in(tmp_path)
    assert "video.mp4" not in names and "notes.txt" in names
    if kind == "png":
        assert len(list((tmp_path / "frames").iterdir())) == 3
    elif kind != "none":
        assert iio.imread(tmp_path / f"video.{kind}").shape[:3] == (3, 180, 320)


WRONG = [
    (("run", "jely"), "jely: no such preset or file; did you mean jelly?"),
    (("run", "no/such.toml"), "no/such.toml: cannot be read: No such file"),
    (("run", "jelly", "--set", "solver.foo=1"), "--set solver.foo: solver.foo: unknown key"),
    (("run", "jelly", "--set", "nonsense"), "--set nonsense: must be KEY=VALUE"),
    (("run", "jelly", "--size", "1280"), "--size 1280: must be WIDTHxHEIGHT"),
    (("run", "jelly", "--size", "1281x720"), "must be even"),
    (("run", "jelly", "--seconds", "-1"), "--seconds: duration: must be > 0, got -1.0"),
    (("run", "jelly", "--seconds", "soon"), "--seconds"),
    (("run", "jelly", "--fps", "0"), "render.fps: must be > 0"),
    (("run", "jelly", "--arch", "cuda"), "arch 'cuda': not available on this machine"),
    (("run", "jelly", "--arch", "abacus"), "arch 'abacus': must be one of cpu, cuda, vulkan, metal"),
    (("run", "jelly", "--precision", "f16"), "precision 'f16': must be f32 or f64"),
    (("run", "jelly", "--threads", "100000"), "threads 100000: at most"),
    (("run", "jelly", "--set", "bodies.0.material.youngs_modulus=1e14", "--fps", "2"), "jelly: solver.dt: "),
    (("run", "jelly", "--set", "bodies.0.material.youngs_modulus=1e300"), "youngs_modulus: must not be beyond 1e+15"),
    (("run", "jelly", "--set", "bodies.0.position=[1e8,0,0]"), "jelly: bodies: so far from the origin f32 rounds"),
    (("run", "jelly", "--set", "bodies.0.shape.cells=[4096,4096,4096]"), "makes 6.88e+10 particles, at most 2e+07"),
    (("run", "jelly", "--threads", "0"), "threads 0: must be at least 1"),
    (("run", "jelly", "--renderer", "pencil"), "--renderer pencil: must be one of taichi, ggui, none"),
    (("run", "jelly", "--video", "avi"), "--video avi: must be one of mp4"),
    (("run", "jelly", "--resume", "none.npz"), "none.npz: cannot be read: No such file"),
    (("run", "jelly", "--out", "/dev/null/x"), "/dev/null/x: cannot be written: Not a directory"),
    (("run",), "Missing argument 'SCENE'"),
    (("run", "jelly", "--colour", "red"), "No such option: --colour"),
    (("jump",), "No such command 'jump'"),
    (("validate", "pyproject.toml"), "pyproject.toml: "),
]


@pytest.mark.parametrize(("arguments", "message"), WRONG, ids=["-".join(w[0])[:40] for w in WRONG])
def test_wrong_input_is_one_line_and_exit_code_2(run_cli, tmp_path, monkeypatch, arguments, message):
    if arguments[:2] == ("run", "jelly") and "--out" not in arguments:
        arguments = (*arguments, "--out", tmp_path / "out")
    code, printed, errors = run_cli(*arguments)
    assert (code, printed) == (2, "")
    assert errors.count("\n") == 1 and message in errors
    # Nothing half-written is left.
    assert not list(tmp_path.rglob("*.*"))


def test_a_scene_that_is_none_is_named_with_its_place(run_cli, tmp_path):
    scene = tmp_path / "x.toml"
    scene.write_text(
        'dimension = 2\n[[bodies]]\nname = "a"\nshape = { kind = "box", size = [1, 1], cells = [1, 1] }\n'
        "material = { stiffness = -3 }\n"
    )
    for command in ("validate", "run"):
        code, _, errors = run_cli(command, scene)
        assert (code, errors) == (2, f"sandbox: {scene}: bodies[0].material.stiffness: must be > 0, got -3\n")
    scene.write_bytes(b"dimension = \x00")
    code, _, errors = run_cli("validate", scene)
    assert code == 2 and "is not TOML" in errors and errors.count("\n") == 1


def test_scenes_lists_every_preset(run_cli):
    code, printed, _ = run_cli("scenes", "--json")
    rows = {row["name"]: row for row in json.loads(printed)}
    assert code == 0 and {"jelly", "rope", "drop_2d"} <= set(rows)
    assert rows["jelly"]["particles"] >= 4000 and "half-space contact" in rows["jelly"]["physics"]
    code, printed, _ = run_cli("scenes")
    assert code == 0 and "jelly" in printed


def test_validate_and_schema_and_help(run_cli):
    code, printed, _ = run_cli("validate", "jelly")
    assert code == 0 and printed.startswith("jelly: ok, ")
    code, printed, _ = run_cli("schema")
    assert code == 0 and json.loads(printed)["title"] == "Scene"
    for arguments in ((), ("--help",), ("run", "--help"), ("--version",)):
        code, printed, _ = run_cli(*arguments)
        assert code == 0 and printed.strip()


def test_help_says_all_that_it_has_to_say(run_cli, monkeypatch):
    """Units in brackets are no markup, for any command and option."""
    monkeypatch.setenv("COLUMNS", "100")
    group = typer.main.get_command(cli.app)
    brackets = 0
    for name, command in group.commands.items():
        code, printed, _ = run_cli(name, "--help")
        said = "".join(printed.split())
        assert code == 0
        for parameter in command.params:
            if parameter.name != "help":
                assert "".join((parameter.help or "").split()) in said, (name, parameter.name)
                brackets += "[" in (parameter.help or "")
    assert brackets > 5


def test_titles_are_no_markup(run_cli, tmp_path):
    title = "a [bold] ride [/] for all [s]"
    arguments = ("drop_2d", "--set", f"title={title}", "--set", "duration=0.04")
    code, _, errors = run_cli("run", *arguments, "--renderer", "none", "--out", tmp_path / "run")
    assert code == 0 and "[bold]" in errors and "[/]" in errors


def test_as_a_program_nothing_but_the_summary_is_on_standard_output(tmp_path):
    """A process of its own: Taichi's banner and log stay off."""
    command = [sys.executable, "-m", "sandbox", "run", "rope", "--seconds", "0.05", "--renderer", "none", "--json"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path)], capture_output=True, text=True, check=True, cwd=Path(__file__).parent.parent
    )
    assert json.loads(done.stdout)["status"] == "done"
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("home", "why"),
    [
        ({"HOME": "/dev/null/nobody"}, "/dev/null/nobody/.cache/taichi/ticache cannot be written (Not a directory)"),
        ({}, "there is neither HOME nor XDG_CACHE_HOME"),
    ],
    ids=["unwritable", "missing"],
)
def test_without_a_home_a_run_goes_without_a_cache_and_leaves_none(home, why, tmp_path):
    """As services, cron and containers have it: Taichi by itself aborts, or crashes at its end."""
    (tmp_path / "temporary").mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "sandbox", "run", "rope", "--seconds", "0.05", "--renderer", "none", "--quiet"],
        cwd=tmp_path,
        env={**home, "TMPDIR": str(tmp_path / "temporary"), "PYTHONPATH": str(Path(__file__).parent.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines() == [
        f"warning: no cache for compiled kernels: {why}; every start compiles anew; "
        "set XDG_CACHE_HOME to a folder that can be written"
    ]
    assert (tmp_path / "outputs" / "rope" / "summary.json").is_file()
    assert not list((tmp_path / "temporary").iterdir())
