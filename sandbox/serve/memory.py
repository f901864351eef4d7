"""Gives memory back that a long-lived server would gather."""

import contextlib
import ctypes

from sandbox import runtime


def forget_code() -> None:
    """Have Taichi forget what it has compiled, which it keeps else, some 10 MB for every solver there ever was.

    Simulations go on as they were; what they need is compiled again, mostly from the cache on disk.
    """
    runtime.stop()
    trim()


def trim() -> None:
    """Give the system what was freed, where the C library keeps it: 30 MB after a compilation or many connections."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
