"""What a worker process does: runs trials, and times them; it keeps the last simulation for the next one like it."""

import math
import time as clock
from dataclasses import dataclass
from enum import StrEnum

from sandbox.errors import DivergedError, SandboxError
from sandbox.simulation import Simulation
from sandbox.trade.outlook import Event, meetings
from sandbox.trade.record import Record, record
from sandbox.trade.trial import Trial


class Status(StrEnum):
    """How a trial ended."""

    DONE = "done"
    DIVERGED = "diverged"
    SLOW = "too slow"
    REFUSED = "refused"
    CRASHED = "crashed"


@dataclass(frozen=True)
class Outcome:
    """What came of a trial."""

    status: Status
    message: str = ""
    record: Record | None = None
    seconds: float = 0.0
    """Wall time of its steps, where nobody took care to have the machine alone [s]."""


@dataclass(frozen=True)
class Timing:
    """Wall time of a trial's pictures, with the machine alone."""

    passes: tuple[tuple[float, ...], ...] = ()
    """Of every picture [s], by pass; the last ones of a slow trial are left out."""
    fps: float = 1.0
    message: str = ""
    """Why there is none."""

    @property
    def per_second(self) -> tuple[float, float, float]:
        """Least, median and most wall time of a simulated second [s] over the passes; nan without any."""
        values = sorted(self.fps * sum(frames) / len(frames) for frames in self.passes)
        if not values:
            return (math.nan,) * 3
        middle = 0.5 * (values[(len(values) - 1) // 2] + values[len(values) // 2])
        return values[0], middle, values[-1]

    def frame_quantile(self, part: float) -> float:
        """Wall time that this part of all pictures stays within [s]; nan without any."""
        frames = sorted(seconds for frames in self.passes for seconds in frames)
        return frames[min(len(frames) - 1, math.ceil(part * len(frames)) - 1)] if frames else math.nan


_FEWEST_PASSES = 2


@dataclass
class _Held:
    """The simulation of the last trial: another step is all that the next one needs of it, often."""

    group: str = ""
    simulation: Simulation | None = None

    def take(self, trial: Trial) -> Simulation:
        """A simulation at the start of a trial's scene."""
        dt = float(trial.scene.solver.dt)  # trials have steps, never "auto"
        if self.simulation is None or self.group != trial.group:
            self.drop()
            self.simulation = Simulation(trial.scene, arch=trial.arch, threads=trial.threads, warns=False)
            self.simulation.explains_failures = False
            self.group = trial.group
        else:
            self.simulation.restore()
        self.simulation.dt = dt
        return self.simulation

    def drop(self) -> None:
        """Let go of it."""
        if self.simulation is not None:
            self.simulation.close()
        self.simulation, self.group = None, ""


_held = _Held()


class _TooSlow(Exception):
    """A trial took longer than it may."""


def run_trial(trial: Trial, most_seconds: float) -> Outcome:
    """Run a trial from the start of its scene; whatever goes wrong is part of the outcome."""
    begun: list[float] = []

    def check() -> None:
        begun.append(clock.perf_counter())
        if begun[-1] - begun[0] > most_seconds:
            raise _TooSlow

    try:
        kept = record(_held.take(trial), trial, check)
    except DivergedError as error:
        return Outcome(Status.DIVERGED, str(error))
    except _TooSlow:
        return Outcome(Status.SLOW, f"took more than {most_seconds:.3g} s", seconds=most_seconds)
    except SandboxError as error:
        return Outcome(Status.REFUSED, str(error))
    # The first picture compiles; it says nothing of speed unless it is all there is.
    timed = begun[1:] or begun
    return Outcome(Status.DONE, record=kept, seconds=(clock.perf_counter() - timed[0]) * len(begun) / len(timed))


def look_ahead(trial: Trial, most_seconds: float) -> tuple[tuple[Event, ...], float]:
    """First meetings in a trial, and the time up to which it came in about ``most_seconds`` [s]."""
    begun: list[float] = []

    def check() -> bool:
        begun.append(clock.perf_counter())
        # The first picture compiles.
        return begun[-1] - begun[min(1, len(begun) - 1)] > most_seconds

    try:
        return meetings(_held.take(trial), trial.frames, check)
    except SandboxError:
        return (), 0.0


def time_trial(trial: Trial, passes: int, most_seconds: float) -> Timing:
    """Time a trial's pictures, compiled before, in about ``most_seconds``.

    Passes end early where all together would take longer. There are two at least: one alone tells nothing of how far
    times differ by chance.
    """
    taken: list[tuple[float, ...]] = []
    try:
        simulation = _held.take(trial)
        simulation.step_frame()  # compiles what is not compiled yet, and fills caches
        start = clock.perf_counter()
        for number in range(passes):
            simulation.restore()
            simulation.dt = float(trial.scene.solver.dt)
            now = clock.perf_counter()
            if number >= _FEWEST_PASSES and now - start > most_seconds * number / passes:
                break
            taken.append(_time_pass(simulation, trial.frames, now + most_seconds / passes))
    except SandboxError as error:
        return Timing(message=str(error))
    return Timing(tuple(taken), fps=trial.scene.render.fps)


def _time_pass(simulation: Simulation, frames: int, end: float) -> tuple[float, ...]:
    """Wall time of every picture until ``end`` on the clock [s], of the first one in any case."""
    taken: list[float] = []
    now = clock.perf_counter()
    while len(taken) < frames and (not taken or now < end):
        simulation.step_frame()
        simulation.measure()
        begun, now = now, clock.perf_counter()
        taken.append(now - begun)
    return tuple(taken)
