"""The long run, and single inputs again: ``python -m tests.fuzz [KIND ...]`` or ``python -m tests.fuzz KIND FILE``."""

import argparse
import math
import random
import sys
from pathlib import Path

from tests.fuzz.campaign import explore, keep
from tests.fuzz.court import MOST_SECONDS, Verdict, court
from tests.fuzz.inputs import Input
from tests.fuzz.kinds import KINDS


def main() -> int:
    """Exit code 1 where an input failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("what", nargs="*", metavar="KIND", help=f"{', '.join(KINDS)}, or one of them and a FILE")
    parser.add_argument("--count", type=int, default=1000, help="inputs of every kind")
    parser.add_argument("--seconds", type=float, default=math.inf, help="time for every kind [s]")
    parser.add_argument("--seed", type=int, help="which inputs; by default others every time")
    given = parser.parse_args()
    names = given.what or list(KINDS)
    if len(names) == 2 and names[1] not in KINDS:
        return _again(names[0], Path(names[1]))
    first = random.randrange(10**9) if given.seed is None else given.seed
    failed = 0
    for name in names:
        with court(KINDS[name]) as opened:
            tally = explore(
                KINDS[name], opened, given.count, first, given.seconds, lambda line: print(line, flush=True)
            )
        print(tally.line(), flush=True)
        if tally.slow is not None and tally.slowest > 0.25 * MOST_SECONDS:
            print(f"  the slowest: {keep(KINDS[name], tally.slow, Verdict('slow'))}")
        for place, count in tally.places.most_common():
            print(f"  {count:5d} x {place}")
        failed += tally.outcomes["failed"]
    return 1 if failed else 0


def _again(name: str, path: Path) -> int:
    with court(KINDS[name]) as opened:
        verdict = opened.judge(KINDS[name], Input("".join(path.suffixes[-1:]), path.read_bytes()))
    print(f"{verdict.outcome} {verdict.place}\n{verdict.message}\n{verdict.seconds:.2f} s, {verdict.megabytes:.0f} MB")
    return int(verdict.failed)


if __name__ == "__main__":
    sys.exit(main())
