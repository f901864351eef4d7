"""What a hostile client does to a served scene, by name: each is done with a server that goes on serving others."""

import contextlib
import math
import struct
import time
import zlib
from collections.abc import Callable

from sandbox.serve import limits
from tests.serve.target import BAD_NUMBERS, Target, camera, drag, frame, nested, pack

HOSTILE: dict[str, Callable[[Target], None]] = {}


def hostile(action):
    """A client that :data:`HOSTILE` lists."""
    HOSTILE[action.__name__] = action
    return action


# -- what controls are sent -------------------------------------------------------------------------


@hostile
def sets_other_attributes_of_controls(target):
    names = ("visible", "label", "order", "disabled", "hint", "min", "options", "update_cb", "sync_cb", "removed")
    names += ("_impl", "uuid", "gui_api", "props", "is_button", "__class__", "__dict__", "no_such")
    for label in target.controls:
        alone = [{"type": "GuiUpdateMessage", "uuid": target.controls[label], "updates": {name: 1}} for name in names]
        target.send(*alone, *(target.update(label, "auto", [(name, None)]) for name in names))


@hostile
def sets_controls_to_values_of_other_types(target):
    for label in target.controls:
        target.send(*(target.update(label, value) for value in (*BAD_NUMBERS, "\x1b[31mred", "no such", "\0", [], {})))


@hostile
def sets_sliders_beyond_their_ends(target):
    target.send(*(target.update("cube", value) for value in (-1.0, 0.0, 0.0999, 5.01, 1e15, -1e-300, 2**62)))


@hostile
def sets_controls_to_long_texts(target):
    for size in (1000, 60_000, 10_000_000):
        target.send(*(target.update(label, "x" * size) for label in target.controls))


@hostile
def sets_controls_to_what_is_nested_deeply(target):
    for depth in (1000, 30_000):
        raw = pack(target.update("Step [s]", 0))[:-1] + nested(depth)
        target.send(raw, b"\x81" + pack("type") + nested(depth))


@hostile
def sets_controls_that_are_not_there(target):
    names = ("", "root", "x" * 300, "\0", 1, None, ["a"], "00000000-0000-0000-0000-000000000000")
    target.send(*({"type": "GuiUpdateMessage", "uuid": name, "updates": {"value": "Go"}} for name in names))


@hostile
def clicks_step_20_000_times(target):
    click = pack(target.update("Time", "Step"))
    target.send(*[click] * 20_000)
    target.send(target.update("Time", "Go"))


@hostile
def clicks_step_from_many_connections(target):
    click, step = pack(target.update("Time", "Step")), frame(2, pack(camera()))
    links = [target.open() for _ in range(20)]
    for link in links:
        with contextlib.suppress(OSError):
            link.sendall(step + 300 * frame(2, click))
    for link in links:
        link.close()
    target.send(target.update("Time", "Go"))


@hostile
def resets_2_000_times(target):
    target.send(*[target.update("Time", "Reset")] * 2000)


@hostile
def saves_recordings_and_never_reads_them(target):
    with target.viewer() as viewer, contextlib.suppress(OSError):
        for _ in range(300):
            viewer.connection.socket.sendall(frame(2, pack(target.update("Save recording", True))))
            time.sleep(0.003)


@hostile
def asks_for_the_least_step_and_changes_the_solver(target):
    least = target.update("Step [s]", "2e-6")
    kinds = [target.update("Integrator", name) for name in ("symplectic_euler", "velocity_verlet")]
    target.send(least, *kinds * 50, pause=0.5)
    target.send(target.update("Time", "Reset"), pause=2.0)


# -- other messages ---------------------------------------------------------------------------------


@hostile
def uploads_what_no_control_asked_for(target):
    start = {
        "type": "FileTransferStartUpload", "source_component_uuid": target.controls["Time"], "transfer_uuid": "t",
        "filename": "../../etc/passwd", "mime_type": "text/plain", "part_count": 10**6, "size_bytes": 10**9,
    }  # fmt: skip
    part = {"type": "FileTransferPart", "source_component_uuid": target.controls["Time"], "transfer_uuid": "t"}
    parts = [part | {"part_index": index, "content": bytes(60_000)} for index in (3, 0, 0, -1, 10**6, 2**40)]
    target.send(start, *parts, *[start | {"part_count": 0, "size_bytes": 0}] * 20)
    target.send(start, *[part | {"part_index": index, "content": bytes(60_000)} for index in range(500)])


@hostile
def asks_for_a_tunnel_and_sends_what_servers_send(target):
    kinds = ("ShareUrlRequest", "ShareUrlDisconnect", "ResetGuiMessage", "NotificationShowMessage", "GuiRemoveMessage")
    kinds += ("RunJavascriptMessage", "GuiFormDirtyMessage", "GuiFormSubmitMessage", "GuiButtonHoldMessage")
    kinds += ("RemoveSceneNodeMessage", "SetCameraPositionMessage", "CommandTriggerMessage", "Message", "object")
    target.send(*({"type": kind} for kind in kinds), *({"type": kind, "uuid": "x", "name": "/"} for kind in kinds))


@hostile
def looks_from_nowhere(target):
    bad = (math.nan, math.inf, 1e308, 2**63, "1", None, [])
    target.send(
        *(camera(position=[value, 0.0, 0.0]) for value in bad), *(camera(fov=value) for value in (*bad, 0, -1, 7))
    )
    zero = [
        camera(wxyz=[0.0] * 4),
        camera(up_direction=[0.0] * 3),
        camera(wxyz=[1.0]),
        camera(look_at=[]),
        camera(far=0),
    ]
    target.send(
        *zero, camera(image_height=-1), camera(image_width=2**40), camera(image_width=1.5), {**camera(), "x": 1}
    )


@hostile
def points_along_rays_of_no_number(target):
    ray = {"type": "ScenePointerMessage", "modifier": None, "screen_pos": [[0.5, 0.5]]}
    kinds = ("click", "rect-select", "no such", 1, None)
    target.send(
        *(ray | {"event_type": kind, "ray_origin": [math.nan] * 3, "ray_direction": [0.0] * 3} for kind in kinds)
    )
    node = {"type": "SceneNodeClickMessage", "name": "/bodies/0 cube", "instance_index": 0, "owner": ""}
    target.send(node | ray | {"type": "SceneNodeClickMessage", "ray_origin": [math.inf] * 3, "ray_direction": None})


@hostile
def drags_without_a_grab(target):
    target.send(*(drag(phase, [0.2, 0.5, 0.2]) for phase in ("update", "end", "update", "end") * 20))


@hostile
def drags_what_is_not_there_to_where_nothing_is(target):
    bad = ([math.nan] * 3, [1e300] * 3, [0.0], [], "abc", None, [2**63] * 3, [[0.0] * 3] * 3)
    target.send(*(drag(phase, point) for point in bad for phase in ("start", "update", "end", "no such", 3)))
    odd = [{"name": "/no such"}, {"name": ""}, {"name": "/" * 60_000}, {"instance_index": -1}, {"owner": "1"}]
    odd += [{"button": "none"}, {"modifier": "no such"}, {"phase": None}, {"start_screen_pos": [math.nan] * 2}]
    target.send(*(drag("start", [0.2, 0.5, 0.2], one) for one in odd))


@hostile
def grabs_and_vanishes_40_times(target):
    for _ in range(40):
        with target.viewer() as viewer:
            viewer.connection.send(pack(drag("start", [0.25, 0.5, 0.25])))


@hostile
def grabs_and_lets_go_5_000_times(target):
    both = (drag("start", [0.25, 0.5, 0.25]), drag("end", [0.25, 0.5, 0.25]))
    target.send(*both * 2500)


# -- what is no message -----------------------------------------------------------------------------


@hostile
def sends_garbage(target):
    target.send(*(zlib.crc32(bytes([n])).to_bytes(4, "big") * (n + 1) for n in range(256)), b"", b"\xc1", b"\xff" * 999)


@hostile
def sends_headers_of_more_than_there_is(target):
    bombs = [b"\xdd\x7f\xff\xff\xff", b"\xdf\x7f\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff"]
    bombs += [pack(target.update("cube", 0.0))[:-9] + bomb for bomb in bombs]
    target.send(*bombs * 10, nested(60_000))


@hostile
def sends_texts(target):
    target.send("", "hello", "\x1b]0;title\x07", '{"type": "GuiUpdateMessage"}', "\N{PILE OF POO}" * 10_000)
    link = target.open()
    link.sendall(frame(1, b"\xff\xfe\xfd"))
    link.close()


@hostile
def sends_giant_messages(target):
    for size in (limits.MESSAGE_SIZE + 1, 1 << 24):
        with target.open() as link, contextlib.suppress(OSError):
            link.sendall(frame(2, bytes(size)))
    with target.open() as link, contextlib.suppress(OSError):
        link.sendall(frame(2, bytes(1000), length=(1 << 63) - 1))


@hostile
def sends_fragments_without_end(target):
    for piece in (b"", bytes(100)):
        with target.open() as link, contextlib.suppress(OSError):
            link.sendall(frame(2, piece, fin=False))
            for _ in range(300):
                link.sendall(frame(0, piece, fin=False) * 30)


@hostile
def sends_10_000_pings(target):
    with target.open() as link, contextlib.suppress(OSError):
        link.sendall(frame(9, bytes(125)) * 10_000)


@hostile
def answers_pings_that_were_not_sent(target):
    with target.open() as link, contextlib.suppress(OSError):
        link.sendall(frame(10, bytes(125)) * 10_000)


@hostile
def sends_frames_of_no_kind(target):
    for head in (frame(3), frame(15), frame(9, bytes(200)), frame(2, b"x", rsv=7), frame(8, b"\0"), frame(0, b"x")):
        target.raw(target.handshake(), head, wait=0.1)
    target.raw(target.handshake(), b"\x82\x05hello", wait=0.1)


@hostile
def sends_compressed_bombs(target):
    deflate = zlib.compressobj(wbits=-15)
    bomb = deflate.compress(bytes(50_000_000)) + deflate.flush(zlib.Z_SYNC_FLUSH)
    with target.open("Sec-WebSocket-Extensions: permessage-deflate; client_max_window_bits") as link:
        with contextlib.suppress(OSError):
            link.sendall(frame(2, bomb[: limits.MESSAGE_SIZE - 100], rsv=4))


@hostile
def goes_on_after_saying_goodbye(target):
    with target.open() as link, contextlib.suppress(OSError):
        link.sendall(frame(8, struct.pack(">H", 1000)) + frame(2, pack(camera())) * 1000)
