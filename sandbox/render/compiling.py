"""How the rendering kernels are compiled: in f32, whatever the simulation's precision."""

from collections.abc import Iterator
from contextlib import contextmanager

import taichi as ti
from taichi.lang import impl


@contextmanager
def compiling() -> Iterator[None]:
    """Compile kernels inside with f32 literals: pictures need no more, and f64 would halve their speed."""
    runtime = impl.get_runtime()
    before = runtime.default_fp
    runtime.default_fp = ti.f32
    try:
        yield
    finally:
        runtime.default_fp = before
