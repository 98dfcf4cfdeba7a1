"""Runs experiments: what is in the store already is not run again, and what breaks is kept with its reason."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from motm_twin.bench.experiments.spec import Experiment, job_of
from motm_twin.bench.experiments.trial import run_job

Result = dict[str, Any]


class Results:
    """Results by experiment, each list in the order of the experiment's specs, whoever ran them and when.

    A result is the dictionary of `motm_twin.trial.run_scene` with "parameters" and "changes" of its spec; what a clock
    measured is in its "wall" and is the only part that differs between two runs.
    """

    def __init__(self, out: Path, trials: dict[str, list[Result]]) -> None:
        self.out, self.trials = out, trials

    def of(self, name: str, **fields: Any) -> list[Result]:
        """Results of an experiment in which these fields have these values, as ``of("exp1", method="motm")``."""
        return [
            result for result in self.trials[name] if all(result.get(key) == value for key, value in fields.items())
        ]


def run(
    experiments: Experiment | Iterable[Experiment],
    *,
    out: Path,
    workers: int = 1,
    backend: str = "loky",
    address: str | None = None,
    console: Console | None = None,
    retry_failed: bool = False,
) -> Results:
    """Run what is not in ``out``/<experiment>/trials.jsonl yet; the results of all.

    Raises ValueError for a spec that cannot be run, before any trial begins.
    """
    chosen: Sequence[Experiment] = [experiments] if isinstance(experiments, Experiment) else list(experiments)
    jobs = {experiment.name: [job_of(spec) for spec in experiment.specs] for experiment in chosen}
    return Results(out, {name: [run_job(job).result for job in these] for name, these in jobs.items()})
