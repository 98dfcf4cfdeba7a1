"""A part of the report: a figure or a table with its data, or the reason why it is not there."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from motm_twin.perf.report import plain
from motm_twin.studies.paper.style import styled

Row = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A figure, or a table when there is no figure, and the numbers that it shows."""

    name: str  # of its files
    title: str
    caption: str  # what is seen, in sentences
    n: str  # how many trials, or what else was counted
    rows: Sequence[Row]  # the numbers, as the CSV has them
    command: str = ""  # of the one trial that is shown; the report puts before it what makes the part
    facts: Mapping[str, Any] = field(default_factory=dict)  # more numbers, for the JSON
    figure: Figure | None = None
    picture: bytes | None = None  # PNG of what is not drawn here: photographs of the page
    header: Sequence[str] = ()  # a table: its columns, and its cells as they are printed
    cells: Sequence[Sequence[str]] = ()
    marked: Sequence[int] = ()  # rows of the table that are published, not measured
    notes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Missing:
    """A part that could not be made. Nothing is shown in its place."""

    name: str
    title: str
    reason: str  # one sentence
    larger: bool = False  # these trials do not have it, more of them may
    command: str = ""  # that would make it; the report says it


Part = Drawn | Missing


def save(part: Drawn, folder: Path) -> None:
    """Write PNG and SVG, CSV and JSON of a part."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / part.name
    if part.figure is not None:
        with styled():
            part.figure.savefig(stem.with_suffix(".png"), metadata={"Software": None})
            part.figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None})
    elif part.picture is not None:
        stem.with_suffix(".png").write_bytes(part.picture)
    write_csv(stem.with_suffix(".csv"), part.rows)
    about = {"title": part.title, "caption": part.caption, "command": part.command, "n": part.n}
    document = {**about, "notes": list(part.notes), "facts": dict(part.facts), "rows": [dict(row) for row in part.rows]}
    write_json(stem.with_suffix(".json"), document)


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Rows with the columns of all of them, in the order in which they come; nan and None are empty."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([_cell(row.get(column)) for column in columns] for row in rows)


def write_json(path: Path, document: Any) -> None:
    """JSON without nan and infinity, which it does not have: null instead."""
    path.write_text(json.dumps(plain(document), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _cell(value: Any) -> Any:
    value = plain(value)
    return "" if value is None else value
