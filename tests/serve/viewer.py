"""A browser without a picture: speaks to a served scene as viser's page does, and says what it was sent."""

import contextlib
import socket
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from viser import _messages as messages
from websockets.sync.client import ClientConnection, connect

ORIGIN = (0.0, 0.0, 0.0)


class Viewer:
    """A connection to a served scene."""

    def __init__(self, port: int, **options: Any) -> None:
        self.connection: ClientConnection = connect(
            f"ws://127.0.0.1:{port}", subprotocols=[f"viser-v{viser.__version__}"], max_size=None, **options
        )
        self.vertices: dict[str, np.ndarray] = {}
        """What is known of surfaces, by their names."""
        self.texts: dict[str, str] = {}
        """What read-outs say."""
        self.controls: dict[str, str] = {}
        """Names of controls for viser, by their labels."""
        self.updates = 0
        """Surfaces that came anew."""
        self.send(
            messages.ViewerCameraMessage(
                wxyz=(1.0, 0.0, 0.0, 0.0),
                position=(0.0, 0.0, 3.0),
                fov=0.6,
                near=0.1,
                far=100.0,
                image_height=100,
                image_width=100,
                look_at=ORIGIN,
                up_direction=(0.0, 1.0, 0.0),
            )
        )

    def send(self, message: messages.Message) -> None:
        """Say something to the server."""
        self.connection.send(msgspec.msgpack.encode(message.as_serializable_dict()))

    def drag(self, phase: str, name: str, start: Any, end: Any) -> None:
        """Drag a body from where it was clicked at [m] to a point in the plane of the picture [m]."""
        data = {
            "type": "SceneNodeDragMessage",
            "phase": phase,
            "name": name,
            "instance_index": None,
            "start_position": start,
            "start_screen_pos": (0.5, 0.5),
            "end_position": end,
            "end_screen_pos": (0.5, 0.5),
            "button": "left",
            "modifier": None,
            "owner": "",
        }
        self.connection.send(msgspec.msgpack.encode(data))

    def look(self, timeout: float = 0.0) -> bool:
        """Take in the next thing that was sent, within some time [s]; False if there was none."""
        try:
            raw = self.connection.recv(timeout=timeout)
        except TimeoutError:
            return False
        assert isinstance(raw, bytes)
        for message in _decode(raw):
            props = message.get("updates") or message.get("props") or {}
            if message["type"] in ("MeshMessage", "SceneNodeUpdateMessage") and "vertices" in props:
                self.updates += 1
                self.vertices[message["name"]] = props["vertices"].reshape(-1, 3)
            if "uuid" in message and "label" in props:
                self.controls[props["label"]] = message["uuid"]
            if "content" in props:
                self.texts[message["uuid"]] = props["content"]
        return True

    def look_around(self, timeout: float = 0.3) -> None:
        """Take in all that was sent, until nothing more comes for some time [s]."""
        while self.look(timeout):
            pass

    def reads(self, text: str) -> bool:
        """Whether some read-out says this."""
        return any(text in content for content in self.texts.values())

    def vanish(self) -> None:
        """Be gone without a word, as a browser that was killed."""
        with contextlib.suppress(OSError):
            self.connection.socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Say goodbye."""
        self.connection.close()


def _decode(raw: bytes) -> list[dict[str, Any]]:
    whole, packed = (int.from_bytes(raw[first : first + 8], "little") for first in (0, 8))
    data = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], max_output_size=whole))
    offset, buffers = 16 + packed, []
    for length in data["binaryBufferLengths"]:
        offset += -offset % 8
        buffers.append(raw[offset : offset + length])
        offset += length
    return [_filled(message, buffers) for message in data["messages"]]


def _filled(value: Any, buffers: list[bytes]) -> Any:
    if isinstance(value, dict) and "__binary_index" in value:
        return np.frombuffer(buffers[value["__binary_index"]], dtype=value["dtype"])
    if isinstance(value, dict):
        return {key: _filled(part, buffers) for key, part in value.items()}
    return [_filled(part, buffers) for part in value] if isinstance(value, list) else value
