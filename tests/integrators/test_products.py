"""Stiffness of the laws: products against differences of forces, blocks against products."""

import numpy as np
import pytest
import taichi as ti

from tests.conftest import make_scene

DT = 0.01


@ti.data_oriented
class Probe:
    """Forces, products and blocks of one law of a simulation with an implicit scheme."""

    def __init__(self, simulation, name: str) -> None:
        self.stepper = simulation._pipeline.stepper
        self.law = next(law for law in simulation.laws if type(law).__name__ == name)
        self.state = simulation.state
        self.dimension = self.state.dimension
        self.u = self.stepper.linear.direction
        self.result = self.stepper.linear.image
        self.prepares = hasattr(self.law, "prepare_end")
        self.prepares_product = hasattr(self.law, "prepare_product_at")

    def forces(self, positions, velocities):
        """Of every particle [N], shape (N, d)."""
        self.state.write(positions, velocities)
        self._force()
        return self.result.to_numpy()

    def products(self, u, stiff, damp):
        """(stiff K + damp C) u at the state last given, shape (N, d)."""
        self.u.from_numpy(u)
        self._product(stiff, damp)
        return self.result.to_numpy()

    def blocks(self, stiff, damp):
        """Diagonal blocks, shape (N, d, d)."""
        blocks = np.empty((self.state.count, self.dimension, self.dimension))
        self._block(blocks, stiff, damp)
        return blocks

    @ti.kernel
    def _force(self):
        ti.loop_config(serialize=True)
        for _ in range(1):
            if ti.static(self.prepares):
                for k in range(self.law.prepare_count):
                    self.law.prepare_at(k, 0, 0.0, 0.0)
                self.law.prepare_end(0, 0.0, 0.0)
            for i in range(self.state.count):
                self.result[i] = self.law.force_on(i, 0)

    @ti.kernel
    def _product(self, stiff: float, damp: float):
        ti.loop_config(serialize=True)
        for _ in range(1):
            if ti.static(self.prepares_product):
                for k in range(self.law.product_count):
                    self.law.prepare_product_at(k, 0, self.u)
                self.law.prepare_product_end()
            for i in range(self.state.count):
                self.result[i] = self.law.product_on(i, 0, self.u, stiff, damp)

    @ti.kernel
    def _block(self, blocks: ti.types.ndarray(), stiff: float, damp: float):
        for i in range(self.state.count):
            block = self.law.block_on(i, 0, stiff, damp)
            for a, b in ti.static(ti.ndrange(self.dimension, self.dimension)):
                blocks[i, a, b] = block[a, b]


def scene(kind: str, dimension: int):
    """A small body with the law in question, not at rest."""
    material = {"stiffness": 300.0, "damping": 2.0}
    body: dict = {"name": "body", "material": material}
    parts: dict = {}
    if kind == "Springs":
        body["shape"] = {"kind": "box", "size": [1.0] * dimension, "cells": [2] * dimension}
    elif kind == "Pressure":
        body["shape"] = {"kind": "ring", "radius": 0.5, "segments": 9}
        if dimension == 3:
            body["shape"] = {"kind": "shell", "radius": 0.5, "subdivisions": 1}
        body["pressure"] = {"gauge_pressure": 300.0, "ambient": 1000.0}
    else:
        body["shape"] = {"kind": "rope", "from": [0.0, 0.0], "to": [1.0, 0.0], "segments": 4, "thickness": 0.1}
        if dimension == 3:
            body["shape"] = {"kind": "sheet", "size": [1.0, 1.0], "cells": [2, 2]}
        parts["wind"] = {"velocity": [3.0, 1.0, 2.0][:dimension]}
    solver = {"integrator": "implicit_euler", "dt": DT, "precision": "f64"}
    return make_scene(dimension=dimension, solver=solver, bodies=[body], **parts)


@pytest.mark.parametrize(("kind", "dimension"), [("Springs", 2), ("Springs", 3), ("Pressure", 2), ("Pressure", 3)])
def test_products_are_derivatives_of_the_force(simulate, kind, dimension):
    simulation = simulate(scene(kind, dimension))
    probe = Probe(simulation, kind)
    rng = np.random.default_rng(2)
    # All springs stretched: there the positive matrix is the exact one.
    start = simulation.state.read()[0]  # in the order of the fields
    x = 1.6 * start + 0.02 * rng.standard_normal(start.shape)
    v, u = np.zeros_like(x), rng.standard_normal(x.shape)
    e = 1e-5
    slope = -(probe.forces(x + e * u, v) - probe.forces(x - e * u, v)) / (2.0 * e)
    drag = -(probe.forces(x, v + e * u) - probe.forces(x, v - e * u)) / (2.0 * e)
    probe.forces(x, v)
    size = np.abs(slope).max()
    assert probe.products(u, 1.0, 0.0) == pytest.approx(slope, abs=1e-7 * size)
    assert probe.products(u, 0.0, 1.0) == pytest.approx(drag, abs=1e-7 * size)
    blocks = probe.blocks(0.5, 0.1)
    for i, axis in ((0, 0), (3, 1), (len(x) - 1, dimension - 1)):
        unit = np.zeros_like(x)
        unit[i, axis] = 1.0
        assert blocks[i, :, axis] == pytest.approx(probe.products(unit, 0.5, 0.1)[i], abs=1e-9 * size)


def test_compressed_springs_have_a_positive_matrix(simulate):
    simulation = simulate(scene("Springs", 2))
    probe = Probe(simulation, "Springs")
    x = 0.6 * simulation.state.read()[0]
    probe.forces(x, 0.0 * x)
    columns = []
    for k in range(x.size):
        unit = np.zeros(x.size)
        unit[k] = 1.0
        columns.append(probe.products(unit.reshape(x.shape), 1.0, 0.0).reshape(-1))
    matrix = np.array(columns)
    assert matrix == pytest.approx(matrix.T, abs=1e-9)
    assert np.linalg.eigvalsh(matrix).min() > -1e-9


@pytest.mark.parametrize("dimension", [2, 3])
def test_wind_resists_motion_along_and_across_its_faces(simulate, dimension):
    """Exact where the relative wind is along the normal or in the face; symmetric and positive anywhere."""
    simulation = simulate(scene("WindForce", dimension))
    probe = Probe(simulation, "WindForce")
    x, wind = simulation.state.read()[0], np.array([3.0, 1.0, 2.0][:dimension])
    flat = np.ptp(x, axis=0).argmin()
    normal = np.eye(dimension)[flat]
    v = np.broadcast_to(wind - 4.0 * normal, x.shape)  # the air comes along the normal, at 4 m/s
    e = 1e-5
    for direction in np.eye(dimension):
        u = np.broadcast_to(direction, x.shape).copy()
        drag = -(probe.forces(x, v + e * u) - probe.forces(x, v - e * u)) / (2.0 * e)
        probe.forces(x, v)
        assert probe.products(u, 0.0, 1.0) == pytest.approx(drag, abs=1e-6 * np.abs(drag).max() + 1e-9)
    rng = np.random.default_rng(3)
    probe.forces(x + 0.1 * rng.standard_normal(x.shape), 3.0 * rng.standard_normal(x.shape))
    vectors = rng.standard_normal((2, *x.shape))
    first, second = (probe.products(u, 0.0, 1.0) for u in vectors)
    assert (first * vectors[1]).sum() == pytest.approx((second * vectors[0]).sum(), rel=1e-9)
    assert (first * vectors[0]).sum() > 0.0
