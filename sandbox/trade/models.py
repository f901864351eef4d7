"""What a model leaves out: the time that is saved and the error that is made, part by part.

Every variant of a scene (:mod:`sandbox.trade.variants`) runs with the scene's own solver settings against the
reference of the whole scene. The whole scene with its own settings is the first row: its error is that of stepping
time; what a variant's error is beyond it comes of the model. Leaving out a part may allow longer steps, and so
dt = "auto" is looked up for each of them.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy import sparse

from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Scene
from sandbox.trade import norms
from sandbox.trade.correspondence import correspondence, mapped
from sandbox.trade.crew import Failed, Job, Slot, open_crew, work_off
from sandbox.trade.jobs import GRACE, RUN_MOST, outcome_of, run_job, timing_job, timing_of
from sandbox.trade.ladder import Choice, Prospect, Prospects, run_seconds, whole_steps
from sandbox.trade.measure import NOTHING, Options, Study
from sandbox.trade.norms import Scale, Statistics
from sandbox.trade.progress import Progress
from sandbox.trade.record import Record
from sandbox.trade.reference import Reference
from sandbox.trade.store import Store
from sandbox.trade.trial import Settings, Trial
from sandbox.trade.variants import Change, Variant, find_variants, variants
from sandbox.trade.wording import milliseconds, percent
from sandbox.trade.worker import Outcome, Status, Timing

WHOLE = "whole scene"
"""Name of the row of the scene itself."""
COLUMNS = ("model", "what", "ms/simulated s", "time saved", "dt [ms]", "error", "energy error", "centres", "shapes", "")
_HALVINGS = 3
"""How often the step of dt = "auto" is halved for a variant that diverges: a run of its own would adapt it."""
_LEVELS = 3
"""Levels of the reference that are run from the start."""
_REFERENCE_SECONDS = 40.0
"""Estimated time on one core beyond which no finer level is run [s]."""
_TIMING_MOST = 1.5
_COMPILING = 4.0
"""About how long it takes to compile a scene [s]; every variant is another one."""


@dataclass(frozen=True)
class ModelRow:
    """A model of the scene."""

    name: str
    what: str
    change: Change | None
    """None for the whole scene."""
    particles: int
    settings: Settings
    status: Status
    message: str
    seconds: tuple[float, float, float]
    """Least, median and most wall time of a simulated second [s]; nan where there is none."""
    saved: float
    """Part of the whole scene's median time that it does without [1]; negative where it takes longer."""
    error: float
    """Position error, in body sizes [1]; nan where there is none."""
    resolved: bool
    """False where the error is below what the reference tells apart: it is at most ``error`` then."""
    energy_error: float
    """[1]; nan where there is none."""
    statistics: Statistics

    def plain(self) -> dict[str, Any]:
        """As plain data, for CSV and JSON; times in seconds, errors as parts of one."""
        low, middle, high = self.seconds
        return {
            "model": self.name,
            "what": self.what,
            "change": "" if self.change is None else str(self.change),
            "particles": self.particles,
            "dt": self.settings.dt,
            "precision": str(self.settings.precision),
            "status": str(self.status),
            "seconds": middle,
            "seconds_low": low,
            "seconds_high": high,
            "saved": self.saved,
            "error": self.error,
            "error_is_bound": not self.resolved,
            "energy_error": self.energy_error,
            **{f"{name}_difference": value for name, value in asdict(self.statistics).items()},
            "message": self.message,
        }


@dataclass(frozen=True)
class ModelTrade:
    """What every part of a scene costs and is worth."""

    scene: Scene
    rows: tuple[ModelRow, ...]
    """The whole scene first."""
    variants: tuple[Variant, ...]
    """The scenes of the other rows, in their order."""
    left_out: tuple[str, ...]
    """One line for each part that could not be left out, with the reason."""
    reference: Reference
    horizon: float
    """Time that was looked at [s]."""
    predictable: float
    """Time over which two references agree, and trajectories are compared [s]."""
    smallest: float
    """Smallest position error that is told apart [1]."""
    statistics_bound: Statistics
    """How far two references are apart in what is compared beyond."""
    unseen: tuple[str, ...]
    """What happens in the scene and was not looked at, a line each."""

    def plain(self) -> dict[str, Any]:
        """As plain data, for JSON."""
        settings = self.reference.settings
        return {
            "horizon": self.horizon,
            "predictable": self.predictable,
            "reference": {"integrator": str(settings.integrator), "dt": settings.dt, "bound": self.reference.bound},
            "smallest_error": self.smallest,
            "statistics_bound": asdict(self.statistics_bound),
            "rows": [row.plain() for row in self.rows],
            "left_out": list(self.left_out),
            "warnings": list(self.unseen),
        }


@dataclass
class _Model:
    """A scene on its way to a row."""

    name: str
    what: str
    change: Change | None
    scene: Scene
    assembly: Assembly
    prospect: Prospect
    settings: Settings
    weights: sparse.csr_array | None
    """Of the whole scene's particles for each of its own; None where they are the same."""
    outcome: Outcome = field(default_factory=lambda: Outcome(Status.CRASHED))
    timing: Timing = field(default_factory=Timing)


class ModelStudy:
    """The models of a scene, run and timed.

    Raises SceneError where the scene cannot be built.
    """

    def __init__(self, scene: Scene, options: Options, store: Store, progress: Progress = lambda *_: None) -> None:
        own = replace(options, choice=Choice(schemes=(scene.solver.integrator,)))
        self.options, self.store, self.progress, self._part = options, store, progress, 0.0
        # The reference is the first third of the work, by count of what is run; no more is known before.
        self.study = Study(scene, own, store, lambda done, what: self._tell(done / 3.0, what))
        whole = self.study.prospects.assembly
        self.found = find_variants(whole)
        self.models = [self._model(WHOLE, "all parts of it", None, scene, self.study.prospects)]
        for variant in self.found.variants:
            prospects = Prospects(variant.scene)
            self.models.append(self._model(variant.name, variant.what, variant.change, variant.scene, prospects))
        self._steps, self._done = 2.0 * len(self.models), 0.0

    def _model(self, name: str, what: str, change: Change | None, scene: Scene, prospects: Prospects) -> _Model:
        whole, assembly, solver = self.study.prospects, prospects.assembly, scene.solver
        # Limits of large scenes take seconds to find.
        same = _same_network(whole.assembly, assembly)
        prospect = (whole if same else prospects).of(solver.integrator)
        dt = whole_steps(prospect.dt if solver.dt == "auto" else float(solver.dt), self.study.frame)
        return _Model(
            name=name,
            what=what,
            change=change,
            scene=scene,
            assembly=assembly,
            prospect=prospect,
            settings=Settings(solver.integrator, dt, solver.precision, solver.iterations),
            weights=correspondence(whole.assembly, assembly),
        )

    def trial(self, model: _Model) -> Trial:
        """The run of a model."""
        cost = run_seconds(model.prospect, model.settings, self.study.horizon, model.scene.render.fps)
        scene = model.settings.applied_to(model.scene)
        threads = self.study.threads_of(model.settings.integrator)
        return Trial(scene, self.study.frames, self.study.samples, self.options.arch, threads, cost)

    def run(self, slots: Sequence[Slot]) -> Reference:
        """Run all models, and the reference until it tells the whole scene's own error."""
        self.study.look_ahead(slots)
        self.study.expect(self.study.level_seconds(_LEVELS) + 0.5 * _LEVELS)
        self.study.run(slots, (), range(_LEVELS))
        self.study.reference()  # nothing is worth running without one
        self._run(slots, self.models)
        for _ in range(_HALVINGS):
            again = [model for model in self.models if self._may_halve(model)]
            for model in again:
                model.settings = replace(model.settings, dt=0.5 * model.settings.dt)
            self._run(slots, again)
        return self.study.refine(slots, self._own_error, _REFERENCE_SECONDS)

    def _run(self, slots: Sequence[Slot], models: Sequence[_Model]) -> None:
        jobs, owners = [], {}
        for model in models:
            trial = self.trial(model)
            if (known := self.store.outcome(trial.key)) is not None:
                model.outcome = known
            else:
                owners[trial.key] = model
                jobs.append(run_job(trial, _COMPILING))

        def done(job: Job, result: Outcome | Failed) -> None:
            model = owners[job.key]
            model.outcome = outcome_of(result)
            self.store.keep_outcome(job.key, model.outcome)
            self._advance(f"{model.name}: {model.outcome.status}")

        work_off(slots, jobs, done)

    @staticmethod
    def _may_halve(model: _Model) -> bool:
        return model.outcome.status is Status.DIVERGED and model.scene.solver.dt == "auto"

    def _own_error(self) -> float:
        error = self._error(self.models[0], self.study.reference())
        return error if error > 0.0 else math.inf

    def time(self, slot: Slot) -> None:
        """Time the models that came through, one after the other, on a machine that does nothing else."""
        jobs, owners = [], {}
        for model in self.models:
            trial = self.trial(model).on(self.options.threads)
            if (known := self.store.timing(trial.key)) is not None:
                model.timing = known
            elif model.outcome.record is not None:
                owners[trial.key] = model
                jobs.append(timing_job(trial, _TIMING_MOST, _COMPILING, RUN_MOST + GRACE))

        def done(job: Job, result: Timing | Failed) -> None:
            timing = timing_of(result)
            owners[job.key].timing = timing
            self.store.keep_timing(job.key, timing)
            self._advance(f"timing {owners[job.key].name}")

        work_off([slot], jobs, done)

    def _advance(self, what: str) -> None:
        self._done += 1.0
        self._tell(min(1.0, (1.0 + 2.0 * self._done / self._steps) / 3.0), what)

    def _tell(self, part: float, what: str) -> None:
        self._part = max(self._part, part)
        self.progress(self._part, what)

    # -- what models are worth --------------------------------------------------------------------------

    def _error(self, model: _Model, reference: Reference) -> float:
        """Position error over the time that can be predicted [1]; nan where there is none."""
        run = model.outcome.record
        if run is None:
            return math.nan
        scale, seen = Scale.of(model.assembly), mapped(reference.record, run, model.weights)
        return norms.rms(norms.errors_over_time(scale, run, seen)[: reference.agreed])

    def _compared(self, model: _Model, run: Record, reference: Reference) -> tuple[float, Statistics]:
        """Energy error, and statistics past the time that can be predicted or of the whole where all of it can."""
        seen = mapped(reference.record, run, model.weights)
        first, last = self.study.first_compared(reference), self.study.predictable_frames(reference)
        statistics = norms.compare(Scale.of(model.assembly), run, seen, first, self.study.frame)
        return norms.energy_error(run, seen, last), statistics

    def trade(self, reference: Reference) -> ModelTrade:
        """The study as it stands."""
        base = self.study.trade(reference)
        return ModelTrade(
            scene=self.study.scene,
            rows=tuple(self._row(model, reference, base.smallest) for model in self.models),
            variants=self.found.variants,
            left_out=self.found.left_out,
            reference=reference,
            horizon=base.horizon,
            predictable=base.predictable,
            smallest=base.smallest,
            statistics_bound=base.statistics_bound,
            unseen=base.unseen,
        )

    def _row(self, model: _Model, reference: Reference, smallest: float) -> ModelRow:
        error, record = self._error(model, reference), model.outcome.record
        energy_error, statistics = (math.nan, NOTHING) if record is None else self._compared(model, record, reference)
        seconds = model.timing.per_second
        return ModelRow(
            name=model.name,
            what=model.what,
            change=model.change,
            particles=model.assembly.particle_count,
            settings=model.settings,
            status=model.outcome.status,
            message=model.outcome.message or model.timing.message,
            seconds=seconds,
            saved=1.0 - seconds[1] / self.models[0].timing.per_second[1],
            error=max(error, smallest) if error == error else math.nan,
            resolved=not error < smallest,
            energy_error=energy_error,
            statistics=statistics,
        )


def _same_network(one: Assembly, other: Assembly) -> bool:
    """Whether two scenes allow the same steps: the same particles, held by the same springs, and gas in the same
    bodies."""
    if one.particle_count != other.particle_count or one.spring_count != other.spring_count:
        return False
    ours, theirs = one.spring_set, other.spring_set
    pairs = [(getattr(ours, name), getattr(theirs, name)) for name in ("ends", "rest_lengths", "stiffness", "damping")]
    pairs += [(one.positions, other.positions), (one.inverse_masses, other.inverse_masses)]
    return one.gases == other.gases and all(np.array_equal(a, b) for a, b in pairs)


def measure_models(scene: Scene, options: Options, store: Store, progress: Progress = lambda *_: None) -> ModelTrade:
    """Measure what every part of a scene costs and is worth, with the scene's own solver settings.

    Raises SceneError where the scene cannot be built, DivergedError where it has no reference.
    """
    study = ModelStudy(scene, options, store, progress)
    with open_crew(options.workers, options.cluster) as slots:
        reference = study.run(slots)
    if options.times:
        with open_crew(1) as slots:
            study.time(slots[0])
    progress(1.0, "done")
    return study.trade(reference)


def table(trade: ModelTrade) -> list[tuple[str, ...]]:
    """Rows as text under COLUMNS: the whole scene, then what saves most; what came to nothing at the end."""
    whole, *others = trade.rows
    others.sort(key=lambda row: (row.status is not Status.DONE, math.isnan(row.saved), -row.saved))
    return [_cells(row) for row in (whole, *others)]


def _cells(row: ModelRow) -> tuple[str, ...]:
    return (
        row.name,
        row.what,
        milliseconds(row.seconds),
        "" if row.change is None or math.isnan(row.saved) else f"{100.0 * row.saved:+.0f} %",
        f"{1e3 * row.settings.dt:.4g}",
        ("" if row.resolved or math.isnan(row.error) else "< ") + percent(row.error),
        percent(row.energy_error),
        percent(row.statistics.centre),
        percent(row.statistics.shape),
        "" if row.status is Status.DONE else str(row.status),
    )


__all__ = ["COLUMNS", "ModelRow", "ModelStudy", "ModelTrade", "Variant", "measure_models", "table", "variants"]
