"""What a state is worth knowing by: energies, momenta, largest strain, speed and penetration, finiteness.

One kernel measures everything that the scene has, in blocks of particles whose sums are added in
order on the host: the numbers do not depend on the number of threads.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.parts import Parts
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
    work: Mapping[str, float] | None = None
    """Work done on the bodies since the start, by term of the ledger [J]; None without a ledger."""


@ti.data_oriented
class Diagnostics:
    """Measures a state with the laws and colliders that act on it."""

    def __init__(self, builder: ti.FieldsBuilder, state: ParticleState, parts: Parts) -> None:
        self.state = state
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
            work=self.ledger[0].totals() if self.ledger else None,
        )

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
