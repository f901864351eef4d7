"""What could be left out of a scene, or be modelled more coarsely: one scene for each such choice.

A part is left out of all bodies at once, and only where the scene has it. What cannot be left out is told with the
reason. NumPy only, through the assembly.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from sandbox.errors import SceneError
from sandbox.scene.assemble import Assembly, assemble
from sandbox.scene.model import (
    Ball,
    Body,
    Box,
    Bracing,
    Custom,
    Fill,
    Mesh,
    Polygon,
    Precision,
    Ring,
    Rope,
    Scene,
    Shape,
    Sheet,
    Shell,
    Tower,
)
from sandbox.trade.trial import with_solver

FEWEST_BALL_CELLS, FEWEST_RING_SEGMENTS = 2, 3
"""The least that the model takes."""


class Change(StrEnum):
    """What is done to the model."""

    REMOVES = "removes"
    COARSENS = "coarsens"
    TUNES = "tunes"
    """The model is the same; how it is computed is not."""


@dataclass(frozen=True)
class Variant:
    """A scene with a part left out or coarsened."""

    name: str
    what: str
    """One line for a table."""
    change: Change
    scene: Scene


@dataclass(frozen=True)
class Found:
    """What could be left out of a scene, and what could not."""

    variants: tuple[Variant, ...]
    left_out: tuple[str, ...]
    """One line for each part that the scene has and that cannot be left out or coarsened, with the reason."""


def variants(scene: Scene) -> list[Variant]:
    """What could be left out of a scene. Raises SceneError where the scene cannot be built."""
    return list(find_variants(assemble(scene)).variants)


def find_variants(assembly: Assembly) -> Found:
    """The same with what could not be left out, for a scene that is assembled."""
    scene, refusals = assembly.scene, list[str]()
    tried: list[Variant] = []
    for look in (_of_springs, _of_materials, _of_contact, _of_surroundings, _of_computing):
        tried += [Variant(*parts) for parts in look(assembly)]
    for name, what, kind, change in _of_shapes():
        changed, refused = _body_by_body(scene, change)
        if changed is not None:
            spared = f" (not of {_few(list(refused))})" if refused else ""
            tried.append(Variant(name, what(changed) + spared, kind, changed))
        else:
            refusals += [f"{name}: {reason} ({_few(names)})" for reason, names in _by_reason(refused).items()]
    found = []
    for variant in tried:
        try:
            assemble(variant.scene)
        except SceneError as error:
            refusals.append(f"{variant.name}: {error}")
        else:
            found.append(variant)
    return Found(tuple(found), tuple(refusals))


# -- parts of all bodies ------------------------------------------------------------------------------

_Parts = Iterator[tuple[str, str, Change, Scene]]


def _of_springs(assembly: Assembly) -> _Parts:
    scene, springs = assembly.scene, assembly.spring_set
    if springs.damping.any():
        free = _with_materials(scene, damping=None, damping_ratio=None)
        free = _with_attachments(free, damping=0.0)
        yield "no spring damping", "springs that only pull and push", Change.REMOVES, free


def _of_materials(assembly: Assembly) -> _Parts:
    scene, springs = assembly.scene, assembly.spring_set
    if np.isfinite(springs.yield_strain).any():
        stays = _with_materials(scene, yield_strain=None, creep=None, max_plastic_strain=None)
        yield "no plasticity", "rest lengths that never flow", Change.REMOVES, stays
    if springs.tears:
        holds = _with_attachments(_with_materials(scene, break_strain=None), break_strain=None)
        yield "no tearing", "springs that never break", Change.REMOVES, holds


def _of_contact(assembly: Assembly) -> _Parts:
    scene = assembly.scene
    if assembly.meets_particles:
        if any(body.self_contact for body in scene.bodies):
            passing = _with_bodies(scene, lambda body: _but(body, self_contact=False))
            yield "no self-contact", "bodies pass through themselves", Change.REMOVES, passing
        if sum(body.has_radius for body in scene.bodies) > 1:
            off = _but(scene, contact=_but(scene.contact, enabled=False))
            yield "no particle contact", "bodies meet colliders only", Change.REMOVES, off
        for factor, word in ((2.0, "twice"), (0.5, "half")):
            skin = factor * scene.contact.skin
            tuned = _but(scene, contact=_but(scene.contact, skin=skin))
            yield f"contact skin x{factor:g}", f"neighbour lists reach {word} as far", Change.TUNES, tuned
    if any(pair.friction > 0.0 for row in assembly.contacts for pair in row):
        smooth = _but(scene, colliders=tuple(_but(collider, friction=0.0) for collider in scene.colliders))
        yield "no collider friction", "colliders that bodies slide on", Change.REMOVES, smooth


def _of_surroundings(assembly: Assembly) -> _Parts:
    scene, wind = assembly.scene, assembly.scene.wind
    if scene.drag > 0.0:
        yield "no drag", "no drag on particles", Change.REMOVES, _but(scene, drag=0.0)
    if wind is not None and len(assembly.wind_faces.faces):
        begins = f" (wind begins at {wind.start:g} s)" if wind.start > 0.0 else ""
        yield "no wind", f"no air around the bodies{begins}", Change.REMOVES, _but(scene, wind=None)
        if wind.gust is not None:
            even = _but(scene, wind=_but(wind, gust=None))
            yield "no gusts", f"even wind{begins}", Change.REMOVES, even


def _of_computing(assembly: Assembly) -> _Parts:
    scene = assembly.scene
    if scene.diagnostics.ledger:
        unbooked = _but(scene, diagnostics=_but(scene.diagnostics, ledger=False))
        yield "no ledger", "work of the parts is not booked", Change.TUNES, unbooked
    other = Precision.F32 if scene.solver.precision is Precision.F64 else Precision.F64
    yield str(other), f"numbers of {other.value[1:]} bits", Change.TUNES, with_solver(scene, precision=other)


def _but(part: Any, **changes: Any) -> Any:
    """A part of a scene with other values, which must be ones that the model takes."""
    return part.model_copy(update=changes)


def _with_bodies(scene: Scene, change: Callable[[Body], Body]) -> Scene:
    changed: Scene = _but(scene, bodies=tuple(change(body) for body in scene.bodies))
    return changed


def _with_materials(scene: Scene, **changes: Any) -> Scene:
    return _with_bodies(scene, lambda body: _but(body, material=_but(body.material, **changes)))


def _with_attachments(scene: Scene, **changes: Any) -> Scene:
    changed: Scene = _but(scene, attachments=tuple(_but(held, **changes) for held in scene.attachments))
    return changed


# -- shapes, body by body -----------------------------------------------------------------------------


class _Refused(Exception):
    """A body cannot be changed in a way; the text is the reason."""


_ShapeChange = Callable[[Scene, Body], Body | None]
"""A body with a change; None where it has nothing to change. Raises _Refused or SceneError where it cannot be."""


def _of_shapes() -> Iterator[tuple[str, Callable[[Scene], str], Change, _ShapeChange]]:
    yield "no shear springs", lambda _: "lattices without diagonals", Change.REMOVES, _without_shear
    yield "no bend springs", lambda _: "no springs that skip a particle", Change.REMOVES, _without_bend
    yield "coarser", _coarser_words, Change.COARSENS, _coarser


def _body_by_body(scene: Scene, change: _ShapeChange) -> tuple[Scene | None, dict[str, str]]:
    """The scene with all bodies changed that can be, None if none can; the others by name, with the reason."""
    bodies, refused, changes = [], dict[str, str](), False
    for body in scene.bodies:
        kept = body
        try:
            if (other := change(scene, body)) is not None:
                _alone(scene, other)
                kept, changes = other, True
        except SceneError as error:
            refused[body.name] = str(error).removeprefix("bodies[0].")
        except _Refused as reason:
            refused[body.name] = str(reason)
        bodies.append(kept)
    return (_but(scene, bodies=tuple(bodies)) if changes else None), refused


def _alone(scene: Scene, body: Body) -> Assembly:
    """The assembly of one body of a scene. Raises SceneError where it cannot be built."""
    return assemble(_but(scene, bodies=(body,), attachments=()))


def _without_shear(scene: Scene, body: Body) -> Body | None:
    shape = body.shape
    surface = isinstance(shape, Mesh) and shape.fill is Fill.SHELL
    if surface or getattr(shape, "bracing", Bracing.NONE) is Bracing.NONE:
        return None
    changed: Body = _but(body, shape=_but(shape, bracing=Bracing.NONE))
    return changed


def _without_bend(scene: Scene, body: Body) -> Body | None:
    shape = body.shape
    unused = isinstance(shape, Mesh) and shape.fill is Fill.LATTICE
    if unused or not getattr(shape, "bend", 0.0) > 0.0:
        return None
    changed: Body = _but(body, shape=_but(shape, bend=0.0))
    return changed


def _coarser(scene: Scene, body: Body) -> Body | None:
    """The body with cells twice as large, of the same material."""
    if body.pin is not None and body.pin.indices:
        raise _Refused("pinned by index, which would mean other particles")
    if any(held.body == body.name and held.indices for held in scene.attachments):
        raise _Refused("attached by index, which would mean other particles")
    changed: Body = _but(body, shape=coarser_shape(body.shape))
    return _of_same_material(scene, body, changed)


def coarser_shape(shape: Shape) -> Shape:
    """The shape with half as many cells along every edge."""
    changes: dict[str, Any]
    match shape:
        case Box() | Sheet():
            changes = {"cells": tuple(_half(count) for count in shape.cells)}
        case Ball():
            changes = {"cells": max(FEWEST_BALL_CELLS, _half(shape.cells))}
        case Rope():
            changes = {"segments": _half(shape.segments)}
        case Ring():
            changes = {"segments": max(FEWEST_RING_SEGMENTS, _half(shape.segments))}
        case Shell():
            changes = {"subdivisions": max(0, shape.subdivisions - 1)}
        case Polygon():
            changes = {"spacing": 2.0 * shape.spacing}
        case Mesh(fill=Fill.LATTICE):
            changes = {"cells": _half(shape.cells)}
        case Mesh():
            raise _Refused("the file's triangles are its springs")
        case Tower():
            raise _Refused("a tower's members are what it is")
        case Custom():
            raise _Refused("a custom shape has no resolution")
    coarse: Shape = _but(shape, **changes)
    if coarse == shape:
        raise _Refused("as coarse as can be")
    return coarse


def _half(count: int) -> int:
    return max(1, (count + 1) // 2)


def _of_same_material(scene: Scene, fine: Body, coarse: Body) -> Body:
    """The coarse body with springs that store and dissipate in an even stretch what those of the fine one do.

    Stretched by e, springs store 1/2 e^2 sum k L^2, and c in place of k tells what they dissipate. Young's modulus
    stands for that by itself; a stiffness, a damping and a damping ratio are those of single springs.
    """
    material = coarse.material
    wanted = _spring_sums(_alone(scene, fine))
    if material.stiffness is not None:
        ratio = _ratio(wanted[0], _spring_sums(_alone(scene, coarse))[0])
        coarse = _but(coarse, material=_but(coarse.material, stiffness=material.stiffness * ratio))
    ratio = _ratio(wanted[1], _spring_sums(_alone(scene, coarse))[1])
    damping = {
        name: value * ratio
        for name in ("damping", "damping_ratio")
        if (value := getattr(material, name)) is not None and ratio > 0.0
    }
    return coarse if not damping else _but(coarse, material=_but(coarse.material, **damping))


def _spring_sums(assembly: Assembly) -> tuple[float, float]:
    """Sums of k L^2 [J] and c L^2 [J s] over all springs."""
    springs = assembly.spring_set
    squares = springs.rest_lengths**2
    return float(springs.stiffness @ squares), float(springs.damping @ squares)


def _ratio(wanted: float, there: float) -> float:
    return wanted / there if there > 0.0 else 1.0


def _coarser_words(scene: Scene) -> str:
    return f"cells twice as large: {assemble(scene).particle_count} particles"


def _by_reason(refused: dict[str, str]) -> dict[str, list[str]]:
    grouped: dict[str, list[str]] = {}
    for name, reason in refused.items():
        grouped.setdefault(reason, []).append(name)
    return grouped


def _few(names: Sequence[str]) -> str:
    """Names for a line: the first few, and how many more."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more
