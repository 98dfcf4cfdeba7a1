"""Runs the trials of a group on several processes, and keeps a broken trial from hiding the others."""

import time
from collections.abc import Iterator

import msgspec

from motm_twin.bench.experiments.pool import Lost, local_pool, outcomes
from motm_twin.bench.experiments.spec import TrialSpec, job_of
from motm_twin.bench.experiments.trial import broken, run_job
from motm_twin.bench.groups import Group, Result, Trial
from motm_twin.bench.machine import machine

__all__ = ["LIMIT_S", "failed", "machine", "run_group", "run_one"]

LIMIT_S = 1800.0  # [s] of wall time per group; trials not done by then count as failed


def run_group(group: Group, workers: int, limit_s: float = LIMIT_S) -> Iterator[Result]:
    """Results in the order of the trials, each as soon as it and those before it are done."""
    deadline = time.monotonic() + limit_s
    calls = [(trial, deadline) for trial in group.trials]
    done: dict[int, Result] = {}
    following = 0
    for index, outcome in outcomes(_run_until, calls, local_pool(1 if group.alone else workers)):
        done[index] = failed(group.trials[index], outcome.reason) if isinstance(outcome, Lost) else outcome
        while following in done:
            yield done.pop(following)
            following += 1


def run_one(trial: Trial) -> Result:
    """One trial; one that breaks gives a failed result."""
    spec = TrialSpec(trial.scene, trial.variant, trial.seed)
    result = run_job(job_of(spec)).result
    result = {**result, **result["wall"]} if "tick_ms" in result["wall"] else failed(trial, result["reason"])
    if trial.link is None:
        return result
    from motm_twin.bench.external_trial import run_external  # the bus: only where a robot is elsewhere

    outside = run_external(trial.scene, trial.variant, trial.link, method=spec.method)
    return {**outside, "in_process_s": result["time_s"], "link": msgspec.to_builtins(trial.link)}


def _run_until(call: tuple[Trial, float]) -> Result:
    """One trial, or a failed result when the time is over or the trial broke."""
    trial, deadline = call
    if time.monotonic() > deadline:
        return failed(trial, f"not run: the group's limit of {LIMIT_S:.0f} s of wall time was over")
    try:
        return run_one(trial)
    except Exception as error:  # of the robot in another process; the others are still worth a table
        return failed(trial, f"{type(error).__name__}: {error}")


def failed(trial: Trial, reason: str) -> Result:
    """The result of a trial that gave none."""
    nan = float("nan")
    return {
        **broken(job_of(TrialSpec(trial.scene, trial.variant, trial.seed)), reason),
        "in_process_s": 0.0,
        "reference_tour_s": 0.0,
        "tick_ms": {"p50": nan, "p99": nan, "max": nan},
        "realtime_factor": 0.0,
        "state_hash": f"none: {reason}",
    }
