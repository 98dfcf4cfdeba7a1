"""A part of the report: a figure or a table with its data, or the reason why it is missing; and the figures' style.

Colours are those of Okabe and Ito. No colour stands alone: hatches, markers and line styles say the same.
"""

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from motm_twin.perf.report import plain

ONE_COLUMN, TWO_COLUMNS = 88.0, 181.0  # [mm]
MM = 1.0 / 25.4  # [inch]
DPI = 300

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, RED, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, PALE = "#777777", "#DDDDDD"

SMALLEST = 7.0  # [pt] no letter is smaller
STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 8.0),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.fontsize"), SMALLEST),
    **dict.fromkeys(("legend.frameon", "axes.spines.top", "axes.spines.right", "axes.grid"), False),
    **dict.fromkeys(("axes.linewidth", "patch.linewidth"), 0.7),
    "legend.handlelength": 2.2,
    "axes.axisbelow": True,
    "grid.color": PALE,
    "grid.linewidth": 0.5,
    "hatch.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 4.0,
    "figure.dpi": 100,
    "savefig.dpi": DPI,
    "svg.fonttype": "none",  # letters stay letters, to be searched and edited
    "svg.hashsalt": "motm_twin",  # the same figure, the same file
}

# Cost of standing or driving there: light where free, dark where occupied, so that grey says the same as green to red.
OCCUPANCY = LinearSegmentedColormap.from_list("occupancy", ["#CFEBC4", "#8CC97B", "#C99A3C", "#A63A22", "#5A0F0F"])
# Cost of a candidate: the cheaper, the brighter green (Paper, Sec. IV).
COST = LinearSegmentedColormap.from_list("cost", ["#4CF06A", "#1F8F4A", "#14402C", "#101418"])


class Look(NamedTuple):
    """Colour, marker, line and hatch of a method in every figure."""

    colour: str
    marker: str
    line: str
    hatch: str


LOOKS: dict[str, Look] = {
    "motm": Look(BLUE, "o", "-", ""),
    "paper_literal": Look(SKY, "o", "--", "...."),
    "fast": Look(BLACK, "*", "-", "xx"),
    "staa": Look(GREEN, "s", "--", "//"),
    "motm2022": Look(PURPLE, "D", "-.", "\\\\"),
    "holistic": Look(YELLOW, "^", ":", "xx"),
    "fixed_set": Look(GREY, "v", ":", "||"),
    "irm": Look(ORANGE, "P", "--", "--"),
    "greedy": Look(PALE, "<", "-.", "++"),
    "sequential": Look(RED, "X", "-.", "////"),
    "sequential_overlap": Look("#F2B48A", "h", "--", "\\\\\\\\"),
    "open_loop": Look(ORANGE, "^", "--", "////"),
}
OTHER = Look("#BBBBBB", "p", "-.", "oo")


def look(method: str) -> Look:
    """Look of a method; methods that are not shipped share one."""
    return LOOKS.get(method, OTHER)


@contextmanager
def styled() -> Iterator[None]:
    """Within this block figures are made, and saved, in the one style."""
    with mpl.rc_context(STYLE):
        yield


def figure(width: float, height: float) -> Figure:
    """An empty figure of a size in [mm]. No pyplot: nothing is global, nothing needs a screen."""
    return Figure(figsize=(width * MM, height * MM), layout="constrained")


def rows_down(axes: Axes, names: Sequence[str], label: str) -> None:
    """Names of rows down the side, the first on top; ``label`` of the axis below."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel(label)


def legend_below(fig: Figure, panels: Iterable[Axes], columns: int | None = None) -> None:
    """One legend of all panels below them; ``columns``: None: one row."""
    handles = {each.get_label(): each for panel in panels for each in panel.get_legend_handles_labels()[0]}
    fig.legend(handles=list(handles.values()), loc="outside lower center", ncols=columns or len(handles))


Row = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A figure, or a table when there is no figure, and the numbers that it shows."""

    caption: str  # what is seen, in sentences
    n: str  # how many trials, or what else was counted
    rows: Sequence[Row]  # the numbers, as the CSV has them
    name: str = ""  # of its files; the register of parts gives name and title
    title: str = ""
    command: str = ""  # of the one trial that is shown; the report puts before it what makes the part
    facts: Mapping[str, Any] = field(default_factory=dict)  # more numbers, for the JSON
    figure: Figure | None = None
    cells: Sequence[Mapping[str, str]] = ()  # a table: its rows as they are printed, by column
    marked: Sequence[int] = ()  # rows of the table that are published, not measured
    notes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Missing:
    """A part that could not be made. Nothing is shown in its place."""

    reason: str  # one sentence
    name: str = ""
    title: str = ""
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
    write_csv(stem.with_suffix(".csv"), part.rows)
    fields = ("title", "caption", "command", "n", "notes", "facts", "rows")
    write_json(stem.with_suffix(".json"), {name: getattr(part, name) for name in fields})


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Rows with the columns of all of them, in the order in which they come; nan and None are empty."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(map(plain, rows))


def write_json(path: Path, document: Any) -> None:
    """JSON without nan and infinity, which it does not have: null instead."""
    path.write_text(json.dumps(plain(document), indent=1, allow_nan=False) + "\n", encoding="utf-8")
