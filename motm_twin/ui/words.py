"""Names of the controller in words: phases, plans, rows and bounds of the arm's program."""

import math
import re
from collections.abc import Iterable, Sequence

from motm_twin.bus.messages import ArmMessage, StatusMessage, TaskMessage, TickMessage
from motm_twin.model.joint_limits import DQ_MAX, Q_MAX, Q_MIN

PLANS = {
    "goal": "reaches the goal",
    "aborted": "part of the way",
    "braking": "braking",
    "escaping": "backing out",
    "idle": "standing",
}
MODES = {
    "reach": "closest in reach",
    "closest": "closest free place",
    "whole body": "base and arm together",
    "drive": "drive target",
    "none": "no target",
}
LIDAR = "what the lidar sees"
STANDS = (0.03, 0.05)  # [m/s], [rad/s] below which the base stands
_ORDINAL = {2: "second", 3: "third", 4: "fourth", 5: "fifth"}
_NEAR_END = 0.25  # [rad] from a joint's end where its damper begins
_AT_SPEED = 0.97  # of the largest rate


def method_title(status: StatusMessage, name: str) -> str:
    """A method in a few words; its name, where the server does not offer it."""
    titles = {choice.name: choice.title for choice in status.methods}
    title = titles.get(name, name)
    return title if sum(other == title for other in titles.values()) < 2 else f"{title} ({name})"


def active_task(tick: TickMessage) -> TaskMessage | None:
    """The task in hand; None when all are done."""
    return tick.tasks[tick.task_index] if 0 <= tick.task_index < len(tick.tasks) else None


def held(tick: TickMessage) -> str:
    """Name of the object in the gripper, "" when empty."""
    return next((belief.name for belief in tick.beliefs if belief.held), "")


def doing(tick: TickMessage) -> str:
    """What the robot does now, in one sentence."""
    task, step = active_task(tick), tick.arm[-1] if tick.arm else None
    if task is None or tick.done:
        return _ended(tick.tasks)
    if task.kind.startswith("drive"):
        return f"Driving to {task.target}"
    name = task.target
    carried = held(tick)
    cargo = carried or "the object"
    on = "" if stands(tick) else ", on the move"
    phases = {
        "stow": f"Driving to {name}, the arm at rest",
        "transit": f"Bringing {cargo} over {name}{on}" if carried else f"Reaching out for {name}{on}",
        "final": f"{'Looking for' if _unseen(step) else 'Closing in on'} {name}{on}",
        "closing": f"The fingers close on {name}" + (" while the base drives on" if on else ""),
        "lift": f"Lifting {cargo if carried else name}{on}",
        "carry": f"Carrying {cargo} to {name}"
        if task.kind == "place"
        else f"Holding {cargo}, with {name} to be picked",
        "release": f"Letting {cargo} go over {name}{on}",
        "retry": f"Opening the fingers for another try at {name}",
    }
    if step is None:
        return f"Driving to {name}"
    if stands(tick) and step.phase in ("stow", "carry"):
        return f"Standing on the way to {name}" + (f", with {carried}" if carried else "")
    return phases.get(step.phase, f"{step.phase.replace('_', ' ')}: {name}")


def _unseen(step: ArmMessage | None) -> bool:
    """Whether the hand is where the object was seen, and the camera does not see it there."""
    return step is not None and step.reason.startswith("waiting for a sight of")


def stands(tick: TickMessage) -> bool:
    """Whether the base does not move."""
    speed, turn = tick.robot.twist
    return abs(speed) < STANDS[0] and abs(turn) < STANDS[1]


def waiting(tick: TickMessage, limiter: str = "") -> list[tuple[str, bool]]:
    """What the robot waits for or is slowed by: sentences, and whether it is held up by it.

    ``limiter``: name of what slows the gripper, where it has one.
    """
    found: list[tuple[str, bool]] = []
    step, task = tick.arm[-1] if tick.arm else None, active_task(tick)
    if tick.stop_reason:
        found.append((_capital(tick.stop_reason), not tick.done))
    near = slowed_by(tick.arm, limiter)
    if near:
        found.append((near, False))
    if step is not None and step.reason and step.reason not in tick.stop_reason:
        found.append((_capital(step.reason), False))
    if task is not None and task.attempts > 1:
        found.append((f"This is the {_ORDINAL.get(task.attempts, f'{task.attempts}th')} try at {task.target}", False))
    found += [(_capital(fault), True) for fault in tick.faults]
    return found


def slowed(steps: Sequence[ArmMessage]) -> list[ArmMessage]:
    """The steps of a period in which something that the lidar sees slows the gripper."""
    return [step for step in steps if step.limiter and any(row.startswith("lidar") for row in step.active)]


def slowed_by(steps: Sequence[ArmMessage], name: str = "") -> str:
    """Which obstacle slows the gripper in this period, and by how much; "" when none does. ``name``: its name."""
    limited = slowed(steps)
    if not limited:
        return ""
    step = limited[-1]
    what = name.rstrip(",") or f"A {step.limiter}"
    allowed = step.allowed_approach
    if allowed is None or step.obstacle_distance is None:
        return f"The gripper is slowed by {name.rstrip(',') or 'a ' + step.limiter}"
    how = f"may approach at {allowed:.2f} m/s" if allowed > 0.0 else f"backs off at {-allowed:.2f} m/s or more"
    return f"{what} {step.obstacle_distance:.2f} m away: the gripper {how}"


def _ended(tasks: Sequence[TaskMessage]) -> str:
    failed = [task for task in tasks if task.status == "failed"]
    if not tasks:
        return "Nothing to do: the list of tasks is empty"
    if failed:
        return f"All tasks have ended; given up: {', '.join(f'{task.kind} {task.target}' for task in failed)}"
    return f"All {len(tasks)} tasks are done"


def _capital(value: str) -> str:
    return value[:1].upper() + value[1:]


_BODY = re.compile(r"^(elbow|forearm|wrist|hand|fingers|held object) - (.+)$")
_JOINT = re.compile(r"^joint ([1-7])$")
_GRIPPER = {
    "lidar static": "kept off a standing obstacle",
    "lidar moving": "kept off a moving obstacle",
    "lidar height": "kept from sinking beside an obstacle",
}


def constraints(steps: Sequence[ArmMessage], q: Sequence[float]) -> list[tuple[str, str]]:
    """Rows and bounds that held with equality in these arm steps, grouped: what is held, and by what.

    ``q`` [rad], shape (7,): where the joints are, which tells their end stops from their speed.
    """
    names = dict.fromkeys(name for step in steps for name in step.active)
    rows: dict[str, list[str]] = {}
    for name in names:
        what, by = _constraint(name, steps[-1], q)
        rows.setdefault(by, []).append(what)
    return [(_listed(what), by) for by, what in rows.items()]


def _constraint(name: str, step: ArmMessage, q: Sequence[float]) -> tuple[str, str]:
    if name in _GRIPPER:
        return "gripper", _GRIPPER[name]
    body = _BODY.match(name)
    if body is not None:
        other = {"lidar": LIDAR, "own base": "the own base", "own column": "the own column"}
        return body[1], f"kept off {other.get(body[2], body[2])}"
    joint = _JOINT.match(name)
    if joint is not None:
        return name, _joint_bound(int(joint[1]) - 1, step, q)
    return {"base speed": ("base", "accelerates all it may"), "base yaw rate": ("base", "turns in all it may")}.get(
        name, (name, "at its limit")
    )


def _joint_bound(k: int, step: ArmMessage, q: Sequence[float]) -> str:
    """Which of its limits a joint is at: position, speed, or else acceleration."""
    if k < len(q) and min(q[k] - Q_MIN[k], Q_MAX[k] - q[k]) < _NEAR_END:
        return "near the end of its range"
    if k < len(step.joint_velocity) and abs(step.joint_velocity[k]) > _AT_SPEED * DQ_MAX[k]:
        return "at full speed"
    return "accelerates all it may"


def _listed(names: Iterable[str]) -> str:
    """Names in a row: joints share their word, none comes twice."""
    unique = list(dict.fromkeys(names))
    joints = [found[1] for name in unique if (found := _JOINT.match(name))]
    others = [name for name in unique if not _JOINT.match(name)]
    if joints:
        others.append(("joints " if len(joints) > 1 else "joint ") + ", ".join(sorted(joints)))
    return ", ".join(others)


def turn(angle: float) -> str:
    """An angle [rad] in degrees."""
    return f"{math.degrees(angle):.0f}°"
