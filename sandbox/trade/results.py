"""A study's findings as files and as a table."""

import contextlib
import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sandbox.output.folder import RunFolder
from sandbox.scene.load import to_toml
from sandbox.scene.model import Scene
from sandbox.trade.crew import open_crew
from sandbox.trade.front import by_time
from sandbox.trade.measure import Options, Row, Study, Trade, measure
from sandbox.trade.models import ModelTrade, measure_models
from sandbox.trade.progress import progress_bar
from sandbox.trade.store import Store
from sandbox.trade.tune import Target, Tuned, tune_budget, tune_error
from sandbox.trade.wording import milliseconds, percent

COLUMNS = ("integrator", "iterations", "precision", "dt [ms]", "error", "energy error", "ms/simulated s",
           "x real time", "")  # fmt: skip


UNFINISHED = ".study"
"""Folder of finished rows within that of a study, until the study is done."""


def report_trade(
    scene: Scene, name: str, options: Options, out: Path | None, fresh: bool, silent: bool
) -> tuple[Trade, Path]:
    """Measure a scene and leave a folder; what was found, and where.

    ``fresh`` forgets what an interrupted study has finished. Raises SceneError where the scene cannot be built,
    DivergedError where it has no reference; finished rows stay for the next time, and nothing else.
    """
    path = out or Path("outputs") / f"{name}-trade"
    names = ("scene.toml", "trade.json", "trade.csv", "trade.png")
    with _study_folder(path, fresh, names) as (folder, store):
        with progress_bar(silent) as progress:
            trade = measure(scene, options, store, progress)
        write(name, trade, folder)
    return trade, path


def report_models(
    scene: Scene, name: str, options: Options, out: Path | None, fresh: bool, silent: bool
) -> tuple[ModelTrade, Path]:
    """Measure what the parts of a scene cost and are worth, and leave a folder; see :func:`report_trade`."""
    path = out or Path("outputs") / f"{name}-models"
    with _study_folder(path, fresh, ("scene.toml", "models.json", "models.csv")) as (folder, store):
        with progress_bar(silent) as progress:
            trade = measure_models(scene, options, store, progress)
        folder.write_text("scene.toml", to_toml(scene))
        folder.write_json("models.json", {"name": name, **trade.plain()})
        write_csv([row.plain() for row in trade.rows], folder.partial / "models.csv")
    return trade, path


@contextlib.contextmanager
def _study_folder(path: Path, fresh: bool, names: Sequence[str]) -> Iterator[tuple[RunFolder, Store]]:
    """A folder that is published if the block ends well, and finished rows, which stay if it does not."""
    folder, store = RunFolder(path, names), Store(path / UNFINISHED)
    if fresh:
        store.clear()
        store = Store(path / UNFINISHED)
    with folder.discarded_on_failure():
        yield folder, store
        folder.publish()
    store.clear()


def report_tuned(
    scene: Scene, name: str, options: Options, out: Path | None, fresh: bool, silent: bool, target: Target
) -> tuple[Tuned, float, Path]:
    """Find the settings that meet a target, and leave a folder; what was found, the time looked at [s], and where.

    Raises SceneError where the scene cannot be built, SandboxError where nothing meets the target; finished rows stay
    for the next time then, and nothing else.
    """
    path = out or Path("outputs") / f"{name}-tune"
    with _study_folder(path, fresh, ("tuned.toml", "tune.json")) as (folder, store):
        with progress_bar(silent) as progress, contextlib.ExitStack() as stack:
            study = Study(scene, options, store, progress)
            slots = stack.enter_context(open_crew(options.workers, options.cluster))
            timer = stack.enter_context(open_crew(1))[0] if options.cluster else slots[0]
            search, goal = (tune_error, target.error) if target.error else (tune_budget, target.budget)
            assert goal is not None
            tuned = search(study, slots, timer, goal)
        folder.write_text("tuned.toml", tuned_fragment(target, tuned, study.horizon))
        folder.write_json("tune.json", tuned_data(name, target, tuned, study.horizon))
    return tuned, study.horizon, path


def tuned_data(name: str, target: Target, tuned: Tuned, horizon: float) -> dict[str, Any]:
    """What a search found, as plain data."""
    return {
        "name": name,
        **asdict(target),
        "horizon": horizon,
        "predictable": tuned.predictable,
        "reference_bound": tuned.reference.bound,
        "trials": tuned.trials,
        "timed": tuned.timed,
        "grid": tuned.grid,
        "found": row_data(tuned.row),
        "as_fast": [row.settings.label for row in tuned.as_fast],
        "others": [row_data(row) for row in tuned.others],
        "warnings": list(tuned.unseen),
    }


def tuned_fragment(target: Target, tuned: Tuned, horizon: float) -> str:
    """The settings that were found as TOML, and what to know of them in comments."""
    row, bound = tuned.row, tuned.reference.bound
    low, middle, high = row.seconds
    error = percent(row.error) + (f" +- {percent(bound)}" if row.resolved else " at most")
    wanted = (
        f"the most accurate of those that simulate 95 of 100 pictures within {1e3 * target.budget:.3g} ms"
        if target.budget
        else f"the cheapest of those within {percent(target.error or math.nan)} of the body's size"
    )
    lines = [
        f"{wanted}, over {tuned.predictable:.3g} s",
        f"error {error} of the body's size; {1e3 * middle:.3g} ms a simulated second ({1e3 * low:.3g} to "
        f"{1e3 * high:.3g}), 95 of 100 pictures within {1e3 * row.frame_95:.3g} ms, drawing apart",
        f"{tuned.trials} settings run and {tuned.timed} timed, of {tuned.grid} that a full grid has",
    ]
    if tuned.as_fast and not target.budget:
        others = ", ".join(f"{other.settings.label} ({percent(other.error)})" for other in tuned.as_fast)
        lines.append(f"as fast, for all that timings tell: {others}")
    if tuned.predictable < 0.999 * horizon:
        lines.append(f"chaotic after {tuned.predictable:.3g} of {horizon:.3g} s: no error is known from there on")
    lines += [f"warning: {line}" for line in tuned.unseen]
    return "".join(f"# {line}\n" for line in lines) + row.settings.fragment()


def write(name: str, trade: Trade, folder: RunFolder) -> None:
    """All files of a study."""
    from sandbox.trade.plot import draw

    folder.write_text("scene.toml", to_toml(trade.scene))
    folder.write_json("trade.json", trade_data(name, trade))
    write_csv([row_data(row) for row in trade.rows], folder.partial / "trade.csv")
    draw(trade, folder.partial / "trade.png", trade.scene.title or name)


def row_data(row: Row) -> dict[str, Any]:
    """A row as plain data; times in seconds, errors as parts of one."""
    low, middle, high = row.seconds
    settings = row.settings
    return {
        "integrator": str(settings.integrator),
        "iterations": settings.iterations,
        "precision": str(settings.precision),
        "dt": settings.dt,
        "status": str(row.status),
        "error": row.error,
        "error_is_bound": not row.resolved,
        "energy_error": row.energy_error,
        **{f"{name}_difference": value for name, value in asdict(row.statistics).items()},
        "seconds": middle,
        "seconds_low": low,
        "seconds_high": high,
        "frame_95": row.frame_95,
        "real_time_factor": row.real_time_factor,
        "pareto": row.standing.pareto,
        "pareto_is_certain": row.standing.certain,
        "time_ties": row.standing.ties,
        "message": row.message,
    }


def trade_data(name: str, trade: Trade) -> dict[str, Any]:
    """A whole study as plain data."""
    reference = trade.reference
    return {
        "name": name,
        "horizon": trade.horizon,
        "predictable": trade.predictable,
        "reference": {
            "integrator": str(reference.settings.integrator),
            "precision": str(reference.settings.precision),
            "dt": reference.settings.dt,
            "bound": reference.bound,
            "halvings": list(reference.differences),
        },
        "smallest_error": trade.smallest,
        "statistics_bound": asdict(trade.statistics_bound),
        "rows": [row_data(row) for row in trade.rows],
        "warnings": list(trade.unseen),
    }


def write_csv(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Rows of equal keys as a table; numbers that are not there are left empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows({key: "" if _is_missing(value) else value for key, value in row.items()} for row in rows)


def _is_missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def table(rows: Iterable[Row]) -> list[tuple[str, ...]]:
    """Rows as text under COLUMNS, the fastest first; what diverged at the end.

    A time that may be no longer than that of the row above is marked as such.
    """
    return [_cells(row, slower) for row, slower in by_time(list(rows))]


def _cells(row: Row, slower: bool) -> tuple[str, ...]:
    error = "" if math.isnan(row.error) else f"{'' if row.resolved else '< '}{percent(row.error)}"
    return (
        str(row.settings.integrator),
        "" if row.settings.iterations is None else str(row.settings.iterations),
        str(row.settings.precision),
        f"{1e3 * row.settings.dt:.4g}",
        error,
        percent(row.energy_error),
        ("" if slower else "~ ") + milliseconds(row.seconds),
        "" if math.isnan(row.real_time_factor) else f"{row.real_time_factor:.3g}",
        row.standing.word if math.isfinite(row.error) else str(row.status),
    )


def summary(trade: Trade | ModelTrade) -> str:
    """What to know of a study before reading its table."""
    reference = trade.reference
    lines = [
        f"over {trade.horizon:.3g} s, against {reference.settings.label}, itself within {percent(reference.bound)}"
        f"; smallest error told apart: {percent(trade.smallest)}"
    ]
    if trade.predictable < trade.horizon * (1.0 - 1e-9):
        lines.append(
            f"two references agree for {trade.predictable:.3g} s: positions and energies are compared up to there, "
            "statistics from there on"
        )
    if isinstance(trade, Trade) and (noise := noise_line(trade.rows)):
        lines.append(noise)
    return "\n".join(lines)


def noise_line(rows: Sequence[Row]) -> str:
    """What timings do not tell, for readers of a table; nothing where they tell all."""
    tied = sum(not slower for _, slower in by_time(rows))
    unsure = sum(row.standing.pareto and not row.standing.certain for row in rows)
    if not tied:
        return ""
    line = f"times of {tied} rows are not told apart from those of the row above (~): their repetitions overlap"
    return line + (f"; so {unsure} may be on the front or not (Pareto?)" if unsure else "")
