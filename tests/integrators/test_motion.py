"""Free fall, drag, conservation, chains: laws of motion through the public API."""

import math

import numpy as np
import pytest

from tests import analytical
from tests.conftest import falling_point, make_scene


def test_free_fall_symplectic_euler_is_exact_for_the_scheme(simulate):
    simulation = simulate(falling_point(velocity=(1.0, 2.0), gravity=[0.0, -9.81]))
    simulation.advance(0.5)
    # The velocity is updated first, so the fall is half a step ahead.
    assert simulation.positions()[0] == pytest.approx([0.5, 2.0 - 0.5 * 9.81 * 0.5 * 0.501], abs=1e-12)
    assert simulation.velocities()[0] == pytest.approx([1.0, 2.0 - 9.81 * 0.5], abs=1e-12)


def test_free_fall_verlet_is_exact(simulate):
    solver = {"integrator": "velocity_verlet", "dt": 0.05, "precision": "f64"}
    simulation = simulate(falling_point(velocity=(1.0, 2.0), gravity=[0.0, -9.81], solver=solver))
    simulation.advance(0.5)
    assert simulation.positions()[0] == pytest.approx([0.5, 2.0 - 0.5 * 9.81 * 0.25], abs=1e-12)


@pytest.mark.parametrize("dt", [1e-3, 0.1])
@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet"])
def test_drag_is_exact_for_any_step(simulate, integrator, dt):
    solver = {"integrator": integrator, "dt": dt, "precision": "f64"}
    simulation = simulate(falling_point(velocity=(3.0, 0.0), gravity=[0.0, -9.81], drag=2.0, solver=solver))
    simulation.advance(0.7)
    decay = math.exp(-2.0 * 0.7)
    assert simulation.velocities()[0] == pytest.approx([3.0 * decay, -9.81 / 2.0 * (1.0 - decay)], abs=1e-12)
    simulation.advance(20.0)
    assert simulation.velocities()[0, 1] == pytest.approx(-9.81 / 2.0, abs=1e-10)  # terminal speed g / gamma


def spinning_box(precision: str, dimension: int, damping_ratio: float):
    cells = [4] * dimension
    return make_scene(
        dimension=dimension,
        solver={"dt": 1e-3, "precision": precision},
        bodies=[
            {
                "name": "box",
                "shape": {"kind": "box", "size": [1.0] * dimension, "cells": cells},
                "position": [0.3] * dimension,
                "velocity": [1.0, -2.0, 0.5][:dimension],
                "angular_velocity": 3.0 if dimension == 2 else [1.0, 2.0, 3.0],
                "material": {"youngs_modulus": 1e5, "damping_ratio": damping_ratio},
            }
        ],
    )


@pytest.mark.parametrize("damping_ratio", [0.0, 0.1])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("precision", "tolerance"), [("f64", 2e-13), ("f32", 2e-4)])
def test_momentum_is_kept_to_rounding(simulate, precision, tolerance, dimension, damping_ratio):
    simulation = simulate(spinning_box(precision, dimension, damping_ratio))
    momentum, spin = simulation.momentum(), simulation.angular_momentum()
    simulation.advance(1.0)
    assert simulation.momentum() == pytest.approx(momentum, abs=tolerance * np.abs(momentum).max())
    # A scheme that updates x with the new v keeps x cross v only if forces are central: they are.
    assert simulation.angular_momentum() == pytest.approx(spin, abs=10 * tolerance * np.abs(spin).max())


def test_damping_takes_the_energy_that_is_not_rigid_motion(simulate):
    simulation = simulate(spinning_box("f64", 2, 0.3))
    before = simulation.energy().total
    simulation.advance(2.0)
    after = simulation.energy()
    assert after.total < before
    # What is left is translation and rotation; the box is stretched a little by its own spin.
    assert after.elastic < 0.01 * after.kinetic


def test_hanging_chain_stretch(simulate):
    count, mass, stiffness = 8, 0.5, 2000.0
    points = [[0.0, -0.1 * i] for i in range(count + 1)]
    simulation = simulate(
        make_scene(
            dimension=2,
            gravity=[0.0, -9.81],
            drag=20.0,
            solver={"dt": 2e-3, "precision": "f64"},
            bodies=[
                {
                    "name": "chain",
                    "shape": {
                        "kind": "custom",
                        "points": points,
                        "springs": [[i, i + 1] for i in range(count)],
                        "masses": [mass] * (count + 1),
                        "pinned": [0],
                    },
                    "material": {"stiffness": stiffness, "damping_ratio": 0.1},
                }
            ],
        )
    )
    simulation.advance(20.0)
    stretch = -0.1 * count - simulation.positions()[-1, 1]
    assert stretch == pytest.approx(analytical.chain_stretch(count, mass, 9.81, stiffness), rel=1e-9)


@pytest.mark.parametrize("mode", [1, 3])
def test_chain_between_fixed_ends_swings_at_its_mode(simulate, mode):
    count, mass, stiffness, spacing = 8, 0.5, 2000.0, 0.1
    shape = np.sin(mode * np.pi * np.arange(count + 2) / (count + 1))
    simulation = simulate(
        make_scene(
            dimension=2,
            solver={"integrator": "velocity_verlet", "dt": 1e-4, "precision": "f64"},
            bodies=[
                {
                    "name": "chain",
                    "shape": {
                        "kind": "custom",
                        "points": [[spacing * i + 1e-4 * s, 0.0] for i, s in enumerate(shape)],
                        "springs": [[i, i + 1] for i in range(count + 1)],
                        "rest_lengths": [spacing] * (count + 1),
                        "masses": [mass] * (count + 2),
                        "pinned": [0, count + 1],
                    },
                    "material": {"stiffness": stiffness},
                }
            ],
        )
    )
    period = 2.0 * np.pi / analytical.chain_frequency(mode, count, stiffness, mass)
    simulation.advance(0.5 * period)
    offsets = simulation.positions()[:, 0] - spacing * np.arange(count + 2)
    # Half a period later every mass is mirrored; the scheme's own phase error is far below 1e-3.
    assert offsets == pytest.approx(-1e-4 * shape, abs=1e-7)


def hanging_cable(segments: int):
    """Span 2 m, length 2.5 m, 1 kg, nearly inextensible; starts as a V."""
    along = np.linspace(0.0, 1.0, segments + 1)
    depth = np.sqrt(1.25**2 - 1.0)
    points = np.stack([2.0 * along - 1.0, -depth * (1.0 - np.abs(2.0 * along - 1.0))], axis=1)
    masses = np.full(segments + 1, 1.0 / segments)
    return make_scene(
        dimension=2,
        gravity=[0.0, -9.81],
        drag=2.0,
        solver={"dt": "auto", "precision": "f64"},
        bodies=[
            {
                "name": "cable",
                "shape": {
                    "kind": "custom",
                    "points": points.tolist(),
                    "springs": [[i, i + 1] for i in range(segments)],
                    "rest_lengths": [2.5 / segments] * segments,
                    "masses": masses.tolist(),
                    "pinned": [0, segments],
                },
                "material": {"stiffness": 2e5 * segments / 2.5, "damping_ratio": 0.2},
            }
        ],
    )


def test_catenary_sag_and_tension_converge(simulate):
    sag, ratio = analytical.catenary(2.0, 2.5)
    assert (sag, ratio) == pytest.approx((0.66359, 1.7849), rel=4e-5)  # the figures that everybody quotes
    errors = []
    for segments in (10, 20, 40):
        simulation = simulate(hanging_cable(segments))
        simulation.advance(8.0)
        positions = simulation.positions()
        d = np.diff(positions, axis=0)
        forces = (2e5 * segments / 2.5) * (1.0 - (2.5 / segments) / np.linalg.norm(d, axis=1))[:, None] * d
        # The end holds its spring and the weight of half a segment.
        end = np.hypot(forces[-1, 0], forces[-1, 1] + 0.5 * 9.81 / segments)
        errors.append([abs(-positions[:, 1].min() - sag), abs(end / forces[:, 0].mean() - ratio)])
        simulation.close()
    errors = np.array(errors)
    assert errors[-1] == pytest.approx([0.0, 0.0], abs=1.5e-3)
    assert (errors[:-1] / errors[1:] > 2.5).all()  # of second order in the length of segments
