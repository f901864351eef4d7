"""Opens the port, and starts viser behind the rule of who may see the scene and what may be asked of it."""

import asyncio
import contextlib
import io
import logging
import socket
from collections.abc import Iterator
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from sandbox.errors import SandboxError, SceneError
from sandbox.serve import limits
from sandbox.serve.access import Access, Asked, Verdict

if TYPE_CHECKING:
    import viser

    from sandbox.serve.door import Door

_SEND_BUFFER = 1 << 18
"""What a connection may hold back in the kernel [bytes]: a slow browser sees the newest picture, not old ones."""
_CLOSING = 2.0
"""For a browser to say goodbye as well [s]."""
_REFUSALS = {
    Verdict.NO_TOKEN: (HTTPStatus.UNAUTHORIZED, "A token is needed: open the address that sandbox serve printed.\n"),
    Verdict.STRANGE_PAGE: (HTTPStatus.FORBIDDEN, "Only pages of this server itself are served.\n"),
}


def open_port(host: str, port: int) -> socket.socket:
    """A listening socket. Raises SceneError where the address is none of this machine, or the port is taken."""
    if not 0 <= port <= 65535:
        raise SceneError(f"--port {port}: must be between 0 and 65535")
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    except (OSError, UnicodeError):
        raise SceneError(f"--host {host}: there is no such address") from None
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        listening.bind(address)
        listening.listen()
    except OSError as error:
        listening.close()
        raise SceneError(f"{host}, port {port}: {(error.strerror or str(error)).lower()}; choose another") from None
    return listening


@contextlib.contextmanager
def serving(listening: socket.socket, access: Access, clients: int = limits.CLIENTS) -> Iterator["viser.ViserServer"]:
    """A viser server on a socket that lets in whom ``access`` does; the server and the socket end with the block."""
    from sandbox.serve.door import Door

    with behind(Door(clients), listening, access) as server:
        yield server


@contextlib.contextmanager
def behind(door: "Door", listening: socket.socket, access: Access) -> Iterator["viser.ViserServer"]:
    """The same, with connections counted and looked at by ``door``.

    viser offers no place for a rule of its own, so what it calls to listen is replaced while it starts: its listener
    gets our socket, every request is judged before viser sees it, and so is every message. Should a viser listen in
    another way, it is stopped, on a loopback port that nobody was told.
    """
    import viser
    from viser import _messages
    from websockets.asyncio import server as transport

    from sandbox.serve.gate import Gate

    loops: list[asyncio.AbstractEventLoop] = []
    # It would tell of every write to a connection that was cut off.
    logging.getLogger("asyncio").addHandler(quiet := logging.NullHandler())
    plain = transport.serve

    def serve(handler: Any, host: Any, port: Any, **options: Any) -> Any:
        loops.append(asyncio.get_running_loop())
        loops[0].set_exception_handler(door.note_failure)
        answer = options.pop("process_request")
        options |= {
            "max_size": limits.MESSAGE_SIZE, "logger": _silent(), "create_connection": door.connect,
            "open_timeout": limits.PAGE_TIME, "close_timeout": _CLOSING,
            "ping_interval": limits.PING, "ping_timeout": limits.PATIENCE,
        }  # fmt: skip
        guarded = _guarded(answer, access, door)
        return plain(_of_this_version(handler), sock=listening, process_request=guarded, **options)

    # Setting an attribute of a module by name: mypy knows it as a class.
    vars(transport)["serve"] = serve
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    finally:
        vars(transport)["serve"] = plain
    try:
        if not loops:
            raise SandboxError("this version of viser cannot be guarded; pip install 'softbody-sandbox[web]' again")
        # Any browser could have viser publish the scene through a tunnel of its makers.
        for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            server._websock_server.unregister_handler(message)
        door.gate = Gate.of(server)
        yield server
    finally:
        for loop in loops:
            with contextlib.suppress(RuntimeError):  # It has ended by itself.
                loop.call_soon_threadsafe(door.shut)
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
        listening.close()
        logging.getLogger("asyncio").removeHandler(quiet)


def _of_this_version(handler: Any) -> Any:
    """Send pages of another viser away before viser does: it prints what version they say they are of."""
    import viser

    async def handle(connection: Any) -> None:
        if connection.subprotocol == f"viser-v{viser.__version__}":
            await handler(connection)
        else:
            await connection.close(1002, f"The page is of another version than {viser.__version__}: load it again")

    return handle


def _guarded(answer: Any, access: Access, door: "Door") -> Any:
    """What looks at a request before ``answer`` does."""

    def admit(connection: Any, request: Any) -> Any:
        port = connection.local_address[1]
        asked = Asked(
            path=request.path,
            hosts=request.headers.get_all("Host"),
            origins=request.headers.get_all("Origin"),
            cookies=request.headers.get_all("Cookie"),
            is_websocket=bool(request.headers.get_all("Upgrade")),
        )
        verdict = access.judge(asked, port)
        if not asked.is_websocket:
            # The page may take its time where the network is slow.
            connection.close_timeout = limits.PAGE_TIME
        if verdict is Verdict.LET_IN:
            if asked.is_websocket and not door.has_room(connection):
                return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "As many browsers look as may.\n")
            with contextlib.suppress(OSError, ValueError, LookupError):
                return answer(connection, request)
            return connection.respond(HTTPStatus.NOT_FOUND, "NOT FOUND")
        if verdict is Verdict.GIVE_COOKIE:
            response = connection.respond(HTTPStatus.SEE_OTHER, "")
            response.headers["Location"] = "/"
            response.headers["Set-Cookie"] = access.cookie(port)
        else:
            response = connection.respond(*_REFUSALS[verdict])
        response.headers["Cache-Control"] = "no-store"
        response.headers["Referrer-Policy"] = "no-referrer"
        return response

    return admit


def _silent() -> logging.Logger:
    """A log for what strangers send, which is none of the terminal's business."""
    logger = logging.Logger("sandbox.serve")
    logger.addHandler(logging.NullHandler())
    return logger
