"""What slides over corners and around bows of edges: the velocity is what the place says, and nothing is held."""

import math

import numpy as np
import pytest

from tests.conftest import make_scene

G = 9.81


def _slope(angles, lengths, floor=-30.0):
    """A terrain that begins at the origin: straight pieces that go down by these angles [deg]; its outline."""
    corners = [np.zeros(2)]
    for angle, length in zip(angles, lengths, strict=True):
        way = np.array([math.cos(math.radians(angle)), -math.sin(math.radians(angle))])
        corners.append(corners[-1] + length * way)
    return [[0.0, floor], [float(corners[-1][0]), floor], *[corner.tolist() for corner in reversed(corners)]]


def _points(outline, starts, radius, integrator="symplectic_euler", dt=1e-4, precision="f64", velocity=(0.0, 0.0)):
    bodies = [
        {
            "name": f"point {k}",
            "radius": radius,
            "velocity": list(velocity),
            "shape": {"kind": "custom", "points": [list(start)], "masses": [1.0]},
        }
        for k, start in enumerate(starts)
    ]
    return make_scene(
        dimension=2,
        duration=3.0,
        gravity=[0.0, -G],
        solver={"integrator": integrator, "dt": dt, "precision": precision},
        contact={"enabled": False},
        bodies=bodies,
        colliders=[{"kind": "polygon", "points": outline}],
    )


@pytest.mark.parametrize("integrator", ["symplectic_euler", "rk4", "implicit_euler"])
@pytest.mark.parametrize("angles", [(45.0, 44.0), (50.0, 20.0)])
def test_a_concave_corner_takes_what_goes_into_it_and_no_more(simulate, integrator, angles):
    # 0.5 m down the first slope from rest, then on; a point at the very surface and one above it by its radius.
    first, second = (math.radians(angle) for angle in angles)
    down = np.array([math.cos(first), -math.sin(first)])
    up = np.array([math.sin(first), math.cos(first)])
    for radius in (0.0, 0.037):
        scene = _points(_slope(angles, (1.0, 9.0)), [0.5 * down + radius * up], radius, integrator, dt=2e-4)
        simulation = simulate(scene)
        # A ball of a radius meets the corner earlier: where its centre is that far from both slopes.
        run = 0.5 - radius * math.tan(0.5 * (first - second))
        reached = math.sqrt(2.0 * run / (G * math.sin(first)))
        speed, left = G * math.sin(first) * reached * math.cos(first - second), 0.7 - reached
        simulation.advance(0.7)
        assert np.linalg.norm(simulation.velocities()[0]) == pytest.approx(
            speed + G * math.sin(second) * left, rel=2e-3
        )
        corner = 1.0 * down
        along = np.array([math.cos(second), -math.sin(second)])
        start = radius * math.tan(0.5 * (first - second))
        expected = start + speed * left + 0.5 * G * math.sin(second) * left**2
        assert (simulation.positions()[0] - corner) @ along == pytest.approx(expected, rel=3e-3)


def test_a_convex_corner_lets_go(simulate):
    # Faster than the edge behind the corner falls away: a parabola from the corner on, at its speed there.
    first = math.radians(30.0)
    down = np.array([math.cos(first), -math.sin(first)])
    simulation = simulate(_points(_slope((30.0, 80.0), (2.0, 9.0)), [1.0 * down], 0.0))
    time = math.sqrt(2.0 / (G * math.sin(first)))
    simulation.advance(time + 0.2)
    fall = G * math.sin(first) * time * down * 0.2 - [0.0, 0.5 * G * 0.2**2]
    assert simulation.positions()[0] == pytest.approx(2.0 * down + fall, abs=1e-3)


@pytest.mark.parametrize("radius", [0.0, 0.02])
def test_a_bowl_of_very_many_edges_is_a_round_one(simulate, radius):
    """Edges far shorter than the way of a step: a point slides down a quarter of a circle as on the smooth one."""
    inner, count = 1.0, 2500
    angles = np.linspace(math.pi, 2.0 * math.pi, count)
    bow = inner * np.column_stack([np.cos(angles), np.sin(angles)])
    outline = [[1.3, 0.0], [1.3, -1.3], [-1.3, -1.3], [-1.3, 0.0], *bow.tolist()]
    slide = inner - radius
    start = slide * np.array([math.cos(math.radians(200.0)), math.sin(math.radians(200.0))])
    simulation = simulate(_points(outline, [start], radius, dt=1e-3))
    top, lowest = simulation.energy().total, math.inf
    speed = 0.0
    for _ in range(60):
        simulation.advance(0.01)
        lowest = min(lowest, float(simulation.positions()[0, 1]))
        speed = max(speed, float(np.linalg.norm(simulation.velocities()[0])))
        assert simulation.energy().total < top + 0.02
        # Where it is and what it is said to do agree.
    assert lowest == pytest.approx(-slide, abs=2e-3)
    assert speed == pytest.approx(math.sqrt(2.0 * G * (slide + float(start[1]))), rel=2e-2)


def test_in_a_wedge_both_the_place_and_the_speed_end(simulate):
    outline = [[-2.0, -1.0], [2.0, -1.0], [2.0, 2.0], [0.0, 0.0], [-2.0, 2.0]]
    simulation = simulate(_points(outline, [[0.3, 1.0], [-0.11, 0.7]], 0.05, dt=1e-3))
    simulation.advance(2.0)
    rest = math.sqrt(2.0) * 0.05
    assert simulation.positions() == pytest.approx(np.array([[0.0, rest], [0.0, rest]]), abs=1e-3)
    assert np.abs(simulation.velocities()).max() < 0.02
