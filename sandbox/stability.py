"""The stability limit of springs and gas, known before the first step. NumPy only.

An explicit splitting scheme is stable while h^2 K + w h C <= 4 M, where K is the stiffness matrix in
the current shape, C the damping matrix, and w belongs to the scheme. The largest eigenvalue is found
by Lanczos iteration with products over springs and faces; no matrix is built.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.surfaces import GAS_CONSTANT, FaceSet, Gas

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_ACCURACY = 1e-4
_MOST_ITERATIONS = 150
_CHECK_EVERY = 5
_MOST_UPDATES = 12
_WHOLE = 150
"""Unknowns up to which all modes are found, not a sample."""


@dataclass(frozen=True)
class GasStiffness:
    """What the gas of G closed bodies adds to the stiffness: the second derivative of its free energy.

    With V(x) the volume of a body: n R T / V^2 (dV/dx)(dV/dx)^T - (p - p0) d2V/dx2.
    """

    faces: IntArray
    """Particles of every edge (d = 2) or triangle (d = 3), counter-clockwise from outside, shape (F, d)."""
    gas: IntArray
    """Gas behind every face, shape (F,)."""
    energies: FloatArray
    """n R T [J], shape (G,)."""
    ambient: FloatArray
    """Pressure outside [Pa], shape (G,)."""

    @classmethod
    def of(cls, faces: FaceSet, gases: Sequence[Gas], amounts: FloatArray | None = None) -> "GasStiffness | None":
        """Of the gases behind ``faces``, with amounts [mol], shape (G,); by default what they start with.

        None where there is no gas.
        """
        if not gases:
            return None
        held = np.array([gas.amount for gas in gases]) if amounts is None else amounts
        return cls(
            faces=faces.faces,
            gas=np.searchsorted([gas.body for gas in gases], faces.body).astype(np.int32),
            energies=held * GAS_CONSTANT * np.array([gas.temperature for gas in gases]),
            ambient=np.array([gas.ambient for gas in gases]),
        )


@dataclass(frozen=True)
class SpringNetwork:
    """What the limit depends on: S springs between N particles in d dimensions, and gas inside."""

    inverse_masses: FloatArray
    """[1/kg], 0 where pinned, shape (N,)."""
    springs: IntArray
    """Pairs of particles, shape (S, 2)."""
    rest_lengths: FloatArray
    """[m], shape (S,)."""
    stiffness: FloatArray
    """[N/m], shape (S,)."""
    damping: FloatArray
    """[N s/m], shape (S,)."""
    gas: GasStiffness | None = None
    """Gas in closed bodies, if there is any."""

    @property
    def masses(self) -> FloatArray:
        """[kg], 0 where pinned, shape (N,)."""
        free = self.inverse_masses > 0.0
        return np.divide(1.0, self.inverse_masses, out=np.zeros_like(self.inverse_masses), where=free)


class _GasOperator:
    """Stiffness of gas at given positions, applied to vectors. A body that is inside out has none."""

    def __init__(self, stiffness: GasStiffness, positions: FloatArray) -> None:
        self.faces = stiffness.faces
        self.count = len(positions)
        groups = len(stiffness.energies)
        self.gas = np.zeros(self.count, dtype=np.int64)
        self.gas[self.faces] = stiffness.gas[:, None]
        # Measured from the middle of all: far from the origin the parts would cancel almost wholly.
        self.corners = positions[self.faces] - positions[self.faces].mean(axis=(0, 1))
        parts = _volume_slopes(self.corners, self.corners)
        self.slope = self._to_particles(parts)
        dimension = positions.shape[1]
        volumes = np.bincount(stiffness.gas, (parts * self.corners).sum(axis=(1, 2)), groups) / dimension
        inverse = np.divide(1.0, volumes, out=np.zeros(groups), where=volumes > 0.0)
        self.bulk = stiffness.energies * inverse**2
        self.gauge = np.where(volumes > 0.0, stiffness.energies * inverse - stiffness.ambient, 0.0)
        self.groups = groups

    def product(self, u: FloatArray) -> FloatArray:
        """Stiffness [N/m] times displacements [m] of shape (N, d)."""
        change = np.bincount(self.gas, (self.slope * u).sum(axis=1), self.groups)
        turned = self._to_particles(self._slope_change(u[self.faces]))
        return np.asarray((self.bulk * change)[self.gas, None] * self.slope - self.gauge[self.gas, None] * turned)

    def _slope_change(self, u: FloatArray) -> FloatArray:
        """How dV/dx changes when corners move by u, face by face, shape (F, d, d)."""
        if u.shape[1] == 2:
            return _volume_slopes(u, u)
        return _volume_slopes(u, self.corners) + _volume_slopes(self.corners, u)

    def _to_particles(self, parts: FloatArray) -> FloatArray:
        corner = self.faces.reshape(-1)
        columns = [np.bincount(corner, parts[..., axis].reshape(-1), self.count) for axis in range(parts.shape[2])]
        return np.stack(columns, axis=1)


def _volume_slopes(first: FloatArray, second: FloatArray) -> FloatArray:
    """Slope of the volume between faces and the origin by each corner [m^(d-1)], shape (F, d, d).

    Bilinear in the corners in 3D: ``first`` [m] are the corners that follow, ``second`` those after them.
    """
    if first.shape[1] == 2:
        following = np.roll(first, -1, axis=1) * np.array([1.0, -1.0])[:, None]
        return np.asarray(0.5 * np.stack([following[..., 1], -following[..., 0]], axis=2))
    return np.asarray(np.cross(np.roll(first, -1, axis=1), np.roll(second, -2, axis=1)) / 6.0)


class _Operator:
    """M^-1/2 (stiffness_factor K + damping_factor C) M^-1/2 at given positions, applied to vectors."""

    def __init__(self, network: SpringNetwork, positions: FloatArray) -> None:
        self.a, self.b = network.springs.T
        d = positions[self.b] - positions[self.a]
        r = np.linalg.norm(d, axis=1)
        self.direction = np.divide(d, r[:, None], out=np.zeros_like(d), where=r[:, None] > 0.0)
        # A stretched spring also resists turning; a compressed one gives way, which no explicit step minds.
        slack = np.divide(network.rest_lengths, r, out=np.ones_like(r), where=r > 0.0)
        self.axial = network.stiffness
        self.transverse = network.stiffness * np.clip(1.0 - slack, 0.0, None)
        self.stretched = bool(self.transverse.any())
        self.damping = network.damping
        self.scale = np.sqrt(network.inverse_masses)[:, None]
        self.shape = positions.shape
        self.gas = None if network.gas is None else _GasOperator(network.gas, positions)

    def product(self, vector: FloatArray, stiffness_factor: float, damping_factor: float) -> FloatArray:
        """The operator times a vector of shape (N, d)."""
        u = self.scale * vector
        relative = u[self.b] - u[self.a]
        axial = stiffness_factor * (self.axial - self.transverse) + damping_factor * self.damping
        forces = ((relative * self.direction).sum(axis=1) * axial)[:, None] * self.direction
        if self.stretched:
            forces += (stiffness_factor * self.transverse)[:, None] * relative
        result = self._to_particles(forces)
        if self.gas is not None and stiffness_factor:
            result += stiffness_factor * self.gas.product(u)
        return self.scale * result

    def _to_particles(self, forces: FloatArray) -> FloatArray:
        result = np.empty(self.shape)
        for axis in range(self.shape[1]):
            result[:, axis] = np.bincount(self.b, forces[:, axis], self.shape[0])
            result[:, axis] -= np.bincount(self.a, forces[:, axis], self.shape[0])
        return result


def has_modes(network: SpringNetwork) -> bool:
    """Whether anything can oscillate."""
    springs = bool(network.inverse_masses[network.springs].any())
    return springs or (network.gas is not None and bool(network.inverse_masses[network.gas.faces].any()))


def stable_step(network: SpringNetwork, positions: FloatArray, damping_weight: float) -> float:
    """Largest stable step h [s] of a splitting scheme; infinity where nothing oscillates.

    ``damping_weight`` w is the scheme's, see :mod:`sandbox.integrators.schemes`. The answer errs on
    the short side by at most some 1e-4 of itself.
    """
    return stable_mode(network, positions, damping_weight)[0]


def stable_mode(network: SpringNetwork, positions: FloatArray, damping_weight: float) -> tuple[float, FloatArray]:
    """The same with the mode that sets it: displacements of any length, shape (N, d)."""

    def of_mode(kappa: float, gamma: float) -> float:
        total = damping_weight * gamma
        return np.inf if kappa + total <= 0.0 else float(8.0 / (total + np.sqrt(total**2 + 16.0 * kappa)))

    step, mode = step_of_top_mode(network, positions, damping_weight, of_mode)
    # Gas has no bound that holds in any shape.
    if network.gas is None and step != np.inf:
        step = max(step, row_sum_step(network, damping_weight))
    return step, mode


def step_of_top_mode(
    network: SpringNetwork, positions: FloatArray, damping_weight: float, of_mode: Callable[[float, float], float]
) -> tuple[float, FloatArray]:
    """The step h [s] that ``of_mode`` gives for the mode with the largest h^2 kappa + w h gamma, and the mode.

    kappa [1/s^2] and gamma [1/s] are the mode's stiffness and damping for unit mass. The mode is in displacements,
    shape (N, d), of any length. Infinity and no displacement where nothing oscillates.
    """
    if not has_modes(network):
        return np.inf, np.zeros_like(positions)
    operator = _Operator(network, positions)
    springs = bool(network.inverse_masses[network.springs].any())
    step = row_sum_step(network, damping_weight) if springs else 1.0
    start = np.random.default_rng(0).standard_normal(operator.shape) * (operator.scale > 0.0)
    for _ in range(_MOST_UPDATES if network.damping.any() else 1):
        stiffness_part, damping_part, residual, start = _largest(operator, step, damping_weight, start)
        # The residual bounds what the mode may still miss.
        refined = of_mode(stiffness_part + residual / step**2, damping_part)
        if not np.isfinite(refined):
            return np.inf, operator.scale * start
        change = abs(refined - step)
        step = refined
        if change <= _ACCURACY * step:
            break
    return step, operator.scale * start


@dataclass(frozen=True)
class Modes:
    """M approximate modes of damped vibration."""

    rates: NDArray[np.complex128]
    """lambda, where a mode goes as exp(lambda t) [1/s], shape (M,); one of each complex pair."""
    shapes: FloatArray
    """Displacements, shape (M, N, d)."""
    residuals: FloatArray
    """What is left of (lambda^2 + lambda C + K) u, as a part of lambda^2 u [1], shape (M,): 0 for a true mode."""


def sampled_modes(
    network: SpringNetwork, positions: FloatArray, stiff: float = 1.0, damp: float = 0.0, count: int = 40
) -> Modes:
    """Modes from all over the spectrum of ``stiff`` K + ``damp`` C.

    Those within the space of a Lanczos iteration: the ends of the spectrum are met first, the rest is a sample.
    """
    operator = _Operator(network, positions)
    start = np.random.default_rng(1).standard_normal(operator.shape) * (operator.scale > 0.0)
    basis = [start.ravel() / np.linalg.norm(start)]
    images: list[list[FloatArray]] = []
    while len(images) < (count if start.size > _WHOLE else start.size):
        vector = basis[-1].reshape(operator.shape)
        images.append([operator.product(vector, *factors).ravel() for factors in ((1.0, 0.0), (0.0, 1.0))])
        image = stiff * images[-1][0] + damp * images[-1][1]
        scale = float(np.linalg.norm(image))
        space = np.array(basis)
        for _ in range(2):  # orthogonal to all of the others, not in exact arithmetic alone
            image -= space.T @ (space @ image)
        length = float(np.linalg.norm(image))
        if length <= 1e-9 * scale or scale == 0.0:
            break
        basis.append(image / length)
    space = np.array(basis[: len(images)])
    stiffness, damping = (space @ np.array([pair[part] for pair in images]).T for part in (0, 1))
    # The motion within the space of the samples: x'' + C x' + K x = 0 as a system of first order.
    none, size = np.zeros_like(stiffness), len(space)
    rates, vectors = np.linalg.eig(np.block([[none, np.eye(size)], [-stiffness, -damping]]))
    chosen = rates.imag >= 0.0
    moved = vectors[:size, chosen].T
    # A mode's parts need not swing in step; the instant at which most of it moves stands for it.
    turned = moved * np.exp(-0.5j * np.angle((moved**2).sum(axis=1)))[:, None]
    shapes = operator.scale * (turned.real @ space).reshape(-1, *operator.shape)
    rates = np.minimum(rates[chosen].real, 0.0) + 1j * rates[chosen].imag
    left = rates[:, None] * (moved @ np.array([pair[1] for pair in images])) + moved @ np.array([p[0] for p in images])
    left += (rates**2)[:, None] * (moved @ space)
    whole = np.abs(rates) ** 2 * np.linalg.norm(moved, axis=1)
    residuals = np.divide(np.linalg.norm(left, axis=1), whole, out=np.full(len(rates), np.inf), where=whole > 0.0)
    return Modes(rates, shapes, residuals)


def stiffness_products(network: SpringNetwork, positions: FloatArray, moved: FloatArray) -> FloatArray:
    """Stiffness times displacements [N], both of shape (M, N, d), at given positions; pinned particles feel nothing."""
    free = network.inverse_masses > 0.0
    unit = replace(network, inverse_masses=free.astype(float))
    operator = _Operator(unit, positions)
    return np.array([operator.product(u, 1.0, 0.0) for u in moved])


def frequency_of(network: SpringNetwork, positions: FloatArray, mode: FloatArray) -> float:
    """Angular frequency of a mode of vibration, shape (N, d), by Rayleigh's quotient [rad/s]."""
    inertia = float((network.masses[:, None] * mode**2).sum())
    stiffness = float((stiffness_products(network, positions, mode[None])[0] * mode).sum())
    return float(np.sqrt(max(stiffness, 0.0) / inertia)) if inertia > 0.0 else 0.0


def row_sum_step(network: SpringNetwork, damping_weight: float) -> float:
    """A step that is stable for the springs in any shape [s], by Gershgorin's rows of M^-1 K: w^2 <= 2 sum(k) / m."""

    def largest(values: FloatArray) -> float:
        ends = network.springs.T.reshape(-1)
        sums = np.bincount(ends, np.concatenate([values, values]), len(network.inverse_masses))
        return float((2.0 * sums * network.inverse_masses).max())

    kappa, gamma = largest(network.stiffness), damping_weight * largest(network.damping)
    return 8.0 / (gamma + float(np.sqrt(gamma**2 + 16.0 * kappa)))


def element_frequencies(network: SpringNetwork) -> FloatArray:
    """Angular frequency of every spring with its two masses alone [rad/s], shape (S,)."""
    return np.asarray(np.sqrt(network.stiffness * network.inverse_masses[network.springs].sum(axis=1)))


def _largest(
    operator: _Operator, step: float, weight: float, start: FloatArray
) -> tuple[float, float, float, FloatArray]:
    """Lanczos on h^2 K + w h C: stiffness and damping Rayleigh quotients of the top mode, residual, mode."""

    basis = [start / np.linalg.norm(start)]
    diagonal: list[float] = []
    beside: list[float] = []
    for _ in range(min(_MOST_ITERATIONS, start.size)):
        image = operator.product(basis[-1], step**2, weight * step)
        diagonal.append(float((image * basis[-1]).sum()))
        image -= diagonal[-1] * basis[-1]
        if len(basis) > 1:
            image -= beside[-1] * basis[-2]
        beside.append(float(np.linalg.norm(image)))
        exhausted = beside[-1] <= 1e-12 * abs(diagonal[0]) or len(basis) == min(_MOST_ITERATIONS, start.size)
        if len(basis) % _CHECK_EVERY and not exhausted:
            basis.append(image / beside[-1])
            continue
        tridiagonal = np.diag(diagonal) + np.diag(beside[:-1], 1) + np.diag(beside[:-1], -1)
        values, vectors = np.linalg.eigh(tridiagonal)
        residual = beside[-1] * abs(vectors[-1, -1])
        if exhausted or residual <= _ACCURACY * values[-1]:
            break
        basis.append(image / beside[-1])
    mode = sum(weight_ * vector for weight_, vector in zip(vectors[:, -1], basis, strict=False))
    mode = mode / np.linalg.norm(mode)
    stiff, damped = (float((operator.product(mode, *factors) * mode).sum()) for factors in ((1.0, 0.0), (0.0, 1.0)))
    return stiff, damped, float(residual), mode
