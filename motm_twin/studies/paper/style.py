"""Style of every figure: widths, letters, and colours that colour-blind readers and grey printers tell apart.

Colours are those of Okabe and Ito; no colour stands alone: hatches, markers and line styles say the same.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

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
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": SMALLEST,
    "ytick.labelsize": SMALLEST,
    "legend.fontsize": SMALLEST,
    "legend.frameon": False,
    "legend.handlelength": 2.2,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": False,
    "grid.color": PALE,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 4.0,
    "hatch.linewidth": 0.6,
    "patch.linewidth": 0.7,
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
