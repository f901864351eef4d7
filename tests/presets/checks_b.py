"""What must be true of the presets tower, bridge, pile, trampoline and cloth.

A check takes the simulation at its end, a measurement and the positions [m] of every picture.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from sandbox import Simulation
from sandbox.diagnostics import Measurement

Positions = NDArray[np.float64]
Check = Callable[[Simulation, Sequence[Measurement], Sequence[Positions]], None]


def _particles(simulation: Simulation) -> dict[str, NDArray[np.int64]]:
    """Particles of every body by its name, in the scene's order."""
    assembly = simulation.assembly
    body = np.empty(assembly.particle_count, dtype=np.int64)
    body[assembly.order] = assembly.particle_body
    return {part.name: np.flatnonzero(body == index) for index, part in enumerate(assembly.scene.bodies)}


def _triangles(simulation: Simulation) -> NDArray[np.int64]:
    """Surface triangles, by particles in the scene's order."""
    return simulation.assembly.order[simulation.assembly.appearance.triangles]


def _picture(simulation: Simulation, time: float) -> int:
    """Number of the picture at a time [s]."""
    return round(time * simulation.scene.render.fps) - 1


def _centres(snapshots: Sequence[Positions], particles: NDArray[np.int64]) -> Positions:
    """Mean position of a body in every picture [m]."""
    return np.array([positions[particles].mean(axis=0) for positions in snapshots])


def _rests(simulation: Simulation, snapshots: Sequence[Positions], speed: float) -> None:
    """No body's centre moves faster than ``speed`` [m/s] over the last fifth of a second."""
    back = round(0.2 * simulation.scene.render.fps)
    for name, own in _particles(simulation).items():
        way = snapshots[-1][own].mean(axis=0) - snapshots[-1 - back][own].mean(axis=0)
        assert np.linalg.norm(way) < 0.2 * speed, f"{name} still moves"


def tower_comes_down(simulation: Simulation, history: Sequence[Measurement], snapshots: Sequence[Positions]) -> None:
    own = _particles(simulation)
    tower, ball = own["tower"], own["ball"]
    springs = simulation.assembly.spring_set
    members = springs.body == 0
    assert members.sum() >= 1000
    start = simulation.assembly.scene_order(simulation.assembly.positions)[tower]
    hit = next(number for number, measured in enumerate(history) if measured.torn > 0)
    standing = snapshots[_picture(simulation, 0.3)][tower]
    assert hit > _picture(simulation, 0.3)
    assert np.linalg.norm(standing - start, axis=1).max() < 0.02  # it bears its own weight
    assert np.linalg.norm(_centres(snapshots, ball)[hit] - start.mean(axis=0)) < 2.0  # and then the ball is there
    end = snapshots[-1]
    assert 20 < history[-1].torn < 0.5 * members.sum()
    rest = next(values for name, values in simulation.memory.items() if name.endswith("rest_length"))
    bent = np.abs(rest / springs.rest_lengths[members] - 1.0) > 0.02
    assert bent.sum() > 100  # bent for good
    assert end[tower][:, 1].max() < 0.4 * start[:, 1].max()
    assert end[tower][:, 0].max() > 3.0  # it lies stretched out, away from where the ball came from
    assert end[:, 1].min() > 0.045  # on the ground, less the radius of the nodes
    assert np.linalg.norm(end[tower] - snapshots[-7][tower], axis=1).mean() < 0.03


def bridge_bears_the_jelly(
    simulation: Simulation, history: Sequence[Measurement], snapshots: Sequence[Positions]
) -> None:
    own = _particles(simulation)
    end = snapshots[-1]
    start = simulation.assembly.scene_order(simulation.assembly.positions)
    jelly = end[own["jelly"]]
    planks = [particles for name, particles in own.items() if name.startswith("plank")]
    row = np.array([end[plank].mean(axis=0) for plank in planks])
    assert np.abs(jelly[:, 0]).max() < 1.9  # between the cliffs
    assert np.abs(jelly[:, 2]).max() < 0.6  # and between the rails
    under = row[np.argmin(np.abs(row[:, 0] - jelly[:, 0].mean()))]
    assert 0.2 < jelly[:, 1].mean() - under[1] < 0.5  # on the planks
    assert _depths(end[np.concatenate(planks)], jelly).max() < 0.03  # and none of them in it
    assert jelly[:, 1].min() > 0.5
    middle = _centres(snapshots, planks[len(planks) // 2])[:, 1]
    assert 0.15 < 1.5 - middle.min() < 0.9  # it sags
    after = middle[_picture(simulation, 0.8) :]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(after))))
    assert len(turns) >= 4  # and swings
    assert np.ptp(after[-10:]) < 0.3 * np.ptp(after)
    # Planks lie in a row, level across, and none has left its ropes.
    assert (np.diff(row[:, 0]) > 0.15).all()
    assert np.abs(row[:, 2]).max() < 0.15
    for plank in planks:
        sides = [end[plank][start[plank][:, 2] * side > 0.5].mean(axis=0) for side in (1, -1)]
        assert abs(sides[0][1] - sides[1][1]) < 0.25
    springs = simulation.assembly.spring_set
    held = springs.ends[springs.body >= len(own)]
    ends = simulation.assembly.internal_order(end)[held]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max() < 0.15
    for side in ("left", "right"):
        clear = end[own[f"{side} rail"]][:, 1] - end[own[f"{side} rope"]][:, 1]
        assert 0.3 < clear.min() < clear.max() < 0.75  # the rail hangs over its rope
    assert max(measured.max_strain for measured in history) < 1.5


def pile_is_a_heap_in_the_box(
    simulation: Simulation, history: Sequence[Measurement], snapshots: Sequence[Positions]
) -> None:
    own = _particles(simulation)
    end = snapshots[-1]
    assert len(own) >= 30
    assert {name.split()[0] for name in own} == {"cube", "ball", "rod"}
    walls = [collider for collider in simulation.scene.colliders if collider.kind == "box"]
    inner = min(max(abs(wall.position[0]), abs(wall.position[2])) for wall in walls)
    centres = np.array([end[particles].mean(axis=0) for particles in own.values()])
    assert np.abs(centres[:, [0, 2]]).max() < inner  # none was lost
    assert centres[:, 1].min() > 0.05
    assert centres[:, 1].max() > 0.5  # several layers of them
    _rests(simulation, snapshots, 0.1)
    volumes = [_volumes(simulation, positions) for positions in (snapshots[0], end)]
    assert (np.abs(volumes[1] / volumes[0] - 1.0) < 0.3).all()  # squashed, not crumpled
    assert _deepest(end, list(own.values())) < 0.04  # no body is inside another
    assert max(measured.max_penetration for measured in history[30:]) < 1e-3


def _volumes(simulation: Simulation, positions: Positions) -> Positions:
    """Volume inside the surface of every body [m^3]."""
    corners = positions[_triangles(simulation)]
    six = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return np.bincount(simulation.assembly.appearance.triangle_body, six / 6.0)


def _deepest(positions: Positions, bodies: list[NDArray[np.int64]]) -> float:
    """How far a particle of one body is inside the convex hull of another [m]."""
    deepest = 0.0
    for index, body in enumerate(bodies):
        others = positions[np.concatenate(bodies[:index] + bodies[index + 1 :])]
        deepest = max(deepest, float(_depths(others, positions[body]).max()))
    return deepest


def _depths(points: Positions, body: Positions) -> Positions:
    """How far points are inside the convex hull of a body [m]; negative outside."""
    faces = ConvexHull(body).equations
    return -(points @ faces[:, :3].T + faces[:, 3]).max(axis=1)


def trampoline_throws_the_ball(
    simulation: Simulation, history: Sequence[Measurement], snapshots: Sequence[Positions]
) -> None:
    own = _particles(simulation)
    mat = own["mat"]
    height = _centres(snapshots, own["ball"])[:, 1]
    tops = [
        number
        for number in range(1, len(height) - 1)
        if height[number - 1] <= height[number] > height[number + 1] and height[number] - height[:number].min() > 0.1
    ]
    assert len(tops) >= 2  # thrown up again and again
    assert height[tops[0]] - height[: tops[0]].min() > 0.3
    assert all(height[later] <= height[sooner] + 0.05 for sooner, later in itertools.pairwise(tops))
    cube = _centres(snapshots, own["cube"])
    assert cube[0, 0] < -2.0
    for body in (own["ball"], own["cube"]):
        assert np.abs(snapshots[-1][body][:, [0, 2]]).max() < 1.3  # both stay on the mat
        assert _above(snapshots[-1][mat], snapshots[-1][body]).min() > 0.0  # and over it
        for positions in snapshots[_picture(simulation, 1.6) :]:
            # A corner may dig in for a moment.
            assert (_above(positions[mat], positions[body]) < 0.0).mean() < 0.03
    start = simulation.assembly.scene_order(simulation.assembly.positions)[mat]
    rim = np.abs(start[:, [0, 2]]).max(axis=1) > 1.19
    assert np.abs(snapshots[-1][mat][rim] - start[rim]).max() < 1e-6
    assert 0.1 < start[:, 1].max() - min(positions[mat][:, 1].min() for positions in snapshots) < 0.8
    assert max(measured.max_strain for measured in history) < 0.6


def _above(mat: Positions, body: Positions) -> Positions:
    """Height of every particle of a body over that of the mat which is nearest in plan [m]."""
    _, nearest = cKDTree(mat[:, [0, 2]]).query(body[:, [0, 2]])
    return body[:, 1] - mat[nearest][:, 1]


def cloth_drapes_and_folds(
    simulation: Simulation, history: Sequence[Measurement], snapshots: Sequence[Positions]
) -> None:
    sphere = next(collider for collider in simulation.scene.colliders if collider.kind == "sphere")
    radius = simulation.scene.bodies[0].radius
    centre = np.array(sphere.position)
    apart = np.array([np.linalg.norm(positions - centre, axis=1).min() for positions in snapshots])
    assert apart.min() > sphere.radius + radius - 2e-3  # never inside the sphere
    assert min(positions[:, 1].min() for positions in snapshots) > radius - 2e-3  # nor the ground
    end = snapshots[-1]
    resting = np.linalg.norm(end - centre, axis=1) < sphere.radius + radius + 3e-3
    assert resting.sum() > 300
    assert (end[:, 1] < radius + 3e-3).sum() > 5  # its corners reach the ground
    blown = snapshots[_picture(simulation, 2.0)]
    assert blown[:, 0].min() < end[:, 0].min() - 0.15  # the gust had lifted it
    assert _touching(simulation, blown) > 20  # and laid it over upon itself
    assert _touching(simulation, end) > 0
    for positions in (*snapshots[::10], end):
        assert _pierced(positions, _triangles(simulation)) == 0
    assert np.linalg.norm(end - snapshots[-7], axis=1).mean() < 0.02  # and comes to rest
    assert simulation.energy().kinetic < 0.05 * max(measured.energy.kinetic for measured in history)


def _touching(simulation: Simulation, positions: Positions) -> int:
    """Pairs of particles that touch though they are far from each other in the flat cloth."""
    radius = simulation.scene.bodies[0].radius
    pairs = cKDTree(positions).query_pairs(2.1 * radius, output_type="ndarray")
    flat = simulation.assembly.scene_order(simulation.assembly.positions)
    return int((np.linalg.norm(flat[pairs[:, 0]] - flat[pairs[:, 1]], axis=1) > 8.0 * radius).sum())


def _pierced(points: Positions, triangles: NDArray[np.int64]) -> int:
    """Number of edges of a surface that pass through a triangle of it with which they share no corner."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = np.unique(np.sort(sides, axis=1), axis=0)
    longest = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1).max()
    near = cKDTree(points[edges].mean(axis=1)).query_ball_tree(cKDTree(points[triangles].mean(axis=1)), 1.2 * longest)
    edge = np.repeat(edges, [len(row) for row in near], axis=0)
    face = triangles[np.concatenate([np.array(row, dtype=np.int64) for row in near])]
    strangers = ~(edge[:, :, None] == face[:, None, :]).any(axis=(1, 2))
    a, b = points[edge[strangers]].transpose(1, 0, 2)
    p, q, r = points[face[strangers]].transpose(1, 0, 2)
    normal = np.cross(q - p, r - p)
    before, after = (np.einsum("ij,ij->i", end - p, normal) for end in (a, b))
    through = before * after < 0.0
    a, b, p, q, r, normal = (values[through] for values in (a, b, p, q, r, normal))
    share = before[through] / (before[through] - after[through])
    spot = a + share[:, None] * (b - a)
    inside = np.ones(len(spot), dtype=bool)
    for one, other in ((p, q), (q, r), (r, p)):
        inside &= np.einsum("ij,ij->i", np.cross(other - one, spot - one), normal) > 0.0
    return int(inside.sum())


CHECKS_B: dict[str, Check] = {
    "tower": tower_comes_down,
    "bridge": bridge_bears_the_jelly,
    "pile": pile_is_a_heap_in_the_box,
    "trampoline": trampoline_throws_the_ball,
    "cloth": cloth_drapes_and_folds,
}
