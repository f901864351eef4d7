"""Whether `sandbox tune` keeps its word: fresh runs of what it found, beside the full grid that it did not run.

    python benchmarks/tune.py [SCENE ...] [--error 0.01] [--budget 0.016] [--horizon SECONDS]

For an error: the settings found, their error in a fresh process, and every setting of the full grid that takes less
than 0.8 of their time, with its error. For a budget: the 95th percentile of the time of a picture in fresh runs.
Some minutes a scene. Run it with the machine alone.
"""

import argparse
import math
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from sandbox.errors import SandboxError
from sandbox.scene.load import load_scene
from sandbox.scene.model import Precision
from sandbox.trade.crew import open_crew
from sandbox.trade.ladder import Choice, ladder
from sandbox.trade.measure import Options, Study
from sandbox.trade.store import Store
from sandbox.trade.trial import Settings
from sandbox.trade.tune import Tuned, tune_budget, tune_error
from sandbox.trade.wording import percent

SCENES = ("jelly", "balloon", "tower", "cloth")
WORKERS = 2
FASTER = 0.8
"""Part of the time of what was found below which a setting of the grid would show the search wrong [1]."""
_WORTH_TIMING = 3.0
"""Estimated time over that of what was found up to which settings of the grid are timed: estimates err [1]."""


def study_of(name: str, options: Options, folder: str) -> Study:
    """A study that knows nothing but the cached reference."""
    return Study(load_scene(name), options, Store(Path(tempfile.mkdtemp(dir=folder))))


def check_error(name: str, error: float, options: Options, folder: str) -> None:
    """The settings found for an error, run afresh, beside the grid."""
    study = study_of(name, options, folder)
    with open_crew(WORKERS) as slots:
        found = tune_error(study, slots, slots[0], error)
    fresh = study_of(name, options, folder)
    fresh.levels = study.levels
    grid = ladder(fresh.prospects, Choice(precisions=tuple(Precision)))
    with open_crew(1) as slots:
        fresh.look_ahead(slots)
        fresh.run(slots, [found.row.settings])
        fresh.time(slots[0], [found.row.settings, *worth_timing(fresh, found, grid)])
    time = fresh.timings[found.row.settings].per_second[1]
    faster = [settings for settings in grid if seconds(fresh, settings) < FASTER * time]
    with open_crew(WORKERS) as slots:
        fresh.run(slots, faster)
    made = fresh.error(found.row.settings, found.reference)
    print(
        f"{name:10} {found.row.settings.label:34} {1e3 * time:7.4g} ms a second, error {percent(made)} "
        f"+- {percent(found.reference.bound)} over {study.horizon:.2g} s; {found.trials} trials, {found.timed} timed, "
        f"of {len(grid)}; faster in the grid: {len(faster)}"
    )
    for settings in faster:
        wrong = fresh.error(settings, found.reference)
        verdict = "WITHIN" if wrong <= error else "beyond"
        print(f"{'':10} {settings.label:34} {1e3 * seconds(fresh, settings):7.4g} ms, {percent(wrong)}: {verdict}")
    sys.stdout.flush()


def seconds(study: Study, settings: Settings) -> float:
    """Time of a simulated second [s]; infinite where it was not worth timing."""
    timing = study.timings.get(settings)
    return math.inf if timing is None or not timing.passes else timing.per_second[1]


def worth_timing(study: Study, found: Tuned, grid: list[Settings]) -> list[Settings]:
    """Settings of the grid that might be as fast as those found."""

    def estimate(settings: Settings) -> float:
        return study.cost(settings, 1.0)

    most = _WORTH_TIMING * estimate(found.row.settings)
    return [settings for settings in grid if estimate(settings) <= most and settings != found.row.settings]


def check_budget(name: str, budget: float, options: Options, folder: str) -> None:
    """The settings found for a budget, timed afresh three times."""
    study = study_of(name, options, folder)
    with open_crew(WORKERS) as slots:
        found = tune_budget(study, slots, slots[0], budget)
    taken = []
    for _ in range(3):
        fresh = study_of(name, options, folder)
        with open_crew(1) as slots:
            fresh.look_ahead(slots)
            fresh.time(slots[0], [found.row.settings])
        taken.append(1e3 * fresh.timings[found.row.settings].frame_quantile(0.95))
    print(
        f"{name:10} {found.row.settings.label:34} error {percent(found.row.error)}; 95 of 100 pictures within "
        f"{1e3 * found.row.frame_95:.3g} ms, in fresh runs {', '.join(f'{t:.3g}' for t in taken)} ms of "
        f"{1e3 * budget:.3g}; {found.trials} trials and {found.timed} timed of {found.grid}",
        flush=True,
    )


def main() -> None:
    """Check the scenes named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--error", type=float, default=0.01)
    parser.add_argument("--budget", type=float, default=0.016)
    parser.add_argument("--horizon", type=float, default=None)
    arguments = parser.parse_args()
    options = replace(Options(workers=WORKERS), horizon=arguments.horizon)
    with tempfile.TemporaryDirectory() as folder:
        for title, check, goal in (("error", check_error, arguments.error), ("budget", check_budget, arguments.budget)):
            print(f"\n{title}: {goal:g}\n{'-' * 20}", flush=True)
            for name in arguments.scenes if math.isfinite(goal) else ():
                try:
                    check(name, goal, options, folder)
                except SandboxError as error:
                    print(f"{name:10} {error}", flush=True)


if __name__ == "__main__":
    main()
