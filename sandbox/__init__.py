"""A real-time soft-body sandbox on Taichi.

>>> import sandbox
>>> scene = sandbox.load_scene("jelly", overrides={"solver.dt": 1e-3})
>>> simulation = sandbox.Simulation(scene)
>>> simulation.advance(0.5)

Names are imported when they are first used, so that ``import sandbox`` is quick and starts nothing.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from sandbox import kernel_cache

if TYPE_CHECKING:
    from sandbox.diagnostics import Energy, Measurement
    from sandbox.errors import DivergedError, RuntimeUnavailableError, SandboxError, SceneError
    from sandbox.headless import RunOptions, Summary, run
    from sandbox.output.trajectory import Trajectory
    from sandbox.scene.load import json_schema, load_scene, preset_paths, to_toml
    from sandbox.scene.model import Scene
    from sandbox.simulation import Simulation
    from sandbox.warning_log import SceneWarning, StabilityWarning

__version__ = "0.1.0"

# Read by Taichi when it is imported, which prints a banner to standard output otherwise.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
kernel_cache.find_home()

__all__ = [
    "DivergedError",
    "Energy",
    "Measurement",
    "RunOptions",
    "RuntimeUnavailableError",
    "SandboxError",
    "Scene",
    "SceneError",
    "SceneWarning",
    "Simulation",
    "StabilityWarning",
    "Summary",
    "Trajectory",
    "__version__",
    "json_schema",
    "load_scene",
    "preset_paths",
    "run",
    "to_toml",
]

_HOMES = {
    "DivergedError": "sandbox.errors",
    "Energy": "sandbox.diagnostics",
    "Measurement": "sandbox.diagnostics",
    "RunOptions": "sandbox.headless",
    "RuntimeUnavailableError": "sandbox.errors",
    "SandboxError": "sandbox.errors",
    "Scene": "sandbox.scene.model",
    "SceneError": "sandbox.errors",
    "Simulation": "sandbox.simulation",
    "SceneWarning": "sandbox.warning_log",
    "StabilityWarning": "sandbox.warning_log",
    "Summary": "sandbox.headless",
    "Trajectory": "sandbox.output.trajectory",
    "json_schema": "sandbox.scene.load",
    "load_scene": "sandbox.scene.load",
    "preset_paths": "sandbox.scene.load",
    "run": "sandbox.headless",
    "to_toml": "sandbox.scene.load",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'sandbox' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
