"""Colours, colliders and index lists against straightforward computations."""

import subprocess
import sys

import numpy as np
import pytest

from sandbox.render import NullRenderer, Renderer, create_renderer, overlay, palette
from sandbox.render.colliders import grid_spacing
from sandbox.render.topology import build_surface
from sandbox.scene.model import Render


def test_srgb_and_linear_are_inverse():
    values = np.linspace(0, 1, 256)
    np.testing.assert_allclose(palette.to_srgb(palette.to_linear(values)), values, atol=1e-7)


def test_flat_colors_come_out_as_they_went_in():
    values = np.arange(256)
    at = np.sqrt(palette.to_linear(values / 255) / palette.ENCODE_MAX) * (palette.ENCODE_SIZE - 1)
    encoded = palette.encode_table_flat()[np.round(at).astype(int)].astype(int)
    assert np.abs(encoded - values).max() <= 1


def test_colormaps_run_between_their_ends():
    for name in ("viridis", "turbo", "magma"):
        colors = palette.colormap(name)
        assert colors.shape == (256, 3) and colors.min() >= 0 and colors.max() <= 1
        assert np.abs(np.diff(colors, axis=0)).max() < 0.05


@pytest.mark.parametrize(("extent", "spacing"), [(1.0, 0.2), (2.1, 0.5), (8.0, 2.0), (0.041, 0.01)])
def test_grid_spacing_is_round(extent, spacing):
    assert grid_spacing(extent) == pytest.approx(spacing)


def test_rings_give_the_same_normals_as_a_sum_over_triangles(cube):
    points, triangles = cube
    surface = build_surface(triangles)
    expected = np.zeros_like(points)
    corner = points[triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    for k in range(3):
        np.add.at(expected, triangles[:, k], normal)
    for vertex, particle in enumerate(surface.points):
        ring = surface.ring[surface.ring_start[vertex] : surface.ring_start[vertex + 1]]
        gathered = np.cross(points[ring[:, 0]] - points[particle], points[ring[:, 1]] - points[particle]).sum(axis=0)
        np.testing.assert_allclose(gathered, expected[particle], atol=1e-12)


def test_ticks_are_round_and_end_below_the_top():
    assert overlay.ticks(1.0) == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert overlay.ticks(0.37)[-1] <= 0.37 and len(overlay.ticks(0.37)) in range(3, 8)


def test_factory_and_null_renderer():
    renderer = create_renderer("none", None, Render(size=(32, 18)))
    assert isinstance(renderer, NullRenderer) and isinstance(renderer, Renderer)
    assert renderer.draw(None, 0, None, 1.0, None).shape == (18, 32, 3)
    with pytest.raises(ValueError):
        create_renderer("oil paint", None, Render())


def test_importing_the_package_does_not_import_taichi():
    code = "import sys, sandbox.render; sys.exit('taichi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
