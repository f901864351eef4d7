"""The grid against all pairs: everyone near is in the runs around a particle, and nothing depends on threads."""

import numpy as np
import pytest
import taichi as ti

from sandbox import runtime
from sandbox.contact.spatial_hash import _RUN, LANES, SpatialHash
from sandbox.state import place

REACH = 0.1


@ti.data_oriented
class Cloud:
    """Points in a grid, and a kernel that walks the runs around each."""

    def __init__(self, points: np.ndarray, radii: np.ndarray) -> None:
        self.count, self.dimension = points.shape
        self.all_sized = bool((radii > 0.0).all())
        builder = runtime.fields_builder()
        self.hash = SpatialHash(builder, self.count, self.dimension, REACH)
        self.x = place(builder, runtime.vector(self.dimension).field(), 1, self.count)
        self.radius = place(builder, ti.field(runtime.real()), self.count)
        self.tree = builder.finalize()
        self._write(points, radii)

    @ti.kernel
    def _write(self, points: ti.types.ndarray(), radii: ti.types.ndarray()):
        for i in range(self.count):
            self.radius[i] = radii[i]
            for axis in ti.static(range(self.dimension)):
                self.x[0, i][axis] = points[i, axis]

    @ti.kernel
    def build(self):
        self.hash.build(self.x, 0, self.radius, self.all_sized)

    @ti.kernel
    def build_serially(self):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.hash.build(self.x, 0, self.radius, self.all_sized)

    @ti.kernel
    def walk(self, near: ti.types.ndarray()):
        for i in range(self.count):
            if self.hash.bucket[i] >= 0:
                lowest, weight = self.hash.surroundings(self.x[0, i])
                for column in range(self.hash.columns):
                    first, end = self.hash.run(lowest, weight, column)
                    for other in range(first, end):
                        apart = -self.x[0, i]
                        for axis in ti.static(range(self.dimension)):
                            apart[axis] += self.hash.x[axis][other // LANES][other % LANES]
                        if apart.norm() < REACH:
                            near[i, self.hash.member[other]] = 1

    def near(self) -> np.ndarray:
        """Who is met within reach of whom, shape (count, count)."""
        near = np.zeros((self.count, self.count), dtype=np.int32)
        self.walk(near)
        return near.astype(bool)

    def table(self) -> list[np.ndarray]:
        held = int(self.hash.begin.to_numpy()[self.hash.size])
        return [self.hash.begin.to_numpy()[: self.hash.size], self.hash.member.to_numpy()[:held]]


def expected(points: np.ndarray, radii: np.ndarray) -> np.ndarray:
    sized = radii > 0.0
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    return (distance < REACH) & sized[:, None] & sized[None]


@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("spread", [0.4, 3.0, 1000.0], ids=["crowded", "boxed", "scattered"])
def test_meets_everyone_within_reach(dimension, spread, precision):
    """Negative coordinates too; where the box is too large for the table, clusters of ten still meet."""
    runtime.start(precision=precision)
    rng = np.random.default_rng(3)
    centres = rng.uniform(-spread, spread, (40, dimension))
    points = (centres[:, None] + rng.uniform(-0.1, 0.1, (40, 10, dimension))).reshape(-1, dimension)
    points = points.astype(precision.replace("f", "float")).astype(float)
    radii = np.where(rng.random(len(points)) < 0.1, 0.0, 0.05)
    cloud = Cloud(points, radii)
    cloud.build()
    wanted = expected(points, radii)
    # Rounding may take pairs at just the reach either way.
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    clear = abs(distance - REACH) > (1e-4 if precision == "f32" else 1e-9)
    assert (cloud.near() == wanted)[clear].all()


def test_buckets_hold_every_particle_once_and_in_order():
    runtime.start(precision="f64")
    points = np.random.default_rng(4).uniform(-0.5, 0.5, (500, 3))
    cloud = Cloud(points, np.full(500, 0.05))
    cloud.build()
    begin, member = cloud.table()
    assert sorted(member) == list(range(500))
    for first, end in zip(begin, [*begin[1:], 500], strict=True):
        assert (np.diff(member[first:end]) > 0).all()
    again = cloud.hash.begin.to_numpy()[cloud.hash.size :]
    assert (again == 500 + begin[:_RUN]).all()


def test_the_table_does_not_depend_on_threads():
    points = np.random.default_rng(5).uniform(-1.0, 1.0, (5000, 3))
    tables = []
    for threads in (1, 2, 4):
        runtime.start(precision="f32", threads=threads)
        cloud = Cloud(points, np.full(5000, 0.05))
        cloud.build()
        tables.append(cloud.table())
        cloud.build_serially()
        tables.append(cloud.table())
    for table in tables[1:]:
        assert all((a == b).all() for a, b in zip(table, tables[0], strict=True))


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_particles_at_no_place_stay_out(precision):
    runtime.start(precision=precision)
    points = np.random.default_rng(6).uniform(0.0, 0.3, (60, 2))
    points[7], points[8, 1], points[9, 0] = np.nan, np.inf, -1e30
    cloud = Cloud(points, np.full(60, 0.05))
    cloud.build()
    _, member = cloud.table()
    assert sorted(member) == [i for i in range(60) if i not in (7, 8, 9)]
