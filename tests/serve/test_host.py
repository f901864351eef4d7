"""A served scene that is watched and touched, over real connections but without a browser."""

import threading
import time

import numpy as np
import pytest

pytest.importorskip("viser", reason="needs the extra web")

from sandbox.serve import commands as ask
from sandbox.serve.access import Access
from sandbox.serve.host import Host
from sandbox.serve.listener import open_port, serving
from sandbox.session import Session
from tests.conftest import make_scene
from tests.serve.viewer import Viewer

CUBE = "/bodies/0 cube"


@pytest.fixture(scope="module")
def served():
    """A cube of jelly on the ground, served; and its port."""
    cube = {
        "name": "cube",
        "position": [0.0, 0.25, 0.0],
        "shape": {"kind": "box", "size": [0.5, 0.5, 0.5], "cells": [4, 4, 4]},
        "material": {"youngs_modulus": 4e5, "damping_ratio": 0.2, "density": 1000.0},
    }
    ground = {"kind": "half_space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "friction": 0.8}
    scene = make_scene(dimension=3, gravity=[0.0, -9.81, 0.0], bodies=[cube], colliders=[ground])
    listening = open_port("127.0.0.1", 0)
    port = listening.getsockname()[1]
    with serving(listening, Access.of("127.0.0.1")) as server:
        host = Host(Session(scene), server, pictures=30.0)
        host.warm_up()
        yield host, port


@pytest.fixture
def host(served):
    served[0].commands.put(ask.Reset())
    served[0].picture()
    return served[0]


@pytest.fixture
def view(served):
    """Open a viewer that has seen the scene as it is."""
    opened = []

    def one(**options):
        opened.append(Viewer(served[1], **options))
        wait_for(served[0], lambda: len(served[0]._server.get_clients()) >= len(opened))
        return opened[-1]

    yield one
    for viewer in opened:
        viewer.vanish()
    wait_for(served[0], lambda: not served[0]._server.get_clients())


def wait_for(host, condition, seconds=5.0):
    """Let the scene go on until something is so."""
    end = time.perf_counter() + seconds
    while not condition():
        assert time.perf_counter() < end, "it never came to be so"
        host.picture()
        time.sleep(0.01)


def go_on(host, seconds):
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        host.picture()
        time.sleep(min(host.pace.wait(), 0.03))


def top(host):
    """Height of the cube's highest point [m]."""
    return host.session.simulation.positions()[:, 1].max()


def test_time_stands_still_until_somebody_looks(host, view):
    go_on(host, 0.1)
    assert host.session.ticks == 0
    viewer = view()
    go_on(host, 0.3)
    assert host.session.ticks > 0
    viewer.look_around()
    positions = host.session.simulation.positions()
    assert np.unique(np.round(viewer.vertices[CUBE], 4), axis=0).shape == (98, 3)
    assert viewer.vertices[CUBE].max(axis=0) == pytest.approx(positions.max(axis=0), abs=1e-6)


def test_a_body_is_dragged_and_let_go(host, view):
    viewer = view()
    grabbed = (0.25, 0.5, 0.25)
    viewer.drag("start", CUBE, grabbed, grabbed)
    wait_for(host, lambda: host.grips)
    viewer.drag("update", CUBE, grabbed, (0.25, 1.5, 0.25))
    wait_for(host, lambda: top(host) > 0.8)
    viewer.drag("end", CUBE, grabbed, (0.25, 1.5, 0.25))
    wait_for(host, lambda: not host.grips)
    viewer.look_around()
    assert viewer.vertices[CUBE][:, 1].max() > 0.7
    actions = host.session.recording().actions
    assert [action.kind for action in actions] == ["grab"] and actions[0].end < host.session.simulation.time + 1.0


def test_two_viewers_see_the_same_and_drag_each_with_a_hand_of_its_own(host, view):
    one, other = view(), view()
    left, right = (-0.25, 0.5, 0.25), (0.25, 0.5, 0.25)
    one.drag("start", CUBE, left, left)
    other.drag("start", CUBE, right, right)
    wait_for(host, lambda: len(host.grips) == 2)
    one.drag("update", CUBE, left, (-0.6, 0.6, 0.25))
    other.drag("update", CUBE, right, (0.6, 0.6, 0.25))
    wait_for(host, lambda: np.ptp(host.session.simulation.positions()[:, 0]) > 0.6)
    host.commands.put(ask.SetPause(True))
    go_on(host, 0.1)
    one.look_around(), other.look_around()
    assert np.array_equal(one.vertices[CUBE], other.vertices[CUBE])


def test_a_viewer_that_vanishes_while_it_drags_leaves_nothing_behind(host, view):
    one, other = view(), view()
    nodes = set(host._server.scene._handle_from_node_name)
    for viewer, x in ((one, -0.25), (other, 0.25)):
        viewer.drag("start", CUBE, (x, 0.5, 0.25), (x, 0.5, 0.25))
    wait_for(host, lambda: len(host.grips) == 2)
    free = host.session._acting.free_hands
    one.vanish()
    wait_for(host, lambda: len(host._server.get_clients()) == 1)
    wait_for(host, lambda: len(host.grips) == 1)
    other.drag("update", CUBE, (0.25, 0.5, 0.25), (0.25, 1.2, 0.25))
    wait_for(host, lambda: top(host) > 0.6)
    assert host.session._acting.free_hands == free + 1
    assert set(host._server.scene._handle_from_node_name) == nodes
    assert not any(client != next(iter(host.grips)) for client, _ in host._server.scene._active_drag_handles)
    assert len(host._server._websock_server._client_state_from_id) == 1
    ends = sorted(action.end for action in host.session.recording().actions)
    assert ends[0] < ends[1]


@pytest.mark.filterwarnings("ignore:.*does not match annotation")
def test_what_no_browser_would_send_changes_nothing(host, view):
    # Who sends nonsense may be thrown out; the other goes on looking.
    viewer, _ = view(), view()
    for bad in ((float("nan"), 0.0, 0.0), (1e300, 0.0, 0.0), (0.0,), ("a", "b", "c"), "abc", 1):
        viewer.drag("start", CUBE, bad, bad)
        viewer.drag("update", CUBE, bad, bad)
    for command in (
        ask.SetSolver(dt="1e-9"),
        ask.SetSolver(dt="nan"),
        ask.SetSolver(dt=""),
        ask.SetSolver(integrator="no_such"),
        ask.SetStiffness("cube", float("nan")),
        ask.SetStiffness("no such body", 2.0),
        ask.Release(17),
        ask.Drag(17, (0.0, 0.0, 0.0)),
        ask.SendRecording(17),
    ):
        host.commands.put(command)
    go_on(host, 0.2)
    assert not host.grips and not host.session.recording().actions
    assert host.session.ticks > 0


def test_a_far_pointer_pulls_no_further_than_the_scene_is_wide(host, view):
    viewer = view()
    grabbed = (0.25, 0.5, 0.25)
    viewer.drag("start", CUBE, grabbed, (1e8, 1e8, 1e8))
    wait_for(host, lambda: host.grips)
    ((grip, _, _),) = host.grips.values()
    assert np.abs(grip.target).max() < 50.0


def test_pause_step_slow_motion_and_reset(host, view):
    view()
    wait_for(host, lambda: host.session.ticks > 10)
    host.commands.put(ask.SetPause(True))
    host.picture()
    before = host.session.ticks
    go_on(host, 0.1)
    assert host.session.ticks == before
    host.commands.put(ask.StepPicture())
    host.picture()
    assert host.session.ticks == before + 4
    host.commands.put(ask.Reset())
    host.commands.put(ask.SetPause(True))
    host.picture()
    assert host.session.ticks == 0
    host.commands.put(ask.SetSpeed(0.1))
    host.commands.put(ask.SetPause(False))
    go_on(host, 0.5)
    host.commands.put(ask.SetSpeed(1.0))
    assert 0 < host.session.simulation.time < 0.1


def test_material_and_solver_are_changed_while_it_runs(host, view):
    viewer = view()
    host.commands.put(ask.SetStiffness("cube", 2.0))
    host.commands.put(ask.SetSolver(integrator="velocity_verlet"))
    host.commands.put(ask.SetSolver(dt="0.0005"))
    wait_for(host, lambda: host.session.simulation.dt <= 0.0005, seconds=30.0)
    assert str(host.session.simulation.scene.solver.integrator) == "velocity_verlet"
    assert [action.kind for action in host.session.recording().actions] == ["stiffen", "solver", "solver"]
    go_on(host, 0.3)
    viewer.look_around()
    assert viewer.reads("largest strain")


def test_a_blow_up_stops_time_and_is_said_and_reset_helps(host, view):
    viewer = view()
    host.commands.put(ask.SetSolver(dt="0.05"))
    wait_for(host, lambda: host.pace.paused, seconds=60.0)
    viewer.look_around()
    assert viewer.reads("diverged at t =") and viewer.reads("Reset")
    host.commands.put(ask.Reset())
    # The solver of the scene is compiled again.
    wait_for(host, lambda: not host.pace.paused and host.session.ticks > 5, seconds=60.0)
    viewer.look_around()
    assert not viewer.reads("diverged at t =")


def test_a_viewer_that_does_not_look_slows_nobody_and_is_not_sent_old_pictures(host, view):
    slow, quick = view(), view()
    go_on(host, 0.2)
    buffer = host._server._websock_server.get_message_buffer()
    held = len(buffer.message_from_id)
    # Wiggle, so that every picture is another one.
    quick.drag("start", CUBE, (0.25, 0.5, 0.25), (0.25, 0.5, 0.25))
    before, ticks, seen = host.pictures, host.session.ticks, quick.updates
    done = threading.Event()
    watching = threading.Thread(target=lambda: [quick.look(0.05) for _ in iter(done.is_set, True)])
    watching.start()
    for turn in range(20):
        quick.drag("update", CUBE, (0.25, 0.5, 0.25), (0.25 + 0.2 * (turn % 2), 0.8, 0.25))
        go_on(host, 0.1)
    quick.drag("end", CUBE, (0.25, 0.5, 0.25), (0.25, 0.8, 0.25))
    sent = host.pictures - before
    assert host.session.ticks - ticks > 2 * sent
    host.commands.put(ask.SetPause(True))
    go_on(host, 0.2)
    # What waits for the slow one is the newest of everything, not a row of old pictures.
    assert len(buffer.message_from_id) <= held + 5
    done.set()
    watching.join()
    slow.look_around(), quick.look_around()
    assert np.array_equal(slow.vertices[CUBE], quick.vertices[CUBE])
    assert quick.updates - seen > 0.7 * sent


BARE = {
    "rope": {"kind": "rope", "from": [0, 1, 0], "to": [1, 1, 0], "segments": 9},
    "point": {"kind": "custom", "points": [[0, 1, 0]], "masses": [1]},
    "ring": {"kind": "ring", "radius": 0.4, "segments": 13},
    "late": {"kind": "ball", "radius": 0.4, "cells": 3},
}
"""All that a scene has: some have no surface, some lie in the plane, one enters later."""


@pytest.mark.parametrize("name", BARE)
def test_any_scene_is_served(name):
    dimension = 3 if name in ("rope", "point") else 2
    body = {"name": name, "shape": BARE[name], "position": [0, 1, 0][:dimension]}
    if name != "point":
        body["material"] = {"stiffness": 1e3, "mass": 0.1}
    ground = {"kind": "half_space", "point": [0, 0, 0][:dimension], "normal": [0, 1, 0][:dimension]}
    enters = [{"kind": "spawn", "time": 0.5, "body": "late"}] if name == "late" else []
    listening = open_port("127.0.0.1", 0)
    with serving(listening, Access.of("127.0.0.1")) as server:
        scene = make_scene(dimension=dimension, bodies=[body], colliders=[ground], actions=enters)
        host = Host(Session(scene), server, pictures=30.0)
        host.warm_up()
        viewer = Viewer(listening.getsockname()[1])
        wait_for(host, lambda: host.session.ticks > 2 and host.pictures > 2, seconds=20.0)
        viewer.vanish()
        host.session.simulation.suspend()
