"""Texts of the page as small pieces of HTML. Everything that comes from outside is escaped."""

import html

from motm_twin.bus.messages import StatusMessage

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
