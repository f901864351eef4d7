"""What waits to be done: of each kind the newest, and a signal is heeded whatever is on its way."""

import os
import signal
import threading
import time

import pytest

from sandbox.serve import commands as ask
from sandbox.serve import ending as endings
from sandbox.serve.ending import ended_by_signals
from sandbox.serve.limits import STEPS
from sandbox.serve.waiting import Waiting

HERE = (0.0, 0.0, 0.0)


def waiting(*commands):
    one = Waiting()
    for command in commands:
        one.put(command)
    return one


def taken(one):
    return list(iter(one.take, None))


def test_clicks_on_step_are_counted_and_all_else_is_replaced_by_the_newest():
    flood = [ask.StepPicture(), ask.Reset(), ask.SetSpeed(0.5), ask.SetPause(True)] * 5000
    assert len(waiting(*flood)) == STEPS + 3
    assert taken(waiting(ask.SetStiffness("a", 1.0), ask.SetStiffness("b", 1.0), ask.SetStiffness("a", 2.0))) == [
        ask.SetStiffness("b", 1.0),
        ask.SetStiffness("a", 2.0),
    ]
    assert taken(waiting(ask.SetSolver(dt="1"), ask.SetSolver(integrator="rk4"), ask.SetSolver(dt="2"))) == [
        ask.SetSolver(integrator="rk4"),
        ask.SetSolver(dt="2"),
    ]


def test_what_is_asked_for_keeps_its_order():
    clicks = [ask.SetPause(True), ask.StepPicture(), ask.StepPicture(), ask.SetSpeed(0.1)]
    assert taken(waiting(*clicks)) == clicks
    again = [ask.Grab(1, HERE), ask.Drag(1, HERE), ask.Release(1), ask.Grab(1, HERE), ask.Drag(1, HERE)]
    assert taken(waiting(*again)) == [ask.Release(1), ask.Grab(1, HERE), ask.Drag(1, HERE)]


def test_who_vanishes_lets_go_of_what_it_held_and_leaves_nothing_else():
    one = waiting(ask.Grab(1, HERE), ask.Grab(2, HERE))
    assert taken(one) == [ask.Grab(1, HERE), ask.Grab(2, HERE)]
    one.put(ask.Drag(1, HERE))
    one.put(ask.SendRecording(1))
    one.put(ask.Drag(2, HERE))
    one.vanish(1)
    assert taken(one) == [ask.Drag(2, HERE), ask.Release(1)]
    for client in range(3, 10_000):
        one.put(ask.Grab(client, HERE))
        one.put(ask.SendRecording(client))
        one.vanish(client)
    assert len(one) == 0


def test_it_never_grows_long_but_hands_open():
    many = waiting(*(ask.Drag(client, HERE) for client in range(5000)))
    assert len(many) == 1000
    many.put(ask.Release(1))
    assert taken(many)[-1] == ask.Release(1)


needs_timer = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer that signals")


@needs_timer
def test_a_signal_ends_what_takes_long(monkeypatch):
    monkeypatch.setattr(endings, "_GRACE", 0.2)
    before = signal.getsignal(signal.SIGTERM)
    start = time.perf_counter()
    with ended_by_signals() as ending:
        with ending.in_time():
            os.kill(os.getpid(), signal.SIGTERM)
            while time.perf_counter() - start < 10.0:
                pass
        assert ending.was_broken_off and ending.stop.is_set()
        time.sleep(0.5)  # Nothing more comes.
    assert 0.2 <= time.perf_counter() - start < 5.0
    assert signal.getsignal(signal.SIGTERM) is before


@needs_timer
def test_what_ends_in_time_is_not_broken_off_and_a_second_signal_interrupts():
    with ended_by_signals() as ending:
        with ending.in_time():
            os.kill(os.getpid(), signal.SIGINT)
            assert ending.stop.wait(5.0)
        assert not ending.was_broken_off
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1.0)


def test_a_signal_ends_the_process_where_it_would_not_be_heard_and_all_is_put_away_before():
    prepared = []
    with ended_by_signals() as ending:
        with ending.deaf(lambda: prepared.append(1)):
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
        assert signal.getsignal(signal.SIGTERM) == ending._heard
        ending.stop.set()
        with ending.deaf(lambda: prepared.append(2)):
            assert signal.getsignal(signal.SIGTERM) == ending._heard
    assert prepared == [1]


def test_elsewhere_than_in_the_main_thread_there_are_no_signals():
    found = []

    def run():
        with ended_by_signals() as ending, ending.in_time(), ending.deaf(lambda: found.append("prepared")):
            found.append(ending.stop.is_set())

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert found == [False]
