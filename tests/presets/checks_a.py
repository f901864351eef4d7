"""How balloons, torn tissue, clay, boxes over polygons and a flag must end."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from sandbox import Simulation
from sandbox.diagnostics import Measurement

FloatArray = NDArray[np.float64]
History = Sequence[Measurement]
Snapshots = Sequence[FloatArray]


def balloon_has_bounced_and_grown(simulation: Simulation, history: History, snapshots: Snapshots) -> None:
    (rest_volume,) = (gas.rest_volume for gas in simulation.assembly.gases)
    (volume,) = gas_of(simulation).volumes()
    (gauge,) = gas_of(simulation).gauge_pressures()
    assert 1.8 < volume / rest_volume < 2.0
    assert gauge > 150.0  # the rubber holds it together
    height = heights(simulation, history)
    landed = 5 + int(np.argmin(height[5:20]))
    assert height[landed] < 0.42  # squashed: below the radius
    assert height[landed : landed + 20].max() > 0.65  # and thrown up again
    strain = np.array([measured.max_strain for measured in history])
    assert strain[frames(simulation, 2.8, 3.2)].min() > 0.25  # the finger's dent
    assert strain[frames(simulation, 3.7, 4.0)].max() < 0.15  # which is gone with it
    positions = simulation.assembly.internal_order(simulation.positions())
    assert -1e-5 < positions[:, 1].min() < 1e-3
    assert simulation.measure().max_speed < 0.6
    # Round but for the side that it lies on, and smooth: no particle stands out from its neighbours.
    radius = np.linalg.norm(positions - positions.mean(axis=0), axis=1)
    assert radius.max() / radius.min() < 1.2
    first, second = simulation.assembly.springs.T
    assert np.abs(radius[first] - radius[second]).max() < 0.03


def rings_lie_in_the_pit(simulation: Simulation, history: History, snapshots: Snapshots) -> None:
    gases = simulation.assembly.gases
    growth = gas_of(simulation).volumes() / [gas.rest_volume for gas in gases]
    pumped = np.array([bool(gas.pumps) for gas in gases])
    assert growth[pumped].min() > 1.5
    assert 0.93 < growth[~pumped].min() and growth[~pumped].max() < 1.1
    positions = simulation.positions()
    # Through the neck, all of them, into the chamber below.
    assert positions[:, 1].max() < 1.6
    assert positions[:, 1].min() > -1e-4
    assert np.abs(positions[:, 0]).max() < 1.75
    assert max(measured.max_penetration for measured in history) < 1e-5
    assert overlapping(simulation, rings(simulation)) == []
    assert travel_in(simulation, 0.2) < 0.06
    assert simulation.energy().kinetic < 0.02 * max(measured.energy.kinetic for measured in history)


def tissue_has_parted(simulation: Simulation, history: History, snapshots: Snapshots) -> None:
    torn = np.array([measured.torn for measured in history])
    strain = np.array([measured.max_strain for measured in history])
    assert torn[frames(simulation, 0.0, 0.45)].max() == 0
    assert strain[frames(simulation, 0.0, 0.5)].max() > 0.25  # it stretches first
    assert torn[-1] > 100
    # It runs for more than a second, and is over in the end.
    assert np.interp([0.1 * torn[-1], 0.9 * torn[-1]], torn, simulation_times(simulation, history)) @ [-1, 1] > 0.8
    assert torn[-1] == torn[frames(simulation, 3.0, 3.1)].max()
    parts = pieces(simulation)
    sizes = np.bincount(parts)
    large = np.argsort(sizes)[-2:]
    assert sizes[large].min() > 0.4 * len(parts)
    assert sizes[large].sum() > 0.98 * len(parts)
    # One hangs from either clamp, with a gap between them.
    positions = simulation.assembly.internal_order(simulation.positions())
    left, right = sorted((positions[parts == part] for part in large), key=lambda points: points[:, 0].mean())
    assert right[:, 0].min() - left[:, 0].max() > 0.15
    for part, top in ((left, 1.2), (right, 1.25)):
        assert part[:, 1].max() > top
        assert part[:, 1].min() < top - 0.6
    kinetic = np.array([measured.energy.kinetic for measured in history])
    assert kinetic[frames(simulation, 2.0, 3.0)].max() > 0.1  # the halves spring back
    assert kinetic[-1] < 0.05


def clay_keeps_two_dents(simulation: Simulation, history: History, snapshots: Snapshots) -> None:
    positions = simulation.positions()
    shape = (16, 7, 12, 3)
    start = simulation.assembly.scene_order(simulation.assembly.positions).reshape(shape)
    grid = positions.reshape(shape)
    assert np.all(np.diff(start[:, 0, 0, 0]) > 0.0) and np.all(np.diff(start[0, :, 0, 1]) > 0.0)
    top, first = grid[:, -1, :, 1], start[:, -1]
    for x in (-0.24, 0.24):
        beneath = np.hypot(first[..., 0] - x, first[..., 2]) < 0.08
        assert top[beneath].mean() < 0.34
    edge = (np.abs(first[..., 0]) > 0.49) | (np.abs(first[..., 2]) > 0.34)
    assert top[edge].min() > 0.36
    # At rest: it moves no more, and the thumb has been gone for a while.
    assert travel_in(simulation, 0.2) < 1e-3
    assert simulation.measure().max_speed < 0.05
    assert simulation.measure().max_penetration < 1e-5
    lengths = simulation.assembly.spring_set.rest_lengths
    (flowed,) = (values for name, values in simulation.memory.items() if name.endswith(".rest_length"))
    assert np.abs(flowed / lengths - 1.0).max() > 0.2  # what stays is plastic
    # No cell is inside out.
    edges = [np.diff(grid, axis=axis) for axis in range(3)]
    across = edges[0][:, :-1, :-1], edges[1][:-1, :, :-1], edges[2][:-1, :-1, :]
    volumes = np.einsum("ijkc,ijkc->ijk", np.cross(across[0], across[1]), across[2])
    assert volumes.min() > 0.2 * np.median(volumes)


def boxes_rest_on_polygons(simulation: Simulation, history: History, snapshots: Snapshots) -> None:
    assembly = simulation.assembly
    triangles, owner = assembly.appearance.triangles, assembly.appearance.triangle_body
    points = assembly.internal_order(simulation.positions())
    before, after = (areas(triangles, values) for values in (assembly.positions, points))
    assert np.bincount(owner, after) == pytest.approx(np.bincount(owner, before), rel=0.05)
    assert (after / before).min() > 0.5  # nothing is folded over
    assert max(measured.max_penetration for measured in history) < 1e-5
    assert overlapping(simulation, outlines(simulation)) == []
    assert travel_in(simulation, 0.2) < 0.02
    assert simulation.energy().kinetic < 1e-3 * max(measured.energy.kinetic for measured in history)
    # The captive has turned with its block, and is still in the hole.
    names = [body.name for body in simulation.scene.bodies]
    (block,) = (collider for collider in simulation.scene.colliders if getattr(collider, "holes", ()))
    turn = np.radians(block.motion[-1].rotation)
    assert abs(turn) > np.radians(180.0)
    frame = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    captive = points[assembly.particle_body == names.index("captive")]
    assert inside(np.array(block.holes[0]), (captive - block.position) @ frame.T).all()
    # Not everything has just fallen to the ground.
    lowest = [points[assembly.particle_body == body][:, 1].min() for body in range(len(names))]
    assert sum(height > 0.3 for height in lowest) >= 3


def flag_flutters_from_its_pole(simulation: Simulation, history: History, snapshots: Snapshots) -> None:
    start = simulation.assembly.scene_order(simulation.assembly.positions)
    held, free = start[:, 0] < 0.035, start[:, 0] > start[:, 0].max() - 1e-6
    seen = []
    for _ in range(30):
        simulation.step_frame()
        seen.append(simulation.positions())
    path = np.array(seen)
    assert np.abs(path[:, held] - start[held]).max() < 1e-5
    swing = np.ptp(path[:, free, 2], axis=0)
    assert 0.15 < swing.mean() < 1.5  # the free edge goes to and fro
    assert np.abs(path[:, free, 2]).max() < 1.3
    assert path[:, free, 0].mean() > 1.0  # and streams out
    # Waves run to the free edge: what z does at two thirds of the flag, it does at the edge, only later.
    row = np.abs(start[:, 1] - 2.0) < 0.02
    inner = row & (np.abs(start[:, 0] - 1.0) < 0.02)
    z_inner, z_outer = path[:, inner, 2].mean(axis=1), path[:, row & free, 2].mean(axis=1)
    lags = np.arange(-6, 7)
    match = [np.corrcoef(z_inner[6:-6], z_outer[6 + lag : len(z_outer) - 6 + lag])[0, 1] for lag in lags]
    assert lags[int(np.argmax(match))] > 0
    assert max(measured.max_strain for measured in history) < 1.0
    kinetic = np.array([measured.energy.kinetic for measured in history])
    assert kinetic[30:].min() > 0.02
    assert kinetic.max() < 10.0  # it is not blown up


# -- what several of them look at -------------------------------------------------------------------


def gas_of(simulation: Simulation) -> Any:
    """The law of the scene's gases."""
    return next(law for law in simulation.laws if hasattr(law, "gauge_pressures"))


def heights(simulation: Simulation, history: History) -> FloatArray:
    """Height of the centre of mass [m] in every picture, from the energy of gravity."""
    weight = float(simulation.assembly.masses.sum()) * float(np.linalg.norm(simulation.scene.gravity or 0.0))
    return np.array([measured.energy.gravity for measured in history]) / weight


def frames(simulation: Simulation, begin: float, end: float) -> slice:
    """Which measurements were taken from ``begin`` to ``end`` [s]."""
    fps = simulation.scene.render.fps
    return slice(max(round(begin * fps) - 1, 0), round(end * fps))


def simulation_times(simulation: Simulation, history: History) -> FloatArray:
    """Time of every measurement [s]."""
    return (1.0 + np.arange(len(history))) / simulation.scene.render.fps


def travel_in(simulation: Simulation, seconds: float) -> float:
    """How far the particle that moves most gets in so many more seconds [m]."""
    before = simulation.positions()
    simulation.advance(seconds)
    return float(np.linalg.norm(simulation.positions() - before, axis=1).max())


def pieces(simulation: Simulation) -> NDArray[np.int64]:
    """Which connected piece every particle belongs to, internal order, by springs that have not torn."""
    whole = simulation.torn.to_numpy() == 0
    first, second = simulation.assembly.springs[whole].T
    count = simulation.particle_count
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def areas(triangles: NDArray[np.int32], points: FloatArray) -> FloatArray:
    """Signed areas of triangles [m^2]."""
    ab, ac = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    return 0.5 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])


def rings(simulation: Simulation) -> list[FloatArray]:
    """Corners of every ring, in order."""
    positions, body = simulation.positions(), body_in_scene_order(simulation)
    return [positions[body == b] for b in range(len(simulation.scene.bodies))]


def outlines(simulation: Simulation) -> list[FloatArray]:
    """Corners of every body's outline, in order."""
    appearance = simulation.assembly.appearance
    points = simulation.assembly.internal_order(simulation.positions())
    found = []
    for body in range(len(simulation.scene.bodies)):
        following = dict(appearance.outline[appearance.outline_body == body].tolist())
        chain = [next(iter(following))]
        while following[chain[-1]] != chain[0]:
            chain.append(following[chain[-1]])
        found.append(points[chain])
    return found


def overlapping(simulation: Simulation, shapes: list[FloatArray]) -> list[tuple[str, str]]:
    """Pairs of bodies of which one has particles within the other's outline."""
    names = [body.name for body in simulation.scene.bodies]
    positions, body = simulation.positions(), body_in_scene_order(simulation)
    return [
        (names[a], names[b])
        for a in range(len(names))
        for b in range(len(names))
        if a != b and inside(shapes[a], positions[body == b]).any()
    ]


def body_in_scene_order(simulation: Simulation) -> NDArray[np.int64]:
    """Body of every particle, in the scene's order."""
    return simulation.assembly.scene_order(simulation.assembly.particle_body.astype(float)).astype(np.int64)


def inside(corners: FloatArray, points: FloatArray) -> NDArray[np.bool_]:
    """Which points are inside a polygon: a ray to the right crosses its sides an odd number of times."""
    result = np.zeros(len(points), dtype=bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        spans = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        rise = b[1] - a[1] if b[1] != a[1] else 1.0
        result ^= spans & (points[:, 0] < a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / rise)
    return result


CHECKS_A = {
    "balloon": balloon_has_bounced_and_grown,
    "balloons_2d": rings_lie_in_the_pit,
    "boxes_2d": boxes_rest_on_polygons,
    "clay": clay_keeps_two_dents,
    "flag": flag_flutters_from_its_pole,
    "tissue": tissue_has_parted,
}
