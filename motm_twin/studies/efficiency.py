"""Efficiency of more processes on this machine: trials per core-hour with one process, two, and so on."""

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console

from motm_twin.perf.report import Limit, Report, conclude
from motm_twin.studies.pool import Lost, Pool, local_pool, outcomes
from motm_twin.studies.spec import Job, TrialSpec, job_of
from motm_twin.studies.trial import run_job

NAME = "efficiency"
TITLE = "Trials of Experiment 1 on one process, two, and so on"
LIMITS = {"lost": Limit(name="efficiency lost on all processes", unit="%", limit=10.0, decimals=1)}
ROUNDS = 3  # trials per process: the last ones do not end together, which costs up to one trial's spread
MILLION = 1_000_000
HOUR = 3600.0  # [s]


def bench_efficiency(out: Path, workers: int, console: Console) -> bool:
    """Measure and print; True when at most 10 % are lost on ``workers`` processes. Nothing else may run meanwhile."""
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    report = Report()
    specs = [TrialSpec("exp1", "random", seed) for seed in range(ROUNDS)]
    rates: dict[int, float] = {}
    for count in counts(workers):
        rates[count] = trials_per_hour(specs, count)
        share = rates[count] / (count * rates[1])
        report.details[f"{count} processes"] = {
            "trials_per_hour": rates[count],
            "trials_per_core_hour": rates[count] / count,
            "efficiency": share,
            "days_for_a_million": MILLION / rates[count] / 24.0,
        }
        console.print(f"  {count} processes: {rates[count]:.0f} trials/h, efficiency {100 * share:.1f} %", markup=False)
    report.values["lost"] = 100.0 * (1.0 - rates[workers] / (workers * rates[1])) if rates else math.nan
    return conclude(NAME, TITLE, LIMITS, report, out, console)


def counts(workers: int) -> Iterator[int]:
    """1, 2, 4, ... and ``workers``."""
    count = 1
    while count < workers:
        yield count
        count *= 2
    yield workers


def trials_per_hour(specs: Sequence[TrialSpec], processes: int) -> float:
    """Trials done per hour of wall time by processes that are warm: each process runs every spec once.

    Every process runs the same trials as often, so that the work per process is the same for any number of them.
    """
    jobs = [job_of(spec) for spec in specs]
    pool, there = local_pool(processes), max(2, processes)  # a pool has at least two processes; one may wait
    _all(jobs[:1] * there, local_pool(there))  # imports, and kernels from the cache
    began = time.perf_counter()
    done = _all([job for job in jobs for _ in range(processes)], pool)
    return done * HOUR / (time.perf_counter() - began)


def _all(jobs: list[Job], pool: Pool) -> int:
    """Run them; how many there were. Raises RuntimeError for one that broke: its time would mean nothing."""
    for index, outcome in outcomes(run_job, jobs, pool):
        if isinstance(outcome, Lost) or not outcome.result["success"]:
            reason = outcome.reason if isinstance(outcome, Lost) else outcome.result["reason"]
            raise RuntimeError(f"{jobs[index].scene.name} seed {jobs[index].scene.seed}: {reason}")
    return len(jobs)
