"""Which messages of a browser are let through: what a control may send, where the camera is, and drags of bodies.

All else that viser knows, such as uploads, tunnels, or other attributes of controls, ends here. What passes is written
anew from what was understood, so that viser reads nothing that was not looked at.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct
from viser import (
    GuiButtonGroupHandle,
    GuiButtonHandle,
    GuiCheckboxHandle,
    GuiDropdownHandle,
    GuiSliderHandle,
    GuiTextHandle,
)
from viser._messages import KeyModifier

from sandbox.serve.limits import MESSAGE_SIZE, TEXT

if TYPE_CHECKING:
    import viser

# NaN is not within bounds either.
_Number = Annotated[float, Meta(ge=-1e15, le=1e15)]
_Triple = tuple[_Number, _Number, _Number]
_Pair = tuple[_Number, _Number]
_Count = Annotated[int, Meta(ge=0, le=1 << 31)]
_Text = Annotated[str, Meta(max_length=TEXT)]


class _Updates(Struct, forbid_unknown_fields=True):
    value: bool | _Number | _Text


class _Update(Struct, tag_field="type", tag="GuiUpdateMessage", forbid_unknown_fields=True):
    uuid: _Text
    updates: _Updates


class _Camera(Struct, tag_field="type", tag="ViewerCameraMessage", forbid_unknown_fields=True):
    wxyz: tuple[_Number, _Number, _Number, _Number]
    position: _Triple
    fov: Annotated[float, Meta(gt=0.0, lt=math.pi)]
    near: Annotated[float, Meta(ge=0.0, le=1e15)]
    far: Annotated[float, Meta(gt=0.0, le=1e18)]
    image_height: _Count
    image_width: _Count
    look_at: _Triple
    up_direction: _Triple

    def is_sound(self) -> bool:
        """Whether it looks anywhere."""
        return all(1e-9 < math.hypot(*vector) for vector in (self.wxyz, self.up_direction))


class _Drag(Struct, tag_field="type", tag="SceneNodeDragMessage", forbid_unknown_fields=True):
    phase: Literal["start", "update", "end"]
    name: _Text
    instance_index: _Count | None
    start_position: _Triple
    start_screen_pos: _Pair
    end_position: _Triple
    end_screen_pos: _Pair
    button: Literal["left"]
    modifier: KeyModifier | None
    owner: Literal[""]


class Gate:
    """Decides on messages.

    Parameters
    ----------
    control : viser's handle of a control by its name, None where there is none
    is_body : whether something of a name can be dragged
    """

    def __init__(self, control: Callable[[str], Any], is_body: Callable[[str], bool]) -> None:
        self._control, self._is_body = control, is_body
        self._decode = msgspec.msgpack.Decoder(_Update | _Camera | _Drag).decode

    @classmethod
    def of(cls, server: "viser.ViserServer") -> "Gate":
        """For what a server shows."""
        # viser has no public way to a control by the name that browsers know it by.
        return cls(server.gui._gui_input_handle_from_uuid.get, server.scene._handle_from_node_name.__contains__)

    def passed(self, message: str | bytes) -> bytes | None:
        """What viser may read of a message; None where it is refused."""
        if isinstance(message, str) or len(message) > MESSAGE_SIZE:
            return None
        try:
            understood = self._decode(message)
            return msgspec.msgpack.encode(understood) if self._is_allowed(understood) else None
        except (msgspec.MsgspecError, UnicodeError, RecursionError, OverflowError, MemoryError):
            return None

    def _is_allowed(self, message: _Update | _Camera | _Drag) -> bool:
        if isinstance(message, _Camera):
            return message.is_sound()
        if isinstance(message, _Drag):
            return self._is_body(message.name)
        return may_send(self._control(message.uuid), message.updates.value)


def may_send(control: Any, value: bool | float | str) -> bool:
    """Whether a control, as a viser handle, can be set to a value in the page. False where there is no such control."""
    if control is None or not control.visible or control.disabled:
        return False
    match control:
        case GuiButtonHandle():
            return value is True
        case GuiCheckboxHandle():
            return isinstance(value, bool)
        case GuiButtonGroupHandle() | GuiDropdownHandle():
            return value in control.options
        case GuiSliderHandle():
            # The number beside a slider can be typed, between its steps too.
            return type(value) is float and control.min <= value <= control.max
        case GuiTextHandle():
            return isinstance(value, str) and value.isprintable()
    return False
