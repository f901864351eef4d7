"""Every kind of mesh file, read by the programs that users read them with, is where ``positions()`` says."""

import numpy as np
import pytest
import trimesh

from sandbox import RunOptions, Simulation, run
from sandbox.exports import ExportFormat
from sandbox.output.frames import Frame, Stem
from sandbox.output.mesh.surface import Surfaces
from sandbox.output.mesh.vtu import _Appended
from sandbox.scene.assemble import assemble
from tests.conftest import left_in, make_scene
from tests.output.conftest import ROPE, SHEET, SOLID, flat_scene, solid_scene

BODIES = ("the box", "sheet", "rope", "point")
F32 = 3e-7  # of coordinates up to 2 m


def in_space(rows):
    return np.pad(rows, ((0, 0), (0, 3 - rows.shape[1])))


@pytest.fixture(scope="module")
def pyvista():
    return pytest.importorskip("pyvista", reason="pyvista is not installed")


@pytest.fixture(scope="module")
def pxr():
    pytest.importorskip("pxr.UsdGeom", reason="usd-core is not installed")
    return pytest.importorskip("pxr")


@pytest.fixture(scope="module")
def whole_triangles(solid_run):
    """Triangles of every body that nothing torn touches, by particles in the scene's order, at every frame."""
    with solid_run.trajectory() as trajectory, Simulation(trajectory.scene) as simulation:
        assembly = simulation.assembly
    look, springs, torn = assembly.appearance, assembly.springs, solid_run.torn
    gone = [{frozenset(assembly.order[pair].tolist()) for pair in springs[marks]} for marks in torn]
    result = []
    for edges in gone:
        kept: dict[int, list[frozenset[int]]] = {body: [] for body in range(4)}
        # The first triangles are those of the surface; others may come to light inside.
        for triangle, body in zip(assembly.order[look.triangles].tolist(), look.triangle_body, strict=True):
            a, b, c = triangle
            if not edges & {frozenset((a, b)), frozenset((b, c)), frozenset((c, a))}:
                kept[int(body)].append(frozenset(triangle))
        result.append(kept)
    return result


def triangles_of(faces, numbers):
    """Triangles by the numbers of their corners."""
    return sorted(map(sorted, np.asarray(numbers)[np.asarray(faces)].tolist()))


def test_the_layout_is_as_the_docs_say(solid_run):
    names = {path.name for path in solid_run.folder.iterdir()}
    assert {"ply", "obj", "vtu", "springs", "scene.pvd", "scene_springs.pvd", "scene.usdc", "scene.glb"} <= names
    for kind, ending in (("ply", "ply"), ("faces", "ply"), ("obj", "obj"), ("vtu", "vtu"), ("springs", "vtu")):
        files = sorted(path.name for path in (solid_run.folder / kind).iterdir())
        assert files == [f"scene_{number:04d}.{ending}" for number in range(5)]


@pytest.mark.parametrize("number", [0, 4])
def test_ply(solid_run, whole_triangles, number):
    with (solid_run.folder / "ply" / f"scene_{number:04d}.ply").open("rb") as file:
        mesh = trimesh.load(file, file_type="ply", process=False)
    data = mesh.metadata["_ply_raw"]["vertex"]["data"] if "_ply_raw" in mesh.metadata else None
    particle, body = data["particle"].ravel(), data["body"].ravel()
    assert np.allclose(mesh.vertices, solid_run.positions[number][particle], atol=F32)
    speeds = np.stack([data[name].ravel() for name in ("vx", "vy", "vz")], axis=1)
    assert np.allclose(speeds, solid_run.velocities[number][particle], rtol=1e-6, atol=1e-6)
    assert set(body) == {0, 1, 2, 3}
    color = np.stack([data[name].ravel() for name in ("red", "green", "blue")], axis=1)
    assert (color[body == SOLID] == (255, 128, 0)).all()
    of_sheet = mesh.faces[body[mesh.faces[:, 0]] == SHEET]
    assert triangles_of(of_sheet, particle) == sorted(map(sorted, whole_triangles[number][SHEET]))
    # The inner particle of the box is no vertex, and the surface is closed and looks outward.
    box = trimesh.Trimesh(mesh.vertices, mesh.faces[body[mesh.faces[:, 0]] == SOLID])
    assert (body == SOLID).sum() == 26 and box.is_watertight and box.volume == pytest.approx(0.064, rel=0.2)
    edges = mesh.metadata["_ply_raw"]["edge"]["data"]
    rope = solid_run.rows(ROPE)
    ends = particle[np.stack([edges["vertex1"], edges["vertex2"]], axis=1).reshape(-1, 2)]
    assert ends.tolist() == [[k, k + 1] for k in range(rope.start, rope.stop - 1)]


def test_faces_are_the_ply_without_its_edges(solid_run):
    whole, faces = (
        (solid_run.folder / kind / "scene_0004.ply").read_bytes().split(b"end_header\n", 1) for kind in ("ply", "faces")
    )
    assert b"element edge" in whole[0] and b"element edge" not in faces[0]
    assert faces[0] == whole[0].split(b"element edge")[0] and whole[1].startswith(faces[1])


def test_the_sheet_loses_triangles(whole_triangles):
    assert len(whole_triangles[0][SHEET]) == 32 > len(whole_triangles[-1][SHEET]) > 0


def test_obj(solid_run, whole_triangles):
    scene = trimesh.load(
        solid_run.folder / "obj" / "scene_0004.obj", process=False, split_objects=True, group_material=False
    )
    text = (solid_run.folder / "obj" / "scene_0004.obj").read_text()
    assert [line[2:] for line in text.splitlines() if line.startswith("o ")] == ["the_box", "sheet", "rope", "point"]
    assert text.count("\nl ") == 5 and text.count("\np ") == 1
    parts = [part for part in scene.geometry.values() if hasattr(part, "faces")]
    sheet = next(part for part in parts if len(part.faces) == len(whole_triangles[4][SHEET]))
    own = solid_run.positions[4][solid_run.rows(SHEET)]
    near = np.linalg.norm(sheet.vertices[:, None] - own[None], axis=2)
    assert near.min(axis=1).max() < F32 and len(set(near.argmin(axis=1))) == len(sheet.vertices)
    found = triangles_of(sheet.faces, near.argmin(axis=1) + solid_run.rows(SHEET).start)
    assert found == sorted(map(sorted, whole_triangles[4][SHEET]))


@pytest.mark.parametrize("number", [0, 4])
def test_vtu(solid_run, whole_triangles, pyvista, number):
    grid = pyvista.read(solid_run.folder / "vtu" / f"scene_{number:04d}.vtu")
    assert np.array_equal(grid.points, solid_run.positions[number])
    assert np.array_equal(grid.point_data["velocity"], solid_run.velocities[number])
    with solid_run.trajectory() as trajectory:
        assert np.array_equal(grid.point_data["strain"], trajectory.strain(number))
    assert np.array_equal(grid.point_data["particle"], np.arange(len(solid_run.positions[0])))
    assert grid.field_data["TimeValue"][0] == pytest.approx(number * 0.05)
    cells, body = grid.cells_dict, grid.cell_data["body"]
    triangle = grid.celltypes == pyvista.CellType.TRIANGLE
    sheet = cells[pyvista.CellType.TRIANGLE][body[triangle] == SHEET]
    assert sorted(map(sorted, sheet.tolist())) == sorted(map(sorted, whole_triangles[number][SHEET]))
    rope = solid_run.rows(ROPE)
    assert cells[pyvista.CellType.LINE].tolist() == [[k, k + 1] for k in range(rope.start, rope.stop - 1)]
    assert cells[pyvista.CellType.VERTEX].tolist() == [[len(grid.points) - 1]]


def test_pvd_knows_the_times(solid_run, pyvista):
    for name in ("scene.pvd", "scene_springs.pvd"):
        reader = pyvista.get_reader(solid_run.folder / name)
        assert reader.time_values == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2])
        reader.set_active_time_point(3)
        assert np.array_equal(reader.read()[0].points, solid_run.positions[3])


def test_springs(solid_run, pyvista):
    grid = pyvista.read(solid_run.folder / "springs" / "scene_0004.vtu")
    torn, points = solid_run.torn[4], solid_run.positions[4]
    assert grid.n_cells == len(torn) - torn.sum() < len(torn)
    ends = grid.cells_dict[pyvista.CellType.LINE]
    first = solid_run.positions[0]
    length, rest = (np.linalg.norm(p[ends[:, 1]] - p[ends[:, 0]], axis=1) for p in (points, first))
    assert np.allclose(grid.cell_data["stretch"], length / rest - 1.0, atol=2e-6)
    assert set(grid.cell_data["body"]) == {SOLID, SHEET, ROPE}


def test_usd(solid_run, whole_triangles, pxr):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(solid_run.folder / "scene.usdc"))
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (0.0, 4.0, 20.0)
    sheet = UsdGeom.Mesh(stage.GetPrimAtPath("/scene/bodies/sheet/surface"))
    own = solid_run.rows(SHEET)
    for number in range(5):
        assert np.allclose(sheet.GetPointsAttr().Get(number), solid_run.positions[number][own], atol=F32)
        assert np.allclose(sheet.GetVelocitiesAttr().Get(number), solid_run.velocities[number][own], rtol=1e-6)
        faces = np.reshape(sheet.GetFaceVertexIndicesAttr().Get(number), (-1, 3))
        assert len(sheet.GetFaceVertexCountsAttr().Get(number)) == len(faces)
        assert triangles_of(faces, np.arange(own.start, own.stop)) == sorted(
            map(sorted, whole_triangles[number][SHEET])
        )
    assert sheet.GetDoubleSidedAttr().Get()
    box = UsdGeom.Mesh(stage.GetPrimAtPath("/scene/bodies/the_box/surface"))
    red, green, blue = box.GetDisplayColorAttr().Get()[0]
    assert (red, blue) == (1.0, 0.0) and green == pytest.approx(0.2158, abs=1e-3)  # linear light
    rope = UsdGeom.BasisCurves(stage.GetPrimAtPath("/scene/bodies/rope/lines"))
    points = solid_run.positions[4][solid_run.rows(ROPE)]
    pairs = np.stack([points[:-1], points[1:]], axis=1).reshape(-1, 3)
    assert np.allclose(rope.GetPointsAttr().Get(4), pairs, atol=F32)
    assert list(rope.GetCurveVertexCountsAttr().Get(4)) == [2] * 5
    ball = UsdGeom.Points(stage.GetPrimAtPath("/scene/bodies/point/particles"))
    assert np.allclose(ball.GetPointsAttr().Get(2), solid_run.positions[2][-1:], atol=F32)
    assert ball.GetWidthsAttr().Get()[0] == pytest.approx(0.1)


def test_usd_holds_colliders_that_move(solid_run, pxr):
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(solid_run.folder / "scene.usdc"))
    ramp = UsdGeom.Xformable(stage.GetPrimAtPath("/scene/colliders/ramp"))
    place = ramp.ComputeLocalToWorldTransform(4.0).Transform(Gf.Vec3d(0.1, 0.0, 0.0))
    assert np.allclose(place, (2.5, 0.2, 1.9), atol=1e-6)  # turned by 90 degrees about y: x goes to -z
    rod = stage.GetPrimAtPath("/scene/colliders/capsule_1/capsule_0")
    assert UsdGeom.Capsule(rod).GetHeightAttr().Get() == 2.0
    tip = UsdGeom.Xformable(rod).ComputeLocalToWorldTransform(0.0).Transform(Gf.Vec3d(0.0, 0.0, 1.0))
    assert np.allclose(tip, (0.0, 0.1, 1.0), atol=1e-6)


def test_glb(solid_run):
    scene = trimesh.load(solid_run.folder / "scene.glb", process=False)
    with solid_run.trajectory() as trajectory:
        best = trajectory.poster
    box = scene.geometry["the box"]
    own = solid_run.positions[best][solid_run.rows(SOLID)]
    near = np.linalg.norm(box.vertices[:, None] - own[None], axis=2)
    assert near.min(axis=1).max() < F32 and box.is_watertight
    assert box.visual.material.baseColorFactor[:3].tolist() == [255, 55, 0]  # linear light
    rope = scene.geometry["rope.lines"]
    ends = solid_run.positions[best][solid_run.rows(ROPE)]
    assert np.allclose(rope.vertices[:8].mean(axis=0), ends[0], atol=1e-6)
    assert {"half_space_0", "capsule_1", "ramp", "point.particles", "sheet"} <= set(scene.geometry)
    ramp = scene.graph.get("ramp")[0]
    with solid_run.trajectory() as trajectory:
        assert 2.0 < ramp[0, 3] <= 2.5 and trajectory.times[best] > 0.0


def test_flat_scenes_lie_in_a_plane(flat_run, pyvista, pxr):
    from pxr import Usd, UsdGeom

    last = in_space(flat_run.positions[-1])
    grid = pyvista.read(flat_run.folder / "vtu" / "scene_0003.vtu")
    assert grid.points.dtype == np.float64 and np.array_equal(grid.points, last)
    assert grid.cells_dict[pyvista.CellType.TRIANGLE].shape == (8 + 6, 3)
    assert grid.cells_dict[pyvista.CellType.LINE].tolist() == [[17, 18], [18, 19]]
    mesh = trimesh.load(flat_run.folder / "ply" / "scene_0003.ply", process=False)
    assert np.allclose(mesh.vertices[:9], last[:9], atol=1e-15) and (mesh.face_normals[:, 2] > 0.0).all()
    stage = Usd.Stage.Open(str(flat_run.folder / "scene.usdc"))
    square = UsdGeom.Mesh(stage.GetPrimAtPath("/scene/bodies/square/surface"))
    assert np.allclose(square.GetPointsAttr().Get(3), last[:9], atol=F32)
    ground = UsdGeom.Mesh(stage.GetPrimAtPath("/scene/colliders/half_space_0/surface"))
    corners = np.asarray(ground.GetPointsAttr().Get())
    normal = np.array([0.1, 1.0, 0.0]) / np.hypot(0.1, 1.0)
    assert (corners @ normal).max() == pytest.approx(0.0, abs=1e-5) and (corners[:, 2] == 0.0).all()
    scene = trimesh.load(flat_run.folder / "scene.glb", process=False)
    disc = scene.geometry["sphere_1"]
    assert disc.area == pytest.approx(np.pi * 0.16, rel=5e-3) and (disc.face_normals[:, 2] > 0.99).all()


def test_colors_by_value():
    """Colours show the value that the scene asks for."""
    with Simulation(solid_scene(color="speed", color_max=2.0)) as simulation:
        surfaces = Surfaces(simulation.assembly)
        velocities = np.zeros((simulation.particle_count, 3))
        velocities[0] = (0.0, 2.5, 0.0)
        frame = Frame(0, 0.0, simulation.positions(), velocities)
        box = surfaces.at(frame)[SOLID]
    assert np.allclose(box.colors[0], (0xFD / 255, 0xE7 / 255, 0x25 / 255))
    assert np.allclose(box.colors[1:], (0x44 / 255, 0x01 / 255, 0x54 / 255))


def test_long_runs_sort():
    names = [Stem("a{0}b", 12000).of(number) for number in (0, 9, 10, 9999, 10000, 12000)]
    assert names == sorted(names) and names[0] == "a{0}b_00000"


def test_carried_points_go_with_their_particles(tmp_path):
    """The surface of a mesh file that hangs on a lattice."""
    file = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=2, radius=0.2).export(file)
    shape = {"kind": "mesh", "file": str(file), "cells": 4}
    body = {"name": "ball", "shape": shape, "material": {"stiffness": 100.0, "mass": 1.0}}
    assembly = assemble(make_scene(dimension=3, bodies=[body]))
    surfaces = Surfaces(assembly)
    start = assembly.scene_order(assembly.positions)
    moved = 2.0 * start[:, [2, 0, 1]] + (1.0, 2.0, 3.0)
    shape_there = surfaces.at(Frame(0, 0.0, moved, np.ones_like(moved)))[0]
    first = surfaces.at(Frame(0, 0.0, start, np.ones_like(start)))[0]
    assert (first.particles == -1).all() and np.allclose(np.linalg.norm(first.vertices, axis=1), 0.2, atol=1e-6)
    assert np.allclose(shape_there.vertices, 2.0 * first.vertices[:, [2, 0, 1]] + (1.0, 2.0, 3.0))
    assert np.allclose(shape_there.velocities, 1.0)


def test_an_empty_array_is_whole(pyvista, tmp_path):
    """A frame in which everything has torn."""
    file = _Appended(1, 0)
    file.begin_piece()
    file.section("Points", {"points": np.zeros((1, 3))})
    none = np.zeros(0, dtype=np.int64)
    file.section("Cells", {"connectivity": none, "offsets": none, "types": none.astype(np.uint8)})
    (tmp_path / "x.vtu").write_bytes(file.finished())
    grid = pyvista.read(tmp_path / "x.vtu")
    assert (grid.n_points, grid.n_cells) == (1, 0)


def test_a_later_run_takes_exports_away_and_nothing_else(tmp_path):
    scene = flat_scene()
    (tmp_path / "ply").mkdir()
    with pytest.raises(Exception, match="is there already, not of an earlier run"):
        run(scene, RunOptions("flat", tmp_path, renderer="none", exports=("ply",)))
    assert left_in(tmp_path) == {"ply"}
    run(scene, RunOptions("flat", tmp_path, renderer="none", exports=("obj", "vtu")))
    assert {"obj", "vtu", "flat.pvd"} <= left_in(tmp_path)
    run(scene, RunOptions("flat", tmp_path, renderer="none", exports=("obj",)))
    names = left_in(tmp_path)
    assert {"ply", "obj"} <= names and not names & {"vtu", "flat.pvd"}
    run(scene, RunOptions("flat", tmp_path, renderer="none"))
    assert "ply" in left_in(tmp_path) and "obj" not in left_in(tmp_path)


def test_without_its_package_usd_is_one_line(refuses, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pxr", None)
    refuses("pip install 'softbody-sandbox[usd]'", "run", "drop_2d", "--export", "usd")


def test_every_format_is_tested(solid_run):
    assert set(ExportFormat) == {"ply", "faces", "obj", "vtu", "springs", "usd", "glb"}


def test_a_body_that_enters_later_is_not_there_before(tmp_path):
    scene = flat_scene()
    data = scene.model_dump(mode="json", exclude_none=True)
    data["actions"] = [{"kind": "spawn", "body": "ring", "time": 0.07}]
    run(make_scene(**data), RunOptions("flat", tmp_path, renderer="none", exports=("obj",)))
    texts = [path.read_text() for path in sorted((tmp_path / "obj").iterdir())]
    assert ["o ring" in text for text in texts] == [False, False, True, True]


def test_a_scene_that_is_empty_at_first(pyvista, pxr, tmp_path):
    """Every format has a file of a moment without bodies, or, as GLB, none."""
    point = {"kind": "custom", "points": [[0.0, 0.0]], "masses": [1.0]}
    scene = make_scene(
        dimension=2,
        duration=0.1,
        render={"fps": 20},
        solver={"dt": 1e-3},
        bodies=[{"name": "point", "shape": point}],
        actions=[{"kind": "spawn", "body": "point", "time": 0.09}],
    )
    formats = tuple(map(str, ExportFormat))
    run(scene, RunOptions("late", tmp_path, renderer="none", exports=formats, trajectory="npz"))
    assert "element vertex 0\n" in (tmp_path / "ply" / "late_0000.ply").read_bytes().decode("ascii", "replace")
    assert "element vertex 1\n" in (tmp_path / "ply" / "late_0002.ply").read_bytes().decode("ascii", "replace")
    grids = [pyvista.read(tmp_path / "vtu" / f"late_{number:04d}.vtu") for number in range(3)]
    assert [grid.n_cells for grid in grids] == [0, 0, 1]
    assert pyvista.read(tmp_path / "springs" / "late_0002.vtu").n_cells == 0
    stage = pxr.Usd.Stage.Open(str(tmp_path / "late.usdc"))
    seen = pxr.UsdGeom.Imageable(stage.GetPrimAtPath("/scene/bodies/point"))
    assert [seen.ComputeVisibility(code) for code in (0.0, 1.0, 2.0)] == ["invisible", "invisible", "inherited"]
