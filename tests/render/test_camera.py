"""Projection of known points, and framing of the motion for any shape of picture."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbox.render.camera import FILL_3D, corners, frame_2d, frame_3d, padded_bounds
from sandbox.scene.model import Camera

extents = st.floats(0.01, 100.0)
sizes = st.tuples(st.integers(40, 2000), st.integers(40, 2000))


def test_points_project_where_a_hand_computation_puts_them():
    given_camera = Camera(eye=(0.0, 0.0, 10.0), target=(0.0, 0.0, 0.0), field_of_view=90.0)
    camera = frame_3d(given_camera, np.array([[-1] * 3, [1] * 3]), (400, 200))
    # Half the height (100 pixels) is seen under 45 degrees: at distance 10 a metre is 10 pixels.
    np.testing.assert_allclose(camera.project(np.array([0.0, 0.0, 0.0])), [200, 100, 10], atol=1e-9)
    np.testing.assert_allclose(camera.project(np.array([3.0, 2.0, 0.0])), [230, 80, 10], atol=1e-9)
    np.testing.assert_allclose(camera.project(np.array([3.0, 2.0, 5.0])), [260, 60, 5], atol=1e-9)


@given(st.tuples(extents, extents, extents), st.tuples(*[st.floats(-50, 50)] * 3), sizes, st.floats(5, 120))
def test_bounds_fit_any_picture_in_3d(extent, low, size, field_of_view):
    bounds = np.array([low, np.add(low, extent)])
    camera = frame_3d(Camera(field_of_view=field_of_view), bounds, size)
    x, y, depth = camera.project(corners(bounds)).T
    assert np.all(depth > 0)
    assert x.min() > 0 and x.max() < size[0] and y.min() > 0 and y.max() < size[1]
    # Tight: the box, no thinner than it is taken to be, reaches the margin on both sides in one direction.
    x, y, _ = camera.project(corners(padded_bounds(bounds))).T
    sides = [
        np.abs(np.array([x.min(), x.max()]) / size[0] * 2 - 1),
        np.abs(np.array([y.min(), y.max()]) / size[1] * 2 - 1),
    ]
    assert max(sides[0].min(), sides[1].min()) == pytest.approx(FILL_3D, abs=1e-6)


@given(st.tuples(extents, extents), st.tuples(*[st.floats(-50, 50)] * 2), sizes)
def test_bounds_fit_any_picture_in_2d(extent, low, size):
    bounds = np.array([low, np.add(low, extent)])
    x, y = frame_2d(Camera(), bounds, size).project(corners(bounds)).T
    assert x.min() > 0 and x.max() < size[0] and y.min() > 0 and y.max() < size[1]


def test_a_given_target_is_in_the_middle_and_all_is_seen():
    bounds = np.array([[-1.0, 0.0, -1.0], [1.0, 2.0, 1.0]])
    camera = frame_3d(Camera(target=(0.5, 0.2, 0.0)), bounds, (300, 200))
    np.testing.assert_allclose(camera.project(np.array([0.5, 0.2, 0.0]))[:2], [150, 100], atol=1e-6)
    x, y, _ = camera.project(corners(bounds)).T
    assert x.min() > 0 and x.max() < 300 and y.min() > 0 and y.max() < 200


def test_height_sets_the_scale_in_2d():
    camera = frame_2d(Camera(target=(1.0, 2.0), height=4.0), np.array([[0.0, 0.0], [1.0, 1.0]]), (300, 200))
    np.testing.assert_allclose(camera.project(np.array([1.0, 3.0])), [150, 50])


def test_eye_on_target_is_refused():
    with pytest.raises(ValueError, match="same point"):
        frame_3d(Camera(eye=(0.0, 0.0, 0.0), target=(0.0, 0.0, 0.0)), np.array([[-1] * 3, [1] * 3]), (64, 64))
