"""What connections may cost, with limits that are reached soon."""

import contextlib
import socket
import time

import pytest

pytest.importorskip("viser", reason="needs the extra web")

import numpy as np
from websockets.exceptions import InvalidStatus

from sandbox.serve import limits
from sandbox.serve.access import Access
from sandbox.serve.door import Door
from sandbox.serve.listener import behind, open_port
from tests.serve.target import Target, camera, frame, pack
from tests.serve.viewer import Viewer


@pytest.fixture
def served(monkeypatch):
    """A door, what it leads to, and a target."""
    for name, seconds in {
        "REQUEST_TIME": 0.5,
        "PAGE_TIME": 5.0,
        "PATIENCE": 1.0,
        "PING": 60.0,
        "NEWCOMER": 0.5,
    }.items():
        monkeypatch.setattr(limits, name, seconds)
    door, listening = Door(clients=3), open_port("127.0.0.1", 0)
    with behind(door, listening, Access.of("127.0.0.1")) as server:
        yield door, server, Target(listening.getsockname()[1], {})


def wait_for(condition, seconds=5.0):
    end = time.perf_counter() + seconds
    while not condition():
        assert time.perf_counter() < end, "it never came to be so"
        time.sleep(0.02)


def test_a_request_that_is_not_whole_in_time_ends(served):
    door, _, target = served
    start = time.perf_counter()
    assert target.raw(b"GET / HTTP/1.1\r\nHost: ", wait=5.0) == b""
    assert 0.4 < time.perf_counter() - start < 3.0
    assert door.cut == 1 and not door.connections


def test_the_oldest_that_ask_for_nothing_make_room(served):
    door, _, target = served
    links = [socket.create_connection(("127.0.0.1", target.port)) for _ in range(limits.OPENING + 5)]
    wait_for(lambda: door.cut >= 5)
    assert len(door.connections) <= limits.OPENING
    assert b"200 OK" in target.raw(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", wait=2.0)
    for link in links:
        link.close()


def test_more_browsers_than_may_are_told_so_and_silent_ones_make_room(served):
    door, _, target = served
    viewers = [Viewer(target.port) for _ in range(3)]
    wait_for(lambda: sum(one.is_heard for one in door.connections) == 3)
    time.sleep(0.6)
    with pytest.raises(InvalidStatus) as refused:
        Viewer(target.port)
    assert refused.value.response.status_code == 503
    viewers.pop().close()
    wait_for(lambda: len(door.connections) == 2)
    silent = target.open()
    time.sleep(0.6)
    viewers.append(Viewer(target.port))
    silent.settimeout(5.0)
    with contextlib.suppress(ConnectionResetError):
        while silent.recv(1 << 16):
            pass
    for viewer in viewers:
        viewer.close()


def test_who_takes_nothing_is_cut_off_and_who_takes_little_is_not(served):
    door, server, target = served
    points = np.random.default_rng(0).random((100_000, 3))
    mesh = server.scene.add_mesh_simple("/mesh", points, np.array([[0, 1, 2]]))
    links = []
    for _ in range(2):
        links.append(socket.socket())
        links[-1].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 12)
        links[-1].connect(("127.0.0.1", target.port))
        links[-1].sendall(target.handshake() + frame(2, pack(camera())))
    taker, end = links[0], time.perf_counter() + 4.0
    while time.perf_counter() < end:
        mesh.vertices = points + time.perf_counter()
        for _ in range(20):
            assert taker.recv(1 << 12), "it was cut off"
        time.sleep(0.02)
    (left,) = door.connections
    assert left.is_heard and left.unsent > 0 and door.cut == 1
    # One picture waits for it, and not all of them.
    assert left.unsent < 3 * points.size * 4
    for link in links:
        link.close()


def test_messages_beyond_the_rate_are_dropped_and_far_beyond_it_the_connection_is_cut(served):
    door, _, target = served
    with target.viewer() as viewer:
        for _ in range(limits.MESSAGES + 500):
            viewer.connection.send(pack(camera()))
        wait_for(lambda: door.refused >= 300)
        assert door.cut == 0
        with contextlib.suppress(Exception):
            viewer.connection.socket.sendall(frame(2, pack(camera())) * 2 * limits.FRAMES)
        wait_for(lambda: door.cut == 1)
    assert "messages and 1 connections" in door.remarks()[0]


def test_nothing_to_remark_where_nothing_was_refused(served):
    door, _, target = served
    viewer = Viewer(target.port)
    viewer.look_around(0.1)
    viewer.close()
    assert door.remarks() == []


def test_what_fails_while_it_serves_is_counted_by_its_kind(served):
    door, server, _ = served
    loop = server._event_loop
    loop.call_soon_threadsafe(lambda: 1 / 0)
    wait_for(lambda: door.failures)
    assert door.remarks() == ["serving failed in parts (ZeroDivisionError 1)"]
