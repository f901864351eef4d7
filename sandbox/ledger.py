"""The energy ledger: work of everything that adds or takes energy, booked per particle and term.

Compiled in only where ``diagnostics.ledger`` is on. Sums run over very many small amounts, so they
are kept in double precision whatever the scene's; particle by particle, so that no two threads meet.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.state import place

FloatArray = NDArray[np.float64]

TERMS = (
    "damping", "drag", "collision", "friction", "contact", "plastic", "tearing", "wind", "gas_flow", "drive",
    "action",
)  # fmt: skip
"""What energy may come from or go to: spring damping; drag; restitution and push of colliders; friction of any
contact; restitution of particles among themselves; plastic flow; torn springs; wind; gas let in or out; whatever
moves carried particles; hands, pushes, and whatever else is done to bodies."""


RUBBED, ALONG, ACROSS, MOVED = 0, 1, 2, 3
"""What waits for the step to book it: impulses of friction with colliders, of contact of particles along and across
their lines of centres [N s]; and the way that colliders moved a particle beyond its velocity [m]."""
_KINDS = 4


@ti.data_oriented
class Ledger:
    """Work done on the bodies since the start [J], by term; negative where it takes energy.

    Parts that change velocities at once hand in their impulses; their work is known only when the
    velocity that the step ends with is, see :mod:`sandbox.integrators.bookkeeping`.
    """

    def __init__(self, builder: ti.FieldsBuilder, particle_count: int, dimension: int) -> None:
        self.count = particle_count
        self.work = place(builder, ti.field(ti.f64), len(TERMS), particle_count)
        self._number = np.float64 if runtime.settings().precision == "f64" else np.float32
        self._earlier = np.zeros(len(TERMS))
        self._kept: dict[str, FloatArray] = {}
        self.impulses = place(builder, runtime.vector(dimension).field(), _KINDS, particle_count)

    def index(self, term: str) -> int:
        """Row of a term, to book under."""
        return TERMS.index(term)

    def totals(self) -> dict[str, float]:
        """Work by term [J]."""
        return dict(zip(TERMS, (float(value) for value in self._sums()), strict=True))

    def _sums(self) -> FloatArray:
        return np.asarray(self._earlier + self._by_particle().sum(axis=1))

    def _by_particle(self) -> FloatArray:
        work = np.empty((len(TERMS), self.count))
        self._read(work)
        return work

    def book(self, term: str, joules: float) -> None:
        """Book work that is known as a whole [J], between steps."""
        self._earlier[self.index(term)] += joules

    def clear(self) -> None:
        """Begin the books anew."""
        self._earlier[:] = 0.0
        self.work.fill(0.0)
        self.impulses.fill(0.0)

    def keep(self) -> None:
        """Remember the books as they are now."""
        self._kept = self.memory()

    def restore(self) -> None:
        """Go back to the books that were kept."""
        self.remember(self._kept)

    def memory(self) -> dict[str, FloatArray]:
        """The books, for :meth:`remember`; not summed up, so that what is booked later is rounded as ever."""
        return {
            "ledger.earlier": self._earlier.copy(),
            "ledger.work": self._by_particle(),
            "ledger.impulses": self.impulses.to_numpy().astype(np.float64),
        }

    def remember(self, values: dict[str, FloatArray]) -> None:
        """Open the books with what :meth:`memory` gave; without it, empty."""
        self.clear()
        if "ledger.work" in values:
            self._earlier[:] = values["ledger.earlier"]
            self.work.from_numpy(values["ledger.work"])
            self.impulses.from_numpy(values["ledger.impulses"].astype(self._number))

    @ti.func
    def add(self, term, i, joules):
        """Book ``joules`` for particle i under a term's index."""
        self.work[term, i] = self.work[term, i] + ti.cast(joules, ti.f64)

    @ti.func
    def hand_in(self, kind, i, impulse):
        """Remember an impulse on particle i [N s], or a way [m], until its step is booked."""
        self.impulses[kind, i] = self.impulses[kind, i] + impulse

    @ti.func
    def take(self, kind, i):
        """What was handed in for particle i since the last booking."""
        impulse = self.impulses[kind, i]
        self.impulses[kind, i] = 0.0 * impulse
        return impulse

    @ti.kernel
    def _read(self, work: ti.types.ndarray()):
        for term, i in self.work:
            work[term, i] = self.work[term, i]
