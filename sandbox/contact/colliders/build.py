"""Builds the colliders of a scene, each with its surface and, where it moves, its motion."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import taichi as ti

from sandbox.contact.colliders.mesh import MeshSolidCollider
from sandbox.contact.colliders.moved import MovingCollider
from sandbox.contact.colliders.plain import BallCollider, BlockCollider, HalfSpaceCollider, RodCollider
from sandbox.contact.colliders.polygon import OutlineCollider
from sandbox.contact.colliders.solid import ParticleRadius, SolidCollider, UniformRadius
from sandbox.contact.moving import Motions
from sandbox.contact.surface import BodySurfaces, UniformSurface
from sandbox.errors import SceneError
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import (
    BoxCollider,
    CapsuleCollider,
    Collider,
    HalfSpace,
    MeshCollider,
    PolygonCollider,
    SphereCollider,
)
from sandbox.scene.motion import Motion, motion_of
from sandbox.state import ParticleState

_PLAIN: dict[type, Any] = {
    HalfSpace: HalfSpaceCollider,
    SphereCollider: BallCollider,
    BoxCollider: BlockCollider,
    CapsuleCollider: RodCollider,
}
_MOST_WRITTEN_OUT = 2
"""Most still solids of a kind that kernels hold one by one, as constants, instead of in a loop."""


@dataclass(frozen=True)
class Colliders:
    """The colliders of a scene and what belongs to them."""

    solids: list[SolidCollider] = field(default_factory=list)
    """Those of a kind and surface together: not in the scene's order."""
    parts: list[Any] = field(default_factory=list)
    """What wants ``load(assembly)`` once the fields are there; the motions among them."""
    motions: Motions | None = None
    """What moves them: a part that prepares every substep; None where all stand still."""


def build_colliders(builder: ti.FieldsBuilder, assembly: Assembly, state: ParticleState) -> Colliders:
    """The colliders of a scene. Raises SceneError where a mesh is no solid."""
    if not assembly.colliders and not assembly.frames:
        return Colliders()
    try:
        return _build(builder, assembly, state)
    except SceneError:
        builder.finalize()  # Taichi does nothing more while a tree is unfinished
        raise


def _build(builder: ti.FieldsBuilder, assembly: Assembly, state: ParticleState) -> Colliders:
    radii = np.unique(assembly.radii)
    radius = UniformRadius(float(radii[0])) if len(radii) == 1 else ParticleRadius(builder, state.count)
    moves = {index: motion_of(collider, assembly.dimension) for index, collider in enumerate(assembly.colliders)}
    moving = {index: motion for index, motion in moves.items() if motion is not None}
    groups = _groups(assembly, moving)
    # Rows in the order of the groups: each finds its own one after the other.
    rows = {index: moving[index] for group in groups for index in group if index in moving}
    rows |= {len(assembly.colliders) + number: motion for number, motion in enumerate(assembly.frames)}
    motions = Motions(builder, rows) if rows else None
    built = Colliders(parts=[radius], motions=motions)
    for group in groups:
        pairs = assembly.contacts[group[0]]
        surface = UniformSurface(pairs[0]) if len(set(pairs)) == 1 else BodySurfaces(builder, assembly, pairs)
        reach = max(float(np.abs(moving[index].positions).max()) if index in moving else 0.0 for index in group)
        members: list[Any] = [assembly.colliders[index] for index in group]
        if group[0] in moving:
            members = [_about_origin(collider, assembly.dimension) for collider in members]
        solid: SolidCollider
        first = members[0]
        if isinstance(first, PolygonCollider):
            solid = OutlineCollider(members, surface, radius, state, builder, reach)
        elif isinstance(first, MeshCollider):
            where = f"colliders[{group[0]}]"
            solid = MeshSolidCollider(first, surface, radius, state, builder, reach, where, float(radii[-1]))
        else:
            solid = _PLAIN[type(first)](members, surface, radius, state, builder)
        built.parts.extend([surface, solid])
        if motions is not None and group[0] in moving:
            solid = MovingCollider(solid, motions, motions.rows[group[0]])
        built.solids.append(solid)
    if motions is not None:
        built.parts.append(motions)
    return built


def collider_order(assembly: Assembly) -> list[int]:
    """Indices in the scene of all solids, in the order of :attr:`Colliders.solids` and of those within each."""
    moves = {index: motion_of(collider, assembly.dimension) for index, collider in enumerate(assembly.colliders)}
    moving = {index: motion for index, motion in moves.items() if motion is not None}
    return [index for group in _groups(assembly, moving) for index in group]


def _groups(assembly: Assembly, moving: dict[int, Motion]) -> list[list[int]]:
    """Indices of colliders that one loop can handle: of one kind and surface, all moving or all still."""
    groups: dict[Any, list[int]] = {}
    for index, (collider, pairs) in enumerate(zip(assembly.colliders, assembly.contacts, strict=True)):
        alone = index if isinstance(collider, MeshCollider) else -1
        groups.setdefault((type(collider), index in moving, pairs, alone), []).append(index)
    result: list[list[int]] = []
    for group in groups.values():
        apart = len(group) <= _MOST_WRITTEN_OUT and group[0] not in moving
        result.extend([[index] for index in group] if apart else [group])
    return result


def _about_origin(collider: Collider, dimension: int) -> Collider:
    """The collider in its own frame: its motion says where it is."""
    nowhere = (0.0,) * dimension
    if isinstance(collider, HalfSpace):
        return collider.model_copy(update={"point": nowhere})
    changes = {"position": nowhere, "rotation": 0.0}
    return collider.model_copy(update={name: value for name, value in changes.items() if hasattr(collider, name)})
