"""What a run may replace in its folder, and what of others it leaves alone."""

import json
import os
from pathlib import Path

import pytest

from sandbox import RunOptions, SandboxError, SceneError, run
from sandbox.output.folder import RunFolder
from sandbox.output.mark import MARK
from sandbox.trade.store import Store
from tests.conftest import falling_point, left_in


def leave(folder: Path, adds: bool = False, **texts: str) -> None:
    """A run that leaves files: names with _ for the dot."""
    named = {name.replace("_", "."): text for name, text in texts.items()}
    left = RunFolder(folder, tuple(named))
    with left.discarded_on_failure():
        for name, text in named.items():
            left.write_text(name, text)
        left.publish(adds)


def contents(folder: Path) -> dict[str, object]:
    """All that is in a folder, the mark apart: bytes of files, targets of links, None for folders."""
    inside = (path for path in sorted(folder.rglob("*")) if path.name != MARK)
    return {
        str(path.relative_to(folder)): os.readlink(path)
        if path.is_symlink()
        else None
        if path.is_dir()
        else path.read_bytes()
        for path in inside
    }


def file(folder: Path) -> None:
    (folder / "metrics.csv").write_text("mine")


def folder_of_that_name(folder: Path) -> None:
    (folder / "metrics.csv").mkdir()
    (folder / "metrics.csv" / "mine").write_text("mine")


def link(folder: Path) -> None:
    (folder / "elsewhere").write_text("mine")
    (folder / "metrics.csv").symlink_to("elsewhere")


def dangling_link(folder: Path) -> None:
    (folder / "metrics.csv").symlink_to("nowhere")


def link_in_place_of_a_product(folder: Path) -> None:
    leave(folder, metrics_csv="old")
    (folder / "metrics.csv").rename(folder / "moved")
    (folder / "metrics.csv").symlink_to("moved")


def changed_product(folder: Path) -> None:
    leave(folder, metrics_csv="old")
    (folder / "metrics.csv").write_text("new")


def product_of_a_run_that_did_not_leave_it(folder: Path) -> None:
    leave(folder, scene_toml="old")
    (folder / "metrics.csv").write_text("mine")


def mark_that_is_none(folder: Path) -> None:
    (folder / MARK).write_text("mine")


def mark_that_leads_out_of_the_folder(folder: Path) -> None:
    (folder / MARK).write_text(json.dumps({"files": {"../mine": []}}))


def summary_of_another_program(folder: Path) -> None:
    (folder / "summary.json").write_text(json.dumps({"files": ["metrics.csv"], "status": "done"}))
    (folder / "metrics.csv").write_text("mine")


REFUSED = [
    file, folder_of_that_name, link, dangling_link, link_in_place_of_a_product, changed_product,
    product_of_a_run_that_did_not_leave_it, mark_that_is_none, mark_that_leads_out_of_the_folder,
    summary_of_another_program,
]  # fmt: skip


@pytest.mark.parametrize("make", REFUSED, ids=[make.__name__ for make in REFUSED])
def test_what_no_run_has_left_is_refused_before_anything_is_done(tmp_path, make):
    make(tmp_path)
    before = contents(tmp_path)
    with pytest.raises(SceneError, match="choose another --out") as caught:
        leave(tmp_path, metrics_csv="a run's")
    assert caught.value.exit_code == 2 and "\n" not in str(caught.value)
    assert contents(tmp_path) == before


def test_a_file_or_a_broken_link_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("nowhere")
    for name in ("file", "link"):
        with pytest.raises(SceneError, match=f"{name}: is no folder"):
            RunFolder(tmp_path / name)
    (tmp_path / "real").mkdir()
    (tmp_path / "good").symlink_to("real")
    leave(tmp_path / "good", metrics_csv="x")
    assert left_in(tmp_path / "real") == {"metrics.csv"} and (tmp_path / "file").read_text() == "mine"


def test_a_run_replaces_and_takes_away_what_runs_have_left_and_nothing_else(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    leave(tmp_path, metrics_csv="1", video_mp4="1", scene_toml="1")
    (tmp_path / "video.mp4").write_text("cut by hand")
    leave(tmp_path, metrics_csv="2", tuned_toml="2")
    assert contents(tmp_path) == {
        "metrics.csv": b"2", "notes.txt": b"mine", "tuned.toml": b"2", "video.mp4": b"cut by hand",
    }  # fmt: skip
    leave(tmp_path, adds=True, trade_csv="3")
    leave(tmp_path, metrics_csv="4")
    assert left_in(tmp_path) == {"metrics.csv", "notes.txt", "video.mp4"}


def test_a_folder_of_pictures_is_kept_once_somebody_has_added_to_it(tmp_path):
    for mine in (None, "note.txt", "link"):
        pictures = RunFolder(tmp_path / str(mine), ("frames",))
        (pictures.partial / "frames").mkdir()
        (pictures.partial / "frames" / "00001.png").write_text("picture")
        pictures.publish()
        if mine == "note.txt":
            (tmp_path / mine / "frames" / mine).write_text("mine")
        elif mine == "link":
            (tmp_path / mine / "frames" / mine).symlink_to("nowhere")
        leave(tmp_path / str(mine), metrics_csv="x")
        assert (tmp_path / str(mine) / "frames").exists() == (mine is not None)
        if mine is not None:
            with pytest.raises(SceneError, match="frames: "):
                RunFolder(tmp_path / mine, ("frames",))


def test_what_comes_while_a_run_goes_on_stays_and_the_run_is_beside_it(tmp_path):
    late = RunFolder(tmp_path, ("metrics.csv",))
    late.write_text("metrics.csv", "a run's")
    (tmp_path / "metrics.csv").write_text("mine")
    with (
        pytest.raises(SandboxError, match=r"metrics.csv: .*; this run is in .*run-") as caught,
        late.discarded_on_failure(),
    ):
        late.publish()
    assert caught.value.exit_code == 1
    aside = f"run-{os.getpid()}"
    assert contents(tmp_path) == {"metrics.csv": b"mine", aside: None, f"{aside}/metrics.csv": b"a run's"}


def test_of_two_runs_at_once_the_later_one_stays(tmp_path, monkeypatch):
    first = RunFolder(tmp_path, ("metrics.csv",))
    monkeypatch.setattr("sandbox.output.folder.os.getpid", lambda: os.getppid())
    second = RunFolder(tmp_path, ("metrics.csv",))
    for number, one in enumerate((first, second)):
        one.write_text("metrics.csv", str(number))
        one.publish()
    assert contents(tmp_path) == {"metrics.csv": b"1"}


def test_a_run_that_was_killed_while_it_published_is_replaced(tmp_path, monkeypatch):
    leave(tmp_path, metrics_csv="1", scene_toml="1")
    after = RunFolder(tmp_path, ("metrics.csv", "scene.toml"))
    after.write_text("metrics.csv", "2")
    after.write_text("scene.toml", "2")
    replace = Path.replace

    def killed_at_the_scene(path, target):
        if Path(target).name == "scene.toml":
            raise KeyboardInterrupt
        return replace(path, target)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Path, "replace", killed_at_the_scene)
        after.publish()
    assert contents(tmp_path)["metrics.csv"] == b"2" and contents(tmp_path)["scene.toml"] == b"1"
    monkeypatch.setattr("sandbox.output.folder._own", set())  # as in another process
    leave(tmp_path, metrics_csv="3", scene_toml="3")
    assert contents(tmp_path) == {"metrics.csv": b"3", "scene.toml": b"3"}


def test_unfinished_folders_of_others_stay(tmp_path):
    for name in ("unfinished-notes", "unfinished-77"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine").write_text("mine")
    leave(tmp_path, metrics_csv="x")
    assert {"unfinished-notes/mine", "unfinished-77/mine"} <= contents(tmp_path).keys()


def test_a_study_forgets_its_rows_and_nothing_else(tmp_path):
    (tmp_path / "mine.json").write_text("mine")
    (tmp_path / f"{'0a' * 12}.json").write_text("{}")
    (tmp_path / f"{'0a' * 12}.time.json").write_text("{}")
    Store(tmp_path).clear()
    assert left_in(tmp_path) == {"mine.json"}


def test_a_run_into_the_folder_of_an_older_version_or_of_the_run_that_it_goes_on_from(tmp_path):
    """What has no mark is known by its summary."""

    def go(**more):
        return run(falling_point(duration=0.1), RunOptions("point", tmp_path, renderer="none", **more))

    go(exports=("ply",))
    (tmp_path / MARK).unlink()
    names = json.loads((tmp_path / "summary.json").read_text())["files"]
    assert set(names) == left_in(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    go()
    assert left_in(tmp_path) == {"notes.txt", *names} - {"ply"}
    scene = falling_point(duration=0.2)
    summary = run(scene, RunOptions("point", tmp_path, renderer="none", resume=tmp_path / "checkpoint.npz"))
    assert summary.simulated == pytest.approx(0.2) and left_in(tmp_path) == {"notes.txt", *summary.files}


@pytest.mark.parametrize(
    ("arguments", "product"),
    [
        (("run",), "scene.toml"),
        (("run", "--video", "png"), "frames"),
        (("run", "--trajectory", "npz", "--renderer", "none"), "trajectory.npz"),
        (("export", "--format", "ply"), "ply"),
        (("stability", "--map"), "stability_map.png"),
        (("measure",), "trade.csv"),
        (("measure", "--model"), "models.json"),
        (("tune", "--error", "1%"), "tuned.toml"),
        (("sweep", "--vary", "drag=0,1"), "sweep.csv"),
        (("sweep", "--vary", "drag=0,1", "--posters"), "sweep.png"),
    ],
)
def test_every_command_keeps_files_of_others(run_cli, tmp_path, arguments, product):
    (tmp_path / product).write_text("mine")
    command, *more = arguments
    code, printed, errors = run_cli(command, "drop_2d", *more, "--out", tmp_path, "--quiet")
    assert (code, printed) == (2, "") and errors.count("\n") == 1
    assert f"{tmp_path / product}: is there already, not of an earlier run" in errors
    assert contents(tmp_path) == {product: b"mine"}
