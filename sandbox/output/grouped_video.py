"""Video in groups of pictures that stand for themselves: it plays as far as it got, and can be gone on with.

Each group is whole in the file or not there. An encoder cannot be stored; one that begins anew with every group makes
the same bits whether the run went through or was gone on with.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.video.stream import VideoStream

from sandbox.files import append_at, replace_when_whole, write_all
from sandbox.output.pictures import Memory, Picture

_LONGEST_GROUP = 32
"""Pictures: what may be missing of a video that was cut off, and how far apart one can jump to."""
_EXACT = {"fflags": "+bitexact"}
"""For containers: none of the random numbers that WebM has by default."""


class VideoWriter:
    """H.264 (.mp4) or VP9 (.webm), yuv420p so that every player shows it.

    Groups of pictures have an encoder each, and are appended once they are complete: to MP4 as fragments, to WebM as
    clusters, so that the file plays as far as it got. The first group is of a single picture and each one after it
    twice as long, up to 32: also what is cut off soon shows something. At the end the packets are put into a file of
    the usual kind, with an index.
    """

    def __init__(self, path: Path, kind: "VideoKind", fps: float, memory: Memory | None = None) -> None:
        self._path, self._kind = path, kind
        self._indexed = path.with_name(f".indexed-{path.name}")
        self._rate = Fraction(fps).limit_denominator(100_000)
        self._file: Any = None
        self._group: _Group | None = None
        self._count, self._size = 0, 0
        """Pictures, and bytes, of complete groups."""
        self._frames: list[av.VideoFrame] = []
        """Those of the group that is not complete."""
        if memory is not None:
            self._count, self._size = int(memory["count"]), int(memory["size"])
            self._file = append_at(path, self._size) if self._size else None
            for picture in memory["pictures"]:
                self._add(av.VideoFrame.from_ndarray(picture, format="yuv420p"))

    @property
    def between_groups(self) -> bool:
        """True where all pictures are in the file."""
        return not self._frames

    def write(self, picture: Picture) -> None:
        """Append one picture. The first one opens the file: a video without pictures is none."""
        self._add(av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(format="yuv420p"))

    def _add(self, frame: av.VideoFrame) -> None:
        self._group = self._group or _Group(self._kind, self._rate, frame.width, frame.height)
        number = self._count + len(self._frames)
        self._group.add(frame, number)
        self._frames.append(frame)
        if number + 1 == _end_of_group(self._count):
            self._append_group()

    def _append_group(self) -> None:
        if self._group is None:
            return
        data = self._group.close()
        self._file = self._file or self._path.open("wb", buffering=0)
        # The first group brings the head of the file.
        write_all(self._file, data[self._kind.first_group(data) :] if self._count else data)
        self._count, self._size = self._count + len(self._frames), self._file.tell()
        self._group, self._frames = None, []

    def close(self, indexes: bool = True) -> None:
        """Write the last group, short as it may be, and beside it the file with an index."""
        self._append_group()
        if self._file is not None:
            self._file.close()
            if indexes:
                _write_index(self._path, self._indexed, self._kind)

    def settle(self) -> None:
        """Let the file with an index take the name of the other."""
        if self._indexed.exists():
            self._indexed.replace(self._path)

    def memory(self) -> Memory:
        """Pictures of the group that is not complete, as the encoder takes them; where the file ends without them."""
        pictures = [frame.to_ndarray() for frame in self._frames]
        return {
            "count": np.array(self._count),
            "size": np.array(self._size),
            "pictures": np.stack(pictures) if pictures else np.zeros((0, 0, 0), dtype=np.uint8),
        }


@dataclass(frozen=True)
class VideoKind:
    """What is particular of a container: its codec, and where its head ends."""

    name: str
    codec: str
    codec_options: dict[str, str]
    options: dict[str, str]
    """Of a container that is written in groups."""
    first_group: Callable[[bytes], int]
    """Where in a container with one group that begins."""


def _first_fragment(data: bytes) -> int:
    """Where the first fragment of an MP4 begins: boxes say how long they are."""
    place = 0
    while data[place + 4 : place + 8] != b"moof":
        place += int.from_bytes(data[place : place + 4], "big")
    return place


def _first_cluster(data: bytes) -> int:
    """Where the first cluster of a WebM begins."""
    return data.index(b"\x1f\x43\xb6\x75")


KINDS = {
    # Without B-frames, whose times of decoding would reach back into the group before.
    "mp4": VideoKind(
        "mp4", "libx264", {"bf": "0"},
        {"movflags": "frag_keyframe+delay_moov+default_base_moof+frag_discont+skip_trailer"}, _first_fragment,
    ),
    "webm": VideoKind("webm", "libvpx-vp9", {}, {"live": "1"}, _first_cluster),
}  # fmt: skip


class _Group:
    """Pictures with an encoder and a container of their own."""

    def __init__(self, kind: VideoKind, rate: Fraction, width: int, height: int) -> None:
        # In memory: a container that meets a full disk by itself complains once more when it is collected.
        self._data = io.BytesIO()
        self._container = av.open(self._data, "w", format=kind.name, options=kind.options | _EXACT)
        self._stream = cast(VideoStream, self._container.add_stream(kind.codec, rate=rate, options=kind.codec_options))
        self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
        self._time_base = 1 / rate

    def add(self, frame: av.VideoFrame, number: int) -> None:
        """Append picture ``number`` of the video."""
        frame.pts, frame.time_base = number, self._time_base
        self._container.mux(self._stream.encode(frame))

    def close(self) -> bytes:
        """The container of these pictures."""
        self._container.mux(self._stream.encode(None))
        self._container.close()
        return self._data.getvalue()


def _end_of_group(begin: int) -> int:
    """Number of pictures at the end of the group before which there are ``begin``: 1, 3, 7, 15, 31, 63, 95, ..."""
    return begin + min(begin + 1, _LONGEST_GROUP)


def _write_index(path: Path, indexed: Path, kind: VideoKind) -> None:
    """Put the packets of a video that is in groups into a file of the usual kind."""
    with replace_when_whole(indexed) as temporary, temporary.open("wb") as file:
        sink = _Sink(file)
        with av.open(str(path)) as grouped, av.open(sink, "w", format=kind.name, options=_EXACT) as usual:
            stream: Any = usual.add_stream_from_template(grouped.streams.video[0])
            for packet in grouped.demux(video=0):
                if packet.dts is not None:
                    packet.stream = stream
                    usual.mux(packet)
        sink.check()


class _Sink:
    """A file for a container to be written to that raises what went wrong only when asked.

    A container that cannot write complains once more when it is collected.
    """

    def __init__(self, file: Any) -> None:
        self._file = file
        self._error: OSError | None = None
        self.seek, self.tell = file.seek, file.tell

    def write(self, data: bytes) -> int:
        """Write all of it."""
        try:
            if self._error is None:
                self._file.write(data)
        except OSError as error:
            self._error = error
        return len(data)

    def check(self) -> None:
        """Raise the OSError there was."""
        try:
            self._file.flush()
        except OSError as error:
            self._error = self._error or error
        if self._error is not None:
            raise self._error
