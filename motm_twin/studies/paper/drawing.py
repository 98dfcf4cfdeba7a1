"""A part of the report: a figure or a table with its data, or the reason why it is missing; and the style of figures.

Colours are those of Okabe and Ito. No colour stands alone: hatches, markers and line styles carry the same meaning.
The last functions draw the elements of a floor plan.
"""

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patheffects import Normal, Stroke

from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import Bin, Cylinder, Scene, Solid
from motm_twin.perception.distance import proximity_cost
from motm_twin.perception.footprints import outline
from motm_twin.perception.world_map import WorldMap
from motm_twin.perf.report import plain

ONE_COLUMN, TWO_COLUMNS = 88.0, 181.0  # [mm]
MM = 1.0 / 25.4  # [inch]
DPI = 300

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, RED, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, PALE = "#777777", "#DDDDDD"

SMALLEST = 7.0  # [pt] smallest font size
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
    "svg.fonttype": "none",  # text stays text that can be searched and edited
    "svg.hashsalt": "motm_twin",  # equal figures give equal files
}

# Cost of a cell: light where free, dark where occupied, so that a greyscale print shows the same as green to red.
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
    """Context in which figures are drawn and saved in the common style."""
    with mpl.rc_context(STYLE):
        yield


def figure(width: float, height: float) -> Figure:
    """An empty figure of this size [mm]; without pyplot, so without global state and without a screen."""
    return Figure(figsize=(width * MM, height * MM), layout="constrained")


def rows_down(axes: Axes, names: Sequence[str], label: str) -> None:
    """Label the rows at the left, the first on top; ``label``: of the x axis."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel(label)


def legend_below(fig: Figure, panels: Iterable[Axes], columns: int | None = None) -> None:
    """One common legend below all panels; ``columns`` None: one row."""
    handles = {each.get_label(): each for panel in panels for each in panel.get_legend_handles_labels()[0]}
    fig.legend(handles=list(handles.values()), loc="outside lower center", ncols=columns or len(handles))


Row = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A figure or a table, or both, and the numbers in it."""

    caption: str  # one or more sentences
    n: str  # number of trials, or of other samples
    rows: Sequence[Row]  # the numbers as rows of the CSV
    name: str = ""  # of its files; the register of parts gives name and title
    title: str = ""
    command: str = ""  # of the one trial that is shown; the report puts the command of the part before it
    facts: Mapping[str, Any] = field(default_factory=dict)  # more numbers, for the JSON
    figure: Figure | None = None
    cells: Sequence[Mapping[str, str]] = ()  # a table: its printed rows, by column
    marked: Sequence[int] = ()  # indices of rows that are published, not measured
    notes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Missing:
    """A part that could not be made. Nothing is shown in its place."""

    reason: str  # one sentence
    name: str = ""
    title: str = ""
    larger: bool = False  # a larger plan may have the trials for it
    command: str = ""  # that would make the part; printed in the report


Part = Drawn | Missing


def save(part: Drawn, folder: Path) -> None:
    """Write PNG, SVG, CSV and JSON files of a part."""
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
    """Write rows with the columns of all rows, in order of first appearance; nan and None become empty cells."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(map(plain, rows))


def write_json(path: Path, document: Any) -> None:
    """Write a JSON document with null in place of nan and infinity, which JSON does not have."""
    path.write_text(json.dumps(plain(document), indent=1, allow_nan=False) + "\n", encoding="utf-8")


INFLATION, BLUR = 0.6, 0.2  # [m] of STAA*'s grid
CLEAR = 0.7  # [m] above the floor: a solid that begins higher is a table top


def metres(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Equal axes in metres over a region."""
    axes.set_aspect("equal")
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def occupancy(axes: Axes, world: WorldMap) -> Any:
    """The proximity grid with the inflation of STAA*, from free (light green) to occupied (dark red)."""
    cost = proximity_cost(world.distance, INFLATION, round(0.5 * BLUR / world.resolution))
    rows, columns = cost.shape
    x, y = (float(value) for value in world.origin)
    extent = (x, x + columns * world.resolution, y, y + rows * world.resolution)
    return axes.imshow(cost, cmap=OCCUPANCY, vmin=0.0, vmax=1.0, origin="lower", extent=extent, interpolation="nearest")


def furniture(axes: Axes, solids: Iterable[Solid], *, face: str = "#E8E2D6", hatch: str | None = None) -> None:
    """Outlines of furniture, low pieces first."""
    look: dict[str, Any] = {"facecolor": face, "edgecolor": GREY, "linewidth": 0.6, "hatch": hatch, "zorder": 1}
    for solid in sorted(solids, key=lambda each: each.z_max):
        if isinstance(solid.shape, Cylinder):
            axes.add_patch(Circle(solid.shape.centre, solid.shape.radius, **look))
        else:
            axes.add_patch(Polygon(outline(solid.shape), closed=True, **look))


def bins(axes: Axes, scene_bins: Iterable[Bin]) -> None:
    """Bins as open squares."""
    for item in scene_bins:
        corner = (item.centre[0] - 0.5 * item.side, item.centre[1] - 0.5 * item.side)
        axes.add_patch(Rectangle(corner, item.side, item.side, facecolor="white", edgecolor=BLACK, lw=0.8, zorder=2))


def cubes(axes: Axes, points: Sequence[Any], colour: str, size: float = 9.0) -> None:
    """Cubes as small squares, larger than to scale."""
    if len(points):
        at = np.asarray(points, dtype=float)
        axes.scatter(at[:, 0], at[:, 1], s=size, marker="s", c=colour, edgecolors=BLACK, linewidths=0.4, zorder=4)


def robot(
    axes: Axes, pose: Array, footprint: Footprint, *, colour: str = BLUE, alpha: float = 1.0, fill: bool = True
) -> None:
    """The base as its rectangle, with an arrow forwards."""
    b, w = 0.5 * footprint.length, 0.5 * footprint.width
    corners = np.array([[b, w], [-b, w], [-b, -w], [b, -w]]) + np.array([footprint.offset_x, 0.0])
    tip = np.array([[0.8 * b, 0.0], [0.2 * b, 0.5 * w], [0.2 * b, -0.5 * w]])
    body, arrow = (from_frame(pose, points) for points in (corners, tip))
    face = colour if fill else "none"
    axes.add_patch(Polygon(body, closed=True, facecolor=face, edgecolor=BLACK, lw=0.6, alpha=alpha, zorder=5))
    axes.add_patch(Polygon(arrow, closed=True, facecolor="white", edgecolor=BLACK, lw=0.5, alpha=alpha, zorder=6))


def temi(axes: Axes, x: float, y: float, radius: float, *, colour: str, alpha: float = 1.0) -> None:
    """A Temi as its disc."""
    axes.add_patch(Circle((x, y), radius, facecolor=colour, edgecolor=BLACK, lw=0.6, alpha=alpha, zorder=5))


def path(
    axes: Axes, points: Array, colour: str, style: Any = "-", *, width: float = 1.8, casing: str = "white", **more: Any
) -> None:
    """A path with a casing, so that it is visible on any background."""
    if len(points) < 2:
        return
    effects = [Stroke(linewidth=width + 1.6, foreground=casing), Normal()]
    axes.plot(
        points[:, 0], points[:, 1], linestyle=style, color=colour, lw=width, zorder=7, path_effects=effects,
        solid_capstyle="round", **more,
    )  # fmt: skip


def setting(axes: Axes, scene: Scene) -> None:
    """Furniture and bins of a scene, unmapped furniture hatched; mapped posts below a table top are not drawn."""
    furniture(axes, [solid for solid in scene.solids if solid.mapped and not _below_top(solid, scene)])
    furniture(axes, [solid for solid in scene.solids if not solid.mapped], face="#FFE08A", hatch="//")
    bins(axes, scene.bins)


def _below_top(solid: Solid, scene: Scene) -> bool:
    """True for posts and feet under a table top of the same group."""
    tops = [other for other in scene.solids if other.group == solid.group and other.z_min > CLEAR]
    return bool(solid.group and tops and solid not in tops)
