"""Cameras that a hand turns, and rays through the cursor."""

import numpy as np
import pytest

from sandbox.live.picker import beside, cursor_of, ray
from sandbox.live.views import FlatView, OrbitView, view_of
from sandbox.render.camera import FlatCamera, frame_2d, frame_3d
from sandbox.scene.model import Camera

BOX = np.array([[-1.0, 0.0, -1.0], [1.0, 2.0, 1.0]])
SIZE = (640, 360)


@pytest.fixture(params=["given", "chosen"])
def camera(request):
    eye = {"eye": (3.0, 2.0, 4.0), "target": (0.2, 1.0, 0.0)} if request.param == "given" else {}
    return frame_3d(Camera(**eye), BOX, SIZE)


def test_a_view_begins_as_its_camera(camera):
    view = OrbitView.of(camera, BOX)
    for name in ("eye", "right", "up", "forward", "focal"):
        assert getattr(view.camera, name) == pytest.approx(getattr(camera, name), abs=1e-12)


def test_what_it_turns_around_stays_in_the_middle_at_its_distance(camera):
    view = OrbitView.of(camera, BOX)
    middle, distance = view.target.copy(), view.distance
    for across, up in ((0.3, 0.1), (-1.7, 0.6), (0.1, -3.0)):
        view.turn(across, up)
        x, y, depth = view.camera.project(middle)
        assert (x, y, depth) == pytest.approx((320.0, 180.0, distance))
        axes = np.array([view.camera.right, view.camera.up, -view.camera.forward])
        assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert view.camera.up[1] >= 0.0


def test_the_scene_follows_the_hand(camera):
    """What is in front moves to the right and up when the hand does."""
    view = OrbitView.of(camera, BOX)
    near = view.target - 0.5 * view.distance * view.camera.forward
    before = view.camera.project(near)
    view.turn(0.02, 0.02)
    after = view.camera.project(near)
    assert after[0] > before[0] and after[1] < before[1]


def test_shifting_moves_the_target_with_the_cursor(camera):
    view = OrbitView.of(camera, BOX)
    target = view.target.copy()
    view.shift(0.25, -0.1)
    assert view.camera.project(target)[:2] == pytest.approx((320.0 + 0.25 * 360, 180.0 + 0.1 * 360))


@pytest.mark.parametrize("dimension", [2, 3])
def test_zooming_ends_somewhere_and_reset_leads_back(dimension, camera):
    view = view_of(camera if dimension == 3 else frame_2d(Camera(), BOX[:, :2], SIZE), BOX[:, :dimension])
    first = view.camera
    for factor in (1e9, 1e-12, 3.0):
        view.zoom(factor)
        view.turn(0.1, 0.2)
        view.shift(0.3, 0.1)
        assert np.all(np.isfinite(view.camera.project(np.zeros(dimension))))
    view.reset()
    points = np.random.default_rng(1).uniform(BOX[0, :dimension], BOX[1, :dimension], (5, dimension))
    assert view.camera.project(points) == pytest.approx(first.project(points))


def test_a_ray_goes_through_what_is_drawn_under_the_cursor(camera):
    for point in np.random.default_rng(2).uniform(*BOX, (10, 3)):
        origin, direction = ray(camera, cursor_of(camera, point))
        assert direction is not None
        assert np.linalg.norm(np.cross(point - origin, direction)) < 1e-9
        assert (point - origin) @ direction > 0.0


def test_dragging_keeps_the_depth_and_the_place_under_the_cursor(camera):
    point = np.array([0.3, 0.8, -0.2])
    assert beside(camera, cursor_of(camera, point), point) == pytest.approx(point)
    moved = beside(camera, (0.7, 0.4), point)
    assert (moved - point) @ camera.forward == pytest.approx(0.0, abs=1e-12)
    assert cursor_of(camera, moved) == pytest.approx((0.7, 0.4))


def test_in_the_plane_the_cursor_is_the_point():
    camera = FlatCamera(np.array([1.0, 2.0]), 50.0, SIZE)
    point, direction = ray(camera, (1.0, 0.0))
    assert direction is None
    assert point == pytest.approx((1.0 + 320 / 50, 2.0 - 180 / 50))
    assert cursor_of(camera, point) == pytest.approx((1.0, 0.0))
    assert beside(camera, (1.0, 0.0), np.zeros(2)) == pytest.approx(point)
    view = FlatView.of(camera)
    view.resize((320, 180))
    assert view.camera.scale == pytest.approx(25.0)
