"""Colours: sRGB to linear light and back, colour maps, a colour-blind safe palette. NumPy only."""

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.appearance import FloatArray
from sandbox.scene.model import ColorBy

BODY_PALETTE = ("#e4572e", "#2e86ab", "#f2a541", "#4ba36b", "#8e5ea2", "#d4638f", "#3bb3c3", "#7a8b99")
"""sRGB colours for bodies that name none: distinct in hue and lightness."""

ENCODE_SIZE = 4096
ENCODE_MAX = 2.0
"""Linear light above which the encoding table is saturated."""

COLORMAPS = {ColorBy.SPEED: "viridis", ColorBy.STRAIN: "turbo"}
"""Colour maps of what colours can show."""

# Anchors of the colour maps, at equal steps; between them is interpolated in sRGB.
_COLORMAP_ANCHORS = {
    "viridis": (
        "#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c", "#22a884", "#44bf70", "#7ad151", "#bddf26",
        "#fde725",
    ),
    "magma": (
        "#000004", "#140e36", "#3b0f70", "#641a80", "#8c2981", "#b73779", "#de4968", "#f7705c", "#fe9f6d", "#fecf92",
        "#fcfdbf",
    ),
    "turbo": (
        "#30123b", "#4145ab", "#4675ed", "#39a2fc", "#1bcfd4", "#24eca6", "#61fc6c", "#a4fc3b", "#d1e834", "#f3c63a",
        "#fe9b2d", "#f36315", "#d93806", "#b11901", "#7a0402",
    ),
}  # fmt: skip


def from_hex(color: str) -> FloatArray:
    """sRGB colour in [0, 1] of "#rrggbb", shape (3,)."""
    return np.array([int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5)])


def to_linear(srgb: FloatArray) -> FloatArray:
    """Linear light of sRGB values in [0, 1], any shape (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, dtype=float)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: FloatArray) -> FloatArray:
    """sRGB values in [0, 1] of linear light, any shape; clipped (IEC 61966-2-1)."""
    linear = np.clip(np.asarray(linear, dtype=float), 0.0, 1.0)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def body_palette(count: int) -> FloatArray:
    """sRGB colours in [0, 1] of `count` bodies, repeating after the palette's length, shape (count, 3)."""
    return np.array([from_hex(BODY_PALETTE[k % len(BODY_PALETTE)]) for k in range(count)]).reshape(count, 3)


def colormap(name: str, count: int = 256) -> FloatArray:
    """Colour map as sRGB in [0, 1], shape (count, 3). Raises KeyError for an unknown name."""
    anchors = np.array([from_hex(color) for color in _COLORMAP_ANCHORS[name]])
    at = np.linspace(0.0, 1.0, count)
    knots = np.linspace(0.0, 1.0, len(anchors))
    return np.stack([np.interp(at, knots, anchors[:, channel]) for channel in range(3)], axis=-1)


def tone_map(linear: FloatArray) -> FloatArray:
    """Linear light to linear light in [0, 1]: the identity up to 0.75, then a soft shoulder."""
    linear = np.asarray(linear, dtype=float)
    knee = 0.75
    over = np.maximum(linear - knee, 0.0)
    return np.where(linear <= knee, linear, knee + (1 - knee) * (1 - np.exp(-over / (1 - knee))))


def encode_table() -> NDArray[np.uint8]:
    """8-bit sRGB of linear light x at entry sqrt(x / ENCODE_MAX) (ENCODE_SIZE - 1), tone mapped."""
    linear = np.linspace(0.0, 1.0, ENCODE_SIZE) ** 2 * ENCODE_MAX
    return np.round(to_srgb(tone_map(linear)) * 255.0).astype(np.uint8)


def encode_table_flat() -> NDArray[np.uint8]:
    """The same without tone mapping, for flat colours that must come out as they went in."""
    linear = np.linspace(0.0, 1.0, ENCODE_SIZE) ** 2 * ENCODE_MAX
    return np.round(to_srgb(linear) * 255.0).astype(np.uint8)


def tint(color: str | None, default: tuple[float, float, float]) -> FloatArray:
    """Linear colour of what may name one as #rrggbb, shape (3,); else the linear ``default``."""
    return np.array(default) if color is None else to_linear(from_hex(color))
