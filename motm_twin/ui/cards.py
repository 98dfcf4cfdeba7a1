"""Texts of the page as small pieces of HTML. Everything that comes from outside is escaped."""

import html
import math

from motm_twin.bus.messages import StatusMessage, TaskMessage, TickMessage

_BOX = "font-size:13px;line-height:1.45;padding:8px 12px;"
_MUTED = "color:#6b7280;"
_ONE_LINE = "white-space:nowrap;overflow:hidden;text-overflow:ellipsis;"
_STATES = {
    "playing": ("Running", "#15803d"),
    "paused": ("Paused", "#6b7280"),
    "loading": ("Loading", "#b45309"),
    "done": ("Finished", "#1d4ed8"),
    "error": ("Stopped by an error", "#b91c1c"),
    "waiting": ("Waiting for the twin", "#b45309"),
    "lost": ("Connection lost", "#b91c1c"),
}
LOOKING_BACK = "#7c3aed"
PHASES = {
    "stow": "Arm at rest",
    "transit": "Reaching out on the move",
    "final": "Closing in on the cube",
    "closing": "Fingers close while the base drives on",
    "lift": "Lifting",
    "carry": "Carrying to the bin",
    "release": "Letting go over the bin",
    "retry": "Trying the grasp again",
}

HELP = """
**Look** &nbsp; drag: turn &middot; right-drag: move &middot; wheel: zoom

**Disturb** &nbsp; grab a Temi or an added box with the mouse and drag it over the floor, also into the robot's way

**Ask** &nbsp; click one of the coloured candidates to read its costs

**Keys** &nbsp; `space` play / pause &middot; `N` one step &middot; `R` reset &middot; `1` overview &middot;
`2` top &middot; `3` follow &middot; `H` this card
"""


def status_card(state: str, status: StatusMessage | None, note: str, *, looked_at: float | None = None) -> str:
    """State of the server, time, wanted and actual speed, and a sentence when there is something to say.

    ``looked_at``: time [s] of the earlier period that is shown, which then stands in the place of the newest.
    """
    name, colour = _STATES.get(state, (state, "#6b7280"))
    if looked_at is not None:
        name, colour = "Looking back", LOOKING_BACK
    chip = (
        f'<span style="background:{colour};color:white;border-radius:9px;padding:1px 9px;font-weight:600">'
        f"{html.escape(name)}</span>"
    )
    clock = _clock(status, looked_at)
    rows = [f'<div style="display:flex;justify-content:space-between;align-items:center">{chip}{clock}</div>']
    if status is not None:
        rows.append(f'<div style="{_MUTED}{_ONE_LINE}margin-top:4px">{_where(status)}</div>')
        rows.append(f'<div style="{_MUTED}{_ONE_LINE}">{_speed(state, status)}</div>')
    if note:
        rows.append(_sentence(note, _STATES[state][1] if state in {"error", "lost", "done"} else "#b45309"))
    return f'<div style="{_BOX}">{"".join(rows)}</div>'


def _clock(status: StatusMessage | None, looked_at: float | None) -> str:
    if status is None:
        return ""
    time = f"{status.time if looked_at is None else looked_at:.2f} s"
    colour = "" if looked_at is None else f"color:{LOOKING_BACK};"
    return f'<span style="font-variant-numeric:tabular-nums;font-size:17px;font-weight:600;{colour}">{time}</span>'


def _where(status: StatusMessage) -> str:
    variant = f" / {status.variant}" if status.variant else ""
    return html.escape(f"{status.scene}{variant}, seed {status.seed}")


def _speed(state: str, status: StatusMessage) -> str:
    wanted = f"{status.speed:g}&times;"
    if state != "playing" or status.actual_speed <= 0.0:  # not known yet
        return f"speed {wanted}"
    capped = ' <b style="color:#b45309">CAPPED</b>' if status.capped else ""
    return f"speed {wanted}, actual {status.actual_speed:.2f}&times;{capped}"


def _sentence(text: str, colour: str) -> str:
    return (
        f'<div style="margin-top:6px;border-left:3px solid {colour};padding:2px 8px;background:{colour}14">'
        f"{html.escape(text)}</div>"
    )


def progress_card(tick: TickMessage) -> str:
    """What the robot does now, why it waits, and the list of jobs."""
    step = tick.arm[-1] if tick.arm else None
    phase = "" if step is None else PHASES.get(step.phase, step.phase.replace("_", " "))
    rows = [f'<div style="font-weight:600;font-size:14px">{html.escape(phase or "Driving")}</div>']
    speed, turn = tick.robot.twist
    rows.append(
        f'<div style="{_MUTED}font-variant-numeric:tabular-nums">'
        f"base {speed:+.2f} m/s, {math.degrees(turn):+.0f}&deg;/s"
        f"{_goal(tick)}</div>"
    )
    why = tick.stop_reason or tick.plan.reason or (step.reason if step else "")
    if why:
        rows.append(_sentence(why, "#b45309"))
    rows.append(_jobs(tick.tasks))
    rows.append(_score(tick))
    return f'<div style="{_BOX}">{"".join(rows)}</div>'


def _goal(tick: TickMessage) -> str:
    t_h = tick.plan.t_h
    return "" if t_h is None or t_h <= 0.0 else f" &middot; goal in {t_h:.1f} s"


def _jobs(tasks: list[TaskMessage]) -> str:
    signs = {"done": ("&#10003;", "#15803d"), "active": ("&#9654;", "#1d4ed8"), "failed": ("&#10007;", "#b91c1c")}
    cells = []
    for first, second in pairs(tasks):
        parts = []
        for task in (first, second):
            if task is None:
                continue
            sign, colour = signs.get(task.status, ("&#9675;", "#9ca3af"))
            weight = "600" if task.status == "active" else "400"
            again = f" ({task.attempts}.)" if task.attempts > 1 else ""
            parts.append(
                f'<span style="color:{colour}">{sign}</span>&nbsp;'
                f'<span style="font-weight:{weight}">{html.escape(_job_name(task) + again)}</span>'
            )
        cells.append(f'<div style="white-space:nowrap">{" &rarr; ".join(parts)}</div>')
    return (
        '<div style="display:grid;grid-template-columns:1fr 1fr;gap:1px 10px;margin-top:6px">'
        + "".join(cells)
        + "</div>"
    )


def _job_name(task: TaskMessage) -> str:
    return f"drive to {task.target}" if task.kind.startswith("drive") else task.target


def pairs(tasks: list[TaskMessage]) -> list[tuple[TaskMessage, TaskMessage | None]]:
    """Tasks in rows: a pick together with the place that follows it."""
    rows: list[tuple[TaskMessage, TaskMessage | None]] = []
    index = 0
    while index < len(tasks):
        following = tasks[index + 1] if index + 1 < len(tasks) else None
        joined = following is not None and tasks[index].kind == "pick" and following.kind == "place"
        rows.append((tasks[index], following if joined else None))
        index += 2 if joined else 1
    return rows


def _score(tick: TickMessage) -> str:
    if tick.score is None:
        return ""
    picks = sum(task.kind == "pick" for task in tick.tasks)
    places = sum(task.kind == "place" for task in tick.tasks)
    caused = sum(contact.caused_by_robot for contact in tick.score.contacts)
    others = len(tick.score.contacts) - caused
    colour = "#b91c1c" if caused else "#15803d"
    text = (
        f"picked {tick.score.picks}/{picks} &middot; placed {tick.score.places}/{places} &middot; "
        f'<span style="color:{colour}">contacts {caused}</span>'
    )
    text += f" (+{others} by others)" if others else ""
    return f'<div style="margin-top:6px;{_MUTED}">{text}</div>'
