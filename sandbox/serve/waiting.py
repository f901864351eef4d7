"""What browsers have asked for and was not done yet: of each kind the newest, so that it never grows long."""

import threading

from sandbox.serve.commands import (
    Client,
    Command,
    Drag,
    Grab,
    Release,
    SendRecording,
    SetSolver,
    SetStiffness,
    StepPicture,
)
from sandbox.serve.limits import STEPS

_MOST = 1000
"""More than can come together by what follows; the last resort."""


class Waiting:
    """A queue of commands. Any thread may put some in; the one of the simulation takes them out."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._commands: list[Command] = []
        self._holding: set[Client] = set()
        """Who may hold something: grabs of theirs were taken out, and no release since."""

    def __len__(self) -> int:
        return len(self._commands)

    def put(self, command: Command) -> None:
        """Have something done, after all that waits and instead of what it replaces."""
        with self._lock:
            if isinstance(command, StepPicture):
                if sum(isinstance(one, StepPicture) for one in self._commands) >= STEPS:
                    return
            else:
                key = _key(command)
                self._commands = [one for one in self._commands if _key(one) != key]
            if len(self._commands) < _MOST or isinstance(command, Release):
                self._commands.append(command)

    def vanish(self, client: Client) -> None:
        """A client is gone: it lets go, and of what it asked for last nothing about itself is done."""
        with self._lock:
            about_itself = (Grab, Drag, Release, SendRecording)
            self._commands = [
                one for one in self._commands if not (isinstance(one, about_itself) and one.client == client)
            ]
            if client in self._holding:
                self._commands.append(Release(client))

    def take(self) -> Command | None:
        """The next to be done; None where nothing waits."""
        with self._lock:
            if not self._commands:
                return None
            command = self._commands.pop(0)
            if isinstance(command, Grab):
                self._holding.add(command.client)
            elif isinstance(command, Release):
                self._holding.discard(command.client)
            return command


def _key(command: Command) -> tuple[object, ...]:
    """What commands have in common of which the newest replaces the others."""
    match command:
        case Grab(client) | Drag(client) | Release(client) | SendRecording(client):
            return type(command), client
        case SetStiffness(body):
            return type(command), body
        case SetSolver(integrator, dt):
            return type(command), integrator is None, dt is None
    return (type(command),)
