"""A stored run drawn anew: the same picture where nothing is changed, another where something is; and in notebooks."""

import base64
import re
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

import sandbox
from sandbox import RunOptions, SandboxError, SceneError, Simulation, run
from sandbox.output.inline import InlineVideo
from tests.conftest import left_in
from tests.output.conftest import flat_scene, solid_scene

LOOKS = [(solid_scene, "strain"), (solid_scene, "body"), (flat_scene, "speed")]


def frames(folder):
    return [iio.imread(path) for path in sorted((folder / "frames").iterdir())]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Runs with pictures and trajectories, by scene and colour."""
    made = {}

    def of(make, color):
        if (make, color) not in made:
            folder = tmp_path_factory.mktemp(color)
            made[make, color] = run(make(color=color), RunOptions("scene", folder, video="png", trajectory="npz"))
        return made[make, color]

    return of


@pytest.mark.parametrize(("make", "color"), LOOKS, ids=["solid by strain", "solid", "flat by speed"])
def test_unchanged_options_give_the_same_pictures(drawn, make, color, run_cli, tmp_path):
    summary = drawn(make, color)
    folder = tmp_path / "again"
    code, printed, errors = run_cli("render", summary.folder, "--video", "png", "--out", folder, "--quiet")
    assert (code, printed, errors) == (0, "", "")
    there, again = frames(Path(summary.folder)), frames(folder)
    assert len(there) == len(again) == summary.pictures
    assert all(np.array_equal(one, other) for one, other in zip(there, again, strict=True))
    assert not np.array_equal(again[0], again[-1])
    assert np.array_equal(iio.imread(folder / "poster.png"), summary.poster().pixels)


def test_another_camera_color_and_size(drawn, run_cli, tmp_path, monkeypatch):
    """Nothing is simulated for it."""
    summary = drawn(solid_scene, "body")
    monkeypatch.setattr(Simulation, "advance", None)
    arguments = ("--size", "128x64", "--fps", "10", "--set", "bodies.0.color=#0000ff", "--video", "png", "--quiet")
    code, _, errors = run_cli(
        "render", summary.folder, "--camera", "eye=0,0.4,2 target=0,0.4,0", *arguments, "--out", tmp_path
    )
    assert (code, errors) == (0, "")
    again = frames(tmp_path)
    assert len(again) == 2 and again[0].shape == (64, 128, 3)
    middle = again[0][32, 64].astype(int)
    assert middle[2] > middle[0] + 50
    assert sandbox.load_scene(tmp_path / "scene.toml").render.camera.eye == (0.0, 0.4, 2.0)


REFUSED = [
    (("--set", "solver.dt=1"), "only render.* and colours can change"),
    (("--set", "bodies.0.material.mass=2"), "only render.* and colours can change"),
    (("--set", "render=1"), "only render.* and colours can change"),
    (("--set", "render.colour=strain"), "unknown key; did you mean color?"),
    (("--set", "nonsense"), "must be KEY=VALUE"),
    (("--camera", "eye"), "--camera eye: must be like eye=1,2,5"),
    (("--camera", "eye=a,b,c"), "--camera eye=a,b,c: must be like"),
    (("--camera", "eye=1,2"), "must have 3 components"),
    (("--fps", "15"), "the run holds 20 pictures a second"),
    (("--size", "7x7"), "--size: render.size[0]: must be >= 16"),
    (("--renderer", "none"), "--renderer none: there would be nothing to see"),
]


@pytest.mark.parametrize(("arguments", "message"), REFUSED, ids=[" ".join(row[0]) for row in REFUSED])
def test_what_cannot_change_is_refused(solid_run, refuses, arguments, message):
    refuses(message, "render", solid_run.folder, *arguments)


def test_the_run_itself_is_not_drawn_over(solid_run, refuses):
    refuses("is the run itself", "render", solid_run.folder, "--out", solid_run.folder)
    assert (solid_run.folder / "trajectory.npz").exists()


def test_a_folder_without_trajectory_is_refused(refuses, tmp_path):
    refuses("holds no trajectory; run the scene with --trajectory", "render", tmp_path)
    refuses("holds no trajectory", "export", tmp_path)
    refuses("a.npz: cannot be read: No such file", "export", tmp_path / "a.npz")


def test_export_of_a_stored_run_equals_that_of_the_run(solid_run, run_cli, tmp_path, monkeypatch):
    """To the byte, without simulating, and beside what the folder holds."""
    monkeypatch.setattr(Simulation, "advance", None)
    (tmp_path / "mine.txt").write_text("mine")
    arguments = ("--format", "ply,vtu", "--out", tmp_path, "--quiet")
    assert run_cli("export", solid_run.folder, *arguments)[0] == 0
    assert run_cli("export", solid_run.folder, "--format", "obj,glb", *arguments[2:])[0] == 0
    assert left_in(tmp_path) == {"mine.txt", "ply", "vtu", "scene.pvd", "obj", "scene.glb"}
    for kind in ("ply", "obj"):
        for path in (tmp_path / kind).iterdir():
            assert path.read_bytes() == (solid_run.folder / kind / path.name).read_bytes()
    assert len(list((tmp_path / "vtu").iterdir())) == 5


def test_export_simulates_a_scene(run_cli, tmp_path):
    out = tmp_path / "out"
    code, printed, _ = run_cli("export", "drop_2d", "--format", "obj", "--seconds", "0.1", "--out", out)
    assert code == 0 and "obj" in printed
    assert [path.name for path in sorted((out / "obj").iterdir())] == [f"drop_2d_{k:04d}.obj" for k in range(4)]
    assert not (out / "video.mp4").exists()


@pytest.mark.filterwarnings("always::sandbox.warning_log.StabilityWarning")
def test_only_the_start_is_drawn_where_there_is_nothing_else(run_cli, tmp_path):
    """Of a run that went wrong at once."""
    arguments = ("--set", "solver.dt=0.01", "--trajectory", "npz", "--renderer", "none", "--quiet")
    code, _, _ = run_cli("run", "drop_2d", *arguments, "--out", tmp_path / "run")
    assert code == 3
    code, _, errors = run_cli("render", tmp_path / "run", "--size", "160x96", "--quiet")
    assert (code, errors) == (0, "") and (tmp_path / "run-render" / "poster.png").exists()


def test_show_is_the_picture_of_the_run(drawn):
    summary = drawn(flat_scene, "speed")
    with Simulation(flat_scene(color="speed")) as simulation:
        simulation.advance(0.15)
        picture = simulation.show()
        assert simulation.show(size=(64, 32)).pixels.shape == (32, 64, 3)
        with pytest.raises(SceneError, match=r"size \(3, 5\): must be two even numbers"):
            simulation.show(size=(3, 5))
        simulation.advance(0.05)  # goes on
    assert np.array_equal(picture.pixels, frames(Path(summary.folder))[-1])
    data = picture._repr_png_()
    assert data[:8] == b"\x89PNG\r\n\x1a\n" and np.array_equal(iio.imread(data), picture.pixels)


@pytest.mark.parametrize(("kind", "begins"), [("mp4", b"ftyp"), ("webm", b"\x1a\x45\xdf\xa3"), ("gif", b"GIF89a")])
def test_videos_show_themselves(tmp_path, kind, begins):
    summary = run(flat_scene(), RunOptions("flat", tmp_path, video=kind))
    html = summary.video()._repr_mimebundle_()["text/html"]
    data = base64.b64decode(re.search(r'base64,([^"]+)"', html).group(1))
    assert begins in data[:12] and html.startswith("<img" if kind == "gif" else "<video")
    assert summary.poster()._repr_png_()[:4] == b"\x89PNG"


def test_where_there_is_no_video(solid_run, tmp_path):
    with pytest.raises(SandboxError, match="has no video"):
        InlineVideo.of_folder(solid_run.folder)
    summary = run(flat_scene(), RunOptions("flat", tmp_path, renderer="none"))
    with pytest.raises(SandboxError, match="drew no pictures"):
        summary.poster()


def test_the_docs_run(tmp_path, monkeypatch):
    """The Python of docs/export.md, as it stands there."""
    text = (Path(sandbox.__file__).parent.parent / "docs" / "export.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    for block in blocks:
        exec(block, names)
    assert len(blocks) == 2 and names["picture"].pixels.shape == (180, 320, 3)
    assert (tmp_path / "outputs" / "drop" / "trajectory.npz").exists()
