"""Trials that are in the folder already, which of them a plan still misses, and what ran them."""

from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

import msgspec

from motm_twin.perf.report import machine
from motm_twin.sessions.made_with import SOURCE, made_with
from motm_twin.studies.spec import Experiment, TrialSpec, jobs_of
from motm_twin.studies.store import TRIALS, Record
from motm_twin.studies.store import Store as Trials
from motm_twin.studies.trial import MACHINE

PLAN, COMMAND = "plan", "command"  # kept with every trial, beside what it was made with
NOT_RECORDED = "not recorded"


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Of all trials together; what was not the same for all of them names each with its number of trials."""

    sources: tuple[str, ...]  # those of the trials
    plans: tuple[str, ...]  # those that ran them; "not recorded" for `motm-twin bench` and versions before this
    plan: str
    command: str
    machine: str
    made_with: dict[str, str]

    @property
    def current(self) -> bool:
        """All trials were run by the source as it is now."""
        return self.sources == (made_with()[SOURCE],)


def origin(records: Iterable[Record], command: str) -> Origin:
    """That of these trials; without any all that is shown is made now, by this command."""
    notes = [record.made_with for record in records] or [{**current_origin(), PLAN: "no trials", COMMAND: command}]
    names = [*dict.fromkeys(name for note in notes for name in note), PLAN, COMMAND, MACHINE, SOURCE]
    counts = {name: Counter(note.get(name, NOT_RECORDED) for note in notes) for name in names}
    apart = (PLAN, COMMAND, MACHINE)
    return Origin(
        sources=tuple(counts[SOURCE]),
        plans=tuple(counts[PLAN]),
        plan=_counted(counts[PLAN]),
        command=_counted(counts[COMMAND]),
        machine=_counted(counts[MACHINE]),
        made_with={name: _counted(values) for name, values in counts.items() if name not in apart},
    )


def current_origin() -> dict[str, str]:
    """Source, libraries and machine that draw the report, under the same names."""
    return {**made_with(), MACHINE: machine()}


def _counted(values: Counter[str]) -> str:
    if len(values) == 1:
        return next(iter(values))
    return "; ".join(f"{value} ({count} {'trial' if count == 1 else 'trials'})" for value, count in values.items())


Records = dict[str, list[Record]]  # by experiment
Keys = dict[str, dict[str, TrialSpec]]  # by experiment: trials by their names in the store


def stored(out: Path, without: Collection[str] = ()) -> Records:
    """The newest record of every spec, of whatever experiment and source; not of these experiments."""
    found: Records = {}
    for file in sorted(out.glob(f"*/{TRIALS}")):
        if file.parent.name in without:
            continue
        found[file.parent.name] = list(_newest(Trials(file.parent).read().values()).values())
    return found


def keys(experiments: Iterable[Experiment]) -> Keys:
    """The trials of these experiments with the source as it is now; one that is wanted twice is one.

    Raises ValueError for a trial that cannot be run.
    """
    source = made_with()[SOURCE]
    return {each.name: {job.key(source): job.spec for job in jobs_of(each.specs)} for each in experiments}


def of_plan(out: Path, wanted: Keys) -> Records:
    """Records of these trials, each once and in their order: of the source as it is now, or else the newest."""
    found: Records = {}
    for name, trials in wanted.items():
        records = Trials(out / name).read()
        newest = _newest(records.values())
        these = (records.get(key) or newest.get(_text(spec)) for key, spec in trials.items())
        found[name] = [record for record in these if record is not None]
    return found


def completed(out: Path, wanted: Keys) -> None:
    """Write `results.jsonl` of what there is of these trials: a run of some of them left only those in it."""
    for name, trials in wanted.items():
        records = Trials(out / name).read()
        Trials(out / name).write_results([records[key].result for key in trials if key in records])


def missing(out: Path, wanted: Keys, *, retry_failed: bool = False) -> tuple[list[TrialSpec], int]:
    """Those of these trials that have to be run, and the number of all."""
    done = {
        record.key
        for name in wanted
        for record in Trials(out / name).read().values()
        if record.result["success"] or not retry_failed
    }
    every = {key: spec for trials in wanted.values() for key, spec in trials.items()}
    return [spec for key, spec in every.items() if key not in done], len(every)


def _newest(records: Iterable[Record]) -> dict[bytes, Record]:
    """By spec."""
    return {_text(record.spec): record for record in records}


def _text(spec: TrialSpec) -> bytes:
    return msgspec.json.encode(spec, order="deterministic")
