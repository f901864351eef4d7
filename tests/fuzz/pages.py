"""Messages of a browser to the gate of the page: nearly right ones, and bytes that are none.

What the gate lets through is what viser reads, and what is done with it is a live call, see ``messages``.
"""

import contextlib
import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from tests.fuzz import odd
from tests.fuzz.inputs import Input, Kind, Wrong

_SOUND = {"ViewerCameraMessage", "SceneNodeDragMessage", "GuiUpdateMessage"}
_VALUES: tuple[Any, ...] = (True, False, 0.1, 1.0, 4.99, "1/2", "Step", "auto", "0.001")
_PLACES: tuple[Any, ...] = ([0.0, 1.0, 2.0], [-3.0, 0.5, 1e-3])


@functools.cache
def _opened() -> Any:
    """A gate, and the handle of one control of each kind; the server is there until the process ends."""
    from sandbox.serve.access import Access
    from sandbox.serve.gate import Gate
    from sandbox.serve.listener import open_port, serving

    stack = contextlib.ExitStack()
    server = stack.enter_context(serving(open_port("127.0.0.1", 0), Access.of("127.0.0.1")))
    gui = server.gui
    controls = {
        "slider": gui.add_slider("slider", 0.1, 5.0, 0.05, 1.0),
        "choice": gui.add_dropdown("choice", ("real time", "1/2")),
        "buttons": gui.add_button_group("buttons", ("Go", "Step")),
        "button": gui.add_button("button"),
        "check": gui.add_checkbox("check", False),
        "text": gui.add_text("text", "auto"),
        "upload": gui.add_upload_button("upload"),
        "hidden": gui.add_text("hidden", "x", visible=False),
        "disabled": gui.add_button("disabled", disabled=True),
    }
    return Gate(controls.get, {"/bodies/0 cube"}.__contains__), controls, stack


def _prepare() -> None:
    _opened()


def _whole() -> list[Any]:
    """Messages as a page sends them."""
    from tests.serve.target import camera, drag

    names = ("slider", "choice", "buttons", "button", "check", "text", "upload", "hidden", "disabled", "nobody")
    updates = [
        {"type": "GuiUpdateMessage", "uuid": name, "updates": {"value": value}} for name in names for value in _VALUES
    ]
    drags = [drag(phase, point) for phase in ("start", "update", "end") for point in _PLACES]
    cameras = [camera(), camera(position=[1e3, -2.0, 0.1], fov=3.0)]
    return updates + 8 * drags + 20 * cameras


def _packed(tree: Any) -> bytes:
    """As MessagePack; what that cannot say is a text."""
    import msgspec

    if isinstance(tree, dict):
        tree = {str(key): value for key, value in tree.items()}
    try:
        return msgspec.msgpack.encode(tree, enc_hook=str)
    except (OverflowError, TypeError, ValueError, UnicodeError, RecursionError):
        return msgspec.msgpack.encode(ascii(tree))


@st.composite
def _drawn(draw: Any) -> Input:
    whole = _whole()
    match draw(st.sampled_from(["whole", "changed", "changed", "changed", "damaged"])):
        case "whole":
            data = _packed(whole[draw(st.integers(0, len(whole) - 1))])
        case "changed":
            data = _packed(draw(odd.changed(whole, odd.values, most=2)))
        case _:
            data = odd.damaged(draw, _packed(whole[draw(st.integers(0, len(whole) - 1))]))
    return Input(".msgpack", data)


def _take(path: Path) -> str:
    from viser._messages import Message

    from sandbox.serve.gate import may_send

    gate, controls, _ = _opened()
    passed = gate.passed(path.read_bytes())
    if passed is None:
        return "refused"
    message = Message.deserialize(passed)
    kind, content = type(message).__name__, vars(message)
    if kind not in _SOUND:
        raise Wrong(f"lets a {kind} through")
    if kind == "GuiUpdateMessage":
        if content["updates"].keys() != {"value"} or not may_send(
            controls.get(content["uuid"]), content["updates"]["value"]
        ):
            raise Wrong("sets what a control does not take")
    for name, value in content.items():
        if isinstance(value, float | tuple) and not np.isfinite(np.asarray(value, dtype=float)).all():
            raise Wrong(f"has a {name} that is not finite")
    if kind == "ViewerCameraMessage" and not math.hypot(*content["up_direction"]) > 0.0:
        raise Wrong("is a camera that has no way up")
    return "let through"


PAGES = Kind("pages", _drawn, _take, short=60, prepare=_prepare)
