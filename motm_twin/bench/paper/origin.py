"""What ran the trials of a report: source, libraries, machine, plan and command, as the records of the trials say."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from motm_twin.bench.experiments.store import Record
from motm_twin.bench.experiments.trial import MACHINE
from motm_twin.bench.machine import machine
from motm_twin.record.made_with import SOURCE, made_with

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
        """Whether all trials were run by the source as it is now."""
        return self.sources == (made_with()[SOURCE],)


def origin(records: Iterable[Record], command: str) -> Origin:
    """That of these trials; without any all that is shown is made now, by this command."""
    notes = [record.made_with for record in records] or [{**now(), PLAN: "no trials", COMMAND: command}]
    names = [*dict.fromkeys(name for note in notes for name in note), PLAN, COMMAND, MACHINE, SOURCE]
    counts = {name: Counter(note.get(name, NOT_RECORDED) for note in notes) for name in names}
    apart = (PLAN, COMMAND, MACHINE)
    return Origin(
        sources=tuple(counts[SOURCE]),
        plans=tuple(counts[PLAN]),
        plan=_said(counts[PLAN]),
        command=_said(counts[COMMAND]),
        machine=_said(counts[MACHINE]),
        made_with={name: _said(values) for name, values in counts.items() if name not in apart},
    )


def now() -> dict[str, str]:
    """What draws the report, in the same words."""
    return {**made_with(), MACHINE: machine()}


def _said(values: Counter[str]) -> str:
    if len(values) == 1:
        return next(iter(values))
    return "; ".join(f"{value} ({count} {'trial' if count == 1 else 'trials'})" for value, count in values.items())
