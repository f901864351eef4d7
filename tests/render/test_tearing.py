"""What has torn is neither drawn nor casts, and nothing else changes."""

import numpy as np
import pytest
import taichi as ti

from sandbox.render.software import SoftwareRenderer
from sandbox.scene.model import Camera, Render

SMALL = (160, 96)
RED, GREEN = (1.0, 0.1, 0.1), (0.1, 1.0, 0.1)
CELLS = 8
FAR = np.array([0.0, 500.0, 0.0])


def pixel(picture, camera, point):
    """Colour where a point is seen."""
    x, y = camera.project(np.asarray(point, dtype=float))[:2]
    return picture[int(y), int(x)].astype(int)


def spring_field(count, torn=()):
    """A field of springs of which some have torn."""
    field = ti.field(ti.i32, count)
    flags = np.zeros(count, dtype=np.int32)
    flags[list(torn)] = 1
    field.from_numpy(flags)
    return field


@pytest.fixture(scope="module")
def sheet():
    """A level sheet of 8 x 8 cells at height 1 and a rod beside it; triangles 2 c and 2 c + 1 share spring c."""
    along = np.linspace(-1, 1, CELLS + 1)
    points = [[x, 1.0, z] for x in along for z in along] + [[-1.4, 0.5, 0.0], [-1.4, 0.5, 1.0]]
    triangles = []
    for i in range(CELLS):
        for j in range(CELLS):
            a = i * (CELLS + 1) + j
            triangles += [(a, a + 1, a + CELLS + 2), (a, a + CELLS + 2, a + CELLS + 1)]
    springs = np.full((len(triangles), 3), -1)
    springs[:, 2] = np.arange(len(triangles)) // 2
    return np.array(points), np.array(triangles), springs


ABOVE = Camera(eye=(0.5, 6.0, 2.5), target=(0.0, 0.5, 0.0))
BELOW = Camera(eye=(0.5, 0.9, 5.0), target=(0.0, 0.2, 0.0))


@pytest.fixture(scope="module")
def torn_sheet(sheet, make_appearance, make_field, ground):
    """The sheet seen from above, and from below, where it does not hide its shadow."""
    return tuple(draw_torn(camera, sheet, make_appearance, make_field, ground) for camera in (ABOVE, BELOW))


def draw_torn(camera, sheet, make_appearance, make_field, ground):
    """Painter, and pictures without bodies, whole and torn: a hole of two by two cells in the middle, and no rod."""
    points, triangles, springs = sheet
    count = CELLS * CELLS + 1
    parts = {
        "triangles": triangles, "triangle_body": np.zeros(len(triangles)), "two_sided": [True, False], "body_count": 2,
        "capsules": [[len(points) - 2, len(points) - 1]], "capsule_radius": [0.1], "capsule_body": [1],
        "colliders": [ground], "bounds": [[-1.5, 0.0, -1.0], [1.0, 1.0, 1.0]], "body_colors": [RED, GREEN],
    }  # fmt: skip
    appearance = make_appearance(triangle_springs=springs, capsule_spring=[count - 1], **parts)
    renderer = SoftwareRenderer(appearance, Render(size=SMALL), camera)
    field = make_field(points, points + FAR)
    middle = CELLS // 2
    hole = [i * CELLS + j for i in (middle - 1, middle) for j in (middle - 1, middle)]
    pictures = {
        "empty": renderer.draw(field, 1),
        "whole": renderer.draw(field, 0, None, 0.0, spring_field(count)),
        "torn": renderer.draw(field, 0, None, 0.0, spring_field(count, [*hole, count - 1])),
        "again": renderer.draw(field, 0),
        "plain": SoftwareRenderer(make_appearance(**parts), Render(size=SMALL), camera).draw(field, 0),
    }
    return renderer._painter, pictures


def test_a_hole_shows_the_ground(torn_sheet):
    painter, pictures = torn_sheet[0]
    hole = [0.0, 1.0, 0.0]
    red, green, _ = pixel(pictures["whole"], painter.camera, hole)
    assert red > 2 * green
    # The ground behind the hole may lie in the sheet's shadow.
    red, green, blue = pixel(pictures["torn"], painter.camera, hole)
    assert abs(red - green) < 30 and abs(green - blue) < 30
    beside = [0.7, 1.0, 0.7]
    assert np.array_equal(
        pixel(pictures["torn"], painter.camera, beside), pixel(pictures["whole"], painter.camera, beside)
    )


def test_light_falls_through_a_hole(torn_sheet):
    painter, pictures = torn_sheet[1]
    light = painter.light.direction
    lit = np.array([0.0, 1.0, 0.0]) - light / light[1]
    assert np.all(pixel(pictures["whole"], painter.camera, lit) < 0.85 * pixel(pictures["empty"], painter.camera, lit))
    assert np.all(pixel(pictures["torn"], painter.camera, lit) > 0.95 * pixel(pictures["empty"], painter.camera, lit))


def test_a_torn_rod_is_gone_with_its_shadow(torn_sheet):
    painter, pictures = torn_sheet[1]
    rod = np.array([-1.4, 0.5, 0.8])
    shadow = rod - painter.light.direction * (rod[1] / painter.light.direction[1])
    assert np.argmax(pixel(pictures["whole"], painter.camera, rod)) == 1
    for point in (rod, shadow):
        empty = pixel(pictures["empty"], painter.camera, point)
        assert np.any(pixel(pictures["whole"], painter.camera, point) < 0.9 * empty)
        assert np.array_equal(pixel(pictures["torn"], painter.camera, point), empty)


def test_where_nothing_has_torn_the_picture_is_that_of_a_scene_that_cannot_tear(torn_sheet):
    for _, pictures in torn_sheet:
        assert np.array_equal(pictures["whole"], pictures["plain"])
        assert np.array_equal(pictures["again"], pictures["whole"])


def test_normals_at_the_rim_come_from_what_is_left(cube, make_appearance, make_field):
    points, triangles = cube
    springs = np.full((len(triangles), 3), -1)
    springs[:, 0] = np.arange(len(triangles))
    renderer = SoftwareRenderer(
        make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)), triangle_springs=springs),
        Render(size=SMALL),
    )
    gone = np.flatnonzero(points[triangles][:, :, 1].min(axis=1) > 0.49)
    renderer.draw(make_field(points), 0, None, 0.0, spring_field(len(triangles), gone))
    normal = renderer._painter._vertices[1].to_numpy()
    rim = (points[:, 1] > 0.49) & (points[:, 0] > 0.49) & (np.abs(points[:, 2]) < 0.4)
    np.testing.assert_allclose(normal[rim], np.broadcast_to([1.0, 0.0, 0.0], (rim.sum(), 3)), atol=1e-6)


def test_a_torn_closed_body_shows_its_inside(cube, make_appearance, make_field):
    points, triangles = cube
    springs = np.full((len(triangles), 3), -1)
    springs[:, 1] = np.arange(len(triangles))
    appearance = make_appearance(
        triangles=triangles, triangle_body=np.zeros(len(triangles)), triangle_springs=springs, body_colors=[GREEN]
    )
    front = Camera(eye=(0.0, 0.0, 6.0), target=(0.0, 0.0, 0.0))
    renderer = SoftwareRenderer(appearance, Render(size=SMALL), front)
    field = make_field(points)
    middle = (SMALL[1] // 2, SMALL[0] // 2)
    whole = renderer.draw(field, 0)[middle].astype(int)
    front_side = np.flatnonzero(points[triangles][:, :, 2].min(axis=1) > 0.49)
    torn = renderer.draw(field, 0, None, 0.0, spring_field(len(triangles), front_side))[middle].astype(int)
    both = np.concatenate([front_side, np.flatnonzero(points[triangles][:, :, 2].max(axis=1) < -0.49)])
    through = renderer.draw(field, 0, None, 0.0, spring_field(len(triangles), both))[middle].astype(int)
    assert np.argmax(whole) == np.argmax(torn) == 1
    # The inside of the far side lies in the shade.
    assert torn[1] < whole[1]
    assert through[1] - through[0] < 20


def test_triangles_outlines_and_springs_tear_in_the_plane(make_appearance, make_field):
    points = [[-3.0, -2.0], [3.0, -2.0], [3.0, 2.0], [-3.0, 2.0], [-6.0, 0.0], [-5.0, 2.0]]
    appearance = make_appearance(
        2, triangles=[[0, 1, 2], [0, 2, 3]], triangle_body=[0, 0], outline=[[0, 1], [2, 3]], capsules=[[4, 5]],
        capsule_radius=[0.2], triangle_springs=[[0, -1, -1], [-1, -1, 1]], outline_spring=[0, -1], capsule_spring=[2],
    )  # fmt: skip
    renderer = SoftwareRenderer(appearance, Render(size=SMALL, camera=Camera(target=(0.0, 0.0), height=9.6)))
    camera, field = renderer._painter.camera, make_field(points)
    whole = renderer.draw(field, 0, None, 0.0, spring_field(3))
    torn = renderer.draw(field, 0, None, 0.0, spring_field(3, [0, 2]))
    assert np.array_equal(renderer.draw(field, 0), whole)
    paper = pixel(whole, camera, [5.5, -3.3])
    for gone in ([1.5, -1.0], [0.0, -2.05], [-5.5, 1.0]):
        assert np.abs(pixel(torn, camera, gone) - paper).max() < 15 < np.abs(pixel(whole, camera, gone) - paper).max()
    for kept in ([-1.5, 1.0], [0.0, 2.0]):
        assert np.array_equal(pixel(torn, camera, kept), pixel(whole, camera, kept))
