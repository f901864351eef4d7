"""Loading scenes: presets, overrides, round trips, and one clear line for whatever is wrong."""

import json
import tomllib

import pytest
import tomli_w

from sandbox import SceneError, json_schema, load_scene, preset_paths, to_toml
from sandbox.scene.assemble import assemble
from sandbox.scene.load import scene_from_data
from sandbox.scene.overrides import parse_assignment

VALID = {
    "dimension": 2,
    "gravity": [0.0, -9.81],
    "bodies": [
        {
            "name": "box",
            "shape": {"kind": "box", "size": [1.0, 1.0], "cells": [2, 2]},
            "material": {"youngs_modulus": 1e4, "damping_ratio": 0.1},
        }
    ],
    "colliders": [{"kind": "half_space", "point": [0, 0], "normal": [0, 1]}],
}


def test_every_preset_loads_and_survives_a_round_trip_through_toml():
    assert {"jelly", "rope", "drop_2d"} <= set(preset_paths())
    for name in preset_paths():
        scene = load_scene(name)
        assert scene.title and scene.description
        assert scene_from_data(tomllib.loads(to_toml(scene)), None) == scene


def test_jelly_has_at_least_4000_particles():
    assert assemble(load_scene("jelly")).particle_count >= 4000


def test_overrides_reach_tables_that_are_not_there_and_lists_in_both_notations():
    overrides = {"solver.dt": 1e-4, "bodies.0.material.youngs_modulus": 5.0, "bodies[0].position": [1.0, 2.0]}
    scene = scene_from_data(VALID, overrides)
    assert scene.solver.dt == 1e-4
    assert scene.bodies[0].material.youngs_modulus == 5.0
    assert scene.bodies[0].position == (1.0, 2.0)
    assert "solver" not in VALID  # the data given are left alone


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("solver.dt=1e-4", ("solver.dt", 1e-4)),
        ("a.b=[1, 2]", ("a.b", [1, 2])),
        ("solver.integrator=velocity_verlet", ("solver.integrator", "velocity_verlet")),
        ('title="a = b"', ("title", "a = b")),
        ("render.struts=true", ("render.struts", True)),
    ],
)
def test_assignments(text, expected):
    assert parse_assignment(text) == expected


def changed(path: str, value: object) -> dict:
    data = json.loads(json.dumps(VALID))
    node = data
    *way, last = path.split(".")
    for part in way:
        node = node[int(part)] if isinstance(node, list) else node.setdefault(part, {})
    node[int(last) if isinstance(node, list) else last] = value
    return data


CUSTOM = {"kind": "custom", "points": [[0, 0], [1, 0]]}
WRONG = [
    ("colour", 1, "colour: unknown key; did you mean color?"),
    ("bodies.0.material.stifness", 1.0, "bodies[0].material.stifness: unknown key; did you mean stiffness?"),
    ("bodies.0.material.stiffness", -3, "bodies[0].material.stiffness: must be > 0, got -3"),
    ("bodies.0.material.stiffness", "hard", "bodies[0].material.stiffness: must be a number, got 'hard'"),
    ("bodies.0.material.stiffness", True, "bodies[0].material.stiffness: must be a number, got True"),
    ("bodies.0.material.stiffness", 3.0, "bodies[0].material: give stiffness or youngs_modulus, not both"),
    ("bodies.0.material.mass", -1.0, "bodies[0].material.mass: must be > 0, got -1.0"),
    ("bodies.0.material.density", float("inf"), "bodies[0].material.density: must be a finite number, got inf"),
    ("bodies.0.shape.size", [1.0, 0.0], "bodies[0].shape.size: must be > 0 in every direction, got 0.0"),
    ("bodies.0.shape.size", [1.0, 1.0, 1.0], "bodies[0].shape.size: must have 2 components in a 2D scene, got 3"),
    ("bodies.0.shape.cells", [2], "bodies[0].shape.cells: must have 2 entries in a 2D scene, got 1"),
    ("bodies.0.shape.cells", [2.5, 2], "bodies[0].shape.cells[0]: must be a whole number, got 2.5"),
    ("bodies.0.shape.kind", "bx", "bodies[0].shape: kind must be one of 'box', 'ball', 'rope', 'sheet', 'ring',"),
    ("bodies.0.shape.springs", [[0, 1]], "bodies[0].shape.springs: unknown key"),
    (
        "bodies.0.shape",
        {**CUSTOM, "springs": [[0, 7]]},
        "bodies[0].shape: springs[0] names point 7, but there are only 2 (0 to 1)",
    ),
    ("bodies.0.shape", {**CUSTOM, "springs": [[1, 1]]}, "bodies[0].shape: springs[0] joins point 1 to itself"),
    ("bodies.0.shape", {**CUSTOM, "masses": [1.0]}, "masses must have one entry a point (2), got 1"),
    ("bodies.0.shape", {**CUSTOM, "masses": [1.0, -1.0]}, "bodies[0].shape.masses[1]: must be > 0, got -1.0"),
    ("bodies.0.shape", {**CUSTOM, "pinned": [-1]}, "bodies[0].shape.pinned[0]: must be >= 0, got -1"),
    ("bodies.0.shape", {"kind": "sheet", "size": [1, 1], "cells": [1, 1]}, "a sheet needs a 3D scene"),
    ("bodies.0.rotation", [1.0, 2.0, 3.0], "bodies[0].rotation: must be one number in a 2D scene"),
    ("bodies.0.name", "", "bodies[0].name: must not be empty"),
    ("bodies", [], "bodies: must have at least 1 entries, got 0"),
    ("bodies", 3, "bodies: must be a list, got 3"),
    ("dimension", 4, "dimension: must be 2 or 3, got 4"),
    ("gravity", [0.0, 0.0, -9.81], "gravity: must have 2 components in a 2D scene, got 3"),
    ("solver.dt", -1e-3, "solver.dt: must be > 0 or 'auto', got -0.001"),
    ("solver.integrator", "rk5", "solver.integrator: must be"),
    ("colliders.0.normal", [0, 0], "colliders[0].normal: must not be the zero vector"),
    ("colliders.0.restitution", 1.5, "colliders[0].restitution: must be <= 1, got 1.5"),
    ("render.size", [1281, 720], "render: size must be even"),
    ("render.camera", {"eye": [1, 2], "target": [1, 2]}, "render.camera: eye and target are the same point"),
    ("render.fps", 0, "render.fps: must be > 0, got 0"),
    ("duration", 0, "duration: must be > 0, got 0"),
    ("bodies.0.self_contact", True, "bodies[0]: self_contact needs radius > 0"),
    ("bodies.0.radius", -0.1, "bodies[0].radius: must be >= 0 or 'auto', got -0.1"),
    ("bodies.0.pressure", {}, "bodies[0].pressure: give either amount or gauge_pressure"),
    ("bodies.0.pressure", {"amount": -1.0}, "bodies[0].pressure.amount: must be >= 0, got -1.0"),
    ("bodies.0.pressure", {"gauge_pressure": -2e5}, "bodies[0].pressure: gauge_pressure is below vacuum"),
    ("bodies.0.pressure", {"amount": 1.0, "temperature": 0.0}, "bodies[0].pressure.temperature: must be > 0, got 0.0"),
    ("bodies.0.material.creep", 1.0, "bodies[0].material: creep needs yield_strain"),
    ("bodies.0.material.yield_strain", 0.0, "bodies[0].material.yield_strain: must be > 0, got 0.0"),
    ("bodies.0.material.break_strain", -0.1, "bodies[0].material.break_strain: must be > 0, got -0.1"),
    (
        "bodies.0.shape",
        {"kind": "shell", "radius": 1.0, "subdivisions": 2},
        "a shell needs a 3D scene; in 2D use a ring",
    ),
    ("bodies.0.shape", {"kind": "ring", "radius": 1.0, "segments": 2}, "bodies[0].shape.segments: must be >= 3, got 2"),
    ("bodies.0.shape", {"kind": "mesh", "file": ""}, "bodies[0].shape.file: must not be empty"),
    (
        "colliders.0",
        {"kind": "mesh", "file": "a.obj"},
        "colliders[0].kind: a mesh needs a 3D scene; in 2D use a polygon",
    ),
    (
        "colliders.0",
        {"kind": "polygon", "points": [[0, 0], [1, 0]]},
        "colliders[0].points: must have at least 3 entries",
    ),
    ("colliders.0", {"kind": "polygon", "points": [[0, 0], [1, 0], [0, 1, 2]]}, "colliders[0].points[2]: must have 2"),
    ("colliders.0.motion", [{"time": 1.0}, {"time": 1.0}], "colliders[0]: motion[1].time must be later than the one"),
    ("colliders.0.motion", [{"time": 1.0, "position": [0, 0, 0]}], "colliders[0].motion[0].position: must have 2"),
    ("colliders.0.name", "box", "colliders[0].name: 'box' is the name of an earlier body or collider too"),
    ("attachments", [{"body": "square", "to": "x"}], "attachments[0]: give indices or region"),
    ("wind", {"velocity": [1.0, 0.0, 0.0]}, "wind.velocity: must have 2 components in a 2D scene, got 3"),
    ("wind", {"gust": {"strength": -1.0}}, "wind.gust.strength: must be > 0, got -1.0"),
    (
        "wind",
        {"vortices": [{"center": [0, 0, 0], "speed": 1.0, "radius": 1.0}]},
        "wind.vortices[0].center: must have 2",
    ),
    ("contact", {"skin": 0.0}, "contact.skin: must be > 0, got 0.0"),
    ("bodies.0.pin", {}, "bodies[0].pin: give indices or a region"),
    ("wind", {"velocity": [1, 0], "start": 1.0, "end": 0.5}, "wind: end must be later than start"),
    ("contact", {"skin": 1e3}, "contact.skin: must be <= 100, got 1000.0"),
    ("bodies.0.pressure", {"amount": 1.0, "temperature": 1e9}, "temperature: must be <= 1e+06, got 1000000000.0"),
    ("duration", 1e300, "duration: must not be beyond 1e+15, got 1e+300"),
    ("gravity", [0.0, -1e16], "gravity[1]: must not be beyond 1e+15, got -1e+16"),
    ("bodies.0.material.density", 1e-300, "bodies[0].material.density: is too small to compute with (below 1e-18)"),
    ("solver.tolerance", 1.0, "solver.tolerance: must be < 1, got 1.0"),
    ("interaction", {"grips": 1001}, "interaction.grips: must be <= 1000, got 1001"),
    (
        "actions",
        [{"kind": "pump", "body": "square", "start": 0.0, "end": 1.0, "amount": 1.0}],
        "actions[0].body: there is no body 'square' with pressure",
    ),
    (
        "actions",
        [{"kind": "pump", "body": "square", "start": 2.0, "end": 1.0, "amount": 1.0}],
        "actions[0]: end must be later than start",
    ),
]


@pytest.mark.parametrize(("path", "value", "message"), WRONG, ids=[f"{path}-{value}"[:50] for path, value, _ in WRONG])
def test_wrong_scenes_are_one_line_that_says_where(path, value, message):
    with pytest.raises(SceneError) as caught:
        scene_from_data(changed(path, value), None, source="scenes/x.toml")
    assert str(caught.value).startswith("scenes/x.toml: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


ASSEMBLY = [
    ("bodies.0.material", {}, "bodies[0].material: give stiffness or youngs_modulus for the springs"),
    ("bodies.0.shape.cells", [1, 9], "bodies[0].shape.cells: too far from squares or cubes"),
    ("bodies.0.shape.bracing", "none", "bracing none resists no shear"),
    ("bodies.0.pin", {"indices": [99]}, "bodies[0].pin.indices[0]: there is no particle 99; the body has 9"),
    ("bodies.0.pin", {"region": {"min": [5, 5], "max": [6, 6]}}, "bodies[0].pin.region: holds no particle"),
    ("bodies.0.position", [1e15, 0.0], "bodies[0]: its positions are too large to compute with"),
    ("bodies.0.shape", {**CUSTOM, "springs": [[0, 1]]}, "a custom shape has no lattice; give stiffness"),
    (
        "bodies.0",
        {"name": "b", "shape": {**CUSTOM, "points": [[0, 0]]}, "pressure": {"amount": 1.0}},
        "bodies[0].pressure: the body is not closed; use a ring",
    ),
    ("attachments", [{"body": "box", "indices": [0], "to": "x"}], "attachments[0].to: there is no body or collider"),
    (
        "bodies.0.shape",
        {"kind": "polygon", "points": [[0, 0], [1, 1], [1, 0], [0, 1]], "spacing": 0.1},
        "bodies[0].shape: points: the outline meets itself",
    ),
]


@pytest.mark.parametrize(("path", "value", "message"), ASSEMBLY, ids=[str(row)[:40] for row in ASSEMBLY])
def test_parts_that_do_not_fit_together(path, value, message):
    with pytest.raises(SceneError) as caught:
        assemble(scene_from_data(changed(path, value), None))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("solver.foo", "--set solver.foo: solver.foo: unknown key"),
        ("bodies.7.name", "--set bodies.7.name: bodies.7: there is no such entry; the list has 1"),
        ("bodies.first.name", "bodies.first: there is no such entry; the list has 1: box"),
        ("bodies[first].name", "--set bodies[first].name: bodies.first: there is no such entry; the list has 1: box"),
        ("colliders.walls.friction", "colliders.walls: there is no such entry; the list has"),
        ("attachments.0.body", "--set attachments.0.body: attachments.0: there is no such entry; the list has 0"),
        ("actions.poke.time", "actions.poke: there is no such entry; the list has 0"),
        ("bodies..name", "--set bodies..name: has an empty part"),
        ("bodies.\u00b2.name", "bodies.\u00b2: there is no such entry; the list has 1"),
        (".".join(["a"] * 1500), "has more than 64 parts"),
        ("bodies.box.material.stiffness", "bodies[0].material.stiffness: must be a number, got 'wrong'"),
        ("bodies.box.densty", "--set bodies.box.densty: bodies[0].densty: unknown key; did you mean density?"),
        ("solver.dt.x", "--set solver.dt.x: solver.dt: must be a number or 'auto', got {'x': 'wrong'}"),
        ("dimension.x", "--set dimension.x: dimension is not a table"),
        ("solver..dt", "--set solver..dt: has an empty part"),
        ("solver.dt", "--set solver.dt: solver.dt: must be a number or 'auto', got 'wrong'"),
    ],
)
def test_bad_overrides_name_the_override(key, message):
    with pytest.raises(SceneError) as caught:
        scene_from_data(VALID, {key: "wrong"}, source="x.toml")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a" + ".a" * 1200 + " = 1", "is nested more than 64 levels deep"),
        ("a = " + "[" * 1500 + "]" * 1500, "is not TOML: maximum recursion depth exceeded"),
        ("a = " + "[" * 100 + "]" * 100, "is nested more than 64 levels deep"),
        ("duration = " + "9" * 5000, "has a number of more digits than are read"),
        ("a = [{kind = 0x" + "f" * 5000 + "}]", "has a number of more digits than are read"),
    ],
    ids=["keys", "lists", "fewer lists", "digits", "hexadecimal"],
)
def test_absurd_files_are_one_line(text, message, tmp_path):
    path = tmp_path / "x.toml"
    path.write_text(text)
    with pytest.raises(SceneError, match=message) as caught:
        load_scene(path)
    assert len(str(caught.value)) < 300


def test_a_message_obeys_no_terminal():
    with pytest.raises(SceneError, match=r"x: \\x1b\[31m\\x00\\u202e: unknown key"):
        scene_from_data({**VALID, "\x1b[31m\x00\u202e": 1}, None, source="x")


def test_bodies_are_bounded_together():
    box = {"shape": {"kind": "box", "size": [1.0, 1.0], "cells": [4000, 4000]}}
    scene_from_data({"dimension": 2, "bodies": [{"name": "a", **box}]}, None)
    with pytest.raises(SceneError, match=r"bodies: make 3.2e.07 particles together, at most 2e.07 are taken"):
        scene_from_data({"dimension": 2, "bodies": [{"name": "a", **box}, {"name": "b", **box}]}, None)


@pytest.mark.parametrize(
    "value", [1 << 20_000, [[1 << 20_000]], json.loads("[" * 90 + "]" * 90)], ids=["number", "list", "deep"]
)
def test_absurd_overrides_are_one_line(value):
    with pytest.raises(SceneError, match=r"--set duration: (has a number of more digits|is nested more than)"):
        scene_from_data(VALID, {"duration": value})


NAMED = {
    "dimension": 2,
    "bodies": [
        {"name": name, "shape": {"kind": "box", "size": [1.0, 0.7], "cells": [3, 2]}}
        for name in ("jelly", "leg.1", "0", "a [b]")
    ],
    "colliders": [
        {"kind": "half_space", "point": [0.0, -9.0], "normal": [0.0, 1.0]},
        {"kind": "sphere", "name": "ball", "position": [0.0, -5.0], "radius": 0.3},
    ],
}


def test_bodies_and_colliders_go_by_number_or_name():
    scene = scene_from_data(
        NAMED,
        {
            "bodies.jelly.material.stiffness": 5.0,
            "bodies.leg.1.material.stiffness": 6.0,
            "bodies[2].material.stiffness": 7.0,  # a number is a number
            "bodies.a [b].material.stiffness": 8.0,
            "colliders.ball.friction": 0.4,
        },
    )
    assert [body.material.stiffness for body in scene.bodies] == [5.0, 6.0, 7.0, 8.0]
    assert [collider.friction for collider in scene.colliders] == [0.0, 0.4]
    # One change after the other: a body goes by the name that it was given before.
    renamed = scene_from_data(NAMED, {"bodies.jelly.name": "gel", "bodies.gel.color": "#010203"})
    assert renamed.bodies[0].color == "#010203"


def test_relative_mesh_files_begin_at_the_scene_s_folder_wherever_they_are_named(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    scene = tmp_path / "scene.toml"
    mesh = {"kind": "mesh", "file": "a.obj", "position": [0.0, 0.0, 0.0]}
    body = {"name": "it", "shape": {"kind": "mesh", "file": "a.obj"}}
    scene.write_text(tomli_w.dumps({"dimension": 3, "bodies": [body], "colliders": [mesh]}))
    shape = {"kind": "mesh", "file": "sub/b.obj"}
    for overrides, expected in (
        ({}, "a.obj"),
        ({"bodies.0.shape.file": "sub/b.obj", "colliders.0.file": "sub/b.obj"}, "sub/b.obj"),
        ({"bodies.it.shape": shape, "colliders": [{**mesh, "file": "sub/b.obj"}]}, "sub/b.obj"),
        ({"bodies": [{**body, "shape": shape}], "colliders.0.file": "./sub/../sub/b.obj"}, "sub/b.obj"),
        ({"bodies.it.shape.file": str(tmp_path / "c.obj"), "colliders.0.file": str(tmp_path / "c.obj")}, "c.obj"),
    ):
        found = load_scene(scene, overrides)
        assert found.bodies[0].shape.file == found.colliders[0].file == str(tmp_path / expected)
    assert shape["file"] == "sub/b.obj"  # what was given is left alone


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        ("#3D9BE0", "#3D9BE0"), ("#fa3", "#ffaa33"), ("tomato", "#ff6347"), ("RebeccaPurple", "#663399"),
        ("grey", "#808080"), ("gray", "#808080"), ("lightgoldenrodyellow", "#fafad2"),
    ],
)  # fmt: skip
def test_colors_are_hexadecimal_or_css_names(color, expected):
    scene = scene_from_data(NAMED, {"bodies.jelly.color": color, "colliders.ball.color": color})
    assert scene.bodies[0].color == scene.colliders[1].color == expected


@pytest.mark.parametrize("color", ["", "#12345", "#12345678", "rgb(1,2,3)", "hsl(0,100%,50%)", "transparent", "#ggg"])
def test_other_colors_are_refused(color):
    with pytest.raises(SceneError, match=r"bodies\[0\].color: must be a color such as #e8604c or a CSS name") as caught:
        scene_from_data(NAMED, {"bodies.0.color": color})
    assert "did you mean" not in str(caught.value)


def test_hints_name_only_what_is_really_near():
    near = {
        "jely": "jelly", "JELLY": "jelly", "ballon": "balloon", "drop": "drop_2d", "boxes": "boxes_2d",
        "pump": "pump_up", "suregry": "surgery", "tissues": "tissue", "bridge_2d": "bridge", "trampolin": "trampoline",
    }  # fmt: skip
    for word in ("poked", "table", "xyz", "j", "landing", "soft", "cube", "tower_of_pisa", "2d", "stone"):
        near[word] = ""
    for word, name in near.items():
        with pytest.raises(SceneError) as caught:
            load_scene(word)
        hint = f"did you mean {name}?" if name else "there are balloon, balloons_2d, "
        assert f"{word}: no such preset or file; {hint}" in str(caught.value)
    keys = {"tension": "tension_only", "stifness": "stiffness", "E": "", "timestep": "", "breaks": "", "poked": ""}
    for word, name in keys.items():
        with pytest.raises(SceneError) as caught:
            scene_from_data(VALID, {word: 1.0})
        assert str(caught.value).endswith(f"{word}: unknown key" + (f"; did you mean {name}?" if name else ""))


def test_missing_and_broken_files(tmp_path):
    with pytest.raises(SceneError, match=r"jely: no such preset or file; did you mean jelly\?"):
        load_scene("jely")
    with pytest.raises(SceneError, match="cannot be read: No such file"):
        load_scene(tmp_path / "none.toml")
    with pytest.raises(SceneError, match="cannot be read: Is a directory"):
        load_scene(tmp_path)
    broken = tmp_path / "broken.toml"
    broken.write_text("dimension = = 2")
    with pytest.raises(SceneError, match=r"broken.toml: is not TOML: .*line 1"):
        load_scene(broken)
    broken.write_bytes(b"\xff\xfe")
    with pytest.raises(SceneError, match="not UTF-8"):
        load_scene(broken)


def test_schema_describes_every_quantity():
    schema = json.loads(json_schema())
    assert schema["properties"]["duration"]["description"] == "simulated time [s]"
    undescribed = [
        f"{name}.{key}"
        for name, part in schema["$defs"].items()
        for key, entry in part.get("properties", {}).items()
        if not (entry.get("description") or "$ref" in entry or "const" in entry or "allOf" in entry)
    ]
    assert undescribed == []
