"""Animated GIF that plays as far as it got."""

from pathlib import Path
from typing import Any

import numpy as np
from PIL import GifImagePlugin, Image

from sandbox.files import append_at, write_all
from sandbox.output.pictures import Memory, Picture

_SAME = 255
"""Colour of a GIF that stands for what was there before."""


class GifWriter:
    """Animated GIF; its time steps are hundredths of a second, so single pictures last a little more or less.

    A picture stores what has changed since the one before it.
    """

    between_groups = True

    def __init__(self, path: Path, fps: float, memory: Memory | None = None) -> None:
        self._path, self._fps = path, fps
        self._count = 0
        self._file: Any = None
        self._last: Picture | None = None
        if memory is not None and int(memory["count"]):
            self._count, self._last = int(memory["count"]), memory["last"]
            self._file = append_at(path, int(memory["size"]))

    def write(self, picture: Picture) -> None:
        """Append one picture."""
        parts: list[bytes] = []
        if self._file is None:
            self._file = self._path.open("wb", buffering=0)
            head = Image.new("P", (picture.shape[1], picture.shape[0]))
            parts += GifImagePlugin.getheader(head, info={"loop": 0})[0]
        parts += self._what_changed(picture)
        write_all(self._file, b"".join(parts))
        self._count, self._last = self._count + 1, picture

    def _what_changed(self, picture: Picture) -> list[bytes]:
        """The part of a picture that is not as in the last one; what has not changed there is left out."""
        last = picture ^ 255 if self._last is None else self._last
        changed = (picture != last).any(axis=2)
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        top, bottom = (rows[0], rows[-1] + 1) if len(rows) else (0, 1)
        left, right = (columns[0], columns[-1] + 1) if len(columns) else (0, 1)
        part = Image.fromarray(picture[top:bottom, left:right])
        coloured = part.convert("P", palette=Image.Palette.ADAPTIVE, colors=_SAME)
        indices = np.where(changed[top:bottom, left:right], np.asarray(coloured), _SAME).astype(np.uint8)
        shown = Image.fromarray(indices, "P")
        shown.putpalette(coloured.getpalette() or [])
        options: dict[str, Any] = {"duration": self._duration(), "disposal": 1, "include_color_table": True}
        if self._last is not None:
            # Not of the first, which has nothing before it: readers would give all pictures an alpha channel.
            options["transparency"] = _SAME
        return list(GifImagePlugin.getdata(shown, (int(left), int(top)), **options))

    def _duration(self) -> int:
        """Of the next picture [ms]; rounded from the start each time, so that the whole keeps its length."""
        start, end = (round(100.0 * n / self._fps) * 10 for n in (self._count, self._count + 1))
        return max(20, end - start)

    def close(self, indexes: bool = True) -> None:
        """Finish the file."""
        if self._file is not None:
            write_all(self._file, b";")
            self._file.close()

    def settle(self) -> None:
        """Nothing is left to do."""

    def memory(self) -> Memory:
        """How many pictures there are, where the file ends, and the last picture."""
        if self._last is None:
            return {"count": np.array(0)}
        return {"count": np.array(self._count), "size": np.array(self._file.tell()), "last": self._last}
