"""Ctrl-C and SIGTERM: a picture is finished first, if that does not take long."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

_GRACE, _AGAIN = 1.0, 0.25
"""How long a picture may still take, and after which time to try once more [s]."""
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Overdue(BaseException):
    """What is on its way takes too long to be waited for."""


class Ending:
    """What ends a server; made by :func:`ended_by_signals`."""

    def __init__(self, hears: bool) -> None:
        self.stop = threading.Event()
        """Set once it is to end."""
        self.was_broken_off = False
        """Whether a picture was not finished."""
        self._hears, self._may_break = hears, False

    @contextlib.contextmanager
    def in_time(self) -> Iterator[None]:
        """The block ends soon after ``stop`` is set, be it in the middle of a picture."""
        self._may_break = True
        try:
            yield
        except Overdue:
            self.was_broken_off = True
        finally:
            self._may_break = False

    @contextlib.contextmanager
    def deaf(self, prepare: Callable[[], None]) -> Iterator[None]:
        """The block calls what cannot be broken off, such as a compiler: a signal ends the process there at once.

        ``prepare`` is called before, to put away what would be lost.
        """
        if not self._hears or self.stop.is_set():
            yield
            return
        prepare()
        before = {number: signal.signal(number, signal.SIG_DFL) for number in _SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _heard(self, number: int, frame: Any) -> None:
        if self.stop.is_set():
            raise KeyboardInterrupt
        self.stop.set()
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, _GRACE, _AGAIN)

    def _is_overdue(self, number: int, frame: Any) -> None:
        if self._may_break:
            raise Overdue


@contextlib.contextmanager
def ended_by_signals() -> Iterator[Ending]:
    """Have the block end by Ctrl-C and SIGTERM; a second one interrupts at once."""
    ending = Ending(hears=threading.current_thread() is threading.main_thread())
    if not ending._hears:
        yield ending
        return
    handlers: dict[int, Any] = dict.fromkeys(_SIGNALS, ending._heard)
    if hasattr(signal, "setitimer"):
        handlers[signal.SIGALRM] = ending._is_overdue
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield ending
    finally:
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
