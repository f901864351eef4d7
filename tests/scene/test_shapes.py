"""What shapes are made of: springs, masses and surfaces, and how stiff they are as a whole. NumPy alone."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import TypeAdapter
from scipy.sparse.linalg import cg

from sandbox.scene.lattice import build_lattice
from sandbox.scene.mesh_file import is_closed, signed_volume
from sandbox.scene.model import Bracing, Shape
from sandbox.scene.shapes import Geometry, generate
from sandbox.scene.shapes.shells import icosphere
from sandbox.scene.shapes.triangles import find_edges, membrane_springs, signed_areas, triangle_areas
from sandbox.scene.topology import pair_keys

Array = NDArray[np.float64]


def shape(dimension: int, **data: Any) -> Geometry:
    """The geometry of a shape written as in a scene file."""
    return generate(TypeAdapter(Shape).validate_python(data), dimension)


def stiffness_matrix(geometry: Geometry) -> Array:
    """Linear stiffness of the springs at rest over Young's modulus [m], shape (N d, N d)."""
    assert geometry.spring_scale is not None
    points, springs = geometry.points, geometry.springs
    count, dimension = points.shape
    unit = (points[springs[:, 1]] - points[springs[:, 0]]) / geometry.rest_lengths[:, None]
    stretch = np.zeros((len(springs), count, dimension))
    rows = np.arange(len(springs))
    stretch[rows, springs[:, 0]] = -unit
    stretch[rows, springs[:, 1]] = unit
    stretch = stretch.reshape(len(springs), -1)
    return stretch.T @ (geometry.spring_scale[:, None] * stretch)


def modulus_of_stretch(geometry: Geometry, axis: int = 0) -> float:
    """Young's modulus of a block pulled along an axis, over that of its material [1]; free to narrow."""
    points = geometry.points
    low, high = points.min(axis=0), points.max(axis=0)
    pulled = points[:, axis] > high[axis] - 1e-9
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[pulled | (points[:, axis] < low[axis] + 1e-9), axis] = True
    movement = np.zeros(points.shape)
    movement[pulled, axis] = 1.0
    matrix = stiffness_matrix(geometry)
    known, given = fixed.reshape(-1), movement.reshape(-1)
    # What is left are motions of the whole across the axis, which cost nothing: conjugate gradients never make them.
    given[~known], failed = cg(matrix[np.ix_(~known, ~known)], -matrix[~known] @ given, rtol=1e-12)
    assert not failed
    force = (matrix @ given).reshape(points.shape)[pulled, axis].sum()
    section = np.delete(high - low, axis).prod()
    return float(force * (high - low)[axis] / section)


def check_sound(geometry: Geometry) -> None:
    """What every generated geometry keeps to."""
    springs = geometry.springs
    assert springs.dtype == np.int32 and geometry.triangles.dtype == np.int32
    assert (springs[:, 0] != springs[:, 1]).all()
    assert len(np.unique(pair_keys(springs))) == len(springs)
    assert springs.min() >= 0 and springs.max() == len(geometry.points) - 1
    placed = np.linalg.norm(geometry.points[springs[:, 1]] - geometry.points[springs[:, 0]], axis=1)
    np.testing.assert_allclose(geometry.rest_lengths, placed, rtol=1e-12)
    assert geometry.mass_share.sum() == pytest.approx(1.0, abs=1e-12)
    assert geometry.mass_share.min() > 0.0
    assert geometry.spring_scale is not None and geometry.spring_scale.shape == (len(springs),)
    assert (geometry.spring_scale > 0.0).all()
    assert geometry.spring_ratio is None or geometry.spring_ratio.shape == (len(springs),)
    assert geometry.triangles.max(initial=-1) < len(geometry.points) + len(geometry.carried_nodes)


SHAPES: list[tuple[int, dict[str, Any]]] = [
    (2, {"kind": "ring", "radius": 1.0, "segments": 3, "bend": 0.5}),
    (2, {"kind": "ring", "radius": 1.0, "segments": 4, "bend": 0.5}),
    (2, {"kind": "ring", "radius": 1.0, "segments": 17}),
    (3, {"kind": "shell", "radius": 1.0, "subdivisions": 0, "bend": 0.5}),
    (3, {"kind": "shell", "radius": 1.0, "subdivisions": 2}),
    (2, {"kind": "box", "size": [4.0, 1.0], "cells": [4, 1], "bend": 0.5}),
    (3, {"kind": "box", "size": [2.0, 1.0, 1.5], "cells": [4, 2, 3], "bend": 0.5, "bracing": "body"}),
    (3, {"kind": "sheet", "size": [1.0, 1.0], "cells": [3, 3], "bend": 0.5}),
    (2, {"kind": "tower", "levels": 2, "bays": 2, "height": 2.0, "width": 1.0}),
    (3, {"kind": "tower", "levels": 2, "bays": 2, "height": 2.0, "width": 1.0}),
    (2, {"kind": "polygon", "points": [[0, 0], [1, 0], [0, 1]], "spacing": 0.2}),
    (2, {"kind": "rope", "from": [0.0, 0.0], "to": [1.0, 0.0], "segments": 5}),
    (3, {"kind": "ball", "radius": 1.0, "cells": 5}),
]


@pytest.mark.parametrize(
    ("dimension", "data"), SHAPES, ids=lambda value: value["kind"] if isinstance(value, dict) else ""
)
def test_every_spring_is_there_once_and_every_particle_has_mass(dimension: int, data: dict[str, Any]) -> None:
    check_sound(shape(dimension, **data))


def test_thin_shapes_are_membranes() -> None:
    thin = {data["kind"] for dimension, data in SHAPES if shape(dimension, **data).membrane}
    assert thin == {"ring", "shell", "sheet", "rope"}


@pytest.mark.parametrize("segments", [3, 4, 5, 40, 41])
def test_ring_is_filled_counter_clockwise(segments: int) -> None:
    ring = shape(2, kind="ring", radius=2.0, segments=segments, thickness=0.01)
    assert (signed_areas(ring.points, ring.triangles) > 0.0).all()
    area = 0.5 * segments * 4.0 * np.sin(2.0 * np.pi / segments)
    assert signed_areas(ring.points, ring.triangles).sum() == pytest.approx(area, rel=1e-12)
    x, y = ring.points[ring.outline].transpose(2, 1, 0)
    assert 0.5 * (x[0] * y[1] - x[1] * y[0]).sum() == pytest.approx(area, rel=1e-12)
    edge = 4.0 * np.sin(np.pi / segments)
    assert ring.volume == pytest.approx(segments * edge * 0.01)
    np.testing.assert_allclose(ring.spring_scale, 0.01 / edge)


@pytest.mark.parametrize("bend", [0.0, 0.7])
@pytest.mark.parametrize("segments", [4, 5, 64])
def test_ring_under_pressure_widens_as_its_wall_says(segments: int, bend: float) -> None:
    """The force to widen a ring all round over the strain: E t, the closed form of a thin tube, p r = E t e."""
    ring = shape(2, kind="ring", radius=0.5, segments=segments, thickness=0.01, bend=bend)
    strained = ring.points.reshape(-1)
    energy = 0.5 * strained @ stiffness_matrix(ring) @ strained
    perimeter = ring.rest_lengths[:segments].sum()
    assert energy == pytest.approx(0.5 * 0.01 * perimeter, rel=1e-9)


def test_ring_bend_springs_skip_one_particle() -> None:
    ring = shape(2, kind="ring", radius=1.0, segments=6, bend=0.25)
    assert ring.springs[6:].tolist() == [[0, 2], [1, 3], [2, 4], [3, 5], [4, 0], [5, 1]]
    assert ring.spring_ratio is not None and ring.spring_scale is not None
    np.testing.assert_allclose(ring.spring_ratio, [1.0] * 6 + [0.25] * 6)
    np.testing.assert_allclose(ring.spring_scale[6:] / ring.spring_scale[:6], 0.25)


def test_icosphere_is_a_closed_sphere_and_converges_to_the_round_one() -> None:
    volume_error, area_error = [], []
    for level in range(5):
        points, triangles = icosphere(level)
        edges = find_edges(triangles)
        assert (len(points), len(triangles)) == (10 * 4**level + 2, 20 * 4**level)
        assert len(points) - len(edges.pairs) + len(triangles) == 2
        assert is_closed(triangles)
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, rtol=1e-14)
        a, b, c = (points[triangles[:, k]] for k in range(3))
        assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0.0).all()
        volume_error.append(1.0 - signed_volume(points, triangles) / (4.0 / 3.0 * np.pi))
        area_error.append(1.0 - triangle_areas(points, triangles).sum() / (4.0 * np.pi))
    for error in (volume_error, area_error):
        slopes = np.log2(np.divide(error[2:-1], error[3:]))
        np.testing.assert_allclose(slopes, 2.0, atol=0.1)


def test_icosphere_is_the_same_every_time() -> None:
    first, second = icosphere(2), icosphere(2)
    assert (first[0] == second[0]).all() and (first[1] == second[1]).all()
    coarse, _ = icosphere(1)
    assert (first[0][: len(coarse)] == coarse).all()


@pytest.mark.parametrize("bend", [0.0, 0.5])
def test_shell_under_pressure_widens_as_a_thin_sphere(bend: float) -> None:
    """u = p r^2 (1 - nu) / (2 E t), with Poisson's ratio 1/3 of a triangular lattice."""
    radius, thickness = 0.5, 0.002
    shell = shape(3, kind="shell", radius=radius, subdivisions=2, thickness=thickness, bend=bend)
    force = shell.points / radius * shell.mass_share[:, None] * 4.0 * np.pi * radius**2
    movement = np.linalg.lstsq(stiffness_matrix(shell), force.reshape(-1), rcond=1e-12)[0].reshape(-1, 3)
    outward = (movement * shell.points / radius).sum(axis=1) @ shell.mass_share
    assert outward == pytest.approx(radius**2 * (2.0 / 3.0) / (2.0 * thickness), rel=0.05)


def test_shell_bend_springs_join_the_corners_across_every_edge() -> None:
    plain = shape(3, kind="shell", radius=1.0, subdivisions=1)
    bent = shape(3, kind="shell", radius=1.0, subdivisions=1, bend=0.1)
    count = len(plain.springs)
    assert len(bent.springs) == 2 * count
    assert bent.spring_ratio is not None
    np.testing.assert_array_equal(bent.spring_ratio, np.repeat([1.0, 0.1], count))
    neighbours = [set(bent.springs[:count][(bent.springs[:count] == i).any(axis=1)].ravel()) for i in range(42)]
    for a, b in bent.springs[count:]:
        assert len((neighbours[a] & neighbours[b]) - {a, b}) >= 2


def test_membrane_of_two_triangles_back_to_back_has_no_spring_from_a_corner_to_itself() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 1]], dtype=np.int32)
    assert membrane_springs(points, triangles, 1.0, bend=1.0).springs.tolist() == [[0, 1], [0, 2], [1, 2]]


@pytest.mark.parametrize("bend", [0.0, 0.3, 4.0])
@pytest.mark.parametrize("cells", [(5, 3), (1, 1), (2, 2)])
def test_bend_springs_leave_youngs_modulus_of_a_rectangle(cells: tuple[int, int], bend: float) -> None:
    box = shape(2, kind="box", size=cells, cells=cells, bend=bend)
    assert modulus_of_stretch(box, 0) == pytest.approx(1.0, rel=1e-9)
    assert modulus_of_stretch(box, 1) == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("bracing", ["face", "body"])
def test_bend_springs_leave_youngs_modulus_of_a_box(bracing: str) -> None:
    box = shape(3, kind="box", size=(1.5, 1.0, 1.1), cells=(3, 2, 2), bend=0.6, bracing=bracing)
    assert modulus_of_stretch(box, 0) == pytest.approx(1.0, rel=1e-9)


def test_lattice_bend_springs_are_as_the_formula_says() -> None:
    plain = build_lattice(np.ones((6, 6), dtype=bool), (0.1, 0.1), Bracing.FACE)
    bent = build_lattice(np.ones((6, 6), dtype=bool), (0.1, 0.1), Bracing.FACE, bend=0.5)
    count = len(plain.springs)
    assert (bent.springs[:count] == plain.springs).all()
    # Two axes, seven lines, five springs that skip a node.
    assert len(bent.springs) == count + 2 * 7 * 5
    assert bent.spring_ratio is not None
    assert (bent.spring_ratio[:count] == 1.0).all() and (bent.spring_ratio[count:] == 0.5).all()
    reach = np.abs(bent.points[bent.springs[:, 1]] - bent.points[bent.springs[:, 0]])
    np.testing.assert_allclose(np.sort(reach[count:], axis=1), [[0.0, 0.2]] * 70, atol=1e-12)
    middle = (np.abs(bent.points[bent.springs]) < 0.15).all(axis=(1, 2))
    axial = reach.min(axis=1) < 1e-9
    # Inside, the axial springs of a square lattice, 3/4 E, become 3/4 E / (1 + 4 bend).
    np.testing.assert_allclose(bent.spring_scale[:count][(middle & axial)[:count]], 0.75 / 3.0)
    shear = ~axial[:count]
    np.testing.assert_allclose(bent.spring_scale[:count][shear], plain.spring_scale[shear])


def test_bend_springs_need_both_springs_that_they_span() -> None:
    occupied = np.array([[True], [False], [True]])
    lattice = build_lattice(occupied, (1.0, 1.0), Bracing.FACE, bend=1.0)
    assert (lattice.spring_ratio == 1.0).all()


def test_sheet_has_the_stiffness_of_a_rectangle_as_thick() -> None:
    sheet = shape(3, kind="sheet", size=(1.0, 1.0), cells=(4, 4), thickness=0.01, bend=0.2)
    box = shape(2, kind="box", size=(1.0, 1.0), cells=(4, 4), bend=0.2)
    assert sheet.spring_scale is not None and box.spring_scale is not None
    np.testing.assert_allclose(sheet.spring_scale, 0.01 * box.spring_scale)
    np.testing.assert_array_equal(sheet.spring_ratio, box.spring_ratio)
