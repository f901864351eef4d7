"""What the pictures show: shadows, depth order, both sides of a sheet, nothing stale, legends."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import taichi as ti
from PIL import Image

from sandbox.render import create_renderer
from sandbox.render.software import SoftwareRenderer
from sandbox.scene.model import BoxCollider, Camera, Render, SphereCollider

SMALL = (160, 90)
FRONT = Camera(eye=(0.0, 0.0, 6.0), target=(0.0, 0.0, 0.0))
RED, GREEN, BLUE = (1.0, 0.1, 0.1), (0.1, 1.0, 0.1), (0.1, 0.1, 1.0)
FLOAT, BESIDE, OUTSIDE = np.array([[0.0, 1.0, 0.0], [0.5, -0.3, 0.4], [0.0, 500.0, 0.0]])
BOUNDS = [[-1.2, 0.0, -1.2], [1.2, 1.8, 1.2]]


@pytest.fixture(scope="module")
def floating(cube, make_appearance, make_field, ground):
    """A cube above the ground in row 0, beside it in row 1, and far outside in row 2."""
    points, triangles = cube
    points = points * 0.8 + FLOAT
    appearance = make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)), colliders=[ground],
                                 bounds=BOUNDS)  # fmt: skip
    renderer = SoftwareRenderer(appearance, Render(size=SMALL))
    return renderer, make_field(points, points + BESIDE, points + OUTSIDE)


def pixel(picture, camera, point):
    """Colour where a point is seen."""
    x, y, _ = camera.project(np.asarray(point, dtype=float))
    return picture[int(y), int(x)].astype(int)


def test_shadow_falls_where_the_light_ray_meets_the_ground(floating):
    renderer, field = floating
    painter = renderer._painter
    empty, picture = renderer.draw(field, 2), renderer.draw(field, 0)
    light = painter.light.direction
    shadow = FLOAT - light * (FLOAT[1] / light[1])
    assert np.all(pixel(picture, painter.camera, shadow) < 0.85 * pixel(empty, painter.camera, shadow))
    for away in ([-1.1, 0.0, -0.4], [-0.9, 0.0, 1.0]):
        assert np.array_equal(pixel(picture, painter.camera, away), pixel(empty, painter.camera, away))


def test_shadow_has_soft_edges(floating):
    renderer, field = floating
    painter = renderer._painter
    empty, picture = renderer.draw(field, 2).astype(float), renderer.draw(field, 0).astype(float)
    light = painter.light.direction
    middle = FLOAT - light * (FLOAT[1] / light[1])
    away = np.cross(light, [0.0, 1.0, 0.0])
    path = painter.camera.project(middle + np.linspace(0, 1.2, 200)[:, None] * away / np.linalg.norm(away))
    y, x = path[:, 1].astype(int), path[:, 0].astype(int)
    inside = (y >= 0) & (y < SMALL[1]) & (x >= 0) & (x < SMALL[0])
    ratio = (picture[y, x] / empty[y, x])[inside, 0]
    assert np.any((ratio > 0.87) & (ratio < 0.97))


def test_nothing_is_stale(floating):
    renderer, field = floating
    first = renderer.draw(field, 0)
    assert not np.array_equal(renderer.draw(field, 1), first)
    assert np.array_equal(renderer.draw(field, 0), first)


def test_a_body_that_left_leaves_nothing(floating, make_appearance, ground):
    renderer, field = floating
    renderer.draw(field, 0)
    gone = renderer.draw(field, 2)
    empty = SoftwareRenderer(make_appearance(colliders=[ground], bounds=BOUNDS), Render(size=SMALL))
    assert np.array_equal(gone, empty.draw(field, 0))


def test_f64_positions_give_the_same_picture(floating, make_field):
    renderer, field = floating
    double = make_field(*field.to_numpy(), precision=ti.f64)
    difference = np.abs(renderer.draw(field, 0).astype(int) - renderer.draw(double, 0))
    # Two kernels may round differently: a sample on an edge may go to the neighbour.
    assert np.mean(difference > 2) < 1e-3


def test_the_picture_is_the_callers(floating):
    renderer, field = floating
    first = renderer.draw(field, 0)
    kept = first.copy()
    renderer.draw(field, 1)
    assert np.array_equal(first, kept) and first.dtype == np.uint8 and first.flags.c_contiguous


def test_silhouettes_are_antialiased(floating):
    renderer, field = floating
    picture, empty = renderer.draw(field, 0).astype(int), renderer.draw(field, 2).astype(int)
    painter = renderer._painter
    row = int(painter.camera.project(FLOAT)[1])
    redness = picture[row, :, 0] - picture[row, :, 2]
    assert empty[row].max() > 0 and redness.max() > 80
    edge = np.flatnonzero(redness > 60)[0] - 1
    assert redness[edge] < 60
    between = (redness > 15) & (redness < 60)
    assert np.any(between)


LAYERS = [[0.0, 0.0, 0.0], [-2.0, 0.0, 1.0], [2.0, 0.0, 1.0], [-1.5, -1.5, -1.0], [1.5, -1.5, -1.0], [0.0, 1.8, -1.0]]


def test_depth_order_of_sphere_capsule_and_triangle(make_appearance, make_field):
    appearance = make_appearance(
        body_count=3, body_colors=[RED, GREEN, BLUE], two_sided=[False, False, True], spheres=[0], sphere_radius=[0.5],
        capsules=[[1, 2]], capsule_radius=[0.2], capsule_body=[1], triangles=[[3, 4, 5]], triangle_body=[2],
    )  # fmt: skip
    renderer = SoftwareRenderer(appearance, Render(size=SMALL), FRONT)
    swapped = np.array(LAYERS)
    swapped[1:3, 2], swapped[3:, 2] = -2.0, 1.0
    field = make_field(LAYERS, swapped)
    camera = renderer._painter.camera
    near = renderer.draw(field, 0)
    # From the eye: capsule, sphere, triangle.
    assert np.argmax(pixel(near, camera, [0.0, 0.0, 1.2])) == 1
    assert np.argmax(pixel(near, camera, [0.0, 0.4, 0.0])) == 0
    assert np.argmax(pixel(near, camera, [0.0, 1.0, -1.0])) == 2
    # Now the triangle hides both.
    assert np.argmax(pixel(renderer.draw(field, 1), camera, [0.0, 0.0, 1.0])) == 2


def test_sphere_is_round_and_as_large_as_it_should_be(make_appearance, make_field):
    appearance = make_appearance(spheres=[0], sphere_radius=[0.8], body_colors=[RED])
    renderer = SoftwareRenderer(appearance, Render(size=SMALL), FRONT)
    difference = renderer.draw(make_field([[0.0, 0.0, 0.0]]), 0).astype(int)
    red = difference[..., 0] - difference[..., 2] > 40
    focal = renderer._painter.camera.focal
    radius = focal * np.tan(np.arcsin(0.8 / 6.0))
    assert red.sum() == pytest.approx(np.pi * radius**2, rel=0.06)


def test_closed_surfaces_show_their_outside_only_and_sheets_both(make_appearance, make_field):
    points = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.2, 0.0]]
    field = make_field(points)
    parts = {"triangles": [[0, 2, 1]], "triangle_body": [0], "body_colors": [RED]}
    hidden = SoftwareRenderer(make_appearance(**parts), Render(size=SMALL), FRONT).draw(field, 0)
    back = SoftwareRenderer(make_appearance(two_sided=[True], **parts), Render(size=SMALL), FRONT).draw(field, 0)
    parts["triangles"] = [[0, 1, 2]]
    front = SoftwareRenderer(make_appearance(two_sided=[True], **parts), Render(size=SMALL), FRONT).draw(field, 0)
    middle = (SMALL[1] // 2, SMALL[0] // 2)
    assert int(hidden[middle][0]) - int(hidden[middle][2]) < 20
    assert np.abs(back[middle].astype(int) - front[middle]).max() <= 1 and front[middle][0] > 100


def test_colliders_hide_and_are_hidden(make_appearance, make_field):
    box = BoxCollider(
        kind="box", position=(0.0, 0.0, 0.0), size=(1.0, 1.0, 1.0), rotation=(0.0, 45.0, 0.0), color="#0000ff"
    )
    ball = SphereCollider(kind="sphere", position=(1.6, 0.0, 0.0), radius=0.5, color="#00ff00")
    appearance = make_appearance(spheres=[0], sphere_radius=[0.3], body_colors=[RED], colliders=[box, ball])
    renderer = SoftwareRenderer(appearance, Render(size=SMALL), FRONT)
    field = make_field([[0.0, 0.0, -2.0]], [[0.0, 0.0, 2.0]])
    middle = (SMALL[1] // 2, SMALL[0] // 2)
    assert np.argmax(renderer.draw(field, 0)[middle]) == 2
    assert np.argmax(renderer.draw(field, 1)[middle]) == 0
    assert np.argmax(pixel(renderer.draw(field, 0), renderer._painter.camera, [1.6, 0.0, 0.0])) == 1


@pytest.fixture(scope="module")
def values():
    field = ti.field(ti.f64, 1)
    field.fill(0.5)
    return field


def test_legend_is_drawn_for_speed_only(make_appearance, make_field, values):
    appearance, field = make_appearance(spheres=[0], sphere_radius=[0.5], body_colors=[RED]), make_field([[0.0] * 3])
    size = (320, 180)
    plain = SoftwareRenderer(appearance, Render(size=size)).draw(field, 0)
    colored = SoftwareRenderer(appearance, Render(size=size, color="speed", color_max=1.0))
    picture = colored.draw(field, 0, values)
    corner = (slice(0, 90), slice(260, 320))
    assert plain[corner].std(axis=(0, 1)).max() < 12 < picture[corner].std(axis=(0, 1)).max()
    red, green, blue = picture[90, 160].astype(int)
    assert green > red and abs(green - blue) < 60
    again = colored.draw(field, 0, values)
    assert np.array_equal(again, picture)
    colored.set_color_max(0.5)
    red, green, blue = colored.draw(field, 0, values)[90, 160].astype(int)
    assert red > blue and green > blue
    with pytest.raises(ValueError, match="no values"):
        colored.draw(field, 0)
    with pytest.raises(ValueError, match="> 0"):
        colored.set_color_max(0.0)


def test_closing_frees_and_another_can_be_made(make_appearance, make_field):
    appearance, field = make_appearance(spheres=[0], sphere_radius=[0.5]), make_field([[0.0] * 3])
    pictures = []
    for _ in range(2):
        renderer = create_renderer("taichi", appearance, Render(size=SMALL))
        pictures.append(renderer.draw(field, 0))
        renderer.close()
        renderer.close()
        with pytest.raises(RuntimeError, match="closed"):
            renderer.draw(field, 0)
    assert np.array_equal(*pictures)


def golden_picture(cube, make_appearance, make_field, ground):
    """A twisted cube and a row of spheres on a rope over the ground."""
    points, triangles = cube
    angle = 0.9 * points[:, 1]
    twisted = np.stack([points[:, 0] * np.cos(angle) + points[:, 2] * np.sin(angle), points[:, 1] + 0.62,
                        points[:, 2] * np.cos(angle) - points[:, 0] * np.sin(angle)], axis=1)  # fmt: skip
    count = 12
    along = np.linspace(-1, 1, count)
    rope = np.stack([along * 1.2, 0.3 + 0.5 * along**2, 0.8 + 0 * along], axis=1)
    first = len(points)
    appearance = make_appearance(
        body_count=2, triangles=triangles, triangle_body=np.zeros(len(triangles)), colliders=[ground],
        capsules=[(first + k, first + k + 1) for k in range(count - 1)], capsule_radius=np.full(count - 1, 0.03),
        capsule_body=np.ones(count - 1), spheres=first + np.arange(count), sphere_radius=np.full(count, 0.06),
        sphere_body=np.ones(count), bounds=[[-1.25, 0.0, -0.7], [1.25, 1.2, 0.9]],
    )  # fmt: skip
    renderer = SoftwareRenderer(appearance, Render(size=(320, 180)))
    return renderer.draw(make_field(np.concatenate([twisted, rope])), 0)


GOLDEN = Path(__file__).parent / "golden" / "twist.png"


def test_golden_image(cube, make_appearance, make_field, ground):
    picture = golden_picture(cube, make_appearance, make_field, ground)
    if "SANDBOX_WRITE_GOLDEN" in os.environ:
        GOLDEN.parent.mkdir(exist_ok=True)
        Image.fromarray(picture).save(GOLDEN)
    golden = np.asarray(Image.open(GOLDEN), dtype=float) / 255
    assert np.mean((picture / 255 - golden) ** 2) < 2e-5


SCRIPT = """
import hashlib, sys
import numpy as np
from sandbox import runtime
runtime.start(arch="cpu", precision="f64", threads=1)
import taichi as ti
from sandbox.render.software import SoftwareRenderer
from sandbox.scene.appearance import Appearance
from sandbox.scene.model import HalfSpace, Render
empty = np.zeros(0, dtype=np.int32)
appearance = Appearance(3, empty.reshape(0, 3), empty, empty.reshape(0, 2), empty, np.array([[0, 1]]), np.array([0.3]),
    np.array([0]), np.array([2]), np.array([0.5]), np.array([0]), np.array([[1.0, 0.1, 0.1]]), np.array([False]),
    (HalfSpace(kind="half_space", point=(0.0, -1.0, 0.0), normal=(0.0, 1.0, 0.0)),), np.array([[-1.0] * 3, [1.0] * 3]),
    0.1, 3, np.zeros((0, 1), dtype=np.int32), np.zeros((0, 1)))
renderer = SoftwareRenderer(appearance, Render(size=(160, 90)))
field = ti.Vector.field(3, ti.f64, (1, 3))
field.from_numpy(np.array([[[-0.5, 0.0, 0.0], [0.5, 0.25, 0.0], [0.0, 0.5, 0.75]]]))
print(hashlib.sha256(renderer.draw(field, 0).tobytes()).hexdigest())
"""


def test_precision_of_the_simulation_and_threads_do_not_matter(make_appearance, make_field, ground):
    lower = ground.model_copy(update={"point": (0.0, -1.0, 0.0)})
    appearance = make_appearance(
        capsules=[[0, 1]], capsule_radius=[0.3], spheres=[2], sphere_radius=[0.5], body_colors=[RED], colliders=[lower]
    )
    field = make_field([[-0.5, 0.0, 0.0], [0.5, 0.25, 0.0], [0.0, 0.5, 0.75]])
    here = SoftwareRenderer(appearance, Render(size=SMALL)).draw(field, 0)
    there = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True).stdout.split()[
        -1
    ]
    assert there == hashlib.sha256(here.tobytes()).hexdigest()
