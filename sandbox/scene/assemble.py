"""Scene -> Assembly: immutable NumPy arrays, the one place where units become numbers.

Particles of an assembly lie in an order that is good for memory; ``order`` leads back to the scene's.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene.appearance import Appearance
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.look import build_appearance
from sandbox.scene.model import Body, Bracing, Collider, Custom, Material, Scene
from sandbox.scene.ordering import locality_order
from sandbox.scene.placement import rotation_matrix, spin
from sandbox.scene.shapes import Geometry, generate

DEFAULT_DENSITY = 1000.0
"""Density of a body that gives neither density nor mass [kg/m^3]: water, and so most tissue and jelly."""
LARGEST = 1e15
"""Largest coordinate, speed or mass that is taken; its square is still far from the end of f32."""
DEFAULT_POINT_MASS = 1.0
"""Mass of a custom shape's point when nothing else says it [kg]."""


@dataclass(frozen=True)
class ContactPair:
    """How one collider meets one body, both materials combined."""

    restitution: float
    friction: float


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
    springs: IntArray
    """Pairs of particles, in the scene's order of springs, shape (S, 2)."""
    spring_rest_lengths: FloatArray
    """Rest lengths [m], shape (S,)."""
    spring_stiffness: FloatArray
    """Stiffness [N/m], shape (S,)."""
    spring_damping: FloatArray
    """Damping [N s/m], shape (S,)."""
    spring_body: IntArray
    """Body of every spring, shape (S,)."""
    contacts: tuple[tuple[ContactPair, ...], ...]
    """One row a collider, one entry a body."""
    appearance: Appearance

    @property
    def particle_count(self) -> int:
        return len(self.masses)

    @property
    def spring_count(self) -> int:
        return len(self.springs)

    @property
    def colliders(self) -> tuple[Collider, ...]:
        return self.scene.colliders

    def scene_order(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows of ``values`` (internal order) in the scene's order of bodies and points."""
        result = np.empty_like(values)
        result[self.order] = values
        return result

    def internal_order(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows of ``values`` (scene order) in the internal order."""
        return values[self.order]


def assemble(scene: Scene) -> Assembly:
    """The numbers of a scene. Raises SceneError where its parts do not fit together."""
    parts = [_Part.build(index, body, scene) for index, body in enumerate(scene.bodies)]
    first = np.cumsum([0] + [len(part.masses) for part in parts])
    positions = np.concatenate([part.positions for part in parts])
    particle_body = np.repeat(np.arange(len(parts), dtype=np.int32), np.diff(first))
    springs = np.concatenate([part.geometry.springs + offset for part, offset in zip(parts, first, strict=False)])
    order = locality_order(positions, particle_body, springs)
    internal = np.empty_like(order)
    internal[order] = np.arange(len(order))
    masses = np.concatenate([part.masses for part in parts])
    inverse = np.where(np.concatenate([part.pinned for part in parts]), 0.0, 1.0 / masses)
    return Assembly(
        scene=scene,
        dimension=scene.dimension,
        order=order,
        positions=positions[order],
        velocities=np.concatenate([part.velocities for part in parts])[order],
        masses=masses[order],
        inverse_masses=inverse[order],
        radii=np.concatenate([np.full(len(part.masses), part.body.radius) for part in parts])[order],
        particle_body=particle_body[order],
        springs=internal[springs].astype(np.int32).reshape(-1, 2),
        spring_rest_lengths=np.concatenate([part.geometry.rest_lengths for part in parts]),
        spring_stiffness=np.concatenate([part.stiffness for part in parts]),
        spring_damping=np.concatenate([part.damping for part in parts]),
        spring_body=np.repeat(np.arange(len(parts), dtype=np.int32), [len(p.geometry.springs) for p in parts]),
        contacts=tuple(tuple(_combine(c, part.body.material) for part in parts) for c in scene.colliders),
        appearance=build_appearance(scene, [part.geometry for part in parts], positions, internal),
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
    stiffness: FloatArray
    damping: FloatArray

    @classmethod
    def build(cls, index: int, body: Body, scene: Scene) -> "_Part":
        where = f"bodies[{index}]"
        geometry = generate(body.shape, scene.dimension)
        turn = rotation_matrix(body.rotation, scene.dimension)
        arms = geometry.points @ turn.T
        positions = arms + (0.0 if body.position is None else np.asarray(body.position))
        pinned = _pinned(where, body, geometry, positions)
        velocities = _velocities(body, geometry, arms, turn)
        velocities[pinned] = 0.0
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
            stiffness=stiffness,
            damping=_damping(body.material, stiffness, masses, pinned, geometry.springs),
        )


def _pinned(where: str, body: Body, geometry: Geometry, positions: FloatArray) -> NDArray[np.bool_]:
    pinned = np.zeros(len(positions), dtype=bool)
    pinned[geometry.pinned] = True
    if body.pin is not None:
        for row, index in enumerate(body.pin.indices):
            if index >= len(positions):
                raise SceneError(
                    f"{where}.pin.indices[{row}]: there is no particle {index}; the body has {len(positions)}"
                )
            pinned[index] = True
        if body.pin.region is not None:
            low, high = np.asarray(body.pin.region.min), np.asarray(body.pin.region.max)
            inside = ((positions >= low) & (positions <= high)).all(axis=1)
            if not inside.any():
                raise SceneError(f"{where}.pin.region: holds no particle of the body")
            pinned |= inside
    return pinned


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
        return np.full(count, material.stiffness)
    if material.youngs_modulus is None:
        raise SceneError(f"{where}.material: give stiffness or youngs_modulus for the springs of the shape")
    if isinstance(body.shape, Custom) or geometry.spring_scale is None:
        raise SceneError(f"{where}.material.youngs_modulus: a custom shape has no lattice; give stiffness")
    if getattr(body.shape, "bracing", Bracing.FACE) is Bracing.NONE:
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
