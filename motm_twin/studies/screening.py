"""Sensitivity of every number of ours: each is halved and doubled, and each switch flipped, on the same seeds.

A number that changes no run has to be shown by a test, or goes with the code that reads it. Every trial is an
experiment's (`studies.run`), kept on disk and gone on with after Ctrl-C.
"""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from motm_twin.control.tuning import tuned
from motm_twin.methods.registry import FAST
from motm_twin.model.number import Found, numbers_of, replaced
from motm_twin.perf.report import Sheet, machine, write_report
from motm_twin.studies import statistics
from motm_twin.studies.groups import drove_into, touches
from motm_twin.studies.run import Result, Results, run_or_stop
from motm_twin.studies.spec import Experiment, TrialSpec

NAME = "screening"
TITLE = "Every number of ours halved and doubled: Experiments 1 and 2"
SCENES = (("exp1", "random"), ("exp2", "random"))
SEEDS = 4  # of each scene
FACTORS = (0.5, 2.0)
SMALL, WHOLE = 0.05, 1  # in place of halves and doubles of 0
HEAD = ("number", "value", "trials", "the same", "time", "placed", "contacts, caused")


class Change(NamedTuple):
    """A number with another value."""

    name: str  # its path in the tree
    value: float | bool


def ours(given: Iterable[str] = ()) -> list[Found]:
    """Numbers of ours; of those the ones whose paths are ``given``, or begin so. Raises ValueError for a wrong one."""
    found = [each for each in numbers_of(tuned(FAST.parameters)) if each.ours and not isinstance(each.default, str)]
    for name in given:
        if not any(_within(each, name) for each in found):
            raise ValueError(f"no number of ours is, or is in, {name!r}: docs/parameters.md lists all")
    return [each for each in found if not given or any(_within(each, name) for name in given)]


def _within(found: Found, name: str) -> bool:
    path = name.split(".")
    return list(found.path[: len(path)]) == path


def changes_of(found: Found) -> list[Change]:
    """The other values of a number, those left out that its parameter class refuses."""
    value = found.default
    if isinstance(value, bool):
        others: list[float | bool] = [not value]
    elif value == 0:
        others = [WHOLE if isinstance(value, int) else SMALL]
    elif isinstance(value, int):
        others = [max(1, round(factor * value)) for factor in FACTORS]
    else:
        others = [factor * value for factor in FACTORS]
    return [Change(".".join(found.path), other) for other in others if other != value and _possible(found, other)]


def _possible(found: Found, value: float | bool) -> bool:
    try:
        replaced(tuned(FAST.parameters), found.path, value)
    except ValueError:
        return False
    return True


def specs(changes: Iterable[Change], seeds: int) -> Iterable[TrialSpec]:
    """The trials: first without a change, then each change on the same scenes and seeds."""
    for change in (None, *changes):
        numbers = {} if change is None else {change.name: change.value}
        for scene, variant in SCENES:
            for seed in range(seeds):
                yield TrialSpec(scene, variant, seed, FAST.name, numbers=numbers)


def bench_screening(out: Path, share: float, workers: int, console: Console, given: Sequence[str] = ()) -> bool:
    """Run, print, write ``out/screening.json`` and ``.md``; True when all trials have run.

    ``share`` of four seeds of each scene; ``given``: only these numbers, or groups of them. About 5,700 trials for all.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    try:
        found = ours(given)
    except ValueError as error:
        console.print(f"  {error}", style="red", markup=False)
        return False
    changes = [change for each in found for change in changes_of(each)]
    chosen = Experiment(NAME, TITLE, tuple(specs(changes, math.ceil(SEEDS * share))))
    results = run_or_stop([chosen], out=out / NAME, workers=workers, console=console)
    if results is None:
        return False
    rows = rows_of(results, changes)
    console.print(SHEET.table(rows))
    SHEET.write(out / f"{NAME}.md", rows)
    target = write_report(out, NAME, TITLE, reached=True, rows=rows)
    console.print(f"{machine()}, {workers} processes; written to {target} and {NAME}.md")
    return True


def rows_of(results: Results, changes: Iterable[Change]) -> list[dict[str, Any]]:
    """A row for each change beside the runs without it. The change of time is that of the trials that both complete."""
    shipped = {(each["scene"], each["seed"]): each for each in results.of(NAME, numbers={})}
    rows = [_row(Change(SHIPPED, 1.0), list(shipped.values()), shipped)]
    for change in changes:
        rows.append(_row(change, results.of(NAME, numbers={change.name: change.value}), shipped))
    return rows


def _row(change: Change, these: list[Result], shipped: dict[tuple[str, int], Result]) -> dict[str, Any]:
    both = [(each, shipped[each["scene"], each["seed"]]) for each in these]
    done = [(one, other) for one, other in both if one["success"] and other["success"]]
    slower = statistics.mean([one["time_s"] - other["time_s"] for one, other in done])
    return {
        "number": change.name, "value": change.value, "trials": len(these),
        "same": sum(one["state_hash"] == other["state_hash"] for one, other in both),
        "slower_s": slower.value, "slower_low_s": slower.low, "slower_high_s": slower.high,
        "placed": sum(each["places_done"] for each in these), "places": sum(each["places_total"] for each in these),
        "contacts": touches(these), "caused": drove_into(these),
    }  # fmt: skip


def cells(row: dict[str, Any]) -> tuple[str, ...]:
    """A row as the texts of `HEAD`."""
    slower = f"{row['slower_s']:+.1f}"
    if math.isfinite(row["slower_low_s"]):
        slower += f" [{row['slower_low_s']:+.1f}, {row['slower_high_s']:+.1f}]"
    value = row["value"] if isinstance(row["value"], bool) else f"{row['value']:.4g}"
    return (
        f"`{row['number']}`", str(value), str(row["trials"]), str(row["same"]), f"{slower} s",
        f"{row['placed']}/{row['places']}", f"{row['contacts']}, {row['caused']}",
    )  # fmt: skip


SHIPPED = "as shipped"
SHEET = Sheet(
    head=HEAD, texts=HEAD[:1], cells=cells, good=lambda row: row["number"] == SHIPPED or row["same"] < row["trials"]
)  # those that changed no run are yellow
