"""Inputs at the edge of sense: each runs on finitely, or stops with an error that names what is wrong."""

import numpy as np
import pytest

from sandbox import DivergedError, SandboxError
from tests.conftest import make_scene, oscillator


def runs_or_says_why(simulate, scene, seconds: float = 0.5):
    """Advance; afterwards every number of the state is finite, whether an error stopped it or not."""
    error = None
    simulation = None
    try:
        simulation = simulate(scene)
        simulation.advance(seconds)
    except SandboxError as caught:
        error = caught
        assert "\n" not in str(caught)
    if simulation is not None:
        assert np.isfinite(simulation.positions()).all()
        assert np.isfinite(simulation.velocities()).all()
        measured = simulation.measure()
        assert measured.finite
        assert np.isfinite([measured.energy.total, measured.max_strain, measured.max_speed]).all()
        simulation.close()
    return error, simulation


def points(places, **more):
    body = {"name": "points", "shape": {"kind": "custom", "points": places}, **more}
    return {"dimension": len(places[0]), "solver": {"dt": 1e-3}, "bodies": [body]}


@pytest.mark.parametrize("dimension", [2, 3])
def test_coincident_particles_stay_finite_and_still(simulate, dimension):
    places = [[0.0] * dimension, [0.0] * dimension, [1.0] * dimension]
    scene = make_scene(**points(places, radius=0.1, self_contact=True))
    error, simulation = runs_or_says_why(simulate, scene)
    assert error is None
    assert simulation.measure().max_speed == 0.0


def test_springs_of_length_zero(simulate):
    shape = {"kind": "custom", "points": [[0.0, 0.0], [0.0, 0.0], [0.1, 0.0]], "springs": [[0, 1], [1, 2], [0, 2]]}
    material = {"stiffness": 1e3, "damping": 1.0, "yield_strain": 0.01, "break_strain": 0.5}
    scene = make_scene(
        dimension=2,
        gravity=[0.0, -9.81],
        solver={"dt": 1e-3},
        bodies=[{"name": "knot", "shape": shape, "material": material}],
    )
    error, simulation = runs_or_says_why(simulate, scene)
    assert error is None
    assert simulation.measure().torn == 0


def ring(**pressure):
    return {
        "name": "ring",
        "shape": {"kind": "ring", "radius": 0.5, "segments": 24},
        "material": {"stiffness": 1e3, "damping": 1.0, "mass": 1.0},
        "pressure": pressure,
    }


def test_a_ring_that_is_turned_inside_out_is_named(simulate):
    scene = make_scene(dimension=2, solver={"dt": 1e-4}, bodies=[ring(gauge_pressure=100.0, ambient=1000.0)])
    simulation = simulate(scene)
    mirrored = simulation.positions() * [-1.0, 1.0]
    simulation.set_state(mirrored, simulation.velocities())
    with pytest.raises(DivergedError, match="'ring' turned inside out"):
        simulation.advance(0.01)
    assert np.isfinite(simulation.positions()).all()


def test_a_ring_folded_over_itself(simulate):
    """An eight: its two halves cancel, so that there is no volume for the gas."""
    scene = make_scene(dimension=2, solver={"dt": 1e-4}, bodies=[ring(gauge_pressure=100.0, ambient=1000.0)])
    simulation = simulate(scene)
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    eight = np.stack([np.cos(angle), 0.5 * np.sin(2.0 * angle)], axis=1)
    simulation.set_state(eight, np.zeros((24, 2)))
    with pytest.raises(DivergedError, match="turned inside out"):
        simulation.advance(0.01)


@pytest.mark.parametrize("amount", [0.0, 1e-9, 1e3, 1e9])
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_any_amount_of_gas(simulate, amount, precision):
    scene = make_scene(dimension=2, solver={"precision": precision}, bodies=[ring(amount=amount, ambient=1e5)])
    error, _ = runs_or_says_why(simulate, scene, 0.02)
    if amount == 0.0:
        # Nothing holds the ring against the air.
        assert error is None or "turned inside out" in str(error) or "strain" in str(error)


@pytest.mark.parametrize("ratio", [1e6, 1e-6])
def test_a_mass_ratio_of_a_million_in_contact(simulate, ratio):
    def disc(name, x, velocity, mass):
        return {
            "name": name, "position": [x, 0.0], "velocity": [velocity, 0.0], "radius": 0.1,
            "shape": {"kind": "custom", "points": [[0.0, 0.0]], "masses": [mass]}, "material": {"restitution": 1.0},
        }  # fmt: skip

    bodies = [disc("a", 0.0, 1.0, 1.0), disc("b", 0.5, 0.0, ratio)]
    scene = make_scene(dimension=2, solver={"dt": 1e-3, "precision": "f64"}, bodies=bodies)
    simulation = simulate(scene)
    simulation.advance(0.6)
    # The elastic collision of two bodies, from any textbook.
    expected = [(1.0 - ratio) / (1.0 + ratio), 2.0 / (1.0 + ratio)]
    assert simulation.velocities()[:, 0] == pytest.approx(expected, rel=1e-9)


def test_a_light_particle_between_heavy_ones(simulate):
    masses = [1e3, 1e-3, 1e3]
    shape = {"kind": "custom", "points": [[0.0, 0.0], [0.25, 0.0], [0.5, 0.0]], "masses": masses,
             "velocities": [[1.0, 0.0], [0.0, 0.0], [-1.0, 0.0]]}  # fmt: skip
    body = {"name": "row", "shape": shape, "radius": 0.1, "self_contact": True, "material": {"restitution": 0.5}}
    scene = make_scene(dimension=2, solver={"dt": 1e-4, "precision": "f64"}, bodies=[body])
    simulation = simulate(scene)
    before = simulation.energy().kinetic
    simulation.advance(0.5)
    assert simulation.energy().kinetic <= before * (1.0 + 1e-12)
    assert np.isfinite(simulation.positions()).all()


def test_a_pile_of_points_pressed_into_one_place_comes_apart(simulate):
    rng = np.random.default_rng(0)
    places = (rng.random((60, 2)) * 0.05).tolist()
    scene = make_scene(**points(places, radius=0.05, self_contact=True))
    simulation = simulate(scene)
    simulation.advance(0.5)
    assert np.isfinite(simulation.positions()).all()


def test_under_great_gravity_automatic_steps_are_short_enough_to_bounce(simulate):
    """At steps that are short for springs alone a rope would fall 16 m in one, and bounce as high."""
    shape = {"kind": "rope", "from": [-0.5, 0.0], "to": [0.5, 0.0], "segments": 5}
    floor = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "restitution": 1.0}
    rope = {"name": "rope", "shape": shape, "position": [0.0, 1.0], "material": {"stiffness": 1.0, "mass": 1.0}}
    solver = {"integrator": "xpbd", "precision": "f64"}
    simulation = simulate(make_scene(dimension=2, gravity=[0.0, -1e6], solver=solver, bodies=[rope], colliders=[floor]))
    for _ in range(10):
        simulation.advance(0.001)
        assert simulation.positions()[:, 1].max() < 1.5


@pytest.mark.parametrize(
    ("integrator", "dt", "reason"),
    [
        ("implicit_euler", 0.01, "nothing in this scene limits it with this scheme: its motion left the bounds"),
        ("xpbd", 0.01, "nothing in this scene limits it with this scheme: its motion left the bounds"),
        ("symplectic_euler", 0.01, "within the 0.06325 s that were stable before: its motion left the bounds"),
        ("symplectic_euler", 0.1, "dt was 0.1 s, stable is 0.06325 s: set solver.dt below it, or to auto"),
    ],
)
def test_a_blow_up_says_truly_what_the_step_has_to_do_with_it(simulate, integrator, dt, reason):
    scene = oscillator(integrator, dt).model_copy(update={"gravity": (0.0, -100.0)})
    bounds = scene.diagnostics.model_copy(update={"max_speed": 10.0})
    scene = scene.model_copy(update={"diagnostics": bounds, "render": scene.render.model_copy(update={"fps": 10.0})})
    with pytest.raises(DivergedError) as caught:
        simulate(scene, warns=False).advance(3.0)
    assert reason in str(caught.value) and "inf" not in str(caught.value)


@pytest.mark.parametrize(("name", "value"), [("actions.done", -1.0), ("actions.done", 1e9), ("actions.rows", 7.0)])
def test_memories_of_other_actions_are_refused(name, value, simulate):
    scene = points([[0.0, 0.0]])
    push = {"kind": "push", "start": 0.0, "end": 0.2, "body": "points", "force": [1.0, 0.0]}
    simulation = simulate(make_scene(**scene, actions=[push]))
    memory = simulation.memory
    state = simulation.positions(), simulation.velocities()
    simulation.set_state(*state, time=0.0, memory=memory)
    memory[name] = np.full_like(memory[name], value)
    with pytest.raises(SandboxError, match="state: what was done until then is not what this scene does"):
        simulation.set_state(*state, time=0.0, memory=memory)


def test_memories_of_numbers_too_large_to_compute_with_are_refused(simulate):
    scene = points([[0.0, 0.0]])
    push = {"kind": "push", "start": 0.0, "end": 0.2, "body": "points", "force": [1.0, 0.0]}
    simulation = simulate(make_scene(**scene, actions=[push]))
    memory = simulation.memory | {"actions.forces": np.full_like(simulation.memory["actions.forces"], 1e300)}
    with pytest.raises(SandboxError, match=r"state: actions.forces must be 1 numbers of at most 1e\+15"):
        simulation.set_state(simulation.positions(), simulation.velocities(), time=0.0, memory=memory)
