"""The court: it sees all that an input may do to it, and is there for the next one."""

import os
import signal
import warnings
from pathlib import Path

import pytest
from hypothesis import strategies as st

from sandbox.errors import SceneError
from tests.fuzz.court import Court
from tests.fuzz.inputs import Input, Kind


def misbehave(path: Path) -> None:
    """Do what the file says."""
    match path.read_text():
        case "hang":
            while True:
                pass
        case "memory":
            bytearray(2_000_000_000)
        case "print":
            print("so")
        case "crash":
            os.kill(os.getpid(), signal.SIGKILL)
        case "warn":
            warnings.warn("so", RuntimeWarning, stacklevel=1)
        case "leave":
            raise SystemExit(3)
        case "refuse":
            raise SceneError("no")
        case "refuse at length":
            error = SceneError("no")
            error.args = ("no " * 200,)
            raise error


KIND = Kind("misbehaviour", st.none, misbehave, short=0)


@pytest.fixture(scope="module")
def opened():
    court = Court([KIND], longest=2.0)
    yield court
    court.close()


@pytest.mark.parametrize(
    ("does", "place"),
    [
        ("hang", "hangs"), ("memory", "MemoryError"), ("print", "prints"), ("crash", "crashes"),
        ("warn", "RuntimeWarning"), ("leave", "SystemExit"), ("refuse at length", "Wrong message"),
    ],
)  # fmt: skip
def test_misbehaviour_is_seen_and_the_next_input_is_judged(does, place, opened):
    verdict = opened.judge(KIND, Input(".txt", does.encode()))
    assert verdict.failed and verdict.place.startswith(place)
    assert opened.judge(KIND, Input(".txt", b"refuse")).outcome == "refused"
    assert opened.judge(KIND, Input(".txt", b"")).outcome == "accepted"
