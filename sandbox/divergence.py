"""Looks for the first bad step of a run that went wrong, by taking the last ones again."""

from collections.abc import Callable

import numpy as np

from sandbox.diagnostics import Measurement
from sandbox.pipeline import Pipeline
from sandbox.postmortem import Failure
from sandbox.scene.assemble import Assembly


def first_bad_step(
    pipeline: Pipeline,
    assembly: Assembly,
    span: tuple[float, int, float],
    out_of_bounds: Callable[[Measurement], bool],
) -> tuple[float, Failure, bool, str | None]:
    """Time of the first bad step [s], its worst element, whether all is finite, and what a part says of it.

    ``span`` is the time [s] of the last good state, which the pipeline has kept, the number of steps since, and dt
    [s]. Leaves that state.
    """
    begun, steps, dt = span
    pipeline.restore()
    pipeline.alarm()  # that of the steps undone is no longer of interest
    good, good_memory = pipeline.state.read(), pipeline.memory()
    before, time = good[:2], begun
    for step in range(1, steps + 1):
        pipeline.stepper.advance(1, dt, time)
        time = begun + step * dt
        after = pipeline.state.read()[:2]
        alarm = pipeline.alarm()
        if out_of_bounds(pipeline.diagnostics.measure()) or alarm:
            break
        before = after
    finite = bool(np.isfinite(after[0]).all() and np.isfinite(after[1]).all())
    failure = Failure.of_state(assembly, *(after if finite else before))
    pipeline.state.write(*good)
    pipeline.remember(good_memory)
    return time, failure, finite, alarm
