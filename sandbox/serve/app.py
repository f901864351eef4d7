"""sandbox serve: a scene, a port, and a thread that keeps both going."""

import contextlib
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sandbox.errors import SceneError, missing_extra
from sandbox.scene.model import Scene
from sandbox.serve.access import Access

_ANYWHERE = ("", "0.0.0.0", "::")


@dataclass(frozen=True)
class ServeOptions:
    """Where and how a scene is served."""

    host: str = "127.0.0.1"
    port: int = 8080
    """0: any that is free."""
    token: str | None = None
    """What browsers must know; made up where the address is open to other machines."""
    record: Path | None = None
    """Where to leave what was done, at the end."""
    seconds: float | None = None
    """Wall time after which to end [s]; None: when interrupted."""
    shadows: bool = True
    arch: str = "cpu"
    precision: str | None = None
    threads: int | None = None
    pictures: float = 60.0
    """Sent a second."""


def check_extra() -> None:
    """Raise SceneError where viser is not installed."""
    if find_spec("viser") is None:
        raise SceneError(missing_extra("serve", "viser", "web"))


def serve(scene: Scene, options: ServeOptions, tell: Callable[[str], None]) -> str:
    """Serve a scene until interrupted; ``tell`` gets the address to open. The result is one line about the end.

    Raises SceneError where the scene, an option or the address is wrong; nothing is served then.
    """
    check_extra()
    access = Access.of(options.host, options.token)
    if options.seconds is not None and not options.seconds > 0.0:
        raise SceneError(f"--seconds {options.seconds:g}: must be > 0")
    if not 1.0 <= options.pictures <= 240.0:
        raise SceneError(f"--pictures {options.pictures:g}: must be between 1 and 240")
    if options.record is not None and not options.record.absolute().parent.is_dir():
        raise SceneError(f"--record {options.record}: there is no folder {options.record.parent}")
    from sandbox.serve.listener import open_port, serving

    with open_port(options.host, options.port) as listening, _stopped_by_signals() as stop:
        from sandbox.serve.host import Host
        from sandbox.session import Session

        session = Session(scene, arch=options.arch, precision=options.precision, threads=options.threads)
        with serving(listening, access) as server:
            host = Host(session, server, options.pictures, options.shadows)
            try:
                host.warm_up()
                tell(access.address(listening.getsockname()[1], _shown(options.host)))
                host.run(stop, options.seconds)
            finally:
                if options.record is not None:
                    session.write_recording(options.record)
    end = f"served {session.simulation.time:.2f} s of simulated time"
    return end if options.record is None else f"{end}; {options.record} holds what was done"


def _shown(host: str) -> str:
    """A name under which other machines may find this one."""
    return socket.gethostname() if host in _ANYWHERE else host


@contextlib.contextmanager
def _stopped_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets, so that a picture is finished first; a second one interrupts at once."""
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def handle(number: int, frame: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
