"""sandbox serve: a scene, a port, and a thread that keeps both going."""

import socket
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from sandbox.errors import SceneError, missing_extra
from sandbox.scene.model import Scene
from sandbox.serve import limits
from sandbox.serve.access import Access
from sandbox.serve.ending import Ending, ended_by_signals

if TYPE_CHECKING:
    from sandbox.session import Session

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
    clients: int = limits.CLIENTS
    """Browsers that may look at once."""


def check_extra() -> None:
    """Raise SceneError where viser is not installed."""
    if find_spec("viser") is None:
        raise SceneError(missing_extra("serve", "viser", "web"))


def serve(scene: Scene, options: ServeOptions, tell: Callable[[str], None], warn: Callable[[list[str]], None]) -> str:
    """Serve a scene until interrupted; ``tell`` gets the address to open. The result is one line about the end.

    ``warn`` gets what was refused meanwhile, in lines. Raises SceneError where the scene, an option or the address is
    wrong; nothing is served then.
    """
    check_extra()
    access = Access.of(options.host, options.token)
    _check(options)
    from sandbox.serve.door import Door
    from sandbox.serve.listener import behind, open_port

    door = Door(options.clients)
    with open_port(options.host, options.port) as listening, ended_by_signals() as ending:
        from sandbox.serve.host import Host
        from sandbox.session import Session

        session = Session(scene, arch=options.arch, precision=options.precision, threads=options.threads)

        def write() -> None:
            if options.record is not None:
                _write(session, options.record, ending)

        with behind(door, listening, access) as server:
            host = Host(session, server, options.pictures, options.shadows)
            try:
                with ending.deaf(write):
                    host.warm_up()
                tell(access.address(listening.getsockname()[1], _shown(options.host)))
                with ending.in_time():
                    host.run(ending.stop, options.seconds, lambda: ending.deaf(write))
            finally:
                write()
    warn(door.remarks())
    end = f"served {session.simulation.time:.2f} s of simulated time"
    return end if options.record is None else f"{end}; {options.record} holds what was done"


def _check(options: ServeOptions) -> None:
    if options.seconds is not None and not options.seconds > 0.0:
        raise SceneError(f"--seconds {options.seconds:g}: must be > 0")
    if not 1.0 <= options.pictures <= 240.0:
        raise SceneError(f"--pictures {options.pictures:g}: must be between 1 and 240")
    if not 1 <= options.clients <= limits.MOST_CLIENTS:
        raise SceneError(f"--clients {options.clients}: must be between 1 and {limits.MOST_CLIENTS}")
    if options.record is not None and not options.record.absolute().parent.is_dir():
        raise SceneError(f"--record {options.record}: there is no folder {options.record.parent}")


def _write(session: "Session", path: Path, ending: Ending) -> None:
    """Leave what was done. In the middle of a picture it has no end that could be compared."""
    if not ending.was_broken_off:
        session.write_recording(path)
        return
    from sandbox import recording

    done = session.recording()
    assert done.recording is not None
    header = done.recording.model_copy(update={"state_sha256": ""})
    recording.write(path, done.model_copy(update={"recording": header}))


def _shown(host: str) -> str:
    """A name under which other machines may find this one."""
    return socket.gethostname() if host in _ANYWHERE else host
