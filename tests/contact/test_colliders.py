"""Colliders: rest, friction, restitution, and that nothing passes through at any speed."""

import math

import numpy as np
import pytest

from tests import analytical
from tests.conftest import falling_point, make_scene

GROUND = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
WALLS = {
    "half_space": {"kind": "half_space", "point": [0.01, 0.0], "normal": [-1.0, 0.0]},
    "sphere": {"kind": "sphere", "position": [0.01, 0.0], "radius": 0.01},
    "box": {"kind": "box", "position": [0.01, 0.0], "size": [0.02, 1.0]},
    "turned box": {"kind": "box", "position": [0.01, 0.0], "size": [1.0, 0.02], "rotation": 90.0},
    "capsule": {"kind": "capsule", "from": [0.01, -0.5], "to": [0.01, 0.5], "radius": 0.01},
    "polygon": {"kind": "polygon", "points": [[0.0, -0.5], [0.02, -0.5], [0.02, 0.5], [0.0, 0.5]]},
}


@pytest.mark.parametrize("speed", [1.0, 100.0, 5e4])
@pytest.mark.parametrize("kind", WALLS)
def test_no_speed_carries_a_particle_through_a_thin_wall(simulate, kind, speed):
    scene = falling_point(
        velocity=(speed, 0.0), position=(-0.5, 0.0), radius=0.005, solver={"dt": 1e-2}, colliders=[WALLS[kind]]
    )
    simulation = simulate(scene)
    simulation.advance(1.0 if speed == 1.0 else 0.1)
    # The front of the wall is at 0 but for the half space, which begins at 0.01.
    front = 0.01 if kind == "half_space" else 0.0
    assert simulation.positions()[0, 0] == pytest.approx(front - 0.005, abs=1e-6)
    assert simulation.velocities()[0] == pytest.approx([0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("restitution", [1.0, 0.7, 0.4])
@pytest.mark.parametrize("kind", ["half_space", "capsule", "polygon"])
def test_rebound_heights(simulate, kind, restitution):
    solver = {"integrator": "velocity_verlet", "dt": 1e-5, "precision": "f64"}
    solid = {
        "half_space": GROUND,
        "capsule": {"kind": "capsule", "from": [-1.0, -0.5], "to": [1.0, -0.5], "radius": 0.5},
        "polygon": {"kind": "polygon", "points": [[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]]},
    }[kind]
    ground = {**solid, "restitution": restitution}
    simulation = simulate(falling_point(gravity=[0.0, -9.81], solver=solver, colliders=[ground]))
    # h0 = 1; the n-th rebound tops out at e^(2n).
    top = math.sqrt(2.0 / 9.81)
    time = top
    for bounce in range(1, 4):
        rise = restitution**bounce * top
        simulation.advance(time + rise - simulation.time)
        assert simulation.positions()[0, 1] == pytest.approx(restitution ** (2 * bounce), rel=1e-3)
        time += 2.0 * rise


@pytest.mark.parametrize("kind", ["half_space", "box", "capsule", "polygon"])
@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_incline(simulate, kind, friction):
    """A particle on a slope slides iff tan(angle) > mu, and then as Coulomb says."""
    gravity, time = 9.81, 0.5
    for angle in (math.atan(friction) - 0.01, math.atan(friction) + 0.1):
        normal = np.array([math.sin(angle), math.cos(angle)])
        down = np.array([math.cos(angle), -math.sin(angle)])
        if kind == "half_space":
            slope = {"kind": kind, "point": [0.0, 0.0], "normal": normal.tolist()}
        elif kind == "capsule":
            ends = [(side * 4.5 * down - 0.5 * normal).tolist() for side in (-1.0, 1.0)]
            slope = {"kind": kind, "from": ends[0], "to": ends[1], "radius": 0.5}
        elif kind == "polygon":
            corners = [[-4.5, -1.0], [4.5, -1.0], [4.5, 0.0], [-4.5, 0.0]]
            slope = {"kind": kind, "points": corners, "rotation": -math.degrees(angle)}
        else:
            centre = -0.5 * normal
            slope = {"kind": kind, "position": centre.tolist(), "size": [9.0, 1.0], "rotation": -math.degrees(angle)}
        scene = falling_point(position=(0.0, 0.0), gravity=[0.0, -gravity], colliders=[{**slope, "friction": friction}])
        simulation = simulate(scene)
        simulation.advance(time)
        speed = simulation.velocities()[0] @ down
        expected = max(0.0, analytical.sliding(0.0, angle, friction, gravity, time))
        assert speed == pytest.approx(expected, abs=1e-9)
        if expected == 0.0:
            assert np.abs(simulation.positions()).max() < 1e-9
        assert abs(simulation.positions()[0] @ normal) < 1e-9


def test_stopping_distance(simulate):
    ground = {**GROUND, "friction": 0.5}
    simulation = simulate(
        falling_point(velocity=(2.0, 0.0), position=(0.0, 0.0), gravity=[0.0, -9.81], colliders=[ground])
    )
    simulation.advance(1.0)
    assert simulation.velocities()[0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert simulation.positions()[0, 0] == pytest.approx(2.0**2 / (2.0 * 0.5 * 9.81), rel=5e-3)


@pytest.mark.parametrize("kind", ["sphere", "box", "half_space"])
def test_starting_inside_comes_out_at_the_closest_surface_without_speed(simulate, kind):
    solid = {
        "sphere": {"kind": "sphere", "position": [0.0, 0.0], "radius": 1.0},
        "box": {"kind": "box", "position": [0.0, 0.0], "size": [2.0, 2.0]},
        "half_space": {"kind": "half_space", "point": [1.0, 0.0], "normal": [1.0, 0.0]},
    }[kind]
    simulation = simulate(falling_point(position=(0.9, 0.0), colliders=[solid]))
    simulation.advance(0.1)
    assert simulation.positions()[0] == pytest.approx([1.0, 0.0], abs=1e-9)
    assert simulation.velocities()[0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert simulation.measure().max_penetration < 1e-9


@pytest.mark.parametrize("dimension", [2, 3])
def test_many_of_a_kind_are_those_one_by_one(simulate, dimension):
    """Kernels hold few solids as constants and many in a table: the same trajectories."""
    rng = np.random.default_rng(8)
    zero = [0.0] * dimension
    if dimension == 2:
        kinds = [
            {"kind": "sphere", "radius": 0.2},
            {"kind": "half_space", "normal": [0.1, 1.0]},
            {"kind": "polygon", "points": [[0.0, 0.0], [0.4, 0.0], [0.1, 0.1], [0.0, 0.4]], "rotation": 15.0},
        ]
    else:
        kinds = [
            {"kind": "box", "size": [0.3] * 3, "rotation": [20.0, 10.0, 5.0]},
            {"kind": "capsule", "from": zero, "to": [0.3] * 3, "radius": 0.1},
        ]
    colliders = []
    for k in range(3):
        for column, kind in enumerate(kinds):
            place = [float(column), 0.5 * k, *[0.0] * (dimension - 2)]
            where = {"point": [0.0, -1.0 - k, *zero[2:]]} if kind["kind"] == "half_space" else {"position": place}
            colliders.append({**kind, **where, "restitution": 0.5, "friction": 0.2})
    points = np.concatenate([rng.uniform([-0.5, 1.3], [2.5, 2.0], (48, 2)), 0.05 * rng.normal(size=(48, 1))], axis=1)
    shape = {"kind": "custom", "points": points[:, :dimension].tolist()}
    results = []
    for slightly in (0.0, 1e-13):  # a friction of its own keeps each solid by itself
        own = [{**c, "friction": c["friction"] + slightly * row} for row, c in enumerate(colliders)]
        simulation = simulate(
            make_scene(
                dimension=dimension,
                solver={"dt": 1e-3, "precision": "f64"},
                gravity=[0.0, -9.81, *zero[2:]],
                bodies=[{"name": "rain", "shape": shape}],
                colliders=own,
            )
        )
        assert len(simulation._wake().parts.colliders) == (len(kinds) if slightly == 0.0 else len(colliders))
        simulation.advance(0.4)
        assert simulation.measure().max_penetration < 1e-9
        results.append(simulation.positions())
    assert results[0] == pytest.approx(results[1], abs=1e-6)


def test_touching_a_thin_wall_is_no_way_through_it(simulate):
    """From right at the surface, or a rounding inside it, inward and out on the other side within one step."""
    starts = [[-1e-9, 0.1], [1e-9, 0.0], [-1e-9, -0.1], [0.01, 5.0 - 0.01 + 1e-9]]
    velocities = [[100.0, 0.0], [100.0, 3.0], [100.0, -3.0], [0.0, 100.0]]
    shape = {"kind": "custom", "points": starts, "velocities": velocities}
    ball = {"kind": "sphere", "position": [0.01, 5.0], "radius": 0.01}
    for wall in ("box", "polygon", "capsule"):
        simulation = simulate(
            make_scene(
                dimension=2,
                solver={"dt": 1e-3, "precision": "f64"},
                bodies=[{"name": "shots", "shape": shape}],
                colliders=[WALLS[wall], ball],
            )
        )
        simulation.advance(1e-3)
        assert np.abs(simulation.velocities()[:3, 0]).max() < 1e-6
        assert np.abs(simulation.positions()[:3, 0]).max() < 1e-6
        assert simulation.positions()[3, 1] == pytest.approx(4.99, abs=1e-6)


def test_centre_of_a_sphere_is_no_trap(simulate):
    simulation = simulate(
        falling_point(position=(0.0, 0.0), colliders=[{"kind": "sphere", "position": [0.0, 0.0], "radius": 1.0}])
    )
    simulation.advance(0.01)
    assert np.linalg.norm(simulation.positions()[0]) == pytest.approx(1.0)


def test_three_dimensions_box_in_any_orientation(simulate):
    """Shots at a turned box from all sides end on its surface, outside, and the normal speed is gone."""
    rng = np.random.default_rng(1)
    starts = rng.normal(size=(64, 3))
    starts *= 3.0 / np.linalg.norm(starts, axis=1, keepdims=True)
    scene = make_scene(
        dimension=3,
        solver={"dt": 0.05, "precision": "f64"},
        bodies=[
            {
                "name": "shots",
                "shape": {
                    "kind": "custom",
                    "points": starts.tolist(),
                    "velocities": (-100.0 * starts).tolist(),
                },
            }
        ],
        colliders=[{"kind": "box", "position": [0, 0, 0], "size": [1.0, 0.4, 0.8], "rotation": [30, 50, 10]}],
    )
    simulation = simulate(scene)
    simulation.advance(0.05)
    from sandbox.scene.placement import rotation_matrix

    local = simulation.positions() @ rotation_matrix((30.0, 50.0, 10.0), 3)
    gap = np.abs(local) - np.array([0.5, 0.2, 0.4])
    # Each slid along the face it met, so it is at the face's level or has left over an edge.
    assert gap.max(axis=1).min() > -1e-9
    assert simulation.measure().max_penetration < 1e-9


def test_pinned_particles_are_not_pushed(simulate):
    scene = make_scene(
        dimension=2,
        gravity=[0.0, -9.81],
        bodies=[
            {
                "name": "pair",
                "shape": {"kind": "custom", "points": [[0.0, -0.5], [0.0, 1.0]], "springs": [[0, 1]], "pinned": [0]},
                "material": {"stiffness": 1000.0, "damping": 1.0},
            }
        ],
        colliders=[GROUND],
    )
    simulation = simulate(scene)
    simulation.advance(0.5)
    assert simulation.positions()[0].tolist() == [0.0, -0.5]


def test_material_friction_and_restitution_combine(simulate):
    """Two bodies on one ground: geometric mean of friction, larger restitution, each for its own body."""
    bodies = [
        {
            "name": name,
            "position": [x, 0.0],
            "velocity": [1.0, -1.0],
            "shape": {"kind": "custom", "points": [[0.0, 0.0]]},
            "material": material,
        }
        for name, x, material in (("rubber", 0.0, {"restitution": 0.8, "friction": 0.4}), ("plain", 1.0, {}))
    ]
    ground = {**GROUND, "restitution": 0.2, "friction": 0.1}
    simulation = simulate(make_scene(dimension=2, solver={"precision": "f64"}, bodies=bodies, colliders=[ground]))
    simulation.advance(1e-3)
    rubber, plain = simulation.velocities()
    assert rubber == pytest.approx([1.0 - 0.2 * 1.8, 0.8])
    assert plain == pytest.approx([1.0 - 0.1 * 1.2, 0.2])
