"""Curves of the last minute with their limits and regions, as light SVG. Pure functions.

Drawn here and not by a plotting widget: regions, limits and units look as in the paper's figure, and one update is a
few kilobytes.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.edits import ParameterValue
from motm_twin.model.joint_limits import DQ_MAX
from motm_twin.model.profile import BaseLimits
from motm_twin.ui.markup import text
from motm_twin.ui.samples import Sample
from motm_twin.ui.timing_card import BUDGET
from motm_twin.ui.why_cards import bands

WINDOW = 60.0  # [s]
BUCKET = 0.25  # [s] of which the curve keeps least and largest; fixed in time, so that a curve only shifts
WIDTH, HEIGHT = 480, 80  # units of the drawing; it is stretched to the panel
_FAR = 1.5  # [m] top of the plot of distances
_MOST_SLACK = 500.0  # [mm/s, deg/s] and of slack: on the way nothing must be met exactly, so it may be much
_MOST_TIME = 100.0  # [ms] and of the period
JOINTS = ("#2563eb", "#0891b2", "#0d9488", "#65a30d", "#d97706", "#db2777", "#7c3aed")

STYLE = """<style>
.mp{font-size:11px;line-height:1.3;padding:2px 10px 4px;font-variant-numeric:tabular-nums;color:#6b7280}
.mp b{color:#111827;font-weight:600;font-size:12px}
.mp .t{display:flex;justify-content:space-between;align-items:baseline;white-space:nowrap}
.mp .f{position:relative;height:78px;margin-left:30px;border-left:1px solid #d1d5db;border-bottom:1px solid #d1d5db}
.mp svg{position:absolute;inset:0;width:100%;height:100%}
.mp path{fill:none;vector-effect:non-scaling-stroke;stroke-linejoin:round}
.mp .y{position:absolute;right:calc(100% + 4px);transform:translateY(-50%)}
.mp .x{display:flex;justify-content:space-between;margin-left:30px}
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
    now: str  # the newest values with units, HTML
    low: float
    high: float
    curves: tuple[Curve, ...]
    regions: tuple[tuple[float, float, str], ...] = ()  # from, to, colour
    limits: tuple[tuple[float, str], ...] = ()  # value, colour
    labels: tuple[tuple[float, str], ...] = field(default=())  # value, text at the axis


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
    ]
    time = samples[:, 0]
    return STYLE + "".join(draw(plot, time) for plot in drawn) + _time_axis(float(time[-1]))


def _column(samples: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    return samples[:, Sample._fields.index(name)]


def distance_plot(samples: NDArray[np.float64], parameters: Mapping[str, ParameterValue]) -> Plot:
    """Gripper to the nearest seen obstacle, with the regions of the paper's figure."""
    d_s, d_i, _ = bands(parameters)
    distance = _column(samples, "distance")
    return Plot(
        title="Gripper to obstacle",
        now=_number(distance[-1], ".2f", " m", "none near"),
        low=0.0,
        high=_FAR,
        curves=(Curve(values=distance, colour="#111827"),),
        regions=((0.0, d_s, "#fecaca"), (d_s, d_i, "#ffedd5")),
        labels=((d_s, f"{d_s:g}"), (d_i, f"{d_i:g}"), (1.0, "1")),
    )


def base_plots(samples: NDArray[np.float64], base: BaseLimits) -> tuple[Plot, Plot]:
    """Forward speed and yaw rate of the base with their limits."""
    speed, turn = _column(samples, "speed"), np.degrees(_column(samples, "yaw_rate"))
    fastest, back, spin = base.forward_speed, -base.reverse_speed, math.degrees(base.yaw_rate)
    limit = "#dc2626"
    return (
        Plot(
            title="Base speed",
            now=_number(speed[-1], "+.2f", " m/s"),
            low=1.25 * back,
            high=1.15 * fastest,
            curves=(Curve(values=speed, colour="#2563eb", extremes=False),),
            limits=((0.0, "#d1d5db"), (fastest, limit), (back, limit)),
            labels=((fastest, f"{fastest:g}"), (0.0, "0"), (back, f"{back:g}")),
        ),
        Plot(
            title="Yaw rate",
            now=_number(turn[-1], "+.0f", " &deg;/s"),
            low=-1.15 * spin,
            high=1.15 * spin,
            curves=(Curve(values=turn, colour="#2563eb", extremes=False),),
            limits=((0.0, "#d1d5db"), (spin, limit), (-spin, limit)),
            labels=((spin, f"{spin:.0f}"), (0.0, "0"), (-spin, f"{-spin:.0f}")),
        ),
    )


def joint_plot(samples: NDArray[np.float64]) -> Plot:
    """Rates of the seven joints as shares of their limits."""
    rates = np.stack([_column(samples, f"dq{k}") for k in range(1, 8)], axis=1) / DQ_MAX
    fastest = int(np.nanargmax(np.abs(rates[-1]))) if np.isfinite(rates[-1]).any() else 0
    names = " ".join(f'<span style="color:{colour}">{k}</span>' for k, colour in enumerate(JOINTS, 1))
    return Plot(
        title=f"Joint rates {names}",
        now=_number(100.0 * rates[-1, fastest], "+.0f", f" % joint {fastest + 1}"),
        low=-1.15,
        high=1.15,
        curves=tuple(Curve(values=rates[:, k], colour=JOINTS[k], extremes=False) for k in range(7)),
        limits=((0.0, "#d1d5db"), (1.0, "#dc2626"), (-1.0, "#dc2626")),
        labels=((1.0, "max"), (0.0, "0"), (-1.0, "&minus;max")),
    )


def slack_plot(samples: NDArray[np.float64]) -> Plot:
    """Slack of the hand's velocity: what it can not do of what it should."""
    linear, angular = 1e3 * _column(samples, "linear_slack"), np.degrees(_column(samples, "angular_slack"))
    high = min(_round_up(np.nanmax(np.concatenate([linear, angular, [20.0]]))), _MOST_SLACK)
    return Plot(
        title='Slack <span style="color:#2563eb">linear</span> <span style="color:#d97706">angular</span>',
        now=_number(linear[-1], ".0f", " mm/s, ") + _number(angular[-1], ".0f", " &deg;/s"),
        low=0.0,
        high=high,
        curves=(Curve(values=angular, colour="#d97706"), Curve(values=linear, colour="#2563eb")),
        labels=((0.0, "0"), (high, f"{high:g}")),
    )


def period_plot(samples: NDArray[np.float64]) -> Plot:
    """Computing time of the period against its budget."""
    period = _column(samples, "period")
    high = min(max(1.2 * BUDGET, _round_up(np.nanmax(np.append(period, 0.0)))), _MOST_TIME)
    return Plot(
        title="Period time",
        now=_number(period[-1], ".1f", " ms"),
        low=0.0,
        high=high,
        curves=(Curve(values=period, colour="#0d9488"),),
        limits=((BUDGET, "#dc2626"),),
        labels=((0.0, "0"), (BUDGET, f"{BUDGET:.0f}")),
    )


def _number(value: float, form: str, unit: str, none: str = "") -> str:
    """A number with its unit, or what is said when there is none."""
    return f"{value:{form}}{unit}" if math.isfinite(value) else none


def _round_up(value: float) -> float:
    """1, 2 or 5 times a power of ten, at least the value."""
    power = 10.0 ** math.floor(math.log10(max(value, 1e-6)))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value - 1e-12)


def draw(plot: Plot, time: NDArray[np.float64]) -> str:
    """One plot as HTML with an SVG that stretches."""
    parts = [
        f'<rect x="0" width="{WIDTH}" y="{_y(plot, high):.0f}" height="{_y(plot, low) - _y(plot, high):.0f}" '
        f'fill="{colour}"/>'
        for low, high, colour in plot.regions
    ]
    parts += [
        f'<path d="M0 {_y(plot, value):.0f}h{WIDTH}" stroke="{colour}" stroke-width="1" stroke-dasharray="4 3"/>'
        for value, colour in plot.limits
    ]
    for curve in plot.curves:
        path = path_of(time, curve, plot.low, plot.high)
        parts.append(f'<path d="{path}" stroke="{curve.colour}" stroke-width="1.3"/>')
    labels = "".join(
        f'<span class="y" style="top:{100.0 * _y(plot, value) / HEIGHT:.0f}%">{label}</span>'
        for value, label in plot.labels
    )
    return (
        f'<div class="mp"><div class="t"><b>{plot.title}</b><span>{plot.now}</span></div><div class="f">'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none">{"".join(parts)}</svg>{labels}</div></div>'
    )


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


def _time_axis(end: float) -> str:
    marks = "".join(
        f"<span>{text(label)}</span>" for label in (f"-{WINDOW:.0f} s", f"-{WINDOW / 2:.0f} s", f"{end:.1f} s")
    )
    return f'<div class="mp"><div class="x">{marks}</div></div>'
