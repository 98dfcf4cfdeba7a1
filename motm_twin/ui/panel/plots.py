"""Curves of the last minute with their limits and regions, as light SVG, and the panel of their own that shows them.

Drawn here and not by a plotting widget: regions, limits and units look as in the paper's figure, and one update is a
few kilobytes.
"""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import viser
from numpy.typing import NDArray

from motm_twin.bus.messages import TickMessage
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.model.edits import ParameterValue
from motm_twin.model.joint_limits import DQ_MAX
from motm_twin.model.physics import REFLEXES
from motm_twin.model.profile import BaseLimits
from motm_twin.ui.history import Sample
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.panel.score import BUDGET

WINDOW = 60.0  # [s]
EVERY = 5  # updates (of 0.1 s) between pictures
PANEL_WIDTH = 300  # [px]
PLOTS, PLOTS_KEY = "Plots of the last minute", "G"
TICKS = (60, 45, 30, 15, 0)  # [s] before the shown period
BUCKET = 0.25  # [s] of which the curve keeps least and largest; fixed in time, so that a curve only shifts
WIDTH, HEIGHT = 480, 80  # units of the drawing; it is stretched to the panel
APART = 15.0  # minimum units between two labels of an axis; the later one is left out
LETTERS = 11.0  # units that the name of a region needs
_FAR = 1.5  # [m] top of the plot of distances
_MOST_SLACK = 500.0  # [mm/s, deg/s] and of slack, which may be large while driving
_MOST_TIME = 100.0  # [ms] and of the period
_LIMIT, _ZERO = "var(--motm-red)", "var(--motm-line)"
JOINTS = ("var(--motm-blue)", "#0891b2", "#0d9488", "#65a30d", "#d97706", "#db2777", "#7c3aed")

STYLE = """<style>
.mp{font-size:11px;line-height:1.3;padding:1px 12px 4px 10px;font-variant-numeric:tabular-nums;color:var(--motm-mute)}
.mp b{color:var(--motm-ink);font-weight:600;font-size:12px}
.mp .t{display:flex;justify-content:space-between;align-items:baseline;white-space:nowrap}
.mp .n{color:var(--motm-ink)}
.mp .f{position:relative;height:74px;margin:4px 0 2px 32px;border:solid var(--motm-edge);border-width:0 0 1px 1px}
.mp svg{position:absolute;inset:0;width:100%;height:100%}
.mp path{fill:none;vector-effect:non-scaling-stroke;stroke-linejoin:round}
.mp .y{position:absolute;right:calc(100% + 4px);transform:translateY(-50%);font-size:10px}
.mp .r{position:absolute;left:4px;transform:translateY(-50%);font-size:10px;line-height:1;color:var(--motm-amber)}
.mp .c{position:absolute;left:3px;font-size:10px;line-height:1;color:var(--motm-ink);padding:1px 2px;
 background:var(--motm-paper)}
.mp .x{position:relative;height:13px;margin-left:32px;font-size:10px}
.mp .x span{position:absolute;transform:translateX(-50%);white-space:nowrap}
.mp .k{display:inline-block;width:14px;border-top:1.5px solid;vertical-align:middle;margin-right:3px}
</style>"""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One line of a plot; values in the unit of the plot, nan where there is none."""

    values: NDArray[np.float64]
    colour: str
    extremes: bool = True  # keep least and largest of every bucket; else only the last value


@dataclass(frozen=True, kw_only=True)
class Plot:
    """Curves with what they are compared with."""

    title: str  # HTML
    unit: str  # HTML
    now: str  # the newest values, HTML
    low: float
    high: float
    curves: tuple[Curve, ...]
    regions: tuple[tuple[float, float, str, str], ...] = ()  # from, to, colour, name
    limits: tuple[tuple[float, str], ...] = ()  # value, colour
    labels: tuple[tuple[float, str], ...] = field(default=())  # value, text at the axis; the important ones first


def plots_html(samples: NDArray[np.float64], base: BaseLimits, parameters: Mapping[str, ParameterValue]) -> str:
    """All plots of the samples (`History.samples`) that end at the shown period."""
    if not len(samples):
        return f'{STYLE}<div class="mp">no period yet</div>'
    drawn = [
        distance_plot(samples, parameters),
        *base_plots(samples, base),
        joint_plot(samples),
        slack_plot(samples),
        period_plot(samples),
        *(force_plots(samples) if np.isfinite(_column(samples, "torque")).any() else ()),
    ]
    time = samples[:, 0]
    return STYLE + _key() + "".join(draw(plot, time) for plot in drawn) + _time_axis(float(time[-1]))


def bands(parameters: Mapping[str, ParameterValue]) -> tuple[float, float, float]:
    """Current values of d_s [m], d_i [m] and xi [m/s]."""
    shipped = AvoidanceParameters()
    d_s, d_i, xi = (float(parameters.get(name, getattr(shipped, name))) for name in ("d_s", "d_i", "xi"))
    return d_s, d_i, xi


def _column(samples: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    return samples[:, Sample._fields.index(name)]


def distance_plot(samples: NDArray[np.float64], parameters: Mapping[str, ParameterValue]) -> Plot:
    """Gripper to the nearest seen obstacle, with the regions of the paper's figure."""
    d_s, d_i, _ = bands(parameters)
    distance = _column(samples, "distance")
    return Plot(
        title="Gripper to obstacle",
        unit="m",
        now=number(distance[-1], ".2f", none="none seen near"),
        low=0.0,
        high=_FAR,
        curves=(Curve(values=distance, colour="var(--motm-ink)"),),
        regions=(
            (0.0, d_s, "var(--motm-near)", "&lt; d<sub>s</sub> too near"),
            (d_s, d_i, "var(--motm-slow)", "&lt; d<sub>i</sub> slows down"),
        ),
        labels=((d_s, f"{d_s:g}"), (d_i, f"{d_i:g}"), (_FAR, f"{_FAR:g}"), (1.0, "1"), (0.0, "0")),
    )


def base_plots(samples: NDArray[np.float64], base: BaseLimits) -> tuple[Plot, Plot]:
    """Forward speed and yaw rate of the base with their limits."""
    speed, turn = _column(samples, "speed"), np.degrees(_column(samples, "yaw_rate"))
    moves, turns = (Curve(values=values, colour="var(--motm-blue)", extremes=False) for values in (speed, turn))
    spin, now = math.degrees(base.yaw_rate), number(speed[-1], "+.2f")
    return (
        _limited("Base speed", "m/s", now, (moves,), (-base.reverse_speed, base.forward_speed), "g"),
        _limited("Yaw rate", "&deg;/s", number(turn[-1], "+.0f"), (turns,), (-spin, spin), ".0f"),
    )


def _limited(
    title: str, unit: str, now: str, curves: tuple[Curve, ...], limits: tuple[float, float], form: str
) -> Plot:
    """A plot of a quantity between two limits, both with a little room beyond them."""
    low, high = limits
    room = 0.075 * (high - low)
    return Plot(
        title=title, unit=unit, now=now, low=low - room, high=high + room, curves=curves,
        limits=((0.0, _ZERO), (high, _LIMIT), (low, _LIMIT)),
        labels=((high, number(high, form)), (0.0, "0"), (low, number(low, form))),
    )  # fmt: skip


def joint_plot(samples: NDArray[np.float64]) -> Plot:
    """Rates of the seven joints as shares of their limits."""
    rates = 100.0 * np.stack([_column(samples, f"dq{k}") for k in range(1, 8)], axis=1) / DQ_MAX
    fastest = int(np.nanargmax(np.abs(rates[-1]))) if np.isfinite(rates[-1]).any() else 0
    names = " ".join(f'<span style="color:{colour}">{k}</span>' for k, colour in enumerate(JOINTS, 1))
    now = number(rates[-1, fastest], "+.0f")
    now = f"joint {fastest + 1}: {now}" if now not in ("", "0") else now
    curves = tuple(Curve(values=rates[:, k], colour=JOINTS[k], extremes=False) for k in range(7))
    return _limited(f"Joint rates {names}", "% of limit", now, curves, (-100.0, 100.0), ".0f")


def slack_plot(samples: NDArray[np.float64]) -> Plot:
    """Slack of the hand's velocity: the part that it misses."""
    linear, angular = 1e3 * _column(samples, "linear_slack"), np.degrees(_column(samples, "angular_slack"))
    high = min(_round_up(np.nanmax(np.concatenate([linear, angular, [20.0]]))), _MOST_SLACK)
    parts = (number(linear[-1], ".0f"), number(angular[-1], ".0f"))
    return Plot(
        title='Slack <span style="color:var(--motm-blue)">linear</span>, <span style="color:#d97706">angular</span>',
        unit="mm/s, &deg;/s",
        now=", ".join(filter(None, parts)),
        low=0.0,
        high=high,
        curves=(Curve(values=angular, colour="#d97706"), Curve(values=linear, colour="var(--motm-blue)")),
        labels=((0.0, "0"), (high, f"{high:g}"), (high / 2, f"{high / 2:g}")),
    )


def period_plot(samples: NDArray[np.float64]) -> Plot:
    """Computing time of the period against its budget."""
    period = _column(samples, "period")
    high = min(max(1.2 * BUDGET, _round_up(np.nanmax(np.append(period, 0.0)))), _MOST_TIME)
    return Plot(
        title="Computing time of a period",
        unit="ms",
        now=number(period[-1], ".1f"),
        low=0.0,
        high=high,
        curves=(Curve(values=period, colour="#0d9488"),),
        limits=((BUDGET, _LIMIT),),
        labels=((0.0, "0"), (BUDGET, f"{BUDGET:.0f}"), (high, f"{high:g}")),
    )


def force_plots(samples: NDArray[np.float64]) -> tuple[Plot, Plot, Plot]:
    """Under contact dynamics: forces of the fingers, external torque with the Panda's reflexes, force at the wrist."""
    left, right, torque, wrist = (_column(samples, name) for name in ("left", "right", "torque", "wrist"))
    colours = ("#2563eb", "#d97706")
    fingers = tuple(Curve(values=each, colour=colour) for each, colour in zip((left, right), colours, strict=True))
    now = ", ".join(filter(None, (number(left[-1], ".0f"), number(right[-1], ".0f"))))
    title = f'Fingers <span style="color:{colours[0]}">left</span>, <span style="color:{colours[1]}">right</span>'
    feels = _upwards("External torque, largest joint", "Nm", (Curve(values=torque, colour="#7c3aed"),), (10.0, 30.0))
    reflexes = tuple(REFLEXES.values())
    return (
        replace(_upwards(title, "N", fingers, (20.0, 40.0)), now=now),
        replace(feels, limits=tuple((limit, _LIMIT) for limit in reflexes)),
        _upwards("Force at the wrist", "N", (Curve(values=wrist, colour="#0d9488"),), (10.0, 20.0)),
    )


def _upwards(title: str, unit: str, curves: tuple[Curve, ...], marks: tuple[float, float]) -> Plot:
    """A plot from 0 to the upper mark, or as far as the curves go."""
    most = max((float(np.nanmax(one.values)) for one in curves if np.isfinite(one.values).any()), default=0.0)
    high = max(marks[1], _round_up(most))
    return Plot(
        title=title, unit=unit, now=number(curves[0].values[-1], ".1f"), low=0.0, high=high, curves=curves,
        labels=((0.0, "0"), (high, f"{high:g}"), (marks[0], f"{marks[0]:g}")),
    )  # fmt: skip


def number(value: float, form: str, *, none: str = "") -> str:
    """A number as HTML with a true minus sign and no sign before zero, or the text for none."""
    if not math.isfinite(value):
        return none
    text = f"{value:{form}}"
    if float(text) == 0.0:
        text = text.lstrip("+-")
    return text.replace("-", "&minus;")


def _round_up(value: float) -> float:
    """1, 2 or 5 times a power of ten, at least the value."""
    power = 10.0 ** math.floor(math.log10(max(value, 1e-6)))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value - 1e-12)


def draw(plot: Plot, time: NDArray[np.float64]) -> str:
    """One plot as HTML with an SVG that stretches."""
    parts = [
        f'<rect x="0" width="{WIDTH}" y="{_y(plot, high):.0f}" height="{_y(plot, low) - _y(plot, high):.0f}" '
        f'fill="{colour}"/>'
        for low, high, colour, _ in plot.regions
    ]
    parts += [
        f'<path d="M{_x(ago):.0f} 0v{HEIGHT}" stroke="var(--motm-line)" stroke-width="1"/>'
        for ago in TICKS
        if 0 < ago < WINDOW
    ]
    parts += [
        f'<path d="M0 {_y(plot, value):.0f}h{WIDTH}" stroke="{colour}" stroke-width="1" stroke-dasharray="4 3"/>'
        for value, colour in plot.limits
    ]
    for curve in plot.curves:
        path = path_of(time, curve, plot.low, plot.high)
        parts.append(f'<path d="{path}" stroke="{curve.colour}" stroke-width="1.3"/>')
    return (
        f'<div class="mp"><div class="t"><span><b>{plot.title}</b> [{plot.unit}]</span>'
        f'<span class="n">{plot.now}</span></div><div class="f">'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none">{"".join(parts)}</svg>'
        f"{_region_names(plot)}{_labels(plot)}{_cut_off(plot)}</div></div>"
    )


def _labels(plot: Plot) -> str:
    """Numbers at the axis; one that would touch an earlier one is left out."""
    placed: dict[float, str] = {}
    for value, label in plot.labels:
        y = _y(plot, value)
        if all(abs(y - other) >= APART for other in placed):
            placed[y] = label
    return "".join(
        f'<span class="y" style="top:{100.0 * y / HEIGHT:.0f}%">{label}</span>' for y, label in placed.items()
    )


def _region_names(plot: Plot) -> str:
    """The name of each region inside it, where it is high enough for letters."""
    return "".join(
        f'<span class="r" style="top:{50.0 * (_y(plot, low) + _y(plot, high)) / HEIGHT:.0f}%">{name}</span>'
        for low, high, _, name in plot.regions
        if _y(plot, low) - _y(plot, high) >= LETTERS
    )


def _cut_off(plot: Plot) -> str:
    """Note on how far curves extend beyond the frame."""
    values = np.concatenate([curve.values[np.isfinite(curve.values)] for curve in plot.curves])
    least, most = (float(values.min()), float(values.max())) if len(values) else (plot.low, plot.high)
    up = f'<span class="c" style="top:1px">&#9650; up to {_size(most)}</span>' if most > plot.high else ""
    down = f'<span class="c" style="bottom:1px">&#9660; down to {_size(least)}</span>' if least < plot.low else ""
    return up + down


def path_of(time: NDArray[np.float64], curve: Curve, low: float, high: float) -> str:
    """The curve as an SVG path in whole units; gaps where there is no value."""
    bucket = np.floor(time / BUCKET + 1e-9)
    starts = np.flatnonzero(np.diff(bucket, prepend=bucket[0] - 1.0))
    ends = np.append(starts[1:], len(time)) - 1
    x = np.round((1.0 + (time[ends] - time[-1]) / WINDOW) * WIDTH).astype(int)
    if curve.extremes:
        with np.errstate(invalid="ignore"):
            least, most = np.fmin.reduceat(curve.values, starts), np.fmax.reduceat(curve.values, starts)
        x = np.repeat(x, 2)
        values = np.stack([least, most], axis=1).ravel()
    else:
        values = curve.values[ends]
    share = (np.clip(values, low, high) - low) / (high - low)
    found = np.isfinite(share)
    points = np.stack([x, np.round((1.0 - np.where(found, share, 0.0)) * HEIGHT).astype(int)], axis=1)
    breaks = np.flatnonzero(np.diff(found, prepend=False, append=False))
    return "".join(_line(points[start:end]) for start, end in breaks.reshape(-1, 2))


def _line(points: NDArray[np.int64]) -> str:
    """Through these points, shape (n, 2), in steps from each to the next."""
    steps = np.diff(points, axis=0)
    steps = steps[(steps != 0).any(axis=1)]
    start = f"M{points[0, 0]} {points[0, 1]}l"
    return start + ("%d %d " * len(steps) % tuple(steps.ravel().tolist()) if len(steps) else "0 0")


def _y(plot: Plot, value: float) -> float:
    return HEIGHT * (1.0 - (value - plot.low) / (plot.high - plot.low))


def _size(value: float) -> str:
    return number(value, ".0f" if abs(value) >= 100.0 else ".3g")


def _x(ago: float) -> float:
    return WIDTH * (1.0 - ago / WINDOW)


def _key() -> str:
    """Key of the dashed red line, once for all plots."""
    return f'<div class="mp"><span class="k" style="border-top-style:dashed;color:{_LIMIT}"></span>limit</div>'


def _time_axis(end: float) -> str:
    marks = "".join(
        f'<span style="left:{100.0 * _x(ago) / WIDTH:.0f}%">{"&minus;" if ago else ""}{ago}</span>' for ago in TICKS
    )
    return (
        f'<div class="mp"><div class="x">{marks}</div>'
        f'<div style="text-align:center;margin-left:32px">time [s]; 0 is {end:.2f} s of the run</div></div>'
    )


class PlotsPanel:
    """The plots in a panel at the left, opened by a button or the key G. Closed at the start; costs nothing then."""

    def __init__(self, gui: viser.GuiApi, hub: Hub) -> None:
        self._gui, self._hub = gui, hub
        self._panel: viser.PanelHandle | None = None
        self._page: viser.GuiHtmlHandle | None = None
        self._lock = threading.Lock()  # the panel is opened and closed in another thread than it is drawn in
        self._count = 0
        self._drawn: TickMessage | None = None
        toggle, hint = hub.watching(self._toggle), f"curves of the last minute; key {PLOTS_KEY}"
        self._button = gui.add_button("Plots", icon=viser.Icon.CHART_LINE, hint=hint)
        self._button.on_click(toggle)
        gui.add_command(PLOTS, hotkey=PLOTS_KEY).on_trigger(toggle)

    def update(self, shown: Shown) -> None:
        """Draw the last minute up to the shown period."""
        page, history, tick = self._page, self._hub.history, shown.tick
        self._count += 1
        if page is None or history is None or tick is None or shown.scene is None:
            return
        if tick is self._drawn or self._count % EVERY:
            return
        self._drawn = tick
        samples = history.samples(None if shown.live else tick.index, WINDOW)
        drawn = plots_html(samples, shown.scene.robot.base, {} if shown.status is None else shown.status.parameters)
        with self._lock:
            if self._page is page:  # not closed meanwhile
                page.content = drawn

    def _toggle(self, _event: object, _visitor: Visitor) -> None:
        panel = self._panel
        if panel is not None:
            with self._lock:
                self._panel = self._page = None
                panel.remove()
        else:
            panel = self._gui.add_panel()
            with panel.add_tab("Plots", viser.Icon.CHART_LINE):
                self._page = self._gui.add_html("&nbsp;")
            panel.dock_left()
            panel.set_width(PANEL_WIDTH)
            self._panel, self._drawn = panel, None
        self._button.label = "Plots" if self._panel is None else "Close plots"
