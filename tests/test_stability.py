"""The predicted stability limit with gas, against its formula and against what happens."""

import dataclasses

import numpy as np
import pytest

from sandbox import DivergedError, stability
from sandbox.forces.pressure import Pressure
from tests.forces.probe import Probe
from tests.forces.test_pressure import ring, shell


def network(assembly, springs=True):
    """What the limit of a scene depends on, as :mod:`sandbox.stability` takes it."""
    chosen = slice(None) if springs else slice(0, 0)
    return stability.SpringNetwork(
        inverse_masses=assembly.inverse_masses,
        springs=assembly.springs[chosen],
        rest_lengths=assembly.spring_set.rest_lengths[chosen],
        stiffness=assembly.spring_set.stiffness[chosen],
        damping=assembly.spring_set.damping[chosen],
        gas=stability.GasStiffness.of(assembly.gas_faces, assembly.gases),
    )


@pytest.mark.parametrize("scene", [ring(10), shell(0)], ids=["ring", "shell"])
def test_gas_stiffness_is_the_slope_of_its_force(simulate, scene):
    """In a random shape, far from the origin, against differences of the forces that the simulation computes."""
    pressure = {"gauge_pressure": 500.0, "ambient": 2000.0}
    body = scene.bodies[0].model_copy(update={"pressure": type(scene.bodies[0].pressure)(**pressure)})
    simulation = simulate(scene.model_copy(update={"bodies": (body,)}))
    assembly = simulation.assembly
    rng = np.random.default_rng(2)
    x = assembly.positions + rng.normal(scale=0.04, size=assembly.positions.shape) + 5.0
    operator = stability._GasOperator(network(assembly).gas, x)
    probe, step = Probe(simulation, Pressure), 1e-6
    for _ in range(4):
        u = rng.normal(size=x.shape)
        forces = []
        for sign in (1.0, -1.0):
            moved = assembly.scene_order(x + sign * step * u)
            simulation.set_state(moved, 0.0 * moved)
            forces.append(probe.forces()[assembly.order])
        slope = (forces[1] - forces[0]) / (2.0 * step)
        assert operator.product(u) == pytest.approx(slope, abs=1e-6 * np.abs(slope).max())


def dense_limit(net, x, weight):
    """The limit [s] from all eigenvalues, found by bisection."""
    operator = stability._Operator(net, x)
    unit = np.eye(x.size).reshape(-1, *x.shape)
    stiff = np.array([operator.product(u, 1.0, 0.0).ravel() for u in unit])
    damped = np.array([operator.product(u, 0.0, 1.0).ravel() for u in unit])
    low, high = 0.0, 1.0
    for _ in range(60):
        h = 0.5 * (low + high)
        if np.linalg.eigvalsh(h * h * stiff + weight * h * damped)[-1] < 4.0:
            low = h
        else:
            high = h
    return low


@pytest.mark.parametrize("springs", [True, False])
@pytest.mark.parametrize("scene", [ring(16, material={"stiffness": 500.0, "damping": 0.4}), shell(1)])
def test_limit_with_gas_equals_that_of_all_eigenvalues(simulate, scene, springs):
    assembly = simulate(scene).assembly
    net = network(assembly, springs)
    x = assembly.positions * 1.1
    limit = stability.stable_step(net, x, 2.0)
    assert limit == pytest.approx(dense_limit(net, x, 2.0), rel=1e-3)
    if springs:
        without = dataclasses.replace(net, gas=None)
        assert limit < 0.5 * stability.stable_step(without, x, 2.0)


def test_only_gas_that_can_move_something_limits_the_step(simulate):
    net = network(simulate(ring()).assembly, springs=False)
    x = simulate(ring()).assembly.positions
    assert np.isfinite(stability.stable_step(net, x, 2.0))
    assert stability.stable_step(dataclasses.replace(net, inverse_masses=0.0 * net.inverse_masses), x, 2.0) == np.inf
    assert stability.stable_step(dataclasses.replace(net, gas=None), x, 2.0) == np.inf


def test_a_simulation_knows_the_limit_of_its_gas(simulate):
    """Also after more has been let in."""
    pump = {"kind": "pump", "body": "balloon", "start": 0.0, "end": 0.1, "amount": 50.0}
    material = {"stiffness": 500.0, "mass": 1e5}
    scene = ring(16, material=material, body={"pin": {"indices": list(range(15))}}, actions=[pump])
    simulation = simulate(scene)
    assembly = simulation.assembly
    for amount in (assembly.gases[0].amount, assembly.gases[0].amount + 50.0):
        gas = stability.GasStiffness.of(assembly.gas_faces, assembly.gases, np.array([amount]))
        net = dataclasses.replace(network(assembly), gas=gas)
        positions = assembly.internal_order(simulation.positions())
        expected = stability.stable_step(net, positions, simulation.scheme.damping_weight)
        assert simulation.stable_dt() == pytest.approx(expected, rel=1e-6)
        simulation.advance(0.1)


@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet"])
@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_a_balloon_blows_up_where_it_was_predicted(simulate, integrator, damping):
    """In the shape of equilibrium a ring of stiff gas is stable just below the limit, and not just above."""
    solver = {"integrator": integrator, "precision": "f64", "dt": "auto"}
    material = {"stiffness": 200.0, "mass": 1.0, "damping": damping}
    scene = ring(24, 0.5, {"gauge_pressure": 0.0, "ambient": 6000.0}, material, solver=solver)
    simulation = simulate(scene)
    both, weight = network(simulation.assembly), simulation.scheme.damping_weight
    predicted, alone = (
        stability.stable_step(net, simulation.assembly.positions, weight)
        for net in (both, dataclasses.replace(both, gas=None))
    )
    assert predicted < 0.8 * alone
    rng = np.random.default_rng(0)
    rest = simulation.positions()
    start = rest + 1e-7 * rng.normal(size=rest.shape)

    def survives(dt):
        simulation.restore()
        simulation.set_state(start, 0.0 * start)
        simulation.dt = dt
        try:
            simulation.advance(1500 * dt)
        except DivergedError:
            return False
        return bool(np.abs(simulation.positions() - rest).max() < 1e-3)

    assert survives(0.96 * predicted)
    assert not survives(1.04 * predicted)
