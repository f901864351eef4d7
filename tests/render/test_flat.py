"""Pictures of two-dimensional scenes: exact areas, edges, order, nothing stale."""

import numpy as np
import pytest
import taichi as ti

from sandbox.render.software import SoftwareRenderer
from sandbox.scene.model import (
    BoxCollider,
    Camera,
    CapsuleCollider,
    HalfSpace,
    Keyframe,
    PolygonCollider,
    Render,
    SphereCollider,
)

SIZE = (160, 90)
# 10 pixels a metre, the origin in the middle.
CAMERA = Camera(target=(0.0, 0.0), height=9.0)
BLACK = [[0.0, 0.0, 0.0]]


def draw(appearance, field, slot=0, **render):
    return SoftwareRenderer(appearance, Render(size=SIZE, camera=CAMERA, **render)).draw(field, slot)


@pytest.fixture(scope="module")
def paper(make_appearance, make_field):
    return draw(make_appearance(2), make_field([[0.0, 0.0]])).astype(float)


def linear(picture):
    value = picture / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def covered(picture, paper):
    """Covered part of every pixel, for black on the background."""
    return 1 - linear(picture.astype(float))[..., 1] / linear(paper)[..., 1]


def test_coverage_sums_to_the_area(make_appearance, make_field, paper):
    points = [[-3.13, -2.07], [3.41, -1.03], [0.57, 3.21]]
    appearance = make_appearance(2, triangles=[[0, 1, 2]], triangle_body=[0], body_colors=BLACK)
    coverage = covered(draw(appearance, make_field(points)), paper)
    (ax, ay), (bx, by), (cx, cy) = points
    area = 100 * 0.5 * abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    assert coverage.sum() == pytest.approx(area, rel=0.005)
    assert np.sum((coverage > 0.2) & (coverage < 0.8)) > 50
    assert coverage.max() == pytest.approx(1.0, abs=0.01)


def test_y_is_up_and_colors_are_kept(make_appearance, make_field):
    points = [[1.0, 1.0], [3.0, 1.0], [3.0, 3.0], [1.0, 3.0]]
    color = np.array([[200, 100, 50]]) / 255
    appearance = make_appearance(2, triangles=[[0, 1, 2], [0, 2, 3]], triangle_body=[0, 0], body_colors=color)
    picture = draw(appearance, make_field(points))
    assert np.abs(picture[25, 100].astype(int) - [200, 100, 50]).max() <= 1
    assert picture[65, 100].min() > 200


def test_discs_and_lines_have_their_size(make_appearance, make_field, paper):
    appearance = make_appearance(2, spheres=[0], sphere_radius=[1.5], body_colors=BLACK)
    field = make_field([[0.03, 0.02], [3.0, 1.0]])
    assert covered(draw(appearance, field), paper).sum() == pytest.approx(np.pi * 15**2, rel=0.01)
    appearance = make_appearance(2, capsules=[[0, 1]], capsule_radius=[0.4], body_colors=BLACK)
    length = 10 * np.hypot(2.97, 0.98)
    assert covered(draw(appearance, field), paper).sum() == pytest.approx(8 * length + np.pi * 16, rel=0.01)


def test_outline_is_darker_than_the_fill(make_appearance, make_field):
    points = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]]
    parts = {"triangles": [[0, 1, 2], [0, 2, 3]], "triangle_body": [0, 0], "body_colors": [[0.9, 0.5, 0.2]]}
    appearance = make_appearance(2, outline=[[0, 1], [1, 2], [2, 3], [3, 0]], **parts)
    camera = Camera(target=(0.0, 0.0), height=6.0)
    renderer = SoftwareRenderer(appearance, Render(size=(640, 360), camera=camera))
    picture = renderer.draw(make_field(points), 0).astype(int)
    assert picture[180, 200, 0] < 0.85 * picture[180, 320, 0]


def test_nothing_is_stale(make_appearance, make_field, paper):
    appearance = make_appearance(2, spheres=[0], sphere_radius=[1.0])
    renderer = SoftwareRenderer(appearance, Render(size=SIZE, camera=CAMERA))
    field = make_field([[0.0, 0.0]], [[3.0, 2.0]], [[1e6, 0.0]])
    first = renderer.draw(field, 0)
    assert not np.array_equal(renderer.draw(field, 1), first)
    assert np.array_equal(renderer.draw(field, 0), first)
    assert np.array_equal(renderer.draw(field, 2), paper.astype(np.uint8))


def test_colliders_are_filled(make_appearance, make_field, paper):
    colliders = [
        HalfSpace(kind="half_space", point=(0.0, -3.0), normal=(0.0, 2.0), color="#112233"),
        BoxCollider(kind="box", position=(4.0, 1.0), size=(2.0, 0.5), rotation=90.0, color="#445566"),
    ]
    picture = draw(make_appearance(2, colliders=colliders), make_field([[0.0, 0.0]])).astype(int)
    assert np.abs(picture[85, 20] - [0x11, 0x22, 0x33]).max() <= 1
    assert np.abs(picture[28, 120] - [0x44, 0x55, 0x66]).max() <= 1
    assert np.array_equal(picture[35, 111], paper[35, 111].astype(int))


def test_values_and_f64(make_appearance, make_field):
    points = [[-3.0, -2.0], [3.0, -2.0], [0.0, 3.0]]
    appearance = make_appearance(2, triangles=[[0, 1, 2]], triangle_body=[0])
    values = ti.field(ti.f32, 3)
    values.from_numpy(np.array([0.0, 2.0, 0.0], dtype=np.float32))
    renderer = SoftwareRenderer(appearance, Render(size=SIZE, camera=CAMERA, color="speed", color_max=2.0))
    picture = renderer.draw(make_field(points), 0, values)
    left, right = picture[63, 54].astype(int), picture[63, 104].astype(int)
    assert left[2] > left[1] and right[1] > right[2]
    double = renderer.draw(make_field(points, precision=ti.f64), 0, values)
    assert np.mean(np.abs(picture.astype(int) - double) > 2) < 1e-3


CONCAVE = ((-5.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-5.0, 3.0), (-3.0, 0.0))
HOLE = ((-1.5, -1.5), (-1.5, 1.5), (1.5, 1.5), (1.5, -1.5))


def test_a_ring_lies_in_the_hole_of_a_concave_polygon(make_appearance, make_field, paper):
    angles = np.linspace(0, 2 * np.pi, 25)[:-1]
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    polygon = PolygonCollider(kind="polygon", points=CONCAVE, holes=(HOLE,), color="#445566")
    appearance = make_appearance(
        2, capsules=[(k, (k + 1) % 24) for k in range(24)], capsule_radius=np.full(24, 0.12), colliders=[polygon]
    )
    picture = draw(appearance, make_field(ring)).astype(int)
    for inside in ([-4.0, 2.5], [2.5, 0.0], [-2.0, 0.0], [0.0, -2.2]):
        x, y = int(80 + 10 * inside[0]), int(45 - 10 * inside[1])
        assert np.abs(picture[y, x] - [0x44, 0x55, 0x66]).max() <= 1
    for outside in ([-4.5, 0.0], [0.0, 0.5], [4.0, 0.0]):
        x, y = int(80 + 10 * outside[0]), int(45 - 10 * outside[1])
        assert np.array_equal(picture[y, x], paper[y, x].astype(int))
    assert picture[45, 90, 0] - picture[45, 90, 2] > 60


def test_colliders_cover_their_area(make_appearance, make_field, paper):
    rod = CapsuleCollider(
        kind="capsule", position=(1.0, 0.0), rotation=90.0, start=(0.0, -2.0), end=(0.0, 1.0), radius=0.8,
        color="#000000",
    )  # fmt: skip
    polygon = PolygonCollider(kind="polygon", points=CONCAVE, holes=(HOLE,), rotation=30.0, color="#000000")
    field = make_field([[0.0, 500.0]])
    for collider, area in ((rod, 2 * 0.8 * 3 + np.pi * 0.64), (polygon, 48 - 6 - 9)):
        coverage = covered(draw(make_appearance(2, colliders=[collider]), field), paper)
        assert coverage.sum() == pytest.approx(100 * area, rel=0.01)
    # Turned about its position: from (3, 0) to (0, 0).
    assert covered(draw(make_appearance(2, colliders=[rod]), field), paper)[45, 108] > 0.99


def test_moving_colliders_are_where_resting_ones_would_be(make_appearance, make_field, paper):
    motion = (Keyframe(time=0.0), Keyframe(time=2.0, position=(2.0, 0.5), rotation=40.0))
    kinds = (
        (PolygonCollider, {"kind": "polygon", "points": CONCAVE, "holes": (HOLE,)}),
        (BoxCollider, {"kind": "box", "size": (2.0, 1.0)}),
        (CapsuleCollider, {"kind": "capsule", "start": (-1.0, 0.0), "end": (1.0, 0.5), "radius": 0.3}),
        (SphereCollider, {"kind": "sphere", "radius": 0.7}),
    )
    field = make_field([[0.0, 500.0]])
    for make, shape in kinds:
        moving = make(position=(-3.0, -1.0), motion=motion, **shape)
        renderer = SoftwareRenderer(make_appearance(2, colliders=[moving]), Render(size=SIZE, camera=CAMERA))
        first = renderer.draw(field, 0)
        turn = {} if make is SphereCollider else {"rotation": 40.0}
        resting = draw(make_appearance(2, colliders=[make(position=(2.0, 0.5), **turn, **shape)]), field)
        for time in (1.0, 2.0, 3.0):
            moved = renderer.draw(field, 0, time=time)
        assert np.array_equal(moved, resting)
        assert np.array_equal(renderer.draw(field, 0, time=0.0), first) and not np.array_equal(first, moved)
    # What the last of them left, the disc, is paper again.
    assert np.array_equal(moved[55, 50], paper[55, 50].astype(np.uint8))


def test_bodies_lie_on_moving_colliders(make_appearance, make_field):
    motion = (Keyframe(time=0.0), Keyframe(time=1.0, position=(0.0, 2.0), rotation=-20.0))
    lid = HalfSpace(kind="half_space", point=(0.0, -2.0), normal=(0.0, 1.0), color="#445566", motion=motion)
    appearance = make_appearance(2, spheres=[0], sphere_radius=[1.0], body_colors=BLACK, colliders=[lid])
    renderer = SoftwareRenderer(appearance, Render(size=SIZE, camera=CAMERA))
    field = make_field([[0.0, 0.0]])
    low, high = renderer.draw(field, 0).astype(int), renderer.draw(field, 0, time=1.0).astype(int)
    assert low[45, 80].max() == high[45, 80].max() == 0
    assert low[40, 40].min() > 200 and np.abs(high[40, 40] - [0x44, 0x55, 0x66]).max() <= 1
    # Turned clockwise the plane falls to the right.
    assert high[35, 150].min() > 200


def test_many_edges_fall_back_to_all_of_them(make_appearance, make_field, paper):
    # A comb so fine that a tile meets more edges than its list holds.
    teeth = np.arange(160)
    comb = [(-4.0 + 0.05 * k, 2.0 if k % 2 else 1.2) for k in teeth] + [(4.0, -1.0), (-4.0, -1.0)]
    collider = PolygonCollider(kind="polygon", points=comb, color="#000000")
    coverage = covered(draw(make_appearance(2, colliders=[collider]), make_field([[0.0, 500.0]])), paper)
    assert coverage[40:50, 50:110].min() > 0.99
    assert coverage[:22].max() < 0.01 and coverage[58:].max() < 0.01
