"""Trajectories: what was simulated comes back to the bit; what is none is refused in one line."""

import shutil
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sandbox import RunOptions, SceneError, Trajectory, load_scene, run
from sandbox.errors import DivergedError
from sandbox.output import frame_arrays
from sandbox.output.trajectory import TrajectoryWriter
from sandbox.scene.load import scene_from_data
from tests.conftest import make_scene


@pytest.mark.parametrize("which", ["solid_run", "flat_run"])
def test_every_frame_comes_back_to_the_bit(which, request):
    stored = request.getfixturevalue(which)
    with stored.trajectory() as trajectory:
        assert len(trajectory) == len(stored.positions) >= 4
        fps = trajectory.scene.render.fps
        assert trajectory.times == pytest.approx(np.arange(len(trajectory)) / fps)
        # Backwards too: a zip is read forward.
        for number in [*range(len(trajectory)), 0, -1]:
            assert np.array_equal(trajectory.positions(number), stored.positions[number])
            assert np.array_equal(trajectory.velocities(number), stored.velocities[number])
            if trajectory.torn(number) is not None:
                assert np.array_equal(trajectory.torn(number), stored.torn[number])
    plain = np.load(stored.folder / "trajectory.npz")
    assert plain["positions"].dtype == (np.float32 if trajectory.precision == "f32" else np.float64)
    assert np.array_equal(plain["positions"].astype(np.float64), np.stack(stored.positions))


def test_the_sheet_tears_and_strain_is_stored(solid_run):
    with solid_run.trajectory() as trajectory:
        assert not trajectory.torn(0).any() and trajectory.torn(-1).any()
        assert trajectory.strain(-1).shape == (trajectory.particle_count,) and trajectory.strain(-1).max() > 0.01
        assert trajectory.poster == int(np.argmax(trajectory.merits)) > 0


def test_the_scene_is_inside(solid_run, tmp_path):
    """The file alone suffices."""
    shutil.copy(solid_run.folder / "trajectory.npz", tmp_path / "alone.npz")
    with Trajectory.open(tmp_path / "alone.npz") as trajectory:
        assert trajectory.scene == load_scene(solid_run.folder / "scene.toml")
        assert (trajectory.name, trajectory.precision, trajectory.arch) == ("scene", "f32", "cpu")


def test_zarr_holds_the_same_as_npz(flat_run, tmp_path, monkeypatch):
    zarr = pytest.importorskip("zarr", reason="zarr is not installed")
    monkeypatch.setattr(frame_arrays, "_CHUNK", 1)  # a row a chunk
    with flat_run.trajectory() as trajectory:
        scene = trajectory.scene
        run(scene, RunOptions("scene", tmp_path, renderer="none", trajectory="zarr"))
        with Trajectory.open(tmp_path) as again:
            assert again.path.name == "trajectory.zarr" and len(again) == len(trajectory) and again.scene == scene
            for number in (0, -1, 1):
                assert np.array_equal(again.positions(number), trajectory.positions(number))
                assert np.array_equal(again.strain(number), trajectory.strain(number))
    assert np.array_equal(zarr.open_group(tmp_path / "trajectory.zarr")["positions"][2], flat_run.positions[2])
    # A chunk that is lost is seen to be.
    next(
        path for path in (tmp_path / "trajectory.zarr" / "positions" / "c" / "2").rglob("*") if path.is_file()
    ).unlink()
    with Trajectory.open(tmp_path) as broken, pytest.raises(SceneError, match="is damaged"):
        broken.positions(2)


def test_a_row_that_was_interrupted_does_not_count(flat_run, tmp_path, monkeypatch):
    """Ctrl-C between two arrays of a frame: the frame is left out, those before are whole."""
    with flat_run.trajectory() as trajectory:
        frames, scene = list(trajectory.frames()), trajectory.scene
        writer = writer_like(trajectory, tmp_path)
    writer.write(frames[0])
    writer.write(frames[1])
    real = frame_arrays.np.ascontiguousarray

    def interrupted(values, dtype):
        if np.ndim(values) == 2:
            raise KeyboardInterrupt
        return real(values, dtype=dtype)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(frame_arrays.np, "ascontiguousarray", interrupted)
        writer.write(frames[2])
    writer.close()
    with Trajectory.open(tmp_path) as again:
        assert len(again) == 2 and again.scene == scene
        assert np.array_equal(again.positions(1), frames[1].positions)
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory.npz"]


def writer_like(trajectory, folder):
    """A writer of such trajectories."""
    from sandbox.output.trajectory import RunInfo, TrajectoryKind

    info = RunInfo("scene", trajectory.precision, "cpu", trajectory.particle_count, 1, tears=False)
    return TrajectoryWriter(folder, TrajectoryKind.NPZ, trajectory.scene, info)


@pytest.mark.filterwarnings("always::sandbox.warning_log.StabilityWarning")
def test_a_blow_up_keeps_what_was_before_it(tmp_path):
    scene = load_scene("drop_2d", {"duration": 1.0, "solver.dt": 0.00171})
    with pytest.raises(DivergedError) as caught:
        run(scene, RunOptions("drop_2d", tmp_path, renderer="none", trajectory="npz", exports=("vtu",)))
    with Trajectory.open(tmp_path) as trajectory:
        assert trajectory.times[0] == 0.0 and trajectory.times[-1] <= caught.value.time
        assert np.isfinite(trajectory.positions(-1)).all()
        assert len(list((tmp_path / "vtu").iterdir())) == len(trajectory)
    assert (tmp_path / "drop_2d.pvd").exists()


def test_mesh_files_of_the_scene_are_inside(tmp_path):
    """A scene that names a file is drawn as it was, even when the file has changed or is gone."""
    import trimesh

    file = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=1, radius=0.2).export(file)
    shape = {"kind": "mesh", "file": str(file), "fill": "shell"}
    body = {"name": "ball", "shape": shape, "material": {"stiffness": 100.0, "mass": 1.0}}
    scene = make_scene(dimension=3, duration=0.02, solver={"dt": 1e-3}, render={"fps": 50}, bodies=[body])
    run(scene, RunOptions("ball", tmp_path / "run", renderer="none", trajectory="npz"))
    with Trajectory.open(tmp_path / "run") as trajectory:
        assert trajectory.scene.bodies[0].shape.file == str(file)
    file.unlink()
    with Trajectory.open(tmp_path / "run") as trajectory:
        copy = Path(trajectory.scene.bodies[0].shape.file)
        assert copy != file and len(trimesh.load(copy).vertices) == trajectory.particle_count
    assert not copy.exists()


def broken_files(whole: Path) -> dict[str, bytes]:
    """Files that are nearly trajectories."""
    data = whole.read_bytes()

    def repacked(change) -> bytes:
        with tempfile.TemporaryFile() as file:
            with zipfile.ZipFile(whole) as old, zipfile.ZipFile(file, "w") as new:
                for name in old.namelist():
                    content = change(name, old.read(name))
                    if content is not None:
                        new.writestr(name, content)
            file.seek(0)
            return file.read()

    return {
        "empty": b"",
        "text": b"positions\n1 2 3\n",
        "half": data[: len(data) // 2],
        "no times": repacked(lambda name, content: None if name == "time.npy" else content),
        "short": repacked(lambda name, content: content[:-8] if name == "positions.npy" else content),
        "no metadata": repacked(lambda name, content: content[:100] if name == "metadata.npy" else content),
        "bad scene": repacked(lambda name, content: content[:256] if name == "scene.npy" else content),
        "newer": repacked(
            lambda name, content: (
                content.replace("format".encode("utf-32-le"), "f0rmat".encode("utf-32-le"))
                if name == "metadata.npy"
                else content
            )
        ),
    }


def test_broken_files_are_one_line(flat_run, tmp_path, run_cli):
    for name, content in broken_files(flat_run.folder / "trajectory.npz").items():
        path = tmp_path / f"{name}.npz"
        path.write_bytes(content)
        code, printed, errors = run_cli("render", path, "--out", tmp_path / "out", "--quiet", "--video", "none")
        assert (code, printed, errors.count("\n")) == (2, "", 1), (name, errors)
        assert "is not a trajectory, or is damaged" in errors, name
    assert not (tmp_path / "out").exists()
    (tmp_path / "x.zarr").mkdir()
    code, _, errors = run_cli("export", tmp_path / "x.zarr", "--quiet")
    assert code == 2 and errors.count("\n") == 1 and "is not a trajectory" in errors


def test_without_its_package_zarr_is_one_line(refuses, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "zarr", None)
    refuses("pip install 'softbody-sandbox[zarr]'", "run", "drop_2d", "--trajectory", "zarr")


def test_frames_are_numbered_from_the_end_too(flat_run):
    with flat_run.trajectory() as trajectory:
        assert trajectory.frame(-1).number == len(trajectory) - 1
        with pytest.raises(IndexError, match="there are 4"):
            trajectory.positions(4)
    assert scene_from_data(trajectory.data, None) == trajectory.scene
