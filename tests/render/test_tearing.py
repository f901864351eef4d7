"""What has torn is neither drawn nor casts, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
import taichi as ti

from sandbox.render.software import SoftwareRenderer
from sandbox.render.tearing import Tearing
from sandbox.scene.assemble import assemble
from sandbox.scene.model import Camera, Render
from tests.conftest import make_scene

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


def cut_scene(dimension, **body):
    """An assembly of one solid in which every spring tears, and marks of the springs that a sloping plane parts."""
    size, cells = [0.8, 0.6, 0.7][:dimension], [8, 6, 7][:dimension]
    shape = {"kind": "box", "size": size, "cells": cells}
    material = {"youngs_modulus": 1e5, "break_strain": 0.5}
    scene = make_scene(dimension=dimension, bodies=[{"name": "b", "shape": shape, "material": material, **body}])
    assembly = assemble(scene)
    front = assembly.positions @ np.array([1.0, 0.4, 0.3][:dimension]) > 0.013
    ends = assembly.spring_set.ends
    return assembly, np.flatnonzero(front[ends[:, 0]] != front[ends[:, 1]]), front


@pytest.fixture(scope="module")
def cut_cube():
    return cut_scene(3)


@pytest.fixture(scope="module")
def cut_square():
    return cut_scene(2)


@pytest.mark.parametrize("solid", ["cut_cube", "cut_square"])
def test_the_kernels_hide_what_the_appearance_does_not_show(solid, request):
    assembly, cut, _ = request.getfixturevalue(solid)
    look, count = assembly.appearance, assembly.spring_count
    kinds = (look.cells.triangles, look.cells.outline, look.cells.capsules)
    tearing = Tearing(look.cells, [(kind, len(kind)) for kind in kinds] + [(None, 3)])
    scattered = np.flatnonzero(np.random.default_rng(2).random(count) < 0.3)
    for torn in (None, [], cut, scattered, None, cut, []):
        marks = None if torn is None else spring_field(count, torn)
        tearing.update(marks)
        shown = look.shown(None if marks is None else marks.to_numpy())
        assert np.array_equal(tearing.hidden.to_numpy() == 0, np.concatenate([*shown, [True] * 3]))
    assert not np.array_equal(look.shown().triangles, look.shown(spring_field(count, cut).to_numpy()).triangles)


def test_inner_faces_are_drawn_where_the_appearance_has_them(cut_cube, make_field):
    assembly, cut, front = cut_cube
    look = assembly.appearance
    apart = assembly.positions + np.where(front[:, None], [0.3, 0.1, 0.0], 0.0)
    renderer = SoftwareRenderer(look, Render(size=SMALL))
    marks = spring_field(assembly.spring_count, cut)
    renderer.draw(make_field(apart), 0, None, 0.0, marks)
    drawn = renderer._painter._vertices[0].to_numpy()
    triangles = renderer._painter._triangles.to_numpy().reshape(-1, 3)
    shown = look.shown(marks.to_numpy()).triangles
    points = look.drawn_points(apart, marks.to_numpy())
    np.testing.assert_allclose(drawn[triangles[shown]], points[look.triangles[shown]], atol=2e-6)
    assert np.abs(points - apart).max() > 0.04
    # Faces inside have vertices of their own: the edge around a cut is sharp.
    inner = look.cells.triangles.is_inner
    assert not np.intersect1d(triangles[shown & inner], triangles[shown & ~inner]).size


def test_outlines_are_drawn_where_the_appearance_has_them(cut_square, make_field):
    assembly, cut, front = cut_square
    look = assembly.appearance
    apart = assembly.positions + np.where(front[:, None], [0.3, 0.1], 0.0)
    renderer = SoftwareRenderer(look, Render(size=SMALL))
    marks = spring_field(assembly.spring_count, cut)
    renderer.draw(make_field(apart), 0, None, 0.0, marks)
    outline = look.outline[look.shown(marks.to_numpy()).outline]
    points = look.drawn_points(apart, marks.to_numpy())
    wanted = renderer.pixels(points)[outline]
    np.testing.assert_allclose(renderer._painter._screen.to_numpy()[outline], wanted, atol=1e-3)
    assert np.abs(points - apart).max() > 0.04


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_a_solid_that_can_tear_looks_like_one_that_cannot(make_field, radius):
    for dimension in (2, 3):
        assembly, _, _ = cut_scene(dimension, radius=radius)
        scene = assembly.scene.model_dump(exclude_unset=True)
        scene["bodies"][0]["material"].pop("break_strain")
        plain = assemble(make_scene(**scene)).appearance
        field = make_field(assembly.positions)
        pictures = [
            SoftwareRenderer(look, Render(size=SMALL)).draw(field, 0, None, 0.0, torn)
            for look, torn in ((plain, None), (assembly.appearance, spring_field(assembly.spring_count)))
        ]
        assert len(assembly.appearance.triangles) + len(assembly.appearance.outline) > len(plain.triangles) + len(
            plain.outline
        )
        if radius == 0.0 or dimension == 2:
            assert np.array_equal(*pictures)
        else:
            # Sums are made in another order.
            assert np.abs(pictures[0].astype(int) - pictures[1]).max() <= 2


def test_the_inside_of_a_solid_is_solid(cut_cube, make_field):
    assembly, cut, front = cut_cube
    # Far to the right the front half leaves the view; what faces it is the cut.
    gone = assembly.positions + np.where(front[:, None], [500.0, 0.0, 0.0], 0.0)
    camera = Camera(eye=(4.0, 1.6, 1.2), target=(0.0, 0.0, 0.0))
    renderer = SoftwareRenderer(assembly.appearance, Render(size=SMALL), camera)
    field = make_field(gone)
    torn = renderer.draw(field, 0, None, 0.0, spring_field(assembly.spring_count, cut))
    point = pixel(torn, renderer._painter.camera, [0.0, 0.0, 0.0])
    color = assembly.appearance.body_colors[0]
    assert np.argmax(point) == np.argmax(color) and point.max() > point.min() + 40


def test_a_flat_solid_that_is_cut_meets_others_a_radius_outside(make_field):
    """The outline follows the cut, and is pushed out on all sides."""
    radius = 0.05
    assembly, cut, front = cut_scene(2, radius=radius)
    look = assembly.appearance
    apart = assembly.positions + np.where(front[:, None], [1.0, 0.0], 0.0)
    marks = spring_field(assembly.spring_count, cut)
    areas = []
    for body_radius in (None, np.array([radius])):
        renderer = SoftwareRenderer(replace(look, body_radius=body_radius), Render(size=(640, 384)))
        renderer.draw(make_field(apart), 0, None, 0.0, marks)
        scale = renderer._painter.camera.scale
        screen = renderer._painter._screen.to_numpy() / scale
        outline = look.outline[look.shown(marks.to_numpy()).outline]
        a, b = screen[outline[:, 0]], screen[outline[:, 1]]
        areas.append(0.5 * abs((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()))
        length = np.linalg.norm(b - a, axis=1).sum()
    pushed = radius - renderer._painter.picture.shape[0] * 1.3 / 720.0 / scale
    assert areas[1] - areas[0] == pytest.approx(pushed * length, rel=0.15)
