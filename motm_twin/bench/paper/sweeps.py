"""Task time against the weight of the next target, the Bezier offset and the ring radii."""

import math

from motm_twin.bench.experiments import statistics
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.plan import SWEEPS, swept_scenes
from motm_twin.bench.paper.style import BLACK, BLUE, ORANGE, RED, TWO_COLUMNS, figure, styled
from motm_twin.control.tuning import parameter

NAME, TITLE = "sweeps", "Task time against the parameters of placement and heuristic"
OURS = "motm"
SCENES = {  # title, marker, line, colour, share of the axis by which it is moved aside
    "exp1": ("Experiment 1", "o", "-", BLUE, 0.0),
    "exp1a": ("Experiment 1a", "D", "--", ORANGE, 0.012),
}


def points(store: Store, experiment: str) -> list[dict]:
    """For each scene and value: how much slower than the shipped one, by trial, with its interval."""
    name = SWEEPS[experiment][0]
    return [row for scene in swept_scenes(name) for row in _of_scene(store, experiment, name, scene)]


def _of_scene(store: Store, experiment: str, name: str, scene: str) -> list[dict]:
    swept = store.of(experiment, scene=scene, method=OURS)
    shipped = [each for each in swept if not each["parameters"]]  # `bench` keeps it beside the other values
    ours = data.times([*shipped, *store.of(scene, method=OURS)])
    found: dict[float, list[Result]] = {}
    for result in swept:
        if name in result["parameters"]:
            found.setdefault(float(result["parameters"][name]), []).append(result)
    return [_row(name, scene, value, these, ours) for value, these in sorted(found.items())]


def _row(name: str, scene: str, value: float, results: list[Result], ours: dict) -> dict:
    slower = statistics.paired_difference(data.times(results), ours)
    placed, wanted = data.placed(results)
    return {
        "parameter": name, "scene": scene, "value": value, "slower_s": slower.value, "low_s": slower.low,
        "high_s": slower.high, "pairs": slower.n, "placed": placed, "wanted": wanted,
    }  # fmt: skip


def draw(store: Store) -> Part:
    """One panel per parameter; the shipped value and the paper's are marked."""
    swept = {name: points(store, name) for name in SWEEPS}
    found = {name: rows for name, rows in swept.items() if any(row["pairs"] for row in rows)}
    if not found:
        return Missing(name=NAME, title=TITLE, reason="no other value of a parameter was completed")
    with styled():
        fig = figure(TWO_COLUMNS, 60.0)
        axes = fig.subplots(1, len(found), squeeze=False, sharey=True)[0]
        for panel, (name, rows) in zip(axes, found.items(), strict=True):
            _panel(panel, SWEEPS[name][0], [row for row in rows if row["pairs"]])
        axes[0].set_ylabel("slower than as shipped by [s]")
        handles = {h.get_label(): h for panel in axes for h in panel.get_legend_handles_labels()[0]}
        fig.legend(handles=list(handles.values()), loc="outside lower center", ncols=len(handles))
    rows = [row for each in found.values() for row in each]
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            "Paired by arrangement with the shipped value (square, 0 by definition); bars are Student's 95 % "
            "intervals. Open: not every object was placed with this value. Dotted: the paper's value. The largest ring "
            "is swept on Experiment 1a, too: Experiment 1 needs none beyond 0.7 m."
        ),
        n=", ".join(f"{row['parameter']} = {row['value']:g} ({row['scene']}): {row['pairs']}" for row in rows)
        + " pairs",
        rows=rows,
        figure=fig,
    )


def _panel(axes, name: str, rows: list[dict]) -> None:
    about = parameter(name)
    shipped = float(about.default)
    span = max(abs(row["value"] - shipped) for row in rows)
    for scene in dict.fromkeys(row["scene"] for row in rows):
        _line(axes, shipped, [row for row in rows if row["scene"] == scene], span)
    axes.plot(shipped, 0.0, "s", mfc="white", mec=BLACK, ms=5.5, zorder=5)
    if about.paper is not None:
        axes.axvline(float(about.paper), ls=":", color=RED, lw=1.0, zorder=1)
    axes.axhline(0.0, color=BLACK, lw=0.5, zorder=1)
    axes.set_xlabel(about.title + (f" [{about.unit}]" if about.unit else ""))
    axes.grid(axis="y")


def _line(axes, shipped: float, rows: list[dict], span: float) -> None:
    """The values of one scene, a little aside so that equal ones are seen beside each other."""
    title, marker, line, colour, aside = SCENES[rows[0]["scene"]]
    drawn = sorted([*((row["value"] + aside * span, row["slower_s"]) for row in rows), (shipped, 0.0)])
    axes.plot(*zip(*drawn, strict=True), line, marker=marker, ms=0, color=colour, lw=1.0, zorder=2)
    for row in rows:
        at, whole = row["value"] + aside * span, row["placed"] == row["wanted"]
        if math.isfinite(row["low_s"]):
            axes.plot([at] * 2, [row["low_s"], row["high_s"]], "-", color=BLACK, lw=1.0, zorder=3)
        axes.plot(at, row["slower_s"], marker, mfc=colour if whole else "white", mec=BLACK, mew=0.5, zorder=4)
    axes.plot([], [], line, marker=marker, mec=BLACK, mew=0.5, color=colour, label=title)
