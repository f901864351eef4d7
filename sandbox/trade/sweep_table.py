"""The table of a sweep: as CSV and JSON, for a terminal, and as a sheet of posters."""

import csv
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sandbox import __version__
from sandbox.output.contact_sheet import MOST_PANELS, Grid, Panel, draw_sheet
from sandbox.trade.combinations import Combination, Variation, short_names


@dataclass(frozen=True)
class Row:
    """One combination, and what came of it."""

    values: dict[str, Any]
    """Of the varied keys."""
    label: str
    folder: str
    """Within that of the sweep."""
    status: str
    """done, diverged, refused or crashed."""
    message: str
    simulated: float | None = None
    """[s]; None where nothing came of it, as all below."""
    real_time_factor: float | None = None
    """Simulated seconds a second [1], with the other workers at work beside it."""
    dt: float | None = None
    """Longest step [s]."""
    stable_dt: float | None = None
    """Stability limit at the start [s]."""
    energy_end: dict[str, float] | None = None
    """[J]"""
    energy_unexplained: float | None = None
    """Change of the total energy that no term explains [J]; None without diagnostics.ledger."""
    max_strain: float | None = None
    """[1]"""
    torn_springs: int | None = None
    state_sha256: str | None = None
    seconds: float | None = None
    """Wall time of the run, compilation and drawing included [s]."""


_FROM_SUMMARY = (
    "simulated", "real_time_factor", "dt", "stable_dt", "energy_end", "energy_unexplained", "max_strain",
    "torn_springs", "state_sha256",
)  # fmt: skip


def row_of(combination: Combination, result: Any) -> Row:
    """The row of a combination's :class:`sandbox.trade.sweep.Result`."""
    summary = result.summary
    known = {} if summary is None else {name: summary[name] for name in _FROM_SUMMARY}
    if summary is not None:
        known["seconds"] = summary["seconds"]["total"]
    return Row(combination.values, combination.label, combination.name, result.status, result.message, **known)


def write_tables(folder: Path, name: str, title: str, variations: Sequence[Variation], rows: Sequence[Row]) -> None:
    """sweep.csv and sweep.json: one row a combination, in their order."""
    data = {
        "name": name,
        "title": title,
        "sandbox": __version__,
        "vary": {variation.key: variation.values for variation in variations},
        "rows": [asdict(row) for row in rows],
    }
    (folder / "sweep.json").write_text(json.dumps(data, indent=2, default=str) + "\n", encoding="utf-8")
    flat = [_flat(row) for row in rows]
    # A column that no row has anything in is left out, but for those that every sweep has.
    columns = dict.fromkeys(key for line in flat for key in line)
    if not any(row.energy_unexplained is not None for row in rows):
        columns.pop("energy_unexplained")
    with (folder / "sweep.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns), restval="", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(flat)


def _flat(row: Row) -> dict[str, Any]:
    data = asdict(row)
    values = {key: v if isinstance(v, str) else json.dumps(v, default=str) for key, v in data.pop("values").items()}
    data.pop("label")
    tail = {name: data.pop(name) for name in ("message", "folder")}
    energies = data.pop("energy_end") or {}
    flat: dict[str, Any] = dict(values)
    for key, value in data.items():
        if key == "energy_unexplained":  # beside the other energies
            flat |= {f"energy_{name}": energies.get(name) for name in ("kinetic", "elastic", "gravity", "gas", "total")}
        flat[key] = value
    return {**flat, **tail}


def table(variations: Sequence[Variation], rows: Sequence[Row]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and lines for a terminal: the varied keys and the main numbers."""
    numbers: dict[str, Callable[[Row], float | None]] = {
        "simulated [s]": lambda row: row.simulated,
        "x real time": lambda row: row.real_time_factor,
        "dt [s]": lambda row: row.dt,
        "stable dt [s]": lambda row: row.stable_dt,
        "energy [J]": lambda row: None if row.energy_end is None else row.energy_end["total"],
        "max strain": lambda row: row.max_strain,
        "torn": lambda row: row.torn_springs or None,
        "unexplained [J]": lambda row: row.energy_unexplained,
    }
    for name in ("torn", "unexplained [J]"):
        if all(numbers[name](row) is None for row in rows):
            del numbers[name]
    short = short_names([variation.key for variation in variations])
    lines = []
    for row in rows:
        texts = [_text(row.values[variation.key]) for variation in variations]
        lines.append((*texts, row.status, *(_number(take(row)) for take in numbers.values())))
    return (*short, "status", *numbers), lines


def _text(value: Any) -> str:
    return value if isinstance(value, str) else _number(value) if isinstance(value, float) else json.dumps(value)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def write_sheet(path: Path, folder: Path, title: str, variations: Sequence[Variation], rows: Sequence[Row]) -> None:
    """The posters of all runs in a sweep's folder, drawn to ``path``.

    The last key's values are beside each other, the others' below each other.
    """
    panels = [
        Panel(row.label, picture if (picture := folder / row.folder / "poster.png").exists() else None, _alarm(row))
        for row in rows
    ]
    grid = Grid()
    if len(variations) > 1:
        across = len(variations[-1].values)
        name = short_names([variation.key for variation in variations])[-1]
        grid = Grid(
            columns=tuple(f"{name}={text}" for text in variations[-1].texts),
            rows=tuple(row.label.rpartition(f", {name}=")[0] for row in rows[::across]),
        )
    more = f", the first {MOST_PANELS} of {len(rows)}" if len(rows) > MOST_PANELS else ""
    draw_sheet(panels, grid, f"{title}{more}").save(path, format="PNG")


def _alarm(row: Row) -> str:
    if row.status == "diverged" and row.simulated is not None and math.isfinite(row.simulated):
        return f"diverged at {row.simulated:.3g} s"
    return "" if row.status == "done" else row.status
