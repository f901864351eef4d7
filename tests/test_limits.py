"""Limits of the schemes, and what dt = "auto" makes of them."""

import math

import numpy as np
import pytest

from sandbox import limits, stability
from sandbox.integrators.schemes import SCHEMES
from sandbox.pipeline import network_of
from sandbox.scene.assemble import assemble
from sandbox.scene.model import IntegratorName
from tests.conftest import make_scene, oscillator

OMEGA = math.sqrt(1000.0)


def growth_step(name: str, rate: complex, duration: float) -> float:
    return limits.growth_step(SCHEMES[IntegratorName(name)], np.array([rate]), duration)


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
    exact = limits.growth_step(scheme, rates[np.abs(rates) > 1.0], 1.0)
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
