"""What a client can send to a served scene that no page would, and the connection for it."""

import contextlib
import math
import socket
import struct
import time

import msgspec
import viser

from tests.serve.viewer import Viewer

pack = msgspec.msgpack.encode
BAD_NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 2**63, True, None, "one", [1.0], {"a": 1.0}, b"1")


class Target:
    """A served scene, as a client sees it that wants it to fail."""

    def __init__(self, port: int, controls: dict[str, str]) -> None:
        self.port = port
        self.controls = controls
        """Names of controls for viser, by their labels."""

    @contextlib.contextmanager
    def viewer(self, **options):
        """A client that is let in; it may be thrown out meanwhile."""
        one = Viewer(self.port, **options)
        try:
            yield one
        finally:
            one.vanish()

    def send(self, *messages, pause=0.0):
        """Say things as one client, as far as the server will listen, and look at what it shows for a moment."""
        with self.viewer() as viewer, contextlib.suppress(Exception):
            for message in messages:
                viewer.connection.send(message if isinstance(message, bytes | str) else pack(message))
            time.sleep(pause)
            end = time.perf_counter() + 0.1
            while time.perf_counter() < end:
                viewer.look(0.05)

    def update(self, control, value, others=()):
        """A message that sets a control, and other attributes of it."""
        updates = {"value": value, **dict(others)}
        return {"type": "GuiUpdateMessage", "uuid": self.controls[control], "updates": updates}

    def raw(self, *pieces, wait=0.2):
        """Speak bytes to the port; what is answered, as far as it comes within some time [s]."""
        answer = b""
        with socket.create_connection(("127.0.0.1", self.port), timeout=5.0) as link:
            with contextlib.suppress(OSError):
                for piece in pieces:
                    link.sendall(piece)
                link.settimeout(wait)
                while len(answer) < 1 << 20 and (more := link.recv(1 << 16)):
                    answer += more
        return answer

    def open(self, *headers):
        """A socket that has become a WebSocket."""
        link = socket.create_connection(("127.0.0.1", self.port), timeout=5.0)
        link.sendall(self.handshake(*headers))
        assert b"101" in link.recv(1 << 12)
        return link

    def handshake(self, *headers):
        """The request that makes a socket a WebSocket."""
        lines = ["GET / HTTP/1.1", f"Host: 127.0.0.1:{self.port}", "Upgrade: websocket", "Connection: Upgrade"]
        lines += ["Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Version: 13"]
        lines += [f"Sec-WebSocket-Protocol: viser-v{viser.__version__}", *headers]
        return "\r\n".join([*lines, "", ""]).encode()


def frame(opcode, payload=b"", fin=True, length=None, rsv=0):
    """A frame of the WebSocket protocol, masked with zeros; ``length`` is claimed."""
    length = len(payload) if length is None else length
    head = bytes([fin << 7 | rsv << 4 | opcode])
    if length < 126:
        head += bytes([0x80 | length])
    else:
        head += bytes([0x80 | (126 if length < 1 << 16 else 127)]) + struct.pack(
            ">H" if length < 1 << 16 else ">Q", length
        )
    return head + bytes(4) + payload


def nested(depth):
    """Lists in lists."""
    return b"\x91" * depth + b"\xc0"


def camera(**changes):
    whole = {
        "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, 3.0], "fov": 0.6,
        "near": 0.1, "far": 100.0, "image_height": 100, "image_width": 100, "look_at": [0.0, 0.0, 0.0],
        "up_direction": [0.0, 1.0, 0.0],
    }  # fmt: skip
    return whole | changes


def drag(phase, point, changes=()):
    whole = {
        "type": "SceneNodeDragMessage", "phase": phase, "name": "/bodies/0 cube", "instance_index": None,
        "start_position": point, "start_screen_pos": [0.5, 0.5], "end_position": point, "end_screen_pos": [0.5, 0.5],
        "button": "left", "modifier": None, "owner": "",
    }  # fmt: skip
    return whole | dict(changes)
