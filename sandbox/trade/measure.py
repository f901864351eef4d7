"""The trade of a scene: what error every setting makes, and what it costs.

Error runs go side by side, timings one after the other with the machine alone; both may be interrupted and go on
from what is finished. See :mod:`sandbox.trade.norms` for what an error is, :mod:`sandbox.trade.reference` for what
it is measured against.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from sandbox.errors import DivergedError, SandboxError
from sandbox.integrators.build import serial_work
from sandbox.integrators.schemes import SCHEMES
from sandbox.scene.model import IntegratorName, Scene
from sandbox.trade import norms
from sandbox.trade.crew import Failed, Job, Slot, open_crew, work_off
from sandbox.trade.front import Standing, with_standing
from sandbox.trade.jobs import PASSES, RUN_MOST, look_ahead_job, outcome_of, run_job, timing_job, timing_of
from sandbox.trade.ladder import Choice, Prospects, ladder, run_seconds
from sandbox.trade.norms import STATISTICS, Scale, Statistics
from sandbox.trade.outlook import Event, Outlook
from sandbox.trade.progress import Progress
from sandbox.trade.record import Record
from sandbox.trade.reference import Cache, Plan, Reference
from sandbox.trade.store import Store
from sandbox.trade.trial import Settings, Trial, even_samples
from sandbox.trade.worker import Outcome, Status, Timing

HORIZON = 1.0
"""Longest time that is looked at by default [s]."""
_FEWEST_FRAMES = 6
_BUDGET = 40.0
"""Estimated time on one core that a study takes by default [s]: a heavy scene is looked at for a shorter time."""
_LATE = 3.0
"""How many times that a study takes where what happens in the scene happens late [1]."""
_LOOK_AHEAD = 30.0
"""Estimated time on one core of the run that tells when it happens, at most [s]."""
_LEVELS = 4
"""Levels of the reference that are run in any case."""
_REFERENCE_BUDGET = 20.0
"""Estimated time on one core beyond which no finer level is run by default [s]."""
_BESIDE = 0.5
"""About what a run takes beside its steps [s]."""
_TIMING_MOST = 0.6
"""Time for which a setting is timed, more or less [s]."""


@dataclass(frozen=True)
class Options:
    """How a study goes about it."""

    choice: Choice = field(default_factory=Choice)
    horizon: float | None = None
    """Time that is looked at [s]; None for what fits the scene."""
    workers: int = 2
    cluster: str | None = None
    """Address of a Dask scheduler that error runs go to."""
    arch: str = "cpu"
    threads: int | None = None
    """CPU threads of timed runs; all cores by default."""
    cache: Cache = field(default_factory=Cache)
    times: bool = True
    """Whether to time; without, a study tells errors alone."""


@dataclass(frozen=True)
class Row:
    """One setting of a study."""

    settings: Settings
    status: Status
    message: str
    error: float
    """Position error, in body sizes [1]; nan where there is none."""
    resolved: bool
    """False where the error is below what the reference tells apart: it is at most ``error`` then."""
    energy_error: float
    """[1]; nan where there is none."""
    statistics: Statistics
    seconds: tuple[float, float, float]
    """Least, median and most wall time of a simulated second [s]; nan where there is none."""
    frame_95: float
    """Wall time that 95 of 100 pictures stay within [s]."""
    standing: Standing = field(default_factory=Standing)
    """Whether other settings are both faster and more accurate, as far as their timings tell."""

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds a second [1]."""
        return 1.0 / self.seconds[1]


@dataclass(frozen=True)
class Trade:
    """What a study found."""

    scene: Scene
    rows: tuple[Row, ...]
    reference: Reference
    horizon: float
    """Time that was looked at [s]."""
    predictable: float
    """Time over which two references agree, and trajectories are compared [s]."""
    statistics_bound: Statistics
    """How far two references are apart in what is compared beyond."""
    unseen: tuple[str, ...]
    """What happens in the scene and was not looked at, a line each."""

    @property
    def smallest(self) -> float:
        """Smallest position error that is told apart [1]."""
        return self.reference.smallest


class Study:
    """A scene, looked at for a time: runs and times trials of it, and knows what they are worth.

    Used by :func:`measure` with all settings at once, by :mod:`sandbox.trade.tune` with few, one after the other.
    Raises SceneError where the scene cannot be built.
    """

    def __init__(self, scene: Scene, options: Options, store: Store, progress: Progress = lambda *_: None) -> None:
        self.scene, self.options, self.store, self.progress = scene, options, store, progress
        self.prospects = Prospects(scene)
        self.scale = Scale.of(self.prospects.assembly)
        self.frame = 1.0 / scene.render.fps
        self.rungs = ladder(self.prospects, options.choice)
        self.plan = Plan.of(self.prospects)
        self.outlook = Outlook.planned(self.prospects.assembly)
        self.frames = self._frames()
        self.samples = self._choose_samples()
        self.levels: dict[int, Record] = {}
        self.outcomes: dict[Settings, Outcome] = {}
        self.timings: dict[Settings, Timing] = {}
        self._whole, self._spent, self._part = math.inf, 0.0, 0.0

    @property
    def horizon(self) -> float:
        """Time that is looked at [s]."""
        return self.frames * self.frame

    def _frames(self) -> int:
        """Pictures that are looked at: as many as were asked for, or as fit the time that a study may take."""
        if self.options.horizon is not None:
            return max(1, round(self.options.horizon / self.frame))
        wanted = min(HORIZON, self.scene.duration)
        levels = self.plan.seconds * (2**_LEVELS - 1)
        whole = wanted * levels + sum(self.cost(settings, wanted) for settings in self.rungs)
        frames = math.ceil(wanted / self.frame - 1e-9)
        affordable = frames * _BUDGET / whole
        least = max(min(_FEWEST_FRAMES, frames), int(min(frames, affordable)))
        late = math.ceil(self.outlook.wanted(least * self.frame) / self.frame - 1e-9)
        return max(least, min(late, int(_LATE * affordable)))

    def _choose_samples(self) -> tuple[int, ...]:
        values = self.prospects.assembly.positions.size
        return even_samples(self.frames, max(4, min(24, 400_000 // max(values, 1))))

    def look_ahead(self, slots: Sequence[Slot]) -> None:
        """Find out when bodies meet; where it is late, and no horizon was asked for, look at as much as shows it."""
        if self.outlook.until >= self.scene.duration:
            return
        self.tell(0.0, "looking ahead")
        settings = self.prospects.own_settings()
        seconds = min(self.scene.duration, _LOOK_AHEAD / self.cost(settings, 1.0))
        frames = max(1, math.ceil(seconds / self.frame - 1e-9))
        threads = self.threads_of(settings.integrator)
        trial = Trial(settings.applied_to(self.scene), frames, (), self.options.arch, threads)

        def done(_: Job, result: tuple[tuple[Event, ...], float] | Failed) -> None:
            if not isinstance(result, Failed):
                self.outlook = self.outlook.with_meetings(*result)

        work_off(slots[:1], [look_ahead_job(trial)], done)
        self.frames = self._frames()
        self.samples = self._choose_samples()

    def cost(self, settings: Settings, horizon: float) -> float:
        """Estimated time of a run on one core [s]."""
        return run_seconds(self.prospects.of(settings.integrator), settings, horizon, self.scene.render.fps)

    def trial(self, settings: Settings) -> Trial:
        """The run of a setting."""
        cost = self.cost(settings, self.horizon)
        threads = self.threads_of(settings.integrator)
        return Trial(settings.applied_to(self.scene), self.frames, self.samples, self.options.arch, threads, cost)

    def threads_of(self, integrator: IntegratorName) -> int | None:
        """Threads of a run beside others.

        Where steps are taken serially anyway they are as many as in timed runs, which then find all compiled.
        """
        is_serial = self.prospects.assembly.work <= serial_work(SCHEMES[integrator])
        return self.options.threads if is_serial else 1

    # -- running --------------------------------------------------------------------------------------

    def run(self, slots: Sequence[Slot], rungs: Iterable[Settings], levels: Iterable[int] = ()) -> None:
        """Run trials and levels of the reference that are not known yet, side by side."""
        jobs, meaning = [], {}
        for level in levels:
            threads = self.threads_of(self.plan.integrator)
            trial = self.plan.trial(level, self.frames, self.samples, self.options.arch, threads)
            meaning[trial.key] = level, trial
            if (known := self.options.cache.load(trial)) is not None:
                self.levels[level] = known
            elif level not in self.levels:
                jobs.append(run_job(trial, _BESIDE))
        owners: dict[str, Settings] = {}
        for settings in rungs:
            trial = self.trial(settings)
            owners[trial.key] = settings
            if (outcome := self.store.outcome(trial.key)) is not None:
                self.outcomes[settings] = outcome
            elif settings not in self.outcomes:
                jobs.append(run_job(trial, _BESIDE))

        def done(job: Job, result: Outcome | Failed) -> None:
            outcome = outcome_of(result)
            if job.key in owners:
                self.outcomes[owners[job.key]] = outcome
                self.store.keep_outcome(job.key, outcome)
                self._advance(job, f"{owners[job.key].label}: {outcome.status}")
            else:
                level, trial = meaning[job.key]
                self._keep_level(level, trial, outcome)
                self._advance(job, f"reference, level {level}")

        work_off(slots, jobs, done)

    def _keep_level(self, level: int, trial: Trial, outcome: Outcome) -> None:
        if outcome.record is not None:
            self.levels[level] = outcome.record
            self.options.cache.save(trial, outcome.record)
        elif outcome.status is Status.CRASHED:
            raise SandboxError(f"the reference of the study failed: {outcome.message}")

    def time(self, slot: Slot, rungs: Iterable[Settings]) -> None:
        """Time trials, one after the other, on a machine that does nothing else."""
        jobs, owners = [], {}
        for settings in rungs:
            trial = self.trial(settings).on(self.options.threads)
            owners[trial.key] = settings
            if (known := self.store.timing(trial.key)) is not None:
                self.timings[settings] = known
            elif settings not in self.timings:
                jobs.append(timing_job(trial, _TIMING_MOST, timing_cost(trial.cost), RUN_MOST))

        def done(job: Job, result: Timing | Failed) -> None:
            timing = timing_of(result)
            self.timings[owners[job.key]] = timing
            self.store.keep_timing(job.key, timing)
            self._advance(job, f"timing {owners[job.key].label}")

        work_off([slot], jobs, done)

    def expect(self, seconds: float) -> None:
        """Say how much work there is in all [s], for progress."""
        self._whole = max(seconds, 1e-9)

    def _advance(self, job: Job, what: str) -> None:
        self._spent += job.cost
        self.tell(self._spent / self._whole, what)

    def tell(self, part: float, what: str) -> None:
        """Report what was done last, and the part of the work that is behind by now [1]; it never falls."""
        self._part = min(1.0, max(self._part, part))
        self.progress(self._part, what)

    # -- the reference --------------------------------------------------------------------------------

    def reference(self) -> Reference:
        """From the levels that are known. Raises DivergedError where no two of them followed the scene through."""
        finest = max(self.levels, default=0)
        if finest == 0 or finest - 1 not in self.levels:
            raise DivergedError(
                f"the scene has no reference: {self.plan.integrator} diverges in it at {self.plan.dt:.3g} s",
                time=0.0,
                stable_dt=math.nan,
            )
        return Reference.of(self.plan, self.scale, self.levels)

    def level_seconds(self, level: int) -> float:
        """Estimated time of a level of the reference on one core [s]; of all before it together, nearly."""
        return math.ldexp(self.plan.seconds * self.horizon, level)

    def first_levels(self) -> range:
        """Levels to be run beside the settings: some, and what more there is time for."""
        return range(_LEVELS + 1 if self.level_seconds(_LEVELS) <= _REFERENCE_BUDGET else _LEVELS)

    def refine(self, slots: Sequence[Slot], wanted: Callable[[], float], most_seconds: float) -> Reference:
        """Refine the reference until its bound is a tenth of the error that is ``wanted()``, or the time is over."""
        reference = self.reference()
        while not reference.tells(wanted()):
            level = reference.level + 1
            if self.level_seconds(level) > most_seconds:
                break
            self.run(slots, (), (level,))
            if level not in self.levels:
                break
            reference = self.reference()
        return reference

    # -- what runs are worth --------------------------------------------------------------------------

    def error(self, settings: Settings, reference: Reference) -> float:
        """Position error of a setting over the time that can be predicted [1]; nan where it has none."""
        outcome = self.outcomes[settings]
        if outcome.record is None:
            return math.nan
        return norms.rms(norms.errors_over_time(self.scale, outcome.record, reference.record)[: reference.agreed])

    def smallest_error(self, rungs: Iterable[Settings]) -> float:
        """Smallest position error of settings that have one, by the reference as it is now [1]; else infinity."""
        reference = self.reference()
        errors = [self.error(settings, reference) for settings in rungs]
        return min((error for error in errors if error > 0.0), default=math.inf)

    def row(self, settings: Settings, reference: Reference) -> Row:
        """All that is known of a setting."""
        outcome, timing = self.outcomes[settings], self.timings.get(settings, Timing())
        error, smallest = self.error(settings, reference), reference.smallest
        last = self.predictable_frames(reference)
        record = outcome.record
        return Row(
            settings=settings,
            status=outcome.status,
            message=outcome.message,
            error=max(error, smallest) if error == error else math.nan,
            resolved=not error < smallest,
            energy_error=math.nan if record is None else norms.energy_error(record, reference.record, last),
            statistics=NOTHING if record is None else self.compare(record, reference),
            seconds=timing.per_second,
            frame_95=timing.frame_quantile(0.95),
        )

    def predictable_frames(self, reference: Reference) -> int:
        """Pictures over which trajectories are compared."""
        return self.samples[reference.agreed - 1] if reference.agreed else 0

    def first_compared(self, reference: Reference) -> int:
        """First picture of statistics: past the time that can be predicted, or 0 where all of it can."""
        last = self.predictable_frames(reference)
        return last if last < self.frames else 0

    def compare(self, record: Record, reference: Reference) -> Statistics:
        """Statistics past the time that can be predicted, or of the whole where all of it can."""
        return norms.compare(self.scale, record, reference.record, self.first_compared(reference), self.frame)

    def trade(self, reference: Reference) -> Trade:
        """The study as it stands."""
        rows = [self.row(settings, reference) for settings in self.rungs if settings in self.outcomes]
        previous = self.levels[reference.level - 1]
        return Trade(
            scene=self.scene,
            rows=tuple(with_standing(rows)),
            reference=reference,
            horizon=self.horizon,
            predictable=self.predictable_frames(reference) * self.frame,
            statistics_bound=self.compare(previous, reference),
            unseen=self.unseen(reference),
        )

    def unseen(self, reference: Reference) -> tuple[str, ...]:
        """What happens in the scene and was not looked at, or is not predictable, a line each."""
        predictable = self.predictable_frames(reference) * self.frame
        return tuple(self.outlook.unseen(self.horizon, predictable, self.frame))


NOTHING = Statistics(**dict.fromkeys(STATISTICS, math.nan))
"""Statistics of a run that came to none."""


def measure(scene: Scene, options: Options, store: Store, progress: Progress = lambda *_: None) -> Trade:
    """Measure the trade of a scene.

    Raises SceneError where the scene cannot be built, DivergedError where it has no reference.
    """
    study = Study(scene, options, store, progress)
    rungs = study.rungs
    with open_crew(options.workers, options.cluster) as slots:
        study.look_ahead(slots)
        levels = study.first_levels()
        errors = sum(study.trial(settings).cost for settings in rungs)
        reference_seconds = study.level_seconds(len(levels)) - study.level_seconds(0)
        timings = sum(timing_cost(study.trial(settings).cost) for settings in rungs) if options.times else 0.0
        study.expect(errors + reference_seconds + timings)
        study.run(slots, rungs, levels)
        reference = study.refine(slots, lambda: study.smallest_error(rungs), _REFERENCE_BUDGET)
    if options.times:
        with open_crew(1) as slots:
            study.time(slots[0], [s for s in rungs if study.outcomes[s].status is Status.DONE])
    study.tell(1.0, "done")
    return study.trade(reference)


def timing_cost(run_cost: float) -> float:
    """About how long a trial is timed that runs for so long [s]."""
    return min(PASSES * run_cost, _TIMING_MOST) + 0.3
