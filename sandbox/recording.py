"""Files of actions: written by hand to be done to any scene, or recorded, to be done again to the same bits."""

import hashlib
import json
import warnings
from collections.abc import Iterator
from pathlib import Path

from pydantic import Field, ValidationError

from sandbox.errors import SceneError
from sandbox.files import replace_when_whole
from sandbox.scene.action_plan import room_left
from sandbox.scene.load import check_dimensions, describe, read_toml, to_toml
from sandbox.scene.model import Action, Interaction, Precision, Scene
from sandbox.scene.model.base import Index, Model, Positive
from sandbox.warning_log import Remark, WarningKind


class Header(Model):
    """What a recording says of itself."""

    title: str = Field("", description="of the scene")
    tick: Positive = Field(description="time went on by this much at once [s]")
    ticks: Index = Field(description="how often")
    duration: Positive | None = Field(None, description="of the scene [s]")
    precision: Precision = Field(description="that it was simulated in")
    scene_sha256: str = Field("", description="fingerprint of the scene before anything was done to it")
    state_sha256: str = Field("", description="hash of the state at the end")
    version: str = Field("", description="of the sandbox")


class ActionFile(Model):
    """What is done to a scene."""

    recording: Header | None = Field(None, description="present in recordings")
    interaction: Interaction | None = Field(None, description="room that the scene had for what is done live")
    actions: tuple[Action, ...] = Field((), description="what is done, in order")


def read(path: Path) -> ActionFile:
    """A file of actions. Raises SceneError, with one line that says where the mistake is."""
    data = read_toml(path)
    try:
        return ActionFile.model_validate(data)
    except ValidationError as error:
        raise SceneError(describe(error, data, str(path), {})) from None


def write(path: Path, file: ActionFile) -> None:
    """Write a file of actions; it appears once it is whole."""
    with replace_when_whole(path) as temporary:
        temporary.write_text(to_toml(file), encoding="utf-8")


def fingerprint(scene: Scene) -> str:
    """SHA-256 of what decides how a scene moves when nothing is done to it live."""
    plain = {"title": "", "description": "", "duration": 1.0, "interaction": None}
    data = scene.model_copy(update=plain).model_dump(mode="json", exclude_none=True)
    data["render"] = scene.render.fps
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def begin_of(action: Action) -> float:
    """When an action begins [s]."""
    times = (getattr(action, name, None) for name in ("start", "time"))
    return next((time for time in times if time is not None), 0.0)


def late_actions(scene: Scene) -> Iterator[Remark]:
    """One remark for every action that begins only when the run is over."""
    for number, action in enumerate(scene.actions):
        if (begins := begin_of(action)) >= scene.duration:
            line = f"actions[{number}]: begins at {begins:g} s, when the run is over ({scene.duration:g} s)"
            yield Remark(WarningKind.ACTION, line, f"actions[{number}] is late")


def with_actions(scene: Scene, file: ActionFile, source: str) -> Scene:
    """The scene with what the file does to it. Raises SceneError where they do not fit together."""
    if file.recording is not None and file.recording.scene_sha256 not in ("", fingerprint(scene)):
        warnings.warn(
            f"{source}: was recorded in another scene, or with other settings; it will not come to the same",
            stacklevel=2,
        )
    changes: dict[str, object] = {"actions": scene.actions + file.actions}
    if file.interaction is not None:
        changes["interaction"] = file.interaction
    if file.recording is not None:
        if file.interaction is not None:
            live = scene.model_copy(update={"interaction": file.interaction})
            changes["interaction"] = room_left(live, scene.actions + file.actions)
        if file.recording.ticks > 0:
            changes["duration"] = file.recording.tick * file.recording.ticks
    together = scene.model_copy(update=changes)
    check_dimensions(together, source)
    return together
