"""The only place that starts Taichi: architecture, precision, threads, log level.

Starting Taichi anew kills every field, so whoever owns fields registers here and is told to save
itself first (:func:`register`). Types for fields come from here too, so that one precision truly
reaches every field and kernel.

Taichi keeps all code that it ever compiled, some megabytes for every simulation, and knows code again on
disk by the numbers of the fields that it works on, which are never given twice. So it is started anew
as well once nobody holds anything in it: no sweep grows, and its later runs find their code compiled.
"""

import contextlib
import gc
import io
import os
import sys
import warnings
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import taichi as ti
from taichi.lang._ndarray import Ndarray
from taichi.lang.field import Field

from sandbox import kernel_cache
from sandbox.compiling import quicken
from sandbox.errors import RuntimeUnavailableError

ARCHITECTURES = ("cpu", "cuda", "vulkan", "metal")
_OF_MANY_KINDS = ("vulkan", "metal")
"""What these run on may lack what every CPU and CUDA device has."""
# These variables would silently overrule what start() is asked for.
_OVERRULING = ("TI_ARCH", "TI_DEFAULT_FP", "TI_CPU_MAX_NUM_THREADS", "TI_FAST_MATH")


class Suspendable(Protocol):
    """An owner of fields that can let go of them and build them again later."""

    def suspend(self) -> None: ...


@dataclass(frozen=True)
class Settings:
    """What Taichi was started with."""

    arch: str
    precision: str
    threads: int | None
    verbose: bool


_MOST_TREES = 480

_current: Settings | None = None
_trees = 0
_owners: "weakref.WeakSet[Any]" = weakref.WeakSet()
_owned: "weakref.WeakSet[Any]" = weakref.WeakSet()
"""Fields that an owner answers for, and all of the times before Taichi was last started: kernels hold on to some."""


def start(arch: str = "cpu", precision: str = "f32", threads: int | None = None, verbose: bool = False) -> None:
    """Start Taichi, unless it runs with just these settings already and somebody uses it.

    ``precision`` is "f32" or "f64"; ``threads`` None means all cores. Raises RuntimeUnavailableError
    where the architecture or the precision is not there.
    """
    global _current
    wanted = Settings(arch, precision, threads, verbose)
    if wanted == _current and not _is_idle():
        return
    _check(wanted)
    quicken()
    _stop()
    _initialise(wanted)
    if wanted.arch in _OF_MANY_KINDS and not _has_doubles():
        ti.reset()
        raise RuntimeUnavailableError(f"arch {wanted.arch!r}: the device has no numbers of 64 bits; use --arch cpu")
    _current = wanted


def stop() -> None:
    """Give back all that Taichi holds, and have it write what it compiled to its cache on disk.

    Simulations that are still wanted save themselves, and start it anew when they go on.
    """
    _stop()
    ti.reset()


def _stop() -> None:
    global _current, _trees
    for owner in list(_owners):
        owner.suspend()
    _owners.clear()
    # An array of Taichi's that is collected after Taichi has started anew takes the memory of a new one with it.
    gc.collect()
    _owned.update(_alive())
    _current, _trees = None, 0


def settings() -> Settings:
    """What Taichi was last started with. Starts it with the defaults if need be."""
    if _current is None:
        start()
    assert _current is not None
    return _current


def register(owner: Suspendable) -> None:
    """Have ``owner.suspend()`` called before Taichi is started anew, which it is not of itself before then."""
    _owners.add(owner)


def unregister(owner: Suspendable) -> None:
    """``owner`` holds nothing in Taichi any more."""
    _owners.discard(owner)


def own(field: Field) -> None:
    """``field`` goes where its owner goes: it does not keep Taichi from being started anew."""
    # Taichi makes two more for derivatives.
    _owned.update(each for each in (field, field.grad, field.dual) if each is not None)


def _is_idle() -> bool:
    """Whether there were fields, and nobody needs any now: neither this package nor who else uses Taichi here."""
    if not _trees:
        return False
    gc.collect()  # what nobody has closed may lie in a circle
    if _owners:
        return False
    return not any(each not in _owned for each in _alive())


def _alive() -> list[Any]:
    """All fields and arrays of Taichi's that there are."""
    objects = gc.get_objects()
    kinds = {kind for kind in set(map(type, objects)) if issubclass(kind, Field | Ndarray)}
    return [each for each in objects if type(each) in kinds]


def fields_builder() -> ti.FieldsBuilder:
    """A new tree of fields. Taichi has room for 512 trees and never takes one back by itself."""
    global _trees
    if _trees >= _MOST_TREES:
        wanted = settings()
        _stop()
        start(**vars(wanted))
    _trees += 1
    return ti.FieldsBuilder()


def give_up(builder: ti.FieldsBuilder) -> None:
    """Leave Taichi where not all fields of a tree came to be, for want of memory: it does nothing more beside such."""
    # Those who still save themselves have Taichi look at every field that it has not seen yet.
    pending = ti.lang.impl.get_runtime()
    pending.unfinalized_fields_builder.pop(builder, None)
    for fields in (pending.global_vars, pending.grad_vars, pending.dual_vars, pending.matrix_fields):
        fields.clear()
    stop()


def packs_fields() -> bool:
    """True where Taichi lays fields of a tree end to end, whatever alignment their types need."""
    return settings().arch == "vulkan"


def lacks_functions() -> bool:
    """True where the device has sines, logarithms and the like for numbers of 32 bits alone, and 64 are wanted."""
    return settings().arch == "vulkan" and settings().precision == "f64"


def real() -> Any:
    """Taichi's scalar type of the current precision."""
    return ti.f64 if settings().precision == "f64" else ti.f32


def vector(dimension: int) -> Any:
    """Taichi's vector type of the current precision."""
    return ti.types.vector(dimension, real())


def check(arch: str, precision: str, threads: int | None) -> None:
    """Raises RuntimeUnavailableError where Taichi could not be started with these settings."""
    _check(Settings(arch, precision, threads, verbose=False))


def _check(wanted: Settings) -> None:
    if wanted.arch not in ARCHITECTURES:
        raise RuntimeUnavailableError(f"arch {wanted.arch!r}: must be one of {', '.join(ARCHITECTURES)}")
    if wanted.precision not in ("f32", "f64"):
        raise RuntimeUnavailableError(f"precision {wanted.precision!r}: must be f32 or f64")
    if wanted.threads is not None and wanted.threads < 1:
        raise RuntimeUnavailableError(f"threads {wanted.threads}: must be at least 1")
    most = max(64, os.cpu_count() or 1)
    if wanted.threads is not None and wanted.threads > most:
        raise RuntimeUnavailableError(f"threads {wanted.threads}: at most {most} on this machine")
    if not wanted.verbose:
        ti.set_logging_level(ti.ERROR)
    with contextlib.nullcontext() if wanted.verbose or wanted.arch == "cpu" else _muted():
        available = wanted.arch == "cpu" or ti.lang.misc.is_arch_supported(getattr(ti, wanted.arch))
    if not available:
        raise RuntimeUnavailableError(
            f"arch {wanted.arch!r}: not available on this machine (no device or no driver); use --arch cpu"
        )


@contextlib.contextmanager
def _muted() -> Iterator[None]:
    """Nothing on standard error, where what is not Python says things of its own that no log level stops."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


@ti.kernel
def _half(number: ti.f64) -> ti.f64:
    return 0.5 * number


def _has_doubles() -> bool:
    """Whether kernels may hold numbers of 64 bits: sums do in any precision, and so does all that goes to the host."""
    try:
        with _muted():
            return bool(_half(3.0) == 1.5)
    except RuntimeError:
        return False


def _initialise(wanted: Settings) -> None:
    options: dict[str, Any] = {
        "arch": getattr(ti, wanted.arch),
        "default_fp": ti.f64 if wanted.precision == "f64" else ti.f32,
        "log_level": ti.INFO if wanted.verbose else ti.ERROR,
        "random_seed": 0,
    }
    options |= kernel_cache.options(ti.lang.impl.default_cfg().offline_cache_file_path)
    if line := kernel_cache.remark():
        warnings.warn(line, RuntimeWarning, stacklevel=2)  # once a place in the code, so once
    if wanted.threads is not None:
        options["cpu_max_num_threads"] = wanted.threads
    hidden = {name: os.environ.pop(name) for name in _OVERRULING if name in os.environ}
    # Taichi prints one line to standard output whatever its log level.
    quiet = contextlib.nullcontext() if wanted.verbose else contextlib.redirect_stdout(io.StringIO())
    try:
        with quiet:
            ti.init(**options, verbose=wanted.verbose, enable_fallback=False)
    except RuntimeError as error:
        raise RuntimeUnavailableError(f"arch {wanted.arch!r}: could not be started: {error}; use --arch cpu") from None
    finally:
        os.environ.update(hidden)
