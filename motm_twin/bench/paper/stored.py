"""Trials that are in the folder already, of whatever experiment and source: to draw without running."""

from collections.abc import Collection
from pathlib import Path

import msgspec

from motm_twin.bench.experiments.store import TRIALS, Record
from motm_twin.bench.experiments.store import Store as Trials
from motm_twin.record.made_with import SOURCE


def stored(out: Path, without: Collection[str] = ()) -> tuple[dict[str, list[dict]], list[str]]:
    """The newest result of every spec by experiment, and the sources that they come from; not of these experiments."""
    trials: dict[str, list[dict]] = {}
    sources: dict[str, None] = {}
    for file in sorted(out.glob(f"*/{TRIALS}")):
        if file.parent.name in without:
            continue
        newest: dict[bytes, Record] = {}
        for record in Trials(file.parent).read().values():
            newest[msgspec.json.encode(record.spec, order="deterministic")] = record
        trials[file.parent.name] = [record.result for record in newest.values()]
        sources |= {record.made_with.get(SOURCE, "unknown"): None for record in newest.values()}
    return trials, list(sources)
