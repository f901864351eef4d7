"""How a run goes: a progress bar on standard error, with how fast against real time, and where its time went."""

import contextlib
import time as clock
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median
from types import TracebackType
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn


class ProgressReport(Protocol):
    """Is told of simulated time as it passes."""

    def update(self, simulated: float, real_time_factor: float) -> None: ...


class NoProgress:
    """Says nothing."""

    def update(self, simulated: float, real_time_factor: float) -> None:
        """Ignore progress."""


class ProgressBar:
    """Live bar; where standard error is no terminal, one line at the end."""

    def __init__(self, title: str, seconds: float) -> None:
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),  # a title is no markup
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[simulated]:.2f} s simulated, {task.fields[factor]:.2f}x real time, left"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
        )
        self._task = self._progress.add_task(title, total=seconds, simulated=0.0, factor=0.0)

        self._started = False

    def __enter__(self) -> "ProgressBar":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._started:
            self._progress.stop()

    def update(self, simulated: float, real_time_factor: float) -> None:
        """Show ``simulated`` [s] as done, at ``real_time_factor`` simulated seconds a second."""
        # Not before there is something to show: a wrong input is one line, without a bar above it.
        if not self._started:
            self._progress.start()
            self._started = True
        self._progress.update(self._task, completed=simulated, simulated=simulated, factor=real_time_factor)


@dataclass
class Timings:
    """Wall time of the parts of a run [s]."""

    setup: float = 0.0
    """Building the simulation and the renderer, less what the first picture then compiles."""
    first_step: float = 0.0
    """From the start of the run to the first simulated picture, compilation included."""
    simulate: list[float] = field(default_factory=list)
    render: list[float] = field(default_factory=list)
    encode: list[float] = field(default_factory=list)
    export: list[float] = field(default_factory=list)
    """Trajectory and mesh files."""
    keep: list[float] = field(default_factory=list)
    """Checkpoints on the way."""

    @contextlib.contextmanager
    def measure(self, part: str) -> Iterator[None]:
        """Add the block's wall time to ``part``."""
        start = clock.perf_counter()
        yield
        getattr(self, part).append(clock.perf_counter() - start)

    def summary(self, total: float) -> dict[str, float]:
        """Seconds a part; medians leave out the first picture, which compiles."""
        table = {"setup": self.setup, "first_step": self.first_step, "total": total}
        for part in ("simulate", "render", "encode", "keep", *(["export"] if self.export else [])):
            values = getattr(self, part)
            table[part] = sum(values)
            table[f"{part}_median_per_picture"] = median(values[1:] or values or [0.0])
        return table
