"""The run folder: whole files or none, whatever happens."""

import errno
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sandbox import RunOptions, SandboxError, SceneError, load_scene, run
from sandbox.files import replace_when_whole
from sandbox.output import folder as folder_module
from sandbox.output.folder import RunFolder
from tests.conftest import left_in


def quick_run(out: Path, **overrides):
    scene = load_scene("drop_2d", {"duration": 0.1, **overrides})
    return run(scene, RunOptions("drop_2d", out, renderer="none"))


def test_files_appear_only_when_published(tmp_path):
    folder = RunFolder(tmp_path)
    folder.write_text("scene.toml", "x")
    assert not (tmp_path / "scene.toml").exists()
    folder.publish()
    assert left_in(tmp_path) == {"scene.toml"}


def test_a_full_disk_leaves_the_earlier_run_as_it_was(tmp_path, monkeypatch):
    quick_run(tmp_path)
    before = {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()}

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(RunFolder, "write_text", full)
    with pytest.raises(SandboxError, match="cannot be written: No space left on device") as caught:
        quick_run(tmp_path, **{"gravity": [0.0, -5.0]})
    assert caught.value.exit_code == 1
    assert {entry.name: entry.read_bytes() for entry in tmp_path.iterdir() if entry.is_file()} == before


def test_a_crash_leaves_the_earlier_run_as_it_was(tmp_path, monkeypatch):
    quick_run(tmp_path)
    before = {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()}
    monkeypatch.setattr("sandbox.recorder.MetricsWriter.write", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        quick_run(tmp_path)
    assert {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()} == before


def test_a_killed_run_leaves_a_folder_that_the_next_run_removes(tmp_path):
    script = (
        "from pathlib import Path; import sys, os, signal\n"
        "from sandbox.output.folder import RunFolder\n"
        "folder = RunFolder(Path(sys.argv[1])); folder.write_text('video.mp4', 'half')\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    root = Path(folder_module.__file__).parents[2]
    killed = subprocess.run([sys.executable, "-c", script, str(tmp_path)], cwd=root)
    assert killed.returncode < 0
    assert [entry.name[:11] for entry in tmp_path.iterdir()] == ["unfinished-"]
    quick_run(tmp_path)
    assert not list(tmp_path.glob("unfinished-*"))
    assert (tmp_path / "summary.json").exists()


@pytest.mark.slow
def test_an_interrupted_run_keeps_what_it_has(tmp_path):
    """Ctrl-C or a polite kill: the folder is published as far as it got."""
    root = Path(folder_module.__file__).parents[2]
    command = [sys.executable, "-m", "sandbox", "run", "drop_2d", "--seconds", "500", "--renderer", "none", "--quiet"]
    process = subprocess.Popen([*command, "--out", str(tmp_path)], cwd=root, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if any(path.stat().st_size > 4096 for path in tmp_path.glob("unfinished-*/metrics.csv")):
            break
        time.sleep(0.1)
    process.terminate()
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert errors.startswith("sandbox: interrupted; ") and errors.count("\n") == 1
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["status"] == "interrupted" and 0.0 < summary["simulated"] < 500.0


def test_no_json_number_is_infinite(tmp_path):
    folder = RunFolder(tmp_path)
    folder.write_json("summary.json", {"a": [math.inf, 1.0], "b": {"c": math.nan}})
    folder.publish()
    assert json.loads((tmp_path / "summary.json").read_text()) == {"a": [None, 1.0], "b": {"c": None}}


def test_a_place_that_cannot_be_written_is_wrong_input(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SceneError, match="cannot be written"):
        RunFolder(tmp_path / "file" / "out")


def test_replace_when_whole_keeps_the_old_file_when_writing_fails(tmp_path):
    path = tmp_path / "data"
    path.write_text("old")
    with pytest.raises(ValueError), replace_when_whole(path) as temporary:
        temporary.write_text("ha")
        raise ValueError
    assert path.read_text() == "old" and [entry.name for entry in tmp_path.iterdir()] == ["data"]
