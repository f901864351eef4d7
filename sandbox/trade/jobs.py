"""Runs and timings of trials as jobs for a crew, and what came of them."""

from sandbox.trade.crew import Failed, Job
from sandbox.trade.trial import Trial
from sandbox.trade.worker import Outcome, Status, Timing, look_ahead, run_trial, time_trial

PASSES = 3
"""Passes over the horizon that a timing makes, if they fit into its time."""
RUN_MOST = 120.0
"""Time after which a run counts as too slow, unless it was estimated to take a tenth of that and more [s]."""
GRACE = 120.0
"""What the process of a run may take longer [s]."""


def run_job(trial: Trial, more: float) -> Job:
    """The run of a trial; beside its own cost it takes about so much ``more`` [s]."""
    most = max(RUN_MOST, 10.0 * trial.cost)
    return Job(trial.key, trial.group, trial.cost + more, run_trial, (trial, most), most + GRACE)


def timing_job(trial: Trial, most_seconds: float, cost: float, timeout: float) -> Job:
    """The timing of a trial for about ``most_seconds``; it takes some ``cost`` in all, at most ``timeout`` [s]."""
    return Job(trial.key, trial.group, cost, time_trial, (trial, PASSES, most_seconds), timeout)


def look_ahead_job(trial: Trial) -> Job:
    """A run that tells when bodies meet."""
    return Job(f"{trial.key} ahead", trial.group, 0.0, look_ahead, (trial, RUN_MOST), RUN_MOST + GRACE)


def outcome_of(result: Outcome | Failed) -> Outcome:
    """What came of a run, whether or not its worker lived to tell."""
    return Outcome(Status.CRASHED, result.message) if isinstance(result, Failed) else result


def timing_of(result: Timing | Failed) -> Timing:
    """The same of a timing."""
    return Timing(message=result.message) if isinstance(result, Failed) else result
