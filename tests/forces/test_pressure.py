"""Gas in closed bodies: closed forms, its energy, what leaks, is pumped, and bursts."""

import math

import numpy as np
import pytest

from sandbox import DivergedError, Simulation
from sandbox.forces.gas import DISCHARGE, MOLAR_MASS
from sandbox.forces.pressure import Pressure
from sandbox.scene.surfaces import GAS_CONSTANT, enclosed_volume
from tests.conftest import make_scene
from tests.forces.probe import Probe, law_of

TEMPERATURE = 293.15


def ring(segments=12, radius=0.5, pressure=None, material=None, **more):
    """A scene with a 2D balloon; by default nothing but its gas matters."""
    shape = {"kind": "ring", "radius": radius, "segments": segments}
    material = {"stiffness": 1e-6, "mass": 1.0, **(material or {})}
    body = {"name": "balloon", "shape": shape, "material": material, "pressure": pressure or {"gauge_pressure": 50.0}}
    body |= more.pop("body", {})
    more.setdefault("solver", {"dt": 1e-3, "precision": "f64"})
    return make_scene(dimension=2, bodies=[body], **more)


def shell(subdivisions=1, radius=0.5, pressure=None, material=None, **more):
    """A scene with a 3D balloon."""
    shape = {"kind": "shell", "radius": radius, "subdivisions": subdivisions}
    material = {"stiffness": 1e-6, "mass": 1.0, **(material or {})}
    body = {"name": "balloon", "shape": shape, "material": material, "pressure": pressure or {"gauge_pressure": 50.0}}
    body |= more.pop("body", {})
    more.setdefault("solver", {"dt": 1e-3, "precision": "f64"})
    return make_scene(dimension=3, bodies=[body], **more)


def held(segments=12, **more):
    """A ring that cannot move: only its gas changes."""
    return ring(segments=segments, body={"pin": {"indices": list(range(segments))}}, **more)


def gas_of(simulation):
    return law_of(simulation, Pressure)


def place(simulation, positions):
    simulation.set_state(positions, np.zeros_like(positions))


# -- at rest -------------------------------------------------------------------------------------------


def balloon_edge(count, stiffness, rest_length, energy):
    """Edge length [m] of a regular polygon of springs around gas with n R T = ``energy`` [J] in a vacuum.

    Of the energies N k (l - l0)^2 / 2 and -n R T ln(l^2), the sum is least where k N l (l - l0) = 2 n R T.
    """
    return 0.5 * (rest_length + math.sqrt(rest_length**2 + 8.0 * energy / (stiffness * count)))


def test_two_dimensional_balloon_takes_its_closed_form(simulate):
    count, rest_length, energy = 32, 0.1, 5.0
    edge = balloon_edge(count, 100.0, rest_length, energy)
    assert edge == pytest.approx(0.125, abs=1e-15)
    gas = {"amount": energy / (GAS_CONSTANT * TEMPERATURE), "temperature": TEMPERATURE, "ambient": 0.0}
    radius = rest_length / (2.0 * math.sin(math.pi / count))
    simulation = simulate(
        ring(count, radius, gas, {"stiffness": 100.0}, drag=5.0, solver={"dt": 2e-3, "precision": "f64"})
    )
    simulation.advance(20.0)
    x = simulation.positions()
    assert np.linalg.norm(x - np.roll(x, 1, axis=0), axis=1) == pytest.approx(edge, abs=1e-12)
    assert np.linalg.norm(x, axis=1) == pytest.approx(0.63764, abs=5e-6)
    assert gas_of(simulation).pressures() == pytest.approx(energy / enclosed_volume(loop(count), x))


def loop(count):
    return np.stack([np.arange(count), np.roll(np.arange(count), -1)], axis=1)


def test_gas_pushes_a_closed_shell_nowhere(simulate):
    simulation = simulate(shell(2, pressure={"gauge_pressure": 1000.0}))
    forces, x = Probe(simulation, Pressure).forces(), simulation.positions()
    scale = np.abs(forces).sum()
    # A sphere of triangles: every force looks out, and adds up to 3 p V along the radii.
    volume = gas_of(simulation).volumes()[0]
    assert (forces * x).sum() == pytest.approx(3.0 * 1000.0 * volume, rel=1e-9)
    assert np.abs(forces.sum(axis=0)).max() < 1e-14 * scale
    assert np.abs(np.cross(x, forces).sum(axis=0)).max() < 1e-14 * scale


# -- energy --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scene", [ring(), shell(0)], ids=["ring", "shell"])
def test_force_is_the_slope_of_the_energy(simulate, scene):
    simulation = simulate(scene)
    rng = np.random.default_rng(1)
    x = simulation.positions() + rng.normal(scale=0.05, size=simulation.positions().shape) + 3.0
    place(simulation, x)
    forces = Probe(simulation, Pressure).forces()
    step, slopes = 1e-4, np.empty_like(x)
    for place_of in np.ndindex(*x.shape):
        energies = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[place_of] += sign * step
            place(simulation, moved)
            energies.append(simulation.energy().gas)
        slopes[place_of] = (energies[0] - energies[1]) / (2.0 * step)
    assert forces == pytest.approx(-slopes, abs=1e-6 * np.abs(forces).max())


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_energy_is_well_conditioned_next_to_ambient_pressure(simulate, precision):
    """Both parts of the energy are some 1e5 J here, their sum 1e-3 J: without care f32 would give noise."""
    simulation = simulate(shell(2, 0.8, {"gauge_pressure": 0.0}, solver={"dt": 1e-3, "precision": precision}))
    x = simulation.positions()
    volume = simulation.assembly.gases[0].rest_volume
    for scale in (0.6, 0.99, 1.0 + 1e-4, 1.02, 1.5):
        place(simulation, scale * x)
        u = scale**3 - 1.0
        expected = 101325.0 * volume * (u - math.log1p(u))
        # What f32 does to the coordinates is u off by some 1e-7.
        noise = 0.0 if precision == "f64" else 1e-7 * 101325.0 * volume * abs(u)
        assert simulation.energy().gas == pytest.approx(expected, rel=1e-6, abs=noise + 1e-9)


def test_energy_is_kept_as_a_balloon_swings(simulate):
    """Velocity Verlet: the error of the total energy falls with the square of the step, and does not grow."""
    solver = {"integrator": "velocity_verlet", "dt": 1e-3, "precision": "f64"}
    simulation = simulate(ring(24, 0.5, {"gauge_pressure": 30.0, "ambient": 50.0}, {"stiffness": 300.0}, solver=solver))
    start, errors = simulation.energy().total, []
    for dt in (2e-3, 1e-3):
        simulation.restore()
        simulation.dt = dt
        worst = 0.0
        for _ in range(40):
            simulation.advance(0.05)
            worst = max(worst, abs(simulation.energy().total - start))
        errors.append(worst)
        assert simulation.energy().gas < -0.1
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 2e-3


def test_boyle(simulate):
    simulation = simulate(shell(1, pressure={"amount": 2.0, "temperature": TEMPERATURE}))
    x = simulation.positions()
    gas = gas_of(simulation)
    for scale in (0.7, 1.0, 1.6):
        place(simulation, scale * x)
        assert gas.pressures() * gas.volumes() == pytest.approx(2.0 * GAS_CONSTANT * TEMPERATURE, rel=1e-12)
        assert gas.amounts() == pytest.approx(2.0, rel=1e-14)


def test_small_gauge_pressure_in_single_precision(simulate):
    """50 Pa above 101325 Pa, some way from the origin: within 0.1 %, though p itself is known to 0.01 Pa only."""
    scene = shell(3, 1.0, {"gauge_pressure": 50.0}, solver={"dt": 1e-3, "precision": "f32"})
    simulation = simulate(scene)
    assert gas_of(simulation).gauge_pressures() == pytest.approx(50.0, rel=1e-3)
    single = Probe(simulation, Pressure).forces()
    double = Probe(simulate(scene, precision="f64"), Pressure).forces()
    assert single == pytest.approx(double, abs=1e-3 * np.abs(double).max())


@pytest.mark.parametrize(("amount", "precision"), [(0.0, "f32"), (1e6, "f32"), (1e6, "f64")])
def test_no_gas_and_far_too_much_give_finite_forces(simulate, amount, precision):
    simulation = simulate(ring(pressure={"amount": amount}, solver={"dt": 1e-6, "precision": precision}))
    volume = gas_of(simulation).volumes()[0]
    expected = amount * GAS_CONSTANT * TEMPERATURE / volume
    assert gas_of(simulation).pressures() == pytest.approx(expected, rel=1e-6, abs=0.1)
    place(simulation, 1e-3 * simulation.positions())
    assert np.isfinite(Probe(simulation, Pressure).forces()).all()
    assert math.isfinite(simulation.energy().gas)


# -- inside out ----------------------------------------------------------------------------------------


def test_a_body_turned_inside_out_is_named(simulate):
    simulation = simulate(ring())
    mirrored = simulation.positions() * [-1.0, 1.0]
    place(simulation, mirrored)
    assert not Probe(simulation, Pressure).forces().any()
    assert gas_of(simulation).alarm() == "body 'balloon' turned inside out: its volume is not positive"
    assert gas_of(simulation).alarm() is None
    assert math.isfinite(simulation.energy().gas)
    with pytest.raises(DivergedError, match="body 'balloon' turned inside out: its volume is not positive"):
        simulation.advance(0.1)


# -- gas that comes and goes -----------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["symplectic_euler", "velocity_verlet"])
def test_a_leak_is_exact_whatever_the_step(simulate, integrator):
    gas = {"gauge_pressure": 200.0, "ambient": 1000.0, "leak": 0.7}
    simulation = simulate(held(pressure=gas, solver={"precision": "f64", "integrator": integrator}))
    for dt in (1e-3, 0.05):
        simulation.restore()
        simulation.dt = dt
        for _ in range(3):
            simulation.advance(0.5)
        assert gas_of(simulation).gauge_pressures() == pytest.approx(200.0 * math.exp(-0.7 * 1.5), rel=1e-10)


def test_a_slow_leak_is_not_lost_in_single_precision(simulate):
    gas = {"gauge_pressure": 50.0, "leak": 1e-3}
    simulation = simulate(held(pressure=gas, solver={"dt": 1e-4, "precision": "f32"}))
    start = gas_of(simulation).gauge_pressures()[0]
    simulation.advance(0.5)
    lost = start - gas_of(simulation).gauge_pressures()[0]
    assert lost == pytest.approx(start * -math.expm1(-5e-4), rel=1e-3)


def test_nothing_leaks_in(simulate):
    simulation = simulate(held(pressure={"gauge_pressure": -100.0, "leak": 5.0}))
    simulation.advance(0.5)
    assert gas_of(simulation).gauge_pressures() == pytest.approx(-100.0, rel=1e-9)


def pump(start, end, amount):
    return {"kind": "pump", "body": "balloon", "start": start, "end": end, "amount": amount}


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_a_pump_lets_in_just_its_amount(simulate, precision):
    actions = [pump(0.1, 0.35, 0.5), pump(0.2, 0.6, -0.2)]
    simulation = simulate(held(pressure={"amount": 1.0}, actions=actions, solver={"precision": precision}))
    gas = gas_of(simulation)
    times = 0.05 * np.arange(1, 17)
    expected = 1.0 + 0.5 * np.clip((times - 0.1) / 0.25, 0, 1) - 0.2 * np.clip((times - 0.2) / 0.4, 0, 1)
    for dt in (7e-4, 0.031):
        simulation.restore()
        simulation.dt = dt
        amounts = []
        for _ in times:
            simulation.advance(0.05)
            amounts.append(gas.amounts()[0])
        assert amounts == pytest.approx(expected, abs=1e-5)
        assert amounts[-1] == pytest.approx(1.3, abs=1e-12 if precision == "f64" else 1e-7)


def test_a_pump_takes_no_more_than_there_is(simulate):
    simulation = simulate(held(pressure={"amount": 1.0}, actions=[pump(0.0, 0.1, -3.0)]))
    simulation.advance(0.2)
    gas = gas_of(simulation)
    assert gas.amounts() == pytest.approx(0.0, abs=1e-14) and gas.pressures() == pytest.approx(0.0, abs=1e-9)


def test_setting_the_time_lets_nothing_in_at_once(simulate):
    simulation = simulate(held(pressure={"amount": 1.0}, actions=[pump(0.0, 1.0, 1.0)]))
    x = simulation.positions()
    simulation.set_state(x, 0.0 * x, time=0.5)
    simulation.advance(0.25)
    assert gas_of(simulation).amounts() == pytest.approx(1.25, abs=1e-9)


# -- holes ---------------------------------------------------------------------------------------------


def burst(**more):
    return held(material={"break_strain": 0.5}, **more)


def orifice(gauge, ambient, hole, volume, times):
    """Gauge pressure [Pa] of a tank with a hole [m^2], by many small steps of the law itself."""
    thermal, results, time = GAS_CONSTANT * TEMPERATURE, [], 0.0
    step = 1e-6
    for until in times:
        while time < until - 0.5 * step:
            high = ambient + max(gauge, 0.0)
            speed = math.sqrt(2.0 * abs(gauge) / (high * MOLAR_MASS / thermal))
            change = DISCHARGE * hole * speed * high / volume * step
            gauge = max(0.0, gauge - change) if gauge > 0.0 else min(0.0, gauge + change)
            time += step
        results.append(gauge)
    return results


@pytest.mark.parametrize("start", [5000.0, -5000.0])
def test_a_torn_body_empties_to_the_ambient_pressure(simulate, start):
    simulation = simulate(burst(pressure={"gauge_pressure": start}))
    gas, x = gas_of(simulation), simulation.positions()
    hole = np.linalg.norm(x[1] - x[0])
    times = [0.001, 0.002, 0.004, 0.006, 0.03]
    expected = orifice(start, 101325.0, hole, gas.volumes()[0], times)
    for dt in (1e-4, 5e-3):
        simulation.restore()
        simulation.dt = dt
        gas.faces.tears.torn[3] = 1
        gauges = []
        for before, until in zip([0.0, *times], times, strict=False):
            simulation.advance(until - before)
            gauges.append(gas.gauge_pressures()[0])
        assert gauges == pytest.approx(expected, rel=0.05)
        assert (np.diff(np.abs(gauges)) <= 0.0).all() and (np.array(gauges) * start >= 0.0).all()
        assert gauges[-1] == pytest.approx(0.0, abs=1e-9)


def test_nothing_presses_on_a_torn_face(simulate):
    simulation = simulate(burst(pressure={"gauge_pressure": 5000.0}))
    whole = Probe(simulation, Pressure).forces()
    gas_of(simulation).faces.tears.torn[0] = 1
    torn = Probe(simulation, Pressure).forces()
    a, b = simulation.assembly.order[simulation.assembly.springs[0]]
    x = simulation.positions()
    d = x[b] - x[a] if (b - a) % 12 == 1 else x[a] - x[b]
    lost = 0.5 * 5000.0 * np.array([d[1], -d[0]])
    changed = whole - torn
    assert changed[[a, b]] == pytest.approx(np.array([lost, lost]), rel=1e-9)
    assert not np.delete(changed, [a, b], axis=0).any()


# -- books, memory, threads ------------------------------------------------------------------------------


@pytest.mark.parametrize("torn", [False, True])
def test_flow_of_gas_is_in_the_ledger(simulate, torn):
    """Energy and booked work add up, and what is left is the scheme's error: with leaks, pumps, and holes."""
    scene = ring(
        24,
        0.5,
        {"gauge_pressure": 30.0, "ambient": 50.0, "leak": 2.0},
        {"stiffness": 300.0, "damping": 0.1, "break_strain": 100.0},
        actions=[pump(0.1, 0.4, 0.01)],
        diagnostics={"ledger": True},
        solver={"integrator": "velocity_verlet", "dt": 1e-3, "precision": "f64"},
    )
    simulation = simulate(scene)
    errors = []
    for dt in (1e-3, 5e-4):
        simulation.restore()
        simulation.dt = dt
        gas_of(simulation).faces.tears.torn[5] = int(torn)
        before = simulation.measure()
        simulation.advance(0.5)
        after = simulation.measure()
        work = {term: after.work[term] - before.work[term] for term in after.work}
        assert abs(work["gas_flow"]) > 0.1
        errors.append(abs(after.energy.total - before.energy.total - sum(work.values())))
    assert errors[1] < 0.6 * errors[0]
    assert errors[1] < 1e-2


def busy(precision="f32", **more):
    return shell(
        3,
        0.5,
        {"gauge_pressure": 100.0, "leak": 0.5},
        {"stiffness": 50.0, "damping": 0.01},
        actions=[pump(0.02, 0.3, 0.05)],
        solver={"precision": precision, "dt": 5e-4},
        **more,
    )


@pytest.mark.parametrize("serial", [True, False])
def test_one_and_two_threads_give_the_same_bits(serial):
    results = []
    for threads in (1, 2):
        simulation = Simulation(busy(), threads=threads, serial=serial)
        simulation.advance(0.1)
        results.append((simulation.positions(), gas_of(simulation).amounts()))
        simulation.close()
    assert all(np.array_equal(one, two) for one, two in zip(*results, strict=True))
    assert np.abs(np.linalg.norm(results[0][0], axis=1) - 0.5).max() > 5e-4


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_amounts_are_saved_and_restored_to_the_bit(simulate, tmp_path, precision):
    simulation = simulate(busy(precision))
    simulation.advance(0.05)
    simulation.save(tmp_path / "half.npz")
    half = gas_of(simulation).memory()
    gas_of(simulation).keep()
    simulation.advance(0.05)
    end, positions = gas_of(simulation).memory(), simulation.positions()
    loaded = Simulation.load(tmp_path / "half.npz")
    loaded.advance(0.05)
    assert all(np.array_equal(gas_of(loaded).memory()[name], end[name]) for name in end)
    assert np.array_equal(loaded.positions(), positions)
    gas = gas_of(simulation)
    gas.restore()
    assert not np.array_equal(half["gas.excess"], end["gas.excess"])
    simulation.restore()
    assert gas_of(simulation).gauge_pressures() == pytest.approx(100.0, rel=1e-3)


def test_two_gases_do_not_mix(simulate):
    bodies = []
    for name, x, gauge in (("left", -2.0, 100.0), ("right", 2.0, 300.0)):
        shape = {"kind": "ring", "radius": 0.5, "segments": 100}
        bodies.append(
            {
                "name": name,
                "shape": shape,
                "position": [x, 0.0],
                "material": {"stiffness": 1.0, "mass": 1.0},
                "pressure": {"gauge_pressure": gauge},
            }
        )
    bodies.insert(1, {"name": "dust", "shape": {"kind": "custom", "points": [[0.0, 0.0]]}})
    simulation = simulate(make_scene(dimension=2, solver={"dt": 1e-4, "precision": "f64"}, bodies=bodies))
    assert gas_of(simulation).gauge_pressures() == pytest.approx([100.0, 300.0], rel=1e-9)
    forces = np.linalg.norm(Probe(simulation, Pressure).forces(), axis=1)
    edge = 2.0 * 0.5 * math.sin(math.pi / 100) * math.cos(math.pi / 100)
    assert forces == pytest.approx(np.repeat([100.0 * edge, 0.0, 300.0 * edge], [100, 1, 100]), rel=1e-9)
