"""The Why tab: reasons of the robot, the current task, the clicked candidate, the arm, events, timing, score."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import viser

from motm_twin.bus import messages as bus
from motm_twin.control.arm.types import ProgramStatus
from motm_twin.model.edits import ParameterValue
from motm_twin.model.scene import REFLEXES, Scene
from motm_twin.planning.parameters import PlacementParameters
from motm_twin.ui import colours
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.panel import explain
from motm_twin.ui.panel.explain import avoided, limited_by, strange
from motm_twin.ui.panel.numbers import TIMING_WINDOW, PlotsPanel, bands, score_card, timing_card
from motm_twin.ui.panel.widgets import (
    AMBER,
    BLUE,
    GREEN,
    MUTED,
    RED,
    Block,
    bar,
    card,
    chip,
    ends,
    explained,
    heading,
    mark,
    metres,
    pairs,
    piece,
    seconds,
    sentence,
    text,
)

FAST, SLOW = 2, 10  # updates (of 0.1 s) between refreshes of live text, and of statistics
NEXT_WEIGHT = "next_weight"  # parameter: weight of the cost C_N
USUAL_NEXT_WEIGHT = PlacementParameters().next_weight
ROUNDED = 0.05  # [s] tolerance of the sum of a message's costs
_PLACE = "Of all places where the base could stand for its target, this one costs the least."
READY_MANIPULABILITY = 0.0838  # of the Panda's ready pose
BEST_MANIPULABILITY = 0.127  # largest of 20,000 random poses
RULER = 1.0  # [m] length of the bar of distances
EVENTS = 8
_LOCAL = "Local plan: motion of the base to its goal, or only part of the way when the search must stop."
_T_H = "t_h: time that the local plan needs from here to its goal."
_K = "k: what driving near obstacles costs, 1 on the way, less shortly before the goal, so that it may come close. Now"
_NODES = "Short motions that the search for the local plan tried in this period (nodes expanded)."
_CUT = "The search ended when its time was over; the robot drives the best plan found until then."
_SLACK = (
    "Slack: by how much the hand's velocity misses the wanted one, because limits come first. Straight and turning:"
)
_MANIPULABILITY = "Manipulability: how freely the hand can move; 0: stretched out or locked. The mark: ready pose. Now"
_REFERENCE = "From the fingers to where they are to be (the reference of the arm's program):"
_FREELY, _SLIGHTLY = 0.999, 0.05  # of k: full above the first, none below the second
_NEGLIGIBLE = 2e-3  # [m/s], [rad/s] of slack
PROGRAMS = {  # outcome of the arm's program: word, and what it means
    ProgramStatus.SOLVED: ("moves as wanted", "The arm's program (a quadratic program) keeps all limits."),
    ProgramStatus.GAVE_WAY: ("gives way", "Something is too near the arm: it moves off."),
    ProgramStatus.DAMPED_STOP: ("stops", "No motion keeps all limits (damped stop): the arm slows down to a stop."),
    ProgramStatus.STANDING: ("stands", "Something stands where the arm is: it does not move."),
    ProgramStatus.WITHDRAWING: ("withdraws", "The arm draws back."),
}  # fmt: skip
_EVENT_COLOURS = {
    "picked": GREEN, "placed": GREEN, "arrived": GREEN, "missed": AMBER, "lost": AMBER,
    "postponed": AMBER, "failed": RED, "contact": RED,
}  # fmt: skip


class WhyTab(Block):
    """Explains the shown period."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        super().__init__(gui, hub, visitor)
        self._count = 0
        self._now = gui.add_html("")
        self._plots = PlotsPanel(gui, hub)
        self._task, self._candidate, self._arm, self._forces, self._events = (gui.add_html("") for _ in range(5))
        with gui.add_folder("Timing"):
            self._timing = gui.add_html("")
        with gui.add_folder("Score"):
            self._score = gui.add_html("")
        self._explained: tuple[bus.TickMessage | None, int | None] = (None, None)

    def _refresh(self, shown: Shown) -> None:
        tick, history = shown.tick, self.hub.history
        if tick is None:
            return
        self._count += 1
        picked, parameters = shown.view.picked, {} if shown.status is None else shown.status.parameters
        if self._count % FAST == 0 and (tick is not self._explained[0] or picked != self._explained[1]):
            self._explained = tick, picked
            self._now.content = now_card(tick, shown.scene, shown.status)
            self._task.content = task_card(tick)
            weight = float(parameters.get(NEXT_WEIGHT, USUAL_NEXT_WEIGHT))
            self._candidate.content = candidate_card(tick.placement, picked, weight)
            self._arm.content = arm_card(tick, parameters, shown.scene)
            self._forces.content = forces_card(tick)
        if history is None:
            return
        index = None if shown.live else tick.index
        if self._count % SLOW == 0:
            self._timing.content = timing_card(history.samples(index, TIMING_WINDOW))
            self._score.content = score_card(tick, shown.status, shown.scene)
        elif self._count % SLOW == SLOW // 2:
            self._events.content = events_card(tick, history.events(index, EVENTS))
        self._plots.update(shown)


def headline(tick: bus.TickMessage, scene: Scene | None = None) -> str:
    """One big sentence: the robot's activity, and with the scene the body that it avoids."""
    colour = GREEN if tick.done and tick.success else "var(--motm-ink)"
    return f'<div class="big two" style="color:{colour}">{text(says(tick, scene))}</div>'


def says(tick: bus.TickMessage, scene: Scene | None = None) -> str:
    """One sentence: the robot's activity, and the body that it avoids."""
    near = avoided(tick, scene)
    return explain.doing(tick) + (near and f", {near}") + "."


def held_up(tick: bus.TickMessage, scene: Scene | None = None) -> str:
    """Reason why the robot waits or is slowed; "" when nothing holds it up."""
    return next((why for why, holds in _reasons(tick, scene) if holds), "")


def _reasons(tick: bus.TickMessage, scene: Scene | None) -> list[tuple[str, bool]]:
    """Reasons of `explain.waiting`, without one that the headline of an ended run already gives."""
    current = explain.doing(tick).lower() if tick.done else ""
    return [(why, holds) for why, holds in explain.waiting(tick, limited_by(tick, scene)) if why.lower() != current]


def now_card(tick: bus.TickMessage, scene: Scene | None = None, status: bus.StatusMessage | None = None) -> str:
    """Reasons why the robot waits, and its motion; names need the scene, the driving method needs the status."""
    rows = [sentence(why, AMBER if holds else MUTED) for why, holds in _reasons(tick, scene)]
    if tick.done and explain.stands(tick):
        return card(*rows, _driven_by(status))
    motion = moving(*tick.robot.twist)
    reach, task = tick.plan.time_to_range, explain.active_task(tick)
    planned = task is not None and not (tick.preview and task.status == "waiting")  # the plan is for this task
    if reach is not None and planned and not tick.done:
        motion += " &middot; target in reach" + (f" in {reach:.1f} s" if reach > 0.0 else " <b>now</b>")
    rows.append(f'<div class="mu" style="margin-top:4px">{motion}</div>')
    return card(*rows, _driven_by(status))


def moving(speed: float, turn: float) -> str:
    """Forward speed [m/s] and yaw rate [rad/s] of the base in words, as HTML."""
    parts = []
    if abs(speed) >= explain.STANDS[0]:
        parts.append(f"{'drives' if speed > 0.0 else 'backs up'} at {abs(speed):.2f} m/s")
    if abs(turn) >= explain.STANDS[1]:
        parts.append(f"turns {'left' if turn > 0.0 else 'right'} at {abs(math.degrees(turn)):.0f}&deg;/s")
    return "base " + (", ".join(parts) or "stands")


def _driven_by(status: bus.StatusMessage | None) -> str:
    """The driving method, HTML."""
    if status is None or not status.method:
        return ""
    about = next((choice.summary for choice in status.methods if choice.name == status.method), "")
    title = f"<b>{text(explain.method_title(status, status.method))}</b>"
    return f'<div class="mu">method {explained(title, about, "method") if about else title}</div>'


def task_card(tick: bus.TickMessage) -> str:
    """The current task: the base placement for it, and the result of the local plan."""
    task, plan, placement = explain.active_task(tick), tick.plan, tick.placement
    if task is None:
        return ""
    name = f"{text(task.kind.replace('_', ' '))} {text(task.target)}"
    tries = f", try {task.attempts}" if task.attempts > 1 else ""
    mode = text(explain.MODES.get(placement.mode, placement.mode))
    mode = f"{placement.radius:.2f} m from the target" if placement.mode == "ring" else mode
    chosen = 0 <= placement.chosen < len(placement.poses)
    number = f" Candidate no. {placement.chosen + 1} of {len(placement.poses)}." if chosen else ""
    colour = {"goal": GREEN, "aborted": BLUE, "braking": RED}.get(plan.status, MUTED)
    cut = explained(", time was over", _CUT, "end of search") if plan.cut_by_clock else ""
    fading = "full" if plan.k > _FREELY else "none: it is there" if plan.k < _SLIGHTLY else "less: it is nearly there"
    words = chip(explain.PLANS.get(plan.status, plan.status), colour)
    rows = [
        (f"task {tick.task_index + 1} of {len(tick.tasks)}", f"<b>{name}</b>{tries}"),
        (explained("where the base is to stand", _PLACE + number, "place"), mode),
        (explained("plan of the next seconds", _LOCAL, "plan"), words),
        (explained("time to get there", _T_H, "plan"), seconds(plan.t_h)),
        (explained("penalty near obstacles", f"{_K}: {plan.k:.2f}.", "penalty"), fading),
        (explained("motions tried", _NODES, "plan"), f"{plan.expansions}{cut}"),
    ]
    return card(heading("Task in hand"), pairs(rows))


def arm_card(tick: bus.TickMessage, parameters: Mapping[str, ParameterValue], scene: Scene | None = None) -> str:
    """The arm's program: solved or not, active limits, manipulability, and the obstacle that it avoids.

    With the scene it also has names, and remarks on bodies that are not in the map.
    """
    if not tick.arm:
        return ""
    step = tick.arm[-1]
    solved = step.program == ProgramStatus.SOLVED
    word, words = PROGRAMS.get(step.program, (step.program, ""))  # type: ignore[call-overload]
    name = explained(chip(word, GREEN if solved else RED), words, "program") if words else chip(word, RED)
    failure = "" if solved else sentence(step.qp_status, RED)
    distance = _distance(tick.arm, parameters, limited_by(tick, scene))
    cm, mm = ("unknown",) * 2 if step.error is None else (f"{100 * step.error:.0f} cm", f"{1e3 * step.error:.0f} mm")
    hand = pairs([(explained("hand still to go", f"{_REFERENCE} {mm}.", "phases"), cm), *_slack(step.slack)])
    held = [(what, f"{by}{strange(by, tick, scene)}") for what, by in explain.constraints(tick.arm, tick.robot.q)]
    lines = "".join(f"<div>{text(what)} <span class='mu'>{text(by)}</span></div>" for what, by in held)
    limits = "<hr>" + (lines or '<div class="mu">no limit is active: the hand moves as it wants</div>')
    return card(ends(heading("Arm"), name), failure, distance, _manipulability(step), hand, limits)


def _distance(steps: Sequence[bus.ArmMessage], parameters: Mapping[str, ParameterValue], name: str) -> str:
    """Distance of the gripper from the points of the lidar, on a ruler with the red and the orange region."""
    step = steps[-1]
    d_s, d_i, _ = bands(parameters)
    distance = step.obstacle_distance
    red, orange = piece(0.0, d_s / RULER, "var(--motm-near)"), piece(d_s / RULER, d_i / RULER, "var(--motm-slow)")
    place = "" if distance is None else mark(distance / RULER)
    rows = [(explained("gripper to obstacle", "by the lidar", "arm"), f"<b>{metres(distance)}</b>")]
    ruler = (
        f"{bar(red, orange, place)}<div class='mu' style='font-size:11px'>"
        f"{explained(f'red: no nearer than {d_s:g} m', 'd_s, the stopping distance', 'avoidance')} &middot; "
        f"{explained(f'orange: slows down within {d_i:g} m', 'd_i, the influence distance', 'avoidance')}</div>"
    )
    if not step.limiter:
        return pairs(rows) + ruler
    near = text(name.rstrip(",") or step.limiter)
    if step.allowed_approach is not None:
        near += f", at most {max(step.allowed_approach, 0.0):.2f} m/s nearer"
    return pairs(rows) + ruler + pairs([("near", near)])


def _manipulability(step: bus.ArmMessage) -> str:
    value = step.manipulability
    if value is None:
        return ""
    colour = GREEN if value > 0.5 * READY_MANIPULABILITY else AMBER if value > 0.2 * READY_MANIPULABILITY else RED
    pieces = piece(0.0, value / BEST_MANIPULABILITY, colour), mark(READY_MANIPULABILITY / BEST_MANIPULABILITY)
    share = 100.0 * value / READY_MANIPULABILITY
    name = explained("freedom of the arm", f"{_MANIPULABILITY} {value:.3f}.", "program")
    row = name, f"{share:.0f} % of the ready pose"
    return f'<div style="margin-top:4px">{pairs([row])}{bar(*pieces, height=6)}</div>'


def _slack(slack: Sequence[float | None]) -> list[tuple[str, str]]:
    known = [value for value in slack if value is not None]
    if len(known) != 6:
        return []
    linear, angular = math.hypot(*known[:3]), math.hypot(*known[3:])
    words = f"{_SLACK} {1e3 * linear:.1f} mm/s, {math.degrees(angular):.1f} deg/s."
    missed = "not at all" if max(linear, angular) < _NEGLIGIBLE else f"by {100 * linear:.1f} cm/s"
    return [(explained("slower than wanted", words, "program"), missed)]


def events_card(tick: bus.TickMessage, events: Sequence[bus.EventMessage]) -> str:
    """The last events with their times, newest first, contacts among them."""
    entries = [(event.time, event.kind, event.text) for event in events]
    if tick.score is not None and not any(event.kind == "contact" for event in events):
        for contact in tick.score.contacts:
            who = "" if contact.caused_by_robot else " (not by the robot)"
            entries.append((contact.time, "contact", f"{contact.body} touched {contact.other}{who}"))
    entries.sort(key=lambda entry: -entry[0])
    rows = []
    for time, kind, what in entries[:EVENTS]:
        dot = f'<span style="color:{_EVENT_COLOURS.get(kind, MUTED)}">&#9679;</span>'
        rows.append(f'<div class="event"><span class="mu">{time:.2f} s</span>{dot}<span>{text(what)}</span></div>')
    return card(heading("What happened"), "".join(rows) or '<div class="mu">nothing yet</div>')


def candidate_card(placement: bus.PlacementMessage, index: int | None, next_weight: float = USUAL_NEXT_WEIGHT) -> str:
    """Costs of one candidate, or why it is rejected; with none picked, the chosen one and the legend."""
    if index is None or not 0 <= index < len(placement.poses):
        chosen = placement.chosen
        if not 0 <= chosen < len(placement.poses):
            return _hint(placement)
        return card(heading(_title(placement, chosen)), *_costs(placement, chosen, next_weight)) + _hint(placement)
    (x, y, turn), reason = placement.poses[index], placement.rejected[index]
    place = f'<div class="mu">x {x:.2f} m, y {y:.2f} m, heading {round(math.degrees(turn))}&deg;</div>'
    costs = [sentence(f"Not possible: {reason}", MUTED)] if reason else _costs(placement, index, next_weight)
    return card(heading(_title(placement, index)), place, *costs)


def _title(placement: bus.PlacementMessage, index: int) -> str:
    """Rank of a candidate, and whether it is chosen; on hover its number, counted round the target."""
    own, known = placement.cost[index], [cost for cost in placement.cost if cost is not None]
    place = "" if own is None else f", {_nth(1 + sum(cost < own for cost in known))} of {len(known)}"
    chosen = ", <b>chosen</b>" if index == placement.chosen else ""
    return explained("Place to stand", f"Candidate no. {index + 1} of {len(placement.poses)}", "place") + place + chosen


def _nth(number: int) -> str:
    """Rank in words: "best", "2nd best"."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return "best" if number == 1 else f"{number}{ending} best"


def _costs(placement: bus.PlacementMessage, index: int, weight: float) -> list[str]:
    here, onward, total = (cost[index] for cost in (placement.cost_current, placement.cost_next, placement.cost))
    paper = here is None or onward is None or total is None or abs(here + weight * onward - total) < ROUNDED
    sum_ = "The cost C, by the rule of this method."
    if paper:
        sum_ = f"The cost C = C_C + {weight:g} C_N: the way on counts {weight:g} times. The least cost is chosen."
    together = explained("together" if paper else "cost", sum_, "place")
    rows = [
        (explained("time to get there", "Current cost C_C.", "place"), seconds(here)),
        (explained("and on to the next target", "Next cost C_N.", "place"), seconds(onward)),
        (together, f"<b>{seconds(total)}</b>{_dearer(placement, index)}"),
    ]
    if not paper:
        return [pairs(rows)]
    parts = []
    dearest = max((cost for cost in placement.cost if cost is not None), default=0.0)
    if here is not None and dearest > 0.0:
        parts.append(piece(0.0, here / dearest, colours.css(colours.WAY_THERE)))
        if onward is not None:
            parts.append(piece(here / dearest, (here + weight * onward) / dearest, colours.css(colours.WAY_ON)))
    return [pairs(rows), f'<div style="margin-top:4px">{bar(*parts, height=7)}</div>']


def _dearer(placement: bus.PlacementMessage, index: int) -> str:
    own, chosen = placement.cost[index], placement.chosen
    best = placement.cost[chosen] if 0 <= chosen < len(placement.cost) else None
    if own is None or best is None or index == chosen:
        return ""
    return f", {abs(own - best):.1f} s {'more' if own > best else 'less'} than the chosen"


def _hint(placement: bus.PlacementMessage) -> str:
    """Hint to click, and the reasons why the grey candidates are rejected."""
    count = len(placement.poses)
    if not count:
        return ""
    reasons = Counter(why for why in placement.rejected if why)
    out = sum(reasons.values())
    rows = [f"<div><b>Click one of the coloured places</b> to read its costs. {count - out} of {count} are free</div>"]
    if out:
        most = ", ".join(f"{number} {text(why)}" for why, number in reasons.most_common(3))
        rows.append(f'<div class="mu">not possible: {most}</div>')
    return card(heading("Places to stand"), *rows) + legend(placement)


def legend(placement: bus.PlacementMessage) -> str:
    """The colour scale of costs; the legend in the scene explains the rest."""
    known = [cost for cost in placement.cost if cost is not None]
    low, high = (f"{min(known):.1f} s", f"{max(known):.1f} s") if known else ("cheap", "dear")
    scale = f'<span class="fill" style="height:8px;border-radius:4px;background:{colours.viridis_css()}"></span>'
    return card(f'<div class="row"><span>{low}</span>{scale}<span>{high}</span></div>')


NOMINAL, ACCELERATING = REFLEXES.values()
TOP = 1.5 * ACCELERATING  # [Nm] at the end of the bar
_TORQUE = (
    "Torque that the arm takes for a push from outside: it does not know that its base accelerates or rolls over a "
    "bump. From the marks on the Panda stops by itself."
)
_PHANTOM = "Times that such a threshold was passed although the robot touched nothing."
_WRIST = "What a sensor at the hand's mount would read, the weight of the hand included."


def forces_card(tick: bus.TickMessage) -> str:
    """Present forces and the newest grasp; "" without contact dynamics."""
    felt = tick.forces
    if felt is None:
        return ""
    (left, right), (first, second) = felt.fingers, felt.phantoms
    wrist = f"{felt.wrist[0]:.1f} N, at most {felt.wrist_peaks[0]:.0f} N"
    rows = [
        ("fingers, left and right", f"<b>{left:.0f} N, {right:.0f} N</b>"),
        *([] if felt.grasp is None else _grasp(felt.grasp)),
        (explained("force at the wrist", _WRIST), wrist),
        (explained("phantom collisions", _PHANTOM), f"{first} over {NOMINAL:g} Nm, {second} over {ACCELERATING:g} Nm"),
    ]
    return card(heading("Forces"), _torque(felt), pairs(rows))


def _torque(felt: bus.ForcesMessage) -> str:
    """The joint with the largest torque, on a bar with the thresholds."""
    sizes = [abs(value) for value in felt.external_torque]
    most = max(sizes)
    colour = RED if most > ACCELERATING else AMBER if most > NOMINAL else GREEN
    now = chip(f"joint {sizes.index(most) + 1}: {most:.1f} Nm", colour)
    row = explained("external torque", _TORQUE), f"{now} at most {max(felt.torque_peaks, default=most):.0f} Nm"
    marks = (mark(NOMINAL / TOP), mark(ACCELERATING / TOP))
    return f"{pairs([row])}{bar(piece(0.0, min(most / TOP, 1.0), colour), *marks, height=6)}"


def _grasp(grasp: bus.GraspMessage) -> list[tuple[str, str]]:
    name = text(grasp.object)
    slip = f"slipped {1e3 * grasp.slip:.1f} mm" + (", <b>lost</b>" if grasp.lost else "")
    return [
        (f"grasp of {name}", f"firm after {grasp.firm:.2f} s, hand at most {1e3 * grasp.speed:.0f} mm/s"),
        ("the fingers shifted it by", f"{1e3 * grasp.shift:.1f} mm; {slip}"),
    ]
