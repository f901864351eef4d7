"""What the actions of a scene need to be there from its start. NumPy only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.attachments import Carried
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.model import (
    Action,
    Breeze,
    Cut,
    Grab,
    Hold,
    Interaction,
    Interpolation,
    Keyframe,
    Move,
    PinDown,
    Push,
    Scene,
    Shake,
    Soften,
    Spawn,
    Stiffen,
    Unpin,
    Wind,
)
from sandbox.scene.motion import Motion, motion_along


@dataclass(frozen=True)
class ActionPlan:
    """Room for the actions of a scene: what it names, and what may be done to it live. None of it costs nothing."""

    grips: int = 0
    """Most grabs at a time."""
    shakes: int = 0
    """Most shakes of the ground at a time."""
    pushes: int = 0
    """Most pushes at a time."""
    cuts: bool = False
    """Whether springs are cut."""
    holds: bool = False
    """Whether particles are pinned, let go, or enter."""
    reforms: bool = False
    """Whether springs become stiffer or softer."""
    entering: tuple[int, ...] = ()
    """Bodies that enter later, by index."""

    @property
    def loads(self) -> bool:
        """Whether forces act that are none of the bodies' own, beside grips."""
        return self.pushes + self.shakes > 0

    @classmethod
    def of(cls, scene: Scene) -> "ActionPlan":
        """What a scene needs."""
        actions, live = scene.actions, scene.interaction
        names = {body.name: index for index, body in enumerate(scene.bodies)}

        def has(*kinds: type) -> bool:
            return any(isinstance(action, kinds) for action in actions)

        return cls(
            grips=most_at_once([a for a in actions if isinstance(a, Grab)]) + _room(live, "grips"),
            shakes=most_at_once([a for a in actions if isinstance(a, Shake)]) + _room(live, "shakes"),
            pushes=most_at_once([a for a in actions if isinstance(a, Push)]) + _room(live, "pushes"),
            cuts=has(Cut) or live is not None,
            holds=has(PinDown, Unpin, Spawn) or live is not None,
            reforms=has(Stiffen, Soften) or live is not None,
            entering=tuple(sorted({names[a.body] for a in actions if isinstance(a, Spawn) and a.body in names})),
        )


def _room(live: Interaction | None, name: str) -> int:
    return 0 if live is None else int(getattr(live, name))


def most_at_once(spans: Sequence[Grab | Push | Shake]) -> int:
    """Most of these that last at the same time; one that ends gives its place to one that begins then."""
    moments = sorted([(span.start, 1) for span in spans] + [(span.end, -1) for span in spans])
    now = most = 0
    for _, change in moments:
        now += change
        most = max(most, now)
    return most


def room_left(live: Scene, actions: Sequence[Action]) -> Interaction:
    """What is left of a live scene's room where these actions of its recording are in the scene from the start.

    Together they have room for just as much as was there live, so that the same code is compiled for both.
    """
    room, taken = ActionPlan.of(live), ActionPlan.of(live.model_copy(update={"actions": actions, "interaction": None}))
    names = ("grips", "pushes", "shakes")
    return Interaction(**{name: max(0, getattr(room, name) - getattr(taken, name)) for name in names})


_PARKED = 60.0
"""How far away bodies wait that enter later, in the size of the scene [1]."""


def parking(scene: Scene, positions: FloatArray, particle_body: IntArray, entering: Sequence[int]) -> FloatArray:
    """Way from where particles will enter to where they wait [m], shape (N, d): behind the eye, far from all else."""
    ways = np.zeros_like(positions)
    extent = float(np.ptp(positions, axis=0).max()) or 1.0
    eye = scene.render.camera.eye
    back = np.array([-1.0, 0.0] if scene.dimension == 2 else eye or (0.3, 0.5, 1.0), dtype=float)
    for place, body in enumerate(entering):
        ways[particle_body == body] = (_PARKED + 4.0 * place) * extent * back / max(float(np.linalg.norm(back)), 1e-9)
    return ways


def check_indices(scene: Scene, particle_counts: Sequence[int]) -> None:
    """Raise SceneError where an action means a particle that its body does not have."""
    counts = dict(zip((body.name for body in scene.bodies), particle_counts, strict=True))
    for number, action in enumerate(scene.actions):
        if not isinstance(action, Hold) or action.body is None:
            continue
        for index in action.indices:
            if index >= counts[action.body]:
                has = f"{action.body!r} has {counts[action.body]}"
                raise SceneError(f"actions[{number}].indices: there is no particle {index}; {has}")


def led_frames(
    scene: Scene, positions: FloatArray, pinned: NDArray[np.bool_], particle_body: IntArray
) -> tuple[tuple[Motion, ...], Carried]:
    """Frames that actions lead, numbered after the colliders, and the pinned particles that they carry.

    Scene order. Raises SceneError where a body has no pinned particles, or is led twice.
    """
    motions: list[Motion] = []
    rows: list[tuple[NDArray[np.int64], int, FloatArray]] = []
    led: set[str] = set()
    for number, action in enumerate(scene.actions):
        if not isinstance(action, Move) or action.body is None:
            continue
        where = f"actions[{number}].body"
        body = next((i for i, one in enumerate(scene.bodies) if one.name == action.body), -1)
        mine = np.nonzero(pinned & (particle_body == body))[0]
        if len(mine) == 0:
            raise SceneError(f"{where}: {action.body!r} has no particles that are pinned from the start")
        if action.body in led:
            raise SceneError(f"{where}: {action.body!r} is led by an earlier action")
        led.add(action.body)
        middle = positions[mine].mean(axis=0)
        motion = motion_along(_whole_path(action), middle, 0.0, action.interpolation is Interpolation.SMOOTH)
        rows.append((mine, len(scene.colliders) + len(motions), positions[mine] - middle))
        motions.append(motion)
    particles = np.concatenate([np.zeros(0, np.int64)] + [mine for mine, _, _ in rows])
    frames = np.concatenate([np.zeros(0, np.int64)] + [np.full(len(mine), frame) for mine, frame, _ in rows])
    local = np.concatenate([np.zeros((0, scene.dimension))] + [arms for _, _, arms in rows])
    return tuple(motions), Carried(particles.astype(np.int32), frames.astype(np.int32), local)


def _whole_path(action: Move) -> tuple[Keyframe, ...]:
    """Its keyframes, and one where it is at the start if it goes to the first one from there."""
    first = action.path[0]
    at_once = first.time == 0.0 or (first.position is None and first.rotation is None)
    return action.path if at_once else (Keyframe(time=0.0), *action.path)


def with_tools(scene: Scene) -> Scene:
    """The scene as its parts see it: colliders move as the actions lead them, and there is air where it blows."""
    colliders = list(scene.colliders)
    for number, action in enumerate(scene.actions):
        if isinstance(action, Move) and action.collider is not None:
            index = next((i for i, c in enumerate(colliders) if c.name == action.collider), None)
            if index is None:
                raise SceneError(f"actions[{number}].collider: there is no collider {action.collider!r}")
            if colliders[index].motion:
                raise SceneError(f"actions[{number}].collider: {action.collider!r} has a motion already")
            changes = {"motion": _whole_path(action), "interpolation": action.interpolation}
            colliders[index] = colliders[index].model_copy(update=changes)
    wind = scene.wind
    if wind is None and any(isinstance(action, Breeze) for action in scene.actions):
        wind = Wind()
    if wind is scene.wind and tuple(colliders) == scene.colliders:
        return scene
    return scene.model_copy(update={"colliders": tuple(colliders), "wind": wind})
