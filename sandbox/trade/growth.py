"""Does a small disturbance grow? Two runs of one scene, one of them disturbed, side by side.

What both have in common, motion, loads and prestress, drops out of their difference, so that this works in any
scene. It is disturbed by velocities: by the mode that is expected to grow first, and by noise for all the others.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import DivergedError
from sandbox.limits import Limit
from sandbox.simulation import Simulation

FloatArray = NDArray[np.float64]

_SMALL = 1e-7
"""Disturbance: part of its length by which a short spring changes at most, about [1]."""
_LOOKS = 12
"""Steps at the end whose largest difference counts: a vibration is not caught where it has no velocity."""


class Disturbance:
    """A scene of double precision with a small disturbance [m/s]."""

    def __init__(self, simulation: Simulation, limit: Limit) -> None:
        self.simulation, self.limit = simulation, limit
        assembly = simulation.assembly
        self.weights = np.where(assembly.inverse_masses > 0.0, assembly.masses, 0.0)[:, None]
        noise = np.random.default_rng(7).standard_normal(assembly.positions.shape)
        self.mode = self._of_unit_energy(limit.mode)
        shape = self.mode + self._of_unit_energy(noise)
        rest = assembly.spring_set.rest_lengths
        length = float(rest[rest > 0.0].min()) if (rest > 0.0).any() else float(np.ptp(assembly.positions))
        size = _SMALL * length * max(limit.frequency, 1.0) / max(float(np.abs(shape).max()), 1e-300)
        self.velocities = assembly.scene_order(size * shape)
        self.begun = self._norm(shape) * size, abs(self._share(shape)) * size
        """Norm of the whole disturbance, and the mode's part of it [J^1/2]."""

    def growth(self, dt: float, horizon: float) -> float:
        """By how much it has grown after ``horizon`` [s] in steps of ``dt`` [s]; infinity for a blow-up."""
        simulation = self.simulation
        steps = max(_LOOKS + 1, round(horizon / dt))
        try:
            plain = list(self._states(dt, steps, 0.0 * self.velocities))
            disturbed = list(self._states(dt, steps, self.velocities))
        except DivergedError:
            return np.inf
        finally:
            simulation.restore()
        ahead = [self._sizes(b[0] - a[0], b[1] - a[1]) for a, b in zip(plain, disturbed, strict=True)]
        return max(
            size / begun for sizes in ahead for size, begun in zip(sizes, self.begun, strict=True) if begun > 0.0
        )

    def _sizes(self, moved: FloatArray, velocities: FloatArray) -> tuple[float, float]:
        """Norm of a difference of velocities, and amplitude of the mode in it, both of the scene's order."""
        x, v = (self.simulation.assembly.internal_order(values) for values in (moved, velocities))
        return self._norm(v), math.hypot(self._share(v), self.limit.frequency * self._share(x))

    def is_stable(self, dt: float, horizon: float) -> bool:
        """Whether it stays within the growth that the limit allows, in steps of ``dt`` [s] over ``horizon`` [s]."""
        return self.growth(dt, horizon) <= self.limit.growth

    def _states(self, dt: float, steps: int, disturbance: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Positions [m] and velocities [m/s] after each of the last steps."""
        simulation = self.simulation
        simulation.restore()
        simulation.dt = dt
        simulation.set_state(simulation.positions(), simulation.velocities() + disturbance)
        simulation.advance((steps - _LOOKS) * dt)
        for _ in range(_LOOKS):
            simulation.advance(dt)
            yield simulation.positions(), simulation.velocities()

    def _of_unit_energy(self, values: FloatArray) -> FloatArray:
        size = self._norm(values)
        return values * (self.weights > 0.0) / size if size > 0.0 else np.zeros_like(values)

    def _norm(self, values: FloatArray) -> float:
        return float(np.sqrt((self.weights * values**2).sum()))

    def _share(self, values: FloatArray) -> float:
        return float((self.weights * self.mode * values).sum())


def largest_stable(disturbance: Disturbance, near: float, horizon: float, accuracy: float, most: float) -> float:
    """Largest stable step [s] by bisection to a relative ``accuracy``, sought around ``near`` [s].

    Infinity where even ``most`` [s] is stable; 0 where nothing above a thousandth of ``near`` is.
    """
    low = high = min(near, most)
    wider = 1.0 + 4.0 * accuracy
    if disturbance.is_stable(low, horizon):
        while disturbance.is_stable(high, horizon):
            if high >= most:
                return np.inf
            low, high, wider = high, min(high * wider, most), wider**2
    else:
        while not disturbance.is_stable(low, horizon):
            if low < 1e-3 * near:
                return 0.0
            low, high, wider = low / wider, low, wider**2
    while high / low > 1.0 + accuracy:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if disturbance.is_stable(middle, horizon) else (low, middle)
    return low
