"""Rescue: a run that goes wrong returns to the last good picture and halves its steps; and steps that follow shapes."""

import numpy as np
import pytest

from sandbox import DivergedError, Simulation
from tests.conftest import make_scene, oscillator

pytestmark = pytest.mark.filterwarnings("ignore::sandbox.warning_log.StabilityWarning")


def unstable(adapt: str | None, most: int = 8):
    """The oscillator with a step five times its limit."""
    scene = oscillator("velocity_verlet", 0.3, start=1.2)
    solver = scene.solver.model_copy(update={"adapt": adapt, "most_halvings": most})
    return scene.model_copy(update={"solver": solver})


def test_without_rescue_a_blow_up_is_an_error(simulate):
    with pytest.raises(DivergedError):
        simulate(unstable(None)).advance(10.0)


def test_a_rescue_halves_the_step_until_it_holds_and_says_so(simulate):
    simulation = simulate(unstable("rescue"))
    simulation.advance(6.0)
    assert simulation.time == pytest.approx(6.0)
    assert simulation.dt < 2.0 / np.sqrt(1000.0) <= 2.0 * simulation.rescues[-1].dt
    assert [rescue.dt for rescue in simulation.rescues] == pytest.approx([0.15, 0.075, 0.0375], rel=0.3)
    assert all("pair" in rescue.reason and rescue.time <= 6.0 for rescue in simulation.rescues)
    # The error was stopped where it began: the amplitude is still that of the start, not a hundred times it.
    assert np.abs(simulation.positions()[1, 0] - 1.0) < 0.5


def test_rescues_are_bounded(simulate):
    simulation = simulate(unstable("rescue", most=1))
    with pytest.raises(DivergedError):
        simulation.advance(10.0)
    assert len(simulation.rescues) == 1
    assert np.isfinite(simulation.positions()).all()


def stretching():
    """A compressed star whose springs will be stretched by far: its limit falls as it flies apart."""
    angles = np.arange(6) * np.pi / 3.0
    points = [[0.0, 0.0], *([float(np.cos(a)), float(np.sin(a))] for a in angles)]
    body = {
        "name": "star",
        "shape": {
            "kind": "custom",
            "points": points,
            "springs": [[0, k] for k in range(1, 7)] + [[k, k % 6 + 1] for k in range(1, 7)],
            "velocities": [[0.0, 0.0], *([800.0 * x, 800.0 * y] for x, y in points[1:])],
        },
        "material": {"stiffness": 4e4, "mass": 1.0},
    }
    solver = {"dt": "auto", "precision": "f64", "safety": 0.95}
    return make_scene(dimension=2, solver=solver, bodies=[body], render={"fps": 500.0})


def test_auto_steps_are_looked_at_again_as_a_body_stretches_and_are_kept_by_checkpoints(simulate, tmp_path):
    simulation = simulate(stretching())
    first = simulation.dt
    simulation.advance(0.05)
    assert simulation.dt < 0.9 * first
    simulation.save(tmp_path / "star.npz")
    other = Simulation.load(tmp_path / "star.npz")
    assert other.dt == simulation.dt
    simulation.advance(0.05)
    other.advance(0.05)
    assert simulation.positions().tobytes() == other.positions().tobytes()
    other.suspend()
    simulation.restore()
    assert simulation.dt == first


def test_a_step_of_the_user_s_own_is_left_alone(simulate):
    simulation = simulate(stretching())
    simulation.dt = 1e-4
    simulation.advance(0.05)
    assert simulation.dt == 1e-4
