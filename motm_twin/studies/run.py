"""Runs experiments and keeps finished trials on disk: a trial in the store is not run again.

One JSON line per trial, flushed to disk before the next one counts. A line truncated by a crash is dropped; all lines
before it are kept. One process writes at a time. A failed trial is stored with its reason.
"""

import fcntl
import os
import signal
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import msgspec
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from motm_twin.processes import handled
from motm_twin.sessions.session import SOURCE, Session, made_with, save_session
from motm_twin.studies.pool import Lost, make_pool, outcomes
from motm_twin.studies.spec import Experiment, Job, Outcome, TrialSpec, given_up, jobs_of, run_job

TRIALS = "trials.jsonl"
RESULTS = "results.jsonl"
SESSIONS = "sessions"


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the store."""

    key: str  # from `Job.key`
    spec: TrialSpec
    result: dict[str, Any]  # "wall" has the wall-clock measurements
    session: str = ""  # file beside the store for `motm-twin rerun`, of a trial without success
    made_with: dict[str, str]  # versions and machine of the run


class Store:
    """The trials of one experiment in its own folder, which is created if missing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / TRIALS

    def read(self) -> dict[str, Record]:
        """Records by key; the newer one of two with the same key."""
        if not self.path.is_file():
            return {}
        found = (_decoded(line) for line in self.path.read_bytes().split(b"\n"))
        return {record.key: record for record in found if record is not None}

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("a+b")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.close()
            message = f"{self.path}: another run writes to it now; wait for it, or give another --out"
            raise ValueError(message) from error
        data = self.path.read_bytes()
        if data and not data.endswith(b"\n"):  # a truncated line
            self._file.truncate(data.rfind(b"\n") + 1)
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def append(self, record: Record) -> None:
        """Add a record; when this returns it is on the disk."""
        self._file.write(msgspec.json.encode(record) + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def keep_session(self, key: str, session: Session | None) -> str:
        """Save the session of a failed trial; its name relative to the folder, "" for none."""
        if session is None:
            return ""
        name = f"{SESSIONS}/{key}.json"
        (self.folder / SESSIONS).mkdir(exist_ok=True)
        save_session(session, self.folder / name)
        return name

    def write_results(self, results: list[dict[str, Any]]) -> None:
        """Write all results in the experiment's order, without wall-clock times: equal runs give equal files."""
        lines = [{key: value for key, value in result.items() if key != "wall"} for result in results]
        text = b"".join(msgspec.json.encode(line, order="sorted") + b"\n" for line in lines)
        temporary = self.folder / f".{RESULTS}"
        temporary.write_bytes(text)
        temporary.replace(self.folder / RESULTS)


def _decoded(line: bytes) -> Record | None:
    try:
        return msgspec.json.decode(line, type=Record) if line else None
    except msgspec.MsgspecError:
        return None  # truncated, or of another version: the trial is run again


HOUR, MINUTE = 3600, 60  # [s]


@dataclass
class TimeLeft:
    """Estimate of the remaining time, from the mean time of done trials of the same method."""

    workers: int
    remaining: Counter[str]  # method: number of trials
    seconds: dict[str, list[float]] = field(default_factory=dict)

    def add(self, method: str, seconds: float | None) -> None:
        """Count a done trial; ``seconds``: its time, None if it has none."""
        self.remaining[method] -= 1
        if seconds is not None:
            self.seconds.setdefault(method, []).append(seconds)

    def left(self) -> float | None:
        """Seconds of wall time; None before the first trial is done. Methods without a time count as the mean."""
        measured = {method: sum(values) / len(values) for method, values in self.seconds.items()}
        if not measured:
            return None
        mean = sum(measured.values()) / len(measured)
        whole = sum(count * measured.get(method, mean) for method, count in self.remaining.items())
        return whole / self.workers


class Bar:
    """A progress bar on the console while it is a terminal; without one, a line for every further tenth."""

    def __init__(self, methods: Iterable[str], workers: int, console: Console) -> None:
        self.time = TimeLeft(workers, Counter(methods))
        self.total = self.time.remaining.total()
        self.done = 0
        self.console = console
        columns = (TextColumn("  trials"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[left]}"))
        self.progress = Progress(*columns, console=console, disable=not console.is_terminal)
        self._task = self.progress.add_task("", total=self.total, left="")

    def add(self, method: str, seconds: float | None) -> None:
        """Count a done trial."""
        self.time.add(method, seconds)
        self.done += 1
        left = left_text(self.time.left())
        self.progress.update(self._task, completed=self.done, left=left)
        tenth = max(1, self.total // 10)
        if not self.console.is_terminal and (self.done % tenth == 0 or self.done == self.total):
            self.console.print(f"  {self.done}/{self.total} trials {left}".rstrip(), markup=False)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self.console.print(f"  {text}", style="yellow", markup=False, soft_wrap=True)


def left_text(seconds: float | None) -> str:
    """'1 h 05 min left'; "" while unknown."""
    if seconds is None:
        return ""
    if seconds >= HOUR:
        return f"{int(seconds // HOUR)} h {int(seconds % HOUR // MINUTE):02d} min left"
    return f"{int(seconds // MINUTE)} min {int(seconds % MINUTE):02d} s left"


Result = dict[str, Any]


def chosen(results: Iterable[Result], fields: Mapping[str, Any]) -> list[Result]:
    """The results in which these fields have these values."""
    return [result for result in results if all(result.get(key) == value for key, value in fields.items())]


@dataclass
class Results:
    """Results by experiment, each list in the order of the experiment's specs, from this or earlier runs.

    A result is the dictionary of `motm_twin.trial.run_scene` with "parameters" and "changes" of its spec; wall-clock
    measurements are in its "wall", the only part that differs between two runs.
    """

    out: Path
    trials: dict[str, list[Result]]
    computed: int = 0  # trials that were run now; the others were in the store
    notes: list[str] = field(default_factory=list)  # notes for readers of the results

    def of(self, name: str, **fields: Any) -> list[Result]:
        """Results of an experiment in which these fields have these values, as ``of("exp1", method="motm")``."""
        return chosen(self.trials[name], fields)


@dataclass
class _Task:
    """A trial that has to be run, and its places in the experiments."""

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
    """Run the trials that are not yet in ``out``/<experiment>/trials.jsonl; returns the results of all.

    After Ctrl-C, SIGTERM (KeyboardInterrupt) or a crash the same call resumes. ``retry_failed`` runs
    trials again that were without success. ``backend`` "ray" needs the extra ``cluster``; ``address`` is the cluster's.
    ``about``: data to store with every trial that is run now, beside its versions and machine.
    Raises ValueError for a spec that cannot be run, before any trial begins.
    """
    given = [experiments] if isinstance(experiments, Experiment) else list(experiments)
    jobs = {experiment.name: jobs_of(experiment.specs) for experiment in given}
    if len(jobs) < len(given):
        raise ValueError("two experiments have the same name: results are kept by name")
    source = made_with()[SOURCE]
    results = Results(out, {name: [{} for _ in these] for name, these in jobs.items()})
    with ExitStack() as stack:
        stack.enter_context(handled(signal.default_int_handler, signal.SIGTERM))  # so that the workers end too
        stores = {name: stack.enter_context(Store(out / name)) for name in jobs}
        tasks = _missing(jobs, stores, results, source, retry_failed=retry_failed)
        if tasks:
            pool = make_pool(workers, backend, address)
            methods = [task.job.spec.method for task in tasks]
            bar = Bar(methods, pool.processes(), console or Console(quiet=True))
            stack.enter_context(bar.progress)
            for number, outcome in outcomes(run_job, [task.job for task in tasks], pool, bar.say):
                _keep(tasks[number], outcome, stores, results, source, bar, about or {})
        for name, store in stores.items():
            store.write_results(results.trials[name])
    return results


def run_or_stop(experiments: Iterable[Experiment], *, out: Path, workers: int, console: Console) -> Results | None:
    """`run`; None, with a line on the console, after Ctrl-C."""
    given = list(experiments)
    try:
        return run(given, out=out, workers=workers, console=console)
    except KeyboardInterrupt:
        console.print(kept_text(out, (each.name for each in given)), markup=False)
        return None


def kept_text(out: Path, names: Iterable[str]) -> str:
    """Sentence for the user after Ctrl-C: stored trials, and how to continue."""
    kept = sum(len(Store(out / name).read()) for name in names)
    return f"\nstopped; {kept} finished trials are in {out}: the same command resumes there"


def _missing(
    jobs: Mapping[str, list[Job]], stores: Mapping[str, Store], results: Results, source: str, *, retry_failed: bool
) -> list[_Task]:
    """The trials that are in no store, each once; the results of the others are taken from their stores."""
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
    task: _Task, outcome: Outcome | Lost, stores: Mapping[str, Store], results: Results, source: str, bar: Bar,
    about: Mapping[str, str],
) -> None:  # fmt: skip
    """Store a finished trial, and report problems."""
    lost = isinstance(outcome, Lost)
    whole = given_up(task.job, outcome.reason, source) if isinstance(outcome, Lost) else outcome
    if whole.source != source and not results.notes:
        results.notes.append("the source changed while trials ran: those run by the new source run again next time")
        bar.say(results.notes[-1])
    key = task.job.key(whole.source)
    result = msgspec.json.decode(msgspec.json.encode(whole.result))  # as it will be when read from the store
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
