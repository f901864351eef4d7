"""Contact among particles: what lists and contacts cost, from a thousand particles to a million.

    python benchmarks/contact.py [--precision f32|f64] [--threads N] [--counts 1000,10000]

Dense packings: close-packed balls (3D) and discs (2D), jittered, so that each touches about 7 or 4 others.
"build" makes the grid and the lists, "contact" finds the pairs that touch and exchanges impulses. "moving" is
what a step costs in a cloud whose particles fly about at random, with lists made anew when they must be.
"CPU" is the time of all threads together for build and contact: it tells even on a busy machine.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.contact.particle_contact import ContactSetup, ParticleContact
from sandbox.state import ParticleState

COUNTS = (1_000, 10_000, 100_000, 1_000_000)
SKIN = 0.1
"""Skin of the lists, in diameters."""
DIAMETER = {2: 1.05, 3: 1.02}
"""In distances of neighbours in the packing before it is jittered."""
JITTER = 0.06
DT = 1e-3
SPEED = 2.0
"""Of the moving cloud: diameters a second along each axis."""


def packing(count: int, dimension: int, rng: np.random.Generator) -> np.ndarray:
    """The first ``count`` places of a close packing of neighbour distance 1, jittered."""
    if dimension == 3:
        side = int(np.ceil((count / 4) ** (1 / 3)))
        corner = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
        cell = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
        points = (corner + cell).reshape(-1, 3)[:count] * np.sqrt(2.0)
    else:
        side = int(np.ceil(count**0.5))
        column, row = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
        points = np.stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)], -1).reshape(-1, 2)[:count]
    return np.asarray(points + rng.uniform(-JITTER, JITTER, points.shape))


@ti.data_oriented
class Cloud:
    """Particles that drift and touch; all of one body, of radius so that a diameter is DIAMETER."""

    def __init__(self, count: int, dimension: int, shuffled: bool) -> None:
        rng = np.random.default_rng(1)
        points = packing(count, dimension, rng)
        if shuffled:
            points = points[rng.permutation(count)]
        self.diameter = DIAMETER[dimension]
        one = np.zeros(count, dtype=np.int32)
        setup = ContactSetup(
            radii=np.full(count, 0.5 * self.diameter),
            body=one,
            family=one,
            self_contact=np.array([True]),
            rest_positions=10.0 * points,
            restitution=np.zeros((1, 1)),
            friction=np.zeros((1, 1)),
            skin=SKIN * self.diameter,
            capacity=20 if dimension == 3 else 12,
        )
        ones = np.ones(count)
        particles: Any = SimpleNamespace(particle_count=count, dimension=dimension, masses=ones, inverse_masses=ones)
        builder = runtime.fields_builder()
        self.state = ParticleState(builder, particles, False)
        self.contact = ParticleContact(builder, setup, self.state)
        self.tree = builder.finalize()
        particles.positions, particles.velocities = points, rng.normal(size=points.shape) * SPEED * self.diameter
        self.start = particles
        self.state.load(particles)
        self.contact.load(setup)

    @ti.kernel
    def drift(self, dt: float):
        for i in range(self.state.count):
            x = self.state.x[0, i] + dt * self.state.v[0, i]
            self.contact.watch(i, x)
            self.state.x[1, i] = x
            self.state.v[1, i] = self.state.v[0, i]

    def move(self, steps: int) -> int:
        """Steps of the moving cloud; how often the lists were made."""
        made = 0
        for _ in range(steps):
            self.drift(DT)
            made += int(self.contact.neighbours.moved[0])
            self.contact.resolve(1, 0, DT)
        assert not self.contact.overflowed()
        return made


def seconds(run: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Median of the wall clock, least of all threads' time."""
    run()
    wall, cpu = [], []
    for _ in range(rounds):
        started, begun = time.perf_counter(), time.process_time()
        run()
        ti.sync()
        wall.append(time.perf_counter() - started)
        cpu.append(time.process_time() - begun)
    return statistics.median(wall), min(cpu)


def measure(count: int, dimension: int, shuffled: bool) -> str:
    """One line of the table."""
    cloud = Cloud(count, dimension, shuffled)
    rounds = max(7, min(60, 2_000_000 // count))
    cloud.drift(DT)
    build, build_cpu = seconds(lambda: cloud.contact._build(1), rounds)
    contact, contact_cpu = seconds(lambda: cloud.contact._exchange_all(1, 0, DT), rounds)
    near = cloud.contact.neighbours
    x = near.x.to_numpy()
    listed, row = near.listed.to_numpy(), near.near.to_numpy().reshape(count, -1)[:2000]
    ends = np.repeat(np.arange(len(row)), listed[: len(row)])
    others = row[np.arange(row.shape[1]) < listed[: len(row), None]]
    touching = (np.linalg.norm(x[ends] - x[others], axis=1) < cloud.diameter).sum() / len(row)
    cloud.state.write(cloud.start.positions, cloud.start.velocities)
    steps = 5 * rounds
    cloud.move(5)
    started = time.perf_counter()
    made = cloud.move(steps)
    ti.sync()
    moving = (time.perf_counter() - started) / steps
    cloud.tree.destroy()
    both = build + contact
    return (
        f"{dimension}D {'shuffled' if shuffled else 'in order':9}{count:>9,}{touching:>9.1f}{listed.mean():>8.1f}"
        f"{1e3 * build:>9.2f}{1e3 * contact:>9.2f}{1e3 * both:>9.2f}{1e9 * both / count:>7.0f}"
        f"{1e3 * (build_cpu + contact_cpu):>9.2f}{1e3 * moving:>9.2f}{steps / max(made, 1):>8.1f}"
    )


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser()
    options.add_argument("--precision", default="f32")
    options.add_argument("--threads", type=int)
    options.add_argument("--counts", default=",".join(map(str, COUNTS)))
    chosen = options.parse_args()
    runtime.start(precision=chosen.precision, threads=chosen.threads)
    print(f"{'':12}{'count':>9}{'touching':>9}{'listed':>8}{'build':>9}{'contact':>9}{'both':>9}{'each':>7}{'CPU':>9}"
          f"{'moving':>9}{'steps a':>8}")  # fmt: skip
    print(
        f"{'':12}{'':>9}{'each':>9}{'each':>8}{'ms':>9}{'ms':>9}{'ms':>9}{'ns':>7}{'ms':>9}{'ms/step':>9}{'build':>8}"
    )
    for dimension in (3, 2):
        for shuffled in (False, True):
            for count in map(int, chosen.counts.split(",")):
                print(measure(count, dimension, shuffled), flush=True)


if __name__ == "__main__":
    main()
