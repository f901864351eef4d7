"""A scene that is played with: what mouse, keys and buttons do, and when time goes on. Knows no window."""

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from sandbox.errors import DivergedError, SceneError
from sandbox.live.pace import Pace
from sandbox.live.picker import Cursor, beside, ray
from sandbox.live.views import View
from sandbox.render.camera import FlatCamera
from sandbox.render.ggui.messages import Input, KeyEvent
from sandbox.scene.appearance import FloatArray
from sandbox.scene.model import IntegratorName
from sandbox.session import TICKS_A_PICTURE, LiveGrip, Session

ZOOM_STEP, TURN_STEP = 1.12, 0.04
"""What a press of a key does to the view: nearer by a factor [1]; turned by parts of the picture's height."""
SPEEDS = (0.05, 0.1, 0.25, 0.5, 1.0)
"""Slow motions, and real time [1]."""
DT_STEP = 1.25
"""What a press of a key does to the step [1]."""
POKE, POKE_REACH = 2.0, 3.0
"""Change of speed of what is poked [m/s], and radius of that, in the length of springs [1]."""
UPWARD = np.array([0.0, 1.0])
NEAR_PIXELS = 8.0
"""So far beside a particle a click still means it [pixels]; a spring's length in any case."""
LEFT, MIDDLE, RIGHT = "LMB", "MMB", "RMB"


@dataclass
class Player:
    """Obeys a window's input, one picture after the other."""

    session: Session
    view: View
    pace: Pace
    now: Callable[[], float] = clock.perf_counter
    message: str = ""
    """What there is to say: why time stands still, or what could not be done."""
    wants_end: bool = False
    """Whether somebody has closed the window."""
    covered: tuple[tuple[float, float, float, float], ...] = ()
    """Left, top, width and height of panels, in parts of the window: what is clicked there is not in the scene."""
    _grip: LiveGrip | None = None
    _hand: FloatArray = field(default_factory=lambda: np.zeros(0))
    _offset: FloatArray = field(default_factory=lambda: np.zeros(0))
    _cursor: Cursor = (0.5, 0.5)
    _turning: frozenset[str] = frozenset()

    # -- what was done ------------------------------------------------------------------------------

    def obey(self, given: Input) -> None:
        """Do what was asked for since the picture before."""
        if min(given.size) > 0 and given.size != self.view.size:
            self.view.resize(given.size)
        self._move(given)
        for event in given.events:
            self._press(event, given.cursor) if event.is_press else self._release(event)
        if self._grip is not None and LEFT not in given.held:
            self._let_go()  # it was released where no window saw it
        for label in given.clicked:
            self._try(BUTTONS[label])
        if not given.is_open:
            self.wants_end = True
        if self._grip is not None:
            place = beside(self.view.camera, given.cursor, self._hand) + self._offset
            self.session.drag(self._grip, tuple(place))
        self._cursor = given.cursor

    def _move(self, given: Input) -> None:
        """Turn or shift the view with the buttons that were down before and still are."""
        wide = self.view.size[0] / self.view.size[1]
        across, up = (given.cursor[0] - self._cursor[0]) * wide, given.cursor[1] - self._cursor[1]
        if RIGHT in self._turning & given.held:
            self.view.turn(across, up)
        elif MIDDLE in self._turning & given.held:
            self.view.shift(across, up)
        self._turning = frozenset(button for button in self._turning if button in given.held)

    def _press(self, event: KeyEvent, cursor: Cursor) -> None:
        if event.key == LEFT:
            if not self._is_covered(cursor):
                self._grab(cursor)
        elif event.key in (MIDDLE, RIGHT):
            if not self._is_covered(cursor):
                self._turning |= {event.key}
                self._cursor = cursor
        elif event.key == "f":
            self._try(lambda player: player.poke(cursor))
        elif event.key in KEYS:
            self._try(KEYS[event.key])

    def _release(self, event: KeyEvent) -> None:
        if event.key == LEFT:
            self._let_go()

    def _try(self, action: "Callable[[Player], None]") -> None:
        try:
            action(self)
        except SceneError as error:
            self.message = str(error)

    def _is_covered(self, cursor: Cursor) -> bool:
        x, y = cursor[0], 1.0 - cursor[1]
        return any(left <= x <= left + width and top <= y <= top + height for left, top, width, height in self.covered)

    # -- hands --------------------------------------------------------------------------------------

    @property
    def grip(self) -> LiveGrip | None:
        """What is held, if anything is."""
        return self._grip

    def _grab(self, cursor: Cursor) -> None:
        self._let_go()
        if self._met(cursor) is None:
            return
        origin, direction = ray(self.view.camera, cursor)
        try:
            self._grip = self.session.grab(
                tuple(origin), direction=None if direction is None else tuple(direction), radius=None
            )
        except SceneError as error:
            self.message = str(error)
        if self._grip is not None:
            # The grip follows the hand from where it was taken, which need not be just under the cursor.
            self._hand = self._grip.point
            self._offset = self._hand - beside(self.view.camera, cursor, self._hand)

    def _met(self, cursor: Cursor) -> FloatArray | None:
        """The particle that is seen under the cursor, or just beside it [m], shape (d,); None where there is none."""
        simulation, camera = self.session.simulation, self.view.camera
        positions = simulation.positions()
        origin, direction = ray(camera, cursor)
        apart = positions - origin
        depth = np.zeros(len(positions)) if direction is None else apart @ direction
        beside_ray = np.linalg.norm(apart if direction is None else apart - depth[:, None] * direction, axis=1)
        pixel = 1.0 / camera.scale if isinstance(camera, FlatCamera) else depth / camera.focal
        reach = np.maximum(simulation.assembly.appearance.element_size, NEAR_PIXELS * pixel)
        near = np.nonzero((beside_ray <= reach) & (depth >= 0.0))[0]
        return positions[near[np.argmin((depth + beside_ray)[near])]] if len(near) else None

    def _let_go(self) -> None:
        if self._grip is not None:
            self.session.release(self._grip)
            self._grip = None

    def poke(self, cursor: Cursor) -> None:
        """Strike what is under the cursor, away from the eye; in the plane, upward."""
        simulation = self.session.simulation
        _, direction = ray(self.view.camera, cursor)
        point = self._met(cursor)
        if point is None:
            return
        positions = simulation.positions()
        radius = POKE_REACH * simulation.assembly.appearance.element_size
        struck = np.linalg.norm(positions - point, axis=1) <= radius
        masses = simulation.assembly.scene_order(simulation.assembly.masses)
        self.session.act(
            {
                "kind": "poke",
                "time": simulation.time,
                "point": point.tolist(),
                "radius": radius,
                "impulse": (POKE * float(masses[struck].sum()) * (UPWARD if direction is None else direction)).tolist(),
            }
        )

    # -- time ---------------------------------------------------------------------------------------

    def go_on(self) -> int:
        """Simulate what is due, at most what there is time for; the number of ticks."""
        ticks = self.pace.due()
        if ticks > 0:
            start = self.now()
            self.advance(ticks)
            self.pace.took(ticks, self.now() - start)
        return ticks

    def advance(self, ticks: int) -> None:
        """Go on by some ticks; where the state leaves its bounds time stops, and the message says why."""
        solver = self.session.simulation.scene.solver
        try:
            self.session.advance(ticks)
        except (DivergedError, SceneError) as error:
            self.pace.paused = True
            self.message = f"{error}; R starts again"
        if self.session.simulation.scene.solver != solver:
            self.pace.rest()  # the time that compiling took says nothing of the solver

    def pause(self) -> None:
        """Stop time, or have it go on."""
        self.pace.paused = not self.pace.paused
        self.pace.rest()

    def step(self) -> None:
        """Go on by one picture of the scene, and stop."""
        self.pace.paused = True
        self.advance(TICKS_A_PICTURE)

    def reset(self) -> None:
        """Start again; the recording begins anew."""
        self._grip = None
        self.session.reset()
        self.message = ""
        self.pace.paused, self.pace.lost = False, 0.0
        self.pace.rest()

    def change_speed(self, by: int) -> None:
        """Slower or faster by so many of the speeds."""
        nearest = int(np.argmin([abs(speed - self.pace.speed) for speed in SPEEDS]))
        self.pace.speed = SPEEDS[max(0, min(len(SPEEDS) - 1, nearest + by))]
        self.pace.rest()

    # -- the solver ---------------------------------------------------------------------------------

    def change_dt(self, factor: float | None) -> None:
        """Steps so many times as long from now on [1]; None: chosen by themselves."""
        dt = "auto" if factor is None else float(f"{self.session.simulation.dt * factor:.3g}")
        self._change_solver(dt=dt)

    def change_integrator(self, by: int) -> None:
        """The integrator so many places further in the list from now on."""
        names = list(IntegratorName)
        place = names.index(IntegratorName(self.session.simulation.scene.solver.integrator))
        self._change_solver(integrator=str(names[(place + by) % len(names)]))

    def _change_solver(self, integrator: str | None = None, dt: float | str | None = None) -> None:
        self.session.change_solver(integrator=integrator, dt=dt)
        self.message = ""
        self.pace.rest()

    def end(self) -> None:
        """No more pictures are wanted."""
        self.wants_end = True


KEYS: dict[str, Callable[[Player], None]] = {
    " ": Player.pause,
    "n": Player.step,
    "r": Player.reset,
    "z": lambda player: player.change_speed(-1),
    "x": lambda player: player.change_speed(1),
    "i": lambda player: player.change_integrator(1),
    "k": lambda player: player.change_integrator(-1),
    "j": lambda player: player.change_dt(1.0 / DT_STEP),
    "l": lambda player: player.change_dt(DT_STEP),
    "o": lambda player: player.change_dt(None),
    "w": lambda player: player.view.zoom(ZOOM_STEP),
    "s": lambda player: player.view.zoom(1.0 / ZOOM_STEP),
    "Left": lambda player: player.view.turn(-TURN_STEP, 0.0),
    "Right": lambda player: player.view.turn(TURN_STEP, 0.0),
    "Up": lambda player: player.view.turn(0.0, TURN_STEP),
    "Down": lambda player: player.view.turn(0.0, -TURN_STEP),
    "c": lambda player: player.view.reset(),
    "q": Player.end,
    "Escape": Player.end,
}
"""What keys do; ``f`` pokes what is under the cursor. GGUI tells of letters and of keys with names, of no others."""

BUTTONS: dict[str, Callable[[Player], None]] = {
    "pause / go on [space]": Player.pause,
    "step [n]": Player.step,
    "reset [r]": Player.reset,
    "slower [z]": lambda player: player.change_speed(-1),
    "faster [x]": lambda player: player.change_speed(1),
    "integrator [i]": lambda player: player.change_integrator(1),
    "dt / 1.25 [j]": lambda player: player.change_dt(1.0 / DT_STEP),
    "dt x 1.25 [l]": lambda player: player.change_dt(DT_STEP),
    "dt auto [o]": lambda player: player.change_dt(None),
    "view [c]": lambda player: player.view.reset(),
}
"""Buttons of the panel, and what they do."""
