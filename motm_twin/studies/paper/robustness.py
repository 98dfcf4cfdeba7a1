"""Robustness and grasp delay: success and time against the size of an error, for each method."""

import math
from collections.abc import Mapping
from typing import Any

from motm_twin.measures.published import FAILURE_RECOVERY, RECOVERY_PLANNED
from motm_twin.studies import statistics
from motm_twin.studies.catalogue import DELAY
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import Result, Store
from motm_twin.studies.paper.part import BLACK, RED, TWO_COLUMNS, Drawn, Missing, Part, figure, look, styled
from motm_twin.studies.paper.tables import successes

COLUMNS = 3  # panels beside each other
LABELS = {  # field of the scene: what it is, and what its number is multiplied with
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
    """The numbers that were changed for a trial, by name."""
    changed: Mapping[str, Any] = {**result["parameters"], **result["changes"]}
    return {
        name: float(value)
        for name, value in changed.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }


def sweeps_of(results: list[Result]) -> dict[str, dict[str, dict[float, list[Result]]]]:
    """Results by what is varied (scene and name), method, and value.

    Without errors all sweeps of a scene are equal: that trial is run once, and is the value at 0 of each.
    """
    found: dict[str, dict[str, dict[float, list[Result]]]] = {}
    plain: dict[tuple[str, str], dict[int, Result]] = {}  # scene and method: seed
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


def points(results: list[Result], *, success: bool) -> list[dict]:
    """Success, or task time of the completed trials, with its interval, for each value of each sweep."""
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
    return _draw(
        store.of("robustness"),
        "robustness",
        "Success against errors: reactive, and the same plan executed open-loop",
        "trials with success",
        "Share of trials that end with success, with the interval of Clopper and Pearson.",
        success=True,
    )


def draw_grasp_delay(store: Store) -> Part:
    """Task time against the delay of each grasp, and how many miss or slip."""
    return _draw(
        store.of("grasp_delay"),
        "grasp_delay",
        "Task time when grasps are late, miss or slip",
        "task time [s]",
        "Mean task time of the completed trials with Student's 95 % interval; open where not all were completed, "
        f"nothing where none was. Points alone: published, read off a chart, for another robot and layout; "
        f"{RECOVERY_PLANNED}.",
        success=False,
    )


def compared(results: list[Result]) -> list[str]:
    """Success with an error, over all errors and levels: of each method, and how much less than the first, by seed."""
    shares: dict[str, dict[int, float]] = {}  # method: share of success by seed
    said = []
    for method in dict.fromkeys(result["method"] for result in results):
        these = [each for each in results if each["method"] == method and any(varied(each).values())]
        by_seed = {seed: [each for each in these if each["seed"] == seed] for seed in {each["seed"] for each in these}}
        shares[method] = {seed: successes(trials).value for seed, trials in by_seed.items()}
        if not these:
            continue
        done = sum(bool(each["success"]) for each in these)
        first = next(iter(shares))
        less = statistics.paired_difference(shares[first], shares[method])
        beside = "" if method == first else f", by seed {data.points(less)} less than {data.title(first)}"
        said.append(f"{data.title(method)}: {done} of {len(these)} trials with an error end with success{beside}.")
    return said


def _draw(results: list[Result], name: str, title: str, label: str, caption: str, *, success: bool) -> Part:
    rows = points(results, success=success) if results else []
    rows = [row for row in rows if math.isfinite(row["estimate"])]
    if not rows:
        return Missing(name=name, title=title, reason=f"the experiment {name} was not run")
    sweeps = list(dict.fromkeys(row["sweep"] for row in rows))
    lines = (len(sweeps) + COLUMNS - 1) // COLUMNS
    with styled():
        fig = figure(TWO_COLUMNS, 18.0 + 46.0 * lines)
        axes = fig.subplots(lines, min(COLUMNS, len(sweeps)), squeeze=False)
        for panel in axes[:, 0]:
            panel.set_ylabel(label)
        for panel, sweep in zip(axes.flat, sweeps, strict=False):
            _panel(panel, [row for row in rows if row["sweep"] == sweep], success=success)
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
        handles = {h.get_label(): h for panel in axes.flat for h in panel.get_legend_handles_labels()[0]}
        fig.legend(handles=list(handles.values()), loc="outside lower center", ncols=4)
    return Drawn(
        name=name,
        title=title,
        caption=caption,
        n=f"{len(results)} trials; of each point in the CSV",
        rows=rows,
        figure=fig,
        notes=compared(results) if success else (),
    )


def _published(axes, scene: str) -> None:
    """Times of the article on failure recovery, of another robot and another layout: as points, not as a line."""
    for delay, times in FAILURE_RECOVERY.get(scene, {}).items():
        for (marker, colour, label), seconds in zip(RIVALS, times, strict=True):
            axes.plot(delay, seconds, marker, mfc="white", mec=colour, mew=1.2, ms=5, ls="", label=label)


def _panel(axes, rows: list[dict], *, success: bool) -> None:
    scale = LABELS.get(rows[0]["sweep"].partition(": ")[2], ("", 1.0))[1]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    span = max(row["value"] for row in rows) * scale
    for number, method in enumerate(methods):
        style = look(method)
        aside = 0.012 * span * (number - 0.5 * (len(methods) - 1))  # so that equal points are seen beside each other
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
