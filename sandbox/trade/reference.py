"""What settings are measured against: one run in double precision, refined until halving its step changes little.

Level k takes 2^k times as many steps a picture as level 0. The bound of a level's error is what the last halving
changed, and more where the error falls by less than half from level to level: d / (2^p - 1) for the order p that the
last two differences show, at every sample by itself. Levels are kept on disk, under a name that changes with the
scene and the engine.
"""

import contextlib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

from sandbox.scene.model import IntegratorName, Precision, Scene
from sandbox.trade import norms
from sandbox.trade.ladder import Prospects, whole_steps
from sandbox.trade.norms import FloatArray, Scale
from sandbox.trade.record import Record
from sandbox.trade.trial import Settings, Trial

STIFF = 100.0
"""The reference is of the implicit midpoint rule where it may step so much further than rk4 is stable at [1]."""
_IMPLICIT_ACCURACY = 1e-4
_LEAST_ORDER = 0.25
"""Order below which halvings are taken to lead nowhere [1]."""
_NOTHING = 1e-300
_NEGLIGIBLE = 1e-9
"""Bound that is good enough for anything: f64 rounds not far below [1]."""
_SMALLEST = 10.0
"""Smallest error that is told apart, in bounds of the reference's own [1]."""
_MOST_CACHE = 2e9
"""Size of all levels on disk beyond which the oldest go [bytes]."""


@dataclass(frozen=True)
class Plan:
    """How the reference of a scene is made."""

    scene: Scene
    integrator: IntegratorName
    dt: float
    """Step of level 0 [s]."""
    seconds: float
    """Estimated time of a simulated second at level 0, on one core [s]."""

    @classmethod
    def of(cls, prospects: Prospects) -> "Plan":
        """rk4, at half of what dt = "auto" would take; the implicit midpoint rule for stiff scenes."""
        frame = 1.0 / prospects.scene.render.fps
        chosen = prospects.of(IntegratorName.RK4)
        dt = 0.5 * chosen.dt
        accurate = prospects.accurate_step(IntegratorName.IMPLICIT_MIDPOINT, _IMPLICIT_ACCURACY)
        if math.isfinite(accurate) and accurate > STIFF * dt:
            chosen, dt = prospects.of(IntegratorName.IMPLICIT_MIDPOINT), accurate
        dt = whole_steps(dt, frame)
        return cls(prospects.scene, chosen.integrator, dt, chosen.seconds(dt, None))

    def settings(self, level: int) -> Settings:
        """Those of a level."""
        return Settings(self.integrator, self.dt / 2**level, Precision.F64)

    def trial(self, level: int, frames: int, samples: tuple[int, ...], arch: str, threads: int | None = 1) -> Trial:
        """The run of a level."""
        scene = self.settings(level).applied_to(self.scene)
        if self.integrator is IntegratorName.IMPLICIT_MIDPOINT:
            solver = scene.solver.model_copy(update={"tolerance": 1e-10, "iterations": 50})
            scene = scene.model_copy(update={"solver": solver})
        return Trial(scene, frames, samples, arch, threads, self.seconds * 2**level * frames / scene.render.fps)


@dataclass(frozen=True)
class Reference:
    """The finest level, and how far it can be trusted."""

    record: Record
    settings: Settings
    level: int
    agreed: int
    """Samples up to which the last two levels agree; trajectories are compared up to there."""
    bound: float
    """Bound of its own position error over those samples [1]."""
    differences: tuple[float, ...]
    """What every halving changed over those samples [1]."""

    @property
    def smallest(self) -> float:
        """Smallest position error of others that it tells apart [1]."""
        return _SMALLEST * max(self.bound, _NEGLIGIBLE)

    def tells(self, error: float) -> bool:
        """Whether it tells such an error of others apart [1], or no refinement would."""
        return self.bound <= max(error / _SMALLEST, _NEGLIGIBLE)

    @classmethod
    def of(cls, plan: Plan, scale: Scale, levels: dict[int, Record]) -> "Reference":
        """From the records of two levels or more, of which the finest follow one another."""
        finest = max(levels)
        numbers = sorted(level for level in levels if all(k in levels for k in range(level, finest)))
        over_time = [norms.errors_over_time(scale, levels[k], levels[k - 1]) for k in numbers[1:]]
        bounds = _bounds(over_time)
        agreed = norms.agreeing(bounds)
        return cls(
            record=levels[finest],
            settings=plan.settings(finest),
            level=finest,
            agreed=agreed,
            bound=norms.rms(bounds[:agreed]) if agreed else math.inf,
            differences=tuple(norms.rms(errors[:agreed]) for errors in over_time),
        )


def _bounds(differences: list[FloatArray]) -> FloatArray:
    """Bound of the finest level's error at every sample from what each halving changed there."""
    last = differences[-1]
    if len(differences) == 1:
        return last
    order = np.log2(np.maximum(differences[-2], _NOTHING) / np.maximum(last, _NOTHING))
    return last * np.maximum(1.0, 1.0 / (np.exp2(np.maximum(order, _LEAST_ORDER)) - 1.0))


class Cache:
    """Levels on disk."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder or user_cache_path("softbody-sandbox") / "references"

    def load(self, trial: Trial) -> Record | None:
        """The record of a level; None where it is not there."""
        with contextlib.suppress(OSError, ValueError, KeyError):
            path = self._path(trial)
            found = Record.load(path)
            path.touch()
            return found
        return None

    def save(self, trial: Trial, record: Record) -> None:
        """Keep it; a disk that is full or forbidden costs time later, and nothing else."""
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            record.save(self._path(trial))
            self._shrink()

    def _path(self, trial: Trial) -> Path:
        return self.folder / f"{trial.key}.npz"

    def _shrink(self) -> None:
        files = sorted(self.folder.glob("*.npz"), key=lambda path: -path.stat().st_mtime)
        sizes = np.cumsum([path.stat().st_size for path in files])
        for path, size in zip(files, sizes, strict=True):
            if size > _MOST_CACHE:
                path.unlink(missing_ok=True)
