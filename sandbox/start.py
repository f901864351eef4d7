"""What must be true of a scene before its first step, and of a state to go on from. NumPy only."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.postmortem import Failure
from sandbox.scene.assemble import Assembly

_COARSEST = 0.01
"""Most of the shortest spring that rounding may take from a coordinate [1]."""


def check_start(assembly: Assembly, precision: str) -> None:
    """Raise SceneError where a scene starts outside its own bounds, or too far out for the precision's digits."""
    bounds = assembly.scene.diagnostics
    speed = float(np.linalg.norm(assembly.velocities, axis=1).max())
    if speed > bounds.max_speed:
        raise SceneError(f"diagnostics.max_speed: a body starts at {speed:.4g} m/s, above {bounds.max_speed:.4g}")
    rest = assembly.spring_set.rest_lengths
    rounding = float(np.finfo("float64" if precision == "f64" else "float32").eps * np.abs(assembly.positions).max())
    if (rest > 0.0).any() and rounding > _COARSEST * rest[rest > 0.0].min():
        raise SceneError(
            f"bodies: so far from the origin {precision} rounds coordinates to {rounding:.2g} m, too coarse "
            f"for springs of {rest[rest > 0.0].min():.2g} m; move the scene nearer, or use solver.precision f64"
        )
    failure = Failure.of_state(assembly, assembly.positions, assembly.velocities)
    if failure.strain > bounds.max_strain:
        raise SceneError(
            f"diagnostics.max_strain: {failure.element(assembly)} starts at strain {failure.strain:.4g}, "
            f"above {bounds.max_strain:.4g}"
        )


def check_memory(first: Mapping[str, NDArray[np.float64]], memory: Mapping[str, NDArray[np.float64]]) -> None:
    """Raise SceneError where ``memory`` is not of the names and shapes that a scene begins with, or not finite."""
    for name, values in first.items():
        if name.startswith("ledger."):
            continue  # a run may begin its books anew
        if name not in memory or memory[name].shape != values.shape or not np.isfinite(memory[name]).all():
            raise SceneError(f"state: {name} must be {len(values)} finite numbers for this scene")
