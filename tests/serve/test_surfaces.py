"""What is sent to browsers, as arrays."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sandbox.scene.assemble import assemble
from sandbox.scene.load import load_scene
from sandbox.serve import surfaces
from sandbox.serve.solids import build_blocks, filled, quaternion
from tests.conftest import make_scene


def area(vertices, faces):
    corner = vertices[faces]
    return 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum()


def volume(vertices, faces):
    corner = vertices[faces].astype(float)
    return np.linalg.det(corner).sum() / 6.0


def cube(radius=0.0, **more):
    body = {
        "name": "cube",
        "shape": {"kind": "box", "size": [1.0, 1.0, 1.0], "cells": [4, 4, 4]},
        "radius": radius,
        "material": {"stiffness": 1000.0, **more},
    }
    return assemble(make_scene(dimension=3, bodies=[body]))


def test_a_body_is_a_closed_surface_of_its_own_vertices():
    assembly = cube()
    (patch,) = surfaces.patches(assembly.appearance, assembly.appearance.shown())
    vertices = patch.vertices(assembly.positions)
    assert vertices.dtype == np.float32 and patch.faces.dtype == np.uint32
    assert patch.faces.max() == len(vertices) - 1 == 97
    assert volume(vertices, patch.faces) == pytest.approx(1.0)


def test_a_body_with_a_contact_radius_is_drawn_that_far_outside():
    assembly = cube(radius=0.1)
    (patch,) = surfaces.patches(assembly.appearance, assembly.appearance.shown())
    vertices = patch.vertices(assembly.positions)
    middle = np.abs(vertices[:, 1:]).max(axis=1) < 0.3
    assert np.abs(vertices[middle][:, 0]) == pytest.approx(0.6, abs=1e-3)


def test_torn_triangles_vanish_and_the_inside_is_lit_apart():
    assembly = cube(break_strain=0.5)
    appearance = assembly.appearance
    middle = assembly.positions[assembly.springs].mean(axis=1)
    torn = (np.abs(middle[:, 0] - 0.125) < 0.1).astype(np.int32)
    (patch,) = surfaces.patches(appearance, appearance.shown(torn))
    assert len(patch.faces) == appearance.shown(torn).triangles.sum()
    assert not patch.is_outer.all()
    # A vertex belongs either to outer faces or to inner ones.
    assert np.array_equal(patch.is_outer[patch.faces], np.repeat(patch.is_outer[patch.faces][:, :1], 3, axis=1))
    vertices = patch.vertices(appearance.drawn_points(assembly.positions, torn))
    assert volume(vertices, patch.faces) == pytest.approx(1.0, rel=0.05)


def test_nothing_left_of_a_surface_is_still_something_to_send():
    assembly = cube(break_strain=0.5)
    torn = np.ones(assembly.spring_count, dtype=np.int32)
    (patch,) = surfaces.patches(assembly.appearance, assembly.appearance.shown(torn))
    vertices = patch.vertices(assembly.positions)
    assert len(patch.faces) >= 1 and area(vertices, patch.faces) == pytest.approx(0.0, abs=1e-9)


def test_rods_stand_between_their_ends():
    assembly = assemble(load_scene("rope"))
    shown = assembly.appearance.shown()
    (rods,) = surfaces.rods(assembly.appearance)
    start, turn, size = rods.placed(assembly.positions, shown)
    ends = start + Rotation.from_quat(turn[:, [1, 2, 3, 0]]).apply([0.0, 0.0, 1.0]) * size[:, 2:]
    assert np.allclose(ends, assembly.positions[rods.ends[:, 1]], atol=1e-5)
    assert np.allclose(size[:, 0], rods.radius)
    gone = shown._replace(capsules=np.zeros(len(rods.rows), dtype=bool))
    assert rods.placed(assembly.positions, gone)[2].max() == 0.0 and rods.joint_sizes(gone).max() == 0.0


def test_turns_lead_the_z_axis_everywhere():
    directions = np.concatenate([np.random.default_rng(1).normal(size=(50, 3)), np.eye(3), -np.eye(3)])
    turned = Rotation.from_quat(surfaces.turns(directions)[:, [1, 2, 3, 0]]).apply([0.0, 0.0, 1.0])
    assert np.allclose(turned, directions / np.linalg.norm(directions, axis=1, keepdims=True), atol=1e-5)


def test_quaternions_are_those_of_scipy():
    turns = [*Rotation.random(50, random_state=1), *Rotation.from_rotvec(np.pi * np.eye(3))]
    for turn in turns:
        w, x, y, z = quaternion(turn.as_matrix())
        assert abs(np.dot([x, y, z, w], turn.as_quat())) == pytest.approx(1.0)


def test_outlines_are_filled_with_holes_left_out():
    star = [(0.0, 0.0), (4.0, 1.0), (4.0, 4.0), (2.0, 1.5), (0.0, 4.0)]
    hole = [(0.5, 0.5), (1.0, 0.6), (1.0, 1.0), (0.5, 1.0)]
    flat, faces = filled([star, hole])
    corner = flat[faces]
    across, along = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    signed = 0.5 * (across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0])

    def shoelace(points):
        x, y = np.transpose(points)
        return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))

    assert signed.min() > -1e-12
    assert signed.sum() == pytest.approx(shoelace(star) - shoelace(hole))


def test_every_collider_is_drawn_where_it_is():
    box = {"kind": "box", "position": [1.0, 0.0, 0.0], "size": [1.0, 2.0, 3.0], "rotation": [0.0, 0.0, 30.0]}
    ball = {"kind": "sphere", "position": [0.0, 2.0, 0.0], "radius": 0.5}
    ball["motion"] = [{"time": 0.0, "position": [0.0, 2.0, 0.0]}, {"time": 1.0, "position": [0.0, 3.0, 0.0]}]
    rod = {"kind": "capsule", "from": [0.0, 0.0, 0.0], "to": [2.0, 0.0, 0.0], "radius": 0.25}
    floor = {"kind": "half_space", "point": [0.0, -1.0, 0.0], "normal": [0.0, 2.0, 0.0]}
    scene = make_scene(dimension=3, colliders=[box, ball, rod, floor], bodies=[cube().scene.bodies[0].model_dump()])
    blocks = build_blocks(scene.colliders, np.array([[-1.0] * 3, [1.0] * 3]))
    assert [block.moves for block in blocks] == [False, True, False, False]
    places = []
    for block in blocks:
        place, rotation = block.pose(0.5)
        places.append(block.vertices @ rotation.T + place)
    assert volume(places[0], blocks[0].faces) == pytest.approx(6.0)
    assert places[0].mean(axis=0) == pytest.approx([1.0, 0.0, 0.0])
    assert places[1].mean(axis=0) == pytest.approx([0.0, 2.5, 0.0], abs=1e-6)
    assert places[2].min(axis=0) == pytest.approx([-0.25] * 3, abs=1e-2)
    assert places[2].max(axis=0) == pytest.approx([2.25, 0.25, 0.25], abs=1e-2)
    assert places[3][:, 1] == pytest.approx(-1.0)


def test_colliders_of_two_dimensions_are_flat_and_have_their_area():
    shapes = [
        ({"kind": "box", "position": [1.0, 0.0], "size": [1.0, 2.0], "rotation": 30.0}, 2.0),
        ({"kind": "sphere", "position": [0.0, 2.0], "radius": 0.5}, np.pi / 4),
        ({"kind": "capsule", "from": [0.0, 0.0], "to": [2.0, 1.0], "radius": 0.25}, 0.5 * 5**0.5 + np.pi / 16),
        (
            {"kind": "polygon", "points": [[0, 0], [2, 0], [2, 2], [0, 2]], "holes": [[[1, 1], [1.5, 1], [1, 1.5]]]},
            3.875,
        ),
        ({"kind": "half_space", "point": [0.0, -1.0], "normal": [1.0, 3.0]}, 2 * 6.0**2 * 2.0**2),
    ]
    point = {"name": "point", "shape": {"kind": "custom", "points": [[0.0, 0.0]], "masses": [1.0]}}
    scene = make_scene(dimension=2, colliders=[shape for shape, _ in shapes], bodies=[point])
    blocks = build_blocks(scene.colliders, np.array([[-1.0, -1.0], [1.0, 1.0]]))
    for block, (_, expected) in zip(blocks, shapes, strict=True):
        assert area(block.vertices, block.faces) == pytest.approx(expected, rel=0.01)
