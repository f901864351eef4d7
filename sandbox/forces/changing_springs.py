"""Springs that do more than pull and push: that go slack, flow, or tear.

Every spring is stored at both of its ends. Both see the same length to the bit, so both copies of a
rest length flow alike and tear in the same step, without a word between them.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import functions, runtime
from sandbox.forces.spring_rows import SpringRows, arrange
from sandbox.forces.springs import _TINY, Springs
from sandbox.forces.tears import Tears
from sandbox.ledger import Ledger
from sandbox.scene.assemble import Assembly
from sandbox.scene.spring_set import Behaviour, SpringSet
from sandbox.state import SLICE, ParticleState, place

FloatArray = NDArray[np.float64]


@ti.data_oriented
class ChangingSprings(Springs):
    """Springs of one behaviour. What the behaviour lacks is not compiled.

    Tension only: no force while shorter than at rest, damping included.

    Plasticity: of the elastic strain e = (r - L) / L0 what is beyond the yield strain turns plastic at
    the rate ``creep``, exactly in time: L grows by (|e| - e_y) (1 - exp(-creep dt)) L0 in the
    direction of e, up to L0 (1 +- max_plastic_strain).

    Tearing: a spring stretched beyond break_strain, (r - L0) / L0, is gone: no stiffness, no damping.
    """

    def __init__(
        self,
        builder: ti.FieldsBuilder,
        springs: SpringSet,
        state: ParticleState,
        rows: SpringRows,
        numbers: NDArray[np.int64],
        behaviour: Behaviour,
        tears: Tears | None,
        ledger: Ledger | None,
    ) -> None:
        super().__init__(builder, springs, state, rows)
        self.numbers = numbers
        self.name = memory_name(numbers)
        self.tension_only = behaviour.tension_only
        self.yields = behaviour.yields
        self.breaks = behaviour.tears
        self.changes = self.yields or self.breaks
        self.tears = tears
        self.booked = ledger is not None
        self.ledger = ledger
        half_edges = len(rows.neighbour)
        _, self._first = np.unique(rows.spring, return_index=True)
        real = runtime.real()
        if self.changes:
            self.original = place(builder, ti.field(real), half_edges)
        if self.yields:
            self.yield_strain = place(builder, ti.field(real), half_edges)
            self.creep = place(builder, ti.field(real), half_edges)
            self.max_plastic = place(builder, ti.field(real), half_edges)
            self.kept_rest_length = place(builder, ti.field(real), half_edges)
        if self.breaks:
            self.break_strain = place(builder, ti.field(real), half_edges)
            self.spring = place(builder, ti.field(ti.i32), half_edges)
            self.kept_stiffness = place(builder, ti.field(real), half_edges)
            if self.damped:
                self.kept_damping = place(builder, ti.field(real), half_edges)
        self.plastic_term = 0 if ledger is None else ledger.index("plastic")
        self.tearing_term = 0 if ledger is None else ledger.index("tearing")

    def load(self, assembly: Assembly) -> None:
        super().load(assembly)
        rows, springs = self.rows, self.springs
        # Infinities do not survive fast math; these are as good.
        limits = (springs.yield_strain, springs.creep, springs.max_plastic_strain, springs.break_strain)
        finite = [np.minimum(values, 1e9)[rows.spring] for values in limits]
        if self.changes:
            self._write_limits(springs.rest_lengths[rows.spring], *finite, self.numbers[rows.spring].astype(np.int32))

    @ti.kernel
    def _write_limits(
        self,
        original: ti.types.ndarray(),
        yield_strain: ti.types.ndarray(),
        creep: ti.types.ndarray(),
        max_plastic: ti.types.ndarray(),
        break_strain: ti.types.ndarray(),
        spring: ti.types.ndarray(),
    ):
        for h in range(original.shape[0]):
            self.original[h] = original[h]
            if ti.static(self.yields):
                self.yield_strain[h] = yield_strain[h]
                self.creep[h] = creep[h]
                self.max_plastic[h] = max_plastic[h]
            if ti.static(self.breaks):
                self.break_strain[h] = break_strain[h]
                self.spring[h] = spring[h]

    @ti.func
    def evolve(self, i, slot, dt):
        """Let the half-edges of particle i flow and tear, at the positions of ``slot``, over ``dt`` [s]."""
        if ti.static(self.changes):
            x = self.state.x[slot, i]
            for h in range(self.row[i], self.row[i + 1]):
                if self.stiffness[h] > 0.0 and self.original[h] > 0.0:
                    d = self.state.x[slot, self.neighbour[h]] - x
                    r = d.norm()
                    before = self._tension(h, r)
                    if ti.static(self.yields):
                        self._flow(i, h, r, dt)
                        self._book_jump(self.plastic_term, i, slot, h, d, before, dt)
                        before = self._tension(h, r)
                    if ti.static(self.breaks):
                        if r > (1.0 + self.break_strain[h]) * self.original[h]:
                            self._tear(i, h, r)
                            self._book_jump(self.tearing_term, i, slot, h, d, before, dt)

    @ti.func
    def _tension(self, h, r):
        return self.stiffness[h] * (r - self.rest_length[h])

    @ti.func
    def _book_jump(self, term, i, slot, h, d, before, dt):
        """A force that jumps between drift and kick works half a step less, or more, than its energy says."""
        if ti.static(self.booked):
            r = ti.max(d.norm(), 1e-12)
            along = d.dot(self.state.v[slot, i]) / r
            self.ledger.add(term, i, 0.5 * dt * along * (self._tension(h, r) - before))

    @ti.func
    def _flow(self, i, h, r, dt):
        original = self.original[h]
        rest = self.rest_length[h]
        stretch = r - rest
        excess = ti.abs(stretch) - self.yield_strain[h] * original
        if ti.static(self.tension_only):
            excess = ti.select(stretch > 0.0, excess, 0.0)
        if excess > 0.0:
            flow = excess * (1.0 - functions.exp(-self.creep[h] * dt))
            most = self.max_plastic[h] * original
            flowed = ti.max(original - most, ti.min(original + most, rest + ti.select(stretch > 0.0, flow, -flow)))
            self.rest_length[h] = flowed
            if ti.static(self.booked):
                gain = 0.25 * self.stiffness[h] * ((r - flowed) * (r - flowed) - stretch * stretch)
                self.ledger.add(self.plastic_term, i, gain)

    @ti.func
    def _tear(self, i, h, r):
        if ti.static(self.booked):
            stretch = r - self.rest_length[h]
            self.ledger.add(self.tearing_term, i, -0.25 * self.stiffness[h] * stretch * stretch)
        self.stiffness[h] = 0.0
        if ti.static(self.damped):
            self.damping[h] = 0.0
        self.tears.mark(self.spring[h])

    @ti.func
    def dissipation_on(self, i, slot):
        """The force on particle i less that of its springs' energy [N]."""
        force = self.vector(0.0)
        if ti.static(self.damped):
            force = self.force_on(i, slot) - self._elastic(i, slot)
        return force

    @ti.func
    def _elastic(self, i, slot):
        x = self.state.x[slot, i]
        force = self.vector(0.0)
        for h in range(self.row[i], self.row[i + 1]):
            d = self.state.x[slot, self.neighbour[h]] - x
            r = ti.sqrt(ti.max(d.dot(d), _TINY))
            stretch = r - self.rest_length[h]
            if ti.static(self.tension_only):
                stretch = ti.max(stretch, 0.0)
            force += self.stiffness[h] * stretch / r * d
        return force

    # -- memory -------------------------------------------------------------------------------------

    def keep(self) -> None:
        """Copy what changes into a backup."""
        if self.changes:
            self._exchange(True)

    def restore(self) -> None:
        """Copy the backup back."""
        if self.changes:
            self._exchange(False)

    def memory(self) -> dict[str, FloatArray]:
        """Rest lengths [m] and stiffness [N/m] of these springs as they are now."""
        if not self.changes:
            return {}
        values = np.empty((2, len(self.rows.neighbour)))
        self._read_changed(values)
        return {f"{self.name}.rest_length": values[0, self._first], f"{self.name}.stiffness": values[1, self._first]}

    def remember(self, values: dict[str, FloatArray]) -> None:
        """Set rest lengths and stiffness from :meth:`memory`; springs without stiffness lose their damping too."""
        if self.changes:
            rest, stiffness = (values[f"{self.name}.{part}"] for part in ("rest_length", "stiffness"))
            damping = np.where(stiffness > 0.0, self.springs.damping, 0.0)
            self._write_changed(*(np.ascontiguousarray(a[self.rows.spring]) for a in (rest, stiffness, damping)))

    @ti.kernel
    def _read_changed(self, values: ti.types.ndarray()):
        for h in range(values.shape[1]):
            values[0, h] = self.rest_length[h]
            values[1, h] = self.stiffness[h]

    @ti.kernel
    def _write_changed(self, rest: ti.types.ndarray(), stiffness: ti.types.ndarray(), damping: ti.types.ndarray()):
        for h in range(rest.shape[0]):
            self.rest_length[h] = rest[h]
            self.stiffness[h] = stiffness[h]
            if ti.static(self.damped):
                self.damping[h] = damping[h]

    @ti.kernel
    def _exchange(self, out: ti.i32):
        for h in self.neighbour:
            if ti.static(self.yields):
                if out:
                    self.kept_rest_length[h] = self.rest_length[h]
                else:
                    self.rest_length[h] = self.kept_rest_length[h]
            if ti.static(self.breaks):
                if out:
                    self.kept_stiffness[h] = self.stiffness[h]
                else:
                    self.stiffness[h] = self.kept_stiffness[h]
            if ti.static(self.breaks and self.damped):
                if out:
                    self.kept_damping[h] = self.damping[h]
                else:
                    self.damping[h] = self.kept_damping[h]


def memory_name(numbers: NDArray[np.int64]) -> str:
    """Under which name a law remembers the springs of these numbers."""
    return f"springs{int(numbers[0])}"


def changing_springs(
    builder: ti.FieldsBuilder,
    springs: SpringSet,
    state: ParticleState,
    numbers: NDArray[np.int64],
    behaviour: Behaviour,
    tears: Tears | None,
    ledger: Ledger | None,
) -> ChangingSprings:
    """Springs of one behaviour; ``numbers`` are theirs among all springs of the scene."""
    rows = arrange(springs.ends, state.count, SLICE)
    return ChangingSprings(builder, springs, state, rows, numbers, behaviour, tears, ledger)
