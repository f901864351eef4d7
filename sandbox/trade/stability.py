"""The largest stable step of every scheme for a scene: predicted, and measured by bisection."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sandbox import limits
from sandbox.integrators.schemes import SCHEMES
from sandbox.pipeline import network_of
from sandbox.scene.model import IntegratorName, Scene
from sandbox.simulation import Simulation
from sandbox.trade.growth import Disturbance, largest_stable
from sandbox.trade.trial import with_solver

ACCURACY = 0.005
"""Of the bisection [1]."""
LONGEST = 0.1
"""Longest step that is tried [s]."""
HORIZON = 0.4
"""Time over which steps are tried, by default [s]."""
FEWEST_STEPS = 20
"""Steps that a horizon must have for a growth to show."""
CALM = 3.0
"""Most growth of a disturbance in short steps that does not come from the scene itself [1]."""
_MOST_HALVINGS = 6


@dataclass(frozen=True)
class StableStep:
    """One scheme in one scene. None stands for no limit: up to LONGEST where it was measured."""

    scheme: str
    order: int
    predicted: float | None
    """[s]"""
    measured: float | None
    """[s]"""
    ratio: float | None
    """Measured over predicted [1]."""
    horizon: float
    """Time over which steps had to hold: shorter than asked for where the scene itself is chaotic later [s]."""
    tried: float
    """Longest step that was tried [s]."""


def stable_steps(
    scene: Scene,
    schemes: Sequence[IntegratorName] = tuple(IntegratorName),
    horizon: float | None = None,
    arch: str = "cpu",
    threads: int | None = None,
    progress: Callable[[float, str], None] = lambda *_: None,
) -> list[StableStep]:
    """Predicted and measured limit of every scheme, in double precision, around the shape that the scene starts with.

    A step counts as stable where no vibration grows tenfold within ``horizon`` [s].
    """
    span = min(scene.duration, HORIZON) if horizon is None else horizon
    rows = []
    for number, name in enumerate(schemes):
        progress(number / len(schemes), str(name))
        rows.append(_measure(scene, name, span, arch, threads))
    return rows


def provoked(scene: Scene, arch: str, threads: int | None) -> Simulation:
    """A simulation of double precision that is meant to blow up: it neither warns of that nor looks into it."""
    simulation = Simulation(scene, arch=arch, precision="f64", threads=threads, warns=False)
    simulation.explains_failures = False
    return simulation


def _measure(scene: Scene, name: IntegratorName, horizon: float, arch: str, threads: int | None) -> StableStep:
    scheme = SCHEMES[name]
    altered = with_solver(scene, integrator=name, dt=min(1e-3, horizon), adapt=None)
    with provoked(altered, arch, threads) as simulation:
        assembly = simulation.assembly
        for halving in range(_MOST_HALVINGS):
            span = horizon / 2**halving
            limit = limits.limit(scheme, network_of(assembly), assembly.positions, span)
            near = limit.step if math.isfinite(limit.step) else span / FEWEST_STEPS
            disturbance = Disturbance(simulation, limit)
            # Collisions and tears make much of a small difference in any steps: they come later then.
            if disturbance.growth(0.5 * near, span) <= CALM:
                break
        longest = min(LONGEST, span / FEWEST_STEPS)
        measured = largest_stable(disturbance, min(near, longest), span, ACCURACY, longest)
    predicted = limit.step if math.isfinite(limit.step) else None
    return StableStep(
        scheme=str(name),
        order=scheme.order,
        predicted=predicted,
        measured=measured if math.isfinite(measured) else None,
        ratio=measured / predicted if predicted is not None and math.isfinite(measured) else None,
        horizon=span,
        tried=longest,
    )
