"""Colliders of every kind: at rest, moving, and the shadows of both."""

import numpy as np
import pytest
import taichi as ti

from sandbox.render.colliders import plane_axes
from sandbox.render.software import SoftwareRenderer
from sandbox.render.solids import build_solid, corner_normals
from sandbox.scene.model import (
    BoxCollider,
    Camera,
    CapsuleCollider,
    HalfSpace,
    Keyframe,
    MeshCollider,
    Render,
    SphereCollider,
)

SIZE = (160, 96)
BOUNDS = [[-1.4, 0.0, -0.8], [1.4, 1.2, 0.8]]
CAMERA = Camera(eye=(1.5, 3.0, 6.0), target=(0.0, 0.4, 0.0))
FAR = [[0.0, 500.0, 0.0]]
FROM, TO, TURN = (-0.9, 0.5, 0.3), (0.8, 0.6, -0.2), (20.0, 50.0, -30.0)


@pytest.fixture(scope="module")
def mesh_file(tmp_path_factory, cube):
    """The unit cube as an OBJ file."""
    points, triangles = cube
    path = tmp_path_factory.mktemp("mesh") / "cube.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    path.write_text("\n".join(lines))
    return str(path)


@pytest.fixture(scope="module")
def show(make_appearance, make_field, ground):
    """Renderer of colliders on the ground, and a field that puts its one particle in front (0) or far away (1)."""
    field = make_field([[0.0, 0.4, 2.0]], FAR)

    def build(*colliders):
        appearance = make_appearance(
            spheres=[0], sphere_radius=[0.15], body_colors=[[1.0, 0.1, 0.1]], colliders=[ground, *colliders],
            bounds=BOUNDS,
        )  # fmt: skip
        return SoftwareRenderer(appearance, Render(size=SIZE, camera=CAMERA)), field

    return build


def pixel(picture, camera, point):
    """Colour where a point is seen."""
    x, y, _ = camera.project(np.asarray(point, dtype=float))
    return picture[int(y), int(x)].astype(int)


def shadow_of(painter, point):
    """Where the ground lies in the shadow of a point."""
    light = painter.light.direction
    return np.asarray(point) - light * (point[1] / light[1])


def collider(kind, mesh_file, **placing):
    """A blue collider of a kind at a place, turned if it can be."""
    match kind:
        case "sphere":
            placing.pop("rotation", None)
            return SphereCollider(kind="sphere", radius=0.3, color="#2040ff", **placing)
        case "box":
            return BoxCollider(kind="box", size=(0.7, 0.4, 0.5), color="#2040ff", **placing)
        case "capsule":
            ends = {"from": (-0.3, 0.0, 0.0), "to": (0.3, 0.1, 0.0)}
            return CapsuleCollider(kind="capsule", radius=0.15, color="#2040ff", **ends, **placing)
        case _:
            return MeshCollider(kind="mesh", file=mesh_file, scale=0.45, color="#2040ff", **placing)


@pytest.mark.parametrize("kind", ["sphere", "box", "capsule", "mesh"])
def test_what_moves_looks_like_what_rests_and_leaves_no_trace(kind, mesh_file, show):
    motion = (Keyframe(time=0.0), Keyframe(time=2.0, position=TO, rotation=TURN))
    moving, field = show(collider(kind, mesh_file, position=FROM, motion=motion))
    painter = moving._painter
    before, after = moving.draw(field, 1, time=0.0), moving.draw(field, 1, time=2.0)
    empty = show()[0].draw(field, 1)
    for picture, here, there in ((before, FROM, TO), (after, TO, FROM)):
        red, _, blue = pixel(picture, painter.camera, here)
        assert blue > red + 60
        shadow = shadow_of(painter, here)
        assert np.all(pixel(picture, painter.camera, shadow) < 0.85 * pixel(empty, painter.camera, shadow))
        for left in (there, shadow_of(painter, there)):
            assert np.array_equal(pixel(picture, painter.camera, left), pixel(empty, painter.camera, left))
    resting = show(collider(kind, mesh_file, position=TO, rotation=TURN))[0].draw(field, 1)
    difference = np.abs(resting.astype(int) - after).max(axis=2)
    # Silhouettes may differ by a sample, and shadow maps in their resolution.
    assert difference.mean() < 0.4 and np.mean(difference > 25) < 0.004
    assert np.array_equal(moving.draw(field, 1, time=0.0), before)


@pytest.mark.parametrize("kind", ["capsule", "mesh"])
def test_resting_colliders_hide_and_are_hidden(kind, mesh_file, show):
    renderer, field = show(collider(kind, mesh_file, position=(0.0, 0.4, 0.0)))
    camera = renderer._painter.camera
    assert np.argmax(pixel(renderer.draw(field, 1), camera, [0.0, 0.4, 0.0])) == 2
    assert np.argmax(pixel(renderer.draw(field, 0), camera, [0.0, 0.4, 2.0])) == 0
    assert np.argmax(pixel(renderer.draw(field, 0), camera, [0.0, 0.4, 0.0])) == 2


def test_bodies_shade_meshes(mesh_file, show, make_field):
    renderer, _ = show(collider("mesh", mesh_file, position=(0.0, 0.225, 0.0)))
    painter = renderer._painter
    top = np.array([0.0, 0.45, 0.0])
    field = make_field([top + 0.5 * painter.light.direction], FAR[0:1])
    lit, shaded = (pixel(renderer.draw(field, slot), painter.camera, top) for slot in (1, 0))
    assert np.all(shaded[1:] < 0.9 * lit[1:])


def test_moving_colliders_keep_their_color_where_bodies_show_speed(mesh_file, make_appearance, make_field):
    motion = (Keyframe(time=0.0), Keyframe(time=1.0, position=TO))
    movers = [
        collider(kind, mesh_file, position=(x, 0.4, 0.0), motion=motion) for kind, x in (("box", -1), ("sphere", 0))
    ]
    appearance = make_appearance(spheres=[0], sphere_radius=[0.3], colliders=movers, bounds=BOUNDS)
    renderer = SoftwareRenderer(appearance, Render(size=SIZE, color="speed", color_max=1.0), CAMERA)
    values = ti.field(ti.f32, 1)
    values.fill(0.75)
    picture, camera = renderer.draw(make_field([[-0.5, 0.4, 1.5]]), 0, values), renderer._painter.camera
    assert np.argmax(pixel(picture, camera, [-1.0, 0.4, 0.0])) == 2
    assert np.argmax(pixel(picture, camera, [0.0, 0.4, 0.0])) == 2
    assert np.argmax(pixel(picture, camera, [-0.5, 0.4, 1.5])) == 1


def test_a_moving_plane_is_a_plate_in_its_plane(make_appearance, make_field):
    motion = (Keyframe(time=0.0), Keyframe(time=1.0, position=(0.0, -0.6, 0.0)))
    press = HalfSpace(kind="half_space", point=(0.0, 0.6, 0.0), normal=(0.0, -1.0, 0.0), color="#20ff40", motion=motion)
    renderer = SoftwareRenderer(
        make_appearance(spheres=[0], sphere_radius=[0.1], colliders=[press]), Render(size=SIZE),
        Camera(eye=(0.0, 0.0, 8.0), target=(0.0, 0.0, 0.0)),
    )  # fmt: skip
    camera, field = renderer._painter.camera, make_field([[0.0, 0.0, 0.0]])
    for time, seen, unseen in ((0.0, 0.63, -0.57), (1.0, -0.57, 0.63)):
        picture = renderer.draw(field, 0, time=time)
        red, green, _ = pixel(picture, camera, [0.5, seen, 1.2])
        assert green > red + 40
        red, green, _ = pixel(picture, camera, [0.5, unseen, 1.2])
        assert green < red + 40


def test_extent_holds_the_whole_swing():
    motion = (Keyframe(time=0.0), Keyframe(time=1.0, rotation=(0.0, 0.0, 180.0)))
    arm = CapsuleCollider(kind="capsule", start=(0.0, 0.0, 0.0), end=(1.0, 0.0, 0.0), radius=0.1, motion=motion)
    solid = build_solid(arm, np.array(BOUNDS))
    low, high = solid.extent()
    np.testing.assert_allclose(low, [-1.1, -0.1, -0.1], atol=1e-9)
    np.testing.assert_allclose(high, [1.1, 1.1, 0.1], atol=1e-9)


def test_the_shadow_map_holds_where_a_collider_goes(show):
    motion = (Keyframe(time=0.0), Keyframe(time=1.0, position=(2.4, 0.5, 0.0)))
    renderer, _ = show(SphereCollider(kind="sphere", position=(0.0, 0.5, 0.0), radius=0.2, motion=motion))
    light = renderer._painter.light
    u, v, w = light.locate(np.array([[2.6, 0.5, 0.0], [0.0, 0.5, 0.0]])).T
    assert np.all((u > 0) & (u < light.size[0]) & (v > 0) & (v < light.size[1]) & (w > 0) & (w < light.top))


def test_creases_stay_sharp_and_curves_smooth(cube):
    points, triangles = cube
    normals = corner_normals(points, triangles)
    corner = points[triangles]
    face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, np.repeat(face[:, None], 3, axis=1), atol=1e-12)
    # The same cube blown up into a sphere: what was an edge is now a curve, except where cells meet at angles.
    ball = points / np.linalg.norm(points, axis=1, keepdims=True)
    cosine = (corner_normals(ball, triangles) * ball[triangles]).sum(axis=2)
    assert np.degrees(np.arccos(cosine.min())) < 12.0


@pytest.mark.parametrize("normal", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (-0.3, -0.9, 0.3)])
def test_plane_axes_are_right_handed(normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    axes = np.array([*plane_axes(normal), normal])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
