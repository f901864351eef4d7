"""The largest step that a scheme can take in a scene, known before the first. NumPy only.

Splitting schemes have a sharp limit. Explicit Runge-Kutta schemes multiply a vibration by R(h lambda) in every
step: they are stable up to where |R| leaves 1. Some of them multiply a vibration that is not damped by a little more
than 1 whatever the step: with them it counts as stable as long as it does not grow by more than GROWTH within a
horizon. That is not the time of the run, so that one that is stopped and gone on with takes the same steps. Implicit
schemes have no limit; for them :func:`accurate_step` tells which step keeps the slowest deformation as true as was
asked for.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox import stability
from sandbox.integrators.schemes import ImplicitScheme, RungeKuttaScheme, Scheme, SplittingScheme
from sandbox.stability import FloatArray, SpringNetwork

GROWTH = 10.0
"""By how much the amplitude of a vibration may grow within the horizon before the step counts as unstable [1]."""
_SWING = 1000.0
_BEYOND = 1.01
"""Step at which a damped mode is expected to be seen growing, in its limits [1]."""
_SEEN = 1.05
"""Growth that can be told from none [1]."""
_DAMPED = 1e-3
"""Damping ratio below which a mode counts as not damped [1]: it loses less than 0.6 % in a turn."""
_RIGID = 1e-8
"""Stiffness of a deformation, relative to the stiffest, below which it is none but a motion of the whole."""
_REFINEMENTS = 60
_SAMPLES = 6
_SETTLED = 0.98
_MODE = 0.15
"""Residual up to which an approximate mode counts [1]."""


@dataclass(frozen=True)
class Limit:
    """The largest stable step of a scheme in a scene."""

    step: float
    """[s]; infinity where there is none."""
    mode: FloatArray
    """The vibration that is the first to grow beyond it: displacements of any length, shape (N, d)."""
    frequency: float
    """Its angular frequency, without damping [rad/s]."""
    growth: float
    """What it may grow by within the horizon and count as stable [1].

    Splitting schemes swing far just below their limit. What a damped mode grows by just above it may be little.
    """


def stable_step(scheme: Scheme, network: SpringNetwork, positions: FloatArray, horizon: float) -> float:
    """Largest stable step [s] in the shape given, shape (N, d), over ``horizon`` [s].

    Infinity where nothing oscillates, and for schemes without a limit.
    """
    if isinstance(scheme, SplittingScheme):
        return stability.stable_step(network, positions, scheme.damping_weight)
    return limit(scheme, network, positions, horizon).step


def limit(scheme: Scheme, network: SpringNetwork, positions: FloatArray, horizon: float) -> Limit:
    """The same with the mode that goes first."""
    if isinstance(scheme, SplittingScheme):
        step, mode = stability.stable_mode(network, positions, scheme.damping_weight)
        return Limit(step, mode, stability.frequency_of(network, positions, mode), _SWING)
    if not isinstance(scheme, RungeKuttaScheme) or not stability.has_modes(network):
        return Limit(np.inf, np.zeros_like(positions), 0.0, GROWTH)
    if not network.damping.any():
        return _undamped_limit(scheme, network, positions, horizon)
    return _damped_limit(scheme, network, positions, horizon)


def _undamped_limit(scheme: RungeKuttaScheme, network: SpringNetwork, positions: FloatArray, horizon: float) -> Limit:
    """Where nothing is damped the fastest vibration goes first, whatever the scheme."""
    step, mode = stability.stable_mode(network, positions, 0.0)
    if not np.isfinite(step):
        return Limit(np.inf, mode, 0.0, GROWTH)
    rate = 2j / step  # a splitting scheme is stable up to 2 over the frequency
    return Limit(float(mode_steps(scheme, np.array([rate]), horizon)[0]), mode, abs(rate), GROWTH)


def _damped_limit(scheme: RungeKuttaScheme, network: SpringNetwork, positions: FloatArray, horizon: float) -> Limit:
    """Of all modes the one that allows the shortest step.

    Which one that is depends on stiffness and damping both, in a way of the scheme's own. It is approached by
    samples of the spectrum of a K + b C, where a and b are the slopes of its growth by stiffness and damping.
    """
    best = Limit(np.inf, np.zeros_like(positions), 0.0, GROWTH)
    stiff, damp = 1.0, 0.0
    for _ in range(_SAMPLES):
        modes = stability.sampled_modes(network, positions, stiff, damp)
        # What is no mode yet may seem less damped than any is.
        steps = np.where(modes.residuals < _MODE, mode_steps(scheme, modes.rates, horizon), np.inf)
        first = int(np.argmin(steps))
        if not steps[first] < best.step:
            break
        step, rate = float(steps[first]), complex(modes.rates[first])
        settled = step > _SETTLED * best.step
        best = Limit(step, modes.shapes[first], abs(rate), _growth_beyond(scheme, rate, step, horizon))
        stiff, damp = _growth_slopes(scheme, abs(rate) ** 2, -2.0 * rate.real, step)
        if settled:
            break
    return best


def _growth_slopes(scheme: RungeKuttaScheme, kappa: float, gamma: float, step: float) -> tuple[float, float]:
    """How the logarithm of the growth in a step changes with h^2 kappa and with h gamma, for h^2 K and h C."""
    z2, z = step**2 * kappa, step * gamma

    def growth(stiff: float, damped: float) -> float:
        root = np.emath.sqrt(damped**2 - 4.0 * stiff)
        powers = scheme.growth[::-1]
        factors = [complex(np.polyval(powers, (-damped + sign * root) / 2.0)) for sign in (1.0, -1.0)]
        return math.log(max(map(abs, factors)) + 1e-300)

    by_stiffness = (growth(1.001 * z2, z) - growth(0.999 * z2, z)) / (0.002 * z2) if z2 > 0.0 else 1.0
    width = 1e-3 * max(z, math.sqrt(z2))
    by_damping = (growth(z2, z + width) - growth(z2, max(z - width, 0.0))) / (width + min(width, z))
    return step**2 * by_stiffness, step * by_damping


def _growth_beyond(scheme: RungeKuttaScheme, rate: complex, step: float, horizon: float) -> float:
    """What a mode grows by in ``horizon`` [s] in steps a little longer than the limit of ``step`` [s] [1]."""
    longer = _BEYOND * step
    factor = max(abs(complex(np.polyval(scheme.growth[::-1], longer * rate))), 1e-300)
    return math.exp(min(max(horizon / longer * math.log(factor), math.log(_SEEN)), math.log(GROWTH)))


def mode_steps(scheme: RungeKuttaScheme, rates: NDArray[np.complex128], horizon: float) -> FloatArray:
    """Largest stable step [s] for every mode x = exp(rate t), rates [1/s] of shape (M,); infinity where it rests.

    Up to there no step lets it grow: |R(h rate)| <= 1. Where a scheme lets what is not damped grow in every step, such
    a mode has another limit over ``horizon`` [s]: what lets it grow by no more than GROWTH.
    """
    steps = np.full(len(rates), np.inf)
    grows = always_grows(scheme)
    for number, rate in enumerate(rates):
        length = abs(rate)
        if length > 0.0:
            reach = scheme.reach(rate / length)
            if grows and -rate.real < _DAMPED * length:
                reach = max(reach, _growing_reach(scheme, length * horizon))
            steps[number] = reach / length
    return steps


def always_grows(scheme: Scheme) -> bool:
    """Whether a vibration without damping grows in every step, however short."""
    return isinstance(scheme, RungeKuttaScheme) and scheme.reach(1j) == 0.0


def _growing_reach(scheme: RungeKuttaScheme, angle: float) -> float:
    """Largest w h at which a vibration without damping grows by GROWTH at most while w t runs through ``angle`` [1].

    At least one turn of it: before that nothing shows whether it grows.
    """
    most = 2.0 * math.log(GROWTH) / max(angle, 2.0 * math.pi)
    powers = scheme.excess(1j)[::-1]
    low, high = 0.0, 2.0
    for _ in range(_REFINEMENTS):
        middle = 0.5 * (low + high)
        grows = middle * np.polyval(powers, middle) > math.expm1(most * middle)
        low, high = (low, middle) if grows else (middle, high)
    return low


def accurate_step(
    scheme: Scheme, network: SpringNetwork, positions: FloatArray, body: NDArray[np.int32], accuracy: float
) -> float:
    """Step [s] that keeps the slowest deformation true to ``accuracy`` [1] over one of its periods.

    Implicit Euler and what solves for it lose pi omega h of the amplitude in a period; the implicit
    midpoint rule has its phase wrong by (omega h)^2 / 12 of it (Hairer, Lubich and Wanner 2003).
    ``body`` is that of every particle, shape (N,).
    """
    omega = slowest_frequency(network, positions, body)
    if omega == 0.0:
        return np.inf
    if isinstance(scheme, ImplicitScheme) and scheme.order == 2:
        return math.sqrt(12.0 * accuracy) / omega
    return accuracy / (math.pi * omega)


def slowest_frequency(network: SpringNetwork, positions: FloatArray, body: NDArray[np.int32]) -> float:
    """Estimate of the lowest angular frequency at which any body deforms [rad/s]; 0 where none does.

    Rayleigh's quotient over deformations that are quadratic in the place, and vanish where a body is pinned:
    stretching, shearing and bending. An upper bound of the true one, close for bodies that are not very slender.
    """
    frequencies = []
    for number in np.unique(body):
        members = np.flatnonzero(body == number)
        frequencies.append(slowest_of(network, positions, members))
    return min((omega for omega in frequencies if omega > 0.0), default=0.0)


def slowest_of(network: SpringNetwork, positions: FloatArray, members: NDArray[np.int64]) -> float:
    """The same for the body of these particles."""
    # Only implicit schemes come here: the others need not wait for the import.
    from scipy.linalg import eigh, null_space

    held = network.inverse_masses[members] == 0.0
    if held.all():
        return 0.0
    centred = positions[members] - positions[members].mean(axis=0)
    monomials = _monomials(centred / max(float(np.abs(centred).max()), 1e-300))
    if held.any():
        free = null_space(monomials[held], rcond=1e-9)
        monomials = monomials @ free
    # Independent ones alone: a sheet has no thickness to be quadratic in.
    left, size, _ = np.linalg.svd(monomials, full_matrices=False)
    fields = left[:, size > 1e-6 * size.max(initial=0.0)]
    dimension, count = positions.shape[1], fields.shape[1]
    if not count:
        return 0.0
    fields[held] = 0.0
    moved = np.zeros((count * dimension, *positions.shape))
    for axis in range(dimension):
        moved[axis * count : (axis + 1) * count, members, axis] = fields.T
    stiffness = stability.stiffness_products(network, positions, moved)
    flat = moved.reshape(len(moved), -1)
    k = flat @ stiffness.reshape(len(moved), -1).T
    m = flat @ (network.masses[:, None] * moved).reshape(len(moved), -1).T
    squares = eigh(0.5 * (k + k.T), m, eigvals_only=True)
    squares = squares[squares > _RIGID * squares.max()]
    return float(np.sqrt(squares.min())) if len(squares) and squares.min() > 0.0 else 0.0


def _monomials(x: FloatArray) -> FloatArray:
    """1, x, y, ..., x^2, x y, ... of places (N, d), one column each."""
    dimension = x.shape[1]
    linear = [x[:, a] for a in range(dimension)]
    squares = [x[:, a] * x[:, b] for a in range(dimension) for b in range(a, dimension)]
    return np.stack([np.ones(len(x)), *linear, *squares], axis=1)
