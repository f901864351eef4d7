"""Scene -> Assembly: immutable NumPy arrays, the one place where units become numbers.

Particles of an assembly lie in an order that is good for memory; ``order`` leads back to the scene's.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene import attachments, surfaces
from sandbox.scene.action_checks import action_problems
from sandbox.scene.action_plan import ActionPlan, check_indices, led_frames, parking, with_tools
from sandbox.scene.appearance import Appearance
from sandbox.scene.attachments import Carried
from sandbox.scene.cells import SolidCells
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.look import build_appearance
from sandbox.scene.mesh_file import load_surface
from sandbox.scene.model import Body, Bracing, Collider, Custom, Material, MeshCollider, Scene
from sandbox.scene.model.base import LARGEST
from sandbox.scene.motion import Motion
from sandbox.scene.ordering import locality_order
from sandbox.scene.placement import rotation_matrix, spin
from sandbox.scene.selection import selected
from sandbox.scene.shapes import Geometry, generate
from sandbox.scene.shapes.geometry import joining_radius, no_elements
from sandbox.scene.spring_set import SpringSet
from sandbox.scene.surfaces import FaceSet, Gas

DEFAULT_DENSITY = 1000.0
"""Density of a body that gives neither density nor mass [kg/m^3]: water, and so most tissue and jelly."""
DEFAULT_POINT_MASS = 1.0
"""Mass of a custom shape's point when nothing else says it [kg]."""


@dataclass(frozen=True)
class ContactPair:
    """How one collider meets one body, both materials combined."""

    restitution: float
    friction: float


@dataclass(frozen=True)
class Home:
    """Where particles would start if all bodies were there from the start; internal order."""

    positions: FloatArray
    """[m], shape (N, d)."""
    velocities: FloatArray
    """[m/s], shape (N, d)."""
    pinned: NDArray[np.bool_]
    """True where particles do not move by themselves, shape (N,)."""


@dataclass(frozen=True)
class Assembly:
    """A scene as numbers. N particles, S springs, B bodies, dimension d; indices are internal ones."""

    scene: Scene
    dimension: int
    order: NDArray[np.int64]
    """Scene index of every internal particle, shape (N,)."""
    positions: FloatArray
    """Initial positions [m], shape (N, d)."""
    velocities: FloatArray
    """Initial velocities [m/s], shape (N, d)."""
    masses: FloatArray
    """Masses [kg], shape (N,)."""
    inverse_masses: FloatArray
    """Inverse masses [1/kg], 0 where pinned, shape (N,)."""
    radii: FloatArray
    """Contact radii [m], shape (N,)."""
    particle_body: IntArray
    """Body of every particle, shape (N,)."""
    spring_set: SpringSet
    """All springs, body after body, then those of attachments."""
    families: IntArray
    """Family of every body, the same for bodies that attachments hold together, shape (B,)."""
    carried: Carried
    """Particles that colliders and frames carry."""
    frames: tuple[Motion, ...]
    """Motions of what is no collider, numbered after the colliders."""
    gas_faces: FaceSet
    """Faces of all bodies with gas, body after body."""
    gases: tuple[Gas, ...]
    """The gas in them, in the order of their bodies."""
    wind_faces: FaceSet
    """Faces that the scene's wind blows on."""
    contacts: tuple[tuple[ContactPair, ...], ...]
    """One row a collider, one entry a body."""
    cells: SolidCells
    """Cells of all solids."""
    appearance: Appearance
    plan: ActionPlan
    """Room for what is done to the bodies."""
    home: "Home"
    """Where bodies are that enter later."""
    remarks: tuple[str, ...] = ()
    """What is odd about the scene's shapes, one line each."""

    @property
    def particle_count(self) -> int:
        return len(self.masses)

    @property
    def spring_count(self) -> int:
        return len(self.spring_set)

    @property
    def work(self) -> int:
        """Particles and half-edges: what a step goes over."""
        return self.particle_count + 2 * self.spring_count

    @property
    def can_tear(self) -> bool:
        """Whether springs may tear or be cut."""
        return (self.spring_set.tears or self.plan.cuts) and self.spring_count > 0

    @property
    def can_be_held(self) -> bool:
        """Whether some particle is held or carried, or may come to be."""
        return self.plan.holds or bool((self.inverse_masses == 0.0).any())

    def unheld(self) -> "Assembly":
        """The same with all particles free that may ever be: what the stability limit must reckon with."""
        if not self.plan.holds:
            return self
        never = self.home.pinned & ~np.isin(self.particle_body, self.plan.entering)
        return replace(self, inverse_masses=np.where(never, 0.0, 1.0 / self.masses))

    @property
    def springs(self) -> IntArray:
        """Pairs of particles, shape (S, 2)."""
        return self.spring_set.ends

    @property
    def meets_particles(self) -> bool:
        """True where particles of some bodies can touch each other."""
        bodies = self.scene.bodies
        touching = sum(body.has_radius for body in bodies) > 1 or any(body.self_contact for body in bodies)
        return self.scene.contact.enabled and touching

    @property
    def colliders(self) -> tuple[Collider, ...]:
        return self.scene.colliders

    def scene_order(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows of ``values`` (internal order) in the scene's order of bodies and points."""
        result = np.empty_like(values)
        result[self.order] = values
        return result

    def of_body(self, name: str) -> NDArray[np.bool_]:
        """True for the particles of the body of a name, which the scene has; shape (N,)."""
        number = next(number for number, body in enumerate(self.scene.bodies) if body.name == name)
        return np.asarray(self.particle_body == number)

    def internal_order(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows of ``values`` (scene order) in the internal order."""
        return values[self.order]


def assemble(scene: Scene) -> Assembly:
    """The numbers of a scene. Raises SceneError where its parts do not fit together."""
    for where, problem in action_problems(scene):
        raise SceneError(f"{where}: {problem}")
    plan = ActionPlan.of(scene)
    scene = with_tools(scene)
    parts = [_Part.build(index, body, scene) for index, body in enumerate(scene.bodies)]
    first = np.cumsum([0] + [len(part.masses) for part in parts])
    check_indices(scene, [len(part.masses) for part in parts])
    radii = np.array([part.radius_for(f"bodies[{index}].radius") for index, part in enumerate(parts)])
    positions = np.concatenate([part.positions for part in parts])
    particle_body = np.repeat(np.arange(len(parts), dtype=np.int32), np.diff(first))
    own = [
        part.springs.shifted(int(offset), index) for index, (part, offset) in enumerate(zip(parts, first, strict=False))
    ]
    held = attachments.resolve(scene, positions, first, own)
    springs = SpringSet.joined([*own, *held.springs])
    masses = np.concatenate([part.masses for part in parts])
    pinned = np.concatenate([part.pinned for part in parts])
    pinned[held.pinned] = True
    velocities = np.concatenate([part.velocities for part in parts])
    velocities[pinned] = 0.0
    frames, led = led_frames(scene, positions, pinned & ~np.isin(np.arange(len(masses)), held.pinned), particle_body)
    order = locality_order(positions, particle_body, springs.ends)
    internal = np.empty_like(order)
    internal[order] = np.arange(len(order))
    can_tear = springs.tears or plan.cuts
    cells = SolidCells.of(
        [part.cells_from(int(offset)) for part, offset in zip(parts, first, strict=False)],
        positions,
        springs.ends if can_tear else None,
    )
    springs = springs.renumbered(internal)
    home = Home(positions[order], velocities[order], pinned[order])
    absent = np.isin(particle_body, plan.entering)[order]
    faces = [internal[part.faces + offset].astype(np.int32) for part, offset in zip(parts, first, strict=False)]
    return Assembly(
        scene=scene,
        dimension=scene.dimension,
        order=order,
        positions=home.positions + parking(scene, home.positions, particle_body[order], plan.entering),
        velocities=np.where(absent[:, None], 0.0, home.velocities),
        masses=masses[order],
        inverse_masses=np.where(home.pinned | absent, 0.0, 1.0 / masses[order]),
        radii=radii[particle_body][order],
        particle_body=particle_body[order],
        spring_set=springs,
        families=held.families,
        carried=held.carried.and_also(led).renumbered(internal),
        frames=frames,
        gas_faces=_faces_of(parts, faces, springs, scene, lambda part: part.body.pressure is not None),
        gases=tuple(
            surfaces.gas_of(index, part.body, part.faces, part.positions, scene.actions)
            for index, part in enumerate(parts)
            if part.body.pressure is not None
        ),
        wind_faces=_faces_of(parts, faces, springs, scene, lambda part: scene.wind is not None and part.feels_wind),
        contacts=tuple(tuple(_combine(c, part.body.material) for part in parts) for c in scene.colliders),
        cells=cells.renumbered(internal),
        appearance=build_appearance(
            scene, [part.geometry for part in parts], positions, internal, springs, can_tear, radii
        ),
        plan=plan,
        home=home,
        remarks=_remarks(scene, parts),
    )


def _remarks(scene: Scene, parts: "list[_Part]") -> tuple[str, ...]:
    own = [f"bodies[{index}].shape: {line}" for index, part in enumerate(parts) for line in part.geometry.remarks]
    for index, collider in enumerate(scene.colliders):
        if isinstance(collider, MeshCollider):
            try:
                own += [f"colliders[{index}]: {line}" for line in load_surface(collider).remarks]
            except SceneError as error:
                raise SceneError(f"colliders[{index}].file: {error}") from None
    return tuple(own)


def _faces_of(
    parts: "list[_Part]", faces: list[IntArray], springs: SpringSet, scene: Scene, chosen: Callable[["_Part"], bool]
) -> FaceSet:
    return surfaces.collect(
        [(index, own) for index, (part, own) in enumerate(zip(parts, faces, strict=True)) if chosen(part)],
        springs.ends,
        scene.dimension,
    )


@dataclass(frozen=True)
class _Part:
    """One body as numbers, in the order of its own points."""

    body: Body
    geometry: Geometry
    positions: FloatArray
    velocities: FloatArray
    masses: FloatArray
    pinned: NDArray[np.bool_]
    springs: SpringSet

    @property
    def faces(self) -> IntArray:
        """Faces of the body itself in its own particles: triangles in 3D, edges in 2D, shape (F, d)."""
        geometry = self.geometry
        if geometry.points.shape[1] == 3:
            return geometry.triangles if len(geometry.carried_nodes) == 0 else geometry.triangles[:0]
        return geometry.outline if len(geometry.outline) else geometry.capsules

    def radius_for(self, where: str) -> float:
        """Contact radius of the particles [m]; raises SceneError, beginning with ``where``."""
        try:
            return joining_radius(self.geometry) if self.body.radius == "auto" else self.body.radius
        except SceneError as error:
            raise SceneError(f"{where}: {error}") from None

    def cells_from(self, first: int) -> tuple[IntArray, IntArray]:
        """Cells of a solid, (C, 2^d), and in 2D the triangles that fill it, (T, 3), if its points count from there."""
        geometry, flat = self.geometry, self.geometry.points.shape[1] == 2
        cells = geometry.cells if len(geometry.cells) else no_elements(4 if flat else 8)
        triangles = geometry.triangles if flat and not geometry.membrane else no_elements(3)
        return cells + np.int32(first), triangles + np.int32(first)

    @property
    def feels_wind(self) -> bool:
        """Whether wind blows on the body."""
        return self.geometry.membrane if self.body.wind is None else self.body.wind

    @classmethod
    def build(cls, index: int, body: Body, scene: Scene) -> "_Part":
        where = f"bodies[{index}]"
        try:
            geometry = generate(body.shape, scene.dimension)
        except SceneError as error:
            raise SceneError(f"{where}.shape: {error}") from None
        turn = rotation_matrix(body.rotation, scene.dimension)
        arms = geometry.points @ turn.T
        positions = arms + (0.0 if body.position is None else np.asarray(body.position))
        pinned = np.zeros(len(positions), dtype=bool)
        pinned[geometry.pinned] = True
        if body.pin is not None:
            pinned |= selected(f"{where}.pin", body.pin, positions)
        velocities = _velocities(body, geometry, arms, turn)
        masses = _masses(where, body.material, geometry)
        stiffness = _stiffness(where, body, geometry)
        for name, values in (("positions", positions), ("velocities", velocities), ("masses", masses)):
            if not (np.isfinite(values).all() and np.abs(values).max() < LARGEST):
                raise SceneError(f"{where}: its {name} are too large to compute with (above {LARGEST:g})")
        return cls(
            body=body,
            geometry=geometry,
            positions=positions,
            velocities=velocities,
            masses=masses,
            pinned=pinned,
            springs=SpringSet.of_body(
                body.material,
                geometry.springs,
                geometry.rest_lengths,
                stiffness,
                _damping(body.material, stiffness, masses, pinned, geometry.springs),
            ),
        )


def _velocities(body: Body, geometry: Geometry, arms: FloatArray, turn: FloatArray) -> FloatArray:
    velocities = np.zeros_like(arms)
    if geometry.velocities is not None:
        velocities += geometry.velocities @ turn.T
    if body.velocity is not None:
        velocities += np.asarray(body.velocity)
    if body.angular_velocity is not None:
        velocities += spin(body.angular_velocity, arms)
    return velocities


def _masses(where: str, material: Material, geometry: Geometry) -> FloatArray:
    if geometry.masses is not None:
        if material.mass is not None or material.density is not None:
            raise SceneError(f"{where}.material: give masses in the shape, or mass or density, not both")
        return geometry.masses
    if material.mass is not None:
        return material.mass * geometry.mass_share
    if geometry.volume is None:
        if material.density is not None:
            raise SceneError(
                f"{where}.material.density: a custom shape has no volume; give mass, or masses in the shape"
            )
        return np.full(len(geometry.points), DEFAULT_POINT_MASS)
    total = geometry.volume * (material.density or DEFAULT_DENSITY)
    if total <= 0.0:
        raise SceneError(f"{where}.shape: has no volume, so density gives no mass; give mass")
    return total * geometry.mass_share


def _stiffness(where: str, body: Body, geometry: Geometry) -> FloatArray:
    material, count = body.material, len(geometry.springs)
    if count == 0:
        return np.zeros(0)
    if material.stiffness is not None:
        ratio = np.ones(count) if geometry.spring_ratio is None else geometry.spring_ratio
        return np.asarray(material.stiffness * ratio)
    if material.youngs_modulus is None:
        raise SceneError(f"{where}.material: give stiffness or youngs_modulus for the springs of the shape")
    if isinstance(body.shape, Custom) or geometry.spring_scale is None:
        raise SceneError(f"{where}.material.youngs_modulus: a custom shape has no lattice; give stiffness")
    if getattr(body.shape, "bracing", Bracing.FACE) is Bracing.NONE and not geometry.membrane:
        raise SceneError(f"{where}.material.youngs_modulus: bracing none resists no shear; give stiffness")
    if not np.isfinite(geometry.spring_scale).all():
        raise SceneError(
            f"{where}.shape.cells: too far from squares or cubes for youngs_modulus; "
            "choose cells in proportion to the size, or give stiffness"
        )
    return material.youngs_modulus * geometry.spring_scale


def _damping(
    material: Material, stiffness: FloatArray, masses: FloatArray, pinned: NDArray[np.bool_], springs: IntArray
) -> FloatArray:
    if not material.damping_ratio:
        return np.full(len(stiffness), material.damping or 0.0)
    inverse = np.where(pinned, 0.0, 1.0 / masses)[springs].sum(axis=1)
    # Two pinned ends never move; any damping will do.
    reduced = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0.0)
    return np.asarray(2.0 * material.damping_ratio * np.sqrt(stiffness * reduced))


def _combine(collider: Collider, material: Material) -> ContactPair:
    friction, restitution = collider.friction, collider.restitution
    if material.friction is not None:
        friction = float(np.sqrt(friction * material.friction))
    if material.restitution is not None:
        restitution = max(restitution, material.restitution)
    return ContactPair(restitution=restitution, friction=friction)


def combine_bodies(materials: Sequence[Material]) -> tuple[FloatArray, FloatArray]:
    """Restitution and friction between every two bodies [1], each of shape (B, B).

    As with colliders: the larger restitution, the geometric mean of frictions; what one of two bodies
    does not say the other says for both, and what neither says is 0.
    """
    restitution = np.array([material.restitution or 0.0 for material in materials])
    friction = np.array([np.nan if material.friction is None else material.friction for material in materials])
    one, other = friction[:, None], friction[None, :]
    mean = np.sqrt(np.where(np.isnan(one), other, one) * np.where(np.isnan(other), one, other))
    return np.maximum.outer(restitution, restitution), np.nan_to_num(mean)
