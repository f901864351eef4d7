"""Time integration schemes as data. None of them knows a force."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.model import IntegratorName

_EXACT = 1e-12
_NEARLY_REAL = 1e-7
"""Imaginary part of a root, of its length, that is rounding [1]."""


@dataclass(frozen=True)
class SplittingScheme:
    """A step of length h as kick (``lead`` h), drift (h), kick ((1 - ``lead``) h).

    Adjoining kicks of consecutive steps happen at the same positions and are done as one, so a step
    costs one force evaluation whatever ``lead`` is.
    """

    order: int
    """Order of accuracy."""
    lead: float
    """Fraction of the kick that comes before the drift."""
    damping_weight: float
    """Stable while h^2 K + ``damping_weight`` h C <= 4 M, the scheme's limit with damping matrix C."""
    predicts_velocity: bool = False
    """True where velocity-dependent forces need the velocity predicted to the time of the positions."""


@dataclass(frozen=True)
class RungeKuttaScheme:
    """An explicit Runge-Kutta scheme of s stages, as its Butcher tableau; checked when it is made.

    Raises ValueError where the tableau is not explicit, not consistent, or not of its order.
    """

    order: int
    """Order of accuracy, 1 to 4."""
    coupling: tuple[tuple[float, ...], ...]
    """Row i: weights of the slopes of stages 0 to i - 1 in the state of stage i."""
    weights: tuple[float, ...]
    """Weights of the stages' slopes in the step."""

    def __post_init__(self) -> None:
        a, b, c = self.coupling, self.weights, self.nodes
        if [len(row) for row in a] != list(range(len(b))):
            raise ValueError("a stage of an explicit scheme uses the stages before it and no other")
        inner = [sum(w * c[j] for j, w in enumerate(row)) for row in a]
        conditions: dict[int, list[tuple[float, float]]] = {
            1: [(sum(b), 1)],
            2: [(_sum(b, c), 1 / 2)],
            3: [(_sum(b, [k**2 for k in c]), 1 / 3), (_sum(b, inner), 1 / 6)],
            4: [
                (_sum(b, [k**3 for k in c]), 1 / 4),
                (_sum(b, [k * s for k, s in zip(c, inner, strict=True)]), 1 / 8),
                (_sum(b, [sum(w * c[j] ** 2 for j, w in enumerate(row)) for row in a]), 1 / 12),
                (_sum(b, [sum(w * inner[j] for j, w in enumerate(row)) for row in a]), 1 / 24),
            ],
        }
        for order in range(1, self.order + 1):
            if not all(math.isclose(value, wanted, rel_tol=_EXACT) for value, wanted in conditions[order]):
                raise ValueError(f"the tableau is not of order {order}")

    @property
    def nodes(self) -> tuple[float, ...]:
        """Time of every stage in the step [1]."""
        return tuple(float(sum(row)) for row in self.coupling)

    @property
    def stages(self) -> int:
        """Number of stages: evaluations of the forces a step."""
        return len(self.weights)

    @property
    def growth(self) -> tuple[float, ...]:
        """Coefficients of z^0, z^1, ... of the factor R(z) by which a step multiplies y where y' = (z / h) y."""
        powers = [[1.0] for _ in self.weights]  # of every stage's state
        step = [1.0] + [0.0] * self.stages
        for i, row in enumerate(self.coupling):
            state = [1.0] + [0.0] * self.stages
            for j, w in enumerate(row):
                for k, value in enumerate(powers[j]):
                    state[k + 1] += w * value
            powers[i] = state[: i + 1]
            for k, value in enumerate(powers[i]):
                step[k + 1] += self.weights[i] * value
        return tuple(step)

    def excess(self, direction: complex) -> NDArray[np.float64]:
        """Coefficients of r^0, r^1, ... of (|R(z)|^2 - 1) / r for z = r ``direction``, which has length 1."""
        terms = np.array(self.growth) * complex(direction) ** np.arange(self.stages + 1)
        excess = np.convolve(terms, terms.conj()).real[1:]
        # What rounding leaves of terms that cancel must not decide whether the shortest steps let y grow.
        return np.asarray(np.where(np.abs(excess) < _EXACT, 0.0, excess))

    def reach(self, direction: complex) -> float:
        """How far out in a ``direction`` of length 1 no step multiplies by more than 1: the largest |z| [1].

        0 where even the shortest steps let y grow. The boundary of the region of stability, section IV.2 of Hairer and
        Wanner, Solving Ordinary Differential Equations II.
        """
        powers = self.excess(direction)[::-1]
        roots = np.roots(powers)
        ends = np.sort(roots.real[(np.abs(roots.imag) <= _NEARLY_REAL * np.abs(roots)) & (roots.real > 0.0)])
        begins = np.concatenate([[0.0], ends])
        between = 0.5 * (begins + np.concatenate([ends, [2.0 * begins[-1] + 1.0]]))
        grows = np.polyval(powers, between) > 0.0
        return float(begins[grows][0]) if grows.any() else math.inf

    predicts_velocity = False


@dataclass(frozen=True)
class ImplicitScheme:
    """The forces of the state at ``theta`` of the step, of whatever is reached at its end, solved for by Newton.

    theta = 1 is implicit Euler, 1/2 the implicit midpoint rule: half a step of implicit Euler, then as much again.
    """

    order: int
    """Order of accuracy."""
    theta: float
    """Where in the step the forces are taken [1]."""

    predicts_velocity = False


@dataclass(frozen=True)
class ConstraintScheme:
    """Implicit Euler solved spring by spring, colour by colour, with multipliers (XPBD)."""

    order: int = 1
    """Order of accuracy, once its iterations have converged."""

    predicts_velocity = False


@dataclass(frozen=True)
class DescentScheme:
    """Implicit Euler solved particle by particle, colour by colour (vertex block descent)."""

    order: int = 1
    """Order of accuracy, once its sweeps have converged."""

    predicts_velocity = False


def _sum(weights: tuple[float, ...], values: list[float] | tuple[float, ...]) -> float:
    return float(sum(w * value for w, value in zip(weights, values, strict=True)))


Scheme = SplittingScheme | RungeKuttaScheme | ImplicitScheme | ConstraintScheme | DescentScheme

# Symplectic Euler: with one frequency, h^2 w^2 + 4 zeta w h <= 4, that is w h <= 2 (sqrt(1 + zeta^2) - zeta).
#
# Velocity Verlet knows v half a step before x when forces are due. Forces that depend on velocity are
# given v + (h / 2) a with the last acceleration, exact to second order (Groot and Warren 1997, with
# lambda = 1), which keeps the scheme of order 2 with damping. Setting x, v, and the prediction to
# alternate in sign gives the limit h^2 w^2 + 8 zeta w h <= 4.
#
# The tableaux: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, section II.1.
SCHEMES: dict[IntegratorName, Scheme] = {
    IntegratorName.EXPLICIT_EULER: RungeKuttaScheme(order=1, coupling=((),), weights=(1.0,)),
    IntegratorName.SYMPLECTIC_EULER: SplittingScheme(order=1, lead=1.0, damping_weight=2.0),
    IntegratorName.VELOCITY_VERLET: SplittingScheme(order=2, lead=0.5, damping_weight=4.0, predicts_velocity=True),
    IntegratorName.MIDPOINT: RungeKuttaScheme(order=2, coupling=((), (0.5,)), weights=(0.0, 1.0)),
    IntegratorName.HEUN: RungeKuttaScheme(order=2, coupling=((), (1.0,)), weights=(0.5, 0.5)),
    IntegratorName.RK4: RungeKuttaScheme(
        order=4, coupling=((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), weights=(1 / 6, 1 / 3, 1 / 3, 1 / 6)
    ),
    IntegratorName.IMPLICIT_EULER: ImplicitScheme(order=1, theta=1.0),
    IntegratorName.IMPLICIT_MIDPOINT: ImplicitScheme(order=2, theta=0.5),
    IntegratorName.XPBD: ConstraintScheme(),
    IntegratorName.VBD: DescentScheme(),
}
