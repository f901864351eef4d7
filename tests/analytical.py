"""Closed forms that the engine must reproduce."""

import math

import numpy as np


def symplectic_euler(omega: float, h: float, x0: float, steps: int) -> tuple[float, float]:
    """Position and velocity of x'' = -omega^2 x after ``steps`` steps from rest at x0, exact for the scheme.

    v_{n+1} = v_n - h omega^2 x_n, x_{n+1} = x_n + h v_{n+1}; so x_n = A cos(n t) + B sin(n t) with
    sin(t / 2) = omega h / 2. Source: Hairer, Lubich, Wanner, Acta Numerica 2003, 399-450, section 1.
    """
    turn = 2.0 * math.asin(omega * h / 2.0)

    def position(n: int) -> float:
        # x_0 = x0 and x_1 = x0 (1 - omega^2 h^2) fix the two constants.
        slope = (x0 * (1.0 - (omega * h) ** 2) - x0 * math.cos(turn)) / math.sin(turn)
        return x0 * math.cos(n * turn) + slope * math.sin(n * turn)

    return position(steps), (position(steps) - position(steps - 1)) / h


def velocity_verlet(omega: float, h: float, x0: float, steps: int) -> tuple[float, float]:
    """The same for velocity Verlet: x_n = x0 cos(n t), v_n = -x0 sin(n t) omega sqrt(1 - omega^2 h^2 / 4).

    Source: as above; v^2 + omega^2 x^2 (1 - omega^2 h^2 / 4) is conserved.
    """
    turn = 2.0 * math.asin(omega * h / 2.0)
    amplitude = omega * math.sqrt(1.0 - (omega * h) ** 2 / 4.0)
    return x0 * math.cos(steps * turn), -x0 * amplitude * math.sin(steps * turn)


def runge_kutta(
    growth: tuple[float, ...], omega: float, zeta: float, h: float, x0: float, steps: int
) -> tuple[float, float]:
    """Position and velocity of x'' = -omega^2 x - 2 zeta omega x' from rest at x0, exact for the scheme.

    An explicit Runge-Kutta scheme multiplies (x, v) in a step by R(h A), A the matrix of the system of first
    order and R its polynomial, of coefficients ``growth``. Hairer, Norsett, Wanner, section II.1.
    """
    matrix = h * np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]])
    step = sum(c * np.linalg.matrix_power(matrix, k) for k, c in enumerate(growth))
    x, v = np.linalg.matrix_power(step, steps) @ np.array([x0, 0.0])
    return float(x), float(v)


def damped_oscillator(omega: float, zeta: float, x0: float, t: float) -> float:
    """Position at time t [s] of x'' = -omega^2 x - 2 zeta omega x' from rest at x0. Any textbook on vibration."""
    damped = omega * math.sqrt(1.0 - zeta**2)
    decay = math.exp(-zeta * omega * t)
    return x0 * decay * (math.cos(damped * t) + zeta * omega / damped * math.sin(damped * t))


def symplectic_euler_limit(zeta: float) -> float:
    """Largest stable omega h with damping ratio zeta taken from the old velocity: 2 (sqrt(1 + zeta^2) - zeta)."""
    return 2.0 * (math.sqrt(1.0 + zeta**2) - zeta)


def velocity_verlet_limit(zeta: float) -> float:
    """Largest stable omega h of velocity Verlet whose damping sees v + (h / 2) a: 2 (sqrt(1 + 4 zeta^2) - 2 zeta).

    From the eigenvalue -1 of the step on (x, v, prediction); see sandbox/integrators/schemes.py.
    """
    return 2.0 * (math.sqrt(1.0 + 4.0 * zeta**2) - 2.0 * zeta)


def chain_stretch(count: int, mass: float, gravity: float, stiffness: float) -> float:
    """Total stretch [m] of a hanging chain of ``count`` masses on ``count`` springs: m g N (N + 1) / (2 k)."""
    return mass * gravity * count * (count + 1) / (2.0 * stiffness)


def chain_frequency(mode: int, count: int, stiffness: float, mass: float) -> float:
    """omega_j [rad/s] of ``count`` masses between fixed ends: 2 sqrt(k / m) sin(j pi / (2 (N + 1)))."""
    return 2.0 * math.sqrt(stiffness / mass) * math.sin(mode * math.pi / (2.0 * (count + 1)))


def cantilever_weight_deflection(load: float, length: float, youngs_modulus: float, second_moment: float) -> float:
    """Tip deflection [m] under a uniform load q [N/m]: q L^4 / (8 E I). Euler-Bernoulli."""
    return load * length**4 / (8.0 * youngs_modulus * second_moment)


def cantilever_shear_deflection(load: float, length: float, shear_modulus: float, area: float) -> float:
    """What shear adds to it [m]: q L^2 / (2 kappa G A), kappa = 5/6 for a rectangle. Timoshenko 1921."""
    return load * length**2 / (2.0 * 5.0 / 6.0 * shear_modulus * area)


def cantilever_frequency(length: float, youngs_modulus: float, second_moment: float, mass_per_length: float) -> float:
    """First natural frequency [Hz]: (1.8751^2 / 2 pi) sqrt(E I / (rho A L^4)). Euler-Bernoulli."""
    return 1.8751**2 / (2.0 * math.pi) * math.sqrt(youngs_modulus * second_moment / (mass_per_length * length**4))


def sliding(velocity: float, angle: float, friction: float, gravity: float, t: float) -> float:
    """Speed [m/s] down an incline of ``angle`` [rad] at time t: v + g (sin - mu cos) t. Coulomb."""
    return velocity + gravity * (math.sin(angle) - friction * math.cos(angle)) * t


def fitted_order(steps: list[float], errors: list[float]) -> float:
    """Slope of log error against log step."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def catenary(span: float, length: float) -> tuple[float, float]:
    """Sag [m] of a chain hung between two points of one height, and its end tension over the horizontal one [1].

    y = a cosh(x / a) with 2 a sinh(span / 2a) = length: sag a (cosh(span / 2a) - 1), ratio cosh(span / 2a).
    Source: Huygens, Leibniz, Bernoulli 1691; any textbook on statics.
    """
    low, high = 1e-3 * span, 1e3 * span
    for _ in range(200):
        a = 0.5 * (low + high)
        low, high = (a, high) if 2.0 * a * math.sinh(span / (2.0 * a)) > length else (low, a)
    return a * (math.cosh(span / (2.0 * a)) - 1.0), math.cosh(span / (2.0 * a))
