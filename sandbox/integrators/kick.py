"""How a constant acceleration changes a velocity over a time t: plainly, or exactly with drag."""

import math

import taichi as ti


@ti.data_oriented
class PlainKick:
    """v + t a."""

    def factors(self, duration: float) -> tuple[float, float]:
        """What ``apply`` multiplies v [1] and a [s] with."""
        return 1.0, duration

    @ti.func
    def apply(self, v, a, decay, gain):
        return v + gain * a


@ti.data_oriented
class DragKick:
    """The exact solution of v' = a - gamma v for constant a: no step size changes how much drag there is."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        """Drag rate gamma [1/s]."""

    def factors(self, duration: float) -> tuple[float, float]:
        """exp(-gamma t) [1] and (1 - exp(-gamma t)) / gamma [s]."""
        return math.exp(-self.rate * duration), -math.expm1(-self.rate * duration) / self.rate

    @ti.func
    def apply(self, v, a, decay, gain):
        return decay * v + gain * a
