"""Which messages are let through, without a simulation or a connection."""

import math
from types import SimpleNamespace

import pytest

pytest.importorskip("viser", reason="needs the extra web")

from viser._messages import Message

from sandbox.serve.access import Access
from sandbox.serve.gate import Gate, may_send
from sandbox.serve.limits import MESSAGE_SIZE, TEXT, Bucket, in_words
from sandbox.serve.listener import open_port, serving
from tests.serve.target import BAD_NUMBERS, camera, drag, nested, pack


@pytest.fixture(scope="module")
def controls():
    """One of every kind that the page has, and one of another."""
    with serving(open_port("127.0.0.1", 0), Access.of("127.0.0.1")) as server:
        gui = server.gui
        yield SimpleNamespace(
            server=server,
            slider=gui.add_slider("slider", 0.1, 5.0, 0.05, 1.0),
            choice=gui.add_dropdown("choice", ("real time", "1/2")),
            buttons=gui.add_button_group("buttons", ("Go", "Step")),
            button=gui.add_button("button"),
            check=gui.add_checkbox("check", False),
            text=gui.add_text("text", "auto"),
            upload=gui.add_upload_button("upload"),
            hidden=gui.add_text("hidden", "x", visible=False),
            disabled=gui.add_button("disabled", disabled=True),
        )


GOOD = {
    "slider": [0.1, 5.0, 0.73, 3.0], "choice": ["1/2"], "buttons": ["Step"], "button": [True], "check": [True, False],
    "text": ["0.001", ""],
}  # fmt: skip
BAD = {
    "slider": [0.0999, 5.0001, True, "1", math.nan], "choice": ["1/3", 1.0, True, ""], "buttons": ["Stop", True],
    "button": [False, 1.0, "True"], "check": [1.0, 0.0, "True"], "text": [1.0, True, "a\nb", "\x1b[31m", "\0"],
    "upload": ["x", True, 1.0], "hidden": ["x"], "disabled": [True],
}  # fmt: skip


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in GOOD.items() for value in values])
def test_what_a_control_may_send_passes(controls, name, value):
    handle = getattr(controls, name)
    assert may_send(handle, value)
    message = {"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": {"value": value}}
    passed = Gate.of(controls.server).passed(pack(message))
    assert vars(Message.deserialize(passed)) == {"uuid": handle._impl.uuid, "updates": {"value": value}}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in BAD.items() for value in values])
def test_what_it_may_not_send_does_not(controls, name, value):
    handle = getattr(controls, name)
    assert not may_send(handle, value)
    message = {"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": {"value": value}}
    assert Gate.of(controls.server).passed(pack(message)) is None


@pytest.fixture
def gate(controls):
    """Knows the text field as t, and one body."""
    return Gate({"t": controls.text}.get, {"/bodies/0 cube"}.__contains__)


def test_only_values_of_controls_that_are_there_pass(gate):
    def update(uuid="t", **updates):
        return gate.passed(pack({"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}))

    assert update(value="1") is not None
    for name in ("visible", "label", "order", "update_cb", "_impl", "uuid", "removed", "no_such"):
        assert update(**{name: "x"}) is None
        assert update(value="1", **{name: "x"}) is None
    assert update() is None and update("other", value="1") is None
    assert update(value="x" * TEXT) is not None and update(value="x" * (TEXT + 1)) is None


def test_cameras_and_drags_pass_where_all_their_numbers_are_some(gate):
    assert type(Message.deserialize(gate.passed(pack(camera())))).__name__ == "ViewerCameraMessage"
    whole = drag("start", [0.0, 1.0, 2.0])
    again = Message.deserialize(gate.passed(pack(whole)))
    assert again.start_position == (0.0, 1.0, 2.0) and again.as_serializable_dict().keys() == whole.keys()
    for value in BAD_NUMBERS:
        for name in ("position", "look_at", "up_direction", "wxyz"):
            assert gate.passed(pack(camera(**{name: [value, 0.0, 1.0]}))) is None
            assert gate.passed(pack(camera(**{name: value}))) is None
        for name in ("fov", "near", "far", "image_height"):
            assert gate.passed(pack(camera(**{name: value}))) is None
        for name in ("start_position", "end_position"):
            assert gate.passed(pack(drag("start", [0.0] * 3, {name: [value, 0.0, 0.0]}))) is None
    for wrong in (
        {"name": "/other"},
        {"owner": "1"},
        {"button": "right"},
        {"modifier": "x"},
        {"phase": "no"},
        {"x": 1},
    ):
        assert gate.passed(pack(drag("start", [0.0] * 3, wrong))) is None
    assert gate.passed(pack(drag("start", [0.0] * 3, {"modifier": "shift", "instance_index": 3}))) is not None
    assert gate.passed(pack(camera(wxyz=[0.0] * 4))) is None and gate.passed(pack(camera(fov=0.0))) is None


def test_all_other_kinds_of_messages_end_here(gate):
    passing = {"GuiUpdateMessage", "ViewerCameraMessage", "SceneNodeDragMessage"}
    kinds = {kind.__name__ for kind in Message.get_subclasses()}
    assert passing < kinds and len(kinds) > 80
    for kind in kinds - passing | {"Message", "", "\0", "object"}:
        assert (
            gate.passed(pack({"type": kind, "uuid": "t", "name": "/bodies/0 cube", "updates": {"value": "1"}})) is None
        )


@pytest.mark.parametrize(
    "raw",
    [
        b"", "text", b"\xc1", b"\xff" * 100, nested(60_000), b"\x82\xa1x" + nested(60_000), b"\xdd\x7f\xff\xff\xff",
        b"\xdf\x7f\xff\xff\xff", b"\xdb\xff\xff\xff\xff", pack([]), pack("Go"), pack(None), pack({}), pack({"type": 1}),
        b"\x82\xa4type\xb0GuiUpdateMessage\xa4uuid\xff", b"\x81\xa4type\xa2\xff\xfe", bytes(MESSAGE_SIZE + 1),
    ],
)  # fmt: skip
def test_what_is_no_message_ends_here(gate, raw):
    assert gate.passed(raw) is None


def test_a_bucket_lets_as_many_through_as_it_has_room_for_and_as_many_again_every_second():
    bucket = Bucket(10.0)
    assert sum(bucket.take(100.0) for _ in range(50)) == 10
    assert sum(bucket.take(100.5) for _ in range(50)) == 5
    assert sum(bucket.take(200.0) for _ in range(50)) == 10
    assert bucket.take(300.0, 10) and not bucket.take(300.0, 1) and not bucket.take(400.0, 11)


def test_limits_are_far_above_what_a_page_sends():
    """Measured in chromium: 46 messages a second and 7 at once while it orbits, 260 bytes at most."""
    from sandbox.serve import limits

    assert limits.MESSAGES >= 5 * 50 and limits.FRAMES >= 5 * limits.MESSAGES and limits.BYTES >= 5 * 50 * 260
    assert all(str(number) in in_words() for number in (limits.CLIENTS, limits.MESSAGES, limits.STEPS))
