"""What contact asks of the step, known before the first: bounces without loss, heavy bodies on light ones. NumPy only.

Springs alone know nothing of either. A step at which every vibration is stable may still be far too long for
a bounce to give back the energy that it took, or for a light particle to bear what lies on it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox import limits
from sandbox.contact.particle_contact import PUSH, PUSH_ACCELERATION
from sandbox.integrators.schemes import ImplicitScheme, RungeKuttaScheme, Scheme, SplittingScheme
from sandbox.scene.assemble import Assembly, combine_bodies
from sandbox.scene.model import IntegratorName
from sandbox.stability import FloatArray, SpringNetwork, row_sum_step
from sandbox.warning_log import Remark, WarningKind

_LOSSLESS = {IntegratorName.SYMPLECTIC_EULER: 0.02, IntegratorName.VELOCITY_VERLET: 0.05, IntegratorName.RK4: 0.05}
"""Part of the limit at which bounces without loss keep their energy to 2 % [1]; other schemes keep none themselves."""
_BY_RESTITUTION, _BY_DAMPING = 2.0, 4.0 * math.pi
"""How much more of it does not matter, for each part of the energy that a bounce takes, and for a damping ratio [1]."""
_SUNK = 0.25
"""Part of their touching distance that particles may overlap under a load [1]."""
_SETTLING = 1.75
"""How much deeper than at rest a load goes when it arrives [1]."""
_PATCH = 4.0
"""Part of a face that touches when a body lies on another is 1 over this [1]."""
_MOST_LOST = 0.1
"""Part of a rebound that a scheme may damp before it is told [1]."""
_FASTER = 0.1
"""Part of the explicit limit below which the implicit midpoint rule follows every vibration [1]."""
_FALLEN = 0.1
"""Part of the scene's size that bodies may fall in a step from rest [1]."""
_BORNE = 0.5
"""Part of the fastest parting that a push can hold against a load [1]."""


def elastic_share(assembly: Assembly) -> float:
    """Largest part of its stability limit that a step may have, for bounces to keep their energy [1]; 1 where none do.

    At a step of omega h the energy of a symplectic scheme of first order is off by some omega h / 2 of what vibrates,
    and so is what a bounce gives back. That matters where nothing else takes more: restitution near 1, and hardly any
    damping.
    """
    lossless = _LOSSLESS.get(assembly.scene.solver.integrator)
    return 1.0 if lossless is None else min(1.0, lossless + _least_lost(assembly))


def _least_lost(assembly: Assembly) -> float:
    """What the body that bounces best loses by its restitution and its damping, 0 for none; inf where none bounces."""
    least, restitution = math.inf, _bounciest(assembly)
    for body in np.unique(assembly.spring_set.body):
        e = restitution[body] if body < len(restitution) else 0.0
        if e > 0.0:
            lost = _BY_RESTITUTION * (1.0 - e**2)
            lost += _BY_DAMPING * _damping_ratio(assembly, assembly.spring_set.body == body)
            least = min(least, lost)
    return least


def _bounciest(assembly: Assembly) -> FloatArray:
    """Largest restitution that every body can meet with, shape (B,)."""
    count = len(assembly.scene.bodies)
    result = np.zeros(count)
    for pairs in assembly.contacts:
        result = np.maximum(result, [pair.restitution for pair in pairs])
    if assembly.meets_particles:
        among, _ = combine_bodies([body.material for body in assembly.scene.bodies])
        meets = _meeting(assembly)
        result = np.maximum(result, np.where(meets, among, 0.0).max(axis=1))
    return result


def _damping_ratio(assembly: Assembly, chosen: NDArray[np.bool_]) -> float:
    """Least damping ratio of springs [1]."""
    springs = assembly.spring_set
    weight = assembly.inverse_masses[springs.ends[chosen]].sum(axis=1)
    k, c = springs.stiffness[chosen], springs.damping[chosen]
    counts = (k > 0.0) & (weight > 0.0)
    return float((0.5 * c[counts] * np.sqrt(weight[counts] / k[counts])).min(initial=1.0))


def _radii(assembly: Assembly) -> FloatArray:
    """Contact radius of every body [m], shape (B,)."""
    result = np.zeros(len(assembly.scene.bodies))
    np.maximum.at(result, assembly.particle_body, assembly.radii)
    return result


def _meeting(assembly: Assembly) -> NDArray[np.bool_]:
    """True for pairs of bodies whose particles can touch, shape (B, B)."""
    touches = _radii(assembly) > 0.0
    held_together = assembly.families[:, None] == assembly.families[None, :]
    return np.asarray(touches[:, None] & touches[None, :] & ~held_together)


def falling_step(assembly: Assembly) -> float:
    """Longest step in which bodies fall by a small part of their size [s]; inf where they do not fall.

    A bounce gives back the speed at its step's end, which is far above that of the meeting where a step falls far.
    """
    gravity = float(np.linalg.norm(assembly.scene.gravity or 0.0))
    extent = float(np.ptp(assembly.positions, axis=0).max())
    return math.sqrt(_FALLEN * extent / gravity) if gravity > 0.0 and extent > 0.0 else math.inf


@dataclass(frozen=True)
class Load:
    """A body that may come to lie on another."""

    heavy: str
    light: str
    """Names of the bodies."""
    ratio: float
    """Load of a particle over its mass [m/s^2]."""
    step: float
    """Longest step at which particles of the light body bear that [s]."""

    @property
    def too_heavy(self) -> bool:
        """Whether no step is short enough."""
        return self.ratio > _BORNE * PUSH_ACCELERATION


def worst_load(assembly: Assembly) -> Load | None:
    """The body that another one bears worst; None where no two bodies press each other.

    An overlap d pushes like a spring of PUSH m / dt^2, see :mod:`sandbox.contact.particle_contact`. The load is the
    weight of the heavy body, shared by the part of a face that two bodies of their numbers of particles touch with.
    """
    scene = assembly.scene
    gravity = float(np.linalg.norm(scene.gravity or 0.0))
    if gravity == 0.0 or not assembly.meets_particles:
        return None
    body, count = assembly.particle_body, len(scene.bodies)
    numbers = np.bincount(body, minlength=count)
    weights = gravity * np.bincount(body, assembly.masses, minlength=count)
    lightest = np.full(count, np.inf)
    free = assembly.inverse_masses > 0.0
    np.minimum.at(lightest, body[free], assembly.masses[free])
    radii = _radii(assembly)
    face = np.minimum.outer(numbers, numbers) ** ((scene.dimension - 1.0) / scene.dimension) / _PATCH
    ratio = weights[:, None] / (np.maximum(face, 1.0) * lightest[None, :])
    ratio[~_meeting(assembly)] = 0.0
    steps = np.sqrt(_SUNK * PUSH / _SETTLING * np.add.outer(radii, radii) / np.maximum(ratio, 1e-300))
    heavy, light = np.unravel_index(int(np.argmin(steps)), steps.shape)
    if ratio[heavy, light] == 0.0:
        return None
    names = [one.name for one in scene.bodies]
    return Load(names[heavy], names[light], float(ratio[heavy, light]), float(steps[heavy, light]))


def contact_remarks(assembly: Assembly, load: Load | None, dt: float) -> Iterator[Remark]:
    """What particles in contact cannot bear at steps of ``dt`` [s]."""
    if load is None:
        return
    on = f"{load.heavy!r} may come to lie on {load.light!r}"
    if load.too_heavy:
        line = f"{on}, and is too heavy for its particles to bear at any step: it will sink in"
        yield Remark(WarningKind.OVERLOADED, line)
    elif assembly.scene.solver.dt != "auto" and dt > load.step:
        line = f"{on}, which its particles bear with steps up to {load.step:.3g} s; at {dt:.3g} s it will sink in"
        yield Remark(WarningKind.OVERLOADED, line)


def bounce_remarks(scheme: Scheme, assembly: Assembly, network: SpringNetwork, dt: float) -> Iterator[Remark]:
    """How far bounces of bodies will not be as their restitution says, at steps of ``dt`` [s]."""
    name = assembly.scene.solver.integrator
    if isinstance(scheme, SplittingScheme | RungeKuttaScheme):
        return
    if isinstance(scheme, ImplicitScheme) and scheme.order == 2:
        if _may_gain(assembly, network, dt):
            line = (
                f"bodies may gain energy where they bounce: {name} does not follow vibrations faster than its step of "
                f"{dt:.3g} s; take velocity_verlet, some damping, or less restitution"
            )
            yield Remark(WarningKind.IMPLICIT_BOUNCE, line)
    elif (lost := _damped(assembly, network, dt)) > _MOST_LOST:
        line = (
            f"bodies bounce lower than their restitution says: {name} damps {lost:.0%} of the speed of a rebound at "
            f"dt = {dt:.3g} s; take a shorter one, or another scheme"
        )
        yield Remark(WarningKind.IMPLICIT_BOUNCE, line)


def _may_gain(assembly: Assembly, network: SpringNetwork, dt: float) -> bool:
    """Whether bodies may gain energy where they bounce under the implicit midpoint rule.

    It keeps all energy of vibrations faster than its step but not their phase, and bounces of single particles
    within them then may give more than they take. Measured: up to a sixth of the energy at 10 times the limit of
    explicit schemes; nothing where restitution or damping take some.
    """
    return _least_lost(assembly) < 1.0 and dt > _FASTER * row_sum_step(network, 0.0)


def _damped(assembly: Assembly, network: SpringNetwork, dt: float) -> float:
    """Part of the speed of a rebound that implicit Euler, and what solves for it, takes by its own damping [1].

    A body rebounds in half a period of its slowest deformation, in which that is 1 - exp(-pi omega h / 2)
    (Hairer, Lubich and Wanner 2003). 0 where nothing bounces.
    """
    # Bodies that bounce alone: what is held or lies still may be as slow as it likes.
    members = [np.flatnonzero(assembly.particle_body == body) for body in np.flatnonzero(_bounciest(assembly) > 0.0)]
    omegas = [limits.slowest_of(network, assembly.positions, own) for own in members]
    return 1.0 - math.exp(-0.5 * math.pi * max(omegas, default=0.0) * dt)
