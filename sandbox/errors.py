"""Errors that a user can meet. Each message is one line: where, what, what to do."""

import difflib
import sys
from collections.abc import Iterable

_LONGEST = 299
"""Most characters of a message..."""
_LONG_WORD = 60
"""... and of a word of one that has more."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """``; did you mean NAME?`` where a known name begins so, or is a letter or two away; else nothing."""
    names = {name.casefold(): name for name in known}
    word = word.casefold()
    near = sorted((name for name in names if len(word) > 2 and name.startswith(word)), key=len)
    # With a smaller share of common letters words merely have some of them, such as tension and dimension.
    near += difflib.get_close_matches(word, names, n=1, cutoff=0.75 if len(word) < 5 else 0.8)
    return f"; did you mean {names[near[0]]}?" if near else ""


def missing_extra(what: str, package: str, extra: str) -> str:
    """That something needs a package of an extra, and how to get it: as a user, and in a checkout."""
    checkout = f"{sys.executable} -m pip install '.[{extra}]'"
    return f"{what} needs {package}: pip install 'softbody-sandbox[{extra}]' (in a checkout: {checkout})"


def one_line(message: str) -> str:
    """A message in one line that a terminal shows; of one that quotes too much, what matters more is left."""
    # Names and paths are quoted as they are, and may have characters in them that a terminal obeys.
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in " ".join(message.split()))
    if len(line) > _LONGEST:
        # Long words are paths, of which the end says most.
        line = " ".join(word if len(word) <= _LONG_WORD else f"...{word[-_LONG_WORD:]}" for word in line.split())
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 105]} ... {line[-100:]}"


class SandboxError(Exception):
    """Base of every error that the sandbox raises on purpose; its text is one line."""

    exit_code = 1

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class SceneError(SandboxError, ValueError):
    """The input is wrong: a scene, a setting, a checkpoint or an output folder."""

    exit_code = 2


class RuntimeUnavailableError(SceneError):
    """The asked-for architecture or precision is not there on this machine."""


class DivergedError(SandboxError, ArithmeticError):
    """The simulation left its bounds. The state before it is kept.

    Attributes
    ----------
    time : simulated time of the first step that left its bounds [s]
    stable_dt : largest stable step at the last good state [s]
    element : what left its bounds first, as the scene names it; empty where that was not looked into
    particles : its particles, in the scene's order
    """

    exit_code = 3

    def __init__(
        self, message: str, time: float, stable_dt: float, element: str = "", particles: tuple[int, ...] = ()
    ) -> None:
        super().__init__(message)
        self.time = time
        self.stable_dt = stable_dt
        self.element = element
        self.particles = particles
