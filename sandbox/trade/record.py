"""What a study keeps of a run: positions at some instants, and a few numbers of every picture."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import DivergedError
from sandbox.files import replace_when_whole
from sandbox.scene.assemble import Assembly
from sandbox.simulation import Simulation
from sandbox.trade.trial import Trial

FloatArray = NDArray[np.float64]

ENERGIES = ("kinetic", "elastic", "gravity", "gas")


@dataclass(frozen=True)
class Record:
    """A run. S samples, F pictures without the start, N particles, B bodies, dimension d; scene order."""

    samples: NDArray[np.int64]
    """Pictures of the samples, counted from 1, shape (S,)."""
    positions: FloatArray
    """[m], shape (S, N, d)."""
    energies: FloatArray
    """Columns ENERGIES at the start and after every picture [J], shape (F + 1, 4)."""
    centres: FloatArray
    """Centre of mass of every body [m], shape (F + 1, B, d)."""
    volumes: FloatArray
    """Volume (2D: area) of every closed body [m^3], nan for others, shape (F + 1, B)."""

    def save(self, path: Path) -> None:
        """Write it as NPZ, whole or not at all."""
        with replace_when_whole(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **vars(self))

    @classmethod
    def load(cls, path: Path) -> "Record":
        """Read what :meth:`save` wrote. Raises OSError, ValueError or KeyError where it is none."""
        with np.load(path, allow_pickle=False) as data:
            return cls(**{name: data[name] for name in cls.__dataclass_fields__})


def record(simulation: Simulation, trial: Trial, check: Any = lambda: None) -> Record:
    """Run a trial from the simulation's present state; ``check()`` is called before every picture.

    Raises DivergedError where it blows up.
    """
    look = _Look(simulation.assembly)
    positions, rows = [], [look.at(simulation)]
    for frame in range(1, trial.frames + 1):
        check()
        simulation.step_frame()
        rows.append(look.at(simulation))
        if frame in trial.samples:
            positions.append(simulation.positions())
    energies, centres, volumes = (np.array(column) for column in zip(*rows, strict=True))
    result = Record(np.array(trial.samples), np.array(positions), energies, centres, volumes)
    if not all(np.isfinite(values).all() for values in (result.positions, energies, centres)):
        raise DivergedError("diverged: not finite", time=simulation.time, stable_dt=np.nan)
    return result


class _Look:
    """Takes the numbers of a state."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        bodies = len(assembly.scene.bodies)
        self.shares = np.zeros((bodies, assembly.particle_count))
        self.shares[assembly.particle_body, np.arange(assembly.particle_count)] = assembly.masses
        self.shares /= np.maximum(self.shares.sum(axis=1, keepdims=True), 1e-300)
        self.surfaces = [_closed_surface(assembly, body) for body in range(bodies)]

    def at(self, simulation: Simulation) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Energies, centres and volumes now."""
        energy = simulation.energy()
        x = self.assembly.internal_order(simulation.positions())
        points = x
        look = self.assembly.appearance
        if len(look.carried_nodes):
            points = np.concatenate([x, np.einsum("cn,cnd->cd", look.carried_weights, x[look.carried_nodes])])
        volumes = [_volume(points, surface) for surface in self.surfaces]
        return np.array([getattr(energy, name) for name in ENERGIES]), self.shares @ x, np.array(volumes)


def _closed_surface(assembly: Assembly, body: int) -> NDArray[np.int32]:
    """Triangles (2D: of the filled area) of a body that has an inside; none for others."""
    look = assembly.appearance
    triangles: NDArray[np.int32] = look.triangles[(look.triangle_body == body) & look.shown().triangles]
    if look.body_two_sided[body]:
        return triangles[:0]
    return triangles


def _volume(points: FloatArray, triangles: NDArray[np.int32]) -> float:
    """Volume within triangles [m^3], or area of flat ones [m^2]; nan where there are none."""
    if not len(triangles):
        return float("nan")
    a, b, c = (points[triangles[:, k]] for k in range(3))
    if points.shape[1] == 2:
        return float(0.5 * np.sum((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
