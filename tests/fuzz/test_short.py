"""A few inputs of every kind, the same ones every time. ``make fuzz`` tries many, others every time."""

from collections import Counter
from collections.abc import Iterator

import pytest

from tests.fuzz.campaign import draw_all, keep
from tests.fuzz.court import Court, court
from tests.fuzz.inputs import Input
from tests.fuzz.kinds import KINDS


@pytest.fixture(scope="module")
def opened() -> Iterator[Court]:
    with court(*KINDS.values()) as one:
        yield one


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_inputs_are_taken_or_refused_in_one_line(name: str, opened: Court) -> None:
    kind, outcomes = KINDS[name], Counter[str]()

    def judge(tried: Input) -> None:
        verdict = opened.judge(kind, tried)
        outcomes[verdict.outcome] += 1
        if verdict.failed:
            pytest.fail(f"{verdict.place}: {keep(kind, tried, verdict)}\n{verdict.message}", pytrace=False)

    draw_all(kind, judge, kind.short, first_seed=0, shrinks=True)
    assert len(outcomes) > 1, "all alike: the inputs are too good or too bad to find anything"
