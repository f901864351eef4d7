"""Pictures by a Vulkan driver: the same framing as the software renderer's, and what happens without a driver."""

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import taichi as ti

from sandbox import load_scene
from sandbox.render import RendererName, create_renderer
from sandbox.render.ggui.messages import Frame
from sandbox.render.ggui.process import DriverError
from sandbox.render.ggui.renderer import GguiRenderer, RendererWarning
from sandbox.render.ggui.rounds import capsule_pattern, stadium_pattern
from sandbox.render.ggui.shared import SharedArrays
from sandbox.render.software import SoftwareRenderer
from sandbox.scene.assemble import assemble
from sandbox.scene.model import ColorBy, Interaction, Render

SIZE = (480, 270)


@pytest.fixture(scope="module")
def driver(taichi_started, make_appearance):
    """Skips what needs a driver where there is none."""
    points = make_appearance(spheres=[0], sphere_radius=[0.1], sphere_body=[0])
    try:
        GguiRenderer(points, Render(size=(32, 32))).close()
    except DriverError as error:
        pytest.skip(f"{error}; Debian's mesa-vulkan-drivers has one that needs no GPU")


@pytest.fixture
def both(driver, make_field):
    """Draw a scene with both renderers, all bodies in pure green."""
    opened = []

    def draw(scene, render=None, torn=None, **options):
        assembly = assemble(scene)
        green = np.tile([[0.05, 0.95, 0.05]], (len(scene.bodies), 1))
        appearance = replace(assembly.appearance, body_colors=green)
        render = Render(**{**dict(scene.render), "size": SIZE, **(render or {})})
        opened[:] = [SoftwareRenderer(appearance, render), GguiRenderer(appearance, render)]
        field = make_field(assembly.positions)
        return [renderer.draw(field, 0, torn=torn, **options) for renderer in opened]

    yield draw
    for renderer in opened:
        renderer.close()


def silhouette(picture):
    """Where something green is."""
    red, green, blue = np.moveaxis(picture.astype(int), 2, 0)
    return green - np.maximum(red, blue) > 40


def overlap(one, other):
    """Intersection over union."""
    return np.count_nonzero(one & other) / np.count_nonzero(one | other)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("jelly", {}),
        ("boxes_2d", {}),
        ("balloons_2d", {}),
        ("cloth", {}),
        ("rope", {}),
        ("jelly", {"struts": True, "particles": True}),
    ],
)
def test_bodies_are_where_the_software_renderer_has_them(both, name, options):
    masks = [silhouette(picture) for picture in both(load_scene(name), options)]
    assert np.count_nonzero(masks[0]) > 500
    # Ropes are a few pixels wide: their edges are most of them.
    assert overlap(*masks) >= (0.95 if name != "rope" else 0.85)


def test_ground_sky_and_light_look_alike(both):
    pictures = both(load_scene("jelly"))
    apart = np.abs(pictures[0].astype(float) - pictures[1])
    # All but the edges of shadows.
    assert np.mean(apart.max(axis=2) > 24) < 0.04
    assert apart.mean() < 4.0


def test_colors_show_values_with_the_same_legend(driver, make_field):
    scene = load_scene("jelly")
    assembly = assemble(scene)
    field = make_field(assembly.positions)
    values = ti.field(ti.f32, assembly.particle_count)
    values.from_numpy(np.linspace(0.0, 1.0, assembly.particle_count).astype(np.float32))
    pictures = []
    for kind in (SoftwareRenderer, GguiRenderer):
        renderer = kind(assembly.appearance, Render(size=SIZE, color=ColorBy.STRAIN))
        with pytest.raises(ValueError, match="no values"):
            renderer.draw(field, 0)
        renderer.set_color_max(1.0)
        pictures.append(renderer.draw(field, 0, values).astype(float))
        renderer.close()
        with pytest.raises(RuntimeError, match="closed"):
            renderer.draw(field, 0, values)
    assert np.abs(pictures[0] - pictures[1]).mean() < 4.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_has_torn_is_not_drawn(both, dimension):
    name, body = ("tug", 0) if dimension == 3 else ("boxes_2d", 0)
    overrides = {f"bodies.{body}.material.break_strain": 0.5}
    scene = load_scene(name, overrides=overrides)
    assembly = assemble(scene)
    torn = ti.field(ti.i32, assembly.spring_count)
    whole = [np.count_nonzero(silhouette(picture)) for picture in both(scene, torn=torn)]
    torn.fill(1)
    own = [np.count_nonzero(silhouette(picture)) for picture in both(scene, torn=torn)]
    assert own[1] < 0.8 * whole[1]
    assert abs(own[0] - own[1]) < 0.02 * whole[0]


def test_a_rope_parts_where_nothing_has_a_surface(both):
    """What can be cut live tears: of a rope there are capsules to hide, but no triangles."""
    scene = load_scene("rope").model_copy(update={"interaction": Interaction(), "colliders": ()})
    torn = ti.field(ti.i32, assemble(scene).spring_count)
    whole = [np.count_nonzero(silhouette(picture)) for picture in both(scene, torn=torn)]
    torn.from_numpy((2 * np.arange(torn.shape[0]) < torn.shape[0]).astype(np.int32))
    parted = [np.count_nonzero(silhouette(picture)) for picture in both(scene, torn=torn)]
    for before, after in zip(whole, parted, strict=True):
        assert 0.3 * before < after < 0.7 * before
    assert abs(parted[0] / whole[0] - parted[1] / whole[1]) < 0.1


def test_the_driver_is_not_blamed_for_what_it_did_not_do(driver, make_appearance):
    points = make_appearance(spheres=[0], sphere_radius=[0.1], sphere_body=[0])
    renderer = GguiRenderer(points, Render(size=(32, 32)))
    assert renderer._process is not None
    with pytest.raises(DriverError, match=r"^the picture could not be drawn \(IndexError: .*\)$"):
        renderer._process.ask(Frame(time=0.0, slot=7))
    renderer.close()


def test_a_driver_that_dies_leaves_the_rest_to_the_software_renderer(driver, cube, make_appearance, make_field):
    points, triangles = cube
    appearance = make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)))
    field = make_field(points)
    renderer = GguiRenderer(appearance, Render(size=SIZE))
    first = renderer.draw(field, 0)
    assert renderer._process is not None
    os.kill(renderer._process.pid, signal.SIGKILL)
    with pytest.warns(RendererWarning, match=r"crashed.*the software renderer draws on"):
        second = renderer.draw(field, 0)
    third = renderer.draw(field, 0)
    assert np.abs(first.astype(float) - second).mean() < 8.0
    assert np.array_equal(second, third)
    renderer.close()


@pytest.mark.parametrize("name", ["VK_ICD_FILENAMES", "VK_DRIVER_FILES"])
def test_without_a_driver_a_line_says_so_and_the_software_renderer_draws(name, monkeypatch, make_appearance, tmp_path):
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path / "none.json"))
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    points = make_appearance(spheres=[0], sphere_radius=[0.1], sphere_body=[0])
    with pytest.warns(RendererWarning, match="no Vulkan driver") as caught:
        renderer = create_renderer(RendererName.GGUI, points, Render(size=(32, 32)))
    assert isinstance(renderer, SoftwareRenderer)
    assert all("\n" not in str(warning.message) for warning in caught)
    renderer.close()


def test_the_drawing_process_ends_with_the_renderer(driver, make_appearance):
    points = make_appearance(spheres=[0], sphere_radius=[0.1], sphere_body=[0])
    renderer = GguiRenderer(points, Render(size=(32, 32)))
    assert renderer._process is not None
    pid, path = renderer._process.pid, renderer._arrays.layout.path
    assert not Path(path).exists(), "the shared file has no name that could be left behind"
    renderer.close()
    deadline = time.monotonic() + 5.0
    while Path(f"/proc/{pid}").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not Path(f"/proc/{pid}").exists()


def test_shared_arrays_are_seen_by_both_sides():
    one = SharedArrays.create({"a": (np.float32, (3, 2)), "none": (np.uint8, (0,)), "b": (np.uint8, (5,))})
    other = SharedArrays(one.layout)
    one["a"][1] = 7.0
    other["b"][:] = 3
    assert other["a"].sum() == 14.0 and one["b"].sum() == 15 and len(one["none"]) == 0
    one.forget_name()
    assert not Path(one.layout.path).exists()
    one["a"][0] = 1.0
    assert other["a"].sum() == 16.0


def test_capsules_are_closed_and_turn_outward():
    for count in (1, 500, 5000, 20000):
        pattern = capsule_pattern(count)
        corners = pattern.directions + np.array([[0.0, 0.0, 0.5]]) * pattern.ends[:, None]
        a, b, c = np.moveaxis(corners[pattern.triangles], 1, 0)
        normal = np.cross(b - a, c - a)
        middle = (a + b + c) / 3 - np.array([0.0, 0.0, 0.25])
        assert np.all((normal * middle).sum(axis=1) > -1e-12)
        # The volume of a closed surface, by the divergence theorem: a cylinder of height 1/2 between two half-balls.
        volume = (normal * a).sum() / 6
        assert volume == pytest.approx(np.pi * (0.5 + 4.0 / 3.0), rel=0.35 if count > 6000 else 0.13)
        edges = np.sort(pattern.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)


def test_flat_lines_have_round_ends():
    pattern = stadium_pattern(1)
    assert np.linalg.norm(pattern.directions, axis=1) == pytest.approx(1.0)
    assert np.all(pattern.directions[pattern.ends == 0][:, 0] < 1e-12)
    assert np.all(pattern.directions[pattern.ends == 1][:, 0] > -1e-12)
