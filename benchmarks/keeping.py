"""Times runs with and without what they keep to go on after a kill: a checkpoint at most 2 s old, a video that plays.

Run `python benchmarks/keeping.py [--seconds 4] [--rounds 3]`. Whole runs of presets with a video, in turns: with
checkpoints as they are, and with none but at the end. Medians of the wall time from the first picture on, and the
part of it that writing checkpoints took, by the run's own clock. That part may be 2 %.
"""

import argparse
import statistics
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from sandbox import SceneWarning, load_scene, unfinished
from sandbox.headless import RunOptions, run

PRESETS = ("drop_2d", "boxes_2d", "jelly", "cloth", "pile", "trampoline")


def seconds_of(preset: str, seconds: float, folder: Path) -> tuple[float, float]:
    """Wall time of a run without its start, and the part of it that went into checkpoints [s]."""
    scene = load_scene(preset, overrides={"duration": seconds})
    spent = run(scene, RunOptions(preset, out=folder)).seconds
    return spent["total"] - spent["first_step"], spent["keep"]


def measure(preset: str, seconds: float, rounds: int) -> None:
    """Print one preset."""
    due: Callable[..., bool] = unfinished.Pace.is_due
    ways = {"kept": due, "not kept": lambda *_: False}
    times: dict[str, list[float]] = {name: [] for name in ways}
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(rounds + 1):
            for name, is_due in ways.items():
                unfinished.Pace.is_due = is_due  # type: ignore[method-assign]
                total, keeping = seconds_of(preset, seconds, Path(folder))
                if number:  # the first round compiles
                    times[name].append(total)
                    parts.extend([keeping / total] if name == "kept" else [])
    unfinished.Pace.is_due = due  # type: ignore[method-assign]
    kept, plain = (statistics.median(times[name]) for name in ways)
    part = 100.0 * statistics.median(parts)
    print(f"{preset:11s} kept {kept:6.2f} s   not kept {plain:6.2f} s   writing {part:4.2f} %", flush=True)


def main() -> None:
    """Measure all presets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    warnings.simplefilter("ignore", SceneWarning)
    for preset in PRESETS:
        measure(preset, options.seconds, options.rounds)


if __name__ == "__main__":
    main()
