"""What went wrong: which element first left its bounds, and what step would have been stable."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.assemble import Assembly

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Failure:
    """The worst element of a state."""

    spring: int | None
    """Spring with the largest strain; None in a scene without springs."""
    strain: float
    """Its strain |r - L| / L [1]."""
    particle: int
    """Fastest particle, internal index."""
    speed: float
    """Its speed [m/s]."""

    @classmethod
    def of_state(cls, assembly: Assembly, positions: FloatArray, velocities: FloatArray) -> "Failure":
        """The worst element of finite positions [m] and velocities [m/s], internal order."""
        with np.errstate(over="ignore"):
            speeds = np.linalg.norm(velocities, axis=1)
        particle = int(speeds.argmax())
        if assembly.spring_count == 0:
            return cls(None, 0.0, particle, float(speeds[particle]))
        a, b = assembly.springs.T
        rest = assembly.spring_set.rest_lengths
        with np.errstate(over="ignore"):
            stretch = np.abs(np.linalg.norm(positions[b] - positions[a], axis=1) - rest)
        # A spring that has been cut is as long as it likes.
        joins = (rest > 0.0) & (assembly.spring_set.stiffness > 0.0)
        strain = np.divide(stretch, rest, out=np.zeros_like(rest), where=joins)
        spring = int(strain.argmax())
        return cls(spring, float(strain[spring]), particle, float(speeds[particle]))

    def particles(self, assembly: Assembly) -> tuple[int, ...]:
        """Particles of the spring, or the particle where there is none, in the scene's order."""
        internal = [self.particle] if self.spring is None else assembly.springs[self.spring]
        return tuple(int(assembly.order[particle]) for particle in internal)

    def element(self, assembly: Assembly) -> str:
        """The spring, or the particle where there is none, as the scene names it."""
        if self.spring is None:
            body, particle = _particle_name(assembly, self.particle)
            return f"body {body!r}, particle {particle}"
        index = int(assembly.spring_set.body[self.spring])
        if index >= len(assembly.scene.bodies):
            attachment = assembly.scene.attachments[index - len(assembly.scene.bodies)]
            return f"a spring that attaches {attachment.body!r} to {attachment.to!r}"
        body = assembly.scene.bodies[index].name
        number = self.spring - int(np.searchsorted(assembly.spring_set.body, index))
        ends = [_particle_name(assembly, int(end))[1] for end in assembly.springs[self.spring]]
        return f"body {body!r}, spring {number} (particles {ends[0]} and {ends[1]})"


def _particle_name(assembly: Assembly, particle: int) -> tuple[str, int]:
    """Name of the particle's body, and its index there."""
    body = int(assembly.particle_body[particle])
    first = assembly.order[assembly.particle_body == body].min()
    return assembly.scene.bodies[body].name, int(assembly.order[particle] - first)


def describe(
    failure: Failure,
    assembly: Assembly,
    time: float,
    dt: float,
    stable_dt: float,
    spring_frequencies: FloatArray,
    finite: bool,
) -> str:
    """One line: when, which element, how far, its omega dt, and the step [s] that would have been stable."""
    how = f"speed {failure.speed:.3g} m/s" + ("" if finite else ", then not finite")
    if failure.spring is not None:
        how = f"strain {failure.strain:.3g}, {how}, omega dt = {spring_frequencies[failure.spring] * dt:.3g}"
    text = f"diverged at t = {time:.6g} s: {failure.element(assembly)}: {how}"
    if dt > stable_dt:
        return f"{text}; dt was {dt:.4g} s, stable is {stable_dt:.4g} s: set solver.dt below it, or to auto"
    bounds = "its motion left the bounds: lower solver.dt or raise diagnostics.max_strain or max_speed"
    if not math.isfinite(stable_dt):
        return f"{text}; dt was {dt:.4g} s, and nothing in this scene limits it with this scheme: {bounds}"
    return f"{text}; dt = {dt:.4g} s is within the {stable_dt:.4g} s that were stable before: {bounds}"
