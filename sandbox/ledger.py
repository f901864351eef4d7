"""The energy ledger: work of everything that adds or takes energy, booked per particle and term.

Compiled in only where ``diagnostics.ledger`` is on. Sums run over very many small amounts, so they
are kept in double precision whatever the scene's; particle by particle, so that no two threads meet.
"""

import numpy as np
import taichi as ti

from sandbox.state import place

TERMS = (
    "damping", "drag", "collision", "friction", "contact", "plastic", "tearing", "wind", "gas_flow", "drive",
)  # fmt: skip
"""What energy may come from or go to: spring damping; drag; restitution and push of colliders; friction of any
contact; restitution of particles among themselves; plastic flow; torn springs; wind; gas let in or out; whatever
moves carried particles."""


@ti.data_oriented
class Ledger:
    """Work done on the bodies since the start [J], by term; negative where it takes energy."""

    def __init__(self, builder: ti.FieldsBuilder, particle_count: int) -> None:
        self.count = particle_count
        self.work = place(builder, ti.field(ti.f64), len(TERMS), particle_count)

    def index(self, term: str) -> int:
        """Row of a term, to book under."""
        return TERMS.index(term)

    def totals(self) -> dict[str, float]:
        """Work by term [J]."""
        work = np.empty((len(TERMS), self.count))
        self._read(work)
        return {term: float(row.sum()) for term, row in zip(TERMS, work, strict=True)}

    def clear(self) -> None:
        """Begin the books anew."""
        self.work.fill(0.0)

    @ti.func
    def add(self, term, i, joules):
        """Book ``joules`` for particle i under a term's index."""
        self.work[term, i] = self.work[term, i] + ti.cast(joules, ti.f64)

    @ti.kernel
    def _read(self, work: ti.types.ndarray()):
        for term, i in self.work:
            work[term, i] = self.work[term, i]
