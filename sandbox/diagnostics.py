"""What a state is worth knowing by: energies, momenta, largest strain, speed and penetration, finiteness.

One kernel measures everything that the scene has, in blocks of particles whose sums are added in
order on the host: the numbers do not depend on the number of threads. Where bodies have cells, another
one counts those that are inside out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.group_blocks import GroupBlocks
from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly
from sandbox.scene.cells import SolidCells
from sandbox.state import ParticleState, place

_BLOCK = 256
_BIG = 1e30


@dataclass(frozen=True)
class Energy:
    """Energies of a state [J]. A part that the scene does not have is 0."""

    kinetic: float
    elastic: float
    gravity: float
    gas: float = 0.0

    @property
    def total(self) -> float:
        """Sum of all parts [J]."""
        return self.kinetic + self.elastic + self.gravity + self.gas


@dataclass(frozen=True)
class Measurement:
    """One look at a state."""

    energy: Energy
    momentum: tuple[float, ...]
    """Linear momentum [kg m/s]."""
    angular_momentum: tuple[float, ...]
    """Angular momentum about the origin [kg m^2/s]; one number in 2D, three in 3D."""
    max_strain: float
    """Largest spring strain |r - L| / L [1]."""
    max_speed: float
    """Largest particle speed [m/s]."""
    max_penetration: float
    """Deepest that a free particle is inside a collider [m]; 0 if none is."""
    max_overlap: float
    """Largest part of their touching distance by which two particles in contact overlap [1]."""
    finite: bool
    """False if any coordinate or velocity is infinite or not a number."""
    torn: int = 0
    """Springs torn so far."""
    inverted: Mapping[int, int] = field(default_factory=dict)
    """Cells that are inside out by body, of those that have any: see :mod:`sandbox.scene.cells`."""
    work: Mapping[str, float] | None = None
    """Work done on the bodies since the start, by term of the ledger [J]; None without a ledger."""

    @property
    def inverted_cells(self) -> int:
        """Cells of all bodies that are inside out."""
        return sum(self.inverted.values())


@ti.data_oriented
class Diagnostics:
    """Measures a state with the laws and colliders that act on it, and the cells that its particles make."""

    def __init__(self, builder: ti.FieldsBuilder, state: ParticleState, parts: Parts, cells: SolidCells) -> None:
        self.state = state
        self.cells = [CellTurns(builder, state, cells, parts.tears)] if len(cells) else []
        self.laws = [law for law in parts.laws if hasattr(law, "energy_on")]
        self.strained = [law for law in parts.laws if hasattr(law, "strain_on")]
        self.colliders = parts.colliders
        self.contact = parts.contact
        self.tears = parts.tears
        self.ledger = parts.ledger
        laws = self.laws
        self.double = runtime.settings().precision == "f64"
        self.blocks = -(-state.count // _BLOCK)
        dimension = state.dimension
        self.spins = 1 if dimension == 2 else 3
        # kinetic, one a law, momentum, angular momentum; then the largest of strain, speed, depth; bad ones
        self.sums = 1 + len(laws) + dimension + self.spins
        self.width = self.sums + 4
        self.table = place(builder, ti.field(runtime.real()), self.blocks, self.width)

    def measure(self) -> Measurement:
        """Measure the state as it is now."""
        self._measure(self.state.slot)
        table = np.empty((self.blocks, self.width))
        self._read(table)
        sums = [float(value) for value in table[:, : self.sums].sum(axis=0)]
        strain, speed, depth, bad = (float(value) for value in table[:, self.sums :].max(axis=0))
        parts = {"elastic": 0.0, "gravity": 0.0, "gas": 0.0}
        for law, value in zip(self.laws, sums[1:], strict=False):
            parts[law.term] += value
        momenta = sums[1 + len(self.laws) :]
        return Measurement(
            energy=Energy(kinetic=sums[0], **parts),
            momentum=tuple(momenta[: self.state.dimension]),
            angular_momentum=tuple(momenta[self.state.dimension :]),
            max_strain=strain,
            max_speed=speed,
            max_penetration=max(0.0, depth),
            max_overlap=max((contact.deepest_overlap() for contact in self.contact), default=0.0),
            finite=bad == 0.0 and bool(np.isfinite(table).all()),
            torn=sum(tears.torn_count() for tears in self.tears),
            inverted=self.cells[0].inverted() if self.cells else {},
            work=self.ledger[0].totals() if self.ledger else None,
        )

    def load(self, assembly: Assembly) -> None:
        """Upload what does not change."""
        for cells in self.cells:
            cells.load()

    @ti.kernel
    def _measure(self, slot: int):
        ti.loop_config(serialize=self.state.serialize)
        for block in range(self.blocks):
            for column in range(self.width):
                self.table[block, column] = 0.0
            self.table[block, self.sums + 2] = -_BIG
            for i in range(block * _BLOCK, ti.min((block + 1) * _BLOCK, self.state.count)):
                self._add(block, i, slot)

    @ti.func
    def _add(self, block, i, slot):
        m = self.state.mass[i]
        x = self.state.x[slot, i]
        v = self.state.v[slot, i]
        speed2 = v.dot(v)
        self._sum(block, 0, 0.5 * m * speed2)
        for k in ti.static(range(len(self.laws))):
            self._sum(block, 1 + k, self.laws[k].energy_on(i, slot))
        first = ti.static(1 + len(self.laws))
        for axis in ti.static(range(self.state.dimension)):
            self._sum(block, first + axis, m * v[axis])
        turn = m * x.cross(v)
        if ti.static(self.spins == 1):
            self._sum(block, first + 2, turn)
        else:
            for axis in ti.static(range(3)):
                self._sum(block, first + 3 + axis, turn[axis])
        for law in ti.static(self.strained):
            self._largest(block, self.sums, law.strain_on(i, slot))
        self._largest(block, self.sums + 1, ti.sqrt(speed2))
        if ti.static(self.colliders):
            if self.state.inverse_mass[i] > 0.0:  # a held particle may be where it likes
                for collider in ti.static(self.colliders):
                    self._largest(block, self.sums + 2, collider.depth(i, x))
        for axis in ti.static(range(self.state.dimension)):
            if self._is_bad(x[axis]) or self._is_bad(v[axis]):
                self.table[block, self.sums + 3] = 1.0

    @ti.func
    def _sum(self, block, column, value):
        # Not `+=`, which Taichi would make an atomic; this block is this thread's own.
        self.table[block, column] = self.table[block, column] + value

    @ti.func
    def _largest(self, block, column, value):
        self.table[block, column] = ti.max(self.table[block, column], value)

    @ti.func
    def _is_bad(self, value) -> ti.i32:
        # By bits: with fast math the compiler takes it that no value is infinite or not a number.
        bad = False
        if ti.static(self.double):
            mask = ti.i64(0x7FF0000000000000)
            bad = (ti.bit_cast(value, ti.i64) & mask) == mask
        else:
            mask = ti.i32(0x7F800000)
            bad = (ti.bit_cast(value, ti.i32) & mask) == mask
        return bad

    @ti.kernel
    def _read(self, table: ti.types.ndarray()):
        ti.loop_config(serialize=self.state.serialize)
        for block in range(self.blocks):
            for column in range(self.width):
                table[block, column] = self.table[block, column]


@ti.data_oriented
class CellTurns:
    """Counts the cells of bodies that are inside out; those with a torn spring are no cells any more."""

    def __init__(
        self, builder: ti.FieldsBuilder, state: ParticleState, cells: SolidCells, tears: Sequence[Any]
    ) -> None:
        self.state = state
        self.cells = cells
        self.blocks = GroupBlocks.of(cells.body, int(cells.body[-1]) + 1)
        self.block_count = len(self.blocks.group)
        self.width = cells.corners.shape[1]
        self.tears = tears if cells.springs.shape[1] else []
        self.first = place(builder, ti.field(ti.i32), self.block_count + 1)
        self.corner = place(builder, ti.field(ti.i32), *cells.corners.shape)
        self.watched = place(builder, ti.field(ti.i32), len(cells))
        if self.tears:
            self.pairs = cells.springs.shape[1]
            self.spring = place(builder, ti.field(ti.i32), *cells.springs.shape)

    def load(self) -> None:
        """Upload the cells."""
        self._write(self.blocks.first, self.cells.corners, self.cells.watched, self.cells.springs)

    def inverted(self) -> dict[int, int]:
        """Inverted cells by body, of bodies that have any."""
        counts = np.empty(self.block_count, dtype=np.int32)
        self._count(self.state.slot, counts)
        bodies = np.bincount(self.blocks.group, counts).astype(int)
        return {int(body): int(bodies[body]) for body in np.flatnonzero(bodies)}

    @ti.kernel
    def _count(self, slot: int, counts: ti.types.ndarray()):
        ti.loop_config(serialize=self.state.serialize)
        for block in range(self.block_count):
            count = 0
            for c in range(self.first[block], self.first[block + 1]):
                count += self.is_inverted(c, slot)
            counts[block] = count

    @ti.func
    def is_inverted(self, c, slot) -> ti.i32:
        """1 where a corner of cell c turns the other way than at rest."""
        inverted = 0
        for k in range(self.width):
            x = self.state.x[slot, self.corner[c, k]]
            span = 0.0 * x[0]
            if ti.static(self.state.dimension == 2):
                span = self.edge(c, k, 2, x, slot).cross(self.edge(c, k, 1, x, slot))
            else:
                span = self.edge(c, k, 4, x, slot).cross(self.edge(c, k, 2, x, slot)).dot(self.edge(c, k, 1, x, slot))
            if span < 0.0 and (self.watched[c] >> k) & 1 == 1:
                inverted = 1
        if ti.static(self.tears):
            for p in range(self.pairs):
                if self.spring[c, p] >= 0:
                    if self.tears[0].torn[self.spring[c, p]] != 0:
                        inverted = 0
        return inverted

    @ti.func
    def edge(self, c, k, axis, x, slot):
        """From corner k of cell c, at x, along an axis of the cell, forward from both of its ends [m]."""
        along = self.state.x[slot, self.corner[c, k ^ axis]] - x
        return ti.select((k & axis) == 0, 1.0, -1.0) * along

    @ti.kernel
    def _write(
        self,
        first: ti.types.ndarray(),
        corner: ti.types.ndarray(),
        watched: ti.types.ndarray(),
        spring: ti.types.ndarray(),
    ):
        for b in range(first.shape[0]):
            self.first[b] = first[b]
        for c in range(watched.shape[0]):
            self.watched[c] = watched[c]
            for k in range(self.width):
                self.corner[c, k] = corner[c, k]
            if ti.static(self.tears):
                for p in range(self.pairs):
                    self.spring[c, p] = spring[c, p]
