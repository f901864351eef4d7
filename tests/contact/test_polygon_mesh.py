"""Capsules, polygons and meshes: distances, corners, holes, and that nothing passes or gains energy."""

import math

import numpy as np
import pytest
import taichi as ti

from sandbox.contact.colliders.polygon import outline_edges
from sandbox.errors import SceneError
from sandbox.scene.model import PolygonCollider
from sandbox.scene.placement import rotation_matrix
from tests.conftest import make_scene

SQUARE = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
ARROW = [[-1.0, -0.7], [0.2, -0.1], [1.1, -0.8], [0.3, 1.2]]  # concave at its second corner
CUP = [[-0.5, 0.0], [0.5, 0.0], [0.5, 0.5], [0.48, 0.5], [0.48, 0.02], [-0.48, 0.02], [-0.48, 0.5], [-0.5, 0.5]]
HOLE = [[-0.4, -0.3], [-0.4, 0.5], [0.6, 0.2]]  # clockwise, the other way than the outline
POLYGONS = {
    "convex": {"points": SQUARE},
    "concave": {"points": ARROW[::-1], "position": [0.2, -0.1], "rotation": 25.0},
    "hole": {"points": SQUARE, "holes": [HOLE]},
    "cup": {"points": CUP},
}


@ti.kernel
def _evaluate(solid: ti.template(), c: int, points: ti.types.ndarray(), result: ti.types.ndarray()):
    for p in range(points.shape[0]):
        x = solid.state.x[0, 0]
        for axis in ti.static(range(solid.state.dimension)):
            x[axis] = points[p, axis]
        result[p] = solid.signed_distance(c, x)


def signed_distances(simulation, index, points, member=0):
    """Signed distances of a member of a group of colliders from points, as the device computes them [m]."""
    result = np.empty(len(points))
    _evaluate(simulation._wake().parts.colliders[index], member, np.ascontiguousarray(points, dtype=float), result)
    return result


def from_segments(points, starts, ends):
    """Distance of every point from the nearest of some segments [m]."""
    along = ends - starts
    arm = points[:, None] - starts[None]
    t = np.clip((arm * along).sum(-1) / (along * along).sum(-1), 0.0, 1.0)
    return np.linalg.norm(arm - t[..., None] * along, axis=-1).min(axis=1)


def turns_around(points, outline):
    """How often a closed outline goes around every point, by the sum of its angles."""
    arms = np.asarray(outline)[None] - points[:, None]
    following = np.roll(arms, -1, axis=1)
    cross = arms[..., 0] * following[..., 1] - arms[..., 1] * following[..., 0]
    return np.rint(np.arctan2(cross, (arms * following).sum(-1)).sum(axis=1) / (2.0 * np.pi)).astype(int)


def write_obj(path, vertices, triangles):
    """A mesh file by hand."""
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in np.asarray(triangles) + 1]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def block(size):
    """Vertices and triangles of a box about the origin, facing outward."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return corners, np.array([[q[0], *pair] for q in quads for pair in (q[1:3], q[2:4])], dtype=np.int32)


def lumpy():
    """A closed mesh without symmetry: an octahedron, divided three times, with bumps."""
    vertices = [np.eye(3)[axis] * side for axis in range(3) for side in (1.0, -1.0)]
    triangles = [(a, b, c) for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    triangles = [t if np.linalg.det([vertices[k] for k in t]) > 0 else t[::-1] for t in triangles]
    for _ in range(3):
        middles, finer = {}, []
        for a, b, c in triangles:
            ends = []
            for pair in ((a, b), (b, c), (c, a)):
                key = tuple(sorted(pair))
                if key not in middles:
                    middles[key] = len(vertices)
                    vertices.append((vertices[pair[0]] + vertices[pair[1]]) / 2.0)
                ends.append(middles[key])
            ab, bc, ca = ends
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        triangles = finer
    points = np.array(vertices)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= (1.0 + 0.2 * np.sin(5.0 * points[:, :1]) * np.cos(4.0 * points[:, 1:2] + 1.0)) * [1.0, 0.8, 0.6]
    return points, np.array(triangles, dtype=np.int32)


def solid_angle(points, vertices, triangles):
    """Generalised winding number of a mesh around points (van Oosterom and Strackee 1983)."""
    a, b, c = (vertices[triangles[:, k]][None] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(arm, axis=-1) for arm in (a, b, c))
    over = (a * np.cross(b, c)).sum(-1)
    under = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return np.arctan2(over, under).sum(axis=1) / (2.0 * np.pi)


def shots(positions, velocities, colliders, radius=0.0, **more):
    """Particles of 1 kg that know nothing of each other."""
    points = np.asarray(positions, dtype=float)
    shape = {"kind": "custom", "points": points.tolist(), "velocities": np.asarray(velocities, dtype=float).tolist()}
    more.setdefault("solver", {"dt": 1e-3})
    body = {"name": "shots", "shape": shape, "radius": radius}
    return make_scene(dimension=points.shape[1], bodies=[body], contact={"enabled": False}, colliders=colliders, **more)


# -- distances ----------------------------------------------------------------------------------------


def test_distances_in_the_plane_match_brute_force(simulate):
    capsule = {"kind": "capsule", "from": [-0.5, 0.1], "to": [0.7, 0.4], "radius": 0.3, "rotation": 40.0}
    colliders = [{"kind": "polygon", **polygon} for polygon in POLYGONS.values()] + [capsule]
    simulation = simulate(shots([[9.0, 9.0]], [[0.0, 0.0]], colliders, solver={"dt": 1e-3, "precision": "f64"}))
    points = np.random.default_rng(0).uniform(-1.6, 1.6, size=(2000, 2))
    for index, polygon in enumerate(POLYGONS.values()):
        turn = rotation_matrix(polygon.get("rotation", 0.0), 2)
        outlines = [
            np.asarray(outline) @ turn.T + polygon.get("position", 0.0)
            for outline in (polygon["points"], *polygon.get("holes", ()))
        ]
        starts, ends = np.concatenate(outlines), np.concatenate([np.roll(o, -1, axis=0) for o in outlines])
        inside = sum(abs(turns_around(points, outline)) for outline in outlines) % 2 == 1
        expected = from_segments(points, starts, ends) * np.where(inside, -1.0, 1.0)
        assert signed_distances(simulation, 0, points, member=index) == pytest.approx(expected, abs=1e-12)
    axis = np.array([capsule["from"], capsule["to"]]) @ rotation_matrix(40.0, 2).T
    expected = from_segments(points, axis[:1], axis[1:]) - 0.3
    assert signed_distances(simulation, 1, points) == pytest.approx(expected, abs=1e-12)


def test_outlines_have_the_solid_on_the_left_however_they_are_given():
    for outline in (SQUARE, SQUARE[::-1]):
        collider = PolygonCollider(kind="polygon", points=outline, holes=[HOLE])
        starts, ends = outline_edges(collider.points, collider.holes)
        middle, along = (starts + ends) / 2.0, ends - starts
        left = middle + 1e-3 * np.stack([-along[:, 1], along[:, 0]], axis=1)
        inside = (abs(turns_around(left, SQUARE)) + abs(turns_around(left, HOLE))) % 2
        assert inside.all()


def test_distances_in_space_match_brute_force(simulate, tmp_path):
    cube = write_obj(tmp_path / "cube.obj", *block(np.array([2.0, 1.0, 1.0])))
    colliders = [
        {"kind": "mesh", "file": cube, "scale": 0.5, "resolution": 40},
        {"kind": "capsule", "from": [-0.5, 0.1, 0.2], "to": [0.7, 0.4, -0.3], "radius": 0.3},
        {"kind": "box", "size": [1.0, 0.5, 0.5]},
    ]
    for collider in colliders[::2]:
        collider |= {"position": [0.3, 0.0, 0.0], "rotation": [20.0, 30.0, 40.0]}
    simulation = simulate(shots([[9.0, 9.0, 9.0]], [[0.0] * 3], colliders))
    points = np.random.default_rng(0).uniform(-0.9, 0.9, size=(2000, 3))
    axis = np.array([colliders[1]["from"], colliders[1]["to"]])
    assert signed_distances(simulation, 1, points) == pytest.approx(
        from_segments(points, axis[:1], axis[1:]) - 0.3, abs=1e-6
    )
    exact = signed_distances(simulation, 2, points)
    assert signed_distances(simulation, 0, points) == pytest.approx(exact, abs=1e-6)


# -- nothing passes -------------------------------------------------------------------------------------

PLATE_2D = [[-0.5, -0.01], [0.5, -0.01], [0.5, 0.01], [-0.5, 0.01]]
TURNS = {2: 33.0, 3: (20.0, 30.0, 40.0)}


def wall(kind, tmp_path):
    """A wall 2 cm thick and 1 m wide, turned, with its normal along its own y, and its dimension."""
    turn = {"position": [0.1, 0.2], "rotation": TURNS[2]}
    if kind == "box":
        return {"kind": "box", "size": [1.0, 0.02], **turn}, 2
    if kind == "capsule":
        return {"kind": "capsule", "from": [-0.5, 0.0], "to": [0.5, 0.0], "radius": 0.01, **turn}, 2
    if kind == "polygon":
        return {"kind": "polygon", "points": PLATE_2D, **turn}, 2
    turn = {"position": [0.1, 0.2, 0.3], "rotation": list(TURNS[3])}
    if kind == "capsule 3d":
        return {"kind": "capsule", "from": [-0.5, 0, 0], "to": [0.5, 0, 0], "radius": 0.01, **turn}, 3
    if kind == "box 3d":
        return {"kind": "box", "size": [1.0, 0.02, 1.0], **turn}, 3
    file = write_obj(tmp_path / "plate.obj", *block(np.array([1.0, 0.02, 1.0])))
    return {"kind": "mesh", "file": file, **turn}, 3


@pytest.mark.parametrize("radius", [0.0, 0.005])
@pytest.mark.parametrize("kind", ["box", "capsule", "polygon", "capsule 3d", "box 3d", "mesh"])
def test_shots_from_all_directions_stay_on_their_side(simulate, tmp_path, kind, radius):
    solid, dimension = wall(kind, tmp_path)
    rng = np.random.default_rng(5)
    starts = rng.normal(size=(96, dimension))
    starts /= np.linalg.norm(starts, axis=1, keepdims=True)
    starts = starts[np.abs(starts[:, 1]) > 0.1]
    targets = rng.uniform(-0.3, 0.3, size=starts.shape)
    targets[:, 1:] = 0.0
    aim = (targets - 0.4 * starts) / np.linalg.norm(targets - 0.4 * starts, axis=1, keepdims=True)
    turn, place = rotation_matrix(TURNS[dimension], dimension), np.array(solid["position"])
    scene = shots((0.4 * starts) @ turn.T + place, (100.0 * aim) @ turn.T, [solid], radius=radius)
    simulation = simulate(scene)
    deepest = 0.0
    for _ in range(7):
        simulation.advance(1e-3)
        deepest = max(deepest, simulation.measure().max_penetration)
    local = (simulation.positions() - place) @ turn
    if kind == "capsule 3d":  # those that met it slide around it
        met = np.linalg.norm(simulation.velocities(), axis=1) < 99.9
        assert met.all()
    else:
        assert (np.sign(local[:, 1]) == np.sign(starts[:, 1])).all()
        assert np.abs(local[:, 1]).min() > 0.01 + radius - 1e-6
    assert deepest < 2e-6


def test_no_way_out_of_a_thin_cup(simulate):
    """100 m/s into the corners of a cup with walls of 2 cm: bottom, wall and bottom again within one step."""
    rng = np.random.default_rng(2)
    angles = rng.uniform(math.radians(200.0), math.radians(340.0), size=128)
    starts = np.stack([rng.uniform(-0.4, 0.4, 128), rng.uniform(0.1, 0.4, 128)], axis=1)
    aim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for restitution, dt in ((0.0, 5e-3), (0.9, 1e-3)):
        cup = {"kind": "polygon", "points": CUP, "restitution": restitution}
        simulation = simulate(shots(starts, 100.0 * aim, [cup], radius=0.005, solver={"dt": dt}))
        simulation.advance(5e-3)
        x = simulation.positions()
        over = x[:, 1] > 0.5  # what left did so by the top
        assert (np.abs(x[~over, 0]) < 0.475 + 1e-6).all()
        assert (x[:, 1] > 0.025 - 1e-6).all()
        assert simulation.measure().max_penetration < 2e-6


def test_a_hole_is_a_container_that_keeps_energy(simulate):
    rng = np.random.default_rng(3)
    angles = rng.uniform(0.0, 2.0 * np.pi, size=64)
    ring = np.array([[math.cos(a), math.sin(a)] for a in np.linspace(0.0, 2.0 * np.pi, 9)[:-1]])
    jar = {"kind": "polygon", "points": (1.02 * ring).tolist(), "holes": [ring.tolist()], "restitution": 1.0}
    velocities = 30.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    simulation = simulate(shots(rng.uniform(-0.5, 0.5, (64, 2)), velocities, [jar], radius=0.005))
    simulation.advance(1.0)
    speed = np.linalg.norm(simulation.velocities(), axis=1)
    assert speed == pytest.approx(np.full(64, 30.0), rel=1e-4)
    assert (np.linalg.norm(simulation.positions(), axis=1) < 1.0).all()
    assert simulation.measure().max_penetration < 2e-6


def inside_starts(kind, tmp_path):
    """A solid and its dimension; points of [-0.3, 0.3]^d are inside."""
    if kind == "half_space":
        return {"kind": kind, "point": [0.0, 0.4], "normal": [0.0, 1.0]}, 2
    if kind == "sphere":
        return {"kind": kind, "position": [0.0, 0.0], "radius": 0.5}, 2
    if kind == "box":
        return {"kind": kind, "position": [0.0, 0.0], "size": [1.0, 0.9], "rotation": 10.0}, 2
    if kind == "capsule":
        return {"kind": kind, "from": [-0.3, 0.0], "to": [0.3, 0.0], "radius": 0.45}, 2
    if kind == "polygon":
        return {"kind": kind, "points": [[-0.5, -0.5], [0.6, -0.5], [0.5, 0.6], [0.0, 0.45], [-0.5, 0.5]]}, 2
    file = write_obj(tmp_path / "inside.obj", *block(np.array([1.0, 0.9, 1.1])))
    return {"kind": "mesh", "file": file, "resolution": 24}, 3


@pytest.mark.parametrize("kind", ["half_space", "sphere", "box", "capsule", "polygon", "mesh"])
def test_starting_inside_comes_out_and_gains_nothing(simulate, tmp_path, kind):
    solid, dimension = inside_starts(kind, tmp_path)
    rng = np.random.default_rng(4)
    starts, velocities = rng.uniform(-0.3, 0.3, (64, dimension)), rng.normal(size=(64, dimension))
    starts[0] = 0.0
    solid |= {"friction": 0.3, "restitution": 0.5}
    simulation = simulate(shots(starts, velocities, [solid], radius=0.01, solver={"dt": 1e-4}))
    simulation.advance(3e-4)
    speed, before = (np.linalg.norm(v, axis=1) for v in (simulation.velocities(), velocities))
    assert (speed <= before * (1.0 + 1e-6)).all()
    assert simulation.measure().max_penetration < 1e-5
    # A few were already on their way out by the way that they were shown.
    assert (speed > 0.999 * before).any()


# -- rest and sliding -----------------------------------------------------------------------------------


def test_rest_on_polygons_is_rest(simulate):
    """Single precision, 200,000 steps: on a flat edge, in a notch, on a corner's flat; radius and point."""
    ground = [[-4, -1], [4, -1], [4, 0], [1, 0], [0, -0.5], [-1, 0], [-2, 0], [-3, 0], [-4, 0]]
    polygon = {"kind": "polygon", "points": [[float(a), float(b)] for a, b in ground], "friction": 0.5}
    starts = [[2.0, 0.02], [0.0, -0.3], [-1.5, 0.01], [-3.0, 0.01]]
    for radius in (0.0, 0.01):
        scene = shots(starts, np.zeros((4, 2)), [polygon], radius=radius, gravity=[0.0, -9.81], solver={"dt": 1e-4})
        simulation = simulate(scene)
        simulation.advance(1.0)
        rested = simulation.positions()
        simulation.advance(19.0)
        assert np.abs(simulation.positions() - rested).max() < 2e-6
        assert np.abs(simulation.velocities()).max() < 1e-3
        assert rested[[0, 2, 3], 1] == pytest.approx(np.full(3, radius), abs=2e-6)
        # The notch's sides fall 1 in 2: a ball in it touches both.
        assert rested[1] == pytest.approx([0.0, -0.5 + radius * math.sqrt(5.0) / 2.0], abs=5e-6)


def test_joints_of_a_straight_edge_are_not_felt(simulate):
    count = 50
    top = [[2.0 - 4.0 * k / count, 0.3] for k in range(count + 1)]
    floor = {"kind": "polygon", "points": [[-2.0, -0.3], [2.0, -0.3], *top]}
    for radius in (0.0, 0.005, 0.1):
        start = [[-1.5, 0.3 + radius]]
        simulation = simulate(
            shots(start, [[2.0, 0.0]], [floor], radius=radius, gravity=[0.0, -9.81], solver={"dt": 2e-4})
        )
        simulation.advance(1.5)
        assert simulation.velocities()[0, 0] == pytest.approx(2.0, rel=1e-6)
        assert simulation.positions()[0, 0] == pytest.approx(1.5, abs=5e-4)
        assert simulation.positions()[0, 1] == pytest.approx(0.3 + radius, abs=1e-6)


def test_rest_and_slide_on_a_mesh(simulate, tmp_path):
    """On a turned box from a file: friction holds below its angle, and slides as Coulomb says above it."""
    file = write_obj(tmp_path / "slope.obj", *block(np.array([4.0, 0.4, 1.0])))
    angle, gravity = 0.3, 9.81
    turn = rotation_matrix((0.0, 0.0, -math.degrees(angle)), 3)
    normal, down = turn @ [0.0, 1.0, 0.0], turn @ [1.0, 0.0, 0.0]
    for friction in (0.2, 0.4):
        slope = {"kind": "mesh", "file": file, "rotation": [0, 0, -math.degrees(angle)], "friction": friction}
        scene = shots([0.21 * normal], [[0.0] * 3], [slope], radius=0.01, gravity=[0, -gravity, 0])
        simulation = simulate(scene)
        simulation.advance(0.5)
        rate = gravity * (math.sin(angle) - friction * math.cos(angle)) if friction < math.tan(angle) else 0.0
        assert simulation.velocities()[0] @ down == pytest.approx(0.5 * rate, abs=1e-3)
        assert simulation.positions()[0] @ normal == pytest.approx(0.21, abs=1e-5)


def test_bounces_on_a_mesh_keep_their_height(simulate, tmp_path):
    file = write_obj(tmp_path / "ground.obj", *block(np.array([2.0, 0.4, 2.0])))
    ground = {"kind": "mesh", "file": file, "restitution": 0.8}
    solver = {"integrator": "velocity_verlet", "dt": 1e-4, "precision": "f64"}
    simulation = simulate(shots([[0.1, 1.2, 0.2]], [[0.0] * 3], [ground], gravity=[0, -9.81, 0], solver=solver))
    top = math.sqrt(2.0 / 9.81)
    simulation.advance(top + 0.8 * top)
    assert simulation.positions()[0] == pytest.approx([0.1, 0.2 + 0.64, 0.2], rel=2e-3)


# -- bad input --------------------------------------------------------------------------------------------


def test_an_open_mesh_is_no_solid(simulate, tmp_path):
    vertices, triangles = block(np.ones(3))
    file = write_obj(tmp_path / "open.obj", vertices, triangles[:-1])
    with pytest.raises(SceneError, match=r"colliders\[0\]\.file: .*open\.obj is not closed"):
        simulate(shots([[0.0] * 3], [[0.0] * 3], [{"kind": "mesh", "file": file}]))
