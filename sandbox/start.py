"""What must or should be true of a scene before its first step, and of a state to go on from. NumPy only."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.postmortem import Failure
from sandbox.scene.assemble import Assembly
from sandbox.scene.model.base import LARGEST
from sandbox.scene.overlaps import BodyPairs, Solids, spacing_of
from sandbox.warning_log import Remark, WarningKind

_NAMED = 3
"""Most bodies, or pairs of them, that one line names."""
_GRAZING = 0.1
"""Part of a body's spacing that a particle's center may start inside a collider [1]."""
_JUMPING = 0.75
"""Part of a body's spacing that a particle may start inside a collider by its contact radius [1]; half is usual."""
_THICKEST = 2.0
"""Most of a body's spacing that its contact radius may be [1]; half of it leaves no gap."""
_COARSEST = 0.01
"""Most of the shortest spring that rounding may take from a coordinate [1]."""


def check_start(assembly: Assembly, precision: str) -> None:
    """Raise SceneError where a scene starts outside its own bounds, or too far out for the precision's digits."""
    bounds = assembly.scene.diagnostics
    speed = float(np.linalg.norm(assembly.velocities, axis=1).max())
    if speed > bounds.max_speed:
        raise SceneError(f"diagnostics.max_speed: a body starts at {speed:.4g} m/s, above {bounds.max_speed:.4g}")
    rest = assembly.spring_set.rest_lengths
    rounding = float(np.finfo("float64" if precision == "f64" else "float32").eps * np.abs(assembly.positions).max())
    if (rest > 0.0).any() and rounding > _COARSEST * rest[rest > 0.0].min():
        raise SceneError(
            f"bodies: so far from the origin {precision} rounds coordinates to {rounding:.2g} m, too coarse "
            f"for springs of {rest[rest > 0.0].min():.2g} m; move the scene nearer, or use solver.precision f64"
        )
    failure = Failure.of_state(assembly, assembly.positions, assembly.velocities)
    if failure.strain > bounds.max_strain:
        raise SceneError(
            f"diagnostics.max_strain: {failure.element(assembly)} starts at strain {failure.strain:.4g}, "
            f"above {bounds.max_strain:.4g}"
        )


def check_memory(first: Mapping[str, NDArray[np.float64]], memory: Mapping[str, NDArray[np.float64]]) -> None:
    """Raise SceneError where ``memory`` is not of the names and shapes that a scene begins with, or too large."""
    for name, values in first.items():
        if name.startswith("ledger."):
            continue  # a run may begin its books anew
        fits = name in memory and memory[name].shape == values.shape
        if not (fits and (np.abs(memory[name]) <= LARGEST).all()):
            raise SceneError(f"state: {name} must be {len(values)} numbers of at most {LARGEST:g} for this scene")


def start_remarks(assembly: Assembly) -> Iterator[Remark]:
    """What is in another thing's place at the start: bodies in each other, bodies inside colliders; odd mesh files."""
    yield from (Remark(WarningKind.MESH, line, line) for line in assembly.remarks)
    yield from (Remark(WarningKind.IDLE, line, line) for line in _idle(assembly))
    names = [body.name for body in assembly.scene.bodies]
    for touching, end in ((True, ""), (False, f"; {NO_RADIUS}")):
        pairs = BodyPairs(assembly, touching)
        overlaps = pairs.overlaps(assembly.positions) if pairs else []
        if overlaps:
            told = [f"{names[o.first]!r} and {names[o.second]!r} by {o.depth:.2g} m" for o in overlaps]
            line = f"bodies overlap at the start: {few(told, 'pairs')}{end}"
            yield Remark(WarningKind.STARTS_OVERLAPPING, line, "" if touching else "no radius")
    if told := list(_thick(assembly)):
        line = f"contact radii are far above the distance of particles: {few(told, 'bodies')}; that far off they meet"
        yield Remark(WarningKind.RADIUS, line)
    if told := list(_sunk(assembly)):
        yield Remark(WarningKind.STARTS_INSIDE, f"bodies start inside colliders: {few(told, 'bodies')}")


def _sunk(assembly: Assembly) -> Iterator[str]:
    """Bodies that start inside colliders; and those that begin with a jump, by as much of their contact radius."""
    if not assembly.colliders:
        return
    solids, spacing, names = Solids(assembly), spacing_of(assembly), [body.name for body in assembly.scene.bodies]
    start = (assembly.positions, assembly.inverse_masses, 0.0)
    found = list(solids.sunk(*start, _GRAZING * spacing + 1e-5 * float(np.abs(assembly.positions).max()), radii=0.0))
    yield from (f"{names[one.body]!r} {one.depth:.2g} m deep in {one.collider}" for one in found)
    known = {(one.body, one.collider) for one in found}
    for one in solids.sunk(*start, np.where(spacing > 0.0, _JUMPING * spacing, np.inf), radii=1.0):
        if (one.body, one.collider) not in known:
            yield f"{names[one.body]!r} {one.depth:.2g} m deep, by its contact radius, in {one.collider}"


def _thick(assembly: Assembly) -> Iterator[str]:
    """Bodies with contact radii far above the distance of their particles."""
    radius = np.zeros(len(assembly.scene.bodies))
    np.maximum.at(radius, assembly.particle_body, assembly.radii)
    for body, spacing in enumerate(spacing_of(assembly)):
        if 0.0 < _THICKEST * spacing < radius[body]:
            name = assembly.scene.bodies[body].name
            yield f"{name!r} {radius[body]:.2g} m, {radius[body] / spacing:.2g} times"


def _idle(assembly: Assembly) -> Iterator[str]:
    """What does nothing, though the scene asks for it."""
    scene = assembly.scene
    if not (scene.actions or (assembly.unheld().inverse_masses > 0.0).any()):
        yield "bodies: every particle is pinned or held, nothing can move"
    if scene.wind is not None and scene.wind.start >= scene.duration:
        yield f"wind: begins at {scene.wind.start:g} s, when the run is over"
    if scene.render.poster is not None and scene.render.poster > scene.duration:
        yield f"render.poster: at {scene.render.poster:g} s the run is over; the last picture is taken"


NO_RADIUS = 'they pass through each other, for want of a contact radius: give both radius = "auto", or a number'
"""What is the matter with bodies that cannot meet."""


def few(told: Sequence[str], what: str, between: str = ", ") -> str:
    """The first few of a list, and how many more there are."""
    more = len(told) - _NAMED
    return between.join(told[:_NAMED]) + (f", and {more} more {what}" if more > 0 else "")
