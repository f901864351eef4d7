"""Surfaces that few particles carry."""

import numpy as np
import taichi as ti

from sandbox.render.software import SoftwareRenderer
from sandbox.render.topology import value_particles
from sandbox.scene.model import Camera, Render

SMALL = (160, 96)
FRONT = Camera(eye=(1.0, 1.5, 5.0), target=(0.0, 0.0, 0.0))
BOX = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def trilinear(points):
    """Weights of the eight corners of the box [-1, 1]^3 that carry points, shape (count, 8)."""
    return np.prod(0.5 * (1.0 + points[:, None] * BOX[None]), axis=2)


def test_a_carried_surface_follows_its_particles(cube, make_appearance, make_field):
    points, triangles = cube
    weights = trilinear(points)
    carried = make_appearance(
        triangles=triangles + 8, triangle_body=np.zeros(len(triangles)), particle_count=8,
        carried_nodes=np.tile(np.arange(8), (len(points), 1)), carried_weights=weights,
    )  # fmt: skip
    direct = make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)))
    sheared = BOX + 0.6 * BOX[:, [1, 2, 0]] * [1.0, 0.0, 0.5]
    one, other = (SoftwareRenderer(appearance, Render(size=SMALL), FRONT) for appearance in (carried, direct))
    for nodes in (BOX, sheared):
        here, there = one.draw(make_field(nodes), 0).astype(int), other.draw(make_field(weights @ nodes), 0)
        assert np.mean(np.abs(here - there) > 2) < 2e-3
        assert np.ptp(here[..., 0] - here[..., 2]) > 100


def test_rows_past_the_particles_are_no_particles(cube, make_appearance, make_field):
    """Fields of a simulation have whole slices of rows: a surface that hangs on 5 particles has 3 more before it."""
    points, triangles = cube
    nodes = np.concatenate([BOX[[0, 3, 5, 6]], [[0.0, 0.0, 0.0]]])
    # Barycentric in the corners of a tetrahedron: exact for every point.
    four = np.linalg.inv(np.vstack([nodes[:4].T, np.ones(4)])) @ np.vstack([points.T, np.ones(len(points))])
    weights = np.column_stack([four.T, np.zeros(len(points))])
    appearance = make_appearance(
        triangles=triangles + 5, triangle_body=np.zeros(len(triangles)), particle_count=5,
        carried_nodes=np.tile(np.arange(5), (len(points), 1)), carried_weights=weights,
    )  # fmt: skip
    direct = make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)))
    there = SoftwareRenderer(direct, Render(size=SMALL), FRONT).draw(make_field(points), 0)
    for rows in (5, 8):
        field = make_field(np.concatenate([nodes, np.zeros((rows - 5, 3))]))
        here = SoftwareRenderer(appearance, Render(size=SMALL), FRONT).draw(field, 0).astype(int)
        assert np.mean(np.abs(here - there) > 2) < 2e-3
    assert np.ptp(there[..., 0].astype(int) - there[..., 2]) > 100


def test_a_flat_picture_reads_values_of_particles_alone(make_appearance, make_field):
    """There are as many values as particles, but more rows of positions."""
    values = ti.field(ti.f32, 3)
    values.from_numpy(np.array([0.1, 0.5, 0.9], dtype=np.float32))
    appearance = make_appearance(dimension=2, triangles=[[0, 1, 2]], triangle_body=[0], particle_count=3)
    corners = np.array([[-0.7, -0.6], [0.8, -0.5], [0.1, 0.7]])
    pictures = []
    for rows in (3, 8):
        renderer = SoftwareRenderer(appearance, Render(size=SMALL, color="speed", color_max=1.0))
        pictures.append(renderer.draw(make_field(np.concatenate([corners, np.zeros((rows - 3, 2))])), 0, values))
        assert renderer._painter._values.shape == values.shape
    np.testing.assert_array_equal(*pictures)


def test_a_carried_point_shows_the_value_of_its_heaviest_node(make_appearance, make_field):
    nodes = [[0, 1, 2], [2, 1, 0], [1, 0, 0], [2, 2, 1]]
    appearance = make_appearance(
        triangles=[[0, 4, 5]], triangle_body=[0], two_sided=[True], particle_count=3, carried_nodes=nodes,
        carried_weights=[[0.2, 0.2, 0.6], [0.5, 0.5, 0.0], [0.9, 0.1, 0.0], [0.3, 0.5, 0.2]],
    )  # fmt: skip
    np.testing.assert_array_equal(value_particles(np.array([0, 2, 3, 4, 5, 6]), appearance), [0, 2, 2, 2, 1, 2])
    values = ti.field(ti.f32, 3)
    field = make_field([[-2.0, -1.0, 0.0], [2.0, -1.0, 0.0], [0.0, 2.0, 0.0]])
    render = Render(size=SMALL, color="speed", color_max=1.0)
    renderer = SoftwareRenderer(appearance, render, Camera(eye=(0.0, 0.0, 8.0), target=(0.0, 0.0, 0.0)))
    pictures = []
    for speed in ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]):
        values.from_numpy(np.array(speed, dtype=np.float32))
        pictures.append(renderer.draw(field, 0, values).astype(int))
    # Toward the corner that shows particle 2, speed turns violet into green.
    x, y, _ = renderer._painter.camera.project(np.array([0.2, 0.0, 0.0]))
    assert pictures[1][int(y), int(x), 1] > pictures[0][int(y), int(x), 1] + 60
