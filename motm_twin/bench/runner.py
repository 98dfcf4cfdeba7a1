"""Runs the trials of a group on several processes, and keeps a broken trial from hiding the others."""

import platform
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import joblib
import msgspec

from motm_twin.bench.groups import Group, Result, Trial

LIMIT_S = 1800.0  # [s] of wall time per group; trials not done by then count as failed


def run_group(group: Group, workers: int, limit_s: float = LIMIT_S) -> Iterator[Result]:
    """Results in the order of the trials, each as soon as it and those before it are done."""
    deadline = time.monotonic() + limit_s
    jobs = 1 if group.alone else workers
    calls = (joblib.delayed(_run_until)(trial, deadline, run_one) for trial in group.trials)
    results: Any = joblib.Parallel(n_jobs=jobs, return_as="generator")(calls)
    yield from results


def run_one(trial: Trial) -> Result:
    """One trial."""
    from motm_twin.trial import run_trial  # the whole twin: only where a trial is run

    if trial.link is not None:
        from motm_twin.bench.external_trial import run_external

        in_process = run_trial(trial.scene, trial.variant, trial.seed)
        result = run_external(trial.scene, trial.variant, trial.link)
        return {**result, "in_process_s": in_process["time_s"], "link": msgspec.to_builtins(trial.link)}
    return run_trial(trial.scene, trial.variant, trial.seed)


def _run_until(trial: Trial, deadline: float, run: Callable[[Trial], Result]) -> Result:
    """One trial, or a failed result when the time is over or the trial broke."""
    if time.monotonic() > deadline:
        return failed(trial, f"not run: the group's limit of {LIMIT_S:.0f} s of wall time was over")
    try:
        return run(trial)
    except Exception as error:  # whatever broke in one trial, the others are still worth a table
        where = traceback.extract_tb(error.__traceback__)[-1]
        return failed(trial, f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})")


def failed(trial: Trial, reason: str) -> Result:
    """The result of a trial that gave none."""
    return {
        "scene": trial.scene,
        "variant": trial.variant,
        "seed": trial.seed,
        "success": False,
        "time_s": 0.0,
        "in_process_s": 0.0,
        "reference_tour_s": 0.0,
        "picks_done": 0,
        "picks_attempted": 0,
        "picks_total": 0,
        "places_done": 0,
        "contacts": [],
        "min_base_clearance_m": None,
        "min_arm_clearance_m": None,
        "min_ee_obstacle_m": None,
        "path_length_m": 0.0,
        "mean_closing_base_speed_mps": None,
        "reason": reason,
        "tick_ms": {"p50": float("nan"), "p99": float("nan"), "max": float("nan")},
        "realtime_factor": 0.0,
        "state_hash": f"none: {reason}",
    }


def machine() -> str:
    """Processor, number of cores and Python, for the table's caption."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].split(":", 1)[1].strip() if lines else model
    return f"{model}, {joblib.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"
