"""Cards of the run: the referee's score beside published times, and the time that each period takes."""

import numpy as np
from numpy.typing import NDArray

from motm_twin.bus.messages import ScoreMessage, StatusMessage, TickMessage
from motm_twin.control.task_list import kind_of, name_of
from motm_twin.measures.published import REFERENCE_TOUR_NOTE, published
from motm_twin.model.scene import Scene
from motm_twin.ui.history import STAGES, Sample
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
WINDOW = 10.0  # [s]
_PERIOD_NAME = f"Computing, last {WINDOW:.0f} s"
_PERIOD_WORDS = "Time from the sensors to the commands of one control period of 50 ms."
_SCALE = 1.2 * BUDGET  # [ms] length of the bars
_LOOKS = {  # of the stages: name and colour
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
    tasks = sorted((task.kind, task.target) for task in tick.tasks)  # published times are of these, in any order
    if scene is not None and tasks != sorted((kind_of(task), name_of(task)) for task in scene.tasks):
        beside = '<hr><div class="mu">the task list was changed: no time to compare with</div>'
    else:
        rows += _tour(tick, status)
        beside = _published(tick, status)
    return card(heading(explained("Score", "as the referee counts", "referee")), table(rows), beside)


def _time(tick: TickMessage) -> float:
    """[s] of the work: a finished run goes on for 2 s, so that the robot comes to rest."""
    return tick.time if tick.ended is None else tick.ended


def progress(tick: TickMessage, status: StatusMessage | None, scene: Scene | None = None) -> str:
    """Picks, places and contacts so far in one line, as HTML; of a finished run the whole `score_card`."""
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
    late = f'<b style="color:{colour}">{over} of {len(period)} over {BUDGET:.0f} ms</b>'
    bars = _stack("typical", [(name, float(np.nanmedian(values))) for name, values in stages])
    bars += _stack("slowest", [(name, float(values[worst])) for name, values in stages])
    cells: list[tuple[str, ...]] = [tuple(f'<span class="mu">{name}</span>' for name in _COLUMNS)]
    for name, values in stages:
        title, colour = _LOOKS[name]
        dot = f'<span style="color:{colour}">&#9632;</span> {title}'
        low, high = np.nanpercentile(values, (50, 99))
        cells.append((dot, f"{low:.1f}", f"{high:.1f}", f"{np.nanmax(values):.1f}"))
    cells.append(("<b>period</b>", f"<b>{p50:.1f}</b>", f"<b>{p99:.1f}</b>", f"<b>{period.max():.1f}</b>"))
    return card(ends(heading(explained(_PERIOD_NAME, _PERIOD_WORDS, "period")), late), bars, table(cells))


def _stack(label: str, stages: list[tuple[str, float]]) -> str:
    parts, at = [], 0.0
    for name, value in stages:
        if np.isfinite(value):
            parts.append(piece(at / _SCALE, (at + value) / _SCALE, _LOOKS[name][1]))
            at += value
    content = bar(*parts, mark(BUDGET / _SCALE, RED), height=12)
    return f'<div class="row"><span class="mu" style="width:48px">{label}</span><div class="fill">{content}</div></div>'
