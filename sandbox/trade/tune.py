"""The cheapest settings within an error, or the most accurate ones within a picture's time, found in few trials.

Theory says where to look: a scheme's longest stable step is its cheapest, its error falls with the power of its order
below that, and its time is that of a step over its length. So every scheme is tried at its longest step first; what
would take longer than the best that is known already is not tried at all; and where a trial fails, the next step
comes from the slope that order, or the last two trials, predict. Only what is left at the end is timed with care.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from sandbox.errors import SandboxError
from sandbox.scene.model import Precision
from sandbox.trade.crew import Slot
from sandbox.trade.front import is_tied
from sandbox.trade.ladder import LIMITED, UNLIMITED, Prospect, ladder, whole_steps
from sandbox.trade.measure import Row, Study
from sandbox.trade.reference import Reference
from sandbox.trade.trial import Settings

ITERATIONS = (1, 4, 16)
"""Iterations of xpbd and sweeps of vbd that are tried."""
_OPENING = 4
"""Cheapest lines that are tried first, side by side."""
_CLOSE = 0.95
"""Part of the error aimed at between two steps that were tried [1]."""
_WORTH = 1.12
"""How much longer a step must be than the longest one known to do, to be worth a trial [1]."""
_HOPE = 1.4
"""Estimated time, over that of the best known, up to which settings are still tried: estimates err [1]."""
_CAUTION = 0.85
"""Part of the error aimed at when a step is predicted [1]."""
_MOST_TRIALS = 7
"""Trials of one line."""
_FINALISTS = 4
"""Settings that are timed in the end."""
_TWINS = 2
"""Of these, those that are tried in f64 too."""
_BUDGET_USED = 0.8
"""Part of a picture's time that settings are made to fit: 95 of 100 pictures shall stay within all of it [1]."""
_MOST_FITS = 6
"""Timings of one line, to fit its step to a budget."""
_ENOUGH = 0.8
"""Step, over one that fits, down to which nothing is gained by taking it instead [1]."""
_REFERENCE_SECONDS = 120.0
"""Estimated time on one core beyond which no finer level of the reference is run [s]."""


@dataclass(frozen=True)
class Target:
    """What settings are looked for: one of the two is given."""

    error: float | None = None
    """Largest position error [1]."""
    budget: float | None = None
    """Wall time of a picture [s]."""


@dataclass
class Line:
    """Settings that differ in their step alone, and what is known of them."""

    prospect: Prospect
    precision: Precision
    iterations: int | None
    frame: float
    tried: dict[float, float] = field(default_factory=dict)
    """Error of every step tried [1]; infinite where it failed."""
    step_seconds: float = math.nan
    """Time of a step [s]: estimated, then as measured."""

    def __post_init__(self) -> None:
        self.step_seconds = self.prospect.seconds(1.0, self.iterations)

    @property
    def longest(self) -> float:
        """Longest step that makes sense [s]."""
        if math.isfinite(self.prospect.limit):
            return whole_steps(LIMITED[0] * self.prospect.dt, self.frame)
        return self.frame

    @property
    def first(self) -> float:
        """Step to begin with [s]."""
        return self.longest if math.isfinite(self.prospect.limit) else self._whole(UNLIMITED[0] * self.prospect.dt)

    def settings(self, dt: float) -> Settings:
        """Those with a step [s]."""
        return Settings(self.prospect.integrator, dt, self.precision, self.iterations)

    def seconds(self, dt: float) -> float:
        """Expected time of a simulated second [s]."""
        return self.step_seconds / dt

    def met(self, error: float) -> float | None:
        """Longest step known to stay within an error [s]."""
        return max((dt for dt, made in self.tried.items() if made <= error), default=None)

    def next(self, error: float) -> float | None:
        """The step to try next for an error; None where nothing is left to find out."""
        if not self.tried:
            return self.first
        if len(self.tried) >= _MOST_TRIALS:
            return None
        within = self.met(error)
        beyond = min((dt for dt, made in self.tried.items() if made > error and dt > (within or 0.0)), default=None)
        if within is None:
            wanted = self._predicted(min(self.tried), error)
        elif beyond is not None:
            wanted = self._between(within, beyond, error)
        else:
            wanted = min(self._predicted(within, error), self.longest)
        wanted = self._whole(wanted)
        worth = within is None or wanted > _WORTH * within
        return wanted if wanted not in self.tried and worth else None

    def _between(self, within: float, beyond: float, error: float) -> float:
        """Step between one that is good enough and one that is not, by the power law that joins their errors."""
        low, high = self.tried[within], self.tried[beyond]
        if not (math.isfinite(high) and low > 0.0):
            return math.sqrt(within * beyond)
        slope = math.log(high / low) / math.log(beyond / within)
        return within * math.pow(max(_CLOSE * error / low, 1.0), 1.0 / slope)

    def _whole(self, dt: float) -> float:
        return whole_steps(dt, self.frame)

    def _predicted(self, dt: float, error: float) -> float:
        """Step whose error should be the one wanted, from what step ``dt`` [s] made."""
        made = self.tried[dt]
        if not math.isfinite(made):
            return 0.5 * dt
        factor = math.pow(_CAUTION * error / max(made, 1e-300), 1.0 / self._slope())
        return dt * min(max(factor, 0.125), 8.0)

    def _slope(self) -> float:
        """Power of the step by which the error falls: as the shortest two trials show, else the order."""
        known = sorted((dt, made) for dt, made in self.tried.items() if math.isfinite(made) and made > 0.0)[:2]
        if len(known) < 2:
            return float(self.prospect.order)
        (short, low), (long, high) = known
        return min(max(math.log(high / low) / math.log(long / short), 0.5), 4.0)


@dataclass(frozen=True)
class Tuned:
    """What a search found."""

    row: Row
    """The settings, with their error and times."""
    reference: Reference
    predictable: float
    """Time over which trajectories are compared: errors are those of this time, and promise nothing beyond [s]."""
    others: tuple[Row, ...]
    """The other finalists."""
    trials: int
    """Settings that were run."""
    timed: int
    """Settings that were timed."""
    grid: int
    """Settings that a full grid has."""
    unseen: tuple[str, ...]
    """What happens in the scene and was not looked at, a line each."""

    @property
    def as_fast(self) -> tuple[Row, ...]:
        """Other finalists whose times do not tell that they are slower."""
        return tuple(row for row in self.others if is_tied(row, self.row))


class _Search:
    """What both searches share: a study, its lines, and who works."""

    def __init__(self, study: Study, slots: Sequence[Slot], timer: Slot, iterations: tuple[int, ...] | None) -> None:
        self.study, self.slots, self.timer = study, slots, timer
        self.counts = iterations or ITERATIONS
        self.lines = list(self._lines(study.scene.solver.precision))
        self._rounds = 0

    def _lines(self, precision: Precision) -> Iterator[Line]:
        for integrator in self.study.options.choice.schemes:
            prospect = self.study.prospects.of(integrator)
            for iterations in self.counts if prospect.iterates else (None,):
                yield Line(prospect, precision, iterations, self.study.frame)

    def doubles(self) -> list[Line]:
        """Lines in f64, where those of the scene are not."""
        if self.study.scene.solver.precision is Precision.F64:
            return []
        return list(self._lines(Precision.F64))

    def run(self, steps: dict[int, float]) -> None:
        """Try a step of every line named by its number, side by side; learn what steps cost."""
        study = self.study
        self._rounds += 1
        study.tell(1.0 - 0.75**self._rounds, f"round {self._rounds}: {len(steps)} trials")
        chosen = {number: self.lines[number].settings(dt) for number, dt in steps.items()}
        study.run(self.slots, chosen.values())
        for number, settings in chosen.items():
            outcome = study.outcomes[settings]
            if outcome.record is not None and outcome.seconds > 0.0:
                self.lines[number].step_seconds = outcome.seconds / study.horizon * settings.dt

    def judge(self, reference: Reference) -> None:
        """Errors of all that was run, by the reference as it is now; its own bound counts as error too."""
        for line in self.lines:
            for settings, outcome in self.study.outcomes.items():
                if settings == line.settings(settings.dt):
                    error = self.study.error(settings, reference) if outcome.record is not None else math.inf
                    line.tried[settings.dt] = error + reference.bound

    def best(self, finalists: list[Settings], reference: Reference) -> list[Row]:
        """Rows of settings, timed with the machine alone."""
        self.study.tell(1.0 - 0.75 ** (self._rounds + 1), f"timing {len(finalists)} finalists")
        self.study.time(self.timer, finalists)
        return [self.study.row(settings, reference) for settings in finalists]


def tune_error(study: Study, slots: Sequence[Slot], timer: Slot, error: float) -> Tuned:
    """The cheapest settings whose position error is at most ``error`` [1].

    Raises SandboxError where nothing that was tried is so accurate, or the scene cannot be predicted at all.
    """
    study.look_ahead(slots)
    search = _Search(study, slots, timer, study.options.choice.iterations)
    study.run(slots, (), range(4))
    reference = study.refine(slots, lambda: error, _REFERENCE_SECONDS)
    _check(reference, error)
    by_cost = sorted(range(len(search.lines)), key=lambda k: search.lines[k].seconds(search.lines[k].first))
    steps = {k: search.lines[k].first for k in by_cost[:_OPENING]}
    doubled = False
    while steps:
        search.run(steps)
        search.judge(reference)
        steps = _proposals(search.lines, error)
        if not steps and not doubled and not any(line.met(error) for line in search.lines):
            search.lines += search.doubles()
            doubled, steps = True, _proposals(search.lines, error)
    within = [(line.seconds(dt), line.settings(dt)) for line in search.lines if (dt := line.met(error)) is not None]
    if not within:
        raise SandboxError(_missed(search, error))
    finalists = [settings for _, settings in sorted(within, key=lambda pair: pair[0])[:_FINALISTS]]
    finalists += _twins(finalists[:_TWINS])
    study.run(slots, finalists)
    finalists = [settings for settings in finalists if study.error(settings, reference) + reference.bound <= error]
    rows = search.best(finalists, reference)
    return _tuned(study, sorted(rows, key=lambda row: row.seconds[1]), reference)


def _twins(finalists: Sequence[Settings]) -> list[Settings]:
    """The same in f64: on a CPU that may well be the faster one, where volumes or contact are reckoned in it anyway."""
    return [replace(settings, precision=Precision.F64) for settings in finalists if settings.precision is Precision.F32]


def _proposals(lines: Sequence[Line], error: float) -> dict[int, float]:
    """What to try next: of every line that may beat the best that is known."""
    times = [line.seconds(dt) for line in lines if (dt := line.met(error)) is not None]
    most = _HOPE * min(times, default=math.inf)
    wanted = {k: dt for k, line in enumerate(lines) if (dt := line.next(error)) is not None}
    steps = {k: dt for k, dt in wanted.items() if lines[k].seconds(dt) <= most}
    if times:
        return steps
    # Nothing is good enough yet: the cheapest first, what is dear may turn out not to be needed.
    cheapest = sorted(steps, key=lambda k: lines[k].seconds(steps[k]))
    return {k: steps[k] for k in cheapest[:_OPENING]}


def _check(reference: Reference, error: float) -> None:
    if not reference.agreed:
        raise SandboxError("two references of this scene never agree: there is no trajectory to be accurate to")
    if reference.bound > 0.5 * error:
        raise SandboxError(
            f"the reference itself is within {reference.bound:.2g} only, over the time that was looked at: "
            f"ask for more than {2.0 * reference.bound:.2g}, or for a shorter --horizon"
        )


def _missed(search: _Search, error: float) -> str:
    best = min((made, line.settings(dt).label) for line in search.lines for dt, made in line.tried.items())
    return f"no settings stay within an error of {error:.3g}: the best of those tried, {best[1]}, makes {best[0]:.3g}"


def tune_budget(study: Study, slots: Sequence[Slot], timer: Slot, budget: float) -> Tuned:
    """The most accurate settings that simulate a picture within ``budget`` [s], 95 times of 100.

    Raises SandboxError where none does.
    """
    study.look_ahead(slots)
    search = _Search(study, slots, timer, study.options.choice.iterations)
    # In both precisions: what does not fit in one of them may well fit in the other.
    lines = [*search.lines, *search.doubles()]
    fitting = [settings for line in lines if (settings := _fitted(study, timer, line, budget)) is not None]
    if not fitting:
        raise SandboxError(f"no settings simulate a picture within {1e3 * budget:.3g} ms and stay stable")
    study.tell(0.5, f"errors of {len(fitting)} settings")
    study.run(slots, fitting, range(4))
    reference = study.refine(slots, lambda: study.smallest_error(fitting), _REFERENCE_SECONDS)
    rows = [study.row(settings, reference) for settings in fitting]
    known = sorted((row for row in rows if math.isfinite(row.error)), key=lambda row: (row.error, row.frame_95))
    if not known:
        raise SandboxError(f"no settings that simulate a picture within {1e3 * budget:.3g} ms stay stable")
    return _tuned(study, known, reference)


def _fitted(study: Study, timer: Slot, line: Line, budget: float) -> Settings | None:
    """The shortest step of a line whose pictures stay within a budget [s]; None where that is too long a step."""
    dt = line.first
    if line.seconds(dt) * line.frame > 4.0 * budget:
        return None  # far too dear, however far the estimate is off
    fitting: Settings | None = None
    for _ in range(_MOST_FITS):
        settings = line.settings(dt)
        study.time(timer, [settings])
        took = study.timings[settings].frame_quantile(0.95)
        if not took > 0.0:
            break
        if took <= (_BUDGET_USED + 0.1) * budget:
            fitting = settings
        steps = max(1, math.floor(_BUDGET_USED * budget / took * round(line.frame / dt)))
        wanted = min(line.frame / steps, line.longest)
        if fitting is settings and wanted > _ENOUGH * dt:
            break
        if wanted == dt or (fitting is not None and wanted >= fitting.dt):
            break
        dt = wanted
    return fitting


def _tuned(study: Study, rows: list[Row], reference: Reference) -> Tuned:
    choice = replace(study.options.choice, precisions=tuple(Precision), dts=None)
    return Tuned(
        row=rows[0],
        reference=reference,
        predictable=study.predictable_frames(reference) * study.frame,
        others=tuple(rows[1:]),
        trials=len(study.outcomes),
        timed=len(study.timings),
        grid=len(ladder(study.prospects, choice)),
        unseen=study.unseen(reference),
    )
