"""What is looked for while a simulation runs: the part of the list of what it could not do that time brings.

Looks are taken where the state is measured anyway, a picture apart at most. What lasts is told with the time since
when, and till when; what is over in an instant only where it was much. docs/warnings.md says what each line means.
"""

from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from sandbox.scene.assemble import Assembly
from sandbox.scene.overlaps import BodyPairs, Solids, Sunk, spacing_of
from sandbox.start import NO_RADIUS, few
from sandbox.warning_log import WarningKind, WarningLog

LASTING = 0.25
"""Time for which cells may be inside out before it is told [s]: longer than an impact takes, which presses a soft body
for half a period of its slowest swing."""
MANY = 0.05
"""Part of a body's cells that may be inside out for less than that [1]."""
SINKING = 0.1
"""Time for which particles may be deep in colliders before it is told [s]."""
SUNK = 0.25
"""Part of its spacing, or its radius, that a particle may be deep in a collider [1]."""
UNSOLVED = 0.2
"""Residual of a step, over the impulses that act in it, at which it is as good as not solved [1].

At 0.07 a beam of xpbd hangs as the solution does to five digits, at 0.97 by 6 % lower; chains at 1.0 are too long by
that much, or many times too long.
"""
DEEP = 0.5
"""Part of their touching distance that two particles in contact may overlap [1]."""
OFTEN = 0.1
"""Part of the steps looked at of which that is told [1]; a single one may be an impact."""
_DEEPER = 1.1
"""How many times deeper particles must be to be looked at again [1]."""
_FEWEST = 5
"""Steps looked at before that part says anything."""


@dataclass
class _Spell:
    """A time for which cells of a body were inside out."""

    since: float
    until: float
    cells: int
    most: int
    told: bool = False


class Watch:
    """Looks at a running simulation, and notes what it could not do.

    Parameters
    ----------
    assembly : of the scene as it starts
    log : takes the lines
    """

    def __init__(self, assembly: Assembly, log: WarningLog) -> None:
        self.log = log
        self.names = [body.name for body in assembly.scene.bodies]
        self.cell_counts = np.bincount(assembly.cells.body, minlength=len(self.names))
        self.assembly = assembly
        self.solids = Solids(assembly) if assembly.colliders else None
        self.allowed = np.full(len(self.names), np.inf)
        """How deep the particles of every body may be in a collider [m], shape (B,)."""
        if self.solids is not None:
            spacing = spacing_of(assembly)
            self.allowed = SUNK * np.where(spacing > 0.0, spacing, np.inf)
            for body, own in enumerate(self.solids.members):
                radius = float(assembly.radii[own].max())
                self.allowed[body] = min(self.allowed[body], radius) if radius > 0.0 else self.allowed[body]
        self._begin(assembly.positions)

    def begin(self, simulation: Any) -> None:
        """Look anew at a simulation of which the state has been set."""
        self._begin(simulation.state.read()[0])
        self.scheme = str(simulation.scene.solver.integrator)
        self.begun = _Tally.of(simulation.solver_report())

    def _begin(self, positions: Any) -> None:
        self.spells: dict[int, _Spell] = {}
        self.sunk: dict[tuple[int, str], tuple[Sunk, float]] = {}
        self.deep_since: float | None = None
        self.deepest = 0.0
        self.overlap = 0.0
        self.next_time = 0.0
        self.met: list[str] = []
        self.scheme = ""
        self.begun, self.tally = _Tally(), _Tally()
        # What passes through each other from the start on is told then, see start_remarks.
        self.passing = BodyPairs(self.assembly, touching=False)
        for overlap in self.passing.overlaps(positions) if self.passing else ():
            self.passing.forget(overlap.first, overlap.second)

    def memory(self) -> dict[str, Any]:
        """What was seen so far as plain data, for :meth:`remember`."""
        return {
            "spells": [(body, *astuple(spell)) for body, spell in self.spells.items()],
            "sunk": [(*astuple(sunk), time) for sunk, time in self.sunk.values()],
            "depths": (self.deep_since, self.deepest, self.overlap),
            "bodies": (self.next_time, self.met, self.passing.forgotten),
            "solver": (self.scheme, astuple(self.begun), astuple(self.tally)),
        }

    def remember(self, memory: Mapping[str, Any]) -> None:
        """Go on from what was seen before, in the same scene."""
        self.spells = {int(body): _Spell(*values) for body, *values in memory["spells"]}
        self.sunk = {(body, name): (Sunk(body, name, depth), time) for body, name, depth, time in memory["sunk"]}
        self.deep_since, self.deepest, self.overlap = memory["depths"]
        self.next_time, self.met, forgotten = memory["bodies"]
        self.passing = BodyPairs(self.assembly, touching=False)
        for first, second in forgotten:
            self.passing.forget(first, second)
        self.scheme, begun, tally = memory["solver"]
        self.begun, self.tally = _Tally(*begun), _Tally(*tally)

    def look(self, simulation: Any) -> None:
        """Note what there is to be seen now."""
        measured = simulation.measure()
        if measured.inverted or self.spells:
            self._look_at_cells(simulation.time, measured.inverted)
        if measured.max_penetration > self.allowed.min():
            self._look_at_depths(simulation, measured.max_penetration)
        else:
            self.deep_since = None
        if measured.max_overlap > max(DEEP, self.overlap):
            self.overlap = measured.max_overlap
            line = f"particles in contact are in each other by {self.overlap:.0%} of their touching distance"
            line += f" at t = {simulation.time:.3g} s: take a shorter dt, or larger or more even radii and masses"
            self.log.note(WarningKind.OVERLAPPING, line)
        # Ticks of what is live are shorter than pictures.
        if self.passing and simulation.time >= self.next_time:
            self.next_time = simulation.time + 0.9 / simulation.scene.render.fps
            self._look_at_bodies(simulation)
        if report := simulation.solver_report():
            self._look_at_solver(simulation, report)

    # -- bodies -------------------------------------------------------------------------------------

    def _look_at_cells(self, time: float, inverted: Mapping[int, int]) -> None:
        for body in {**self.spells, **inverted}:
            count, spell = inverted.get(body, 0), self.spells.get(body)
            if count and (spell is None or not spell.cells):
                told = spell is not None and spell.told
                spell = self.spells[body] = _Spell(time, time, count, max(count, spell.most if spell else 0), told)
            assert spell is not None
            if spell.cells:
                spell.until, spell.cells, spell.most = time, count, max(spell.most, count)
                lasts = time - spell.since >= LASTING
                spell.told = spell.told or lasts or spell.most > MANY * self.cell_counts[body]
        self._tell_of_cells()

    def _tell_of_cells(self) -> None:
        told = sorted((item for item in self.spells.items() if item[1].told), key=lambda item: -item[1].most)
        lines = []
        for body, spell in told:
            name, count, since = f"{self.names[body]!r}", self.cell_counts[body], f"t = {spell.since:.3g} s"
            if spell.cells:
                lines.append(f"{spell.cells} of {count} of {name} since {since} ({spell.most} at most)")
            else:
                lines.append(f"{spell.most} of {count} of {name} at most from {since} to {spell.until:.3g} s")
        if lines:
            self.log.note(WarningKind.INVERTED, f"cells inside out: {few(lines, 'bodies', '; ')}")

    def _look_at_depths(self, simulation: Any, deepest: float) -> None:
        assert self.solids is not None
        time = simulation.time
        self.deep_since = time if self.deep_since is None else self.deep_since
        if time - self.deep_since < SINKING or deepest < _DEEPER * self.deepest:
            return
        self.deepest = deepest
        positions, held = simulation.state.read()[0], simulation.assembly.inverse_masses
        for sunk in self.solids.sunk(positions, held, time, self.allowed, radii=1.0):
            before = self.sunk.get((sunk.body, sunk.collider))
            if before is None or before[0].depth < sunk.depth:
                self.sunk[sunk.body, sunk.collider] = (sunk, time)
        told = sorted(self.sunk.values(), key=lambda item: -item[0].depth)
        lines = [f"{self.names[s.body]!r} {s.depth:.2g} m deep in {s.collider} at t = {at:.3g} s" for s, at in told]
        if not lines and deepest > self.allowed[np.isfinite(self.allowed)].max():
            lines = [f"one {deepest:.2g} m deep at t = {time:.3g} s"]
        if lines:
            self.log.note(WarningKind.PENETRATED, f"particles are inside colliders: {few(lines, 'of them')}")

    def _look_at_bodies(self, simulation: Any) -> None:
        for overlap in self.passing.overlaps(simulation.state.read()[0]):
            self.passing.forget(overlap.first, overlap.second)
            first, second = self.names[overlap.first], self.names[overlap.second]
            self.met.append(f"{first!r} and {second!r} from t = {simulation.time:.3g} s on")
            line = f"bodies are in each other's place: {few(self.met, 'pairs')}; {NO_RADIUS}"
            self.log.note(WarningKind.CANNOT_MEET, line)

    # -- the scheme ---------------------------------------------------------------------------------

    def _look_at_solver(self, simulation: Any, report: Mapping[str, float]) -> None:
        name = str(simulation.scene.solver.integrator)
        if name != self.scheme:
            self.scheme, self.begun, self.tally = name, _Tally(), _Tally()
        if "steps" not in report:
            self.tally.add(report["residual"])
        else:
            counts = _Tally.of(report)
            # A scheme that was built anew counts from none again.
            self.begun = self.begun if counts.steps >= self.begun.steps else _Tally()
            self.tally = counts.since(self.begun)
        tally = self.tally
        if tally.steps >= _FEWEST and tally.unsolved >= OFTEN * tally.steps:
            part = tally.unsolved / tally.steps
            line = f"{name} has not converged in {part:.0%} of its steps (residual up to {tally.worst:.2g})"
            self.log.note(WarningKind.UNCONVERGED, f"{line}: raise solver.iterations, or take a shorter dt", name)
        if tally.replaced > 0.5:
            count = f"{round(tally.replaced)} of {round(tally.steps)} steps"
            line = f"{name} took {count} as implicit_euler, which takes energy out: take a shorter dt"
            self.log.note(WarningKind.REPLACED, line, name)


@dataclass
class _Tally:
    """How steps went: of all, or of those looked at."""

    steps: float = 0.0
    unsolved: float = 0.0
    replaced: float = 0.0
    worst: float = 0.0
    """Largest residual [1]."""

    @classmethod
    def of(cls, report: Mapping[str, float]) -> "_Tally":
        """Of all steps since a scheme was built; of none where it does not say."""
        steps = report.get("steps", 0.0)
        unsolved, replaced = (steps * report.get(name, 0.0) for name in ("unsolved", "replaced"))
        return cls(steps, unsolved, replaced, report.get("residual", 0.0) if steps else 0.0)

    def add(self, residual: float) -> None:
        """One more step was looked at."""
        self.steps += 1.0
        self.unsolved += float(residual > UNSOLVED)
        self.worst = max(self.worst, residual)

    def since(self, before: "_Tally") -> "_Tally":
        """What came after ``before``."""
        return _Tally(
            self.steps - before.steps, self.unsolved - before.unsolved, self.replaced - before.replaced, self.worst
        )
