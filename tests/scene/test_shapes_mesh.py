"""Meshes from files, as shells and as lattices that carry them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from sandbox.errors import SceneError
from sandbox.scene import mesh_file
from sandbox.scene.mesh_file import is_closed, load_mesh, signed_volume
from sandbox.scene.shapes import Geometry
from sandbox.scene.shapes.shells import icosphere
from sandbox.scene.shapes.triangles import find_edges
from sandbox.scene.shapes.voxels import inside_fraction
from tests.scene.test_shapes import check_sound, shape

FORMATS = ["obj", "ply", "stl"]


def write(path: Path, vertices: Any, triangles: Any) -> str:
    trimesh.Trimesh(vertices, triangles, process=False).export(path)
    return str(path)


def ball(path: Path, radius: float = 1.0, centre: tuple[float, ...] = (0.0, 0.0, 0.0), level: int = 2) -> str:
    points, triangles = icosphere(level)
    return write(path, radius * points + np.asarray(centre), triangles)


def box(path: Path, size: tuple[float, ...] = (1.0, 1.0, 1.0)) -> str:
    mesh = trimesh.creation.box(extents=size)
    return write(path, mesh.vertices, mesh.faces)


def carried(geometry: Geometry, points: Any) -> Any:
    return (points[geometry.carried_nodes] * geometry.carried_weights[:, :, None]).sum(axis=1)


@pytest.mark.parametrize("ending", FORMATS)
def test_formats_are_read_alike(tmp_path: Path, ending: str) -> None:
    file = ball(tmp_path / f"ball.{ending}", radius=100.0, centre=(300.0, 0.0, 0.0))
    vertices, triangles = load_mesh(file, 0.01)
    assert (vertices.dtype, triangles.dtype) == (np.float64, np.int32)
    # An STL has three vertices for every triangle: here they are one again.
    assert (len(vertices), len(triangles)) == (162, 320)
    assert is_closed(triangles)
    assert signed_volume(vertices, triangles) == pytest.approx(signed_volume(*icosphere(2)), rel=1e-5)
    np.testing.assert_allclose(0.5 * (vertices.min(axis=0) + vertices.max(axis=0)), [3.0, 0.0, 0.0], atol=1e-5)


def test_triangles_are_turned_outward(tmp_path: Path) -> None:
    points, triangles = icosphere(2)
    random = np.random.default_rng(0)
    for share in (0.3, 1.0):
        turned = random.random(len(triangles)) < share
        mixed = np.where(turned[:, None], triangles[:, ::-1], triangles)
        file = write(tmp_path / "mixed.ply", points, mixed)
        vertices, loaded = load_mesh(file, 1.0)
        assert is_closed(loaded)
        assert signed_volume(vertices, loaded) == pytest.approx(signed_volume(points, triangles))


def test_parts_of_a_mesh_face_outward_and_walls_of_a_hollow_inward(tmp_path: Path) -> None:
    points, triangles = icosphere(2)
    count = len(points)
    vertices = np.concatenate([points, 0.5 * points, 0.5 * points + [5.0, 0.0, 0.0]])
    file = write(
        tmp_path / "parts.ply",
        vertices,
        np.concatenate([triangles, triangles + count, triangles[:, ::-1] + 2 * count]),
    )
    loaded = load_mesh(file, 1.0)
    one = signed_volume(points, triangles)
    assert signed_volume(*loaded) == pytest.approx(one * (1.0 - 0.125 + 0.125))
    whole = icosphere(2)
    a, b, c = (loaded[0][loaded[1][:, k]] for k in range(3))
    normal, middle = np.cross(b - a, c - a), (a + b + c) / 3.0
    hollow = np.linalg.norm(middle, axis=1) < 0.6
    assert hollow.sum() == len(whole[1])
    assert (np.einsum("ij,ij->i", normal, middle)[hollow] < 0.0).all()


def test_cleaning_drops_what_is_no_surface(tmp_path: Path) -> None:
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 1e-12], [9, 9, 9], [2, 0, 0]]
    triangles = [[0, 1, 2], [1, 3, 0], [0, 1, 1], [0, 1, 5]]
    vertices, loaded = load_mesh(write(tmp_path / "dirty.ply", points, triangles), 1.0)
    assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert loaded.tolist() == [[0, 1, 2]]


def test_is_closed() -> None:
    _, triangles = icosphere(0)
    assert is_closed(triangles)
    assert not is_closed(triangles[1:])
    # Every directed edge is met as often as its reverse.
    assert is_closed(np.concatenate([triangles, triangles]))
    assert not is_closed(np.concatenate([triangles, triangles[:1]]))
    turned = triangles.copy()
    turned[3] = turned[3, ::-1]
    assert not is_closed(turned)
    assert not is_closed(triangles[:0])


def test_shell_of_a_closed_mesh(tmp_path: Path) -> None:
    file = ball(tmp_path / "ball.obj", centre=(4.0, 5.0, 6.0))
    shell = shape(3, kind="mesh", file=file, fill="shell", thickness=0.01, bend=0.1)
    check_sound(shell)
    assert shell.membrane and not shell.two_sided and is_closed(shell.triangles)
    np.testing.assert_allclose(shell.points.min(axis=0), -shell.points.max(axis=0))
    twin = shape(3, kind="shell", radius=1.0, subdivisions=2, thickness=0.01, bend=0.1)
    assert twin.volume is not None and twin.spring_scale is not None
    assert shell.volume == pytest.approx(twin.volume, rel=1e-6)
    np.testing.assert_allclose(np.sort(shell.spring_scale), np.sort(twin.spring_scale), rtol=1e-5)


def test_shell_of_an_open_mesh_is_two_sided(tmp_path: Path) -> None:
    points, triangles = icosphere(1)
    shell = shape(3, kind="mesh", file=write(tmp_path / "cut.ply", points, triangles[:-5]), fill="shell")
    check_sound(shell)
    assert shell.two_sided and shell.membrane
    assert len(shell.springs) == len(find_edges(shell.triangles).pairs)


def test_lattice_carries_the_surface_through_any_affine_motion(tmp_path: Path) -> None:
    file = ball(tmp_path / "ball.stl", centre=(4.0, 5.0, 6.0))
    geometry = shape(3, kind="mesh", file=file, cells=9)
    check_sound(geometry)
    assert not geometry.membrane and not geometry.two_sided
    count = len(geometry.points)
    assert geometry.triangles.min() == count
    assert geometry.triangles.max() == count + len(geometry.carried_nodes) - 1
    assert is_closed(geometry.triangles)
    np.testing.assert_allclose(geometry.carried_weights.sum(axis=1), 1.0, rtol=1e-12)
    vertices, _ = load_mesh(file, 1.0)
    vertices = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    np.testing.assert_allclose(carried(geometry, geometry.points), vertices, atol=1e-12)
    matrix, shift = np.random.default_rng(1).normal(size=(3, 3)), np.array([1.0, -2.0, 3.0])
    moved = carried(geometry, geometry.points @ matrix.T + shift)
    np.testing.assert_allclose(moved, vertices @ matrix.T + shift, atol=1e-11)


def test_lattice_of_a_box_is_the_box(tmp_path: Path) -> None:
    geometry = shape(3, kind="mesh", file=box(tmp_path / "box.stl", (1.0, 2.0, 3.0)), cells=6, scale=0.5)
    twin = shape(3, kind="box", size=(0.5, 1.0, 1.5), cells=(2, 4, 6))
    assert geometry.volume == pytest.approx(0.75)
    np.testing.assert_allclose(geometry.points, twin.points, atol=1e-12)
    assert (geometry.springs == twin.springs).all()
    assert geometry.spring_scale is not None and twin.spring_scale is not None
    np.testing.assert_allclose(geometry.spring_scale, twin.spring_scale)
    np.testing.assert_allclose(geometry.mass_share, twin.mass_share)


def test_inside_fraction_converges_to_the_volume() -> None:
    mesh = trimesh.creation.torus(1.0, 0.35)
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int32)
    exact = signed_volume(vertices, triangles)
    for cells, tolerance in ((8, 0.05), (24, 0.01), (64, 0.003)):
        extent = np.ptp(vertices, axis=0)
        spacing = extent.max() / cells
        grid = tuple(int(n) for n in np.ceil(extent / spacing - 1e-9))
        fraction = inside_fraction(vertices, triangles, vertices.min(axis=0), spacing, grid)
        assert fraction.shape == grid
        assert fraction.sum() * spacing**3 == pytest.approx(exact, rel=tolerance)


def test_inside_fraction_of_a_ball_is_a_ball() -> None:
    """Places and orientation of the grid, for every choice of the axis that rays run along."""
    points, triangles = icosphere(4)
    radii = np.array([1.0, 0.7, 0.5])
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1]):
        axes = radii[order]
        grid = tuple(int(n) for n in np.round(20 * axes))
        fraction = inside_fraction(points * axes, triangles, -axes, 0.1, grid)
        centres = (np.stack(np.indices(grid), axis=-1) + 0.5) * 0.1 - axes
        distance = np.linalg.norm(centres / axes, axis=-1)
        assert (fraction[distance < 0.8] == 1.0).all()
        assert (fraction[distance > 1.25] == 0.0).all()


def test_inside_fraction_follows_slanted_faces() -> None:
    """A corner of a cube cut off by x/3 + y/2 + z = 1: every sample on its side of the plane."""
    corners = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)
    cells = (30, 20, 10)
    fraction = inside_fraction(corners, triangles, np.zeros(3), 0.1, cells)
    samples = (np.stack(np.indices([2 * n for n in cells]), axis=-1) + 0.5) * 0.05
    # Rays run a hair beside the samples; no sample is that close to the plane.
    inside = samples @ [1.0 / 3.0, 1.0 / 2.0, 1.0] < 1.0
    expected = inside.reshape(30, 2, 20, 2, 10, 2).mean(axis=(1, 3, 5))
    np.testing.assert_array_equal(fraction, expected)


def test_parts_that_overlap_are_solid_where_they_do() -> None:
    one = trimesh.creation.box(extents=(1.0, 1.0, 1.0))
    vertices = np.concatenate([one.vertices, one.vertices + np.array([0.5, 0.0, 0.0])])
    triangles = np.concatenate([one.faces, one.faces + len(one.vertices)]).astype(np.int32)
    assert (inside_fraction(vertices, triangles, vertices.min(axis=0), 0.25, (6, 4, 4)) == 1.0).all()


def test_hollow_stays_empty(tmp_path: Path) -> None:
    points, triangles = icosphere(2)
    both = np.concatenate([points, 0.5 * points]), np.concatenate([triangles, triangles + len(points)])
    geometry = shape(3, kind="mesh", file=write(tmp_path / "hollow.ply", *both), cells=20)
    assert geometry.volume == pytest.approx(0.875 * signed_volume(points, triangles))
    assert np.linalg.norm(geometry.points, axis=1).min() > 0.3


def test_lattice_keeps_a_thin_bridge(tmp_path: Path) -> None:
    """Two blocks and a bar in both, a quarter of the samples of its cells: one lattice all the same."""
    parts = []
    for size, centre in (((2, 2, 1), (-2, 0, 0)), ((2, 2, 1), (2, 0, 0)), ((4, 0.3, 0.3), (0, 0.25, 0.25))):
        part = trimesh.creation.box(extents=size)
        part.apply_translation(centre)
        parts.append(part)
    whole = trimesh.util.concatenate(parts)
    geometry = shape(3, kind="mesh", file=write(tmp_path / "barbell.ply", whole.vertices, whole.faces), cells=6)
    check_sound(geometry)
    # Four cells a block, two of the bridge.
    assert len(geometry.points) == 2 * 18 + 1 * 4
    assert (np.abs(geometry.points[:, 0]) < 0.5).sum() == 4


def write_text(path: Path, text: str) -> str:
    path.write_text(text)
    return str(path)


def test_files_that_are_no_meshes_are_one_line(tmp_path: Path) -> None:
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    cases = {
        str(tmp_path / "none.obj"): "cannot be read: No such file or directory",
        str(tmp_path): "cannot be read: Is a directory",
        write_text(tmp_path / "text.ply", "hello"): "is no PLY",
        write_text(tmp_path / "text.doc", "hello"): "is not a mesh that can be read",
        write_text(tmp_path / "text.obj", "hello"): "has no triangles",
        write_text(tmp_path / "range.obj", corners + "f 1 2 9\n"): "line 4 names a vertex that is not there",
        write_text(tmp_path / "nan.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"): "has a vertex that is not finite",
        write_text(tmp_path / "flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"): "has no triangle with an area",
        write_text(tmp_path / "point.obj", "v 1 1 1\n" * 3 + "f 1 2 3\n"): "has no triangle with an area",
    }
    for file, message in cases.items():
        with pytest.raises(SceneError) as error:
            load_mesh(file, 1.0)
        assert str(error.value).startswith(f"{file}: {message}") and "\n" not in str(error.value)


def test_too_many_triangles_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_file, "MOST_TRIANGLES", 100)
    with pytest.raises(SceneError, match="has 320 triangles, at most 100 are taken"):
        load_mesh(ball(tmp_path / "ball.ply"), 1.0)


def test_lattices_that_cannot_be_are_one_line(tmp_path: Path) -> None:
    points, triangles = icosphere(1)
    apart = np.concatenate([points, points + np.array([9.0, 0.0, 0.0])])
    plate = box(tmp_path / "plate.ply", (1.0, 1.0, 0.01))
    cases = [
        (write(tmp_path / "cut.ply", points, triangles[1:]), 8, "is not watertight"),
        (write(tmp_path / "two.ply", apart, np.concatenate([triangles, triangles + len(points)])), 22, "falls into 2"),
        (plate, 4, "is thinner than half a cell everywhere"),
        (box(tmp_path / "cube.ply"), 4096, "4096 cells along it make a grid of 6.87e+10 cells"),
    ]
    for file, cells, message in cases:
        with pytest.raises(SceneError) as error:
            shape(3, kind="mesh", file=file, cells=cells)
        assert str(error.value).startswith(f"{file}: {message}") and "\n" not in str(error.value)
