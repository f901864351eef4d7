"""Writers of pictures: H.264 and VP9 video, GIF, numbered PNG files, or nothing."""

import itertools
from pathlib import Path
from typing import Any, Protocol

import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

_CODECS = {"mp4": "libx264", "webm": "libvpx-vp9"}


class PictureWriter(Protocol):
    """Takes pictures of shape (height, width, 3), one after the other."""

    def write(self, picture: Picture) -> None: ...

    def close(self) -> None: ...


class VideoWriter:
    """H.264 (.mp4) or VP9 (.webm) through imageio's pyav plugin, yuv420p so that every player shows it."""

    def __init__(self, path: Path, kind: str, fps: float) -> None:
        self._path, self._kind, self._fps = path, kind, fps
        self._file: Any = None

    def write(self, picture: Picture) -> None:
        """Append one picture. The first one opens the file: a video without pictures is none."""
        if self._file is None:
            self._file = iio.imopen(self._path, "w", plugin="pyav", extension=f".{self._kind}")
            self._file.init_video_stream(_CODECS[self._kind], fps=float(self._fps), pixel_format="yuv420p")
        self._file.write_frame(picture)

    def close(self) -> None:
        """Finish the file."""
        if self._file is not None:
            self._file.close()


class GifWriter:
    """Animated GIF; its time steps are hundredths of a second, so single pictures last a little more or less."""

    def __init__(self, path: Path, fps: float) -> None:
        self._path = path
        self._fps = fps
        self._pictures: list[Picture] = []

    def write(self, picture: Picture) -> None:
        """Append one picture."""
        self._pictures.append(picture)

    def close(self) -> None:
        """Write the file."""
        if self._pictures:
            # Rounded from the start each time, so that the whole keeps its length.
            ends = [round(100.0 * n / self._fps) * 10 for n in range(len(self._pictures) + 1)]
            durations = [max(20, end - start) for start, end in itertools.pairwise(ends)]
            write_image(self._path, np.stack(self._pictures), duration=durations, loop=0)


class PngWriter:
    """Numbered PNG files in a folder: 00001.png and so on."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self._folder = folder
        self._count = 0

    def write(self, picture: Picture) -> None:
        """Write one picture."""
        self._count += 1
        write_image(self._folder / f"{self._count:05d}.png", picture, compress_level=1)

    def close(self) -> None:
        """Nothing is left to do."""


class NullWriter:
    """Takes pictures and forgets them."""

    def write(self, picture: Picture) -> None:
        """Forget one picture."""

    def close(self) -> None:
        """Nothing is left to do."""


def write_image(path: Path, pixels: Picture, **options: Any) -> None:
    """Write a picture, or several as an animation, in the format of the path's ending. Raises OSError."""
    # By way of the memory: a writer that meets a full disk by itself complains once more when it is collected.
    path.write_bytes(iio.imwrite("<bytes>", pixels, extension=path.suffix, **options))


def video_names(kind: str) -> tuple[str, ...]:
    """What :func:`open_writer` makes in its folder."""
    return () if kind == "none" else ("frames",) if kind == "png" else (f"video.{kind}",)


def open_writer(folder: Path, kind: str, fps: float) -> PictureWriter:
    """A writer of ``kind`` mp4, webm, gif, png or none, into ``folder``: video.KIND, or frames/ for png."""
    if kind in _CODECS:
        return VideoWriter(folder / f"video.{kind}", kind, fps)
    if kind == "gif":
        return GifWriter(folder / "video.gif", fps)
    if kind == "png":
        return PngWriter(folder / "frames")
    return NullWriter()
