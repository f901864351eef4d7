"""How tables of studies word their numbers."""

import math


def percent(part: float) -> str:
    """A part of one, in percent; nothing where there is none."""
    return "" if math.isnan(part) else f"{100.0 * part:.2g} %"


def milliseconds(seconds: tuple[float, float, float]) -> str:
    """Median and range of a time, from its least, median and most [s]; nothing where there is none."""
    low, middle, high = seconds
    return "" if math.isnan(middle) else f"{1e3 * middle:.4g} ({1e3 * low:.4g}-{1e3 * high:.4g})"
