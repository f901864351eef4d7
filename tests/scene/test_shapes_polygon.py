"""Polygons: the triangles fill the outline exactly, and are as stiff as the material says."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from sandbox.errors import SceneError
from sandbox.scene.shapes import Geometry
from sandbox.scene.shapes.outlines import check_outline, inside, loop_area
from sandbox.scene.shapes.triangles import open_edges, signed_areas
from sandbox.scene.topology import pair_keys
from tests.scene.test_shapes import check_sound, modulus_of_stretch, shape

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
TRIANGLE = [[0.3, 0.3], [0.6, 0.3], [0.5, 0.7]]


def polygon(points: Any, spacing: float, holes: Any = ()) -> Geometry:
    return shape(2, kind="polygon", points=np.asarray(points).tolist(), spacing=spacing, holes=holes)


def check_filled(geometry: Geometry, area: float) -> None:
    """Triangles that are counter-clockwise, end at the outline and nowhere else, and add up to the area."""
    check_sound(geometry)
    areas = signed_areas(geometry.points, geometry.triangles)
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(area, rel=1e-12)
    assert geometry.volume == pytest.approx(area, rel=1e-12)
    ends, outline = open_edges(geometry.triangles), geometry.outline
    assert sorted(map(tuple, ends.tolist())) == sorted(map(tuple, outline.tolist()))
    x, y = geometry.points[outline].transpose(2, 1, 0)
    assert 0.5 * (x[0] * y[1] - x[1] * y[0]).sum() == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize("direction", [1, -1])
def test_square_with_a_hole_in_either_direction(direction: int) -> None:
    geometry = polygon(SQUARE[::direction], 0.1, holes=[TRIANGLE[::-direction]])
    check_filled(geometry, 1.0 - 0.06)
    for corner in SQUARE + TRIANGLE:
        assert np.abs(geometry.points - corner).max(axis=1).min() == 0.0
    assert not inside(geometry.points[geometry.triangles].mean(axis=1), [np.array(TRIANGLE)]).any()


@pytest.mark.parametrize(
    ("points", "area"),
    [
        ([[0, 0], [2, 0], [2, 1], [1, 0.02], [0, 1]], 1.02),  # an edge close to a corner
        ([[0, 0], [5, 0.05], [0, 0.1]], 0.25),  # a needle
        ([[0, 0], [1, 0], [1, 0.001], [0, 0.001]], 0.001),  # much thinner than the spacing
        ([[0, 0], [2, 0], [2, 1], [1.001, 1], [1, 0.1], [0.999, 1], [0, 1]], 1.9991),  # a slit
        ([[0, 0], [0.5, 0], [1, 0], [1, 1], [0, 1], [0, 0]], 1.0),  # a corner on an edge, the first repeated
    ],
)
def test_awkward_outlines_are_filled(points: Any, area: float) -> None:
    check_filled(polygon(points, 0.1), area)


def test_a_long_bar_of_many_points_is_filled() -> None:
    """Enough points for Qhull to get them a little off their places, which are kept."""
    geometry = polygon([[0, 0], [400, 40], [400, 41], [0, 1]], 0.3)
    check_filled(geometry, 400.0)
    assert len(geometry.points) > 4000


def test_springs_are_about_as_long_as_the_spacing() -> None:
    geometry = polygon([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]], 0.1)
    assert geometry.rest_lengths.min() > 0.5 * 0.1
    assert geometry.rest_lengths.max() < 1.6 * 0.1
    assert np.median(geometry.rest_lengths) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("side", [0.18, 0.12, 0.37])
def test_outline_is_sampled_at_about_the_spacing(side: float) -> None:
    geometry = polygon(side * np.array(SQUARE), 0.1)
    step = np.linalg.norm(np.diff(geometry.points[geometry.outline], axis=1)[:, 0], axis=1)
    assert 0.1 / 1.5 <= step.min() and step.max() <= 0.1 * 1.5


def test_edges_that_points_across_a_slit_are_close_to_are_refined() -> None:
    slit = [[1.002, 1.0], [1.002, 0.67], [1.0, 0.2], [0.998, 1.0]]
    geometry = polygon([[0, 0], [2, 0], [2, 1], *slit, [0, 1]], 0.2)
    check_filled(geometry, loop_area(np.array([[0, 0], [2, 0], [2, 1], *slit, [0, 1]])))
    step = np.linalg.norm(np.diff(geometry.points[geometry.outline], axis=1)[:, 0], axis=1)
    assert step.min() < 0.11


def test_points_stay_where_the_outline_is() -> None:
    here, there = polygon(SQUARE, 0.2), polygon(np.add(SQUARE, [8.0, -4.0]), 0.2)
    np.testing.assert_allclose(there.points, here.points + np.array([8.0, -4.0]), atol=1e-12)
    assert (there.springs == here.springs).all()


@pytest.mark.parametrize("angle", [0.0, 20.0])
def test_youngs_modulus_converges(angle: float) -> None:
    turn = np.radians(angle)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    errors = []
    for spacing in (0.25, 0.125, 0.0625):
        geometry = polygon(np.array([[0, 0], [2, 0], [2, 1], [0, 1]]) @ rotation.T, spacing)
        object.__setattr__(geometry, "points", geometry.points @ rotation)
        errors.append(abs(modulus_of_stretch(geometry) - 1.0))
    assert errors[-1] < 0.02
    assert errors[-1] < 0.6 * errors[0]


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(st.floats(0.05, 1.0), st.floats(0.2, 1.0)), min_size=3, max_size=20),
    st.sampled_from([0.08, 0.15, 0.4]),
)
def test_star_shaped_outlines_are_filled(corners: list[tuple[float, float]], spacing: float) -> None:
    steps, radii = np.array(corners).T
    assume(steps.max() < 0.45 * steps.sum())
    angles = 2.0 * np.pi * np.cumsum(steps) / steps.sum()
    points = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    check_filled(polygon(points, spacing), loop_area(points))


@pytest.mark.parametrize(
    ("points", "holes", "message"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1]], [], "points: the outline meets itself (edges 0 and 2)"),
        ([[0, 0], [2, 0], [2, 1], [1, 0], [0, 1]], [], "points: the outline meets itself"),
        ([[0, 0], [1, 0], [2, 0], [1, 0], [1, 1]], [], "points: the outline turns straight back at (2.0, 0.0)"),
        ([[0, 0], [1, 1], [2, 2]], [], "points: the outline has no area"),
        ([[0, 0], [0, 0], [0, 0]], [], "points: the outline has no area"),
        ([[0, 0], [1e15, 0], [0, 1]], [], "points: "),
        (SQUARE, [[[0.2, 0.2], [0.3, 0.3], [0.4, 0.4]]], "holes[0]: the outline has no area"),
        (SQUARE, [[[2, 2], [3, 2], [3, 3]]], "holes[0]: lies outside the outline"),
        (SQUARE, [[[0.5, 0.5], [3, 0.5], [3, 0.6]]], "points: the outline meets holes[0]"),
        (SQUARE, [TRIANGLE, TRIANGLE], "holes[0]: the outline meets holes[1]"),
        (SQUARE, [[[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]], TRIANGLE], "holes[1]: lies inside holes[0]"),
        (SQUARE, [SQUARE], "points: the outline meets holes[0]"),
    ],
)
def test_unsound_outlines_are_one_line(points: Any, holes: Any, message: str) -> None:
    with pytest.raises(SceneError) as error:
        polygon(points, 0.1, holes=holes)
    assert str(error.value).startswith(message) and "\n" not in str(error.value)


@pytest.mark.parametrize(("points", "spacing"), [(SQUARE, 1e-5), ([[0, 0], [1e4, 1e4 - 0.1], [1e4, 1e4]], 0.1)])
def test_too_fine_a_spacing_is_refused_before_it_is_tried(points: Any, spacing: float) -> None:
    with pytest.raises(SceneError, match=r"^spacing: makes"):
        polygon(points, spacing)


def test_a_hole_next_to_the_outline_keeps_its_wall() -> None:
    hole = [[0.01, 0.01], [0.5, 0.01], [0.5, 0.5], [0.01, 0.5]]
    geometry = polygon(SQUARE, 0.1, holes=[hole])
    check_filled(geometry, 1.0 - 0.49**2)
    assert len(np.unique(pair_keys(geometry.outline))) == len(geometry.outline)


def test_check_outline_turns_loops_and_keeps_the_first_corner() -> None:
    outer, hole = check_outline(SQUARE[::-1], [TRIANGLE])
    assert loop_area(outer) == pytest.approx(1.0) and outer[0].tolist() == SQUARE[3]
    assert loop_area(hole) == pytest.approx(-0.06) and hole[0].tolist() == TRIANGLE[0]


def test_inside_agrees_with_a_disc() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    disc = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.random.default_rng(0).uniform(-1.2, 1.2, (2000, 2))
    radius = np.linalg.norm(points, axis=1)
    clear = np.abs(radius - 1.0) > 1e-3
    assert (inside(points, [disc, 0.5 * disc]) == ((radius < 1.0) & (radius > 0.5)))[
        clear & (abs(radius - 0.5) > 1e-3)
    ].all()
