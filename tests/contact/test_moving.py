"""Colliders that move by keyframes, and the particles that they push, drag, throw and carry."""

import math

import numpy as np
import pytest

from sandbox.scene.model import BoxCollider, Keyframe
from sandbox.scene.motion import motion_of
from tests.conftest import make_scene

EXACT = {"dt": 1e-3, "precision": "f64"}


def particles(positions, velocities, colliders, **more):
    """Particles of 1 kg that do not meet each other."""
    points = np.asarray(positions, dtype=float)
    shape = {"kind": "custom", "points": points.tolist(), "velocities": np.asarray(velocities, dtype=float).tolist()}
    more.setdefault("solver", EXACT)
    body = {"name": "points", "shape": shape, "radius": more.pop("radius", 0.0)}
    return make_scene(dimension=points.shape[1], bodies=[body], contact={"enabled": False}, colliders=colliders, **more)


def moves(*keys, **more):
    """A linear motion through (time, position) or (time, position, rotation)."""
    names = ("time", "position", "rotation")
    return {"motion": [dict(zip(names, key, strict=False)) for key in keys], "interpolation": "linear", **more}


MOTIONS = {
    2: [
        moves((0.2, [1.0, 2.0], 10.0), (1.0, [3.0, -1.0], 400.0), (1.5, [0.0, 0.0], -30.0)),
        moves((0.0, [1.0, 2.0]), (2.0, [3.0, 2.0], 7200.0), interpolation="smooth"),
        moves((0.5, [1.0, 2.0], 90.0)),
    ],
    3: [
        moves((0.0, [1.0, 2.0, 0.0], [10.0, 20.0, 30.0]), (1.3, [3.0, -1.0, 1.0], [200.0, -80.0, 700.0])),
        moves((0.1, [0.0] * 3, [0.0] * 3), (2.0, [0.0, 1.0, 5.0], [90.0, 45.0, -60.0]), interpolation="smooth"),
    ],
}  # fmt: skip


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_poses_on_the_device_are_those_of_the_motion(simulate, dimension, precision):
    box = {"kind": "box", "position": [0.5] * dimension, "size": [1.0] * dimension}
    colliders = [{**box, **motion} for motion in MOTIONS[dimension]]
    scene = particles([[99.0] * dimension], [[0.0] * dimension], colliders, solver={"dt": 1e-3, "precision": precision})
    motions = simulate(scene)._wake().parts.movers[0]
    rounding = 2e-6 if precision == "f32" else 1e-12
    for time in [*np.linspace(0.0, 2.2, 23), 0.2, 1.3, 1.4999]:
        motions.set_time(time)
        turn, spin = motions.turn.to_numpy()[2], motions.spin.to_numpy()[2]
        for index, row in motions.rows.items():
            reference = motion_of(scene.colliders[index], dimension)
            origin, matrix = reference.pose(time)
            assert motions.origin.to_numpy()[2, row] == pytest.approx(origin, abs=4.0 * rounding)
            assert turn[row] == pytest.approx(matrix, abs=30.0 * rounding)
            if precision == "f64" and min(abs(time - key) for key in reference.times) > 1e-3:
                h = 1e-5
                (before, old), (after, new) = reference.pose(time - h), reference.pose(time + h)
                velocity = (after - before) / (2.0 * h)
                assert motions.velocity.to_numpy()[2, row] == pytest.approx(velocity, abs=1e-5)
                skew = (new - old) / (2.0 * h) @ matrix.T
                expected = [skew[1, 0]] if dimension == 2 else [skew[2, 1], skew[0, 2], skew[1, 0]]
                assert spin[row] == pytest.approx(expected, rel=1e-6, abs=1e-5)


def test_what_stands_still_has_no_motion(simulate):
    ground = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    assert simulate(particles([[0.0, 1.0]], [[0.0, 0.0]], [ground]))._wake().parts.movers == []


def test_keyframes_that_never_change_are_a_collider_at_rest(simulate):
    """The same falls and bounces, up to rounding, on solids that stand still and that "moves" nowhere."""
    still = [
        {"kind": "half_space", "point": [0.0, -1.0], "normal": [0.3, 1.0]},
        {"kind": "box", "position": [0.0, 0.0], "size": [1.0, 0.5], "rotation": 20.0},
        {"kind": "capsule", "position": [2.0, 0.0], "from": [-0.5, 0.0], "to": [0.5, 0.1], "radius": 0.2},
        {"kind": "polygon", "position": [4.0, 0.0], "points": [[-0.5, 0.2], [0.0, -0.4], [0.6, 0.1]], "rotation": 15.0},
    ]  # fmt: skip
    common = {"friction": 0.2, "restitution": 0.6}
    starts = [[x, 1.0] for x in np.linspace(-3.0, 5.0, 33)]
    results = []
    for motion in ({}, {"motion": [{"time": 0.0}, {"time": 1.0}]}):
        colliders = [{**collider, **common, **motion} for collider in still]
        simulation = simulate(particles(starts, np.zeros((33, 2)), colliders, gravity=[0.0, -9.81]))
        simulation.advance(1.0)
        results.append((simulation.positions(), simulation.velocities()))
    assert results[1][0] == pytest.approx(results[0][0], abs=1e-6)
    assert results[1][1] == pytest.approx(results[0][1], abs=1e-5)


def test_a_paddle_with_restitution_throws_at_twice_its_speed(simulate):
    speed = 3.0
    outline = [[-0.1, -0.5], [0.1, -0.5], [0.1, 0.5], [-0.1, 0.5]]
    kinds = [
        {"kind": "box", "position": [-1.0, 0.0], "size": [0.2, 1.0]},
        {"kind": "polygon", "position": [-1.0, 5.0], "points": outline},
        {"kind": "half_space", "point": [0.0, 9.0], "normal": [0.0, -1.0]},
    ]
    ends = [[-1.0 + speed, 0.0], [-1.0 + speed, 5.0], [0.0, 9.0 - speed]]
    paddles = [
        {**kind, "restitution": 1.0, **moves((0.0, kind.get("position", kind.get("point"))), (1.0, end))}
        for kind, end in zip(kinds, ends, strict=True)
    ]
    simulation = simulate(particles([[0.0, 0.0], [0.0, 5.0], [50.0, 8.0]], np.zeros((3, 2)), paddles, radius=0.01))
    simulation.advance(0.5)
    assert simulation.velocities() == pytest.approx(2.0 * speed * np.array([[1, 0], [1, 0], [0, -1]]), abs=1e-9)
    way = [2.0 * speed * (0.5 - (1.0 - front - 0.01) / speed) for front in (0.1, 0.1, 0.0)]
    expected = np.array([[way[0], 0.0], [way[1], 5.0], [50.0, 8.0 - way[2]]])
    assert simulation.positions() == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_a_thin_fast_plate_does_not_jump_over_particles(simulate, precision):
    """2 mm at 100 m/s: in one step it moves 50 times its thickness; boxes, capsules and polygons alike."""
    polygon = [[-0.001, -0.5], [0.001, -0.5], [0.001, 0.5], [-0.001, 0.5]]
    plates = [
        {"kind": "box", "position": [-1.0, 0.0], "size": [0.002, 1.0]},
        {"kind": "capsule", "position": [-1.0, 5.0], "from": [0.0, -0.5], "to": [0.0, 0.5], "radius": 0.001},
        {"kind": "polygon", "position": [-1.0, 10.0], "points": polygon},
    ]
    plates = [{**plate, **moves((0.0, plate["position"]), (0.02, [1.0, plate["position"][1]]))} for plate in plates]
    starts = [[x, y + 5.0 * k] for k in range(3) for x, y in ((0.0, 0.0), (0.033, 0.1), (-0.071, -0.2))]
    simulation = simulate(
        particles(starts, np.zeros((9, 2)), plates, radius=0.005, solver={"dt": 1e-3, "precision": precision})
    )
    for dt in (1e-3, 4e-3):
        simulation.restore()
        simulation.dt = dt
        simulation.advance(0.016)
        assert simulation.measure().max_penetration < (2e-6 if precision == "f32" else 1e-9)
        assert (simulation.positions()[:, 0] >= 0.606 - 1e-5).all()
        assert simulation.velocities()[:, 0] == pytest.approx(np.full(9, 100.0), rel=1e-5)


def test_friction_takes_a_particle_to_the_speed_of_the_floor(simulate):
    """A belt at 2 m/s, and one that rises at 0.5 m/s beside: slip at mu g (times (a + g)/g), then rest on it."""
    friction, gravity = 0.4, 9.81
    floors = [
        {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0]},
        {"kind": "box", "position": [0.0, 5.5], "size": [60.0, 1.0]},
        {
            "kind": "polygon",
            "position": [0.0, 10.0],
            "points": [[-30.0, -1.0], [30.0, -1.0], [30.0, 0.0], [-30.0, 0.0]],
        },
    ]
    belts = []
    for floor in floors:
        start = floor.get("point", floor.get("position"))
        belts.append({**floor, "friction": friction, **moves((0.0, start), (1.0, [start[0] + 2.0, start[1] + 0.5]))})
    tops = np.array([0.0, 6.0, 10.0])
    starts = np.stack([np.zeros(3), tops], axis=1)
    for precision, close in (("f64", 1e-9), ("f32", 2e-5)):
        solver = {"dt": 1e-3, "precision": precision}
        simulation = simulate(particles(starts, np.zeros((3, 2)), belts, gravity=[0.0, -gravity], solver=solver))
        # The first touch gives 0.5 m/s upward at once, and friction its share of that impulse.
        simulation.advance(0.2)
        expected = friction * (0.5 + gravity * 0.2)
        assert simulation.velocities() == pytest.approx(np.full((3, 2), [expected, 0.5]), abs=0.01)
        simulation.advance(0.6)
        assert simulation.velocities() == pytest.approx(np.full((3, 2), [2.0, 0.5]), abs=10.0 * close)
        assert simulation.positions()[:, 1] == pytest.approx(tops + 0.4, abs=close)


def test_a_smooth_lift_carries_without_hops(simulate):
    """Up by 0.5 m in 1 s, gently: less than 1 g, so that the load stays on the platform throughout."""
    lift = {"kind": "box", "position": [0.0, -0.5], "size": [2.0, 1.0], "friction": 0.5}
    lift |= moves((0.0, [0.0, -0.5]), (1.0, [0.3, 0.0]), interpolation="smooth")
    simulation = simulate(particles([[0.0, 0.01]], [[0.0, 0.0]], [lift], gravity=[0.0, -9.81], radius=0.01))
    motion = motion_of(simulation.scene.colliders[0], 2)
    for _ in range(12):
        simulation.advance(0.1)
        origin, _ = motion.pose(simulation.time)
        x = simulation.positions()[0]
        assert x == pytest.approx([origin[0], origin[1] + 0.51], abs=2e-5)
        assert abs(simulation.measure().max_penetration) < 1e-6


def test_a_turning_drum_throws_along_its_rim(simulate):
    """Box, polygon and ball turn at 10 rad/s; with much friction a touching particle leaves with their rim's speed."""
    rate = 10.0
    square = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
    kinds = [
        {"kind": "sphere", "position": [0.0, 0.0], "radius": 0.5},
        {"kind": "box", "position": [0.0, 5.0], "size": [1.0, 1.0]},
        {"kind": "polygon", "position": [0.0, 10.0], "points": square},
        {"kind": "capsule", "position": [0.0, 15.0], "from": [-0.5, 0.0], "to": [0.5, 0.0], "radius": 0.5},
    ]
    drums = [
        {**kind, "friction": 50.0, **moves((0.0, kind["position"], 0.0), (1.0, kind["position"], math.degrees(rate)))}
        for kind in kinds
    ]
    starts = [[0.0, 5.0 * k + 0.5 + 1e-5] for k in range(4)]
    simulation = simulate(
        particles(starts, np.full((4, 2), [0.0, -1.0]), drums, solver={"dt": 1e-4, "precision": "f64"})
    )
    simulation.advance(3e-4)
    # The rim above the axis moves to -x at rate * 0.5.
    assert simulation.velocities() == pytest.approx(np.full((4, 2), [-0.5 * rate, 0.0]), abs=2e-2)
    simulation.advance(0.05)
    assert (np.linalg.norm(simulation.velocities(), axis=1) >= 0.5 * rate - 1e-3).all()
    assert simulation.measure().max_penetration < 1e-9


def test_carried_particles_go_where_their_collider_goes(simulate):
    """Attached to a mixer's arm and to a block that stands still, pulling at springs all the while."""
    arm = {"name": "arm", "kind": "capsule", "from": [0, 0, 0], "to": [1, 0, 0], "radius": 0.1, "rotation": [0, 30, 0]}
    arm |= moves((0.0, [0, 0, 0], [0, 30, 0]), (1.0, [0.5, 1.0, 0.0], [200, 90, -40]), interpolation="smooth")
    rope = {"kind": "rope", "from": [1.0, 0.0, 0.0], "to": [2.0, 0.0, 0.0], "segments": 5}
    body = {"name": "rope", "shape": rope, "material": {"stiffness": 50.0, "mass": 0.1, "damping": 0.1}}
    scene = make_scene(
        dimension=3,
        gravity=[0.0, -9.81, 0.0],
        bodies=[body],
        colliders=[arm],
        attachments=[{"body": "rope", "indices": [0, 1], "to": "arm"}],
        solver={"dt": 1e-3, "precision": "f64"},
    )
    simulation = simulate(scene)
    motion = motion_of(scene.colliders[0], 3)
    origin, turn = motion.pose(0.0)
    local = (simulation.positions()[:2] - origin) @ turn
    for _ in range(6):
        simulation.advance(0.2)
        origin, turn = motion.pose(simulation.time)
        assert simulation.positions()[:2] == pytest.approx(local @ turn.T + origin, abs=1e-12)
        ahead, behind = (motion.pose(simulation.time + h) for h in (1e-6, -1e-6))
        velocity = (local @ ahead[1].T + ahead[0] - local @ behind[1].T - behind[0]) / 2e-6
        assert simulation.velocities()[:2] == pytest.approx(velocity, abs=1e-5)


def test_threads_do_not_change_what_moving_colliders_do(simulate):
    rng = np.random.default_rng(6)
    starts = rng.uniform(-1.0, 1.0, (300, 2))
    points = [[-1.5, -1.5], [1.5, -1.5], [1.5, 1.5], [-1.5, 1.5]]
    hole = [[-1.2, -1.2], [1.2, -1.2], [1.2, 1.2], [-1.2, 1.2]]
    drum = {"kind": "polygon", "points": points, "holes": [hole], "friction": 0.3}
    drum |= moves((0.0, [0.0, 0.0], 0.0), (1.0, [0.2, 0.1], 300.0))
    scene = particles(starts, np.zeros_like(starts), [drum], gravity=[0.0, -9.81], radius=0.01, solver={"dt": 1e-3})
    results = []
    for threads in (1, 2):
        simulation = simulate(scene, threads=threads, serial=False)
        simulation.advance(0.5)
        results.append(simulation.positions())
        assert simulation.measure().max_penetration < 2e-4
    assert np.array_equal(*results)


def test_friction_is_booked_apart_from_collision(simulate):
    """A slide that stops: friction takes its energy. A bounce: the collision takes (1 - e^2) of it."""
    ground = {"kind": "half_space", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.5}
    belt = {**ground, **moves((0.0, [0.0, 0.0]), (1.0, [2.0, 0.0]))}
    for collider, start, expected in ((ground, 2.0, -0.5 * 2.0**2), (belt, 0.0, 0.5 * 2.0**2)):
        scene = particles([[0.0, 0.0]], [[start, 0.0]], [collider], gravity=[0, -9.81], diagnostics={"ledger": True})
        simulation = simulate(scene)
        parts = simulation._wake().parts
        simulation.advance(0.9)
        work = parts.ledger[0].totals()
        assert work["friction"] == pytest.approx(expected, rel=1e-9)
        # What a step pushes into the ground and out again is of first order in dt.
        assert work["collision"] == pytest.approx(0.0, abs=0.05)


def test_a_motion_begins_at_the_collider_s_own_place():
    box = BoxCollider(kind="box", position=(1.0, 2.0), size=(1.0, 1.0), motion=(Keyframe(time=0.0), Keyframe(time=1.0)))
    assert motion_of(box, 2).pose(0.5)[0].tolist() == [1.0, 2.0]
