"""The live scene behind the page: one thread simulates, obeys what browsers ask for, and sends what is to be seen."""

import contextlib
import tempfile
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sandbox.errors import DivergedError, SceneError
from sandbox.live.budget import Budget
from sandbox.live.pace import Pace
from sandbox.scene.appearance import IntArray
from sandbox.serve import commands as ask
from sandbox.serve.commands import Command
from sandbox.serve.limits import DEEDS
from sandbox.serve.memory import forget_code, trim
from sandbox.serve.panel import LARGEST_FACTOR, LEAST_FACTOR, Panel
from sandbox.serve.stage import Stage
from sandbox.serve.waiting import Waiting
from sandbox.session import TICKS_A_PICTURE, LiveGrip, Session

if TYPE_CHECKING:
    import viser

_READING = 0.25
"""Time between read-outs [s]."""
_MOST_STEPS = 20_000
"""Steps a picture that a step set in the page may come to."""
_REACH = 20.0
"""How far from the scene a body may be dragged, in its extents [1]."""
_TRIMMING = 5.0
"""Time between two times at which what browsers left behind is cleared away [s]."""
_OBEYING = 0.25
"""How long commands are obeyed before what came of it is shown [s]."""


class Host:
    """A session that browsers watch and touch. Time stands still while none does."""

    def __init__(
        self, session: Session, server: "viser.ViserServer", pictures: float = 60.0, shadows: bool = True
    ) -> None:
        """``pictures`` are sent a second."""
        self.session, self._server = session, server
        self.commands = Waiting()
        """What browsers ask for; any thread may put commands into it."""
        self.pace = Pace(session.tick, pictures)
        scene = session.simulation.scene
        self.stage = Stage(server, scene, session.simulation.assembly.appearance, self._on_drag)
        self.panel = Panel(server, scene, shadows, self.commands.put)
        self.stage.light(shadows)
        self._solver = self._first_solver = scene.solver
        self._compiles = False
        self._stop = threading.Event()
        self._around_compiling: Callable[[], AbstractContextManager[None]] = nullcontext
        self._deeds = 0
        self.grips: dict[int, tuple[LiveGrip, Any, Any]] = {}
        """What clients hold, and where hand and body were when they took hold of it [m]."""
        self.pictures = 0
        """Pictures sent so far."""
        self._stale = True
        self._torn: IntArray | None = None
        self._torn_count = 0
        self._read_at = self._shown_at = self._trimmed_at = -1.0
        self._has_lost_clients = False
        server.on_client_disconnect(self._on_disconnect)

    def run(
        self,
        stop: threading.Event,
        seconds: float | None = None,
        around_compiling: Callable[[], AbstractContextManager[None]] = nullcontext,
    ) -> None:
        """Go on until ``stop`` is set, or for some seconds of wall time.

        ``around_compiling`` is entered around what takes seconds in which nothing can be heard.
        """
        self._stop, self._around_compiling = stop, around_compiling
        end = None if seconds is None else clock.perf_counter() + seconds
        while not stop.is_set() and (end is None or clock.perf_counter() < end):
            self.picture()
            # Where there is not enough time, none is waited away.
            stop.wait(1e-3 if self._is_behind else max(self.pace.wait(), 1e-3))

    def picture(self) -> None:
        """Obey, go on as far as is due, and send what has changed."""
        self._obey()
        if self._server.get_clients():
            self._go_on()
        else:
            self.pace.rest()
        if self._stale and not (self._is_behind and clock.perf_counter() - self._shown_at < self.pace.picture):
            self._show()
        if clock.perf_counter() - self._read_at >= _READING:
            self._read_out()

    def warm_up(self) -> None:
        """Compile what the first picture needs, so that it does not wait."""
        with contextlib.suppress(DivergedError):
            self.session.advance(1)
        self.session.reset()

    # -- time ---------------------------------------------------------------------------------------

    def _go_on(self) -> None:
        ticks = self.pace.due()
        if self.pace.paused:
            return
        start = clock.perf_counter()
        if ticks:
            self._advance(ticks)
        self.pace.took(ticks, clock.perf_counter() - start)

    @property
    def _is_behind(self) -> bool:
        """True where the machine does not manage the speed that is asked for."""
        return not self.pace.paused and self.pace.tick_cost * self.pace.speed > self.pace.tick

    def _advance(self, ticks: int) -> None:
        """Go on by some ticks. What goes wrong stops time, not the page."""
        if self._stop.is_set():
            return
        try:
            with self._compiling():
                self.session.advance(ticks)
        except (DivergedError, SceneError) as error:
            self.pace.paused = True
            self.panel.say(f"{error}. Reset, or change the solver.")
        self._compiles = False
        self._stale = True
        self._note_solver()

    @contextlib.contextmanager
    def _compiling(self) -> Iterator[None]:
        """Around what compiles another solver, if there is to be one."""
        if not self._compiles:
            yield
            return
        with self._around_compiling():
            forget_code()
            yield
            trim()

    def _note_solver(self) -> None:
        """Show the solver that is in use; it has been another since the last step if one was asked for."""
        if (solver := self.session.simulation.scene.solver) != self._solver:
            self._solver = solver
            self.panel.show_solver(str(solver.integrator), str(solver.dt))
            # The time that it took to compile says nothing of its speed.
            self.pace.rest()

    # -- what is seen -------------------------------------------------------------------------------

    def _show(self) -> None:
        simulation = self.session.simulation
        count = simulation.measure().torn
        torn_is_new = count != self._torn_count
        if torn_is_new:
            self._torn_count = count
            self._torn = np.asarray(simulation.torn.to_numpy(), dtype=np.int32) if count else None
        self.stage.show(simulation.state.read()[0], simulation.time, self._torn, torn_is_new)
        self.pictures += 1
        self._shown_at = clock.perf_counter()
        self._stale = False

    def _read_out(self) -> None:
        simulation = self.session.simulation
        budget = Budget.of(self.pace, simulation.dt, simulation.initial_stable_dt)
        self.panel.read_out(simulation.time, simulation.measure(), budget, self.pace.paused, self.pace.lost)
        self._read_at = clock.perf_counter()
        if self._has_lost_clients and self._read_at - self._trimmed_at > _TRIMMING:
            self._has_lost_clients, self._trimmed_at = False, self._read_at
            trim()

    # -- what browsers ask for ----------------------------------------------------------------------

    async def _on_drag(self, event: Any) -> None:
        for command in ask.of_drag(event):
            self.commands.put(command)

    async def _on_disconnect(self, client: Any) -> None:
        self.commands.vanish(client.client_id)
        self._has_lost_clients = True

    def _obey(self) -> None:
        """Do what waits, or as much of it as there is time for before others want to see something."""
        end = clock.perf_counter() + _OBEYING
        while not self._stop.is_set() and (command := self.commands.take()) is not None:
            try:
                self._do(command)
            except SceneError as error:
                self.panel.say(str(error))
            if clock.perf_counter() > end:
                return

    def _do(self, command: Command) -> None:
        match command:
            case ask.Grab(client, point):
                self._grab(client, point)
            case ask.Drag(client, point):
                self._drag(client, point)
            case ask.Release(client):
                if held := self.grips.pop(client, None):
                    self.session.release(held[0])
            case ask.SetPause(paused):
                self.pace.paused = paused
            case ask.StepPicture():
                self.pace.paused = True
                self._advance(TICKS_A_PICTURE)
            case ask.Reset():
                self._reset()
            case ask.SetSpeed(speed):
                self.pace.speed = speed
            case ask.SetStiffness(body, factor):
                self._set_stiffness(body, factor)
            case ask.SetSolver(integrator, dt):
                self._set_solver(integrator, dt)
            case ask.SetShadows(shadows):
                self.stage.light(shadows)
            case ask.SendRecording(client):
                self._send_recording(client)

    def _grab(self, client: int, point: ask.Point) -> None:
        if client in self.grips:
            self.session.release(self.grips.pop(client)[0])
        self._note_deed()
        dimension = self.session.simulation.scene.dimension
        grip = self.session.grab(point[:dimension])
        if grip is None:
            self.panel.say("All hands are full.")
            return
        self.grips[client] = (grip, np.array(point[:dimension]), grip.point)

    def _drag(self, client: int, point: ask.Point) -> None:
        if client not in self.grips:
            return
        self._note_deed()
        grip, hand, body = self.grips[client]
        low, high = self.session.simulation.assembly.appearance.bounds
        reach = _REACH * float((high - low).max())
        target = body + (np.array(point[: len(body)]) - hand)
        self.session.drag(grip, np.clip(target, low - reach, high + reach))

    def _note_deed(self) -> None:
        """One more thing for the recording, which has its limits."""
        if self._deeds >= DEEDS:
            raise SceneError("The recording is full: save it; Reset begins a new one.")
        self._deeds += 1

    def _reset(self) -> None:
        self.grips.clear()
        self._compiles = self.session.simulation.scene.solver != self._first_solver
        with self._compiling():
            self.session.reset()
        self._deeds = 0
        self.panel.say("")
        self.panel.show_unchanged(self.session.simulation.scene)
        self.pace.rest()
        self.pace.lost = 0.0
        self._solver = self.session.simulation.scene.solver
        self.pace.paused = False
        self._stale = True

    def _set_stiffness(self, body: str, factor: float) -> None:
        if not LEAST_FACTOR <= factor <= LARGEST_FACTOR:
            raise SceneError(f"stiffness: must be between {LEAST_FACTOR:g} and {LARGEST_FACTOR:g}")
        self._note_deed()
        self.session.scale_material(body, stiffness=factor)

    def _set_solver(self, integrator: str | None, dt: str | None) -> None:
        self._note_deed()
        try:
            self.session.change_solver(integrator=integrator, dt=None if dt is None else self._step(dt))
        except SceneError:
            self.panel.show_solver(str(self._solver.integrator), str(self._solver.dt))
            raise
        self._compiles = True
        self.panel.say("")

    def _step(self, text: str) -> float | str:
        """The longest step that a text says [s], or "auto"."""
        if text.strip() == "auto":
            return "auto"
        least = self.session.tick * TICKS_A_PICTURE / _MOST_STEPS
        try:
            value = float(text)
        except ValueError:
            value = -1.0
        if not least <= value <= 10.0:
            raise SceneError(f"step {text!r}: must be auto, or seconds between {least:.1g} and 10")
        return value

    def _send_recording(self, client: int) -> None:
        handle = self._server.get_clients().get(client)
        if handle is None:
            return
        buffer = handle._websock_connection.get_message_buffer()
        if buffer.message_from_id:
            return  # It has not even taken the last one.
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "actions.toml"
            self.session.write_recording(path)
            # viser warns of sending to who has just left.
            with buffer.sanctioned_dead_writes():
                handle.send_file_download(path.name, path.read_bytes(), save_immediately=True)
