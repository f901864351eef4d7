"""``sandbox play``: a window in which a scene is touched, and a recording of what was done to it."""

import contextlib
import signal
import time as clock
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandbox.errors import SandboxError
from sandbox.live.pace import Pace
from sandbox.live.player import Player
from sandbox.live.readout import CONTROLS, READINGS, panels
from sandbox.live.views import view_of
from sandbox.particle_values import ParticleValues
from sandbox.render import palette
from sandbox.render.ggui.process import DriverError
from sandbox.render.ggui.renderer import framed
from sandbox.render.ggui.window import LiveWindow
from sandbox.scene.model import ColorBy, Scene
from sandbox.session import Session

_READ_OUT_SECONDS = 0.1
"""Time between two looks at energies [s]."""
_UNITS = {ColorBy.SPEED: " m/s", ColorBy.STRAIN: ""}


@dataclass(frozen=True)
class PlayOptions:
    """How a scene is played."""

    title: str
    """Of the window."""
    record: Path | None = None
    """File that the actions are written to at the end."""
    seconds: float | None = None
    """Wall time after which the window closes [s]; None: not by itself."""
    arch: str = "cpu"
    precision: str | None = None
    threads: int | None = None


@dataclass(frozen=True)
class PlaySummary:
    """What came of it."""

    simulated: float
    """[s]"""
    ticks: int
    actions: int
    state_sha256: str
    """Hash of final positions and velocities."""


def play(scene: Scene, options: PlayOptions) -> PlaySummary:
    """Open a window and play until it is closed; the recording is written whatever ends it.

    Raises SceneError where the scene cannot be built, DriverError where there is no screen or its driver dies.
    """
    session = Session(scene, arch=options.arch, precision=options.precision, threads=options.threads)
    stage = _Stage(session, options.title)
    try:
        try:
            stage.run(options.seconds)
        except KeyboardInterrupt:
            pass  # the usual way to end what has no end
        with _uninterrupted():
            return _finished(session, options.record)
    except DriverError as error:
        with _uninterrupted():
            _finished(session, options.record)
        kept = f"; {options.record} holds what was done until then" if options.record is not None else ""
        raise SandboxError(f"play: {error}{kept}") from None
    finally:
        stage.close()


def _finished(session: Session, record: Path | None) -> PlaySummary:
    recorded = session.recording()
    if record is not None:
        session.write_recording(record)
    assert recorded.recording is not None
    header = recorded.recording
    return PlaySummary(session.simulation.time, header.ticks, len(recorded.actions), header.state_sha256)


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """A second Ctrl-C does not keep the first one's recording from being written."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class _Stage:
    """The parts of a live scene: session, window, and who obeys."""

    def __init__(self, session: Session, title: str) -> None:
        self._session = session
        simulation, scene = session.simulation, session.simulation.scene
        appearance = simulation.assembly.appearance
        camera = framed(appearance, scene.render.camera, scene.render.size)
        self._shown = scene.render.color
        self._by_value = self._shown is not ColorBy.BODY
        colormap = palette.colormap(palette.COLORMAPS[self._shown]) if self._by_value else None
        self._values: ParticleValues | None = None
        self._top = scene.render.color_max
        try:
            self._window = LiveWindow(appearance, camera, colormap, title)
        except (DriverError, OSError) as error:
            raise SandboxError(
                f"play: {error}; `sandbox serve` shows a scene in a browser, `sandbox run` makes a video"
            ) from None
        self._player = Player(
            session, view_of(camera, appearance.bounds), Pace(session.tick), covered=(READINGS, CONTROLS)
        )
        self._panels = panels(self._player)
        self._read_at = clock.perf_counter()

    def run(self, seconds: float | None) -> None:
        """Picture after picture until somebody ends it, or for so much wall time [s]."""
        player, end = self._player, None if seconds is None else clock.perf_counter() + seconds
        while not player.wants_end and (end is None or clock.perf_counter() < end):
            player.obey(self._window.input())
            self._show()
            player.go_on()
            clock.sleep(player.pace.wait())

    def _show(self) -> None:
        player, simulation = self._player, self._session.simulation
        values, scale = self._colors()
        # Text that changes with every picture cannot be read.
        if clock.perf_counter() - self._read_at > _READ_OUT_SECONDS:
            self._panels, self._read_at = panels(player, self._legend()), clock.perf_counter()
        self._window.show(
            player.view.camera, simulation.state, values, scale, simulation.time, simulation.torn, self._panels
        )

    def _colors(self) -> tuple[Any, float]:
        """Values that colours show, and one over the top of their scale."""
        if not self._by_value:
            return None, 1.0
        simulation = self._session.simulation
        # Another solver has other fields.
        if self._values is None or self._values.state is not simulation.state:
            self._values = ParticleValues(simulation, self._shown)
            self._top = self._top or self._values.expected_largest()
        return self._values.update(), 1.0 / (self._top or 1.0)

    def _legend(self) -> str:
        return f"colours: {self._shown} from 0 to {self._top:g}{_UNITS[self._shown]}" if self._by_value else ""

    def close(self) -> None:
        """Close the window."""
        self._window.close()
