"""Taichi arrays made from NumPy arrays; never empty, since kernels take no empty ones."""

from typing import Any

import numpy as np
import taichi as ti

from sandbox.render.types import vec3


def upload(values: Any, element: Any) -> Any:
    """A flat Taichi array of `values`, f32 or i32: few types, because Taichi compiles a copying kernel for each."""
    array = np.ravel(np.asarray(values)).astype(np.float32 if element == ti.f32 else np.int32)
    result = ti.ndarray(element, max(1, array.size))
    if array.size:
        result.from_numpy(array)
    return result


def refill(array: Any, values: Any) -> None:
    """Other values in an i32 array that `upload` has made of as many; of none it has made one that nobody reads."""
    if np.size(values):
        array.from_numpy(np.ascontiguousarray(values, dtype=np.int32))


def vectors(count: int) -> Any:
    """Room for `count` vectors."""
    return ti.ndarray(vec3, max(1, count))


def zeros(element: Any, *shape: int) -> Any:
    """A Taichi array of zeros."""
    result = ti.ndarray(element, shape)
    result.fill(0)
    return result
