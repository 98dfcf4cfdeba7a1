"""The robot's activity in words: task, phase, waiting, active constraints of the arm, and obstacles by name.

The robot sees only points; the names of bodies are those of the twin's ground truth.
"""

import functools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
import shapely.ops

from motm_twin.bus.messages import ArmMessage, StatusMessage, TaskMessage, TickMessage
from motm_twin.model.kinematics import Frankie
from motm_twin.model.profile import DQ_MAX, Q_MAX, Q_MIN, RobotProfile
from motm_twin.model.reason import Kind
from motm_twin.model.scene import Scene
from motm_twin.model.scene_shapes import Piece, moved_scene, outline, pieces, rectangle
from motm_twin.ui.scene.body_view import met
from motm_twin.ui.scene.picking import body_outline, furniture_poses

PLANS = {
    "goal": "reaches the goal", "aborted": "part of the way", "braking": "braking", "escaping": "moving clear",
    "idle": "standing",
}  # fmt: skip
MODES = {
    "reach": "closest in reach", "closest": "closest free place", "whole body": "base and arm together",
    "drive": "drive target", "none": "no target",
}  # fmt: skip
LIDAR = "what the lidar sees"
STANDS = (0.03, 0.05)  # [m/s], [rad/s] below which the base stands
_ORDINAL = {2: "second", 3: "third", 4: "fourth", 5: "fifth"}
_NEAR_END = 0.25  # [rad] from a joint's end where its damper begins
_AT_SPEED = 0.97  # share of the largest rate
_BODY = re.compile(r"^(elbow|forearm|wrist|hand|fingers|held object) - (.+)$")
_JOINT = re.compile(r"^joint ([1-7])$")
_GRIPPER = {
    "lidar static": "kept off a standing obstacle",
    "lidar moving": "kept off a moving obstacle",
    "lidar height": "kept from sinking beside an obstacle",
}
NEAR = 1.2  # [m] from the base: bodies farther away are not named
BESIDE = 0.6  # [m] from the planned path: nearer bodies are passed
HELD = 1.0  # [m] from the base to what it waits for
SAME = 0.2  # [m] tolerance between a named body's distance and the lidar's
ROUNDED = 1e-3  # [m], [rad] tolerance: the poses of a tick are rounded more finely
AHEAD, BEHIND = math.radians(40.0), math.radians(120.0)
_HOLDS = (
    Kind.IN_STOPPING_WAY, Kind.MEETS_MOVER, Kind.FLOOR_UNSEEN, Kind.NO_MOTION, Kind.LEAVES_REACH, Kind.NO_WAY,
    Kind.CLOSED_IN, Kind.NO_BETTER_MOTION,
)  # fmt: skip


def method_title(status: StatusMessage, name: str) -> str:
    """A method in a few words; its name, where the server does not offer it."""
    titles = {choice.name: choice.title for choice in status.methods}
    title = titles.get(name, name)
    return title if sum(other == title for other in titles.values()) < 2 else f"{title} ({name})"


def active_task(tick: TickMessage) -> TaskMessage | None:
    """The task in hand; None when all are done."""
    return tick.tasks[tick.task_index] if 0 <= tick.task_index < len(tick.tasks) else None


def doing(tick: TickMessage) -> str:
    """The robot's current activity, in one sentence."""
    task, step = active_task(tick), tick.arm[-1] if tick.arm else None
    if task is None or tick.done:
        return _ended(tick.tasks)
    if task.kind.startswith("drive"):
        return f"Driving to {task.target}"
    name = task.target
    carried = next((belief.name for belief in tick.beliefs if belief.held), "")
    cargo = carried or "the object"
    why = None if step is None else step.why
    unseen = why is not None and why.kind == Kind.WAITS_FOR_SIGHT  # the robot looks where the target was seen before
    on = "" if stands(tick) else ", on the move"
    carries = f"Carrying {cargo} to {name}" if task.kind == "place" else f"Holding {cargo}, with {name} to be picked"
    phases = {
        "stow": f"Driving to {name}, the arm at rest",
        "transit": f"Bringing {cargo} over {name}{on}" if carried else f"Reaching out for {name}{on}",
        "final": f"{'Looking for' if unseen else 'Closing in on'} {name}{on}",
        "closing": f"The fingers close on {name}" + (" while the base drives on" if on else ""),
        "lift": f"Lifting {cargo if carried else name}{on}",
        "carry": carries,
        "release": f"Letting {cargo} go over {name}{on}",
        "retry": f"Opening the fingers for another try at {name}",
    }
    if step is None:
        return f"Driving to {name}"
    if stands(tick) and step.phase in ("stow", "carry"):
        return f"Standing on the way to {name}" + (f", with {carried}" if carried else "")
    return phases.get(step.phase, f"{step.phase.replace('_', ' ')}: {name}")


def stands(tick: TickMessage) -> bool:
    """True for a base that does not move."""
    speed, turn = tick.robot.twist
    return abs(speed) < STANDS[0] and abs(turn) < STANDS[1]


def waiting(tick: TickMessage, limiter: str = "") -> list[tuple[str, bool]]:
    """Reasons why the robot waits or is slowed: sentences, each with True when the robot is held up.

    ``limiter``: name of the obstacle that slows the gripper; "" when it has none.
    """
    found: list[tuple[str, bool]] = []
    step, task = tick.arm[-1] if tick.arm else None, active_task(tick)
    if tick.stop_reason:
        found.append((_capital(tick.stop_reason), not tick.done))
    near = slowed_by(tick.arm, limiter)
    if near:
        found.append((near, False))
    if step is not None and step.why is not None and not (tick.why and tick.why.about(step.why.kind)):
        found.append((_capital(step.reason), False))
    if task is not None and task.attempts > 1:
        found.append((f"This is the {_ORDINAL.get(task.attempts, f'{task.attempts}th')} try at {task.target}", False))
    found += [(_capital(fault), True) for fault in tick.faults]
    return found


def slowed(steps: Sequence[ArmMessage]) -> list[ArmMessage]:
    """The arm steps of a period in which an obstacle seen by the lidar slows the gripper."""
    return [step for step in steps if step.limiter and any(row.startswith("lidar") for row in step.active)]


def slowed_by(steps: Sequence[ArmMessage], name: str = "") -> str:
    """The obstacle that slows the gripper in this period, and by how much; "" for none. ``name``: its name."""
    limited = slowed(steps)
    if not limited:
        return ""
    step, name = limited[-1], name.rstrip(",")
    allowed = step.allowed_approach
    if allowed is None or step.obstacle_distance is None:
        return f"The gripper is slowed by {name or f'a {step.limiter}'}"
    how = f"may approach at {allowed:.2f} m/s" if allowed > 0.0 else f"backs off at {-allowed:.2f} m/s or more"
    return f"{name or f'A {step.limiter}'} is {step.obstacle_distance:.2f} m away: the gripper {how}"


def _ended(tasks: Sequence[TaskMessage]) -> str:
    failed = [task for task in tasks if task.status == "failed"]
    if not tasks:
        return "Nothing to do: the list of tasks is empty"
    if failed:
        return f"All tasks have ended; given up: {', '.join(f'{task.kind} {task.target}' for task in failed)}"
    return f"All {len(tasks)} tasks are done"


def _capital(value: str) -> str:
    return value[:1].upper() + value[1:]


def constraints(steps: Sequence[ArmMessage], q: Sequence[float]) -> list[tuple[str, str]]:
    """Active rows and bounds of these arm steps, grouped: what is limited, and by what.

    ``q`` [rad], shape (7,): joint positions, which tell a position limit from a speed limit.
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
        other = {"lidar": LIDAR, "own base": "its own base", "own column": "its own column"}
        return body[1], f"kept off {other.get(body[2], body[2])}"
    joint = _JOINT.match(name)
    if joint is not None:
        return name, _joint_bound(int(joint[1]) - 1, step, q)
    return {
        "base speed": ("base", "speeds up or brakes as fast as it may"),
        "base yaw rate": ("base", "starts or ends a turn as fast as it may"),
    }.get(name, (name, "at its limit"))


def _joint_bound(k: int, step: ArmMessage, q: Sequence[float]) -> str:
    """The limit that a joint has reached: position, speed, or else acceleration."""
    if k < len(q) and min(q[k] - Q_MIN[k], Q_MAX[k] - q[k]) < _NEAR_END:
        return "near the end of its range"
    if k < len(step.joint_velocity) and abs(step.joint_velocity[k]) > _AT_SPEED * DQ_MAX[k]:
        return "at full speed"
    return "speeds up or brakes as fast as it may"


def _listed(names: Iterable[str]) -> str:
    """Names as one text, each once, with the joints together: "wrist, joints 1, 3"."""
    unique = list(dict.fromkeys(names))
    joints = sorted(found[1] for name in unique if (found := _JOINT.match(name)))
    others = [name for name in unique if not _JOINT.match(name)]
    return ", ".join([*others, f"joint{'s' * (len(joints) > 1)} {', '.join(joints)}"] if joints else others)


@dataclass(frozen=True)
class Unmapped:
    """A body that is not in the map: a dynamic or added one, or unannounced furniture."""

    label: str
    shape: shapely.Polygon  # outline on the floor [m]


def avoided(tick: TickMessage, scene: Scene | None) -> str:
    """The body that the robot avoids, and how, as the end of a sentence; "" when nothing is near its path."""
    if tick.done or scene is None:
        return ""
    things = list(unmapped(tick, scene))
    return _met(tick) or _held_up(tick, scene, things) or _gripper(tick, scene) or _past(tick, scene, things)


def limited_by(tick: TickMessage, scene: Scene | None) -> str:
    """Name of the unmapped body that limits the arm by its lidar row; "" for none, or for mapped furniture."""
    if scene is None or not slowed(tick.arm) or tick.arm[-1].obstacle_distance is None:
        return ""
    distance, label = _nearest_to_hand(tick, scene)
    return label if abs(distance - tick.arm[-1].obstacle_distance) <= SAME else ""


def strange(held_by: str, tick: TickMessage, scene: Scene | None) -> str:
    """Remark on an obstacle that limits the arm and is missing or misplaced in the map; "" otherwise.

    ``held_by``: a phrase from `constraints`.
    """
    if scene is None:
        return ""
    if held_by == f"kept off {LIDAR}":
        distance, label = _nearest_to_hand(tick, scene)
        return "" if distance > NEAR else f": {label.rstrip(',')}"
    for piece in pieces(scene).values():
        parts = {piece.name, *piece.solids}
        astray = piece.name in tick.removed or not _known(piece, tick)
        if astray and held_by.removeprefix("kept off ") in parts:
            return ", where the map still has it (the robot was not told that it moved)"
    return ""


def unmapped(tick: TickMessage, scene: Scene) -> Iterator[Unmapped]:
    """Bodies near the robot that are not in its map."""
    for body in (*tick.agents, *tick.obstacles):
        known_kind = body.kind.lower() in body.name.lower()  # else the label adds the kind
        yield Unmapped(body.name if known_kind else f"{body.name} ({body.kind})", body_outline(body))
    known = pieces(scene)
    moved = {name: pose for name, pose in furniture_poses(tick).items() if name in known}
    there = (piece for piece in known.values() if piece.name not in tick.removed)
    strange = [piece for piece in there if not (piece.mapped and _known(piece, tick))]
    if not strange:
        return
    solids = {solid.name: solid for solid in moved_scene(scene, moved, ()).solids}
    for piece in strange:
        shape = shapely.union_all([outline(solids[name].shape) for name in piece.solids])
        where = "which is not in the map" if not piece.mapped else "which is not where the map has it"
        yield Unmapped(f"{piece.name}, {where},", shapely.Polygon(shape.convex_hull.boundary.coords))


def _known(piece: Piece, tick: TickMessage) -> bool:
    """True for a piece that stands where the robot's map has it: at its last announced pose, else at home."""
    home = (*piece.centre, 0.0)
    here = furniture_poses(tick).get(piece.name, home)
    x, y, turn = tick.announced.get(piece.name, home)
    return math.dist(here[:2], (x, y)) < ROUNDED and abs(math.remainder(here[2] - turn, 2 * math.pi)) < ROUNDED


def gripper(tick: TickMessage, scene: Scene) -> shapely.Point:
    """True place of the fingers on the floor plan [m]."""
    place, _ = _frankie(scene.robot).tcp_pose(np.array(tick.robot.true_pose), np.array(tick.robot.q))
    return shapely.Point(place[:2])


def _met(tick: TickMessage) -> str:
    """Phrase about the track that the robot waits for, makes way for or passes, with its body's name; "" for none."""
    found = met(tick)
    if found is None:
        return ""
    track, bodies = found.track, (*tick.agents, *tick.obstacles)
    near = min(bodies, key=lambda body: math.dist(body.position[:2], track.position), default=None)
    known = near is not None and math.dist(near.position[:2], track.position) < SAME + track.radius
    return found.words.format(near.name if near is not None and known else f"person {track.track}")


def _held_up(tick: TickMessage, scene: Scene, things: list[Unmapped]) -> str:
    why = None if tick.why is None else tick.why.about(*_HOLDS)
    if tick.plan.status != "braking" and why is None:
        return ""
    found = _nearest(tick, scene, things, HELD)
    verb = "held up by" if stands(tick) else "braking for"
    if found is not None:
        return f"{verb} {_spelled(*found)}"
    if why is None or why.kind != Kind.IN_STOPPING_WAY:
        return ""
    return f"{verb} something the lidar sees {why.value:.1f} m away"


def _gripper(tick: TickMessage, scene: Scene) -> str:
    step = tick.arm[-1] if slowed(tick.arm) else None
    if step is None or step.obstacle_distance is None:
        return ""
    unnamed = "something that moves" if step.limiter == "moving obstacle" else ""  # else furniture that it works at
    label = limited_by(tick, scene) or unnamed
    return label and f"keeping the gripper off {label.rstrip(',')} ({step.obstacle_distance:.1f} m)"


def _nearest_to_hand(tick: TickMessage, scene: Scene) -> tuple[float, str]:
    """Distance [m] and label of the unmapped body nearest to the gripper; infinite when there is none."""
    hand = gripper(tick, scene)
    return min(((thing.shape.distance(hand), thing.label) for thing in unmapped(tick, scene)), default=(math.inf, ""))


def _past(tick: TickMessage, scene: Scene, things: list[Unmapped]) -> str:
    if stands(tick):
        return ""
    here = tick.robot.true_pose[:2]
    points = [here, *(pose[:2] for pose in tick.plan.local_poses)]
    way = shapely.LineString(points) if len(points) > 1 else shapely.Point(here)
    half = scene.robot.footprint.width / 2
    found = _nearest(tick, scene, [t for t in things if t.shape.distance(way) - half < BESIDE], NEAR)
    if found is None or found[2] == "behind":
        return ""
    return f"past {_spelled(*found)}"


def _nearest(tick: TickMessage, scene: Scene, things: list[Unmapped], limit: float) -> tuple[str, float, str] | None:
    """Label, distance from the base [m] and side of the nearest thing; None beyond ``limit`` [m]."""
    x, y, heading = tick.robot.true_pose
    body = scene.robot.footprint
    centre = (x + body.offset_x * math.cos(heading), y + body.offset_x * math.sin(heading))
    base = rectangle((*centre, heading), (body.length, body.width))
    distance, number = min(((thing.shape.distance(base), k) for k, thing in enumerate(things)), default=(math.inf, -1))
    if distance > limit:
        return None
    point = shapely.ops.nearest_points(things[number].shape, shapely.Point(x, y))[0]
    side = math.remainder(math.atan2(point.y - y, point.x - x) - heading, 2 * math.pi)
    where = "ahead" if abs(side) < AHEAD else "behind" if abs(side) > BEHIND else "to its left" if side > 0 else ""
    return things[number].label, float(distance), where or "to its right"


def _spelled(label: str, distance: float, where: str) -> str:
    end = " " if label.endswith(",") else ", "
    return f"{label}{end}{distance:.1f} m {where}"


@functools.lru_cache(maxsize=4)
def _frankie(profile: RobotProfile) -> Frankie:
    return Frankie(profile)
