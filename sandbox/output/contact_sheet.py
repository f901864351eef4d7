"""Pictures of many runs on one sheet, drawn with Pillow."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

MOST_PANELS = 400
"""Most pictures on a sheet."""
_WIDEST = 3200
"""Pixels that a sheet is at most wide, while its panels stay readable."""
_PANEL_WIDTHS = (160, 480)
_INK, _FAINT, _PAPER, _ALARM = (40, 46, 56), (232, 234, 238), (255, 255, 255), (214, 39, 40)
_TEXT = 18


@dataclass(frozen=True)
class Panel:
    """One run."""

    label: str
    picture: Path | None
    """None where there is none."""
    alarm: str = ""
    """What went wrong, in a word; empty where nothing did."""


@dataclass(frozen=True)
class Grid:
    """What the columns and rows of a sheet have in common; panels have their own labels where it is empty."""

    columns: tuple[str, ...] = ()
    rows: tuple[str, ...] = ()


def draw_sheet(panels: Sequence[Panel], grid: Grid, title: str) -> Image.Image:
    """Panels, row after row: in the columns of the grid, or in about a square where it has none."""
    panels = panels[:MOST_PANELS]
    across = len(grid.columns) or math.ceil(math.sqrt(len(panels)))
    sizes = [size for panel in panels if (size := _size(panel)) is not None]
    widest = min(_PANEL_WIDTHS[1], max((wide for wide, _ in sizes), default=_PANEL_WIDTHS[0]))
    width = max(_PANEL_WIDTHS[0], min(widest, _WIDEST // across))
    height = min(2 * width, max((round(width * tall / wide) for wide, tall in sizes), default=width * 9 // 16))
    font = ImageFont.load_default(size=_TEXT)
    pad = _TEXT // 2
    left = pad + max((math.ceil(font.getlength(text)) + pad for text in grid.rows), default=0)
    top = 3 * _TEXT + (2 * _TEXT if grid.columns else 0)
    down = math.ceil(len(panels) / across)
    caption = 0 if grid.columns else _TEXT + pad
    size = (left + across * (width + pad), top + down * (height + caption + pad))
    longest = math.ceil(font.getlength(title)) + 2 * pad
    sheet = Image.new("RGB", (max(size[0], longest), size[1]), _PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((pad, pad), title, font=font, fill=_INK)
    for number, text in enumerate(grid.columns):
        above = (left + number * (width + pad) + width / 2, top - _TEXT)
        pen.text(above, _fitting(text, font, width), font=font, fill=_INK, anchor="mm")
    for number, text in enumerate(grid.rows[:down]):
        pen.text((pad, top + number * (height + pad) + height / 2), text, font=font, fill=_INK, anchor="lm")
    for number, panel in enumerate(panels):
        corner = (left + number % across * (width + pad), top + number // across * (height + caption + pad))
        _draw_panel(sheet, panel, corner, (width, height), font)
        if caption:
            place = (corner[0] + width / 2, corner[1] + height + caption / 2)
            pen.text(place, _fitting(panel.label, font, width), font=font, fill=_INK, anchor="mm")
    return sheet


def _size(panel: Panel) -> tuple[int, int] | None:
    if panel.picture is None:
        return None
    with Image.open(panel.picture) as picture:
        return picture.size


def _draw_panel(sheet: Image.Image, panel: Panel, corner: tuple[int, int], size: tuple[int, int], font: Any) -> None:
    """One picture in the middle of its panel; a frame and a word where something went wrong."""
    pen = ImageDraw.Draw(sheet)
    frame = (*corner, corner[0] + size[0] - 1, corner[1] + size[1] - 1)
    pen.rectangle(frame, fill=_FAINT)
    if panel.picture is not None:
        with Image.open(panel.picture) as picture:
            small = picture.convert("RGB")
        small.thumbnail(size, Image.Resampling.LANCZOS)
        sheet.paste(small, (corner[0] + (size[0] - small.width) // 2, corner[1] + (size[1] - small.height) // 2))
    if panel.alarm:
        pen.rectangle(frame, outline=_ALARM, width=4)
        wide = math.ceil(font.getlength(panel.alarm)) + _TEXT
        pen.rectangle((corner[0], corner[1], corner[0] + wide, corner[1] + round(1.6 * _TEXT)), fill=_ALARM)
        pen.text((corner[0] + _TEXT / 2, corner[1] + 0.8 * _TEXT), panel.alarm, font=font, fill=_PAPER, anchor="lm")


def _fitting(text: str, font: Any, width: float) -> str:
    """The text, or its end where it is too long."""
    if font.getlength(text) <= width:
        return text
    while text and font.getlength("…" + text) > width:
        text = text[1:]
    return "…" + text
