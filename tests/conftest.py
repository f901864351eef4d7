"""Helpers that every test uses. Scenes are small and of few sizes: each new one compiles."""

import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from sandbox import Scene, Simulation, cli
from sandbox.scene.load import scene_from_data


def make_scene(**parts: Any) -> Scene:
    """A scene from plain data, as a TOML file would give it."""
    return scene_from_data(parts, None, source="test")


def oscillator(integrator: str, dt: float | str, damping_ratio: float = 0.0, start: float = 1.5) -> Scene:
    """Mass 1 on a spring of 1000 N/m and rest length 1 to a pinned point, starting at ``start`` on the x axis."""
    return make_scene(
        dimension=2,
        solver={"integrator": integrator, "dt": dt, "precision": "f64"},
        bodies=[
            {
                "name": "pair",
                "shape": {
                    "kind": "custom",
                    "points": [[0.0, 0.0], [start, 0.0]],
                    "springs": [[0, 1]],
                    "rest_lengths": [1.0],
                    "masses": [1.0, 1.0],
                    "pinned": [0],
                },
                "material": {"stiffness": 1000.0, "damping_ratio": damping_ratio},
            }
        ],
    )


def falling_point(
    velocity: tuple[float, ...] = (0.0, 0.0), position: tuple[float, ...] = (0.0, 1.0), **more: Any
) -> Scene:
    """One particle of 1 kg, without springs."""
    more.setdefault("dimension", len(position))
    more.setdefault("solver", {"dt": 1e-3, "precision": "f64"})
    radius = more.pop("radius", 0.0)
    point = {"kind": "custom", "points": [[0.0] * len(position)], "masses": [1.0]}
    body = {"name": "point", "position": position, "velocity": velocity, "radius": radius, "shape": point}
    return make_scene(bodies=[body], **more)


@pytest.fixture
def simulate():
    """Build simulations that are closed when the test ends."""
    built: list[Simulation] = []

    def build(scene: Scene, **options: Any) -> Simulation:
        built.append(Simulation(scene, **options))
        return built[-1]

    yield build
    for simulation in built:
        simulation.suspend()


def left_in(folder: Path) -> set[str]:
    """Names of what a command has left in a folder for its user; the mark is hidden."""
    return {path.name for path in folder.iterdir() if not path.name.startswith(".")}


def heed_interrupts() -> None:
    """In a child before it begins: shells have what they run in the background ignore SIGINT, and so would it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def command_line(*arguments: object, monkeypatch, capsys) -> tuple[int, str, str]:
    """Run the command line in this process: exit code, standard output, standard error."""
    monkeypatch.setattr(sys, "argv", ["sandbox", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    printed = capsys.readouterr()
    return int(caught.value.code or 0), printed.out, printed.err


@pytest.fixture
def run_cli(monkeypatch, capsys):
    return lambda *arguments: command_line(*arguments, monkeypatch=monkeypatch, capsys=capsys)


@pytest.fixture
def refuses(run_cli, monkeypatch, tmp_path):
    """Check that a command is refused with one line that says ``message``, and leaves nothing behind."""

    def check(message: str, *arguments: object) -> None:
        monkeypatch.chdir(tmp_path)
        code, printed, errors = run_cli(*arguments)
        assert (code, printed) == (2, "")
        assert message in errors and errors.count("\n") == 1
        assert not (tmp_path / "outputs").exists()

    return check
