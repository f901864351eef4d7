"""What holds bodies to each other or to colliders, as springs and carried particles. NumPy only."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.model import Attachment, Material, Scene
from sandbox.scene.motion import motion_of
from sandbox.scene.selection import selected
from sandbox.scene.spring_set import SpringSet

_CHUNK = 4_000_000
"""Distances that are looked at together."""


@dataclass(frozen=True)
class Carried:
    """C particles that moving colliders carry along."""

    particles: IntArray
    """Shape (C,)."""
    collider: IntArray
    """Index of the collider that carries each, shape (C,)."""
    local: FloatArray
    """Where it is in the collider's frame [m], shape (C, d)."""

    def renumbered(self, internal: NDArray[np.int64]) -> "Carried":
        """The same with particles by new numbers, shape (N,)."""
        return replace(self, particles=internal[self.particles].astype(np.int32))

    def and_also(self, other: "Carried") -> "Carried":
        """These, and others."""
        names = ("particles", "collider", "local")
        return Carried(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))


@dataclass(frozen=True)
class Held:
    """What the attachments of a scene come to, in scene order of particles."""

    springs: list[SpringSet]
    pinned: IntArray
    """Particles that move no more by themselves."""
    carried: Carried
    families: IntArray
    """Family of every body, shape (body_count,)."""


def resolve(scene: Scene, positions: FloatArray, first: NDArray[np.int64], own: Sequence[SpringSet]) -> Held:
    """The springs and carried particles of all attachments.

    ``positions`` [m] are those of all particles, ``first`` the first particle of every body and the
    end, ``own`` every body's springs. Raises SceneError where an attachment names what is not there.
    """
    names = {body.name: index for index, body in enumerate(scene.bodies)}
    colliders = {collider.name: index for index, collider in enumerate(scene.colliders) if collider.name}
    family = list(range(len(scene.bodies)))
    springs: list[SpringSet] = []
    rows: list[tuple[NDArray[np.int64], int]] = []
    for number, attachment in enumerate(scene.attachments):
        where = f"attachments[{number}]"
        if attachment.body not in names:
            raise SceneError(f"{where}.body: there is no body {attachment.body!r}")
        body = names[attachment.body]
        start, end = int(first[body]), int(first[body + 1])
        chosen = np.nonzero(selected(where, attachment, positions[start:end]))[0] + start
        if attachment.to in names:
            other = names[attachment.to]
            if other == body:
                raise SceneError(f"{where}.to: is the attached body itself")
            ends = np.stack([chosen, _nearest(positions, chosen, int(first[other]), int(first[other + 1]))], axis=1)
            springs.append(
                _springs(where, attachment, ends, positions, (own[body], own[other]), len(first) - 1 + number)
            )
            low, high = sorted((family[body], family[other]))
            family = [low if member == high else member for member in family]
        elif attachment.to in colliders:
            rows.append((chosen, colliders[attachment.to]))
        else:
            raise SceneError(f"{where}.to: there is no body or collider {attachment.to!r}")
    pinned = np.concatenate([np.zeros(0, np.int64)] + [chosen for chosen, _ in rows])
    return Held(springs, pinned.astype(np.int32), _carried(scene, positions, rows), np.array(family, dtype=np.int32))


def _nearest(positions: FloatArray, chosen: NDArray[np.int64], start: int, end: int) -> NDArray[np.int64]:
    """The particle of ``start`` to ``end`` that is nearest to each chosen one, the first of equals."""
    result = np.empty(len(chosen), dtype=np.int64)
    rows = max(1, _CHUNK // (end - start))
    for at in range(0, len(chosen), rows):
        part = slice(at, at + rows)
        apart = positions[chosen[part], None] - positions[None, start:end]
        result[part] = np.einsum("ijk,ijk->ij", apart, apart).argmin(axis=1) + start
    return result


def _springs(
    where: str,
    attachment: Attachment,
    ends: NDArray[np.int64],
    positions: FloatArray,
    around: tuple[SpringSet, SpringSet],
    number: int,
) -> SpringSet:
    stiffness = attachment.stiffness
    if stiffness is None:
        known = [float(one.stiffness.mean()) for one in around if len(one)]
        if not known:
            raise SceneError(f"{where}.stiffness: is required, since neither body has springs")
        stiffness = sum(known) / len(known)
    material = Material(break_strain=attachment.break_strain)
    count = len(ends)
    lengths = np.linalg.norm(positions[ends[:, 1]] - positions[ends[:, 0]], axis=1)
    # Particles at one place but for rounding are at one place.
    lengths[lengths <= 1e-12 * np.abs(positions).max()] = 0.0
    joined = SpringSet.of_body(
        material, ends.astype(np.int32), lengths, np.full(count, stiffness), np.full(count, attachment.damping)
    )
    return replace(joined, body=np.full(count, number, dtype=np.int32))


def _carried(scene: Scene, positions: FloatArray, rows: list[tuple[NDArray[np.int64], int]]) -> Carried:
    """Particles of colliders that move; those of colliders that stand still are simply pinned."""
    dimension = scene.dimension
    particles, colliders, local = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, dimension))]
    for chosen, collider in rows:
        motion = motion_of(scene.colliders[collider], dimension)
        if motion is not None:
            origin, turn = motion.pose(0.0)
            particles.append(chosen)
            colliders.append(np.full(len(chosen), collider))
            local.append((positions[chosen] - origin) @ turn)
    return Carried(
        np.concatenate(particles).astype(np.int32), np.concatenate(colliders).astype(np.int32), np.concatenate(local)
    )
