"""Where the 50 ms of a period go: the stages on a bar, percentiles over the last seconds, overruns."""

import numpy as np
from numpy.typing import NDArray

from motm_twin.ui.markup import AMBER, GREEN, RED, Piece, bar, card, heading, mark, table
from motm_twin.ui.samples import STAGES, Sample

BUDGET = 50.0  # [ms] of one period
WINDOW = 10.0  # [s]
_SCALE = 1.2 * BUDGET  # [ms] length of the bars
COLOURS = {"map": "#0d9488", "place": "#65a30d", "plan": "#2563eb", "arm": "#9333ea", "monitor": "#f59e0b"}
TITLES = {
    "map": "map from the scan",
    "place": "places to stand",
    "plan": "global and local plan",
    "arm": "arm and its QP",
    "monitor": "monitor",
}
_FIRST, _PERIOD = Sample._fields.index(STAGES[0]), Sample._fields.index("period")


def timing_card(samples: NDArray[np.float64]) -> str:
    """The stages of the last periods, from `History.samples`."""
    rows = samples[np.isfinite(samples[:, _PERIOD])]
    if not len(rows):
        return card(heading("Timing"), '<div class="mu">no period yet</div>')
    period = rows[:, _PERIOD]
    stages = [(name, rows[:, _FIRST + k]) for k, name in enumerate(STAGES) if np.isfinite(rows[:, _FIRST + k]).any()]
    p50, p99 = np.percentile(period, (50, 99))
    worst = int(np.argmax(period))
    over = int((period > BUDGET).sum())
    colour = GREEN if over == 0 else RED if over > 0.01 * len(period) else AMBER
    head = (
        f'<div style="display:flex;justify-content:space-between">{heading(f"Period, last {WINDOW:.0f} s")}'
        f'<span style="color:{colour};font-weight:600">{over} of {len(period)} over {BUDGET:.0f} ms</span></div>'
    )
    bars = _labelled("typical", _stack([(name, float(np.nanmedian(values))) for name, values in stages]))
    bars += _labelled("slowest", _stack([(name, float(values[worst])) for name, values in stages]))
    cells: list[tuple[str, ...]] = [('<span class="mu">ms</span>', *_muted("p50", "p99", "max"))]
    for name, values in stages:
        dot = f'<span style="color:{COLOURS[name]}">&#9632;</span> {TITLES[name]}'
        low, high = np.nanpercentile(values, (50, 99))
        cells.append((dot, f"{low:.1f}", f"{high:.1f}", f"{np.nanmax(values):.1f}"))
    cells.append(("<b>period</b>", f"<b>{p50:.1f}</b>", f"<b>{p99:.1f}</b>", f"<b>{period.max():.1f}</b>"))
    return card(head, bars, table(cells))


def _labelled(name: str, content: str) -> str:
    return (
        '<div style="display:flex;align-items:center;gap:8px;margin:2px 0"><span class="mu" style="width:48px">'
        f'{name}</span><div style="flex:1">{content}</div></div>'
    )


def _stack(parts: list[tuple[str, float]]) -> str:
    pieces, at = [], 0.0
    for name, value in parts:
        if np.isfinite(value):
            pieces.append(Piece(at / _SCALE, (at + value) / _SCALE, COLOURS[name]))
            at += value
    return bar(*pieces, mark(BUDGET / _SCALE, RED), height=12)


def _muted(*names: str) -> list[str]:
    return [f'<span class="mu">{name}</span>' for name in names]
