"""The list of what a run could not do: every kind of warning where it is due, and silence where it is not.

docs/warnings.md has a table of all kinds with their tests.
"""

import json
import re

import numpy as np
import pytest
import trimesh

from sandbox import SceneError, SceneWarning, StabilityWarning, to_toml
from sandbox.integrators.schemes import SCHEMES
from sandbox.pipeline import network_of
from sandbox.scene.assemble import assemble
from sandbox.start import start_remarks
from sandbox.step_size import StepSize
from sandbox.warning_log import WarningKind, WarningLog
from tests.conftest import make_scene, oscillator

pytestmark = pytest.mark.filterwarnings("ignore::sandbox.warning_log.SceneWarning")
SOLVER = {"dt": 1e-3, "precision": "f64"}
UP = {"kind": "half_space", "name": "floor", "point": [0.0, 0.0], "normal": [0.0, 1.0]}


def kinds(simulation):
    return simulation.warning_log.kinds()


def box(name="box", at=(0.0, 0.0), cells=(3, 2), size=(0.3, 0.2), **more):
    shape = {"kind": "box", "size": list(size), "cells": list(cells)}
    material = {"youngs_modulus": 1e5, "damping_ratio": 0.1} | more.pop("material", {})
    return {"name": name, "position": list(at), "shape": shape, "material": material, **more}


def scene_of(*bodies, **more):
    return make_scene(**{"dimension": 2, "solver": SOLVER, "bodies": list(bodies), "duration": 1.0} | more)


# -- the list itself -----------------------------------------------------------------------------------------------


def test_a_line_takes_the_place_of_the_one_about_the_same_thing_and_the_first_ones_stay():
    log = WarningLog()
    log.note(WarningKind.INVERTED, "1 cell")
    log.note(WarningKind.INVERTED, "7 cells")
    log.note(WarningKind.UNCONVERGED, "not solved", "xpbd")
    assert log.lines == ["7 cells", "not solved"] and log.kinds() == {WarningKind.INVERTED, WarningKind.UNCONVERGED}
    log.begin_again()
    assert log.lines == []


def test_what_does_nothing_is_told():
    def told(pin=None, **more):
        body = box() if pin is None else box(pin=pin)
        return [one.line for one in start_remarks(assemble(scene_of(body, **more))) if one.kind is WarningKind.IDLE]

    everything = {"indices": list(range(12))}
    wind = {"velocity": [1.0, 0.0]}
    assert told() == told({"indices": [0]}) == told(wind=wind, render={"poster": 1.0}) == []
    assert told(everything) == ["bodies: every particle is pinned or held, nothing can move"]
    assert told(everything, actions=[{"kind": "unpin", "body": "box", "time": 0.5}]) == []
    assert told(wind=wind | {"start": 1.0}) == ["wind: begins at 1 s, when the run is over"]
    assert told(render={"poster": 1.5}) == ["render.poster: at 1.5 s the run is over; the last picture is taken"]


def test_a_step_above_the_limit_is_known_from_the_start_and_stays_known(simulate):
    with pytest.warns(StabilityWarning, match=r"solver.dt = 0.1 s is above the stability limit 0.06325 s") as caught:
        simulation = simulate(oscillator("symplectic_euler", 0.1))
    assert (
        issubclass(StabilityWarning, SceneWarning) and len(caught) == 1 and caught[0].filename.endswith("conftest.py")
    )
    assert kinds(simulation) == {WarningKind.STEP_ABOVE_LIMIT}
    simulation.restore()
    assert kinds(simulation) == {WarningKind.STEP_ABOVE_LIMIT}
    assert simulate(oscillator("symplectic_euler", 0.06)).warnings == []
    assert simulate(oscillator("symplectic_euler", 0.1), warns=False).warnings == []


def steps_of(scene):
    assembly = assemble(scene)
    return StepSize(SCHEMES[scene.solver.integrator], assembly, network_of(assembly))


def test_a_run_longer_than_its_horizon_is_told_where_vibrations_would_grow():
    """Heun's scheme lets what is not damped grow in any step, and "auto" keeps that small for solver.horizon."""

    def told(duration, integrator="heun", dt="auto", damping=0.0, **solver):
        scene = oscillator(integrator, dt, damping)
        changes = {"duration": duration, "solver": scene.solver.model_copy(update=solver)}
        remarks = steps_of(scene.model_copy(update=changes)).remarks()
        return [remark.line for remark in remarks if remark.kind is WarningKind.STEP_ABOVE_LIMIT]

    (line,) = told(1000.0)
    assert "solver.horizon = 10 s: in the 1000 s of this run vibrations without damping may grow" in line
    # A shorter step than the limit lets them grow by less than tenfold for some time more.
    assert told(10.5) == told(1000.0, horizon=1000.0) == told(1000.0, damping=0.1) == []
    assert told(1000.0, "rk4") == told(1000.0, "implicit_euler") == []
    # A step of one's own need hold for the run alone.
    dt = 1.2 * steps_of(oscillator("heun", "auto")).limit
    assert told(2.0, dt=dt) == [] and "above the stability limit" in told(10.0, dt=dt)[0]


def test_rescues_are_told(simulate):
    def rescued(dt):
        scene = oscillator("velocity_verlet", dt, start=1.2)
        simulation = simulate(scene.model_copy(update={"solver": scene.solver.model_copy(update={"adapt": "rescue"})}))
        simulation.advance(2.0)
        return simulation

    simulation = rescued(0.1)
    assert WarningKind.RESCUED in kinds(simulation)
    assert f"rescued {len(simulation.rescues)} times" in simulation.warnings[-1]
    simulation.restore()
    assert kinds(simulation) == {WarningKind.STEP_ABOVE_LIMIT}
    assert rescued(0.05).warnings == []


# -- cells ---------------------------------------------------------------------------------------------------------

SHAPES = {
    "squares": (2, {"kind": "box", "size": [0.3, 0.2], "cells": [3, 2]}),
    "disc": (2, {"kind": "ball", "radius": 0.25, "cells": 5}),
    "outline": (2, {"kind": "polygon", "points": [[0, 0], [0.5, 0], [0.6, 0.4], [0.1, 0.35]], "spacing": 0.13}),
    "triangle": (
        2,
        {
            "kind": "custom",
            "points": [[0, 0], [0, 1], [1, 0]],
            "springs": [[0, 1], [1, 2], [2, 0]],
            "triangles": [[0, 1, 2]],
        },
    ),
    "cubes": (3, {"kind": "box", "size": [0.3, 0.2, 0.4], "cells": [3, 2, 4]}),
    "ball": (3, {"kind": "ball", "radius": 0.3, "cells": 6}),
}


def solid(shape, turned=0.0, **material):
    dimension, shape = SHAPES[shape]
    name, rotation = "body", turned if dimension == 2 else [turned, 20.0, -70.0]
    body = {"name": name, "shape": shape, "rotation": rotation, "material": {"stiffness": 90.0} | material}
    return make_scene(dimension=dimension, solver=SOLVER, bodies=[body])


@pytest.mark.parametrize("shape", SHAPES)
def test_all_cells_of_a_mirrored_body_are_inverted_and_none_of_a_turned_one(simulate, shape):
    simulation = simulate(solid(shape, turned=110.0))
    cells = len(simulation.assembly.cells)
    x, v = simulation.positions(), simulation.velocities()
    assert cells > 0 and simulation.measure().inverted_cells == 0
    simulation.set_state(x * ([-1.0] + [1.0] * (x.shape[1] - 1)), v)
    assert simulation.measure().inverted == {0: cells}
    # Stretched and sheared by far it still has its right side out.
    shear = np.eye(x.shape[1])
    shear[0] = [1.8, 0.9, -0.6][: x.shape[1]]
    simulation.set_state(x @ shear.T, v)
    assert simulation.measure().inverted_cells == 0


def test_a_point_that_is_pushed_through_the_body_inverts_the_cells_around_it(simulate):
    simulation = simulate(solid("cubes"))
    x, v = simulation.positions(), simulation.velocities()
    middle = int(np.argmin(np.linalg.norm(x - x.mean(axis=0), axis=1)))
    around = (simulation.assembly.scene_order(np.arange(len(x), dtype=float)) == middle).argmax()
    own = (simulation.assembly.cells.corners == around).any(axis=1).sum()
    x[middle] += [0.0, 0.0, 0.13]  # past the next layer of points, 0.1 m away
    simulation.set_state(x, v)
    assert 0 < simulation.measure().inverted_cells <= 2 * own


def test_a_cell_with_a_torn_spring_is_no_cell_any_more(simulate):
    simulation = simulate(solid("squares", break_strain=50.0))
    x, v = simulation.positions(), simulation.velocities()
    torn = np.zeros(simulation.spring_count)
    corners = simulation.assembly.cells.corners[4]
    torn[np.isin(simulation.assembly.springs, corners).all(axis=1).argmax()] = 1.0
    holders = (simulation.assembly.cells.springs == torn.argmax()).any(axis=1).sum()
    simulation.set_state(x * [-1.0, 1.0], v, memory=simulation.memory | {"springs.torn": torn})
    assert simulation.measure().inverted_cells == 6 - holders < 6


def test_cells_that_stay_inside_out_are_told_by_body_and_time(simulate):
    """Mirrored springs are as much at rest as others, so that it stays so."""
    simulation = simulate(scene_of(box("left"), box("right", at=(1.0, 0.0))))
    x, v = start = simulation.positions(), simulation.velocities()
    x = x.copy()
    x[12:] = [2.0, 0.0] - x[12:] * [1.0, -1.0]  # the body on the right, mirrored about its own middle
    simulation.set_state(x, v)
    simulation.advance(0.5)
    assert kinds(simulation) == {WarningKind.INVERTED}
    line = simulation.warnings[0]
    assert line.startswith("cells inside out: 6 of 6 of 'right' since t = 0.0") and "'left'" not in line
    simulation.set_state(*start, time=0.6)
    simulation.advance(0.1)
    assert simulation.warnings == [line]  # what was is not forgotten
    simulation.restore()
    assert simulation.warnings == []
    simulation.advance(0.5)
    assert simulation.warnings == []


# -- bodies and colliders ------------------------------------------------------------------------------------------


def meeting(speed, **more):
    return scene_of(
        box("one", velocity=[speed, 0.0], **more), box("two", at=(0.8, 0.01), velocity=[-speed, 0.0], **more)
    )


def test_bodies_without_a_radius_are_named_once_they_are_in_each_other(simulate):
    simulation = simulate(meeting(1.0))
    simulation.advance(0.15)  # 0.3 m of the 0.5 m between them
    assert simulation.warnings == []
    simulation.advance(0.35)
    assert kinds(simulation) == {WarningKind.CANNOT_MEET} and "'one' and 'two' from t = 0.2" in simulation.warnings[0]
    apart = simulate(meeting(-1.0))
    apart.advance(0.4)
    assert apart.warnings == []


def test_an_automatic_radius_leaves_no_gap_and_bodies_meet(simulate):
    simulation = simulate(meeting(1.0, radius="auto"))
    # Spacing 0.1: neighbours overlap a little, their neighbours do not.
    assert (simulation.assembly.radii > 0.05).all() and (simulation.assembly.radii < 0.06).all()
    simulation.advance(0.6)
    x = simulation.positions()[:, 0].reshape(2, -1).mean(axis=1)
    assert simulation.warnings == [] and x[1] - x[0] > 0.3


@pytest.mark.parametrize(
    ("shape", "way"),
    [
        ({"kind": "box", "size": [0.3, 0.6], "cells": [3, 3]}, 0.2),
        ({"kind": "rope", "from": [0, 0], "to": [2, 0], "segments": 8, "thickness": 0.02}, 0.25),
        ({"kind": "custom", "points": [[0, 0], [1, 0], [1, 0.3]], "springs": [[0, 1], [1, 2], [2, 0]]}, 1.0),
    ],
)
def test_an_automatic_radius_reaches_half_of_the_way_between_neighbours(shape, way):
    assembly = assemble(scene_of({"name": "b", "shape": shape, "radius": "auto", "material": {"stiffness": 1.0}}))
    assert assembly.radii == pytest.approx(0.525 * way)


def test_an_automatic_radius_needs_springs():
    point = {"name": "p", "shape": {"kind": "custom", "points": [[0.0, 0.0]]}, "radius": "auto"}
    with pytest.raises(SceneError, match=r'bodies\[0\].radius: "auto" goes by the springs'):
        assemble(scene_of(point))


@pytest.mark.parametrize(
    ("radius", "gap", "line"),
    [
        (0.05, 0.101, None),
        (0.05, 0.09, None),  # a little too close is pushed apart
        (0.05, 0.06, "'one' and 'two' by 0.04 m"),
        (0.05, -0.16, "'one' and 'two' by 0.1"),
        (0.0, 0.06, None),
        (0.0, -0.12, "'one' and 'two' by 0.1.* for want of a contact radius"),
    ],
)
def test_bodies_that_overlap_at_the_start_are_named(radius, gap, line):
    bodies = [box("one", radius=radius), box("two", at=(0.3 + gap, 0.0), radius=radius), box("far", at=(0.0, 5.0))]
    remarks = [r for r in start_remarks(assemble(scene_of(*bodies))) if r.kind is WarningKind.STARTS_OVERLAPPING]
    if line is None:
        assert remarks == []
    else:
        assert len(remarks) == 1 and re.search(line, remarks[0].line)


def test_bodies_that_are_held_together_or_never_meet_by_choice_overlap_as_they_like():
    bodies = [box("one", radius=0.05), box("two", at=(0.2, 0.0), radius=0.05)]
    held = [{"body": "one", "indices": [0], "to": "two"}]
    assert not list(start_remarks(assemble(scene_of(*bodies, attachments=held))))
    assert not list(start_remarks(assemble(scene_of(*bodies, contact={"enabled": False}))))


TURNED = {"rotation": 30.0, "position": [1.0, 2.0]}
INSIDE_2D = [
    ({"kind": "half_space", "point": [0.0, 0.3], "normal": [0.6, 0.8]}, [1.0, -1.0], 0.44),
    ({"kind": "sphere", "position": [1.0, 0.5], "radius": 0.6}, [1.3, 0.9], 0.1),
    ({"kind": "box", "size": [2.0, 1.0]} | TURNED, [1.0, 2.0], 0.5),
    ({"kind": "capsule", "from": [-1.0, 0.0], "to": [1.0, 0.0], "radius": 0.4} | TURNED, [1.0, 2.0], 0.4),
    ({"kind": "polygon", "points": [[-1, -1], [1, -1], [1, 1], [0, 0.25], [-1, 1]]} | TURNED, [1.0, 2.0], 0.25),
]


@pytest.mark.parametrize(("collider", "place", "depth"), INSIDE_2D)
def test_a_body_that_starts_inside_a_collider_is_named_with_its_depth(collider, place, depth):
    shape = {"kind": "custom", "points": [[0.0, 0.0], [1e-3, 0.0]], "springs": [[0, 1]]}
    body = {"name": "probe", "position": place, "shape": shape, "material": {"stiffness": 1.0}}
    remarks = list(start_remarks(assemble(scene_of(body, colliders=[{"name": "it", **collider}]))))
    assert [remark.kind for remark in remarks] == [WarningKind.STARTS_INSIDE]
    told = re.search(r"'probe' (\S+) m deep in collider 'it'", remarks[0].line)
    assert told and float(told[1]) == pytest.approx(depth, rel=0.03)
    for changed in ({"position": [60.0, 60.0]}, {"pin": {"indices": [0, 1]}}):
        remarks = start_remarks(assemble(scene_of(body | changed, colliders=[collider])))
        assert WarningKind.STARTS_INSIDE not in {remark.kind for remark in remarks}


@pytest.mark.parametrize(
    ("radius", "inside", "thick"),
    [("auto", False, False), (0.11, True, False), (0.24, True, True), (5.0, True, True)],
)
def test_a_radius_far_above_the_spacing_is_named(radius, inside, thick):
    """The box, its particles 0.1 m apart, lies on the floor: its lowest ones jump up by as much as the radius."""
    body = box(at=(0.0, 0.1), radius=radius)
    remarks = list(start_remarks(assemble(scene_of(body, colliders=[UP]))))
    told = {remark.kind: remark.line for remark in remarks}
    assert (WarningKind.STARTS_INSIDE in told, WarningKind.RADIUS in told, len(told)) == (inside, thick, inside + thick)
    if inside:
        assert f"'box' {radius:g} m deep, by its contact radius, in collider 'floor'" in told[WarningKind.STARTS_INSIDE]
    if thick:
        assert f"'box' {radius:g} m, {radius / 0.1:g} times" in told[WarningKind.RADIUS]
    high = assemble(scene_of(box(at=(0.0, 10.0), radius=radius), colliders=[UP]))
    assert WarningKind.STARTS_INSIDE not in {remark.kind for remark in start_remarks(high)}


def test_the_depth_in_a_mesh_collider_is_that_in_the_box_of_its_shape(tmp_path):
    trimesh.creation.box((1.0, 2.0, 0.5)).export(tmp_path / "box.stl")
    body = box("probe", at=(0.1, 0.3, 0.0), size=(0.1, 0.1, 0.1), cells=(1, 1, 1))
    solids = [
        {"kind": "mesh", "file": str(tmp_path / "box.stl"), "rotation": [0.0, 0.0, 40.0]},
        {"kind": "box", "position": [0.0, 0.0, 0.0], "size": [1.0, 2.0, 0.5], "rotation": [0.0, 0.0, 40.0]},
    ]
    told = []
    for collider in solids:
        lines = [r.line for r in start_remarks(assemble(scene_of(body, dimension=3, colliders=[collider])))]
        told.append(float(re.search(r"(\S+) m deep in colliders\[0\]", lines[0])[1]))
    assert told[1] == pytest.approx(0.2) and 0.6 * told[1] < told[0] <= 1.1 * told[1]


def test_a_particle_that_is_pressed_into_a_collider_is_told(simulate):
    """A plate comes down on a box and stops above the floor, or goes on to below it: nothing can give way then."""

    def pressed(lowest):
        plate = {"kind": "half_space", "name": "plate", "point": [0.0, 1.0], "normal": [0.0, -1.0]}
        plate["motion"] = [{"time": 0.0, "position": [0.0, 0.7]}, {"time": 0.3, "position": [0.0, lowest]}]
        simulation = simulate(scene_of(box(at=(0.0, 0.25), radius=0.05), colliders=[UP, plate]))
        simulation.advance(0.6)
        return simulation

    deep = pressed(-0.1)
    assert WarningKind.PENETRATED in kinds(deep)
    line = next(line for line in deep.warnings if "inside colliders" in line)
    assert re.search(r"'box' 0\.\d+ m deep in collider '(plate|floor)' at t = ", line)
    assert WarningKind.PENETRATED not in kinds(pressed(0.4))


# -- schemes -------------------------------------------------------------------------------------------------------


def chain(integrator, load, **solver):
    """A light chain that carries a load [kg]: what takes sweeps to tell from end to end."""
    count = 20
    shape = {
        "kind": "custom",
        "points": [[0.0, -0.1 * k] for k in range(count + 1)],
        "springs": [[k, k + 1] for k in range(count)],
        "masses": [0.002] * count + [load],
        "pinned": [0],
    }
    body = {"name": "chain", "shape": shape, "material": {"stiffness": 196200.0, "damping_ratio": 0.2}}
    solver = {"integrator": integrator, "precision": "f64", **solver}
    return make_scene(dimension=2, gravity=[0.0, -9.81], drag=2.0, solver=solver, bodies=[body])


@pytest.mark.parametrize(("load", "iterations", "solved"), [(20.0, 10, False), (0.002, 10, False), (0.002, 1000, True)])
def test_xpbd_says_where_it_has_not_converged(simulate, load, iterations, solved):
    """Each spring gives by what hangs on it over its stiffness; where it does not, a line says so."""
    simulation = simulate(chain("xpbd", load, dt=2e-3, iterations=iterations))
    simulation.advance(1.0)
    stretch = -float(simulation.positions()[-1, 1]) - 2.0
    right = sum(load + 0.002 * k for k in range(20)) * 9.81 / 196200.0
    assert (abs(stretch / right - 1.0) < 0.05) == solved
    assert kinds(simulation) == (set() if solved else {WarningKind.UNCONVERGED})
    if not solved:
        assert "xpbd has not converged" in simulation.warnings[0]


def test_the_midpoint_rule_says_which_steps_were_not_its_own(simulate):
    def swung(iterations):
        scene = oscillator("implicit_midpoint", 0.05)
        body = scene.bodies[0]
        shape = body.shape.model_copy(update={"velocities": ((0.0, 0.0), (0.0, 30.0))})
        solver = scene.solver.model_copy(update={"iterations": iterations})
        return simulate(
            scene.model_copy(update={"bodies": (body.model_copy(update={"shape": shape}),), "solver": solver})
        )

    simulation = swung(1)
    simulation.advance(0.5)
    assert WarningKind.REPLACED in kinds(simulation)
    assert re.search(r"took \d+ of 10 steps as implicit_euler", " ".join(simulation.warnings))
    simulation = swung(None)
    simulation.advance(0.5)
    assert simulation.warnings == []


# -- runs ----------------------------------------------------------------------------------------------------------


def test_a_run_prints_them_at_its_end_and_keeps_them_in_its_summary(run_cli, tmp_path):
    scene = tmp_path / "two.toml"
    scene.write_text(to_toml(meeting(1.0)))
    out = tmp_path / "run"
    code, printed, errors = run_cli("run", scene, "--renderer", "none", "--seconds", "0.5", "--out", out, "--json")
    summary = json.loads(printed)
    assert code == 0 and len(summary["warnings"]) == 1 and "'one' and 'two'" in summary["warnings"][0]
    assert errors == f"warning: {summary['warnings'][0]}\n"
    assert (summary["inverted_cells"], summary["most_inverted_cells"]) == (0, 0)
    header = (out / "metrics.csv").read_text().splitlines()[0]
    assert header.split(",")[-1] == "inverted_cells"


def test_validate_prints_what_is_known_without_simulating(run_cli, tmp_path):
    scene = tmp_path / "low.toml"
    late = {"kind": "poke", "time": 3.0, "point": [0.0, 0.0], "radius": 1.0, "impulse": [1.0, 0.0]}
    sunk = scene_of(box(at=(0.0, 0.02)), colliders=[UP], actions=[late], solver={"dt": 0.1})
    scene.write_text(to_toml(sunk))
    code, printed, errors = run_cli("validate", scene)
    lines = errors.strip().splitlines()
    assert code == 0 and ": ok, 12 particles" in printed and len(lines) == 3
    assert "above the stability limit" in lines[0] and "begins at 3 s, when the run is over (1 s)" in lines[2]
    assert lines[1] == "warning: bodies start inside colliders: 'box' 0.08 m deep in collider 'floor'"
    scene.write_text(to_toml(scene_of(box(at=(0.0, 0.12)), colliders=[UP])))
    assert run_cli("validate", scene)[2] == ""


SPRING = {"kind": "custom", "points": [[0.0, 0.0], [1.0, 0.0]], "springs": [[0, 1]]}
HEAVY = box("heavy", at=(0.0, 1.0), radius=0.05, material={"mass": 1e6})


@pytest.mark.parametrize(
    "scene",
    [
        scene_of(box(radius=3.0), colliders=[UP]),
        scene_of(box(material={"damping_ratio": 0.0}), solver={"integrator": "heun"}, duration=1e6),
        scene_of(box(), gravity=[0.0, -9.8], wind={"velocity": [1.0, 0.0], "start": 2.0}),
        scene_of(box(radius=0.05), HEAVY, gravity=[0.0, -9.8], solver={"dt": 1e-2}),
        scene_of(box(velocity=[11.0, 0.0]), diagnostics={"max_speed": 10.0}),
        scene_of({"name": "b", "shape": SPRING | {"rest_lengths": [0.01]}, "material": {"stiffness": 1.0}}),
        scene_of({"name": "b", "shape": SPRING, "position": [1e9, 0.0], "material": {"stiffness": 1.0}}, solver={}),
        scene_of({"name": "b", "shape": SPRING | {"masses": [1e-9, 1e-9]}, "material": {"stiffness": 1e15}}, solver={}),
    ],
)
def test_validate_says_what_a_run_says_before_its_first_step(run_cli, tmp_path, simulate, scene):
    (tmp_path / "scene.toml").write_text(to_toml(scene))
    code, _, errors = run_cli("validate", tmp_path / "scene.toml")
    try:
        lines = [f"warning: {line}" for line in simulate(scene).warnings]
    except SceneError as error:
        assert code == 2 and str(error) in errors and errors.count("\n") == 1
    else:
        assert code == 0 and errors.splitlines() == lines and lines
