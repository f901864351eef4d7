"""Files of actions and recordings, done to a scene that has something of everything."""

from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from sandbox.recording import late_actions, read, with_actions
from sandbox.scene.assemble import assemble
from sandbox.scene.load import scene_from_data
from tests.fuzz import odd, seeds
from tests.fuzz.inputs import Input, Kind

_RECORDING = {
    "title": "x", "tick": 0.01, "ticks": 20, "duration": 1.0, "precision": "f64", "scene_sha256": "0" * 64,
    "state_sha256": "0" * 64, "version": "0.1.0",
}  # fmt: skip
FILES = (
    {"actions": seeds.FLAT["actions"]},
    {"recording": _RECORDING, "interaction": seeds.FLAT["interaction"], "actions": seeds.FLAT["actions"][:3]},
    {"recording": {**_RECORDING, "scene_sha256": ""}, "actions": []},
)


def _drawn() -> Any:
    mutated = odd.changed(FILES, most=2).map(odd.toml)
    written = [odd.toml(data) for data in FILES]
    return st.one_of(mutated, mutated, odd.broken(written)).map(lambda data: Input(".toml", data))


def _take(path: Path) -> None:
    scene = scene_from_data({**seeds.FLAT, "actions": []}, None, source="scene")
    acted = with_actions(scene, read(path), str(path))
    list(late_actions(acted))
    assemble(acted)


ACTIONS = Kind("actions", _drawn, _take, short=60)
