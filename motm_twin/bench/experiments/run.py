"""Runs experiments: what is in the store already is not run again, and what breaks is kept with its reason."""

import signal
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console

from motm_twin.bench.experiments.pool import Lost, make_pool, outcomes
from motm_twin.bench.experiments.progress import Bar
from motm_twin.bench.experiments.spec import Experiment, Job, jobs_of
from motm_twin.bench.experiments.store import Record, Store
from motm_twin.bench.experiments.trial import Outcome, given_up, run_job
from motm_twin.record.made_with import SOURCE, made_with

Result = dict[str, Any]


@dataclass
class Results:
    """Results by experiment, each list in the order of the experiment's specs, whoever ran them and when.

    A result is the dictionary of `motm_twin.trial.run_scene` with "parameters" and "changes" of its spec; what a clock
    measured is in its "wall", the only part that differs between two runs.
    """

    out: Path
    trials: dict[str, list[Result]]
    computed: int = 0  # trials that were run now; the others were in the store
    notes: list[str] = field(default_factory=list)  # what whoever reads the results should know

    def of(self, name: str, **fields: Any) -> list[Result]:
        """Results of an experiment in which these fields have these values, as ``of("exp1", method="motm")``."""
        return [
            result for result in self.trials[name] if all(result.get(key) == value for key, value in fields.items())
        ]


@dataclass
class _Task:
    """A trial that has to be run, and the places in the experiments that want it."""

    job: Job
    places: list[tuple[str, int]] = field(default_factory=list)  # experiment, index


def run(
    experiments: Experiment | Iterable[Experiment],
    *,
    out: Path,
    workers: int = 1,
    backend: str = "loky",
    address: str | None = None,
    console: Console | None = None,
    retry_failed: bool = False,
    about: Mapping[str, str] | None = None,
) -> Results:
    """Run what is not in ``out``/<experiment>/trials.jsonl yet; the results of all.

    After Ctrl-C or SIGTERM (KeyboardInterrupt) or a crash the same call goes on where it ended. ``retry_failed`` runs
    trials again that were without success. ``backend`` "ray" needs the extra ``cluster``; ``address`` is the cluster's.
    ``about``: what is kept with every trial that is run now, beside what it was made with.
    Raises ValueError for a spec that cannot be run, before any trial begins.
    """
    chosen = [experiments] if isinstance(experiments, Experiment) else list(experiments)
    jobs = {experiment.name: jobs_of(experiment.specs) for experiment in chosen}
    if len(jobs) < len(chosen):
        raise ValueError("two experiments have the same name: results are kept by name")
    source = made_with()[SOURCE]
    results = Results(out, {name: [{} for _ in these] for name, these in jobs.items()})
    with ExitStack() as stack:
        stack.enter_context(_sigterm_as_ctrl_c())
        stores = {name: stack.enter_context(Store(out / name)) for name in jobs}
        tasks = _missing(jobs, stores, results, source, retry_failed=retry_failed)
        if tasks:
            pool = make_pool(workers, backend, address)
            methods = [task.job.spec.method for task in tasks]
            bar = stack.enter_context(Bar(methods, pool.processes(), console or Console(quiet=True)))
            for number, outcome in outcomes(run_job, [task.job for task in tasks], pool, bar.say):
                _keep(tasks[number], outcome, stores, results, source, bar, about or {})
        for name, store in stores.items():
            store.write_results(results.trials[name])
    return results


@contextmanager
def _sigterm_as_ctrl_c() -> Iterator[None]:
    """Whoever is told to end ends the processes that work for it, too."""
    if threading.current_thread() is not threading.main_thread():  # signals are not for this one
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _missing(
    jobs: Mapping[str, list[Job]], stores: Mapping[str, Store], results: Results, source: str, *, retry_failed: bool
) -> list[_Task]:
    """The trials that are in no store, each once. The results of the others are taken from where they are."""
    known = {name: store.read() for name, store in stores.items()}
    tasks: dict[str, _Task] = {}
    for name, these in jobs.items():
        for index, job in enumerate(these):
            key = job.key(source)
            owner = next((other for other in (name, *known) if key in known[other]), None)
            record = known[owner][key] if owner is not None else None
            if record is None or (retry_failed and not record.result["success"]):
                tasks.setdefault(key, _Task(job)).places.append((name, index))
                continue
            results.trials[name][index] = record.result
            if owner != name:
                session = record.session and f"../{owner}/{record.session}"
                known[name][key] = msgspec.structs.replace(record, session=session)
                stores[name].append(known[name][key])
    return list(tasks.values())


def _keep(
    task: _Task,
    outcome: Outcome | Lost,
    stores: Mapping[str, Store],
    results: Results,
    source: str,
    bar: Bar,
    about: Mapping[str, str],
) -> None:
    """Write a finished trial down, and say what was not as it should be."""
    lost = isinstance(outcome, Lost)
    whole = given_up(task.job, outcome.reason, source) if isinstance(outcome, Lost) else outcome
    if whole.source != source and not results.notes:
        results.notes.append("the source was changed while trials ran: those of the new one are run again next time")
        bar.say(results.notes[-1])
    key = task.job.key(whole.source)
    result = msgspec.json.decode(msgspec.json.encode(whole.result))  # as it will be when it is read again
    record = Record(key=key, spec=task.job.spec, result=result, made_with={**whole.made_with, **about})
    kept = ""
    for name in dict(task.places):
        session = stores[name].keep_session(key, whole.session)
        stores[name].append(msgspec.structs.replace(record, session=session))
        kept = kept or (session and str(stores[name].folder / session))
    for name, index in task.places:
        results.trials[name][index] = result
    results.computed += 1
    if not result["success"]:
        what = f"{result['scene']}/{result['variant']} seed {result['seed']} {result['method']}"
        bar.say(f"{what}: {result['reason']} ({kept})")
    bar.add(task.job.spec.method, None if lost else result["wall"]["seconds"])
