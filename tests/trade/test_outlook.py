"""When things happen in a scene, and what studies say of what they did not see."""

import math

import pytest

from sandbox.scene.assemble import assemble
from sandbox.trade.crew import open_crew
from sandbox.trade.measure import Options, Study
from sandbox.trade.outlook import Event, Outlook, meetings
from sandbox.trade.store import Store
from tests.conftest import make_scene

FLOOR = {"kind": "half_space", "name": "floor", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
FRAME = 1.0 / 30.0


def point(name, position, velocity=(0.0, 0.0), **more):
    shape = {"kind": "custom", "points": [[0.0, 0.0]], "masses": [0.7]}
    return {"name": name, "shape": shape, "position": position, "velocity": velocity, **more}


def outlook_of(simulate, scene):
    simulation = simulate(scene)
    found = meetings(simulation, round(scene.duration / FRAME), lambda: False)
    return Outlook.planned(simulation.assembly).with_meetings(*found)


def test_meetings_with_colliders_come_when_free_fall_says(simulate):
    """sqrt(2 h / g), whether it falls for long or bounces off between two pictures; what slides meets the wall too."""
    heights = {"low": 0.13, "middle": 1.1, "high": 5.3}
    wall = {"kind": "box", "name": "wall", "position": [4.0, 0.0], "size": [1.0, 1.0]}
    bodies = [point(name, [-float(k), height]) for k, (name, height) in enumerate(heights.items())]
    bodies += [
        point("thrown", [0.5, 0.3], [25.0, 0.0], material={"restitution": 1.0}),
        point("sliding", [0.4, 0.0], [1.7, 0.0]),
        point("rising", [-4.0, 2.0], [0.0, 30.0]),
    ]
    scene = make_scene(dimension=2, gravity=[0.0, -9.81], duration=3.0, bodies=bodies, colliders=[FLOOR, wall])
    outlook = outlook_of(simulate, scene)
    times = {event.what: event.time for event in outlook.events}
    expected = {f"{name} meets floor": math.sqrt(2.0 * height / 9.81) for name, height in heights.items()}
    expected |= {"thrown meets wall": 3.0 / 25.0, "sliding meets wall": 3.1 / 1.7}
    assert set(expected) < set(times) and not any(what.startswith("rising") for what in times)
    for what, time in expected.items():
        assert times[what] == pytest.approx(time, abs=0.5 * FRAME), what
    assert outlook.until == pytest.approx(3.0)
    assert outlook.wanted(1.0) == pytest.approx(1.25 * times["sliding meets wall"] + 0.25)


def test_meetings_of_bodies_and_with_what_moves(simulate):
    """Gap over closing speed; a collider that is led begins to move, and then meets what waits for it."""
    bodies = [
        point("left", [-2.0, 0.0], [0.6, 0.0], radius=0.1),
        point("right", [0.0, 0.0], [-0.9, 0.0], radius=0.1),
        point("waiting", [0.0, 3.0], radius=0.1),
        point("lonely", [50.0, 0.0], radius=0.1),
    ]
    motion = [{"time": 0.0}, {"time": 0.5}, {"time": 1.5, "position": [0.0, 3.0]}]  # 1.7 m of 2 until they touch
    piston = {"kind": "sphere", "name": "piston", "position": [0.0, 5.0], "radius": 0.2, "motion": motion}
    piston["interpolation"] = "linear"
    scene = make_scene(dimension=2, duration=2.3, bodies=bodies, colliders=[piston])
    times = {event.what: event.time for event in outlook_of(simulate, scene).events}
    assert times == {
        "left meets right": pytest.approx(1.8 / 1.5, abs=0.5 * FRAME),
        "piston begins to move": 0.5,
        "waiting meets piston": pytest.approx(0.5 + 1.7 / 2.0, abs=0.5 * FRAME),
    }


def test_what_the_scene_says_needs_no_run():
    rope = {
        "name": "rope",
        "shape": {"kind": "rope", "start": [0.0, 0.0], "end": [1.0, 0.0], "segments": 5},
        "material": {"stiffness": 500.0, "mass": 1.0},
        "pin": {"indices": [0]},
    }
    actions = [
        {"kind": "push", "body": "rope", "start": 2.0, "end": 2.4, "force": [0.0, 1.0]},
        {"kind": "poke", "time": 0.7, "point": [1.0, 0.0], "radius": 0.5, "impulse": [0.0, 1.0]},
        {"kind": "solver", "time": 1.0, "integrator": "rk4"},
        {"kind": "unpin", "body": "rope", "time": 30.0},
    ]
    wind = {"velocity": [1.0, 0.0], "start": 1.1}
    outlook = Outlook.planned(
        assemble(make_scene(dimension=2, duration=4.0, bodies=[rope], actions=actions, wind=wind))
    )
    assert outlook.events == (
        Event(0.7, "actions[1] (poke)"),
        Event(1.1, "wind begins to blow"),
        Event(2.0, "actions[0] (push)"),
    )
    assert outlook.until == 4.0  # nothing can meet
    assert outlook.wanted(1.0) == 1.25 * 2.0 + 0.25
    still = Outlook.planned(assemble(make_scene(dimension=2, duration=4.0, bodies=[rope])))
    assert still == Outlook((), 4.0, 4.0) and still.wanted(1.0) == 1.0 and still.unseen(1.0, 1.0, FRAME) == []


def test_what_was_not_seen_is_said():
    events = tuple(Event(time, f"body meets {time:g}") for time in (0.3, 1.4, 2.0, 2.1, 2.2))
    outlook = Outlook(events, 3.0, 3.0)
    (line,) = outlook.unseen(1.0, 1.0, FRAME)
    assert line == (
        "only the first 1 s were looked at (--horizon 3 sees more): not seen: "
        "body meets 1.4 at 1.4 s, body meets 2 at 2 s, body meets 2.1 at 2.1 s, 1 more"
    )
    (line,) = outlook.unseen(3.0, 0.29, FRAME)
    assert line.startswith("no error is known of what comes after 0.29 s") and "body meets 0.3" in line
    assert outlook.unseen(3.0, 3.0, FRAME) == []
    assert outlook.unseen(2.8, 2.8, FRAME) == []
    (line,) = Outlook((), 0.8, 600.0).unseen(1.0, 1.0, FRAME)
    assert line.startswith("what bodies meet after 1 s is not known: the scene lasts 600 s")


@pytest.mark.slow
def test_studies_look_for_as_long_as_it_takes_to_see_the_first_meeting(tmp_path):
    """A fall of 5.3 m takes 1.04 s; a horizon that was asked for stays, and says what it does not hold."""
    scene = make_scene(
        dimension=2, gravity=[0.0, -9.81], duration=3.0, bodies=[point("drop", [0.0, 5.3])], colliders=[FLOOR]
    )
    meets = math.sqrt(2.0 * 5.3 / 9.81)
    with open_crew(1) as slots:
        for horizon, expected in ((None, 1.25 * meets + 0.25), (0.5, 0.5)):
            study = Study(scene, Options(horizon=horizon, workers=1), Store(tmp_path))
            study.look_ahead(slots)
            assert study.horizon == pytest.approx(expected, abs=1.01 * FRAME)
            assert study.samples[-1] == study.frames
            unseen = study.outlook.unseen(study.horizon, study.horizon, study.frame)
            assert bool(unseen) == (horizon is not None)
    assert "drop meets floor at 1.04 s" in unseen[0]
