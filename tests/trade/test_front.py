"""What timings tell of which setting is better, on rows whose times and errors are made up."""

import csv
import math
from types import SimpleNamespace

import pytest

from sandbox.scene.model import IntegratorName, Precision
from sandbox.trade import plot, results
from sandbox.trade.front import Standing, by_time, is_faster, is_tied, with_standing
from sandbox.trade.measure import NOTHING, Row
from sandbox.trade.trial import Settings
from sandbox.trade.worker import Status, Timing


def row(error: float, low: float, middle: float, high: float, dt: float = 1e-3) -> Row:
    return Row(
        settings=Settings(IntegratorName.RK4, dt, Precision.F64),
        status=Status.DIVERGED if math.isnan(error) else Status.DONE,
        message="",
        error=error,
        resolved=True,
        energy_error=error,
        statistics=NOTHING,
        seconds=(low, middle, high),
        frame_95=middle / 30.0,
    )


NAN = math.nan
ROWS = [
    row(0.10, 1.0, 1.1, 1.2, 1e-2),  # the fastest for certain
    row(0.05, 2.0, 2.2, 2.6, 8e-3),  # its median is the second, but the next may be as fast, and is more accurate
    row(0.02, 2.1, 2.3, 2.4, 4e-3),
    row(0.04, 3.0, 3.1, 3.2, 2e-3),  # beaten for certain
    row(0.01, 5.0, 5.0, 5.0, 1e-3),
    row(NAN, NAN, NAN, NAN, 5e-2),
]


def test_the_front_is_as_sure_as_its_timings():
    standings = [one.standing for one in with_standing(ROWS)]
    assert standings == [
        Standing(True, True, 0),
        Standing(True, False, 1),
        Standing(True, True, 1),
        Standing(False, True, 0),
        Standing(True, True, 0),
        Standing(),
    ]
    assert [standing.word for standing in standings] == ["Pareto", "Pareto?", "Pareto", "", "Pareto", ""]


def test_times_are_in_order_where_all_of_one_are_below_all_of_the_other():
    one, other = row(0.1, 1.0, 1.1, 1.5), row(0.1, 1.4, 1.8, 1.9)
    assert is_tied(one, other) and is_tied(other, one) and not is_faster(one, other)
    other = row(0.1, 1.6, 1.8, 1.9)
    assert is_faster(one, other) and not is_faster(other, one) and not is_tied(one, other)
    assert not is_tied(one, ROWS[-1]) and not is_faster(ROWS[-1], one)
    # One timing is no spread, but equal ones are no order either.
    assert is_tied(row(0.1, 2.0, 2.0, 2.0), row(0.2, 2.0, 2.0, 2.0))
    assert [slower for _, slower in by_time(ROWS)] == [True, True, False, True, True, True]


def test_table_files_and_picture_say_what_timings_leave_open(tmp_path):
    rows = with_standing(ROWS)
    cells = results.table(rows)
    assert [line[-1] for line in cells] == ["Pareto", "Pareto?", "Pareto", "", "Pareto", "diverged"]
    assert [line[6].startswith("~ ") for line in cells] == [False, False, True, False, False, False]
    line = results.noise_line(rows)
    assert line.startswith("times of 1 rows are not told apart") and "1 may be on the front or not (Pareto?)" in line
    assert results.noise_line(rows[:1]) == ""
    results.write_csv([results.row_data(one) for one in rows], tmp_path / "trade.csv")
    with (tmp_path / "trade.csv").open() as file:
        written = list(csv.DictReader(file))
    assert [(one["pareto"], one["pareto_is_certain"], one["time_ties"]) for one in written[:4]] == [
        ("True", "True", "0"), ("True", "False", "1"), ("True", "True", "1"), ("False", "True", "0"),
    ]  # fmt: skip
    trade = SimpleNamespace(rows=rows, smallest=1e-6, horizon=1.0)
    plot.draw(trade, tmp_path / "trade.svg", "noise")
    assert "on it or not" in (tmp_path / "trade.svg").read_text()


@pytest.mark.parametrize("frames", [(0.3,), (0.1, 0.2)])
def test_a_timing_of_one_pass_is_its_own_range(frames):
    low, middle, high = Timing((frames,), fps=30.0).per_second
    assert low == middle == high == pytest.approx(30.0 * sum(frames) / len(frames))
