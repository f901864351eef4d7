"""Who may touch whom soon: a list of near particles for each, kept until something has moved far enough.

Lists hold all candidates closer than touching plus a skin (Verlet, Phys. Rev. 159, 98 (1967)). As long as
no particle has moved by more than half the skin, no pair that touches is missing from them. They are
in order of ids: who skips what does not touch, and what comes twice, never sees when they were made.
"""

from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sandbox import runtime
from sandbox.contact.spatial_hash import LANES, SpatialHash
from sandbox.state import ParticleState, place

_WATCHED = 0.499
"""Part of the skin that a particle may move; short of half by more than rounding."""
_SPAN = 64
"""Particles that one thread lists in turn, over the same scratch."""
_GROUPS = 2
"""Groups of places that are always looked at together."""
_TASK = 8
"""Spans that a thread takes at a time."""


@dataclass(frozen=True)
class ContactSetup:
    """What contact of N particles of B bodies in d dimensions needs to know, in internal order."""

    radii: NDArray[np.float64]
    """Contact radii [m], shape (N,); 0 takes no part."""
    body: NDArray[np.int32]
    """Body of every particle, shape (N,)."""
    family: NDArray[np.int32]
    """Bodies held together share a family, shape (N,)."""
    self_contact: NDArray[np.bool_]
    """Whether particles of a body meet each other, shape (B,)."""
    rest_positions: NDArray[np.float64]
    """Positions at rest [m], shape (N, d): pairs of a family that overlap there never meet."""
    restitution: NDArray[np.float64]
    """Restitution of a pair of bodies [1], symmetric, shape (B, B)."""
    friction: NDArray[np.float64]
    """Coulomb friction of a pair of bodies [1], symmetric, shape (B, B)."""
    skin: float
    """How much further than touching lists reach [m]; about a tenth of a diameter is good."""
    capacity: int
    """Most particles around one, within touching distance of the largest and the skin, that a list can hold."""
    gravity: float = 0.0
    """Magnitude of gravity [m/s^2]: what it adds in a step or two is no speed to bounce at."""

    def meeting_bodies(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs of bodies that may meet (rows and columns of the tables)."""
        bodies = np.unique(self.body[self.radii > 0.0])
        first, second = (grid.ravel() for grid in np.meshgrid(bodies, bodies, indexing="ij"))
        may = (first != second) | self.self_contact[first]
        return first[may], second[may]

    def close_at_rest(self) -> bool:
        """Whether some pair of a family, that may meet otherwise, overlaps at rest."""
        sized = np.flatnonzero(self.radii > 0.0)
        tree = cKDTree(self.rest_positions[sized])
        pairs = sized[tree.query_pairs(2.0 * float(self.radii.max()), output_type="ndarray")]
        i, j = pairs[:, 0], pairs[:, 1]
        distance = np.linalg.norm(self.rest_positions[i] - self.rest_positions[j], axis=1)
        may = (self.body[i] != self.body[j]) | self.self_contact[self.body[i]]
        near = distance < self.radii[i] + self.radii[j]
        return bool((may & near & (self.family[i] == self.family[j])).any())


@ti.data_oriented
class Neighbours:
    """Lists of candidates for contact, with what decides who is one.

    Attributes
    ----------
    listed : length of every particle's list, shape (N,)
    near : ids, ascending, from ``stride`` times the particle's on; one may come twice, shape (N * stride,)
    moved : 1 where lists are out of date, shape (1,)
    full : 1 where a list was too short, shape (1,)
    """

    def __init__(self, builder: ti.FieldsBuilder, setup: ContactSetup, state: ParticleState) -> None:
        self.state = state
        self.count = state.count
        self.most = setup.capacity + 1
        """How many may be found around a particle, itself among them."""
        self.stride = self.most
        # Groups are written behind what was found.
        self.scratch = self.most + (_GROUPS + 1) * LANES
        self.largest = float(setup.radii.max())
        self.reach = 2.0 * self.largest + setup.skin
        self.watched = (_WATCHED * setup.skin) ** 2
        self.all_sized = bool((setup.radii > 0.0).all())
        self.one_radius = bool((setup.radii[setup.radii > 0.0] == self.largest).all())
        self.closes = not bool(setup.self_contact[np.unique(setup.body)].all())
        self.rested = setup.close_at_rest()
        self.hash = SpatialHash(builder, self.count, state.dimension, self.reach)
        self.real, vector = runtime.real(), runtime.vector(state.dimension)
        self.lanes = ti.types.vector(LANES, self.real)
        spans = -(-self.count // _SPAN)
        self.hit = place(builder, ti.types.vector(LANES, ti.i32).field(), spans)
        self.found = place(builder, ti.field(ti.i32), spans * self.scratch)
        self.x = place(builder, vector.field(), self.count)
        self.listed = place(builder, ti.field(ti.i32), self.count)
        self.near = place(builder, ti.field(ti.i32), self.count * self.stride)
        self.moved = place(builder, ti.field(ti.i32), 1)
        self.full = place(builder, ti.field(ti.i32), 1)
        # Only what tells pairs apart in this scene.
        self.radius = place(builder, ti.field(self.real), 1 if self.one_radius and self.all_sized else self.count)
        self.closed = place(builder, ti.field(ti.i32), self.count if self.closes else 1)
        self.family = place(builder, ti.field(ti.i32), self.count if self.rested else 1)
        self.rest = place(builder, vector.field(), self.count if self.rested else 1)

    def load(self, setup: ContactSetup) -> None:
        """Upload radii, bodies and rest positions."""
        # Two particles meet unless they share this number: their body's, or one of their own.
        closed = np.where(setup.self_contact[setup.body], -1 - np.arange(self.count), setup.body).astype(np.int32)
        family = setup.family.astype(np.int32)
        self._write(setup.radii.astype(float), closed, family, np.ascontiguousarray(setup.rest_positions))

    @ti.kernel
    def _write(
        self,
        radius: ti.types.ndarray(),
        closed: ti.types.ndarray(),
        family: ti.types.ndarray(),
        rest: ti.types.ndarray(),
    ):
        self.moved[0] = 1
        self.full[0] = 0
        for i in range(self.count):
            if ti.static(not (self.one_radius and self.all_sized)):
                self.radius[i] = radius[i]
            if ti.static(self.closes):
                self.closed[i] = closed[i]
            if ti.static(self.rested):
                self.family[i] = family[i]
                for axis in ti.static(range(self.state.dimension)):
                    self.rest[i][axis] = rest[i, axis]

    @ti.func
    def touching(self, i, j):
        """Distance at which two candidates touch [m]."""
        distance = ti.cast(2.0 * self.largest, self.real)
        if ti.static(not self.one_radius):
            distance = self.radius[i] + self.radius[j]
        return distance

    @ti.func
    def candidates(self, i, j):
        """Whether two different particles, both with a radius, may ever meet."""
        may = True
        if ti.static(self.closes):
            may = self.closed[i] != self.closed[j]
        if ti.static(self.rested):
            if may and self.family[i] == self.family[j]:
                apart = self.rest[i] - self.rest[j]
                touching = self.touching(i, j)
                may = apart.dot(apart) >= touching * touching
        return may

    @ti.func
    def watch(self, i, x):
        """Note whether particle i, now at x, has left the place that its neighbours were listed for."""
        way = x - self.x[i]
        if way.dot(way) > self.watched:
            self.moved[0] = 1

    @ti.func
    def build(self, slot):
        """Make all lists anew for the positions in ``slot``."""
        self.hash.build(self.state.x, slot, self.radius, self.all_sized)
        for i in range(self.count):
            self.x[i] = self.state.x[slot, i]
            self.listed[i] = 0
        ti.loop_config(block_dim=_TASK)
        for span in range((self.hash.held() + _SPAN - 1) // _SPAN):
            for own in range(span * _SPAN, ti.min((span + 1) * _SPAN, self.hash.held())):
                self.list_near(span, own, slot)
        self.moved[0] = 0

    @ti.func
    def list_near(self, span, own, slot):
        """List the neighbours of the particle whose own place in the hash this is."""
        i = self.hash.member[own]
        x = self.state.x[slot, i]
        lowest, weight = self.hash.surroundings(x)
        found = 0
        for column in range(self.hash.columns):
            first, end = self.hash.run(lowest, weight, column)
            group = first // LANES
            if first < end and found <= self.most:
                # Two groups hold most runs: a loop that ends now after one and now after two is mispredicted.
                for ahead in ti.static(range(_GROUPS)):
                    found = self.compare(span, found, x, group + ahead, first, end)
                group += _GROUPS
            # A full list is useless: what is left to see in a heap of thousands would only take time.
            while group * LANES < end and found <= self.most:
                found = self.compare(span, found, x, group, first, end)
                group += 1
        if found > self.most:
            self.full[0] = 1
            found = self.most
        self.listed[i] = self.sift(i, span * self.scratch, found)

    @ti.func
    def compare(self, span, found, x, group, first, end):
        """Note the places of a group that are in a run and within reach of x; how many are noted by then.

        No branch: one that is taken one time in four costs more than all lanes. What is near is stored lane
        by lane, which the compiler packs from, and every lane is written where the next one found goes.
        """
        reach = ti.cast(self.reach, self.real)
        distance = self.lanes(0.0)
        for lane in ti.static(range(LANES)):
            for axis in ti.static(range(self.state.dimension)):
                apart = self.hash.x[axis][group][lane] - x[axis]
                distance[lane] += apart * apart
        for lane in ti.static(range(LANES)):
            other = group * LANES + lane
            self.hit[span][lane] = ti.cast((distance[lane] < reach * reach) & (other >= first) & (other < end), ti.i32)
        kept = found
        for lane in ti.static(range(LANES)):
            self.found[span * self.scratch + kept] = group * LANES + lane
            kept += self.hit[span][lane]
        return kept

    @ti.func
    def sift(self, i, first, found):
        """List those of the places found that may meet i by id, but for i itself; how many that are."""
        row = i * self.stride
        kept = 0
        for entry in range(first, first + found):
            j = self.hash.member[self.found[entry]]
            if (j != i) & self.candidates(i, j):
                below = row + kept - 1
                while below >= row and self.near[below] > j:
                    self.near[below + 1] = self.near[below]
                    below -= 1
                self.near[below + 1] = j
                kept += 1
        return kept
