"""`motm-twin run --plot FILE`: speed along the path, and the time of each leg beside the reference tour."""

import itertools
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from motm_twin.control.tick import Tick
from motm_twin.measures.agents import Encounters
from motm_twin.measures.interval import STANDS, Sampler
from motm_twin.measures.measures import part_of
from motm_twin.model.names import scene_name
from motm_twin.model.profile import BaseLimits
from motm_twin.model.scene import Scene
from motm_twin.studies.paper.drawing import (
    BLACK,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    TWO_COLUMNS,
    YELLOW,
    figure,
    styled,
)

HEIGHT = 125.0  # [mm]
FORMATS = (".png", ".svg", ".pdf")
LONG = 0.3  # [s] shorter stops get no mark
LOOKS = {  # of `measures.PARTS`: colour, hatch, words
    "at_limit": (GREEN, "", "at the limit, forward"),
    "below_limit": (SKY, "....", "slower, straight"),
    "turning": (YELLOW, "////", "slower, turning"),
    "reversing": (PURPLE, "\\\\\\\\", "reversing"),
    "waiting_for_arm": (ORANGE, "xxxx", "waiting for the arm"),
    "evading": (RED, "++++", "evading"),
    "standing": (GREY, "", "standing"),
}


class Step(NamedTuple):
    """One period."""

    path: float  # [m] driven until its end
    speed: float  # [m/s], negative in reverse
    seconds: float
    part: str
    task: int


class SpeedFigure:
    """The figure of one trial: add every Tick in order, then `draw`."""

    def __init__(self, scene: Scene) -> None:
        self.limits = scene.robot.base
        self.steps: list[Step] = []
        self._sampler = Sampler(scene)
        self._encounters = Encounters(scene.robot.footprint)

    def add(self, tick: Tick) -> None:
        """Take the next Tick into account."""
        interval = self._sampler.interval(tick)
        if interval is None:
            return
        self._encounters.add(interval)
        part = part_of(interval, self.limits.forward_speed, evading=self._encounters.evading)
        before = self.steps[-1].path if self.steps else 0.0
        self.steps.append(Step(before + interval.path, interval.twist[0], interval.dt, part, interval.tick.task_index))

    def draw(self, result: dict[str, Any], file: Path | None = None) -> Any:
        """Draw the matplotlib figure, and write it to ``file``; ``result``: the report of the trial."""
        with styled():
            fig = figure(TWO_COLUMNS, HEIGHT)
            above, below = fig.subplots(2, 1, height_ratios=(3, 2))
            _speed(above, self.steps, self.limits)
            above.set_title(
                f"{scene_name(result['scene'], result['variant'])}, seed {result['seed']}, {result['method']}: "
                f"{result['time_s']:.1f} s, {result['path_length_m']:.1f} m; "
                f"reference tour {result['reference_tour_s']:.1f} s",
                pad=34.0,
            )
            _legs(below, result["measures"]["legs"], self.limits.forward_speed)
            present = [part for part in LOOKS if result["measures"]["parts_s"][part] > 0.0]
            handles = [_bar(below, 0.0, 0.0, 0.0, part, label=LOOKS[part][2]) for part in present]
            handles.append(
                below.plot([], [], "_", color=BLACK, ms=12, mew=1.6, label="reference tour, at the limit")[0]
            )
            fig.legend(handles=handles, loc="outside lower center", ncols=4)
            if file is not None:
                fig.savefig(file)
        return fig


def _speed(axes: Any, course: list[Step], limits: BaseLimits) -> None:
    """Speed over the distance driven, with the end of each task."""
    begin = 0.0
    for part, group in itertools.groupby(course, key=lambda step: step.part):
        steps = list(group)
        edges, speeds = np.array([begin, *(step.path for step in steps)]), [step.speed for step in steps]
        colour, hatch, _ = LOOKS[part]
        axes.stairs(speeds, edges, fill=True, facecolor=colour, hatch=hatch, edgecolor=BLACK, lw=0.0)
        axes.stairs(speeds, edges, color=BLACK, lw=0.5, baseline=None)
        stood = sum(step.seconds for step in steps if abs(step.speed) <= STANDS)
        if stood >= LONG:
            axes.plot(edges[-1], 0.0, "v", color=colour, mec=BLACK, mew=0.5, ms=5, clip_on=False, zorder=3)
            axes.annotate(
                f"{stood:.1f} s", (edges[-1], 0.0), (0, -11), textcoords="offset points", ha="center", size=7,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
            )  # fmt: skip
        begin = edges[-1]
    for value in (limits.forward_speed, -limits.reverse_speed):
        axes.axhline(value, color=BLACK, lw=0.6, ls=":")
    axes.axhline(0.0, color=BLACK, lw=0.6)
    axes.set_xlim(0.0, max(begin, 1e-3))
    axes.set_xlabel("distance driven [m]")
    axes.set_ylabel("speed [m/s]")
    for before, after in itertools.pairwise(course):
        if after.task != before.task:
            axes.axvline(before.path, color=BLACK, lw=0.6, ls="--")
            axes.annotate(
                str(before.task + 1), (before.path, 1.0), (0, 3), xycoords=("data", "axes fraction"),
                textcoords="offset points", ha="center", size=7,
            )  # fmt: skip
    axes.annotate(
        "task done", (0.0, 1.0), (0, 14), xycoords="axes fraction", textcoords="offset points", ha="left", size=7
    )


def _legs(axes: Any, legs: list[dict[str, Any]], limit: float) -> None:
    """The seconds of each leg by part, and a mark at the time of the reference tour."""
    for k, leg in enumerate(legs):
        bottom = 0.0
        for part in LOOKS:
            seconds = leg["parts_s"].get(part, 0.0)
            if seconds:
                _bar(axes, k, seconds, bottom, part)
                bottom += seconds
        if leg["reference_m"] is not None and leg["task"] != "done":
            axes.plot(k, leg["reference_m"] / limit, "_", color=BLACK, ms=12, mew=1.6)
    names = [f"{leg['index'] + 1}\n{leg['target']}" if leg["task"] != "done" else "end" for leg in legs]
    axes.set_xticks(range(len(legs)), names)
    axes.set_xlim(-0.6, len(legs) - 0.4)
    axes.set_ylabel("time [s]")
    axes.grid(axis="y")


def _bar(axes: Any, x: float, seconds: float, bottom: float, part: str, label: str = "") -> Any:
    colour, hatch, _ = LOOKS[part]
    return axes.bar(
        x, seconds, bottom=bottom, width=0.7, color=colour, hatch=hatch, edgecolor=BLACK, lw=0.4, label=label
    )
