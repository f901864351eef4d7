"""What becomes of mesh files: faces divided, corners welded, parts faced outward and weighed, remarks made."""

import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import sandbox
from sandbox.errors import SceneError
from sandbox.scene.lattice import build_lattice
from sandbox.scene.mesh_file import is_closed, load_mesh, load_surface, signed_volume
from sandbox.scene.mesh_files.faces import RawMesh, ear_clipping
from sandbox.scene.mesh_files.facing import face_outward, gaps
from sandbox.scene.mesh_files.union import union_volume
from sandbox.scene.mesh_files.welding import without_slivers
from sandbox.scene.model import Bracing, Mesh, MeshCollider, Scene
from tests.scene.test_mesh_variants import HEIGHT, POINTS, VOLUME, assembled, obj, stl
from tests.scene.test_mesh_variants import write as write_file

Meshes = Any


def cube(edge: float = 1.0, at: tuple[float, ...] = (0.0, 0.0, 0.0)) -> tuple[Any, Any]:
    mesh = trimesh.creation.box((edge, edge, edge))
    return mesh.vertices + np.asarray(at), np.asarray(mesh.faces)


def joined(*parts: tuple[Any, Any]) -> tuple[Any, Any]:
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [faces + offset for (_, faces), offset in zip(parts, first, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def as_obj(folder: Path, mesh: tuple[Any, Any]) -> str:
    return write_file(folder, "obj", obj(mesh[1].tolist(), mesh[0]))


def turned(mesh: tuple[Any, Any]) -> tuple[Any, Any]:
    return mesh[0], mesh[1][:, ::-1]


def ring_area(points: Any) -> float:
    x, y = points.T
    return float(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def areas(points: Any, triangles: Any) -> Any:
    (ax, ay), (bx, by) = ((points[triangles[:, k]] - points[triangles[:, 0]]).T for k in (1, 2))
    return 0.5 * (ax * by - ay * bx)


def outlines() -> dict[str, Any]:
    angles = np.linspace(0.0, 2.0 * np.pi, 41)[:-1]
    star = np.where(np.arange(40) % 2, 0.3, 1.0)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    comb = [[0.0, 0.0], [7.0, 0.0]] + [[7.0 - i, 0.5 if i % 2 else 2.0] for i in range(8)]
    spiral = [[r * np.cos(a), r * np.sin(a)] for a, r in ((0.4 * i, 1.0 + 0.2 * i) for i in range(30))]
    back = [[0.8 * x, 0.8 * y] for x, y in spiral[::-1]]
    square = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
    hole = [[0, 0], [3, 0], [3, 3], [0, 3], [0, 0], [1, 1], [1, 2], [2, 2], [2, 1], [1, 1]]
    shapes = {"star": star, "comb": comb, "spiral": spiral + back, "corners along edges": square, "hole": hole}
    return {name: np.array(points, dtype=float) for name, points in shapes.items()}


@pytest.mark.parametrize("name", outlines())
@pytest.mark.parametrize("first", [0, 3, 5])
def test_ears_cover_an_outline_once(name: str, first: int) -> None:
    points = np.roll(outlines()[name], -first, axis=0)
    triangles = ear_clipping(points)
    assert len(triangles) == len(points) - 2
    own = areas(points, triangles)
    assert own.min() > -1e-12 and own.sum() == pytest.approx(ring_area(points))


def test_faces_that_are_not_quite_plane_keep_their_edges() -> None:
    """Two closed prisms over stars, the ends one face each, their corners off the plane by a hundredth."""
    star = outlines()["star"]
    count = len(star)
    points = np.concatenate([np.column_stack([star, np.full(count, z)]) for z in (0.0, 0.5)])
    points[:, 2] += 0.01 * np.random.default_rng(2).uniform(-1.0, 1.0, len(points))
    faces = [list(range(count))[::-1], list(range(count, 2 * count))]
    faces += [[i, (i + 1) % count, (i + 1) % count + count, i + count] for i in range(count)]
    raw = RawMesh(points, np.concatenate(faces), np.array([len(face) for face in faces]))
    triangles = raw.triangles().astype(np.int32)
    assert is_closed(triangles) and len(triangles) == 2 * (count - 2) + 2 * count
    assert signed_volume(points, triangles) == pytest.approx(0.5 * ring_area(star), rel=0.02)


TOUCHING: dict[str, tuple[Meshes, float]] = {
    "at a corner": (joined(cube(), cube(1.0, (1.0, 1.0, 1.0))), 2.0),
    "along an edge": (joined(cube(), cube(1.0, (1.0, 1.0, 0.0))), 2.0),
    "along part of an edge": (joined(cube(), cube(1.0, (1.0, 1.0, 0.37))), 2.0),
    "in a face": (joined(cube(), cube(1.0, (1.0, 0.0, 0.0))), 2.0),
    "in part of a face": (joined(cube(), cube(0.5, (0.75, 0.1, 0.2))), 1.125),
    "in a face, one inside out": (joined(cube(), turned(cube(1.0, (1.0, 0.0, 0.0)))), 2.0),
    "along an edge, one inside out": (joined(turned(cube()), cube(1.0, (1.0, 1.0, 0.0))), 2.0),
    "four around an edge": (joined(*(cube(1.0, (x, y, 0.0)) for x in (0, 1) for y in (0, 1))), 4.0),
    "a row of three": (joined(*(cube(1.0, (x, 0.0, 0.0)) for x in range(3))), 3.0),
    "overlapping": (joined(cube(), cube(1.0, (0.37, 0.41, 0.23))), 2.0 - 0.63 * 0.59 * 0.77),
    "three that overlap": (joined(cube(), cube(1.0, (0.5, 0.0, 0.0)), cube(1.0, (0.0, 0.5, 0.0))), 2.0),
    "overlapping, one inside out": (joined(cube(), turned(cube(1.0, (0.5, 0.0, 0.0)))), 1.5),
    "twice the same": (joined(cube(), cube()), 1.0),
    "twice the same, one inside out": (joined(cube(), turned(cube())), 1.0),
    "one in a corner of another": (joined(cube(), cube(0.5, (0.25, 0.25, 0.25))), 1.0),
    "a hollow that touches the wall": (joined(cube(), turned(cube(0.5, (0.25, 0.1, 0.0)))), 0.875),
    "a hollow": (joined(cube(), turned(cube(0.5))), 0.875),
    "a hollow with a core": (joined(cube(), turned(cube(0.5)), cube(0.25)), 0.875 + 0.015625),
    "all inside out, with a hollow": (turned(joined(cube(), turned(cube(0.5)))), 0.875),
}  # fmt: skip


@pytest.mark.parametrize("case", TOUCHING)
def test_parts_that_touch_or_overlap_weigh_their_union(case: str, tmp_path: Path) -> None:
    mesh, volume = TOUCHING[case]
    surface = load_surface(Mesh(kind="mesh", file=as_obj(tmp_path, mesh)))
    assert surface.gaps == "" and surface.remarks == ()
    assert union_volume(surface.vertices, surface.triangles) == pytest.approx(volume, rel=1e-5)


def test_bars_that_cross_weigh_their_union_in_a_scene(tmp_path: Path) -> None:
    bars = [trimesh.creation.box(size) for size in ((0.31, 0.07, 0.07), (0.07, 0.29, 0.07), (0.07, 0.07, 0.27))]
    file = as_obj(tmp_path, joined(*((bar.vertices, np.asarray(bar.faces)) for bar in bars)))
    right = (0.31 + 0.29 + 0.27 - 2 * 0.07) * 0.07**2
    assert assembled(file, cells=31).masses.sum() / 700.0 == pytest.approx(right, rel=1e-5)


@pytest.mark.parametrize("seed", range(12))
def test_sets_of_cubes_are_faced_outward(seed: int) -> None:
    """Cubes at random, with edges of four faces, hollows and corners that touch, some triangles turned."""
    chance = np.random.default_rng(seed)
    occupied = chance.random((3, 4, 3)) < 0.3 + 0.05 * seed
    cubes = build_lattice(occupied, (1.0, 1.0, 1.0), Bracing.FACE)
    for share in (0.0, 0.2, 0.5, 1.0):
        flip = chance.random(len(cubes.faces)) < share
        faced, _ = face_outward(cubes.points, np.where(flip[:, None], cubes.faces[:, ::-1], cubes.faces))
        assert gaps(cubes.points, faced) == ""
        assert union_volume(cubes.points, faced) == pytest.approx(occupied.sum(), rel=1e-5)


def test_a_sheet_with_two_faces_is_not_closed(tmp_path: Path) -> None:
    """A box without a lid, every triangle from both sides: nothing is inside it, though every edge is met both ways."""
    vertices, faces = cube()
    chance = np.random.default_rng(1)
    both = np.concatenate([faces[2:], faces[2:, ::-1]])[chance.permutation(20)]
    surface = load_surface(Mesh(kind="mesh", file=as_obj(tmp_path, (vertices, both))))
    assert surface.gaps.startswith("4 edges with a triangle on one side only") and len(surface.triangles) == 10


def test_features_are_not_welded_away(tmp_path: Path) -> None:
    """A step of 2e-7 of the size on a closed solid stays, as do two parts that are 1e-7 apart."""
    points = POINTS.copy()
    points[[2, 12], 0] += 6e-8
    vertices, triangles = load_mesh(write_file(tmp_path, "obj", obj(points=points)), 1.0)
    assert len(vertices) == 20 and is_closed(triangles)
    file = as_obj(tmp_path, joined(cube(), cube(1.0, (1.0 + 1e-7, 0.0, 0.0))))
    vertices, triangles = load_mesh(file, 1.0)
    assert len(vertices) == 16 and is_closed(triangles)
    # A binary STL far away from its origin: what it can tell apart, it tells apart.
    step = 32.0 * 2.0**-23
    fine = joined(cube(), cube(1.0, (1.0 + 3 * step, 0.0, 0.0)))
    vertices, triangles = load_mesh(write_file(tmp_path, "stl", stl(fine[0] + 30.0, fine[1].tolist())), 1.0)
    assert len(vertices) == 16 and is_closed(triangles)


@pytest.mark.parametrize("points_on_edge", [1, 2, 5])
def test_slivers_go_and_the_mesh_stays_closed(points_on_edge: int) -> None:
    """An edge divided on one side, and the joint closed by a fan of triangles without area, as they come and turned."""
    vertices, faces = cube()
    a, b, c = faces[0]
    shares = np.linspace(0.0, 1.0, points_on_edge + 2)[1:-1]
    vertices = np.vstack([vertices, vertices[a] + shares[:, None] * (vertices[b] - vertices[a])])
    chain = [a, *range(8, 8 + points_on_edge), b]
    fan = [[p, q, c] for p, q in itertools.pairwise(chain)]
    slivers = [[a, q, p] for p, q in itertools.pairwise(chain[1:])]
    triangles = np.array([*fan, *slivers, *faces[1:].tolist()], dtype=np.int32)
    assert is_closed(triangles)
    left, kept = without_slivers(vertices, triangles)
    corners = left[kept]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert is_closed(kept) and len(kept) == 12 + 2 * points_on_edge and area.min() > 1e-3
    assert signed_volume(left, kept) == pytest.approx(1.0)


def test_every_point_of_a_shell_with_slivers_has_a_mass(tmp_path: Path) -> None:
    a, b, c = (0, 10, 17)
    middle = [[20, b, a]]
    faces = obj([*middle, [a, 20, c], [20, b, c]], np.vstack([POINTS, [0.0, 0.0, 0.4 * HEIGHT]]))
    assembly = assembled(write_file(tmp_path, "obj", faces), fill="shell")
    assert (assembly.masses > 0.0).all()


@pytest.mark.parametrize(
    ("faces", "reason"),
    [
        ([[0, 1, 2]], r"^3 edges with a triangle on one side only, one near \(0.5, 0, 0\)$"),
        ([[0, 1, 2], [0, 1, 3], [0, 1, 4]], r"^6 edges .* one side only and 1 edge where 3 triangles meet"),
        ([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4], [4, 5, 1], [5, 0, 1]], r"with both triangles on the same side"),
    ],
)  # fmt: skip
def test_gaps_are_named(faces: list[list[int]], reason: str) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0], [2, 2, 2]], dtype=float)
    triangles, _ = face_outward(points, np.array(faces, dtype=np.int32))
    assert re.search(reason, gaps(points, triangles))


def test_size_and_scale(tmp_path: Path) -> None:
    file = write_file(tmp_path, "obj", obj(points=1e3 * POINTS + 17.0))
    by_size = load_surface(Mesh(kind="mesh", file=file, size=0.62))
    by_scale = load_surface(MeshCollider(kind="mesh", file=file, scale=2e-3, center=True))
    np.testing.assert_allclose(by_size.vertices, by_scale.vertices, atol=1e-9)
    assert np.ptp(by_size.vertices, axis=0).max() == pytest.approx(0.62)
    assert assembled(file, size=0.62).masses.sum() / 700.0 == pytest.approx(8.0 * VOLUME)
    for part in ({"kind": "mesh", "file": file, "size": 1.0, "scale": 2.0},):
        body = {"name": "a", "shape": part, "material": {"youngs_modulus": 1.0}}
        for scene in ({"bodies": [body]}, {"bodies": [{**body, "shape": {**part, "scale": 1.0}}], "colliders": [part]}):
            with pytest.raises(SceneError, match="give scale or size, not both"):
                sandbox.scene.load.scene_from_data({"dimension": 3, "duration": 1.0, **scene}, None)


@pytest.mark.parametrize("center", [True, False])
@pytest.mark.parametrize("fill", ["lattice", "shell"])
def test_position_means_the_same_for_bodies_and_colliders(fill: str, center: bool, tmp_path: Path) -> None:
    file = write_file(tmp_path, "obj", obj(points=POINTS + np.array([0.4, -0.3, 0.2])))
    body = load_surface(Mesh(kind="mesh", file=file, center=center))
    collider = load_surface(MeshCollider(kind="mesh", file=file, center=center))
    np.testing.assert_array_equal(body.vertices, collider.vertices)
    middle = np.zeros(3) if center else POINTS.mean(axis=0) * 0 + [0.4 + 0.155, -0.3 + 0.135, 0.2 + HEIGHT / 2]
    np.testing.assert_allclose(collider.middle, middle, atol=1e-12)
    scene = assembled(file, center=center, fill=fill, cells=31)
    low, high = scene.positions.min(axis=0), scene.positions.max(axis=0)
    np.testing.assert_allclose(0.5 * (low + high), middle, atol=1e-9)


def lines_about(assembly: Any) -> str:
    return " / ".join(assembly.remarks)


def test_a_usual_file_gets_no_remark(tmp_path: Path) -> None:
    assert assembled(write_file(tmp_path, "obj", obj()), cells=16).remarks == ()


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    text = obj() + "l 1 2 3\nl 2 3\np 4\nsurf 0 1 0 1 1 2 3 4\nf 1 2\nF 1 2 3\n"
    said = lines_about(assembled(write_file(tmp_path, "obj", text)))
    for part in ("2 lines", "1 point", "1 surface of free form", "1 face of fewer than 3 corners", "1 line of 'F'"):
        assert part in said
    assert said.startswith("bodies[0].shape: ")


@pytest.mark.parametrize(("scale", "said"), [(1e3, "is 310 m long"), (1e-3, "is 0.00031 m long"), (1.0, "")])
def test_odd_sizes_are_said_unless_they_are_given(scale: float, said: str, tmp_path: Path) -> None:
    file = write_file(tmp_path, "obj", obj(points=scale * POINTS))
    remarks = assembled(file).remarks
    assert len(remarks) == bool(said) and said in "".join(remarks) and (not said or "size" in remarks[0])
    assert assembled(file, size=0.31 * scale).remarks == ()
    remarks = load_surface(MeshCollider(kind="mesh", file=file)).remarks
    assert len(remarks) == bool(said)


def test_a_hollow_that_the_file_does_not_show_as_one_is_said(tmp_path: Path) -> None:
    file = as_obj(tmp_path, joined(cube(), cube(0.5)))
    assert "1 closed part inside another taken as hollow" in lines_about(assembled(file))


def test_thin_parts_that_hang_on_far_cells_are_said(tmp_path: Path) -> None:
    """A block with a needle as long as three of its cells, which no cell holds; with enough cells it is held."""
    needle = trimesh.creation.box((0.6, 0.08, 0.08))
    mesh = joined(cube(), (needle.vertices + np.array([0.75, 0.0, 0.0]), np.asarray(needle.faces)))
    file = as_obj(tmp_path, mesh)
    said = lines_about(assembled(file, cells=8))
    assert "4 of 16 surface points hang on cells that are more than a cell" in said and "take more than 8 cells" in said
    # The longest side, 1.55 m, has 8 cells; 5 of them lie in the block, and the needle ends where the eighth does.
    assert "up to 3.0 cells" in said
    assert assembled(file, cells=31).remarks == ()


def test_remarks_are_warnings_of_a_simulation(tmp_path: Path) -> None:
    text = obj(points=1e3 * POINTS) + "l 1 2\n"
    part = {"kind": "mesh", "file": write_file(tmp_path, "obj", text)}
    body = {"name": "a", "shape": {**part, "cells": 3}, "material": {"stiffness": 1.0, "mass": 1.0}}
    scene = {"dimension": 3, "duration": 0.1, "solver": {"dt": 1e-3}, "bodies": [body]}
    with sandbox.Simulation(Scene.model_validate(scene)) as simulation:
        assert sandbox.warning_log.WarningKind.MESH in simulation.warning_log.kinds()
        assert any("left out 1 line" in line for line in simulation.warning_log.lines)
        assert any("is 310 m long" in line for line in simulation.warning_log.lines)
