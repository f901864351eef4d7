"""Opens the port, and starts viser behind the rule of who may see the scene."""

import contextlib
import io
import logging
import socket
from collections.abc import Iterator
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from sandbox.errors import SandboxError, SceneError
from sandbox.serve.access import Access, Asked, Verdict

if TYPE_CHECKING:
    import viser

_SEND_BUFFER = 1 << 18
"""What a connection may hold back in the kernel [bytes]: a slow browser sees the newest picture, not old ones."""
_LARGEST_MESSAGE = 1 << 20
"""Of what browsers send [bytes]."""
_PING, _PATIENCE = 4.0, 12.0
"""How often a browser is asked whether it is still there, and how long an answer may take [s]."""
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
def serving(listening: socket.socket, access: Access) -> Iterator["viser.ViserServer"]:
    """A viser server on a socket that lets in whom ``access`` does; the server and the socket end with the block.

    viser offers no place for a rule of its own, so what it calls to listen is replaced while it starts: its listener
    gets our socket, and every request is judged before viser sees it. Should a viser listen in another way, it is
    stopped, on a loopback port that nobody was told.
    """
    import viser
    from viser import _messages
    from websockets.asyncio import server as transport

    guards: list[bool] = []
    plain = transport.serve

    def serve(handler: Any, host: Any, port: Any, **options: Any) -> Any:
        guards.append(True)
        answer = options.pop("process_request")
        options |= {
            "max_size": _LARGEST_MESSAGE, "logger": _silent(), "ping_interval": _PING, "ping_timeout": _PATIENCE,
        }  # fmt: skip
        return plain(handler, sock=listening, process_request=_guarded(answer, access), **options)

    # Setting an attribute of a module by name: mypy knows it as a class.
    vars(transport)["serve"] = serve
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    finally:
        vars(transport)["serve"] = plain
    try:
        if not guards:
            raise SandboxError("this version of viser cannot be guarded; pip install 'softbody-sandbox[web]' again")
        # Any browser could have viser publish the scene through a tunnel of its makers.
        for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            server._websock_server.unregister_handler(message)
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
        listening.close()


def _guarded(answer: Any, access: Access) -> Any:
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
        if verdict is Verdict.LET_IN:
            return answer(connection, request)
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
