"""Runs that end early: killed, stopped or out of disk, they go on to the files of a run that went through."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import numpy as np
import pytest

import sandbox
from sandbox import RunOptions, SandboxError, SceneError, load_scene, run
from sandbox.output.folder import left_over
from sandbox.output.grouped_video import VideoWriter
from sandbox.output.video import open_writer
from sandbox.unfinished import Pace

CHANGES = {"duration": 0.7, "render.size": [160, 96], "render.poster": 0.3, "diagnostics.ledger": True}
BOOKKEEPING = {".sandbox-run.json", "summary.json"}


class KilledError(BaseException):
    """What nobody catches: as good as a kill, but within the test's process."""


class At:
    """Progress that does something after a picture."""

    def __init__(self, picture, action):
        self.left, self.action = picture, action

    def update(self, simulated, real_time_factor):
        self.left -= 1
        if self.left == 0:
            self.action()


def kill():
    raise KilledError


def stop():
    os.kill(os.getpid(), signal.SIGTERM)


@pytest.fixture(autouse=True)
def stopped_politely():
    """As the command has it."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture(autouse=True)
def keeps_at_every_picture(monkeypatch):
    monkeypatch.setattr(Pace, "is_due", lambda *_: True)


def begin(out, progress=None, scene_changes=None, **options):
    scene = load_scene("drop_2d", CHANGES | (scene_changes or {}))
    return run(scene, RunOptions("drop_2d", out, **options), progress)


def contents(folder):
    files = {path.relative_to(folder): path for path in folder.rglob("*") if path.is_file()}
    return {str(name): path.read_bytes() for name, path in files.items() if path.name not in BOOKKEEPING}


def summary(folder):
    data = json.loads((folder / "summary.json").read_text())
    return {name: value for name, value in data.items() if name not in ("folder", "seconds", "real_time_factor")}


def assert_same(folder, whole):
    assert contents(folder) == contents(whole)
    assert summary(folder) == summary(whole)
    assert not left_over(folder)


def pictures_in(path):
    with av.open(str(path)) as video:
        return sum(1 for _ in video.decode(video=0))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that went through."""
    folder = tmp_path_factory.mktemp("whole")
    begin(folder)
    return folder


@pytest.mark.parametrize("picture", [1, 18])
def test_a_killed_run_plays_and_goes_on_to_the_same_files(whole, tmp_path, picture):
    with pytest.raises(KilledError):
        begin(tmp_path, At(picture, kill))
    (folder,) = left_over(tmp_path)
    assert pictures_in(folder / "video.mp4") == max(n for n in (1, 3, 7, 15, 31) if n <= picture)
    assert len((folder / "metrics.csv").read_text().splitlines()) == picture + 2
    begin(tmp_path, resume=tmp_path)
    assert_same(tmp_path, whole)


def test_a_stopped_run_is_published_and_goes_on(whole, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        begin(tmp_path, At(11, stop))
    data = json.loads((tmp_path / "summary.json").read_text())
    assert data["status"] == "interrupted" and data["pictures"] == pictures_in(tmp_path / "video.mp4") == 11
    with pytest.raises(KilledError):  # and is killed then
        begin(tmp_path, At(5, kill), resume=tmp_path)
    begin(None, resume=tmp_path)
    assert_same(tmp_path, whole)


def test_two_interrupts_do_not_wait(whole, tmp_path, monkeypatch):
    from sandbox.simulation import Simulation

    advance_to = Simulation.advance_to

    def interrupted_within(self, time):
        advance_to(self, (self.time + time) / 2)
        if self.time > 0.2:
            stop()
            stop()
        advance_to(self, time)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Simulation, "advance_to", interrupted_within)
        begin(tmp_path)
    assert not (tmp_path / "summary.json").exists() and left_over(tmp_path)


@pytest.mark.parametrize(
    "file", ["metrics", "group", "checkpoint", "index", "poster.png", "scene.toml", "summary.json", "mark"]
)
def test_a_disk_that_fills_loses_nothing(whole, tmp_path, monkeypatch, file):
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    count = {"left": 9}

    def fail(*_, **__):
        raise full

    def fail_late(original):
        def wrapped(*arguments, **options):
            count["left"] -= 1
            if count["left"] < 0:
                raise full
            return original(*arguments, **options)

        return wrapped

    from sandbox.output import folder as folder_module
    from sandbox.output import grouped_video
    from sandbox.output.metrics import MetricsWriter

    with monkeypatch.context() as patch:
        if file == "metrics":
            patch.setattr(MetricsWriter, "write", fail_late(MetricsWriter.write))
        elif file == "group":
            count["left"] = 3
            patch.setattr(grouped_video, "write_all", fail_late(grouped_video.write_all))
        elif file == "checkpoint":
            patch.setattr(np, "savez", fail_late(np.savez))
        elif file == "index":
            patch.setattr(grouped_video, "_write_index", fail)
        elif file == "mark":
            count["left"] = 1
            patch.setattr(folder_module.Mark, "put", fail_late(folder_module.Mark.put))
        else:
            real = Path.write_bytes if file.endswith("png") else Path.write_text
            name = real.__name__
            patch.setattr(Path, name, lambda path, *a, **k: fail() if path.name == file else real(path, *a, **k))
        with pytest.raises(SandboxError, match=r"No space left on device; --resume .* goes on") as caught:
            begin(tmp_path)
    assert caught.value.exit_code == 1
    begin(tmp_path, resume=tmp_path)
    assert_same(tmp_path, whole)


@pytest.mark.parametrize(
    ("changes", "options"),
    [
        ({"solver.integrator": "implicit_euler", "solver.iterations": 1, "solver.dt": 0.004}, {"video": "webm"}),
        ({"solver.integrator": "vbd"}, {"video": "gif", "trajectory": "npz", "exports": ("ply", "glb")}),
        ({"solver.dt": 0.002, "solver.adapt": "rescue", "diagnostics.max_strain": 3.0}, {"video": "png"}),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::sandbox.StabilityWarning")
def test_what_was_noticed_and_written_down_goes_on(tmp_path, changes, options):
    straight, parted = tmp_path / "straight", tmp_path / "parted"
    begin(straight, scene_changes=changes, **options)
    with pytest.raises(KilledError):
        begin(parted, At(12, kill), scene_changes=changes, **options)
    begin(parted, resume=parted, scene_changes=changes, **options)
    assert_same(parted, straight)


def test_only_the_same_run_is_gone_on_with(whole, tmp_path):
    with pytest.raises(SceneError, match="holds no run to go on with"):
        begin(tmp_path / "nothing", resume=tmp_path)
    with pytest.raises(SceneError, match=r"that run has ended; --resume .*checkpoint\.npz goes on from its end"):
        begin(tmp_path / "nothing", resume=whole)
    with pytest.raises(KilledError):
        begin(tmp_path, At(2, kill))
    with pytest.raises(SceneError, match=r"gravity\[1\] is not as it was"):
        begin(tmp_path, resume=tmp_path, scene_changes={"gravity": [0.0, -5.0]})
    with pytest.raises(SceneError, match="was run with video = mp4, not gif"):
        begin(tmp_path, resume=tmp_path, video="gif")
    (folder,) = left_over(tmp_path)
    (folder / "video.mp4").write_bytes(b"short")
    with pytest.raises(SceneError, match="is damaged"):
        begin(tmp_path, resume=tmp_path)


def test_a_run_that_goes_through_removes_what_a_killed_one_left(whole, tmp_path):
    with pytest.raises(KilledError):
        begin(tmp_path, At(2, kill))
    assert left_over(tmp_path)
    begin(tmp_path)
    assert_same(tmp_path, whole)


@pytest.mark.slow
def test_a_process_that_is_killed(whole, tmp_path):
    """What the others do in this process, by the command and a signal that nothing can catch."""
    root = Path(sandbox.__file__).parents[1]
    changes = [f"--set={key}={json.dumps(value)}" for key, value in CHANGES.items()]
    command = [sys.executable, "-m", "sandbox", "run", "drop_2d", *changes, "--quiet", "--out", str(tmp_path)]
    with subprocess.Popen(command, cwd=root) as process:
        end = time.monotonic() + 90.0
        while not list(tmp_path.glob("unfinished-*/checkpoint.npz")) and time.monotonic() < end:
            time.sleep(0.01)
        refused = subprocess.run([*command, "--resume", tmp_path], cwd=root, capture_output=True, text=True)
        process.kill()
    if process.returncode == -signal.SIGKILL:
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1) and "still going on" in refused.stderr
        subprocess.run([*command, "--resume", tmp_path], cwd=root, check=True)
    assert_same(tmp_path, whole)


@pytest.mark.parametrize("kind", ["mp4", "webm", "gif", "png"])
def test_writers_go_on_from_any_picture(tmp_path, kind):
    random = np.random.default_rng(5)
    pictures = np.repeat(np.repeat(random.integers(0, 255, (41, 6, 8, 3), dtype=np.uint8), 8, axis=1), 8, axis=2)

    def write(folder, memory, some):
        folder.mkdir(exist_ok=True)
        writer = open_writer(folder, kind, 23.976, memory)
        for picture in some:
            writer.write(picture)
        return writer

    straight = write(tmp_path / "straight", None, pictures)
    straight.close()
    straight.settle()
    for cut in (1, 7, 13, 32):
        folder = tmp_path / str(cut)
        memory = write(folder, None, pictures[:cut]).memory()
        write(folder, memory, pictures[cut : cut + 5])  # what came after the memory does not count
        parted = write(folder, memory, pictures[cut:])
        parted.close()
        parted.settle()
        assert contents(folder) == contents(tmp_path / "straight")


def test_a_video_shows_its_pictures_at_their_times(tmp_path):
    writer = open_writer(tmp_path, "mp4", 25.0)
    assert isinstance(writer, VideoWriter)
    shades = np.linspace(20, 230, 45).astype(np.uint8)
    for shade in shades:
        writer.write(np.full((48, 64, 3), shade, dtype=np.uint8))
    writer.close()
    writer.settle()
    with av.open(str(tmp_path / "video.mp4")) as video:
        frames = list(video.decode(video=0))
        assert video.streams.video[0].average_rate == 25 and video.duration == 45 * 40_000
    np.testing.assert_allclose([frame.time for frame in frames], np.arange(45) / 25.0, atol=1e-6)
    found = [frame.to_ndarray(format="rgb24").mean() for frame in frames]
    np.testing.assert_allclose(found, shades, atol=2.5)
