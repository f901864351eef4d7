"""The trade as a picture: error against wall time, both logarithmic, one line a scheme."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandbox.scene.model import IntegratorName, Precision
from sandbox.trade.measure import Row, Trade
from sandbox.trade.worker import Status

# Okabe and Ito's colours, which colour-blind readers tell apart; what shares one has another marker.
_LOOK: dict[IntegratorName, tuple[str, str]] = {
    IntegratorName.EXPLICIT_EULER: ("#999999", "x"),
    IntegratorName.SYMPLECTIC_EULER: ("#0072b2", "o"),
    IntegratorName.VELOCITY_VERLET: ("#56b4e9", "s"),
    IntegratorName.MIDPOINT: ("#e69f00", "^"),
    IntegratorName.HEUN: ("#e69f00", "v"),
    IntegratorName.RK4: ("#000000", "D"),
    IntegratorName.IMPLICIT_EULER: ("#009e73", "p"),
    IntegratorName.IMPLICIT_MIDPOINT: ("#009e73", "*"),
    IntegratorName.XPBD: ("#cc79a7", "P"),
    IntegratorName.VBD: ("#d55e00", "h"),
}
_NEAR = 5.0
"""How far from all points the line of real time may lie to be drawn [1]."""
_DASHES = ("solid", "dashed", "dashdot", "dotted")


@dataclass(frozen=True)
class _Line:
    """Rows that differ in their step alone, from long steps to short ones."""

    rows: tuple[Row, ...]
    dash: str

    @property
    def settings(self) -> Any:
        return self.rows[0].settings


def draw(trade: Trade, path: Path, title: str) -> None:
    """Write the picture (PNG, or whatever the path's suffix says)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 4.8), layout="constrained")
    axis = figure.subplots()
    lines = _lines(trade.rows)
    for line in lines:
        _draw_line(axis, line)
    _draw_front(axis, [row for row in trade.rows if row.standing.pareto])
    _frame(axis, trade)
    _draw_unstable(axis, lines)
    heading = f"{title}: what a millisecond buys, over {trade.horizon:.3g} s"
    axis.set_title(heading, fontsize=10, loc="left", parse_math=False)
    figure.legend(loc="outside right upper", fontsize=8, frameon=False, handlelength=3.0)
    figure.savefig(path, dpi=150)


def _lines(rows: Sequence[Row]) -> list[_Line]:
    groups: dict[Any, list[Row]] = {}
    for row in rows:
        key = (row.settings.integrator, row.settings.iterations, row.settings.precision)
        groups.setdefault(key, []).append(row)
    lines, seen = [], dict.fromkeys(IntegratorName, 0)
    for (integrator, _, _), members in groups.items():
        dash = _DASHES[min(seen[integrator], len(_DASHES) - 1)]
        seen[integrator] += 1
        lines.append(_Line(tuple(sorted(members, key=lambda row: -row.settings.dt)), dash))
    return lines


def _is_drawn(row: Row) -> bool:
    return row.status is Status.DONE and math.isfinite(row.seconds[1]) and row.error > 0.0


def _draw_line(axis: Any, line: _Line) -> None:
    color, marker = _LOOK[line.settings.integrator]
    rows = [row for row in line.rows if _is_drawn(row)]
    if not rows:
        return
    x, y = [row.seconds[1] for row in rows], [row.error for row in rows]
    spread = [[row.seconds[1] - row.seconds[0] for row in rows], [row.seconds[2] - row.seconds[1] for row in rows]]
    filled = line.settings.precision is Precision.F32
    axis.errorbar(
        x, y, xerr=spread, color=color, marker=marker, linestyle=line.dash, linewidth=1.2, markersize=5.5,
        elinewidth=0.8, markerfacecolor=color if filled else "white", label=line.settings.line,
    )  # fmt: skip


def _draw_front(axis: Any, rows: list[Row]) -> None:
    """What no other setting beats: a staircase behind the lines, and rings around what timings leave open."""
    sure = sorted((row for row in rows if row.standing.certain), key=lambda row: row.seconds[1])
    if sure:
        x, y = [row.seconds[1] for row in sure], [row.error for row in sure]
        axis.step(x, y, where="post", color="#f0c000", alpha=0.45, linewidth=6.0, zorder=0, label="Pareto front")
    open_ones = [row for row in rows if not row.standing.certain]
    if open_ones:
        x, y = [row.seconds[1] for row in open_ones], [row.error for row in open_ones]
        axis.plot(
            x, y, linestyle="none", marker="o", markersize=12.0, markerfacecolor="none", markeredgecolor="#f0c000",
            markeredgewidth=2.0, zorder=0, label="on it or not: times overlap",
        )  # fmt: skip


def _frame(axis: Any, trade: Trade) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set(xscale="log", yscale="log")
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel("wall time of a simulated second [s]")
    axis.set_ylabel("position error, in body sizes")
    axis.grid(which="major", alpha=0.3)
    _mark_real_time(axis)
    low, high = axis.get_ylim()
    if any(not row.resolved for row in trade.rows):
        axis.axhspan(min(low, 0.5 * trade.smallest), trade.smallest, color="#888888", alpha=0.15, linewidth=0.0)
        axis.text(
            0.01, trade.smallest, "below here the reference does not tell", fontsize=7,
            transform=axis.get_yaxis_transform(), ha="left", va="top",
        )  # fmt: skip
        axis.set_ylim(min(low, 0.5 * trade.smallest), high)


def _mark_real_time(axis: Any) -> None:
    """A line where a second takes a second, or a word at the edge that it lies beyond."""
    low, high = axis.get_xlim()
    transform = axis.get_xaxis_transform()
    if low / _NEAR < 1.0 < high * _NEAR:
        axis.axvline(1.0, color="black", linewidth=0.8, linestyle=(0, (1, 2)))
        axis.text(1.0, 0.01, "real time ", rotation=90, fontsize=7, transform=transform, ha="right", va="bottom")
    elif low >= 1.0:
        axis.text(low, 0.99, "\u25c2 slower than real time", fontsize=7, transform=transform, ha="left", va="top")
    else:
        factor = f"all faster than real time, {1.0 / high:.0f}x and more \u25b8"
        axis.text(high, 0.99, factor, fontsize=7, transform=transform, ha="right", va="top")
        axis.set_xlim(low, high)


def _draw_unstable(axis: Any, lines: Sequence[_Line]) -> None:
    """What diverged stands at the upper edge, where its time would be by that of a stable step of the same line."""
    label: str | None = "diverged, at the edge"
    for line in lines:
        stable = next((row for row in line.rows if _is_drawn(row)), None)
        for row in line.rows:
            if row.status is Status.DIVERGED and stable is not None:
                time = stable.seconds[1] * stable.settings.dt / row.settings.dt
                color, _ = _LOOK[line.settings.integrator]
                axis.plot(
                    [time], [1.0], transform=axis.get_xaxis_transform(), color=color, marker=(8, 2, 0), markersize=9,
                    linestyle="none", clip_on=False, label=label,
                )  # fmt: skip
                label = None
