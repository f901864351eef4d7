"""Where Taichi keeps compiled kernels for later runs; and what to do where there is no such place.

Taichi aborts without a home, and crashes at its end where it cannot make the folder. So both are looked at first:
services, containers and read-only homes run without a cache.
"""

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

_temporary: Path | None = None
"""A folder of this process alone, which takes what a cache would."""
_lost = ""
"""Why nothing is kept."""


def find_home() -> None:
    """Before Taichi is imported: give it a folder of this process alone where the user has no home."""
    if "XDG_CACHE_HOME" in os.environ or "HOME" in os.environ:
        return
    global _lost
    _lost = "there is neither HOME nor XDG_CACHE_HOME"
    os.environ["XDG_CACHE_HOME"] = os.fspath(_throwaway())


def options(folder: str) -> dict[str, Any]:
    """What to start Taichi with, that would keep kernels in ``folder``."""
    global _lost
    if not _lost:
        try:
            os.makedirs(folder, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return {}
        except OSError as error:
            _lost = f"{folder} cannot be written ({error.strerror or error})"
    return {"offline_cache": False, "offline_cache_file_path": os.fspath(_throwaway())}


def remark() -> str:
    """What to tell the user, in a line; "" where kernels are kept."""
    how = "every start compiles anew; set XDG_CACHE_HOME to a folder that can be written"
    return f"no cache for compiled kernels: {_lost}; {how}" if _lost else ""


def _throwaway() -> Path:
    global _temporary
    if _temporary is None:
        _temporary = Path(tempfile.mkdtemp(prefix="sandbox-kernels-"))
        atexit.register(_remove, _temporary)
    return _temporary


def _remove(folder: Path) -> None:
    """At the end of the process, and before Taichi comes to its own end, when it would make the folder once more."""
    if (taichi := sys.modules.get("taichi")) is not None:
        taichi.reset()
    shutil.rmtree(folder, ignore_errors=True)
