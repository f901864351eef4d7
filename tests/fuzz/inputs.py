"""What an input is, and a kind of inputs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sandbox.errors import SandboxError

LONGEST_MESSAGE = 300
"""Characters that an error has fewer of."""


class Input(NamedTuple):
    """A file, whatever it is that is tried: an input that failed can be kept, sent and tried again."""

    suffix: str
    data: bytes


Attempt = Callable[[Path], object]
"""Takes the file of an input, in the process that judges. Raises SandboxError where it is refused."""


def nothing() -> None:
    """Prepare nothing."""


@dataclass(frozen=True)
class Kind:
    """Inputs of one kind, and what takes them. Its functions have names, by which another process finds them."""

    name: str
    drawn: Callable[[], Any]
    """Makes the strategy of hypothesis that draws an :class:`Input`."""
    attempt: Attempt
    short: int
    """How many are tried in the suite."""
    prepare: Callable[[], object] = nothing
    """Imports, and starts, what every attempt needs; counts for none."""


def start_taichi() -> None:
    """Start Taichi before memory is bounded: it takes addresses for much that it does not use."""
    from sandbox import runtime

    runtime.start(threads=1)


class Wrong(Exception):
    """An input was taken, and what came of it is not right."""


def check_message(error: SandboxError) -> None:
    """Raise Wrong where what the user is told is not one short line that any terminal can show."""
    text = str(error)
    if not 0 < len(text) < LONGEST_MESSAGE or not text.isprintable():
        raise Wrong(f"is refused, but not in a line of less than {LONGEST_MESSAGE} characters: {text[:400]!r}")
