"""The colour scale's legend, drawn once with Pillow."""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont


def ticks(top: float, count: int = 5) -> list[float]:
    """Round values from 0 to at most `top`, about `count` of them."""
    step = top / count
    power = 10.0 ** math.floor(math.log10(step))
    step = next(factor * power for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= step * 0.999)
    return [k * step for k in range(math.floor(top / step * 1.0001) + 1)]


@cache
def _font(size: int) -> Any:
    return ImageFont.load_default(size=size)


def draw_legend(title: str, top: float, colormap: NDArray[np.float64], height: int) -> NDArray[np.uint8]:
    """Legend of a colour scale from 0 to `top`, sized for a picture `height` pixels high.

    `colormap` is sRGB in [0, 1], shape (count, 3). Returns RGBA, shape (rows, columns, 4).
    """
    text = max(9, round(height * 0.022))
    font = _font(text)
    bar_height, bar_width, pad = round(height * 0.30), max(6, round(height * 0.022)), max(4, round(height * 0.016))
    labels = [(value, f"{value:.6g}") for value in ticks(top)]
    label_width = max(int(font.getlength(label)) for _, label in labels)
    columns = 3 * pad + max(int(font.getlength(title)), bar_width + pad + label_width)
    rows = bar_height + 3 * pad + 2 * text
    image = Image.new("RGBA", (columns, rows), (0, 0, 0, 0))
    pen = ImageDraw.Draw(image)
    pen.rounded_rectangle((0, 0, columns - 1, rows - 1), radius=pad, fill=(255, 255, 255, 190))
    ink = (40, 46, 56, 255)
    pen.text((pad, pad * 0.7), title, font=font, fill=ink)
    bar_top = round(1.8 * pad + text + text * 0.4)
    rgb = np.round(colormap[np.linspace(len(colormap) - 1, 0, bar_height).round().astype(int)] * 255)
    bar = np.broadcast_to(rgb[:, None, :].astype(np.uint8), (bar_height, bar_width, 3))
    image.paste(Image.fromarray(np.ascontiguousarray(bar)), (pad, bar_top))
    for value, label in labels:
        y = bar_top + (bar_height - 1) * (1.0 - value / top)
        pen.line((pad + bar_width, y, pad + bar_width + pad * 0.4, y), fill=ink)
        pen.text((pad + bar_width + pad * 0.8, y), label, font=font, fill=ink, anchor="lm")
    return np.asarray(image)


def blend(picture: NDArray[np.uint8], overlay: NDArray[np.uint8], left: int, top: int) -> None:
    """Lay an RGBA overlay over part of a picture, in place; what does not fit is cut off."""
    area = picture[top : top + overlay.shape[0], left : left + overlay.shape[1]]
    overlay = overlay[: area.shape[0], : area.shape[1]]
    alpha = overlay[..., 3:].astype(np.uint16)
    mixed = overlay[..., :3] * alpha + area * (255 - alpha)
    area[...] = ((mixed + 127) // 255).astype(np.uint8)


def mark(picture: NDArray[np.uint8], points: NDArray[np.float64], label: str) -> NDArray[np.uint8]:
    """A copy of the picture with a ring around points, pixel x and y of shape (N, 2), and a label beside it."""
    height, width = picture.shape[:2]
    image = Image.fromarray(picture)
    pen = ImageDraw.Draw(image)
    size = max(10, round(height * 0.024))
    font, pad = _font(size), round(size * 0.4)
    # What has left the picture is pointed at from its edge.
    inside = np.clip(np.nan_to_num(points), (pad, pad), (width - 1 - pad, height - 1 - pad))
    centre = inside.mean(axis=0)
    radius = max(0.03 * height, float(np.linalg.norm(inside - centre, axis=1).max()) + size)
    ring, line = (214, 39, 40), max(2, round(height / 240))
    pen.ellipse((*(centre - radius), *(centre + radius)), outline=ring, width=line)
    for x, y in inside:
        pen.ellipse((x - line, y - line, x + line, y + line), fill=ring)
    wide = float(font.getlength(label))
    left = float(np.clip(centre[0] - wide / 2, pad, max(width - wide - 3 * pad, pad)))
    top = centre[1] + radius + pad
    if top + size + 2 * pad > height:
        top = centre[1] - radius - size - 3 * pad
    pen.rounded_rectangle((left, top, left + wide + 2 * pad, top + size + 2 * pad), radius=pad, fill=(255, 255, 255))
    pen.text((left + pad, top + pad * 0.7), label, font=font, fill=(40, 46, 56))
    return np.asarray(image)
