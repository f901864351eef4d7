"""Bodies are drawn where they meet each other: a contact radius outside of their particles."""

import numpy as np
import pytest

from sandbox.render.skin import build_skin
from sandbox.render.software import SoftwareRenderer
from sandbox.scene.model import Camera, Render

SIZE = (160, 90)
RADIUS = 0.1
FLAT = Camera(target=(0.0, 0.0), height=9.0)
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def drawn(renderer, field):
    """World coordinates of the surface's vertices [m], shape (vertex_count, 3)."""
    renderer.draw(field, 0)
    return renderer._painter._vertices[0].to_numpy()


def sheet(cells=4):
    """A square sheet in y = 1 that faces up: points (count, 3) and triangles."""
    steps = np.linspace(-0.5, 0.5, cells + 1)
    x, z = np.meshgrid(steps, steps, indexing="ij")
    points = np.stack([x.ravel(), np.ones(x.size), z.ravel()], axis=1)
    i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    a = (i * (cells + 1) + j).ravel()
    quads = np.stack([a, a + 1, a + cells + 2, a + cells + 1], axis=1)
    return points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)


def test_a_closed_body_grows_by_its_radius(cube, make_appearance, make_field):
    points, triangles = cube
    appearance = make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)), body_radius=[RADIUS])
    vertices = drawn(SoftwareRenderer(appearance, Render(size=SIZE)), make_field(points))
    # All faces lie in planes a radius outside, their edges included; corners near enough.
    is_corner = np.abs(points).min(axis=1) > 0.49
    np.testing.assert_allclose(np.abs(vertices - points).max(axis=1)[~is_corner], RADIUS, atol=1e-6)
    np.testing.assert_allclose(np.abs(vertices - points).max(axis=1)[is_corner], RADIUS, atol=0.35 * RADIUS)


def test_without_a_radius_nothing_moves(cube, make_appearance, make_field):
    points, triangles = cube
    pictures = []
    for parts in ({}, {"body_radius": [0.0]}, {"body_radius": [RADIUS]}):
        appearance = make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)), **parts)
        renderer = SoftwareRenderer(appearance, Render(size=SIZE))
        pictures.append(renderer.draw(make_field(points), 0))
        assert renderer._painter._is_thick == ("body_radius" in parts and parts["body_radius"][0] > 0.0)
    assert np.array_equal(pictures[0], pictures[1]) and not np.array_equal(pictures[0], pictures[2])


def test_particles_that_are_drawn_show_their_radius_themselves(cube, make_appearance):
    _, triangles = cube
    appearance = make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)), body_radius=[RADIUS],
                                 spheres=[0], sphere_radius=[RADIUS])  # fmt: skip
    assert not np.any(build_skin(appearance).radius)


def test_a_sheet_has_two_skins_and_closed_rims(make_appearance, make_field):
    points, triangles = sheet()
    appearance = make_appearance(triangles=triangles, triangle_body=np.zeros(len(triangles)), two_sided=[True],
                                 body_radius=[RADIUS])  # fmt: skip
    skin = build_skin(appearance)
    edges = skin.surface.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    directed = {tuple(edge) for edge in edges.tolist()}
    # Closed and turned the same way everywhere: every edge is there once in either direction.
    assert len(directed) == len(edges) and all((b, a) in directed for a, b in directed)
    assert len(skin.surface.points) == 2 * len(points) and np.all(skin.radius == RADIUS)
    renderer = SoftwareRenderer(appearance, Render(size=SIZE))
    vertices = drawn(renderer, make_field(points))
    np.testing.assert_allclose(np.abs(vertices[:, 1] - 1.0), RADIUS, atol=1e-6)
    corner = vertices[skin.surface.triangles]
    volume = np.einsum("ij,ij->i", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum() / 6
    assert volume == pytest.approx(2 * RADIUS, rel=1e-5)
    # Rims are rounded: normals there point out of the sheet as well as up or down.
    normal = renderer._painter._vertices[1].to_numpy()
    is_rim = np.abs(vertices[:, 0]) > 0.49
    assert np.all(normal[is_rim, 0] * vertices[is_rim, 0] > 0.2)
    inner = np.abs(vertices[:, [0, 2]]).max(axis=1) < 0.49
    np.testing.assert_allclose(np.abs(normal[inner, 1]), 1.0, atol=1e-5)


def test_a_sheet_that_may_tear_stays_thin(make_appearance):
    _, triangles = sheet()
    appearance = make_appearance(
        triangles=triangles, triangle_body=np.zeros(len(triangles)), two_sided=[True], body_radius=[RADIUS],
        triangle_springs=np.zeros((len(triangles), 3)),
    )  # fmt: skip
    skin = build_skin(appearance)
    assert len(skin.surface.triangles) == len(triangles) and not np.any(skin.radius)


def darkened(picture, paper):
    """Covered area [square pixels], for black on the background."""
    value = np.stack([picture, paper]).astype(float)[..., 1] / 255
    light = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return float((1.0 - light[0] / light[1]).sum())


@pytest.mark.parametrize("radius", [0.0, 0.5])
def test_a_flat_body_is_drawn_out_to_its_radius(make_appearance, make_field, radius):
    # 10 pixels a metre: the outline's own width is 0.325 pixels.
    outline = [[k, (k + 1) % 4] for k in range(4)]
    render = Render(size=SIZE, camera=FLAT)
    paper = SoftwareRenderer(make_appearance(2), render).draw(make_field([[0.0, 0.0]]), 0)
    appearance = make_appearance(2, triangles=[[0, 1, 2], [0, 2, 3]], triangle_body=[0, 0], outline=outline,
                                 body_colors=[[0.0, 0.0, 0.0]], body_radius=[radius])  # fmt: skip
    angle = 0.3
    turned = SQUARE @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    picture = SoftwareRenderer(appearance, render).draw(make_field(turned), 0)
    side = 20.0 + 2 * max(10.0 * radius, 0.1625)
    assert darkened(picture, paper) == pytest.approx(side**2, rel=0.01)
