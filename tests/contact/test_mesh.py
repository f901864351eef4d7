"""Solids from mesh files: the closest place, what slides over edges and joints, parts that overlap, thin walls."""

import math

import numpy as np
import pytest

from sandbox.contact.mesh_surface import STICKS_OUT, mesh_surface
from sandbox.contact.mesh_union import outer_parts, windings
from sandbox.contact.triangle_tree import build_tree
from sandbox.errors import SceneError
from tests.conftest import make_scene
from tests.contact.test_polygon_mesh import block, lumpy, shots, signed_distances, solid_angle, write_obj


def together(*meshes):
    """Several meshes as the parts of one."""
    first = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
    triangles = [faces + start for (_, faces), start in zip(meshes, first, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(triangles)


def moved(mesh, by):
    return mesh[0] + np.asarray(by, dtype=float), mesh[1]


def inverted(mesh):
    return mesh[0], mesh[1][:, ::-1]


def finer(vertices, triangles, times):
    """Every triangle in four, again and again, all in the old planes."""
    for _ in range(times):
        middles, points, smaller = {}, list(vertices), []
        for triangle in triangles:
            ends = []
            for pair in zip(triangle, np.roll(triangle, -1), strict=True):
                key = tuple(sorted(pair))
                if key not in middles:
                    middles[key] = len(points)
                    points.append((points[pair[0]] + points[pair[1]]) / 2.0)
                ends.append(middles[key])
            (a, b, c), (ab, bc, ca) = triangle, ends
            smaller += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        vertices, triangles = np.array(points), np.array(smaller, dtype=np.int32)
    return vertices, triangles


def globe(radius, times):
    """A ball of triangles, all corners on the sphere."""
    octahedron = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    faces = [(a, b, c) for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    faces = [f if np.linalg.det(octahedron[list(f)]) > 0.0 else f[::-1] for f in faces]
    vertices, triangles = finer(octahedron, np.array(faces, dtype=np.int32), times)
    return radius * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), triangles


def from_corners(points, corners):
    """Distance of every point from the nearest triangle [m], in double precision."""
    nearest = np.full(len(points), np.inf)
    for triangle in corners:
        across = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        normal = across / np.linalg.norm(across)
        distance, within = np.full(len(points), np.inf), np.ones(len(points), dtype=bool)
        for start, end in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
            arm, edge = points - start, end - start
            along = np.clip(arm @ edge / (edge @ edge), 0.0, 1.0)
            distance = np.minimum(distance, np.linalg.norm(arm - along[:, None] * edge, axis=1))
            within &= arm @ np.cross(edge, normal) <= 0.0
        over = np.abs((points - triangle[0]) @ normal)
        nearest = np.minimum(nearest, np.where(within, np.minimum(distance, over), distance))
    return nearest


def around(vertices, triangles, count, rng):
    """Places about a mesh [m]: all over its box and beyond, and close to its surface."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = vertices[triangles[rng.integers(0, len(triangles), count)]]
    near = np.einsum("pk,pkj->pj", rng.dirichlet(np.ones(3), count), corners)
    near += rng.normal(size=(count, 3)) * (high - low).max() * 10.0 ** rng.uniform(-5.0, -1.0, (count, 1))
    return np.concatenate([rng.uniform(1.3 * low - 0.3 * high, 1.3 * high - 0.3 * low, (count, 3)), near])


CUBE = block(np.ones(3))
CROSSED = together(CUBE, moved(block(np.array([0.6, 0.6, 3.0])), [0.1, 0.05, 0.0]))
TOUCHING = together(CUBE, moved(block(np.array([0.4, 0.4, 0.4])), [0.7, 0.1, 0.05]))
NEEDLE = (
    np.array([[0, 0, 0], [2, 0, 0], [0, 0.01, 0], [0, 0, 0.01]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)
MESHES = {
    "lumpy": lumpy(),
    "hollow": together(CUBE, inverted(block(np.array([0.7, 0.6, 0.8])))),
    "foil": block(np.array([1.0, 1e-4, 0.9])),
    "needle": NEEDLE,
    "crossed": CROSSED,
    "touching": TOUCHING,
}


# -- distances ----------------------------------------------------------------------------------------


def test_distances_and_sides_are_exact(simulate, tmp_path):
    """Against every triangle and the solid angle: bumps, hollows, slivers, walls far thinner than a cell, overlaps."""
    colliders = [
        {"kind": "mesh", "file": write_obj(tmp_path / f"{name}.obj", *mesh), "resolution": 17}
        for name, mesh in MESHES.items()
    ]
    simulation = simulate(shots([[9.0, 9.0, 9.0]], [[0.0] * 3], colliders, solver={"dt": 1e-3, "precision": "f64"}))
    rng = np.random.default_rng(0)
    for index, (name, (vertices, triangles)) in enumerate(MESHES.items()):
        points = around(vertices, triangles, 700, rng)
        inside = np.rint(solid_angle(points, vertices, triangles)) != 0
        _, pieces = outer_parts(vertices, triangles.astype(np.int32))
        assert (pieces is not None) == (name in ("crossed", "touching"))
        expected = from_corners(points, vertices[triangles] if pieces is None else pieces)
        found = signed_distances(simulation, index, points)
        assert found == pytest.approx(np.where(inside, -expected, expected), rel=1e-6, abs=1e-9), name


def test_only_what_bounds_the_solid_is_its_surface():
    for mesh, area in ((CROSSED, 6.0 + 4.0 * 0.6 * 2.0), (TOUCHING, 6.0 + 4.0 * 0.16)):
        _, pieces = outer_parts(*mesh)
        across = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
        assert 0.5 * np.linalg.norm(across, axis=1).sum() == pytest.approx(area, rel=1e-9)
    # A part within another bounds nothing, unless it faces inward.
    assert len(outer_parts(*together(CUBE, block(np.full(3, 0.3))))[0]) == 12
    assert len(outer_parts(*MESHES["hollow"])[0]) == 24


def test_windings_match_solid_angles():
    for vertices, triangles in (MESHES["lumpy"], CROSSED):
        points = around(vertices, triangles, 150, np.random.default_rng(4))
        found = windings(points, vertices, triangles, build_tree(vertices[triangles]))
        assert (found == np.rint(solid_angle(points, vertices, triangles))).all()


def test_joints_within_a_plane_stick_out_nowhere():
    surface = mesh_surface(*finer(*CUBE, 2))
    edges, corners = (sum(STICKS_OUT[k : k + 3]) for k in (0, 3))
    # Each of 12 edges in four, and all 3 corners between: 8 + 12 * 3.
    assert sum(int(mark).bit_count() for mark in surface.marks & edges) == 48
    assert sum(int(mark).bit_count() for mark in surface.marks & corners) == 44


# -- sliding ------------------------------------------------------------------------------------------


def rows(count, height, speed):
    """Starts of ``count`` points beside each other on a top, and their velocity along x [m/s]."""
    across = np.linspace(-0.41, 0.37, count)
    return np.stack([-0.2 + 0.3 * across, np.full(count, height), across], axis=1), np.tile(
        [speed, 0.0, 0.1], (count, 1)
    )


@pytest.mark.parametrize("radius", [0.0, 0.03])
def test_joints_are_not_felt_and_edges_let_go(simulate, tmp_path, radius):
    """Over 24 joints at full speed, off the edge, and down as all falls: nothing is left on the top."""
    file = write_obj(tmp_path / "block.obj", *finer(*block(np.array([1.0, 0.5, 1.0])), 3))
    starts, velocities = rows(13, 0.25 + radius, 1.5)
    scene = shots(
        starts, velocities, [{"kind": "mesh", "file": file, "resolution": 16}], radius=radius, gravity=[0, -9.81, 0]
    )
    simulation = simulate(scene)
    simulation.advance(0.25)
    assert simulation.velocities()[:, [0, 2]] == pytest.approx(velocities[:, [0, 2]], rel=1e-5, abs=1e-6)
    assert simulation.positions() == pytest.approx(starts + 0.25 * velocities, abs=1e-5)
    simulation.advance(0.75)
    x = simulation.positions()
    # The edge of a ball's way is at most a radius behind that of the block.
    first, last = ((0.5 + far - starts[:, 0]) / 1.5 for far in (0.0, radius))
    fallen = 0.25 + radius - x[:, 1]
    assert (fallen < 0.5 * 9.81 * (1.0 - first) ** 2 + 0.05).all()
    assert (fallen > 0.5 * 9.81 * (1.0 - last) ** 2 - 0.05).all()
    if radius == 0.0:
        assert x[:, 0] == pytest.approx(starts[:, 0] + 1.5, abs=1e-4)


def test_a_point_leaves_a_globe_where_it_leaves_a_sphere(simulate, tmp_path):
    """From rest near the top, without friction: at two thirds of that height, at the speed of that fall."""
    file = write_obj(tmp_path / "globe.obj", *globe(0.4, 5))
    for radius in (0.0, 0.05):
        size = 0.4 + radius
        turns = np.arange(6.0)
        starts = size * np.stack([0.1 * np.cos(turns), np.full(6, math.sqrt(0.99)), 0.1 * np.sin(turns)], axis=1)
        simulation = simulate(
            shots(starts, np.zeros((6, 3)), [{"kind": "mesh", "file": file}], radius=radius, gravity=[0, -9.81, 0])
        )
        simulation.advance(1.1)
        cosine = 2.0 / 3.0 * math.sqrt(0.99)
        speed = math.sqrt(9.81 * size * cosine) * cosine
        # Once it has left, nothing acts along the horizontal.
        left = np.linalg.norm(simulation.velocities()[:, [0, 2]], axis=1)
        assert left == pytest.approx(np.full(6, speed), rel=0.03)


def test_bounces_within_a_hollow_keep_their_speed(simulate, tmp_path):
    """Restitution 1 against walls, edges and corners from within, by points and by balls."""
    cavity = together(block(np.array([1.2, 1.2, 1.2])), inverted(lumpy()))
    cavity = (np.concatenate([cavity[0][:8] * 2.0, cavity[0][8:]]), cavity[1])
    file = write_obj(tmp_path / "cavity.obj", *cavity)
    rng = np.random.default_rng(3)
    velocities = rng.normal(size=(64, 3))
    velocities *= 5.0 / np.linalg.norm(velocities, axis=1, keepdims=True)
    for radius, dt in ((0.0, 1e-3), (0.04, 5e-3)):
        wall = {"kind": "mesh", "file": file, "restitution": 1.0}
        simulation = simulate(
            shots(rng.uniform(-0.25, 0.25, (64, 3)), velocities, [wall], radius=radius, solver={"dt": dt})
        )
        simulation.advance(1.0)
        assert np.linalg.norm(simulation.velocities(), axis=1) == pytest.approx(np.full(64, 5.0), rel=1e-4)
        assert (np.rint(solid_angle(simulation.positions(), *lumpy())) == 1).all()
        assert simulation.measure().max_penetration < 2e-6


def test_nothing_gains_energy_on_overlapping_parts(simulate, tmp_path):
    """A jelly falls on a figure of round parts, as such files are: its energy only goes down."""
    figure = together(globe(0.3, 3), moved(globe(0.2, 2), [0.3, 0.15, 0.02]), moved(globe(0.15, 2), [-0.3, 0.1, 0.0]))
    file = write_obj(tmp_path / "figure.obj", *figure)
    body = {
        "name": "jelly",
        "position": [0.02, 0.55, 0.01],
        "radius": 0.02,
        "shape": {"kind": "box", "size": [0.4, 0.3, 0.3], "cells": [5, 4, 4]},
        "material": {"youngs_modulus": 2e4, "damping_ratio": 0.1, "density": 1000.0},
    }
    ground = {"kind": "half_space", "point": [0.0, -0.4, 0.0], "normal": [0.0, 1.0, 0.0]}
    scene = make_scene(
        dimension=3,
        gravity=[0.0, -9.81, 0.0],
        solver={"dt": 5e-4},
        bodies=[body],
        colliders=[{"kind": "mesh", "file": file, "friction": 0.3}, ground],
    )
    simulation = simulate(scene)
    energies = [simulation.energy().total]
    for _ in range(20):
        simulation.advance(0.05)
        energies.append(simulation.energy().total)
    assert max(np.diff(energies)) < 1e-3 * abs(energies[0])
    assert simulation.measure().max_penetration < 1e-5


def test_what_starts_in_overlapping_parts_leaves_by_the_outside(simulate, tmp_path):
    file = write_obj(tmp_path / "crossed.obj", *CROSSED)
    starts = np.random.default_rng(6).uniform([-0.15, -0.2, -0.45], [0.35, 0.3, 0.45], (40, 3))
    simulation = simulate(shots(starts, np.zeros((40, 3)), [{"kind": "mesh", "file": file}], radius=0.01))
    simulation.advance(2e-3)
    assert simulation.measure().max_penetration < 1e-6
    assert (np.rint(solid_angle(simulation.positions(), *CROSSED)) == 0).all()


# -- bad input ----------------------------------------------------------------------------------------


def test_a_sheet_with_two_sides_and_nothing_between_is_no_solid(simulate, tmp_path):
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.1], [0.0, 0.0, 1.1]])
    file = write_obj(tmp_path / "flat.obj", square, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))
    with pytest.raises(SceneError, match=r"colliders\[0\]\.file: .*flat\.obj has no inside"):
        simulate(shots([[2.0] * 3], [[0.0] * 3], [{"kind": "mesh", "file": file}]))
