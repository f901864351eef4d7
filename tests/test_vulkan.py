"""Scenes on Vulkan against the same on the CPU; skipped where there is no driver.

Both compute the same sums in the same order, so they differ by rounding alone: in double precision some 1e-16 of the
scene's size a step, over a few hundred steps. What else could go wrong makes far more: a field over another, a race, a
function in single precision (6e-8).
"""

import os
import subprocess
import sys

import numpy as np
import pytest
import taichi as ti

from sandbox import RuntimeUnavailableError, Simulation, functions, runtime
from sandbox.scene.model import IntegratorName
from sandbox.state import place
from tests.conftest import make_scene

_TIME, _SCHEME_TIME = 0.01, 0.002
"""[s]; sweeps are many launches, each slow on a driver without a GPU."""
_ALIKE, _ALIKE_SINGLE = 1e-10, 1e-5
"""Largest difference of places, over the size of the scene [1]."""
_SCENES = ["gas", "gas in single precision", "contact", "hands", "shell", "clay"]
_MEASURED = ["gas", "hands", "clay"]
"""Where springs tear, or work is booked."""
_SCHEMES = [scheme.value for scheme in IntegratorName]
_CUBE = """v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 2 3 7\nf 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8\n"""


@pytest.fixture(scope="module", autouse=True)
def driver():
    """Skips what needs a driver where there is none; afterwards others find the CPU again."""
    try:
        runtime.check("vulkan", "f32", None)
    except RuntimeUnavailableError as error:
        pytest.skip(f"{error}; Debian's mesa-vulkan-drivers has a driver that needs no GPU")
    yield
    runtime.stop()


def make(dimension, bodies, **parts):
    """A scene under gravity, in double precision."""
    gravity = [0.3, -9.81, 0.1][:dimension]
    solver = {"precision": "f64", "dt": 1.5e-4} | parts.pop("solver", {})
    return make_scene(dimension=dimension, gravity=gravity, solver=solver, bodies=bodies, **parts)


def ring(**more):
    """A ring of 37 particles, full of gas, that grows as it is let go."""
    return {
        "name": "ring",
        "shape": {"kind": "ring", "radius": 0.3, "segments": 37, "thickness": 0.01, "bend": 0.3},
        "material": {"youngs_modulus": 3e5, "damping_ratio": 0.3, "density": 600.0},
        "pressure": {"gauge_pressure": 1500.0, "ambient": 2e4, "leak": 0.7},
    } | more


def box(x, **more):
    """A block of 35 particles."""
    return {
        "name": f"box at {x}",
        "position": [x, 0.0],
        "shape": {"kind": "box", "size": [0.6, 0.4], "cells": [6, 4]},
        "material": {"youngs_modulus": 1e5, "damping_ratio": 0.2, "friction": 0.3},
    } | more


def gas_scene(**solver):
    """2D: gas that leaks, is pumped, and flows out where the ring is cut; gusts."""
    return make(
        2,
        [ring()],
        solver=solver,
        wind={"velocity": [3.0, 0.0], "gust": {"strength": 2.0}},
        actions=[
            {"kind": "pump", "body": "ring", "start": 0.003, "end": 0.015, "amount": 0.1},
            {"kind": "cut", "time": 0.006, "from": [0.01, 0.2], "to": [0.01, 0.5]},
        ],
    )


def contact_scene():
    """Two blocks that meet each other."""
    return make(2, [box(-0.36, radius=0.05, velocity=[4.0, -5.0]), box(0.35, radius=0.05, velocity=[-3.0, -5.0])])


def hands_scene():
    """A hand, a push and ground that shakes, with drag; all of it booked."""
    path = [{"time": 0.02, "position": [0.5, 0.3]}]
    return make(
        2,
        [box(0.0)],
        drag=60.0,
        diagnostics={"ledger": True},
        actions=[
            {"kind": "grab", "start": 0.004, "end": 1.0, "point": [0.3, 0.2], "radius": 0.15, "path": path},
            {"kind": "push", "start": 0.005, "end": 0.02, "force": [300.0, 50.0], "body": "box at 0.0"},
            {"kind": "shake", "start": 0.0, "end": 1.0, "amplitude": [0.01, 0.0], "frequency": 20.0},
        ],
    )


def shell_scene():
    """3D: a balloon, and a cloth in turning air that hangs on a plate that turns."""
    shell = {"kind": "shell", "radius": 0.3, "subdivisions": 2}
    made = {"stiffness": 500.0, "damping_ratio": 0.2, "mass": 0.3}
    plate = {"kind": "box", "name": "plate", "size": [1.0, 0.1, 1.0], "position": [0.1, 0.5, 0.0]}
    way = [{"time": 0.0}, {"time": 0.05, "position": [0.1, 0.3, 0.0], "rotation": [10.0, 20.0, 5.0]}]
    cloth = {"kind": "sheet", "size": [0.7, 0.6], "cells": [6, 7]}
    return make(
        3,
        [
            {"name": "balloon", "shape": shell, "material": made, "pressure": {"gauge_pressure": 300.0}},
            {"name": "cloth", "shape": cloth, "material": made, "position": [-0.6, 0.0, 0.0]},
        ],
        attachments=[{"body": "cloth", "indices": [0, 6], "to": "plate"}],
        colliders=[plate | {"motion": way}],
        wind={"velocity": [0.0, 0.0, 4.0], "vortices": [{"center": [0.0, 0.0, 0.0], "speed": 3.0, "radius": 0.2}]},
    )


def clay_scene(mesh):
    """3D: clay that flows and tears as it hits a mesh."""
    clay = {"youngs_modulus": 2e5, "damping_ratio": 0.3, "yield_strain": 0.01, "creep": 40.0, "break_strain": 0.1}
    shape = {"kind": "box", "size": [0.3, 0.4, 0.3], "cells": [3, 4, 3]}
    body = {"name": "clay", "shape": shape, "material": clay, "velocity": [0.0, -6.0, 1.0]}
    solid = {"kind": "mesh", "file": str(mesh), "scale": 0.2, "position": [0.1, -0.42, 0.0], "resolution": 9}
    return make(3, [body], colliders=[solid])


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Positions, torn springs and work of every scene on both, by name and device; few starts of Taichi."""
    mesh = tmp_path_factory.mktemp("vulkan") / "cube.obj"
    mesh.write_text(_CUBE)
    scenes = {"contact": contact_scene(), "hands": hands_scene(), "shell": shell_scene(), "clay": clay_scene(mesh)}
    scenes |= {"gas": gas_scene(), "gas in single precision": gas_scene(precision="f32")}
    scenes |= {scheme: make(2, [ring()], drag=0.5, solver={"integrator": scheme}) for scheme in _SCHEMES}
    found = {}
    for arch in ("cpu", "vulkan"):
        for name in sorted(scenes, key=lambda name: scenes[name].solver.precision):
            # Step by step on either: Taichi compiles the one long kernel of small scenes for far longer.
            with Simulation(scenes[name], arch=arch, serial=False) as simulation:
                simulation.advance(_SCHEME_TIME if name in _SCHEMES else _TIME)
                # Measuring compiles as long as a step does.
                measured = simulation.measure() if name in _MEASURED else None
                torn, work = (measured.torn, measured.work) if measured else (0, None)
                found[name, arch] = simulation.positions(), torn, work or {}
    return found


@pytest.mark.parametrize("name", [*_SCENES, *_SCHEMES])
def test_as_on_the_cpu(name, outcomes):
    """Whatever acts, in 2D and 3D, and every scheme."""
    (wanted, torn, work), (there, torn_there, work_there) = outcomes[name, "cpu"], outcomes[name, "vulkan"]
    alike = _ALIKE_SINGLE if "single" in name else _ALIKE
    assert np.abs(there - wanted).max() < alike * np.ptp(wanted, axis=0).max()
    assert torn_there == torn
    assert work_there == pytest.approx(work, abs=alike * sum(map(abs, work.values())))


def test_no_field_lies_over_another():
    """Of any type and number of elements: each holds what was written to it."""
    runtime.start("vulkan")
    builder = runtime.fields_builder()
    kinds = [lambda kind=kind: ti.field(kind) for kind in (ti.i32, ti.f64, ti.f32, ti.i64)]
    kinds += [lambda kind=kind: ti.Vector.field(3, kind) for kind in (ti.f32, ti.f64)]
    shapes = [(3,), (1, 5), (3, 5, 7)]
    fields = [place(builder, kind(), *shape) for shape in shapes for kind in kinds]
    tree = builder.finalize()
    for number, field in enumerate(fields):
        field.fill(number + 1)
    assert [set(np.unique(field.to_numpy())) for field in fields] == [{n + 1} for n in range(len(fields))]
    assert [field.shape for field in fields] == [shape for shape in shapes for _ in kinds]
    tree.destroy()


@ti.kernel
def _evaluate(x: ti.types.ndarray(), values: ti.types.ndarray()):
    for i in range(x.shape[0]):
        values[0, i] = functions.sin(x[i])
        values[1, i] = functions.cos(x[i])
        values[2, i] = functions.exp(x[i])
        values[3, i] = functions.log(ti.abs(x[i]))


@pytest.mark.parametrize("scale", [1e-200, 1e-5, 0.3, 7.0, 600.0])
def test_functions_in_double_precision(scale):
    """To a few units in the last place; Vulkan itself has none."""
    runtime.start("vulkan", "f64")
    x = scale * np.random.default_rng(1).uniform(-1.0, 1.0, 200)
    values = np.empty((4, len(x)))
    _evaluate(x, values)
    np.testing.assert_allclose(values, [np.sin(x), np.cos(x), np.exp(x), np.log(np.abs(x))], rtol=1e-15, atol=3e-16)


def test_a_device_without_doubles_is_refused(monkeypatch):
    """Rather than with whatever Taichi says when it comes to the first of them."""
    monkeypatch.setattr(runtime, "_has_doubles", lambda: False)
    runtime.stop()
    with pytest.raises(RuntimeUnavailableError, match="arch 'vulkan': the device has no numbers of 64 bits"):
        runtime.start("vulkan")
    runtime.start("cpu")


def test_without_a_driver_one_line_says_so(tmp_path):
    """Whatever the loader of drivers says besides."""
    nowhere = {"VK_DRIVER_FILES": "/none", "VK_ICD_FILENAMES": "/none"}
    done = subprocess.run(
        [sys.executable, "-m", "sandbox", "run", "rope", "--arch", "vulkan", "--out", str(tmp_path / "out")],
        env=os.environ | nowhere, capture_output=True, text=True, check=False,
    )  # fmt: skip
    line = "sandbox: arch 'vulkan': not available on this machine (no device or no driver); use --arch cpu\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", line)
    assert not (tmp_path / "out").exists()
