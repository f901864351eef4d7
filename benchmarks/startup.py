"""From command to first simulated picture, as whole processes: with an empty kernel cache, and with a full one.

python benchmarks/startup.py
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RUN = [sys.executable, "-m", "sandbox", "run", "jelly", "--seconds", "0.0334", "--quiet", "--json"]


def measure(cache: str, *options: str) -> tuple[float, float]:
    """Wall time of a run of one picture, and of that from the run's start to the first simulated picture [s]."""
    with tempfile.TemporaryDirectory() as out:
        start = time.perf_counter()
        environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": cache}
        done = subprocess.run(
            [*RUN, "--out", out, *options],
            env=environment,
            check=True,
            capture_output=True,
            cwd=Path(__file__).resolve().parent.parent,
        )
        return time.perf_counter() - start, json.loads(done.stdout)["seconds"]["first_step"]


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as cache:
        cold = measure(cache)
        warm = [measure(cache) for _ in range(5)]
        bare = [measure(cache, "--renderer", "none") for _ in range(5)]
    print(f"{'':34}{'process s':>12}{'first simulated picture s':>28}")
    rows = [
        ("empty cache, with renderer", [cold]),
        ("full cache, with renderer", warm),
        ("full cache, no renderer", bare),
    ]
    for name, times in rows:
        wall, first = (statistics.median(column) for column in zip(*times, strict=True))
        print(f"{name:34}{wall:12.2f}{first:28.2f}")


if __name__ == "__main__":
    main()
