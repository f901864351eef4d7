"""Contact among particles: closed forms, conservation in heaps, and a twin that tries all pairs."""

import itertools
from typing import Any

import numpy as np
import pytest
import taichi as ti

from sandbox import runtime
from sandbox.contact.particle_contact import ContactSetup, ParticleContact
from sandbox.ledger import ACROSS, ALONG, Ledger
from sandbox.scene.assemble import assemble
from sandbox.state import ParticleState
from tests.conftest import make_scene

RADIUS = 0.05
GRAVITY = 9.81


@ti.data_oriented
class World:
    """Free particles that drift, fall on a floor at height 0 if there is gravity, and touch each other.

    ``bodies`` gives the body of every particle; all arrays are in the order of the caller.
    """

    def __init__(self, points: np.ndarray, velocities: np.ndarray, masses: Any = 1.0, **options: Any) -> None:
        count, self.dimension = points.shape
        body = np.asarray(options.pop("bodies", np.zeros(count, dtype=int)))
        pinned = np.asarray(options.pop("pinned", np.zeros(count, dtype=bool)))
        masses = np.broadcast_to(masses, (count,))
        shapes = []
        for index in range(body.max() + 1):
            mine = body == index
            shape = {"kind": "custom", "points": points[mine].tolist(), "masses": masses[mine].tolist()}
            shape |= {"velocities": velocities[mine].tolist(), "pinned": np.flatnonzero(pinned[mine]).tolist()}
            shapes.append({"name": f"body{index}", "shape": shape})
        assembly = assemble(make_scene(dimension=self.dimension, bodies=shapes))
        self.order = np.argsort(body, kind="stable")[assembly.order]
        self.back = np.argsort(self.order)
        self.masses, self.inverse = assembly.masses[self.back], assembly.inverse_masses[self.back]
        self.gravity = options.get("gravity", 0.0)
        setup = self._setup(points, body, **options)
        builder = runtime.fields_builder()
        self.state = ParticleState(builder, assembly, options.get("predicts", False))
        self.ledger = Ledger(builder, count, self.dimension) if options.get("booked", False) else None
        self.contact = ParticleContact(builder, setup, self.state, self.ledger)
        self.tree = builder.finalize()
        self.start = assembly.positions, assembly.velocities
        self.state.load(assembly)
        self.contact.load(setup)

    def restart(self) -> "World":
        """Back to the start, with everything compiled."""
        self.state.write(*self.start)
        self.contact.invalidate()
        return self

    def _setup(self, points: np.ndarray, body: np.ndarray, **options: Any) -> ContactSetup:
        count, bodies = len(points), int(body.max()) + 1
        radii = np.broadcast_to(options.get("radii", RADIUS), (count,))
        apart = np.arange(count)[:, None] * np.full(self.dimension, 10.0)
        table = np.ones((bodies, bodies))
        return ContactSetup(
            radii=radii[self.order],
            body=body[self.order],
            family=np.asarray(options.get("families", body))[self.order],
            self_contact=np.broadcast_to(options.get("self_contact", True), (bodies,)),
            rest_positions=np.asarray(options.get("rest", apart))[self.order],
            restitution=options.get("restitution", 0.0) * table,
            friction=options.get("friction", 0.0) * table,
            skin=options.get("skin", 0.2 * RADIUS),
            capacity=options.get("capacity", 60),
            gravity=self.gravity,
        )

    @ti.func
    def move(self, i, dt):
        v = self.state.v[0, i]
        if self.state.inverse_mass[i] > 0.0:
            v[self.dimension - 1] -= dt * self.gravity
        x = self.state.x[0, i] + dt * v
        if ti.static(self.gravity > 0.0):
            if x[self.dimension - 1] < 0.0:
                x[self.dimension - 1] = 0.0
                v[self.dimension - 1] = ti.max(v[self.dimension - 1], 0.0)
        self.contact.watch(i, x)
        self.state.x[1, i] = x
        self.state.v[1, i] = v
        if ti.static(self.state.predicts_velocity):
            self.state.force_velocity[1, i] = v

    @ti.kernel
    def _move(self, dt: float):
        for i in range(self.state.count):
            self.move(i, dt)

    @ti.kernel
    def _run_serial(self, steps: int, dt: float):
        ti.loop_config(serialize=True)
        for _ in range(steps):
            for i in range(self.state.count):
                self.move(i, dt)
            self.contact.resolve_serial(1, 0, dt)

    @ti.kernel
    def _resolve_all_pairs(self, dt: float):
        for i in range(self.state.count):
            met = 0
            for j in range(self.state.count):
                if self.meets(i, j, dt):
                    self.contact.partner[i * self.contact.stride + met] = j
                    met += 1
            self.contact.note(i, met)
        for i in range(self.state.count):
            self.contact.respond(i, 1, 0, dt)

    @ti.func
    def meets(self, i, j, dt):
        near = self.contact.neighbours
        sized = True
        if ti.static(not near.all_sized):
            sized = near.radius[i] > 0.0 and near.radius[j] > 0.0
        return sized and i != j and near.candidates(i, j) and self.contact.takes_part(i, j, 1, dt)

    def step(self, steps: int, dt: float, how: str = "serial") -> "World":
        """Take steps: in one launch ("serial"), one by one ("parallel"), with all pairs ("twin") or fresh lists."""
        if how == "serial":
            self._run_serial(steps, dt)
        for _ in range(steps if how != "serial" else 0):
            self._move(dt)
            if how == "twin":
                self._resolve_all_pairs(dt)
            else:
                if how == "rebuilt":
                    self.contact.invalidate()
                self.contact.resolve(1, 0, dt)
        assert not self.contact.overflowed()
        return self

    @property
    def x(self) -> np.ndarray:
        return self.state.read()[0][self.back]

    @property
    def v(self) -> np.ndarray:
        return self.state.read()[1][self.back]

    def momentum(self) -> np.ndarray:
        return self.masses @ self.v

    def angular_momentum(self) -> np.ndarray:
        x, v = (np.pad(values, ((0, 0), (0, 3 - self.dimension))) for values in (self.x, self.v))
        return self.masses @ np.cross(x, v)

    def kinetic(self) -> float:
        return float(0.5 * self.masses @ (self.v**2).sum(axis=1))


def random_cloud(dimension: int, count: int, filling: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Overlapping particles anywhere in a cube, that fill ``filling`` of it, with random velocities of 1 m/s."""
    rng = np.random.default_rng(seed)
    volume = {2: np.pi * RADIUS**2, 3: 4.0 / 3.0 * np.pi * RADIUS**3}[dimension]
    points = (rng.random((count, dimension)) - 0.5) * (count * volume / filling) ** (1.0 / dimension)
    return points, rng.normal(size=points.shape)


def lattice(dimension: int, side: int, seed: int = 0) -> np.ndarray:
    """Points of a square lattice about the origin that do not quite touch, jittered."""
    rng = np.random.default_rng(seed)
    cells = np.array(list(itertools.product(range(side), repeat=dimension)), dtype=float)
    return (cells - cells.mean(axis=0)) * 2.2 * RADIUS + rng.uniform(-0.09, 0.09, cells.shape) * RADIUS


SCENES: dict[str, dict[str, Any]] = {
    "plain": {},
    "bouncy": {"restitution": 1.0},
    "rough": {"friction": 0.4, "restitution": 0.3},
    "radii": {"radii": "mixed", "friction": 0.2},
    "bodies": {"bodies": "three", "self_contact": [True, False, True], "restitution": "table", "friction": "table"},
    "family": {"bodies": "three", "families": "two", "rest": "here"},
    "pinned": {"pinned": "some", "masses": "mixed"},
    "predicting": {"predicts": True, "booked": True, "friction": 0.1},
}


def build(name: str, dimension: int, count: int = 160) -> World:
    """A dense cloud under the options that ``name`` stands for."""
    rng = np.random.default_rng(8)
    points, velocities = random_cloud(dimension, count, 0.5)
    three = rng.integers(0, 3, count)
    table = rng.random((3, 3)) / 2
    values = {
        "mixed": rng.uniform(0.5, 1.0, count) * RADIUS,
        "three": three,
        "two": three % 2,
        "here": points,
        "some": rng.random(count) < 0.2,
        "table": table + table.T,
    }
    values["mixed"][::9] = 0.0
    options = {key: values[value] if isinstance(value, str) else value for key, value in SCENES[name].items()}
    if "masses" in options:
        options["masses"] = 10.0 ** rng.uniform(-2.0, 2.0, count)
    if "pinned" in options:
        velocities[options["pinned"]] = 0.0
    return World(points, velocities, **options)


# -- against all pairs ------------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("name", "precision"), [*((name, "f64") for name in SCENES), ("plain", "f32"), ("rough", "f32")]
)
def test_lists_meet_what_all_pairs_meet(name, precision, dimension):
    """Bit for bit, over many steps in which the cloud flies apart and lists are made anew now and then."""
    runtime.start(precision=precision)
    world = build(name, dimension)
    start = np.array(world.state.read())
    twin = np.array(world.step(100, 2e-3, "twin").state.read())
    assert not np.allclose(twin[1], start[1])
    for how in ("serial", "parallel", "rebuilt"):
        assert np.array_equal(world.restart().step(100, 2e-3, how).state.read(), twin), how


def test_the_skin_changes_nothing():
    runtime.start(precision="f32")
    points, velocities = random_cloud(3, 2000, 0.5)
    ends = [World(points, velocities, skin=skin).step(30, 1e-3, "parallel") for skin in (0.0, 0.1 * RADIUS, RADIUS)]
    assert all(np.array_equal(ends[0].x, end.x) and np.array_equal(ends[0].v, end.v) for end in ends[1:])


def test_threads_change_nothing():
    points, velocities = random_cloud(3, 2000, 0.5)
    ends = []
    for threads in (1, 2, 3):
        runtime.start(precision="f32", threads=threads)
        world = World(points, velocities, friction=0.3).step(30, 1e-3, "parallel")
        ends.append((world.x, world.v))
    assert all(np.array_equal(ends[0], end) for end in ends[1:])


def test_a_list_too_short_is_told():
    runtime.start(precision="f64")
    points, velocities = random_cloud(2, 100, 0.9)
    world = World(points, velocities, capacity=2)
    world._run_serial(1, 1e-3)
    assert world.contact.overflowed()


# -- closed forms -------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [1.0, 0.5, 0.0])
def test_head_on(restitution):
    """m1 v1 + m2 v2 kept, speed of parting e times that of approach."""
    runtime.start(precision="f64")
    world = World(np.array([[-1.0, 0.0], [1.0, 0.0]]), np.array([[3.0, 0.0], [-1.0, 0.0]]), masses=[1.0, 3.0],
                  restitution=restitution).step(300, 3.1e-3)  # fmt: skip
    assert world.v[:, 0] == pytest.approx([-3.0 * restitution, restitution], abs=1e-13)
    # The instant of touching lies within a step, and is met exactly: (2 - 2 r) / 4 s.
    touched = (2.0 - 2.0 * RADIUS) / 4.0
    after = 300 * 3.1e-3 - touched
    assert world.x[1, 0] - world.x[0, 0] == pytest.approx(2.0 * RADIUS + 4.0 * restitution * after, abs=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_oblique_deflection(dimension):
    """Equal discs, e = 1, impact parameter b: the relative velocity turns by pi - 2 asin(b / 2R)."""
    runtime.start(precision="f64")
    offset = np.array([0.05, 0.3, 0.6, 0.95])
    points, velocities = np.zeros((4, 2, dimension)), np.zeros((4, 2, dimension))
    points[:, :, 1] = 20.0 * RADIUS * np.arange(4)[:, None]
    points[:, 0, 0] = -1.0
    points[:, 0, -1] += offset * 2.0 * RADIUS
    velocities[:, 0, 0], velocities[:, 1, 0] = 1.0, -1.0
    world = World(points.reshape(8, -1), velocities.reshape(8, -1), restitution=1.0)
    spin = world.angular_momentum()
    world.step(300, 3.1e-3)
    v = world.v.reshape(4, 2, -1)
    turned = v[:, 0] - v[:, 1]
    angle = np.arccos(turned[:, 0] / np.linalg.norm(turned, axis=1))
    assert angle == pytest.approx(np.pi - 2.0 * np.arcsin(offset), abs=1e-12)
    assert world.kinetic() == pytest.approx(4.0, abs=1e-13)
    assert world.angular_momentum() == pytest.approx(spin, abs=1e-13)


@pytest.mark.parametrize("way", [0.3, 0.9, 1.7])
def test_fast_pairs_bounce_the_right_way(way):
    """Up to 2 (r_i + r_j) of way a step, wherever in it they touch."""
    runtime.start(precision="f64")
    dt = 1e-3
    starts = np.linspace(1.01, 1.0 + way, 20)
    points, velocities = np.zeros((20, 2, 2)), np.zeros((20, 2, 2))
    points[:, :, 1] = 10.0 * RADIUS * np.arange(20)[:, None]
    points[:, 1, 0] = 2.0 * RADIUS * starts
    velocities[:, 0, 0] = way * 2.0 * RADIUS / dt
    world = World(points.reshape(-1, 2), velocities.reshape(-1, 2), restitution=1.0).step(5, dt)
    assert world.v == pytest.approx(velocities[:, ::-1].reshape(-1, 2), rel=1e-12)


def test_friction_stops_sliding_but_no_more():
    """Oblique, e = 0: the tangential impulse is mu times the normal one, or what stops the sliding."""
    runtime.start(precision="f64")
    gap = 0.1 * RADIUS
    for friction, slide, stopped in ((0.25, 1.0, 0.125), (10.0, 0.1, 0.05)):
        # They touch after gap / (1 m/s), and lie side by side then.
        points = np.array([[0.0, -slide * gap], [2.0 * RADIUS + gap, 0.0]])
        start = np.array([[1.0, slide], [0.0, 0.0]])
        end = World(points, start, friction=friction).step(8, 1e-3).v
        assert end[1] == pytest.approx([0.5, stopped], abs=1e-12)
        assert end.sum(axis=0) == pytest.approx(start.sum(axis=0), abs=1e-14)


def test_pinned_particles_are_met_and_stay():
    runtime.start(precision="f64")
    points, velocities = np.array([[0.0, 0.0], [0.3, 0.0], [0.35, 0.0]]), np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    world = World(points, velocities, pinned=[False, True, True], restitution=1.0).step(500, 1e-3)
    assert world.v[:, 0] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-13)
    assert np.array_equal(world.x[1:], points[1:])


def test_the_same_place_is_left_alone():
    runtime.start(precision="f64")
    world = World(np.zeros((2, 2)), np.ones((2, 2))).step(1, 1e-3)
    assert np.array_equal(world.v, np.ones((2, 2)))


# -- conservation -------------------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_momenta_are_kept_in_dense_clusters(dimension, restitution):
    runtime.start(precision="f64")
    points, velocities = random_cloud(dimension, 300, 0.9)
    world = World(points, velocities, masses=np.linspace(0.5, 2.0, 300), restitution=restitution)
    momentum, spin = world.momentum(), world.angular_momentum()
    for _ in range(5):
        world.step(20, 1e-3)
        assert world.momentum() == pytest.approx(momentum, abs=1e-11)
        assert world.angular_momentum() == pytest.approx(spin, abs=1e-11)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("restitution", "friction"), [(0.0, 0.0), (1.0, 0.0), (0.5, 0.5)])
@pytest.mark.parametrize("masses", [1.0, "extreme"])
def test_colliding_particles_gain_no_energy(dimension, restitution, friction, masses):
    """A gas, and a cloud that falls in on itself; masses that differ a million times."""
    runtime.start(precision="f64")
    rng = np.random.default_rng(2)
    points = lattice(dimension, {2: 14, 3: 6}[dimension])
    weights = 10.0 ** rng.uniform(-3.0, 3.0, len(points)) if masses == "extreme" else masses
    for velocities in (rng.normal(size=points.shape), -3.0 * points + 0.05 * rng.normal(size=points.shape)):
        world = World(points, velocities, masses=weights, restitution=restitution, friction=friction)
        first = world.kinetic()
        energies = [world.step(25, 2e-4).kinetic() for _ in range(40)]
        assert max(energies) <= first * (1.0 + 1e-12)
        assert np.isfinite(world.x).all() and np.isfinite(world.v).all()


def test_the_ledger_gets_every_impulse():
    """For the step to book; but for pairs by themselves, whose work within the step only contact knows."""
    runtime.start(precision="f64")
    world = World(*random_cloud(3, 200, 0.9), friction=0.3, booked=True)
    change = -world.v + world.step(1, 1e-3).v
    impulses, work = world.ledger.impulses.to_numpy(), world.ledger.work.to_numpy()
    waiting = ~work.any(axis=0)[world.back]
    assert waiting.sum() > 150 and np.abs(change[waiting]).max() > 0.1
    assert impulses[[ALONG, ACROSS]].sum(axis=0)[world.back][waiting] == pytest.approx(change[waiting], abs=1e-13)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_stack_of_ten_comes_to_rest(restitution):
    """Discs on each other: still, and overlapping by what the load needs: 4 g dt^2 / PUSH a disc above."""
    runtime.start(precision="f64")
    dt = 1e-3
    points = np.zeros((10, 2))
    points[:, 1] = 2.02 * RADIUS * np.arange(10)
    world = World(points, np.zeros_like(points), restitution=restitution, gravity=GRAVITY)
    energy = GRAVITY * points[:, 1].sum()
    for _ in range(4):
        world.step(1000, dt)
        assert world.kinetic() + GRAVITY * world.x[:, 1].sum() < energy
    before = world.x
    world.step(100, dt)
    assert np.abs(world.x - before).max() < 1e-6 * RADIUS
    overlap = 2.0 * RADIUS - np.diff(world.x[:, 1])
    assert (overlap > 0.0).all() and overlap.max() < 0.015 * 2.0 * RADIUS and not world.x[:, 0].any()


def test_an_overlap_parts_to_rest():
    """Two particles that start within each other end side by side, not apart."""
    runtime.start(precision="f64")
    world = World(np.array([[0.0, 0.0], [1.6 * RADIUS, 0.0]]), np.zeros((2, 2))).step(400, 1e-3)
    assert np.diff(world.x[:, 0]) == pytest.approx(2.0 * RADIUS, rel=1e-3)
    assert np.abs(world.v).max() < 1e-6
