"""The largest step that a scheme can take in a scene: known before the first. NumPy only."""

import numpy as np

from sandbox import stability
from sandbox.integrators.schemes import RungeKuttaScheme, Scheme, SplittingScheme
from sandbox.stability import FloatArray, SpringNetwork


def stable_step(scheme: Scheme, network: SpringNetwork, positions: FloatArray, duration: float) -> float:
    """Largest stable step [s] in the shape given, shape (N, d), for a run of ``duration`` [s].

    Infinity where nothing oscillates, and for schemes without a limit.
    """
    if isinstance(scheme, SplittingScheme):
        return stability.stable_step(network, positions, scheme.damping_weight)
    if isinstance(scheme, RungeKuttaScheme):
        return stability.stable_step(network, positions, 2.0)
    return np.inf
