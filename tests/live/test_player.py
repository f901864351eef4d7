"""What mouse, keys and buttons do to a session, without a window."""

import tomllib

import numpy as np
import pytest
import taichi as ti

from sandbox import Simulation
from sandbox.errors import DivergedError
from sandbox.live.pace import Pace
from sandbox.live.picker import cursor_of
from sandbox.live.player import BUTTONS, KEYS, Player
from sandbox.live.readout import CONTROLS, READINGS, panels
from sandbox.live.views import view_of
from sandbox.recording import read, with_actions
from sandbox.render.ggui.messages import Button, Input, KeyEvent, Text
from sandbox.render.ggui.renderer import framed
from sandbox.scene.load import load_scene
from sandbox.session import Session

SIZE = (640, 400)


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def player(jelly_file):
    session = Session(load_scene(jelly_file))
    appearance = session.simulation.assembly.appearance
    camera = framed(appearance, session.simulation.scene.render.camera, SIZE)
    clock = Clock()
    made = Player(
        session, view_of(camera, appearance.bounds), Pace(session.tick, now=clock), clock, covered=(READINGS, CONTROLS)
    )
    made.clock = clock
    yield made
    session.simulation.close()


def press(key, cursor=(0.5, 0.5), held=()):
    return Input(cursor=cursor, held=frozenset(held), events=(KeyEvent(key, True),), size=SIZE)


def on_body(player):
    """Cursor over the middle of the body."""
    return cursor_of(player.view.camera, player.session.simulation.positions().mean(axis=0))


def test_a_drag_leads_the_body_and_is_recorded(player, tmp_path):
    cursor = on_body(player)
    player.obey(press("LMB", cursor, {"LMB"}))
    assert player.grip is not None and player.grip.body == "jelly"
    start = player.grip.point
    # Pictures with no tick, with several, and with the hand at rest between them.
    for ticks, moves in ((1, 1), (0, 1), (4, 0), (3, 1), (4, 0), (4, 0), (2, 1), (30, 0)):
        cursor = (cursor[0], cursor[1] + 0.05 * moves)
        player.obey(Input(cursor=cursor, held=frozenset({"LMB"}), size=SIZE))
        if ticks:
            player.advance(ticks)
    assert player.grip.point[1] > start[1] + 0.1
    assert cursor_of(player.view.camera, player.grip.target) == pytest.approx(
        (cursor_of(player.view.camera, start)[0], cursor_of(player.view.camera, start)[1] + 0.20), abs=1e-6
    )
    player.obey(Input(cursor=cursor, events=(KeyEvent("LMB", False),), size=SIZE))
    assert player.grip is None
    player.advance(10)
    player.session.write_recording(tmp_path / "actions.toml")
    again = Simulation(with_actions(player.session.simulation.scene.model_copy(update={"actions": ()}),
                                    read(tmp_path / "actions.toml"), "test"))  # fmt: skip
    for tick in range(1, player.session.ticks + 1):
        again.advance_to(tick * player.session.tick)
    assert np.array_equal(again.positions(), player.session.simulation.positions())


def test_what_is_clicked_on_a_panel_or_beside_bodies_grabs_nothing(player):
    player.obey(press("LMB", (0.1, 0.9), {"LMB"}))
    assert player.grip is None
    player.obey(press("LMB", (0.75, 0.05), {"LMB"}))
    assert player.grip is None and player.message == ""


def test_a_button_that_came_up_outside_of_the_window_lets_go(player):
    player.obey(press("LMB", on_body(player), {"LMB"}))
    assert player.grip is not None
    player.obey(Input(cursor=(0.5, 0.5), size=SIZE))
    assert player.grip is None


def test_the_right_button_turns_and_the_middle_one_shifts(player):
    first = player.view.camera
    player.obey(press("RMB", (0.5, 0.5), {"RMB"}))
    assert np.array_equal(player.view.camera.eye, first.eye), "a click alone turns nothing"
    player.obey(Input(cursor=(0.6, 0.5), held=frozenset({"RMB"}), size=SIZE))
    turned = player.view.camera
    assert not np.allclose(turned.forward, first.forward)
    player.obey(Input(cursor=(0.9, 0.5), size=SIZE))
    assert np.array_equal(player.view.camera.eye, turned.eye), "nothing turns without a button"
    player.obey(press("MMB", (0.5, 0.5), {"MMB"}))
    player.obey(Input(cursor=(0.6, 0.5), held=frozenset({"MMB"}), size=SIZE))
    assert np.allclose(player.view.camera.forward, turned.forward)
    assert not np.allclose(player.view.camera.eye, turned.eye)
    player.obey(press("c"))
    assert np.allclose(player.view.camera.eye, first.eye)


def test_time_goes_on_stops_and_goes_step_by_step(player):
    session = player.session
    for _ in range(4):
        player.clock.now += 1.0 / 60.0
        player.go_on()
    assert session.ticks == pytest.approx(8, abs=2)
    player.obey(press(" "))
    before = session.ticks
    player.clock.now += 1.0
    assert player.go_on() == 0
    player.obey(press("n"))
    assert session.ticks == before + 4 and player.pace.paused
    player.obey(press("r"))
    assert session.ticks == 0 and not player.pace.paused
    player.obey(press("z"))
    assert player.pace.speed == 0.5
    player.obey(press("x"))
    player.obey(press("x"))
    assert player.pace.speed == 1.0


def test_poking_pushes_the_body_away_from_the_eye(player):
    player.obey(press("f", on_body(player)))
    player.advance(1)
    speed = player.session.simulation.velocities().mean(axis=0)
    assert speed @ player.view.camera.forward > 0.2
    player.obey(press("f", (0.75, 0.05)))
    assert len(player.session.recording().actions) == 1


def test_the_solver_is_changed_and_recorded(player):
    simulation = player.session.simulation
    dt = simulation.dt
    player.obey(press("j"))
    player.advance(1)
    assert player.session.simulation.dt < dt
    player.obey(Input(clicked=frozenset({"integrator [i]"}), size=SIZE))
    player.advance(1)
    assert player.session.simulation.scene.solver.integrator == "velocity_verlet"
    assert [action.kind for action in player.session.recording().actions] == ["solver", "solver"]
    assert player.message == ""


def test_a_blow_up_stops_time_says_why_and_reset_helps(player, monkeypatch):
    def diverge(ticks=1):
        raise DivergedError("diverged at t = 0.1 s: spring 3 of jelly", time=0.1, stable_dt=1e-3)

    with monkeypatch.context() as patched:
        patched.setattr(player.session, "advance", diverge)
        player.clock.now += 0.1
        player.go_on()
    assert player.pace.paused
    readings, _ = panels(player)
    assert "spring 3 of jelly" in " ".join(w.text for w in readings.widgets if isinstance(w, Text))
    player.obey(press("r"))
    assert player.message == "" and not player.pace.paused
    player.advance(2)
    assert player.session.ticks == 2


def test_a_slow_simulation_is_said_to_be_one(player):
    player.pace.took(1, 10.0 * player.session.tick)
    for _ in range(30):
        player.clock.now += 1.0 / 60.0
        ticks = player.pace.due()
        player.pace.took(ticks, ticks * 10.0 * player.session.tick)
        player.clock.now += ticks * 10.0 * player.session.tick
    readings, _ = panels(player)
    text = " ".join(w.text for w in readings.widgets if isinstance(w, Text))
    assert "0.08x real time" in text and "behind the clock by" in text
    assert "real time needs steps of" in text and "sandbox tune" in text


def test_every_button_of_the_panel_does_something(player):
    _, controls = panels(player)
    labels = [widget.label for widget in controls.widgets if isinstance(widget, Button)]
    assert labels == list(BUTTONS)
    # Buttons name the keys that do the same.
    names = {"space": " "}
    assert all(names.get(key, key) in KEYS for key in (label.split("[")[1].rstrip("]") for label in labels))


def test_keys_are_such_as_the_window_tells_of():
    names = vars(ti.ui).values()
    assert all((len(key) == 1 and key.islower()) or key in names for key in KEYS)


def test_closing_the_window_ends_it(player):
    player.obey(Input(size=SIZE, is_open=False))
    assert player.wants_end


def test_a_recording_says_what_was_done(player, tmp_path):
    player.obey(press("f", on_body(player)))
    player.advance(3)
    player.session.write_recording(tmp_path / "actions.toml")
    written = tomllib.loads((tmp_path / "actions.toml").read_text(encoding="utf-8"))
    assert written["recording"]["ticks"] == 3 and written["actions"][0]["kind"] == "poke"
