"""Scene files, taken as ``sandbox validate`` does, written and read again; and changes of scenes by ``--set``."""

import functools
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from sandbox import cli
from sandbox.cli_options import load
from sandbox.scene.assemble import Assembly, assemble
from sandbox.scene.load import load_scene, particle_estimate, preset_paths, read_toml, scene_from_data, to_toml
from sandbox.scene.model import Fill, Mesh, Scene
from sandbox.start import check_start
from tests.fuzz import odd, seeds
from tests.fuzz.inputs import Input, Kind, Wrong

MOST_PARTICLES = 100_000
"""Scenes that say they have more are as large as they say, and are only read."""


def _scenes() -> Any:
    written = [odd.toml(data) for data in seeds.scenes()]
    mutated = odd.changed(seeds.scenes()).map(odd.toml)
    gentle = odd.changed(seeds.scenes(), ways=odd.GENTLE_WAYS).map(odd.toml)
    return st.one_of(mutated, gentle, gentle, odd.broken(written)).map(lambda data: Input(".toml", data))


def size_of(scene: Scene) -> float:
    """About how many particles a scene has at most, and cells for those of mesh files."""
    meshes = [body.shape for body in scene.bodies if isinstance(body.shape, Mesh)]
    return particle_estimate(scene) + sum(mesh.cells**3 for mesh in meshes if mesh.fill is Fill.LATTICE)


def checked(scene: Scene) -> Assembly | None:
    """What becomes of a scene before its first step, other than code; None of one that is too large to be tried."""
    if size_of(scene) > MOST_PARTICLES:
        return None
    assembly = assemble(scene)
    check_start(assembly, str(scene.solver.precision))
    cli._remarks(assembly)
    return assembly


def _take_scene(path: Path) -> None:
    scene = load_scene(path)
    again = scene_from_data(tomllib.loads(to_toml(scene)), None)
    if again != scene:
        raise Wrong("is another scene when it is written and read again")
    checked(scene)


SCENES = Kind("scenes", _scenes, _take_scene, short=100)

_VALUES = st.one_of(
    st.sampled_from(["1", "2", "0.5", "1e-3", "10.0", "[0.0, 1.0]", "[0.0, 1.0, 2.0]", "auto", "heun", "true", "f64"]),
    odd.values.map(lambda value: json.dumps(value, default=str)),
    st.sampled_from(
        [*odd.TEXTS, "\ud800", "[1,", "{a=1}", "9" * 5000, "0x" + "f" * 5000, "[" * 2000, "'''", "1 # x", "1\nb=2"]
    ),
)


@functools.cache
def _known() -> dict[str, list[tuple[str, Any]]]:
    """Dotted keys of every preset, by number and by name, and what it has there."""
    return {name: list(_entries(read_toml(path))) for name, path in preset_paths().items()}


def _entries(node: Any) -> Iterator[tuple[str, Any]]:
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        named = value.get("name") if isinstance(value, dict) else None
        yield str(key), value
        if isinstance(value, dict | list):
            for below, inner in _entries(value):
                yield f"{key}.{below}", inner
                if named is not None:
                    yield f"{named}.{below}", inner


@st.composite
def _assignment(draw: Any, entries: list[tuple[str, Any]]) -> str:
    key, value = entries[draw(st.integers(0, len(entries) - 1))]
    if not isinstance(value, dict | list | str) and draw(st.booleans()):
        return f"{key}={value * draw(st.sampled_from([0, 0.5, 1, 2, 1e6, 1e-6]))}"
    match draw(st.integers(0, 9)):
        case 0:
            at = draw(st.integers(0, len(key)))
            key = (
                key[:at]
                + draw(st.sampled_from([*odd.TEXTS, ".", "[", "]", "\ud800", "[0]", "[-1]", "[1e3]"]))
                + key[at:]
            )
        case 1:
            key = ".".join([key] * draw(st.sampled_from([2, 70, 1000])))
        case 2:
            key = key.replace(".", draw(st.sampled_from(["..", "[", "].", " . ", ""])))
    return f"{key}{draw(st.sampled_from(['=', '=', '=', '=', ' = ', '==', '']))}{draw(_VALUES)}"


@st.composite
def _command(draw: Any) -> Input:
    known = _known()
    name = draw(st.sampled_from(sorted(known)))
    words = draw(st.lists(_assignment(known[name]), min_size=1, max_size=2))
    if draw(st.integers(0, 19)) == 0:
        name = draw(
            st.sampled_from(["", "nowhere", "jely", "x.toml", "/dev/null", "\ud800", "a\x00.toml", "/", ".toml"])
        )
    return Input(".json", json.dumps([name, *words]).encode())


def _take_overrides(path: Path) -> None:
    """A list of texts: a scene as it is named on the command line, and what ``--set`` is given."""
    name, *assignments = json.loads(path.read_bytes())
    scene = load(name, assignments)
    if size_of(scene) <= seeds.MOST_PARTICLES:
        checked(scene)


OVERRIDES = Kind("overrides", _command, _take_overrides, short=100)
