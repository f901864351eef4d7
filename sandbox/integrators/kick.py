"""How a constant acceleration changes a velocity over a time t: plainly, or exactly with drag."""

import math

import taichi as ti

from sandbox import functions


@ti.data_oriented
class PlainKick:
    """v + t a."""

    def factors(self, duration: float) -> tuple[float, float]:
        """What ``apply`` multiplies v [1] and a [s] with."""
        return 1.0, duration

    @ti.func
    def apply(self, v, a, decay, gain):
        return v + gain * a

    @ti.func
    def duration(self, decay, gain):
        """The time that factors were made for [s]."""
        return gain


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

    @ti.func
    def duration(self, decay, gain):
        """The time that factors were made for [s]."""
        lost = 1.0 - decay
        # -log(decay) / (1 - decay), by its series where the difference from 1 is small.
        ratio = 1.0 + lost * (1.0 / 2.0 + lost * (1.0 / 3.0 + lost * (1.0 / 4.0 + lost / 5.0)))
        if lost > 0.01:
            ratio = -functions.log(decay) / lost
        return gain * ratio


def kick_with(drag: float) -> PlainKick | DragKick:
    """The kick for a drag rate [1/s]."""
    return DragKick(drag) if drag > 0.0 else PlainKick()
