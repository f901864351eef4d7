"""Shadows of thin and of long things: even, and whole."""

import numpy as np
import pytest

from sandbox.render.software import SoftwareRenderer
from sandbox.scene.model import Camera, CapsuleCollider, Keyframe, Render

SIZE = (320, 180)
CAMERA = Camera(eye=(0.5, 2.4, 5.5), target=(0.3, 0.2, 0.0))
BOUNDS = [[-1.0, 0.0, -0.5], [1.0, 1.0, 0.5]]
FAR = [[0.0, 500.0, 0.0]]


def ratio(renderer, picture, empty, points):
    """Brightness of points of the world relative to a picture without shadows, NaN where they are not in it."""
    x, y, _ = np.floor(renderer._painter.camera.project(points)).astype(int).T
    result = np.full(len(points), np.nan)
    inside = (x >= 0) & (x < SIZE[0]) & (y >= 0) & (y < SIZE[1])
    result[inside] = picture[y[inside], x[inside], 1] / empty[y[inside], x[inside], 1].astype(float)
    return result


def shadow_of(renderer, points):
    """Where the ground is shaded by points of the world."""
    light = renderer._painter.light.direction
    return points - (points[:, 1] / light[1])[:, None] * light


def test_the_shadow_of_a_rope_has_no_speckle(make_appearance, make_field, ground):
    # So high that the penumbra is many times as wide as the rope.
    ends = np.array([[-0.9, 1.4, 0.0], [0.9, 1.4, 0.0]])
    appearance = make_appearance(
        capsules=[[0, 1]], capsule_radius=[0.015], colliders=[ground], bounds=[[-1.0, 0.0, -0.6], [1.0, 1.5, 0.6]]
    )
    renderer = SoftwareRenderer(appearance, Render(size=SIZE), CAMERA)
    field = make_field(ends, ends + 500.0)
    empty, picture = renderer.draw(field, 1), renderer.draw(field, 0)
    middle = np.linspace([-0.5, 1.4, 0.0], [0.5, 1.4, 0.0], 200)
    shade = ratio(renderer, picture, empty, shadow_of(renderer, middle))
    assert np.isfinite(shade).all() and 0.8 < shade.mean() < 0.97
    # A pixel that took the rope for missed would be as bright as without it.
    assert shade.max() < 0.985 and shade.std() < 0.02


def finger(length, is_moving):
    """A rod that stands up to a height [m] from a little above the ground."""
    motion = (
        (Keyframe(time=0.0, position=(0.0, 9.0, 0.0)), Keyframe(time=1.0, position=(0.0, 0.0, 0.0)))
        if is_moving
        else ()
    )
    return CapsuleCollider(kind="capsule", start=(0.0, 0.3, 0.0), end=(0.0, length, 0.0), radius=0.1, motion=motion)


@pytest.mark.parametrize("is_moving", [True, False])
def test_the_shadow_of_a_long_collider_is_whole(make_appearance, make_field, ground, is_moving):
    parts = {"spheres": [0], "sphere_radius": [0.2], "bounds": BOUNDS}
    field = make_field(FAR)
    bare = SoftwareRenderer(make_appearance(colliders=[ground], **parts), Render(size=SIZE), CAMERA)
    rod = make_appearance(colliders=[ground, finger(5.0, is_moving)], **parts)
    renderer = SoftwareRenderer(rod, Render(size=SIZE), CAMERA)
    points = shadow_of(renderer, np.linspace([0.0, 0.6, 0.0], [0.0, 4.8, 0.0], 60))
    shade = ratio(renderer, renderer.draw(field, 0, time=1.0), bare.draw(field, 0), points)
    shade = shade[np.isfinite(shade)]
    assert len(shade) > 40 and shade.max() < 0.85


def test_a_very_long_collider_leaves_the_map_fine(make_appearance, make_field, ground):
    parts = {"spheres": [0], "sphere_radius": [0.2], "bounds": BOUNDS}
    lights, shades = [], []
    field = make_field(FAR)
    for colliders in ([ground], [ground, finger(60.0, False)], [ground, finger(60.0, True)]):
        renderer = SoftwareRenderer(make_appearance(colliders=colliders, **parts), Render(size=SIZE), CAMERA)
        shades.append(renderer.draw(field, 0, time=1.0).astype(float))
        lights.append(renderer._painter.light)
    points = shadow_of(renderer, np.linspace([0.0, 0.6, 0.0], [0.0, 2.0, 0.0], 30))
    for light, picture in zip(lights[1:], shades[1:], strict=True):
        assert light.texels_per_metre > 0.35 * lights[0].texels_per_metre
        assert np.prod(light.size) <= 1 << 20
        assert ratio(renderer, picture, shades[0], points).max() < 0.85


def test_shadows_fade_where_their_map_ends(make_appearance, make_field, ground):
    # A body far outside of where it was expected.
    points = np.linspace([-1.0, 1.0, 0.0], [9.0, 1.0, 0.0], 2)
    appearance = make_appearance(capsules=[[0, 1]], capsule_radius=[0.15], colliders=[ground], bounds=BOUNDS)
    camera = Camera(eye=(3.0, 3.0, 9.0), target=(3.0, 0.2, 0.0))
    renderer = SoftwareRenderer(appearance, Render(size=SIZE), camera)
    field = make_field(points, points + 500.0)
    empty, picture = renderer.draw(field, 1), renderer.draw(field, 0)
    along = shadow_of(renderer, np.linspace(points[0], points[1], 2000)[200:])
    shade = ratio(renderer, picture, empty, along)
    shade = shade[np.isfinite(shade)]
    assert shade.min() < 0.75 and shade.max() > 0.97
    assert np.abs(np.diff(shade)).max() < 0.2
