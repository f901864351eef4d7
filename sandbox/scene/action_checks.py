"""What of a scene's actions does not fit its bodies, its colliders or its dimension."""

from collections.abc import Iterable

from sandbox.scene.model import Action, Choice, Cut, Grab, Model, Move, Pump, Scene, Shake, Spawn
from sandbox.scene.model.base import LARGEST

Problem = tuple[str, str]
"""Where in the scene, and what is wrong there."""


def action_problems(scene: Scene) -> Iterable[Problem]:
    """Everything that is wrong, action by action."""
    entered: set[str] = set()
    for index, action in enumerate(scene.actions):
        where = f"actions[{index}]"
        for place, text in _problems(scene, action):
            yield f"{where}.{place}", text
        if isinstance(action, Spawn):
            if action.body in entered:
                yield f"{where}.body", f"{action.body!r} enters twice"
            entered.add(action.body)


def _problems(scene: Scene, action: Action) -> Iterable[Problem]:
    for place, number in _numbers(action):
        if abs(number) > LARGEST:
            yield place, f"must not be beyond {LARGEST:g}, got {number:g}"
    bodies = {body.name: body for body in scene.bodies}
    name = getattr(action, "body", None)
    if isinstance(action, Pump):
        if name not in bodies or bodies[action.body].pressure is None:
            yield "body", f"there is no body {name!r} with pressure"
    elif name is not None and name not in bodies:
        yield "body", f"there is no body {name!r}"
    if isinstance(action, Move):
        yield from _move_problems(scene, action)
    if isinstance(action, Spawn) and any(action.body in (held.body, held.to) for held in scene.attachments):
        yield "body", f"{action.body!r} is attached, and must be there from the start"
    if isinstance(action, Cut) and action.edge_start is not None and (action.sweep is None) != (scene.dimension == 2):
        yield "sweep", "is required: the blade's edge goes that way" if scene.dimension == 3 else "is for 3D scenes"
    if isinstance(action, Grab) and action.direction is not None and scene.dimension == 2:
        yield "direction", "is for 3D scenes; in 2D a point says it all"
    if isinstance(action, Choice) and action.region is not None and scene.dimension == len(action.region.min):
        if any(low > high for low, high in zip(action.region.min, action.region.max, strict=False)):
            yield "region", "min must not be above max"
    if isinstance(action, Shake) and not any(action.amplitude):
        yield "amplitude", "must not be the zero vector"


def _numbers(part: Model) -> Iterable[tuple[str, float]]:
    """Every number of an action, and where it is."""
    for name, field in type(part).model_fields.items():
        value, place = getattr(part, name), field.alias or name
        for entry in value if isinstance(value, tuple) else (value,):
            if isinstance(entry, Model):
                yield from ((f"{place}.{inner}", number) for inner, number in _numbers(entry))
            elif isinstance(entry, float):
                yield place, entry


def _move_problems(scene: Scene, action: Move) -> Iterable[Problem]:
    if action.collider is None:
        return
    named = [collider for collider in scene.colliders if collider.name == action.collider]
    if not named:
        yield "collider", f"there is no collider {action.collider!r}"
    elif named[0].motion:
        yield "collider", f"{action.collider!r} has a motion of its own already"
    elif any(other is not action and getattr(other, "collider", None) == action.collider for other in scene.actions):
        yield "collider", f"{action.collider!r} is moved by another action too"
