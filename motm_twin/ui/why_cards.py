"""What the robot does and why: the sentence on top, the task in hand, the arm, the last events. Pure functions."""

import math
from collections.abc import Mapping, Sequence

from motm_twin.bus.messages import ArmMessage, EventMessage, StatusMessage, TickMessage
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.model.edits import ParameterValue
from motm_twin.model.scene import Scene
from motm_twin.ui import words
from motm_twin.ui.avoided import avoided, limited_by, strange
from motm_twin.ui.markup import (
    AMBER,
    BLUE,
    GREEN,
    MUTED,
    RED,
    Piece,
    bar,
    card,
    chip,
    explained,
    heading,
    mark,
    metres,
    pairs,
    seconds,
    sentence,
    signed,
    text,
)

READY_MANIPULABILITY = 0.0838  # of the Panda's ready pose
BEST_MANIPULABILITY = 0.127  # largest of 20,000 random poses
RULER = 1.0  # [m] length of the bar of distances
EVENTS = 8
_LOCAL = (
    "What the base drives in the next seconds: reaches the goal, or only part of the way when the search must stop."
)
_T_H = "Time that the local plan needs from here to its goal."
_K = "How much driving near obstacles costs: 1 on the way, less shortly before the goal, so that it may come close."
_NODES = "Short motions that the search for the local plan tried in this period (nodes expanded)."
_SLACK = "By how much the hand's velocity may miss the wanted one, because limits come first: straight and turning."
_MANIPULABILITY = "How freely the hand can move in every direction; 0: stretched out or locked. The mark: ready pose."
_REFERENCE = "How far the fingers are from where the program of the arm wants them now."
_EVENT_COLOURS = {
    "picked": GREEN, "placed": GREEN, "arrived": GREEN, "missed": AMBER, "lost": AMBER,
    "postponed": AMBER, "failed": RED, "contact": RED,
}  # fmt: skip


def headline(tick: TickMessage, scene: Scene | None = None) -> str:
    """One big sentence: what the robot does, and with the scene whom it keeps off."""
    colour = GREEN if tick.done and tick.success else "#111827"
    near = avoided(tick, scene)
    says, lines = words.doing(tick) + (near and f", {near}"), "" if tick.done else " two"
    return card(f'<div class="big{lines}" style="color:{colour}">{text(says)}.</div>')


def now_card(tick: TickMessage, scene: Scene | None = None, status: StatusMessage | None = None) -> str:
    """What the robot waits for, and how it moves; with the scene by names, with the status who drives."""
    speed, turn = tick.robot.twist
    limiter = limited_by(tick, scene)
    said = words.doing(tick).lower() if tick.done else ""
    rows = [
        sentence(why, AMBER if held_up else MUTED)
        for why, held_up in words.waiting(tick, limiter)
        if why.lower() != said
    ]
    if tick.done and words.stands(tick):
        return card(*rows, _driven_by(status))
    motion = f"base {signed(speed, 2)} m/s, {signed(math.degrees(turn), 0)}&deg;/s"
    reach, task = tick.plan.time_to_range, words.active_task(tick)
    planned = task is not None and not (tick.preview and task.status == "waiting")  # for the task in hand
    if reach is not None and planned and not tick.done:
        motion += " &middot; target in reach" + (f" in {reach:.1f} s" if reach > 0.0 else " <b>now</b>")
    rows.append(f'<div class="mu" style="margin-top:4px">{motion}</div>')
    return card(*rows, _driven_by(status))


def _driven_by(status: StatusMessage | None) -> str:
    """Which method decides, HTML."""
    if status is None or not status.method:
        return ""
    about = next((choice.summary for choice in status.methods if choice.name == status.method), "")
    title = f"<b>{text(words.method_title(status, status.method))}</b>"
    return f'<div class="mu">method {explained(title, about) if about else title}</div>'


def task_card(tick: TickMessage) -> str:
    """The task in hand: where to stand for it, and what the local plan found."""
    task, plan, placement = words.active_task(tick), tick.plan, tick.placement
    if task is None:
        return ""
    number = f"{tick.task_index + 1} of {len(tick.tasks)}"
    tries = f", try {task.attempts}" if task.attempts > 1 else ""
    rows = [(f"task {number}", f"<b>{text(task.kind.replace('_', ' '))} {text(task.target)}</b>{tries}")]
    mode = text(words.MODES.get(placement.mode, placement.mode))
    if placement.mode == "ring":
        mode = f"ring of {placement.radius:.2f} m"
    chosen = 0 <= placement.chosen < len(placement.poses)
    rows.append((f"is to stand at candidate no. {placement.chosen + 1}" if chosen else "is to stand at", mode))
    colour = {"goal": GREEN, "aborted": BLUE, "braking": RED}.get(plan.status, MUTED)
    cut = ", cut by the clock" if plan.cut_by_clock else ""
    rows.append((explained("local plan", _LOCAL), chip(words.PLANS.get(plan.status, plan.status), colour)))
    rows.append((explained("time to the goal, t<sub>h</sub>", _T_H), seconds(plan.t_h)))
    rows.append((explained("penalty of nearness, k", _K), f"{plan.k:.2f}"))
    rows.append((explained("motions tried (nodes)", _NODES), f"{plan.expansions}{cut}"))
    return card(heading("Task in hand"), pairs(rows))


def arm_card(
    tick: TickMessage,
    parameters: Mapping[str, ParameterValue],
    scene: Scene | None = None,
) -> str:
    """The arm's program: solved or not, what held it, how well it can move, what it keeps off.

    With the scene also names, and what of it the map does not have, see `avoided.avoided`.
    """
    if not tick.arm:
        return ""
    step = tick.arm[-1]
    solved = step.qp_status == "solved"
    title = f'<div style="display:flex;justify-content:space-between">{heading("Arm")}'
    title += chip(step.qp_status.split(":")[0], GREEN if solved else RED) + "</div>"
    parts = [title]
    if not solved:
        parts.append(sentence(step.qp_status, RED))
    parts.append(_distance(tick.arm, parameters, limited_by(tick, scene)))
    parts.append(_manipulability(step))
    parts.append(
        pairs([(explained("hand off its reference", _REFERENCE), _millimetres(step.error)), *_slack(step.slack)])
    )
    held = [(what, f"{by}{strange(by, tick, scene)}") for what, by in words.constraints(tick.arm, tick.robot.q)]
    lines = "".join(f"<div>{text(what)} <span class='mu'>{text(by)}</span></div>" for what, by in held)
    parts.append("<hr>" + (lines or '<div class="mu">no limit is active: the hand moves as it wants</div>'))
    return card(*parts)


def bands(parameters: Mapping[str, ParameterValue]) -> tuple[float, float, float]:
    """d_s [m], d_i [m] and xi [m/s] that are in force."""
    shipped = AvoidanceParameters()
    d_s, d_i, xi = (float(parameters.get(name, getattr(shipped, name))) for name in ("d_s", "d_i", "xi"))
    return d_s, d_i, xi


def _distance(steps: Sequence[ArmMessage], parameters: Mapping[str, ParameterValue], name: str) -> str:
    """How far the gripper is from what the lidar sees, on a ruler with the red and the orange region."""
    step = steps[-1]
    d_s, d_i, _ = bands(parameters)
    distance = step.obstacle_distance
    pieces = [Piece(0.0, d_s / RULER, "#fca5a5"), Piece(d_s / RULER, d_i / RULER, "#fed7aa")]
    if distance is not None:
        pieces.append(mark(distance / RULER))
    rows = [("gripper to obstacle", f"<b>{metres(distance)}</b>")]
    ruler = (
        f"{bar(*pieces)}<div class='mu' style='font-size:11px'>red: comes no nearer, d<sub>s</sub> {d_s:g} m &middot; "
        f"orange: slower and slower, d<sub>i</sub> {d_i:g} m</div>"
    )
    limits = []
    if step.limiter:
        what = text(name.rstrip(",") or step.limiter)
        if step.allowed_approach is not None:
            allowed = max(step.allowed_approach, 0.0)
            what += f", at most {allowed:.2f} m/s nearer"
        limits.append(("near", what))
    return pairs(rows) + ruler + (pairs(limits) if limits else "")


def _manipulability(step: ArmMessage) -> str:
    value = step.manipulability
    if value is None:
        return ""
    colour = GREEN if value > 0.5 * READY_MANIPULABILITY else AMBER if value > 0.2 * READY_MANIPULABILITY else RED
    pieces = Piece(0.0, value / BEST_MANIPULABILITY, colour), mark(READY_MANIPULABILITY / BEST_MANIPULABILITY)
    share = 100.0 * value / READY_MANIPULABILITY
    return (
        '<div style="margin-top:4px">'
        + pairs([(explained("manipulability", _MANIPULABILITY), f"{value:.3f}, {share:.0f} % of the ready pose")])
        + bar(*pieces, height=6)
        + "</div>"
    )


def _slack(slack: Sequence[float | None]) -> list[tuple[str, str]]:
    known = [value for value in slack if value is not None]
    if len(known) != 6:
        return []
    linear, angular = math.hypot(*known[:3]), math.hypot(*known[3:])
    return [
        (explained("velocity missed (slack)", _SLACK), f"{1e3 * linear:.1f} mm/s, {math.degrees(angular):.1f}&deg;/s")
    ]


def _millimetres(value: float | None) -> str:
    return "unknown" if value is None else f"{1e3 * value:.0f} mm"


def events_card(tick: TickMessage, events: Sequence[EventMessage]) -> str:
    """The last events with their times, newest first, contacts among them."""
    entries = [(event.time, event.kind, event.text) for event in events]
    if tick.score is not None and not any(event.kind == "contact" for event in events):
        for contact in tick.score.contacts:
            who = "" if contact.caused_by_robot else " (not by the robot)"
            entries.append((contact.time, "contact", f"{contact.body} touched {contact.other}{who}"))
    entries.sort(key=lambda entry: -entry[0])
    rows = []
    for time, kind, what in entries[:EVENTS]:
        colour = _EVENT_COLOURS.get(kind, MUTED)
        rows.append(
            f'<div style="display:flex;gap:8px"><span class="mu" style="min-width:56px;text-align:right">{time:.2f} s'
            f'</span><span style="color:{colour}">&#9679;</span><span>{text(what)}</span></div>'
        )
    return card(heading("What happened"), "".join(rows) or '<div class="mu">nothing yet</div>')
