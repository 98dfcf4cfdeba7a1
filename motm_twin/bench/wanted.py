"""Numbers that are wanted at least, and such that would be better still: how they are judged and printed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A row of the table: what is wanted at least, and what would be better still."""

    key: str
    name: str
    unit: str
    least: float
    best: float
    more: bool = False  # the measured value has to be this much or more, else this much or less
    decimals: int = 2


def enough(row: Wanted, value: float, limit: float) -> bool:
    """Whether a measured value reaches a limit; nan never does."""
    return value >= limit if row.more else value <= limit


def wanted_table(wanted: Sequence[Wanted], columns: Mapping[str, Mapping[str, float]]) -> Table:
    """Every row with its value in each column, what is wanted at least, and what to reach for.

    The first column is judged; the others need not have every value.
    """
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("number to reach", "unit", *columns, "at least", "", "reach for", " "):
        table.add_column(name, justify="left" if name in ("number to reach", "unit") else "right")
    judged = next(iter(columns.values()))
    for row in wanted:
        verdicts = []
        for limit in (row.least, row.best):
            good = enough(row, judged[row.key], limit)
            verdicts += [f"{limit:g}", "[green]reached[/green]" if good else "[red]not reached[/red]"]
        values = (f"{column[row.key]:.{row.decimals}f}" if row.key in column else "-" for column in columns.values())
        table.add_row(row.name, row.unit, *values, *verdicts)
    return table
