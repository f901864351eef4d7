"""Faces of bodies as physics sees them: what gas presses on and wind blows against. NumPy only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbox.errors import SceneError
from sandbox.scene import mesh_file
from sandbox.scene.lattice import FloatArray, IntArray
from sandbox.scene.model import Action, Body, Pressure, Pump
from sandbox.scene.topology import directed_edges, pair_keys

GAS_CONSTANT = 8.314462618
"""Molar gas constant R [J/(mol K)], exact in the SI since 2019."""


@dataclass(frozen=True)
class FaceSet:
    """F faces of bodies in d dimensions: triangles in 3D, edges in 2D."""

    faces: IntArray
    """Particles, counter-clockwise from outside (2D: the outward normal of edge a -> b is (dy, -dx)), shape (F, d)."""
    body: IntArray
    """Body of every face, rising, shape (F,)."""
    springs: IntArray
    """Spring along each edge of a face, -1 where there is none, shape (F, 3), in 2D (F, 1)."""


@dataclass(frozen=True)
class Gas:
    """Gas in one body, in SI units."""

    body: int
    """Index of the body."""
    name: str
    """Name of the body."""
    amount: float
    """Amount at the start [mol]."""
    temperature: float
    """[K]."""
    ambient: float
    """Pressure outside [Pa]."""
    leak: float
    """Rate at which gas above the ambient pressure escapes [1/s]."""
    rest_volume: float
    """Volume as placed [m^3]; in 2D that of 1 m thickness."""
    pumps: tuple[tuple[float, float, float], ...]
    """Gas let in evenly: start [s], end [s], amount [mol]."""


def enclosed_volume(faces: IntArray, positions: FloatArray) -> float:
    """Signed volume (2D: area) inside faces, shape (F, d), of points [m], shape (N, d); positive if they face out."""
    if faces.shape[1] == 3:
        return mesh_file.signed_volume(positions, faces)
    (ax, ay), (bx, by) = (positions[faces[:, k]].T - positions[faces].mean(axis=(0, 1))[:, None] for k in range(2))
    return float(0.5 * (ax * by - ay * bx).sum())


def is_closed(faces: IntArray) -> bool:
    """True where faces leave no hole: every edge (2D: end point) belongs to two faces that pass it in opposite ways."""
    if faces.shape[1] == 3:
        return mesh_file.is_closed(faces)
    one_each = len(np.unique(faces[:, 0])) == len(faces)
    return len(faces) > 0 and one_each and bool((np.sort(faces[:, 0]) == np.sort(faces[:, 1])).all())


def edge_springs(faces: IntArray, springs: IntArray) -> IntArray:
    """Spring along each edge of faces (F, 3), or of edges (F, 2), or -1; shape (F, 3) or (F, 1)."""
    width = 1 if faces.shape[1] == 2 else 3
    return pair_springs(faces if width == 1 else directed_edges(faces), springs).reshape(-1, width)


def pair_springs(pairs: NDArray[np.int32] | NDArray[np.int64], springs: IntArray) -> IntArray:
    """Spring between the particles of every pair, (P, 2), or -1; the first of several; shape (P,)."""
    result = np.full(len(pairs), -1, dtype=np.int32)
    if len(pairs) == 0 or len(springs) == 0:
        return result
    wanted, key = pair_keys(pairs), pair_keys(springs)
    order = np.argsort(key, kind="stable")
    place = np.minimum(np.searchsorted(key[order], wanted), len(key) - 1)
    found = key[order[place]] == wanted
    result[found] = order[place[found]]
    return result


def gas_of(index: int, body: Body, faces: IntArray, positions: FloatArray, actions: Sequence[Action]) -> Gas:
    """The gas of a body with ``pressure``. Raises SceneError where the body is not closed."""
    where = f"bodies[{index}].pressure"
    pressure = body.pressure
    assert isinstance(pressure, Pressure)
    if not is_closed(faces):
        raise SceneError(f"{where}: the body is not closed; use a ring, a shell, or a closed mesh with fill = shell")
    volume = enclosed_volume(faces, positions)
    if not volume > 0.0:
        raise SceneError(f"{where}: the body encloses no volume; its faces must look outward")
    amount = pressure.amount
    if amount is None:
        assert pressure.gauge_pressure is not None
        amount = (pressure.ambient + pressure.gauge_pressure) * volume / (GAS_CONSTANT * pressure.temperature)
    pumps = tuple((a.start, a.end, a.amount) for a in actions if isinstance(a, Pump) and a.body == body.name)
    return Gas(index, body.name, amount, pressure.temperature, pressure.ambient, pressure.leak, volume, pumps)


def collect(parts: Sequence[tuple[int, IntArray]], springs: NDArray[np.int32], dimension: int) -> FaceSet:
    """One set of the faces of several bodies: (body index, faces (F, d) in internal particle indices)."""
    faces = np.concatenate([np.zeros((0, dimension), np.int32)] + [own for _, own in parts]).astype(np.int32)
    body = np.concatenate([np.zeros(0, np.int32)] + [np.full(len(own), index, np.int32) for index, own in parts])
    return FaceSet(faces, body.astype(np.int32), edge_springs(faces, springs))
