"""A few inputs of every kind, the same ones every time. ``make fuzz`` tries many, others every time."""

from collections import Counter

import pytest

from tests.fuzz.campaign import draw_all, keep
from tests.fuzz.court import court
from tests.fuzz.inputs import Input
from tests.fuzz.kinds import KINDS


@pytest.mark.parametrize("name", KINDS)
def test_inputs_are_taken_or_refused_in_one_line(name: str) -> None:
    outcomes: Counter[str] = Counter()
    with court(KINDS[name]) as opened:

        def judge(tried: Input) -> None:
            verdict = opened.judge(tried)
            outcomes[verdict.outcome] += 1
            if verdict.failed:
                pytest.fail(f"{verdict.place}: {keep(KINDS[name], tried, verdict)}\n{verdict.message}", pytrace=False)

        draw_all(KINDS[name], judge, KINDS[name].short, first_seed=0, shrinks=True)
    assert len(outcomes) > 1, "all alike: the inputs are too good or too bad to find anything"
