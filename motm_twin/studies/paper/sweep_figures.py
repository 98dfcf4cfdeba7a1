"""Figures with one variation at a time: a modification switched off, a parameter, an error, or grasps that fail."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from motm_twin.control.tuning import parameter
from motm_twin.measures.references import FAILURE_RECOVERY, RECOVERY_PLANNED
from motm_twin.methods.registry import METHODS
from motm_twin.studies import statistics
from motm_twin.studies.catalogue import DELAY
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import LITERAL, SWEEPS, Result, Store, swept_scenes
from motm_twin.studies.paper.drawing import (
    BLACK,
    BLUE,
    ONE_COLUMN,
    ORANGE,
    RED,
    TWO_COLUMNS,
    Drawn,
    Missing,
    Part,
    figure,
    legend_below,
    look,
    rows_down,
    styled,
)
from motm_twin.studies.paper.tables import Line, group_of, successes
from motm_twin.studies.statistics import Estimate, touches

OURS = "motm"


class Ablation(NamedTuple):
    """The trials of one group without a modification."""

    method: str
    group: str  # of the results table: no mean mixes published and random arrangements
    results: list[Result]
    slower: Estimate

    @property
    def title(self) -> str:
        """Title of the modification that is switched off."""
        return data.title(self.method)


def compared(store: Store) -> list[Ablation]:
    """Every ablation in every group of trials, and the method as the paper prints it."""
    ours = data.times(store.of("exp1", method=OURS))
    ablated = [(name, store.of("ablations", method=name)) for name in store.methods("ablations") if name != OURS]
    found = []
    for method, results in [*ablated, (LITERAL, store.of("exp1", method=LITERAL))]:
        for group in dict.fromkeys(map(group_of, results)):
            own = [result for result in results if group_of(result) == group]
            found.append(Ablation(method, group, own, statistics.paired_difference(data.times(own), ours)))
    return found if ours else []


def draw_ablations(store: Store) -> Part:
    """A dot with its interval for each modification, and a table with the verdicts."""
    found = compared(store)
    if not found:
        return Missing(reason="no modification, or not motm itself, was run")
    lines = [_line_of(each) for each in found]
    with styled():
        fig = figure(ONE_COLUMN, 16.0 + 6.0 * len(found))
        axes = fig.add_subplot()
        for row, (*_, slower) in enumerate(found):
            if slower.n and math.isfinite(slower.low):
                axes.plot([slower.low, slower.high], [row, row], "-", color=BLACK, lw=1.2, solid_capstyle="butt")
            if slower.n:
                clear = shown(slower)
                axes.plot(slower.value, row, "o", mfc=BLUE if clear else "white", mec=BLACK, ms=5)
        axes.axvline(0.0, color=BLACK, lw=0.6)
        several = len({each.group for each in found}) > 1
        named = [f"{each.title} ({each.group})" if several else each.title for each in found]
        rows_down(axes, named, "slower than the whole method by [s]")
        axes.grid(axis="x")
    return Drawn(
        caption=(
            "Paired by arrangement and seed on Experiment 1, with Student's 95 % interval; right of zero: the "
            "modification saves time. Filled: the interval excludes zero. Open: no effect is shown by these trials."
        ),
        n="; ".join(f"{name}: {each.slower.n} pairs" for name, each in zip(named, found, strict=True)),
        rows=[row for row, _ in lines],
        cells=[cells for _, cells in lines],
        figure=fig,
        notes=_notes(found),
    )  # fmt: skip


def shown(slower: Estimate) -> bool:
    """True when the interval excludes zero."""
    return slower.low > 0.0 or slower.high < 0.0


def verdict(slower: Estimate, results: list[Result]) -> str:
    """Verdict of the trials on a modification, in a few words."""
    placed, places = data.placed(results)
    harm = f"without it {places - placed} of {places} objects are not placed; " if placed < places else ""
    hits = data.contacts(results)
    harm += f"without it {hits} contact(s); " if hits else ""
    if slower.n < 2:
        return harm + "too few trials to say"
    if not shown(slower):
        return harm + "no effect on time shown"
    return harm + ("saves time" if slower.value > 0.0 else "costs time here")


def _line_of(found: Ablation) -> Line:
    method, group, results, slower = found
    placed, places = data.placed(results)
    row = {
        "method": method, "experiment": group,
        "slower_s": slower.value, "low_s": slower.low, "high_s": slower.high, "pairs": slower.n,
        "placed": placed, "wanted": places, "contacts": data.contacts(results),
        "all_contacts": touches(results), "verdict": verdict(slower, results),
    }  # fmt: skip
    cells = {
        "Without": found.title, "Paper": METHODS[method].source if method in METHODS else "", "Experiment": group,
        "Slower by, mean [95 % CI] [s]": slower.text(1), "Pairs": str(slower.n), "Objects placed": f"{placed}/{places}",
        "Contacts, caused": f"{touches(results)}, {data.contacts(results)}", "What it shows": row["verdict"],
    }  # fmt: skip
    return row, cells


def _notes(found: list[Ablation]) -> list[str]:
    several = len({each.group for each in found}) > 1
    silent = [each for each in found if each.slower.n >= 2 and not shown(each.slower)]
    names = [f"{each.title} in {each.group}" if several else each.title for each in silent]
    if not silent:
        return []
    return [
        f"No effect on the task time is shown for: {', '.join(names)}. That is not proof that there is none: the "
        "intervals say how large it may be. Experiment 1 has no obstacle that only the lidar sees, so what acts on "
        "obstacles can show nothing there."
    ]  # fmt: skip


SCENES = {  # title, marker, line, colour, horizontal offset as a share of the axis
    "exp1": ("Experiment 1", "o", "-", BLUE, 0.0),
    "exp1a": ("Experiment 1a", "D", "--", ORANGE, 0.012),
}


def points(store: Store, experiment: str) -> list[dict]:
    """For each scene and value: the slowdown against the shipped value, paired by trial, with its interval."""
    name = SWEEPS[experiment][0]
    return [row for scene in swept_scenes(name) for row in _of_scene(store, experiment, name, scene)]


def _of_scene(store: Store, experiment: str, name: str, scene: str) -> list[dict]:
    swept = store.of(experiment, scene=scene, method=OURS)
    shipped = [each for each in swept if not each["parameters"]]  # `bench` stores the shipped value beside the others
    ours = data.times([*shipped, *store.of(scene, method=OURS)])
    found: dict[float, list[Result]] = {}
    for result in swept:
        if name in result["parameters"]:
            found.setdefault(float(result["parameters"][name]), []).append(result)
    rows = []
    for value, results in sorted(found.items()):
        slower = statistics.paired_difference(data.times(results), ours)
        placed, places = data.placed(results)
        rows.append(
            {"parameter": name, "scene": scene, "value": value, "slower_s": slower.value, "low_s": slower.low,
             "high_s": slower.high, "pairs": slower.n, "placed": placed, "wanted": places}
        )  # fmt: skip
    return rows


def draw_sweeps(store: Store) -> Part:
    """One panel per parameter; the shipped value and the paper's are marked."""
    swept = {name: points(store, name) for name in SWEEPS}
    found = {name: rows for name, rows in swept.items() if any(row["pairs"] for row in rows)}
    if not found:
        return Missing(reason="no other value of a parameter was completed")
    with styled():
        fig = figure(TWO_COLUMNS, 60.0)
        axes = fig.subplots(1, len(found), squeeze=False, sharey=True)[0]
        for panel, (name, rows) in zip(axes, found.items(), strict=True):
            _panel(panel, SWEEPS[name][0], [row for row in rows if row["pairs"]])
        axes[0].set_ylabel("slower than as shipped by [s]")
        legend_below(fig, axes)
    rows = [row for each in found.values() for row in each]
    return Drawn(
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
    """Draw the values of one scene with a small offset, so that equal values of two scenes stay visible."""
    title, marker, line, colour, aside = SCENES[rows[0]["scene"]]
    drawn = sorted([*((row["value"] + aside * span, row["slower_s"]) for row in rows), (shipped, 0.0)])
    axes.plot(*zip(*drawn, strict=True), line, marker=marker, ms=0, color=colour, lw=1.0, zorder=2)
    for row in rows:
        at, whole = row["value"] + aside * span, row["placed"] == row["wanted"]
        if math.isfinite(row["low_s"]):
            axes.plot([at] * 2, [row["low_s"], row["high_s"]], "-", color=BLACK, lw=1.0, zorder=3)
        axes.plot(at, row["slower_s"], marker, mfc=colour if whole else "white", mec=BLACK, mew=0.5, zorder=4)
    axes.plot([], [], line, marker=marker, mec=BLACK, mew=0.5, color=colour, label=title)


COLUMNS = 3  # panels in a row
LABELS = {  # field of the scene: label of the axis, and factor to its unit
    "noise.localisation_position_sd": ("localisation error, sd [cm]", 100.0),
    "noise.localisation_heading_sd": ("localisation error, sd [deg]", 180.0 / math.pi),
    "noise.slot_error_until_seen": ("error of the object's place, sd [cm]", 100.0),
    "noise.camera_position_sd_at_1m": ("camera error at 1 m, sd [cm]", 100.0),
    "noise.camera_position_sd_at_01m": ("camera error at 10 cm, sd [cm]", 100.0),
    "noise.base_speed_scale_sd": ("error of base speed, sd [%]", 100.0),
    "noise.arm_rate_sd": ("error of joint rates, sd [mrad/s]", 1000.0),
    "faults.cube_moved_by": ("cube moved on approach [cm]", 100.0),
    "faults.grasp_delay": ("delay of the grasp [s]", 1.0),
    "faults.grasp_misses": ("grasps that close on nothing", 1.0),
    "faults.grasp_slips": ("grasps that slip", 1.0),
}
RIVALS = (("D", RED, "published: Failure Recovery"), ("s", BLACK, "published: its reactive rival"))


def varied(result: Result) -> dict[str, float]:
    """The numeric parameters and scene fields that were changed for a trial, by name."""
    changed: Mapping[str, Any] = {**result["parameters"], **result["changes"]}
    return {
        name: float(value)
        for name, value in changed.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }


def sweeps_of(results: list[Result]) -> dict[str, dict[str, dict[float, list[Result]]]]:
    """Results by sweep ("scene: name"), method, and value.

    Without errors all sweeps of a scene are equal: that trial is run once and stands for value 0 in each.
    """
    found: dict[str, dict[str, dict[float, list[Result]]]] = {}
    plain: dict[tuple[str, str], dict[int, Result]] = {}  # trials without errors by (scene, method) and seed
    for result in results:
        for name, value in varied(result).items():
            if value == 0.0:
                plain.setdefault((result["scene"], result["method"]), {})[result["seed"]] = result
                continue
            title = f"{result['scene']}: {name}"
            found.setdefault(title, {}).setdefault(result["method"], {}).setdefault(value, []).append(result)
    for title, methods in found.items():
        for method, values in methods.items():
            without = plain.get((title.partition(": ")[0], method), {})
            if without:
                values[0.0] = list(without.values())
    return found


def error_points(results: list[Result], *, success: bool) -> list[dict]:
    """Share of success, or mean time of completed trials, with its interval, for each value of each sweep."""
    rows = []
    for title, methods in sweeps_of(results).items():
        for method, values in methods.items():
            for value, these in sorted(values.items()):
                estimate = successes(these) if success else statistics.mean(list(data.times(these).values()))
                rows.append(
                    {"sweep": title, "method": method, "value": value, "estimate": estimate.value,
                     "low": estimate.low, "high": estimate.high, "trials": len(these),
                     "completed": sum(map(data.completed, these))}
                )  # fmt: skip
    return rows


def draw_robustness(store: Store) -> Part:
    """Share of trials with success against each error."""
    caption = "Share of trials that end with success, with the interval of Clopper and Pearson."
    return _draw_errors(store, "robustness", "trials with success", caption, success=True)


def draw_grasp_delay(store: Store) -> Part:
    """Task time against the delay of each grasp, and against the number of grasps that miss or slip."""
    caption = (
        "Mean task time of the completed trials with Student's 95 % interval; open where not all were completed, "
        f"nothing where none was. Points alone: published, read off a chart, for another robot and layout; "
        f"{RECOVERY_PLANNED}."
    )
    return _draw_errors(store, "grasp_delay", "task time [s]", caption, success=False)


def success_notes(results: list[Result]) -> list[str]:
    """Success of each method over all errors and levels, and its loss against the first method, paired by seed."""
    shares: dict[str, dict[int, float]] = {}  # method: share of success by seed
    sentences = []
    for method in dict.fromkeys(result["method"] for result in results):
        these = [each for each in results if each["method"] == method and any(varied(each).values())]
        by_seed = {seed: [each for each in these if each["seed"] == seed] for seed in {each["seed"] for each in these}}
        shares[method] = {seed: successes(trials).value for seed, trials in by_seed.items()}
        if not these:
            continue
        done = sum(bool(each["success"]) for each in these)
        first = next(iter(shares))
        less = statistics.paired_difference(shares[first], shares[method])
        points = data.percent(less).replace(" %", " percentage points", 1)
        beside = "" if method == first else f", by seed {points} less than {data.title(first)}"
        sentences.append(f"{data.title(method)}: {done} of {len(these)} trials with an error end with success{beside}.")
    return sentences


def _draw_errors(store: Store, name: str, label: str, caption: str, *, success: bool) -> Part:
    results = store.of(name)
    rows = [row for row in error_points(results, success=success) if math.isfinite(row["estimate"])]
    if not rows:
        return Missing(reason=f"the experiment {name} was not run")
    sweeps = list(dict.fromkeys(row["sweep"] for row in rows))
    lines = (len(sweeps) + COLUMNS - 1) // COLUMNS
    with styled():
        fig = figure(TWO_COLUMNS, 18.0 + 46.0 * lines)
        axes = fig.subplots(lines, min(COLUMNS, len(sweeps)), squeeze=False)
        for panel in axes[:, 0]:
            panel.set_ylabel(label)
        for panel, sweep in zip(axes.flat, sweeps, strict=False):
            _error_panel(panel, [row for row in rows if row["sweep"] == sweep], success=success)
            scene, _, error = sweep.partition(": ")
            if not success:
                panel.set_title(scene.replace("_", " "))
            panel.set_xlabel(LABELS.get(error, (error, 1.0))[0])
            if error == DELAY and not success:
                _published(panel, scene)
            if success:
                panel.set_ylim(-0.05, 1.05)
        for unused in list(axes.flat)[len(sweeps) :]:
            unused.set_axis_off()
        legend_below(fig, axes.flat, columns=4)
    return Drawn(
        caption=caption,
        n=f"{len(results)} trials; of each point in the CSV",
        rows=rows,
        figure=fig,
        notes=success_notes(results) if success else (),
    )


def _published(axes, scene: str) -> None:
    """Draw the times of the article on failure recovery (another robot and layout) as points, not as a line."""
    for delay, times in FAILURE_RECOVERY.get(scene, {}).items():
        for (marker, colour, label), seconds in zip(RIVALS, times, strict=True):
            axes.plot(delay, seconds, marker, mfc="white", mec=colour, mew=1.2, ms=5, ls="", label=label)


def _error_panel(axes, rows: list[dict], *, success: bool) -> None:
    scale = LABELS.get(rows[0]["sweep"].partition(": ")[2], ("", 1.0))[1]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    span = max(row["value"] for row in rows) * scale
    for number, method in enumerate(methods):
        style = look(method)
        aside = 0.012 * span * (number - 0.5 * (len(methods) - 1))  # so that equal points stay visible
        these = [row for row in rows if row["method"] == method]
        x, y = [scale * row["value"] + aside for row in these], [row["estimate"] for row in these]
        for at, row in zip(x, these, strict=True):
            if math.isfinite(row["low"]):
                axes.plot([at, at], [row["low"], row["high"]], "-", color=style.colour, lw=0.8)
        name = data.title(method)
        axes.plot(x, y, style.line, marker=style.marker, color=style.colour, mec=BLACK, mew=0.4, label=name)
        part = [(at, row) for at, row in zip(x, these, strict=True) if row["completed"] < row["trials"]]
        for at, row in [] if success else part:
            axes.plot(at, row["estimate"], style.marker, mfc="white", mec=style.colour, mew=1.0)
    axes.grid(axis="y")
