"""Limits of the schemes, and what dt = "auto" makes of them."""

import math

import numpy as np
import pytest

from sandbox import limits, stability
from sandbox.integrators.schemes import SCHEMES
from sandbox.pipeline import network_of
from sandbox.scene.assemble import assemble
from sandbox.scene.model import IntegratorName
from sandbox.step_size import StepSize
from tests.conftest import make_scene, oscillator

OMEGA = math.sqrt(1000.0)


def growth_step(name: str, rate: complex, duration: float) -> float:
    return float(limits.mode_steps(SCHEMES[IntegratorName(name)], np.array([rate]), duration)[0])


def test_growth_limits_are_the_formulas():
    """Explicit Euler: (1 + w^2 h^2)^(T / 2h) = 10; midpoint: (1 + (w h)^4 / 4)^(T / 2h) = 10; rk4: w h = 2 sqrt(2)."""
    duration = 20.0
    euler = growth_step("explicit_euler", 1j * OMEGA, duration)
    assert (1.0 + (OMEGA * euler) ** 2) ** (duration / (2.0 * euler)) == pytest.approx(limits.GROWTH, rel=1e-6)
    for name in ("midpoint", "heun"):
        step = growth_step(name, 1j * OMEGA, duration)
        assert (1.0 + (OMEGA * step) ** 4 / 4.0) ** (duration / (2.0 * step)) == pytest.approx(limits.GROWTH, rel=1e-6)
    assert growth_step("rk4", 1j * OMEGA, 1e6) == pytest.approx(2.0 * math.sqrt(2.0) / OMEGA, rel=1e-6)
    # Damped to death, x' = -g x: h g <= 2 for schemes of order 1 and 2.
    assert growth_step("explicit_euler", -50.0 + 0j, 1e6) == pytest.approx(2.0 / 50.0, rel=1e-5)
    assert growth_step("heun", -50.0 + 0j, 1e6) == pytest.approx(2.0 / 50.0, rel=1e-5)
    assert growth_step("rk4", 0j, 1.0) == np.inf


@pytest.mark.parametrize("duration", [0.1, 1.3, 1000.0])
@pytest.mark.parametrize(
    ("name", "zeta", "turn"),
    [
        # |R| = 1: Euler's 1 - 2 z y + y^2, midpoint's and Heun's by their cubic at z = 1/2; x' = -g x for z = 1.
        ("explicit_euler", 0.002, 0.004),
        ("explicit_euler", 0.05, 0.1),
        ("explicit_euler", 1.0, 2.0),
        ("midpoint", 0.5, 2.0),
        ("heun", 0.5, 2.0),
        ("heun", 1.0, 2.0),
        ("rk4", 0.0, 2.0 * math.sqrt(2.0)),
        ("rk4", 1.0, 2.7852935634),  # root of 1 - y/2 + y^2/6 - y^3/24: Hairer and Wanner, section IV.2
    ],
)
def test_a_limit_that_there_is_depends_on_no_duration(name, zeta, turn, duration):
    rate = OMEGA * complex(-zeta, math.sqrt(1.0 - zeta**2))
    assert growth_step(name, rate, duration) == pytest.approx(turn / OMEGA, rel=1e-9)


@pytest.mark.parametrize("name", SCHEMES)
def test_the_step_is_the_same_however_long_the_run_is(name):
    """A run that is stopped and gone on with takes the steps of one that went through."""
    steps = set()
    for duration in (0.01, 2.5, 1e4):
        scene = oscillator(str(name), "auto").model_copy(update={"duration": duration})
        assembly = assemble(scene)
        steps.add(StepSize(SCHEMES[name], assembly, network_of(assembly)).chosen)
    assert len(steps) == 1


@pytest.mark.parametrize("rounding", [0.0, 1e-16, 1e-13, 1e-9, 1e-6])
def test_rounding_makes_neither_a_limit_nor_none(rounding):
    """Damping that is none: rk4 keeps its limit, the others theirs in the run's time."""
    rate = OMEGA * complex(-rounding, 1.0)
    assert growth_step("rk4", rate, 5.0) == pytest.approx(2.0 * math.sqrt(2.0) / OMEGA, rel=1e-5)
    for name in ("explicit_euler", "midpoint", "heun"):
        assert growth_step(name, rate, 5.0) == pytest.approx(growth_step(name, 1j * OMEGA, 5.0), rel=1e-12)
        # What hardly moves at all is no vibration that could grow.
        assert growth_step(name, 1e-9 * rate, 5.0) > 1e6 / OMEGA


def chain(free: int, stiffness: float, mass: float, damping: float) -> tuple[stability.SpringNetwork, np.ndarray]:
    """Free masses in a row between two walls, and where they are."""
    inverse = np.full(free + 2, 1.0 / mass)
    inverse[[0, -1]] = 0.0
    ends = np.stack([np.arange(free + 1), np.arange(1, free + 2)], axis=1).astype(np.int32)
    each = np.ones(free + 1)
    places = np.stack([0.5 * np.arange(free + 2), np.zeros(free + 2)], axis=1)
    return stability.SpringNetwork(inverse, ends, 0.5 * each, stiffness * each, damping * each), places


@pytest.mark.parametrize("free", [1, 6, 61])
def test_limits_of_chains_are_the_formulas(free):
    """w_j = 2 sqrt(k/m) sin(j pi / (2 (N + 1))); dampers along the springs damp by w_j c / (2 k)."""
    stiffness, mass, duration = 450.0, 2.0, 3.0
    omega = 2.0 * math.sqrt(stiffness / mass) * np.sin(np.arange(1, free + 1) * math.pi / (2.0 * (free + 1)))
    top = float(omega.max())

    def step(name: str, damping: float) -> float:
        network, places = chain(free, stiffness, mass, damping)
        return limits.stable_step(SCHEMES[IntegratorName(name)], network, places, duration)

    assert step("rk4", 0.0) * top == pytest.approx(2.0 * math.sqrt(2.0), rel=1e-4)
    for name in ("symplectic_euler", "velocity_verlet"):
        assert step(name, 0.0) * top == pytest.approx(2.0, rel=1e-4)
    for name, power, part in (("explicit_euler", 2, 1.0), ("heun", 4, 0.25)):
        turn = step(name, 0.0) * top
        assert (1.0 + part * turn**power) ** (duration * top / (2.0 * turn)) == pytest.approx(limits.GROWTH, rel=1e-2)
    damping = 3.0  # N s/m: ratios up to 0.1
    zeta = damping * omega / (2.0 * stiffness)
    assert step("explicit_euler", damping) == pytest.approx(damping / stiffness, rel=1e-4)
    for name in ("midpoint", "rk4"):
        h = step(name, damping)
        powers = SCHEMES[IntegratorName(name)].growth[::-1]
        factors = [
            np.abs(np.polyval(powers, part * h * omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2)))).max()
            for part in (0.999, 1.001)
        ]
        assert factors[0] <= 1.0 < factors[1]


@pytest.fixture(scope="module")
def sheet():
    """A small sheet whose springs differ in stiffness and damping, and its network."""
    body = {
        "name": "sheet",
        "shape": {"kind": "box", "size": [0.6, 0.4], "cells": [6, 4]},
        "material": {"youngs_modulus": 2e4, "damping_ratio": 0.15, "density": 100.0},
    }
    assembly = assemble(make_scene(dimension=2, bodies=[body]))
    return assembly, network_of(assembly)


@pytest.mark.parametrize("name", ["explicit_euler", "midpoint", "rk4"])
def test_the_limit_is_that_of_all_modes(sheet, name):
    """Against every eigenvalue of the full system."""
    assembly, network = sheet
    positions = assembly.positions
    operator = stability._Operator(network, positions)
    units = np.eye(positions.size).reshape(-1, *positions.shape)
    k, c = (np.array([operator.product(u, *f).ravel() for u in units]) for f in ((1.0, 0.0), (0.0, 1.0)))
    none = np.zeros_like(k)
    rates = np.linalg.eigvals(np.block([[none, np.eye(len(k))], [-k, -c]]))
    rates = np.minimum(rates.real, 0.0) + 1j * rates.imag
    scheme = SCHEMES[IntegratorName(name)]
    exact = limits.mode_steps(scheme, rates[np.abs(rates) > 1.0], 1.0).min()
    found = limits.limit(scheme, network, positions, 1.0)
    assert found.step == pytest.approx(exact, rel=0.01)
    assert np.isfinite(found.mode).all() and found.mode.any() and found.frequency > 0.0


def test_implicit_schemes_have_no_limit(sheet):
    assembly, network = sheet
    for name in ("implicit_euler", "implicit_midpoint", "xpbd", "vbd"):
        assert limits.stable_step(SCHEMES[IntegratorName(name)], network, assembly.positions, 1.0) == np.inf


def test_slowest_frequency_of_a_stretching_rod_and_of_a_pair(sheet):
    """A free lattice stretches at about (pi / L) sqrt(E / rho); a pair is met exactly."""
    assembly, network = sheet
    bar = (1.0 / 0.6) * math.sqrt(2e4 / 100.0)
    found = limits.slowest_frequency(network, assembly.positions, assembly.particle_body)
    assert 1.5 * bar < found < 3.5 * bar  # bending is slower than stretching, in a body so short not by much
    pair = assemble(oscillator("rk4", 1e-3, start=1.0))
    slow = limits.slowest_frequency(network_of(pair), pair.positions, pair.particle_body)
    assert slow == pytest.approx(OMEGA, rel=1e-6)


@pytest.mark.parametrize("integrator", ["implicit_euler", "implicit_midpoint"])
def test_auto_steps_of_implicit_schemes_are_as_true_as_asked_for(simulate, integrator):
    """On one oscillator: amplitude lost in a period, or phase wrong by it, is the accuracy."""
    scene = oscillator(integrator, "auto", start=1.0)
    solver = scene.solver.model_copy(update={"accuracy": 1e-3, "tolerance": 1e-10})
    simulation = simulate(scene.model_copy(update={"solver": solver}))
    turn = OMEGA * simulation.dt
    if integrator == "implicit_euler":
        lost = 1.0 - (1.0 + turn**2) ** (-math.pi / turn)
    else:
        lost = 1.0 - 2.0 * math.atan(turn / 2.0) / turn
    assert lost == pytest.approx(1e-3, rel=0.02)
