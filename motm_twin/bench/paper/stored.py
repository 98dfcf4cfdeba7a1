"""Trials that are in the folder already: those that a plan wants, those that are missing, and all of them."""

from collections.abc import Collection, Iterable
from pathlib import Path

import msgspec

from motm_twin.bench.experiments.spec import Experiment, TrialSpec, jobs_of
from motm_twin.bench.experiments.store import TRIALS, Record
from motm_twin.bench.experiments.store import Store as Trials
from motm_twin.record.made_with import SOURCE, made_with

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
    """What these trials gave, each once and in their order: with the source as it is now, or else the newest."""
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
