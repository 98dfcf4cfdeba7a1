"""The run in numbers: the referee's score beside published times, the time that each period takes, and curves.

Curves are of the last minute, with their limits and regions, in a panel of their own.
"""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from motm_twin.bus.messages import ScoreMessage, StatusMessage, TickMessage
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.task_list import kind_of, name_of
from motm_twin.measures.references import REFERENCE_TOUR_NOTE, published
from motm_twin.model.edits import ParameterValue
from motm_twin.model.geometry import Array
from motm_twin.model.profile import DQ_MAX, BaseLimits
from motm_twin.model.scene import REFLEXES, Scene
from motm_twin.ui.history import STAGES, Sample
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.panel.widgets import (
    AMBER,
    GREEN,
    RED,
    bar,
    card,
    ends,
    explained,
    heading,
    mark,
    metres,
    piece,
    table,
    text,
)

BUDGET = 50.0  # [ms] of one period
TIMING_WINDOW = 10.0  # [s]
_PERIOD_NAME = f"Computing, last {TIMING_WINDOW:.0f} s"
_PERIOD_WORDS = "Time from the sensors to the commands of one control period of 50 ms."
_SCALE = 1.2 * BUDGET  # [ms] length of the bars
_STAGE_STYLES = {  # stage of the period: name and colour
    "map": ("map from the scan", "#0d9488"),
    "place": ("places to stand", "#65a30d"),
    "plan": ("way and plan", "#2563eb"),
    "arm": ("arm", "#9333ea"),
    "monitor": ("checks", "#f59e0b"),
}
_COLUMNS = ("ms", explained("half", "p50: half of the periods take less"), explained("99 %", "p99"), "max")
_FIRST, _PERIOD = Sample._fields.index(STAGES[0]), Sample._fields.index("period")


def score_card(tick: TickMessage, status: StatusMessage | None, scene: Scene | None = None) -> str:
    """The referee's count up to the shown period, and the published times of this task."""
    rows: list[tuple[str, ...]] = [("time", f"<b>{_time(tick):.2f} s</b>")]
    if tick.score is not None:
        rows += _count(tick, tick.score)
    tasks = sorted((task.kind, task.target) for task in tick.tasks)  # published times are for these tasks, in any order
    if scene is not None and tasks != sorted((kind_of(task), name_of(task)) for task in scene.tasks):
        beside = '<hr><div class="mu">the task list was changed: no time to compare with</div>'
    else:
        rows += _tour(tick, status)
        beside = _published(tick, status)
    return card(heading(explained("Score", "as the referee counts", "referee")), table(rows), beside)


def _time(tick: TickMessage) -> float:
    """Time [s] of the work, without the 2 s after it in which the robot comes to rest."""
    return tick.time if tick.ended is None else tick.ended


def progress(tick: TickMessage, status: StatusMessage | None, scene: Scene | None = None) -> str:
    """Picks, places and contacts so far in one line, as HTML; the whole `score_card` for a finished run."""
    score = tick.score
    if tick.done:
        return score_card(tick, status, scene)
    if score is None:
        return ""
    picks, places, ours, others = _counts(tick, score)
    contacts = f'<span style="color:{RED if ours else GREEN}">contacts {ours}</span>'
    contacts += f" (+{others} by others)" if others else ""
    done = f"picked {score.picks}/{picks} &middot; placed {score.places}/{places}"
    return card(f'<div class="mu">{done} &middot; {contacts}</div>', style="padding:0 12px 6px 12px")


def _counts(tick: TickMessage, score: ScoreMessage) -> tuple[int, int, int, int]:
    """Picks and places of the list; contacts caused by the robot, and by others."""
    picks, places = (sum(task.kind == kind for task in tick.tasks) for kind in ("pick", "place"))
    ours = sum(contact.caused_by_robot for contact in score.contacts)
    return picks, places, ours, len(score.contacts) - ours


def _count(tick: TickMessage, score: ScoreMessage) -> list[tuple[str, ...]]:
    picks, places, ours, others = _counts(tick, score)
    contacts = f'<b style="color:{RED if ours else GREEN}">{ours}</b>' + (f", {others} by others" if others else "")
    rows: list[tuple[str, ...]] = [
        ("picked", f"{score.picks} of {picks}"),
        ("placed", f"{score.places} of {places}"),
        ("contacts of the robot", contacts),
    ]
    if score.drops:
        rows.append(("dropped", str(score.drops) + (f", {len(score.dropped)} not put right" if score.dropped else "")))
    if score.cut_ins:
        rows.append(("cut in on agents", str(len(score.cut_ins))))
    return [
        *rows,
        ("least clearance, base", metres(score.min_base_clearance)),
        ("least clearance, arm", metres(score.min_arm_clearance)),
        ("least, gripper to others", metres(score.min_ee_obstacle)),
        ("distance driven", f"{score.path_length:.1f} m"),
    ]


def _tour(tick: TickMessage, status: StatusMessage | None) -> list[tuple[str, ...]]:
    tour = None if status is None else status.reference_tour
    if tour is None or tour <= 0.0:
        return []
    name = explained("reference tour", REFERENCE_TOUR_NOTE, "tour")
    ratio = f"{_time(tick) / tour:.2f}" if tick.done else f"{tick.time / tour:.2f} so far"
    return [(name, f"{tour:.1f} s"), ("time / reference tour", ratio)]


def _published(tick: TickMessage, status: StatusMessage | None) -> str:
    known = () if status is None else published(status.scene, status.variant)
    if not known:
        return '<hr><div class="mu">no published time for this task</div>'
    rows: list[tuple[str, ...]] = []
    for entry in known:
        name = f'<span class="mu" title="{text(entry.source)}">{text(entry.what)}</span>'
        success = f" ({entry.success})" if entry.success else ""
        against = ""
        if tick.done and tick.success:
            share = 100.0 * (_time(tick) / entry.seconds - 1.0)
            against = f' <span style="color:{GREEN if share <= 0.0 else RED}">{share:+.0f} %</span>'
        rows.append((name, f"{entry.seconds:.1f} s{success}{against}"))
    sources = ", ".join(dict.fromkeys(entry.source.split(",")[0] + "," + entry.source.split(",")[1] for entry in known))
    return f'<hr>{table(rows)}<div class="mu" style="font-size:11px">{text(sources)}</div>'


def timing_card(samples: NDArray[np.float64]) -> str:
    """Computing times of the last periods by stage; ``samples`` as from `History.samples`."""
    rows = samples[np.isfinite(samples[:, _PERIOD])]
    if not len(rows):
        return card(heading("Timing"), '<div class="mu">no period yet</div>')
    period = rows[:, _PERIOD]
    stages = [(name, rows[:, _FIRST + k]) for k, name in enumerate(STAGES) if np.isfinite(rows[:, _FIRST + k]).any()]
    p50, p99 = np.percentile(period, (50, 99))
    worst = int(np.argmax(period))
    over = int((period > BUDGET).sum())
    colour = GREEN if over == 0 else RED if over > 0.01 * len(period) else AMBER
    late = f'<b style="color:{colour}">{over} of {len(period)} over {BUDGET:.0f} ms</b>'
    bars = _stack("typical", [(name, float(np.nanmedian(values))) for name, values in stages])
    bars += _stack("slowest", [(name, float(values[worst])) for name, values in stages])
    cells: list[tuple[str, ...]] = [tuple(f'<span class="mu">{name}</span>' for name in _COLUMNS)]
    for name, values in stages:
        title, colour = _STAGE_STYLES[name]
        dot = f'<span style="color:{colour}">&#9632;</span> {title}'
        low, high = np.nanpercentile(values, (50, 99))
        cells.append((dot, f"{low:.1f}", f"{high:.1f}", f"{np.nanmax(values):.1f}"))
    cells.append(("<b>period</b>", f"<b>{p50:.1f}</b>", f"<b>{p99:.1f}</b>", f"<b>{period.max():.1f}</b>"))
    return card(ends(heading(explained(_PERIOD_NAME, _PERIOD_WORDS, "period")), late), bars, table(cells))


def _stack(label: str, stages: list[tuple[str, float]]) -> str:
    parts, at = [], 0.0
    for name, value in stages:
        if np.isfinite(value):
            parts.append(piece(at / _SCALE, (at + value) / _SCALE, _STAGE_STYLES[name][1]))
            at += value
    content = bar(*parts, mark(BUDGET / _SCALE, RED), height=12)
    return f'<div class="row"><span class="mu" style="width:48px">{label}</span><div class="fill">{content}</div></div>'


WINDOW = 60.0  # [s]
EVERY = 5  # updates (of 0.1 s) from one redraw to the next
PANEL_WIDTH, HEIGHT, AXIS = 320, 92, 46  # [px] of the panel; of a plot, and of its time axis
FONT = "10px sans-serif"
PLOTS, PLOTS_KEY = "Plots of the last minute", "G"
BUCKET = 0.5  # [s] per value of a curve; fixed in time, so that a curve only shifts
WORST = dict.fromkeys(("linear_slack", "angular_slack", "period", "torque", "wrist"), np.fmax) | {"distance": np.fmin}
FAR = 1.5  # [m] top of the plot of distances; a missing distance is drawn beyond it, out of sight
BLUE, ORANGE, TEAL, VIOLET, LIMIT = "#3b82d6", "#d97706", "#0d9488", "#8b5cf6", "#dc4a4a"
JOINTS = (BLUE, "#0891b2", TEAL, "#65a30d", ORANGE, "#db2777", VIOLET)  # readable on light and on dark pages
NEAR, SLOW = "rgba(220, 60, 60, 0.22)", "rgba(240, 160, 40, 0.22)"  # regions, as in the paper's figure


@dataclass(frozen=True, kw_only=True)
class Plot:
    """Curves with their limits and regions."""

    title: str  # HTML
    unit: str  # HTML
    now: str  # the newest values, HTML
    curves: tuple[tuple[Array, str], ...]  # values, shape (n,), and colour
    limits: tuple[float, ...] = ()  # dashed lines
    regions: tuple[tuple[float, str], ...] = ()  # upper end and colour, from 0 up
    range: tuple[float, float | None] = (0.0, None)  # lower and upper end; None: from the curves

    def data(self, time: Array) -> tuple[Array, ...]:
        """Columns of a plot, each shape (n,): times [s], curves, limits, and ends of the regions."""
        ends = (*self.limits, *((0.0, *(end for end, _ in self.regions)) if self.regions else ()))
        return (time, *(values for values, _ in self.curves), *(np.full(len(time), end) for end in ends))

    def add(self, gui: viser.GuiApi, time: Array, *, last: bool) -> viser.GuiUplotHandle:
        """Add the widget of this plot; the ``last`` one has the time axis for all."""
        none = {"points": {"show": False}}
        series: list[Any] = [{}, *({"stroke": colour, "width": 1.5, **none} for _, colour in self.curves)]
        series += [{"width": 1, "stroke": LIMIT, "dash": (5, 4), **none} for _ in self.limits]
        first = len(series)
        series += [{"width": 0, **none} for _ in range(len(self.regions) + bool(self.regions))]
        bands: list[Any] = [
            {"series": (first + k + 1, first + k), "fill": fill} for k, (_, fill) in enumerate(self.regions)
        ]
        axes: list[Any] = [
            {"show": last, "size": 26, "label": "time of the run [s]", "labelSize": AXIS - 26, "labelFont": FONT},
            {"size": 42, "space": 24},
        ]
        for axis in axes:
            axis["font"] = FONT
        return gui.add_uplot(
            self.data(time), tuple(series), bands=tuple(bands), axes=tuple(axes), legend={"show": False},
            scales={"x": {"time": False}, "y": {"range": self.range}}, cursor={"sync": {"key": "motm"}},
            height=HEIGHT + AXIS * last, padding=(6, 10, 0 if last else 6, 0),
        )  # fmt: skip

    @property
    def heading(self) -> str:
        """Title, unit and newest values, HTML."""
        return f'<div class="mp"><span><b>{self.title}</b> [{self.unit}]</span><span class="n">{self.now}</span></div>'


def thinned(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """One row for every `BUCKET`: its last period, with the worst value of its periods in the columns of `WORST`."""
    bucket = np.floor(samples[:, 0] / BUCKET + 1e-9)
    starts = np.flatnonzero(np.diff(bucket, prepend=bucket[0] - 1.0))
    rows = samples[np.append(starts[1:], len(samples)) - 1].copy()
    for name, worst in WORST.items():
        column = Sample._fields.index(name)
        rows[:, column] = worst.reduceat(samples[:, column], starts)
    return rows


def plots(samples: NDArray[np.float64], base: BaseLimits, parameters: Mapping[str, ParameterValue]) -> list[Plot]:
    """All plots of the samples (`History.samples`, at least one), which end at the shown period."""
    column = {name: samples[:, k] for k, name in enumerate(Sample._fields)}
    d_s, d_i, _ = bands(parameters)
    distance, spin = column["distance"], math.degrees(base.yaw_rate)
    turn, rates = np.degrees(column["yaw_rate"]), [100.0 * column[f"dq{k}"] / DQ_MAX[k - 1] for k in range(1, 8)]
    linear, angular = 1e3 * column["linear_slack"], np.degrees(column["angular_slack"])
    names = " ".join(f'<span style="color:{colour}">{k}</span>' for k, colour in enumerate(JOINTS, 1))
    found = [
        Plot(title="Gripper to obstacle", unit="m; red &lt; d<sub>s</sub>, orange &lt; d<sub>i</sub>",
             now=number(distance[-1], ".2f", none="none near"), range=(0.0, FAR), regions=((d_s, NEAR), (d_i, SLOW)),
             curves=((np.where(np.isfinite(distance), distance, 2.0 * FAR), BLUE),)),
        _limited("Base speed", "m/s", ((column["speed"], BLUE),), (-base.reverse_speed, base.forward_speed), "+.2f"),
        _limited("Yaw rate", "&deg;/s", ((turn, BLUE),), (-spin, spin), "+.0f"),
        _limited(f"Joint rates {names}", "% of limit", tuple(zip(rates, JOINTS, strict=True)), (-100.0, 100.0), ""),
        Plot(title=f"Slack {_named(('straight', BLUE), ('turning', ORANGE))}", unit="mm/s, &deg;/s",
             now=_pair(linear[-1], angular[-1]), curves=((linear, BLUE), (angular, ORANGE))),
        Plot(title="Computing time of a period", unit="ms", now=number(column["period"][-1], ".1f"),
             curves=((column["period"], TEAL),), limits=(BUDGET,), range=(0.0, 2.0 * BUDGET)),
    ]  # fmt: skip
    if np.isfinite(column["torque"]).any():  # under contact dynamics
        left, right, torque, wrist = (column[name] for name in ("left", "right", "torque", "wrist"))
        found += [
            Plot(title=f"Fingers {_named(('left', BLUE), ('right', ORANGE))}", unit="N", now=_pair(left[-1], right[-1]),
                 curves=((left, BLUE), (right, ORANGE))),
            Plot(title="External torque, largest joint", unit="Nm, every 50 ms", now=number(torque[-1], ".1f"),
                 curves=((torque, VIOLET),), limits=tuple(REFLEXES.values())),
            Plot(title="Force at the wrist", unit="N", now=number(wrist[-1], ".1f"), curves=((wrist, TEAL),)),
        ]  # fmt: skip
    return found


def bands(parameters: Mapping[str, ParameterValue]) -> tuple[float, float, float]:
    """Current values of d_s [m], d_i [m] and xi [m/s]."""
    shipped = AvoidanceParameters()
    d_s, d_i, xi = (float(parameters.get(name, getattr(shipped, name))) for name in ("d_s", "d_i", "xi"))
    return d_s, d_i, xi


def _limited(
    title: str, unit: str, curves: tuple[tuple[Array, str], ...], limits: tuple[float, float], form: str
) -> Plot:
    """A plot of a quantity between two limits, both with a little room beyond them."""
    room, now = 0.075 * (limits[1] - limits[0]), number(curves[0][0][-1], form) if form else ""
    return Plot(
        title=title, unit=unit, now=now, curves=curves, limits=limits, range=(limits[0] - room, limits[1] + room)
    )


def _named(*curves: tuple[str, str]) -> str:
    return ", ".join(f'<span style="color:{colour}">{name}</span>' for name, colour in curves)


def _pair(first: float, second: float) -> str:
    return ", ".join(filter(None, (number(first, ".0f"), number(second, ".0f"))))


def number(value: float, form: str, *, none: str = "") -> str:
    """A number as HTML with a true minus sign and no sign before zero, or the text for none."""
    if not math.isfinite(value):
        return none
    text = f"{value:{form}}"
    if float(text) == 0.0:
        text = text.lstrip("+-")
    return text.replace("-", "&minus;")


class PlotsPanel:
    """The plots in a panel at the left, opened by a button or the key G. Closed at first, and then costs nothing."""

    def __init__(self, gui: viser.GuiApi, hub: Hub) -> None:
        self._gui, self._hub = gui, hub
        self._panel: viser.PanelHandle | None = None
        self._tab: Any = None
        self._drawn: list[tuple[viser.GuiHtmlHandle, viser.GuiUplotHandle]] = []
        self._ranges: list[tuple[float, float | None]] = []  # of the drawn plots
        self._lock = threading.Lock()  # one thread opens and closes the panel, another draws it
        self._count = 0
        self._tick: TickMessage | None = None
        toggle, hint = hub.watching(self._toggle), f"curves of the last minute; key {PLOTS_KEY}"
        self._button = gui.add_button("Plots", icon=viser.Icon.CHART_LINE, hint=hint)
        self._button.on_click(toggle)
        gui.add_command(PLOTS, hotkey=PLOTS_KEY).on_trigger(toggle)

    def update(self, shown: Shown) -> None:
        """Draw the last minute up to the shown period."""
        history, tick = self._hub.history, shown.tick
        self._count += 1
        if self._panel is None or history is None or tick is None or shown.scene is None:
            return
        if tick is self._tick or self._count % EVERY:
            return
        self._tick = tick
        samples = history.samples(None if shown.live else tick.index, WINDOW)
        if not len(samples):
            return
        rows = thinned(samples)
        found = plots(rows, shown.scene.robot.base, {} if shown.status is None else shown.status.parameters)
        with self._lock:
            if self._panel is not None:  # not closed in the meantime
                self._draw(found, rows[:, 0])

    def _draw(self, found: list[Plot], time: Array) -> None:
        """Fill in the widgets; make them first, and again when the ranges change (other robot, forces)."""
        ranges = [plot.range for plot in found]
        if ranges != self._ranges:
            self._ranges = ranges
            for handle in (handle for pair in self._drawn for handle in pair):
                handle.remove()
            with self._tab:
                self._drawn = [
                    (self._gui.add_html(""), plot.add(self._gui, time, last=plot is found[-1])) for plot in found
                ]
        for plot, (title, drawn) in zip(found, self._drawn, strict=True):
            title.content = plot.heading
            drawn.data = plot.data(time)

    def _toggle(self, _event: object, _visitor: Visitor) -> None:
        panel = self._panel
        if panel is not None:
            with self._lock:
                self._panel, self._drawn, self._ranges = None, [], []
                panel.remove()
        else:
            panel = self._gui.add_panel()
            self._tab = panel.add_tab("Plots", viser.Icon.CHART_LINE)
            panel.dock_left()
            panel.set_width(PANEL_WIDTH)
            self._panel, self._tick = panel, None
        self._button.label = "Plots" if self._panel is None else "Close plots"
