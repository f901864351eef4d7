"""Writers of pictures: H.264 and VP9 video, GIF, numbered PNG files, or nothing."""

from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np

from sandbox.output.gif import GifWriter
from sandbox.output.grouped_video import KINDS, VideoWriter
from sandbox.output.pictures import Memory, Picture, PictureWriter


class PngWriter:
    """Numbered PNG files in a folder: 00001.png and so on."""

    between_groups = True

    def __init__(self, folder: Path, memory: Memory | None = None) -> None:
        folder.mkdir(exist_ok=memory is not None)
        self._folder = folder
        self._count = 0 if memory is None else int(memory["count"])

    def write(self, picture: Picture) -> None:
        """Write one picture."""
        self._count += 1
        write_image(self._folder / f"{self._count:05d}.png", picture, compress_level=1)

    def close(self, indexes: bool = True) -> None:
        """Nothing is left to do."""

    def settle(self) -> None:
        """Nothing is left to do."""

    def memory(self) -> Memory:
        """How many pictures there are."""
        return {"count": np.array(self._count)}


class NullWriter:
    """Takes pictures and forgets them."""

    between_groups = True

    def write(self, picture: Picture) -> None:
        """Forget one picture."""

    def close(self, indexes: bool = True) -> None:
        """Nothing is left to do."""

    def settle(self) -> None:
        """Nothing is left to do."""

    def memory(self) -> Memory:
        """Nothing."""
        return {}


def write_image(path: Path, pixels: Picture, **options: Any) -> None:
    """Write a picture in the format of the path's ending. Raises OSError."""
    # By way of the memory: a writer that meets a full disk by itself complains once more when it is collected.
    path.write_bytes(iio.imwrite("<bytes>", pixels, extension=path.suffix, **options))


def video_names(kind: str) -> tuple[str, ...]:
    """What :func:`open_writer` makes in its folder."""
    return () if kind == "none" else ("frames",) if kind == "png" else (f"video.{kind}",)


def open_writer(folder: Path, kind: str, fps: float, memory: Memory | None = None) -> PictureWriter:
    """A writer of ``kind`` mp4, webm, gif, png or none, into ``folder``: video.KIND, or frames/ for png.

    With the ``memory`` of an earlier writer it goes on with what that one left there, whatever came after.
    """
    if kind in KINDS:
        return VideoWriter(folder / f"video.{kind}", KINDS[kind], fps, memory)
    if kind == "gif":
        return GifWriter(folder / "video.gif", fps, memory)
    if kind == "png":
        return PngWriter(folder / "frames", memory)
    return NullWriter()
