"""Pictures and videos that notebooks show by themselves. Needs no notebook, and none of its packages."""

import base64
import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SandboxError

_TYPES = {".mp4": "video/mp4", ".webm": "video/webm", ".gif": "image/gif"}


@dataclass(frozen=True)
class InlinePicture:
    """One picture; a notebook shows it."""

    pixels: NDArray[np.uint8]
    """sRGB, shape (height, width, 3), top row first."""

    @classmethod
    def of_file(cls, path: Path) -> "InlinePicture":
        """The picture of a file. Raises SandboxError where there is none."""
        if not path.exists():
            raise SandboxError(f"{path.parent}: has no {path.name}; the run drew no pictures")
        return cls(np.asarray(iio.imread(path)))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, whose ending says in which format."""
        iio.imwrite(path, self.pixels)

    def _repr_png_(self) -> bytes:
        with io.BytesIO() as data:
            iio.imwrite(data, self.pixels, extension=".png", compress_level=1)
            return data.getvalue()

    def __repr__(self) -> str:
        return f"<picture {self.pixels.shape[1]} x {self.pixels.shape[0]}>"


@dataclass(frozen=True)
class InlineVideo:
    """One video, mp4, webm or gif; a notebook shows it, and keeps it within itself."""

    path: Path

    @classmethod
    def of_folder(cls, folder: Path) -> "InlineVideo":
        """The video of a run folder. Raises SandboxError where there is none."""
        found = [folder / f"video{ending}" for ending in _TYPES if (folder / f"video{ending}").exists()]
        if not found:
            raise SandboxError(f"{folder}: has no video; run with video mp4, webm or gif")
        return cls(found[0])

    def _repr_html_(self) -> str:
        kind = _TYPES[self.path.suffix]
        data = f"data:{kind};base64,{base64.b64encode(self.path.read_bytes()).decode('ascii')}"
        if kind.startswith("image"):
            return f'<img src="{data}">'
        return (
            f'<video controls loop autoplay muted style="max-width: 100%"><source src="{data}" type="{kind}"></video>'
        )

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, str]:
        return {"text/html": self._repr_html_(), "text/plain": repr(self)}

    def __repr__(self) -> str:
        return f"<video {self.path}>"
