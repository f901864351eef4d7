"""Connections to a served scene: how many there may be, what each may cost, and what viser hears of them."""

import asyncio
from typing import TYPE_CHECKING, Any

from websockets.asyncio.server import ServerConnection
from websockets.frames import Opcode

from sandbox.serve import limits
from sandbox.serve.limits import Bucket

if TYPE_CHECKING:
    from sandbox.serve.gate import Gate

_PIECE = 1 << 12
"""What is looked at in one go [bytes]: thousands of empty frames fit into what comes at once."""
_GOODBYE = 0.3
"""For browsers to hear that the server ends [s]."""


class Connection(ServerConnection):
    """One connection, a request of the page or a browser; what exceeds the limits ends it without a word."""

    def __init__(self, *given: Any, door: "Door", **options: Any) -> None:
        super().__init__(*given, **options)
        self.door = door
        self.began = self.loop.time()
        self.is_browser = False
        """Whether it was let in as one."""
        self.is_heard = False
        """Whether it has sent something that a page sends."""
        self._head = self._fragments = 0
        self._messages, self._bytes = Bucket(limits.MESSAGES), Bucket(limits.BYTES)
        self._frames, self._control = Bucket(limits.FRAMES), Bucket(limits.CONTROL)
        self._share = Bucket(limits.FAIR)
        self._unsent_before = 0
        self._look: asyncio.TimerHandle | None = None
        self._deadline = self.loop.call_later(limits.REQUEST_TIME, self._look_whether_it_asks)

    @property
    def unsent(self) -> int:
        """What was sent and not taken yet [bytes]."""
        return self.transport.get_write_buffer_size()

    def cut(self, counts: bool = True) -> None:
        """End it at once."""
        if not self.transport.is_closing():
            self.door.cut += counts
            self.transport.abort()

    async def recv(self, decode: bool | None = None) -> Any:
        """The next message that may be heard; all others are dropped."""
        while True:
            message = await super().recv(decode)
            allowed = self._messages.take(self.loop.time())
            passed = self.door.gate.passed(message) if allowed and self.door.gate is not None else None
            if passed is not None:
                self.is_heard = True
                return passed
            self.door.refused += 1
            await asyncio.sleep(0)

    # -- what asyncio and websockets call ------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """It has begun."""
        super().connection_made(transport)
        self.door.enter(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """It has ended."""
        self.door.connections.pop(self, None)
        for timer in (self._deadline, self._look):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Something has come."""
        self._head += len(data) if self.request is None else 0
        if self._head > limits.REQUEST_SIZE or not self._bytes.take(self.loop.time(), len(data)):
            self.cut()
        for start in range(0, len(data), _PIECE):
            if self.transport.is_closing():
                return
            super().data_received(data[start : start + _PIECE])

    def process_event(self, event: Any) -> None:
        """A frame has come, or a request."""
        if self.request is not None and not self._is_within_limits(event.opcode):
            self.cut()
        if not self.transport.is_closing():
            super().process_event(event)

    def _is_within_limits(self, opcode: Opcode) -> bool:
        """Whether one more frame is."""
        now = self.loop.time()
        if opcode in (Opcode.PING, Opcode.PONG, Opcode.CLOSE):
            return self._control.take(now)
        self._fragments = self._fragments + 1 if opcode is Opcode.CONT else 1
        is_fair = self._share.take(now)
        has_place = self.door.together.take(now) or is_fair
        return self._fragments <= limits.FRAGMENTS and self._frames.take(now) and has_place

    def pause_writing(self) -> None:
        """More has been sent than was taken."""
        super().pause_writing()
        self._unsent_before = self.unsent
        self._look = self.loop.call_later(limits.PATIENCE, self._look_whether_it_takes)
        self.door.keep_small()

    def resume_writing(self) -> None:
        """It has caught up."""
        super().resume_writing()
        if self._look is not None:
            self._look.cancel()

    def _look_whether_it_asks(self) -> None:
        if self.request is None:
            self.cut()

    def _look_whether_it_takes(self) -> None:
        if self.unsent > self._unsent_before - limits.LEAST_TAKEN:
            self.cut()
            return
        self._unsent_before = self.unsent
        self._look = self.loop.call_later(limits.PATIENCE, self._look_whether_it_takes)


class Door:
    """All connections of a server.

    Parameters
    ----------
    clients : most browsers at once
    """

    def __init__(self, clients: int = limits.CLIENTS) -> None:
        self.clients = clients
        self.gate: Gate | None = None
        """Decides on messages; nothing is heard before there is one."""
        self.together = Bucket(limits.TOGETHER)
        """What all may send."""
        self.connections: dict[Connection, None] = {}
        """Those there are, the oldest first."""
        self.refused = self.cut = 0
        """Messages that were not heard, and connections that were refused or cut off."""
        self.failures: dict[str, int] = {}
        """How often something went wrong that nobody looked after, by its kind."""

    def connect(self, *given: Any, **options: Any) -> Connection:
        """A new connection, as websockets wants it."""
        return Connection(*given, door=self, **options)

    def enter(self, one: Connection) -> None:
        """A connection has begun; where there are too many that are no browser's, the oldest of them ends."""
        self.connections[one] = None
        waiting = [each for each in self.connections if not each.is_browser]
        if len(waiting) > limits.OPENING:
            waiting[0].cut()

    def has_room(self, one: Connection) -> bool:
        """Let a browser in. False where there are as many as there may be, and all of them have been heard."""
        browsers = [each for each in self.connections if each.is_browser]
        if len(browsers) >= self.clients:
            now = one.loop.time()
            silent = [each for each in browsers if not each.is_heard and now - each.began > limits.NEWCOMER]
            if not silent:
                self.cut += 1
                return False
            silent[0].cut()
        one.is_browser, one.began = True, one.loop.time()
        return True

    def keep_small(self) -> None:
        """Where those that fetch the page have left too much untaken, end those that left the most."""
        slow = sorted((one for one in self.connections if not one.is_browser), key=lambda one: one.unsent)
        while slow and sum(one.unsent for one in slow) > limits.UNSENT:
            slow.pop().cut()

    def note_failure(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Count what went wrong in the loop that serves: it is told at the end, in one line."""
        kind = type(context.get("exception")).__name__
        self.failures[kind] = self.failures.get(kind, 0) + 1

    def shut(self) -> None:
        """End all connections soon. From within the loop."""
        for one in list(self.connections):
            if one.is_browser and not one.unsent:
                one.loop.call_later(_GOODBYE, one.cut, False)
            else:
                one.cut(counts=False)

    def remarks(self) -> list[str]:
        """What there is to say about it at the end, a line each."""
        lines = []
        if self.refused or self.cut:
            lines.append(f"refused {self.refused:,} messages and {self.cut:,} connections: see --help for limits")
        if self.failures:
            kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(self.failures.items()))
            lines.append(f"serving failed in parts ({kinds})")
        return lines
