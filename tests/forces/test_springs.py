"""Spring forces against a NumPy twin; stiffness of lattices against continuum mechanics."""

import math

import numpy as np
import pytest

from sandbox.scene.assemble import assemble
from tests import analytical
from tests.conftest import make_scene


def random_network(dimension: int, damping: float, count: int = 40):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(count, dimension))
    pairs = {tuple(sorted(pair)) for pair in rng.integers(0, count, (4 * count, 2)).tolist() if pair[0] != pair[1]}
    springs = sorted(pairs)
    return make_scene(
        dimension=dimension,
        solver={"dt": 1e-3, "precision": "f64"},
        diagnostics={"max_strain": 1e6},
        bodies=[
            {
                "name": "net",
                "shape": {
                    "kind": "custom",
                    "points": points.tolist(),
                    "springs": springs,
                    "rest_lengths": rng.uniform(0.1, 2.0, len(springs)).tolist(),
                    "masses": rng.uniform(0.5, 2.0, count).tolist(),
                    "velocities": rng.normal(size=(count, dimension)).tolist(),
                },
                "material": {"stiffness": 70.0, "damping": damping},
            }
        ],
    )


def spring_forces(scene, x, v):
    """Force on every particle [N] by a plain loop over springs."""
    shape, material = scene.bodies[0].shape, scene.bodies[0].material
    forces = np.zeros_like(x)
    for (a, b), rest in zip(shape.springs, shape.rest_lengths, strict=True):
        d = x[b] - x[a]
        r = np.linalg.norm(d)
        u = d / r
        force = (material.stiffness * (r - rest) + material.damping * (v[b] - v[a]) @ u) * u
        forces[a] += force
        forces[b] -= force
    return forces


@pytest.mark.parametrize("damping", [0.0, 3.0])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("serial", [True, False])
def test_a_step_equals_a_loop_over_springs(simulate, dimension, damping, serial):
    scene = random_network(dimension, damping)
    simulation = simulate(scene, serial=serial)
    x, v = simulation.positions(), simulation.velocities()
    dt, masses = scene.solver.dt, np.array(scene.bodies[0].shape.masses)[:, None]
    for _ in range(3):
        v = v + dt * spring_forces(scene, x, v) / masses
        x = x + dt * v
    simulation.advance(3 * dt)
    assert simulation.positions() == pytest.approx(x, abs=1e-12)
    assert simulation.velocities() == pytest.approx(v, abs=1e-11)


def test_spring_of_length_zero_gives_no_force(simulate):
    scene = make_scene(
        dimension=2,
        solver={"dt": 1e-3},
        bodies=[
            {
                "name": "pair",
                "shape": {"kind": "custom", "points": [[0, 0], [0, 0]], "springs": [[0, 1]], "rest_lengths": [1.0]},
                "material": {"stiffness": 1000.0, "damping": 1.0},
            }
        ],
    )
    simulation = simulate(scene)
    simulation.advance(0.1)
    assert (simulation.positions() == 0.0).all()


def lattice(dimension: int, bracing: str = "face", cells: int = 3, size: float = 1.0):
    return make_scene(
        dimension=dimension,
        solver={"precision": "f64"},
        bodies=[
            {
                "name": "block",
                "shape": {
                    "kind": "box",
                    "size": [size] * dimension,
                    "cells": [cells] * dimension,
                    "bracing": bracing,
                },
                "material": {"youngs_modulus": 1e5, "mass": 1.0},
            }
        ],
    )


@pytest.mark.parametrize("cells", [1, 2, 3])
@pytest.mark.parametrize(
    ("dimension", "bracing", "poisson"), [(2, "face", 1 / 3), (3, "face", 0.25), (3, "body", 0.25)]
)
def test_lattice_has_youngs_modulus_in_every_direction(simulate, dimension, bracing, poisson, cells):
    """Pull along several directions and let the sides contract: the energy is E strain^2 V / 2, whatever the cells.

    Weighted by the cells that share them, springs at the surface make the homogeneous state the
    equilibrium one also for a block of a single cell.
    """
    simulation = simulate(lattice(dimension, bracing, cells))
    rest = simulation.positions()
    strain = 1e-6
    directions = [(1, 0, 0), (math.cos(math.pi / 12), math.sin(math.pi / 12), 0), (1, 1, 0), (1, 1, 1)]
    for direction in directions[: 3 if dimension == 2 else 4]:
        n = np.array(direction[:dimension]) / np.linalg.norm(direction[:dimension])
        along = np.outer(n, n)
        deform = np.eye(dimension) * (1.0 - poisson * strain) + (1.0 + poisson) * strain * along
        simulation.set_state(rest @ deform.T, np.zeros_like(rest))
        expected = 0.5 * 1e5 * strain**2
        assert simulation.energy().elastic == pytest.approx(expected, rel=1e-5)


def test_stretched_cube_is_in_equilibrium_but_for_its_pulled_faces(simulate):
    """Sides of the homogeneous state feel no force: the surface weights are right, spring by spring."""
    scene = lattice(3)
    simulation = simulate(scene)
    rest = simulation.positions()
    strain, dt = 1e-6, 1e-6
    simulation.set_state(rest * [1.0 + strain, 1.0 - 0.25 * strain, 1.0 - 0.25 * strain], 0.0 * rest)
    simulation.dt = dt
    simulation.advance(dt)
    masses = simulation.assembly.scene_order(simulation.assembly.masses)
    forces = masses[:, None] * simulation.velocities() / dt
    pulled = np.abs(np.abs(rest[:, 0]) - 0.5) < 1e-9
    total = 1e5 * strain  # E strain times the area of 1 m^2
    assert np.abs(forces[~pulled]).max() < 1e-4 * total
    assert np.abs(forces[pulled][:, 1:]).max() < 1e-4 * total
    assert forces[rest[:, 0] > 0.49, 0].sum() == pytest.approx(-total, rel=1e-4)


@pytest.mark.parametrize("size", [[1.0, 1.0, 1.2], [0.8, 1.0, 1.0]])
def test_uneven_cells_stay_isotropic(simulate, size):
    scene = make_scene(
        dimension=3,
        solver={"precision": "f64"},
        bodies=[
            {
                "name": "block",
                "shape": {"kind": "box", "size": size, "cells": [2, 2, 2]},
                "material": {"youngs_modulus": 1e5, "mass": 1.0},
            }
        ],
    )
    simulation = simulate(scene)
    rest = simulation.positions()
    for axis in range(3):
        stretch = np.full(3, 1.0 - 0.25e-6)
        stretch[axis] = 1.0 + 1e-6
        simulation.set_state(rest * stretch, 0.0 * rest)
        assert simulation.energy().elastic == pytest.approx(0.5e5 * 1e-12 * math.prod(size), rel=1e-5)


def beam(rows: int, gravity: float):
    """A 1 m x 0.1 m cantilever of 1000 kg/m^3 and 1 MPa, clamped at x = 0."""
    return make_scene(
        dimension=2,
        gravity=[0.0, -gravity],
        solver={"integrator": "velocity_verlet", "precision": "f64", "safety": 0.9},
        bodies=[
            {
                "name": "beam",
                "shape": {"kind": "box", "size": [1.0, 0.1], "cells": [10 * rows, rows]},
                "position": [0.5, 0.0],
                "material": {"youngs_modulus": 1e6, "density": 1000.0},
                "pin": {"region": {"min": [-0.01, -1.0], "max": [1e-6, 1.0]}},
            }
        ],
    )


def test_cantilever_deflection_and_frequency_converge(simulate):
    """Released straight, the tip swings about the static deflection at the first frequency."""
    gravity, density, height = 1e-3, 1000.0, 0.1
    second_moment = height**3 / 12.0
    load = density * height * gravity
    expected = analytical.cantilever_weight_deflection(load, 1.0, 1e6, second_moment)
    expected += analytical.cantilever_shear_deflection(load, 1.0, 1e6 / (2 * (1 + 1 / 3)), height)
    frequency = analytical.cantilever_frequency(1.0, 1e6, second_moment, density * height)
    deflection_errors, frequency_errors = [], []
    for rows in (2, 4, 8):
        simulation = simulate(beam(rows, gravity))
        tip = np.abs(simulation.positions()[:, 0] - 1.0) < 1e-9
        times, depths = [], []
        while simulation.time < 1.2 / frequency:
            simulation.advance(0.01 / frequency)
            times.append(simulation.time)
            depths.append(-simulation.positions()[tip, 1].mean())
        lowest = int(np.argmax(depths[:100]))  # half a period after the start
        back = lowest + int(np.argmin(depths[lowest:]))
        period = times[back]
        deflection = np.mean([d for t, d in zip(times, depths, strict=True) if t <= period])
        deflection_errors.append(abs(deflection / expected - 1.0))
        frequency_errors.append(abs(1.0 / (period * frequency) - 1.0))
    for errors in (deflection_errors, frequency_errors):
        assert errors[1] < 0.5 * errors[0] and errors[2] < 0.5 * errors[1]
        assert errors[2] < 0.03


def test_refining_does_not_change_mass_or_energy_of_a_ball():
    coarse, fine = (
        assemble(
            make_scene(
                dimension=3,
                bodies=[
                    {
                        "name": "ball",
                        "shape": {"kind": "ball", "radius": 0.5, "cells": cells},
                        "material": {"youngs_modulus": 1e5, "density": 900.0},
                    }
                ],
            )
        )
        for cells in (8, 16)
    )
    assert coarse.masses.sum() == pytest.approx(900.0 * 4.0 / 3.0 * math.pi * 0.125)
    assert fine.masses.sum() == pytest.approx(coarse.masses.sum())
    for ball in (coarse, fine):
        rim = np.unique(ball.appearance.triangles)
        assert np.linalg.norm(ball.positions[rim], axis=1) == pytest.approx(0.5)
