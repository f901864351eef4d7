"""How far two runs of one scene are apart. NumPy only.

Position error: root mean square, over particles that can move and over samples, of the distance between where a
particle is and where it is in the reference, each relative to the size of its body (the longest edge of its box at
the start). Energy error: the largest difference of total energies, relative to the energy at play.

Contact makes trajectories chaotic: past a time two references disagree, and nothing is right or wrong there for a
single particle. From there on statistics are compared: centres of mass, volumes, energies, shapes at the end, and
the time at which bodies come to rest.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from sandbox.scene.assemble import Assembly
from sandbox.trade.record import ENERGIES, Record

FloatArray = NDArray[np.float64]

AGREEMENT = 2e-3
"""Difference up to which two references agree on a picture, in sizes of a body [1]."""
_AT_REST = 0.01
"""Part of its largest kinetic energy below which a scene counts as at rest [1]."""


@dataclass(frozen=True)
class Scale:
    """What differences in a scene are relative to. Scene order."""

    sizes: FloatArray
    """Size of its body for every particle [m], shape (N,)."""
    moves: NDArray[np.bool_]
    """Whether a particle can move, shape (N,)."""
    body: NDArray[np.int64]
    """Body of every particle, shape (N,)."""

    @classmethod
    def of(cls, assembly: Assembly) -> "Scale":
        """The scale of a scene."""
        extent = float(np.ptp(assembly.positions, axis=0).max())
        sizes = np.empty(assembly.particle_count)
        for body in np.unique(assembly.particle_body):
            members = assembly.particle_body == body
            size = float(np.ptp(assembly.positions[members], axis=0).max())
            sizes[members] = size if size > 0.0 else (extent or 1.0)
        columns = np.stack([sizes, assembly.inverse_masses > 0.0, assembly.particle_body], axis=1)
        ordered = assembly.scene_order(columns.astype(np.float64))
        return cls(sizes=ordered[:, 0], moves=ordered[:, 1] > 0.0, body=ordered[:, 2].astype(np.int64))

    @property
    def body_sizes(self) -> FloatArray:
        """Size of every body [m], shape (B,)."""
        return np.array([self.sizes[self.body == body][0] for body in range(int(self.body.max()) + 1)])


def errors_over_time(scale: Scale, run: Record, reference: Record) -> FloatArray:
    """Position error at every sample that both have, shape (S,)."""
    count = min(len(run.positions), len(reference.positions))
    apart = (run.positions[:count] - reference.positions[:count])[:, scale.moves] / scale.sizes[scale.moves, None]
    return np.sqrt((apart**2).sum(axis=2).mean(axis=1)) if scale.moves.any() else np.zeros(count)


def rms(values: FloatArray) -> float:
    """Root of the mean square; nan of nothing."""
    return float(np.sqrt((values**2).mean())) if len(values) else float("nan")


def agreeing(errors: FloatArray) -> int:
    """Number of samples before the first one at which two references disagree."""
    apart = np.flatnonzero(~(errors <= AGREEMENT))
    return int(apart[0]) if len(apart) else len(errors)


def energy_at_play(reference: Record) -> float:
    """Most kinetic energy, and most that springs and gas gain or lose, of a run [J]."""
    stored = reference.energies[:, ENERGIES.index("elastic")] + reference.energies[:, ENERGIES.index("gas")]
    return float(reference.energies[:, 0].max() + np.ptp(stored))


def energy_error(run: Record, reference: Record, frames: int) -> float:
    """Largest difference of total energies over the first pictures, relative to the energy at play [1]."""
    apart = (run.energies - reference.energies)[: frames + 1].sum(axis=1)
    return float(np.abs(apart).max() / max(energy_at_play(reference), 1e-300))


@dataclass(frozen=True)
class Statistics:
    """Differences of what can be compared where trajectories cannot; nan where a scene has no such thing."""

    centre: float
    """Of the centres of mass, root mean square over pictures, in sizes of their bodies [1]."""
    volume: float
    """Of the volumes of closed bodies, likewise, relative [1]."""
    energy: float
    """Of the mean total energy, relative to the energy at play [1]."""
    shape: float
    """Of the bodies' shapes at the end but for where they are and how they are turned, in their sizes [1]."""
    settling: float
    """Of the times at which the scene comes to rest [s]; nan where it does not in both."""


def compare(scale: Scale, run: Record, reference: Record, first: int, frame: float) -> Statistics:
    """Statistics from picture ``first`` on, pictures being ``frame`` [s] apart."""
    centre = (run.centres - reference.centres)[first:] / scale.body_sizes[:, None]
    ours, theirs = run.volumes[first:], reference.volumes[first:]
    known = np.isfinite(theirs) & (theirs != 0.0)
    energy = (run.energies - reference.energies)[first:].sum(axis=1).mean()
    return Statistics(
        centre=float(np.sqrt((centre**2).sum(axis=2).mean())),
        volume=rms(ours[known] / theirs[known] - 1.0),
        energy=float(abs(energy) / max(energy_at_play(reference), 1e-300)),
        shape=_shape_difference(scale, run.positions[-1], reference.positions[-1]),
        settling=abs(settling_time(run, frame) - settling_time(reference, frame)),
    )


STATISTICS = tuple(field.name for field in fields(Statistics))


def settling_time(run: Record, frame: float) -> float:
    """Time after which the kinetic energy stays small [s]; nan where it does not within the run."""
    kinetic = run.energies[:, 0]
    lively = np.flatnonzero(kinetic > _AT_REST * kinetic.max())
    if not len(lively):
        return 0.0
    return float("nan") if lively[-1] == len(kinetic) - 1 else (int(lively[-1]) + 1) * frame


def _shape_difference(scale: Scale, ours: FloatArray, theirs: FloatArray) -> float:
    """Root mean square distance after the best rigid motion of every body (Kabsch 1976), in body sizes [1]."""
    squares = np.zeros(len(ours))
    for body in np.unique(scale.body):
        members = scale.body == body
        a, b = (x[members] - x[members].mean(axis=0) for x in (ours, theirs))
        left, _, right = np.linalg.svd(a.T @ b)
        flip = np.ones(a.shape[1])
        flip[-1] = np.sign(np.linalg.det(left @ right)) or 1.0
        squares[members] = ((a @ (left * flip) @ right - b) ** 2).sum(axis=1) / scale.sizes[members] ** 2
    return float(np.sqrt(squares.mean()))
