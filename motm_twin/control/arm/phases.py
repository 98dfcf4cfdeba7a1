"""The phases of a pick and a place, and the conditions that end each.

pick:   stow -> transit -> final -> closing -> lift -> carry      (closing -> retry -> transit after a miss)
place:  carry -> transit -> release -> stow
"""

import math
from dataclasses import dataclass

import numpy as np

from motm_twin.control.arm.geometry import planar_joints, pose_at, room_at, tilt_of
from motm_twin.control.arm.grasp_room import GraspRoom, height_over
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.types import ArmInputs, ArmTiming, Phase
from motm_twin.control.arm.view import ManipulatorState, View, taken
from motm_twin.model.compiler import njit
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array, to_frame
from motm_twin.model.plant import PERIOD
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason

GRAVITY = 9.81  # [m/s^2]
_UNSURE = Reason(kind=Kind.WAITS_FOR_STATE, subject="robot")


Outcome = tuple[str, Reason | None]  # outcome of a step, and the reason
NOTHING: Outcome = ("", None)


@dataclass(frozen=True)
class PhaseRules:
    """Parameters and geometry of the transitions, beside state and view."""

    parameters: ArmParameters
    profile: RobotProfile
    timing: ArmTiming
    mount: Array  # [m] in the base frame
    room: GraspRoom

    def reach(self, kind: str) -> float:
        """Largest distance from the mount at which a final approach begins [m]."""
        return self.parameters.pick_reach if kind == "pick" else self.parameters.place_reach


def enter(state: ManipulatorState, phase: Phase, time: float) -> None:
    """Begin a phase."""
    state.phase, state.since, state.leaves = phase, time, False


def fits_gripper(state: ManipulatorState, view: View) -> bool:
    """Test that the goal fits the gripper: a place while it holds an object, a pick while it holds none."""
    return view.goal.kind == ("place" if state.holding else "pick")


def advance(state: ManipulatorState, view: View, inputs: ArmInputs, rules: PhaseRules) -> Outcome:
    """Move to the phase of this step; returns outcome and reason."""
    goal = f"{view.goal.kind} {view.goal.name}"
    if goal != state.goal:
        _new_goal(state, view)
        state.goal = goal
    if state.holding and state.released is None and view.width < state.side - rules.parameters.held_tolerance:
        return _lost(state, view)
    if _impatient(state, view, rules):
        tight = state.tight if view.goal.kind == "pick" else None
        state.tight_tries += tight is not None
        _withdraw(state, view)
        state.start_over = True
        if state.tight_tries > 1:
            state.tight_tries = 0
            return "no room", tight
        return "stuck", Reason(kind=Kind.NOTHING_ACHIEVED, subject=view.goal.name)
    if state.phase in (Phase.STOW, Phase.CARRY):
        return _leave(state, view, inputs, rules)
    if state.phase == Phase.TRANSIT:
        return _arrive(state, view, inputs, rules)
    if state.phase == Phase.FINAL:
        return _approach(state, view, rules)
    if state.phase == Phase.CLOSING:
        return _close(state, view, rules)
    if state.phase == Phase.LIFT:
        return _lift(state, view, rules)
    if state.phase == Phase.RELEASE:
        return _release(state, view, rules)
    return _retry(state, view, rules)


def _impatient(state: ManipulatorState, view: View, rules: PhaseRules) -> bool:
    """Test that the target has been in range for long while the hand was on the way to it or over it."""
    trying = state.phase in (Phase.TRANSIT, Phase.FINAL, Phase.RELEASE) and state.released is None
    if not trying or view.time_to_range > 0.0:
        state.in_range_since = None
    elif state.in_range_since is None:
        state.in_range_since = view.time
    return state.in_range_since is not None and view.time - state.in_range_since > rules.parameters.patience


def _rest(state: ManipulatorState, time: float) -> None:
    state.yaw, state.tight, state.no_room_since = None, None, None
    state.opening, state.narrowing_since = None, None
    enter(state, Phase.CARRY if state.holding else Phase.STOW, time)


def _rise(state: ManipulatorState, view: View) -> None:
    """Go straight up from here: the fingers are beside an object."""
    state.anchor = view.p.copy()
    enter(state, Phase.RETRY, view.time)


def _withdraw(state: ManipulatorState, view: View) -> None:
    """Return to the stow pose; fingers that are beside an object rise first."""
    low = not state.holding and state.phase in (Phase.FINAL, Phase.CLOSING, Phase.RETRY)
    _rest(state, view.time)
    if low:
        _rise(state, view)


def start_over(state: ManipulatorState, view: View, parameters: ArmParameters) -> str:
    """Break off the job under way, and begin again from the stow pose; "picked" when that ends a lift."""
    if state.phase in (Phase.STOW, Phase.CARRY):
        return ""
    outcome = "" if state.phase != Phase.LIFT or state.reported else _picked(state, parameters)
    if not state.holding:
        state.gripper = "open"
    state.released, state.start_over = None, True
    _withdraw(state, view)
    return outcome


def _picked(state: ManipulatorState, p: ArmParameters) -> str:
    state.reported, state.opening = True, None
    state.clear_z = float(state.anchor[2]) + p.transit_clearance
    state.relaxed = state.anchor[None, :2].copy()
    return "picked"


def _new_goal(state: ManipulatorState, view: View) -> None:
    state.tight_tries, state.opens_fully = 0, False
    if state.phase in (Phase.TRANSIT, Phase.FINAL, Phase.CLOSING, Phase.RETRY, Phase.RELEASE):
        if not state.holding:
            state.gripper = "open"
        state.released = None
        _withdraw(state, view)
        state.leaves = state.phase == Phase.RETRY


def _lost(state: ManipulatorState, view: View) -> Outcome:
    reported = state.reported
    state.holding, state.reported, state.released, state.gripper = False, False, None, "open"
    if reported:
        enter(state, Phase.STOW, view.time)
        return "lost", Reason(kind=Kind.SLIPPED)
    _rise(state, view)
    return "missed", Reason(kind=Kind.SLIPPED_IN_LIFT)


def _leave(state: ManipulatorState, view: View, inputs: ArmInputs, rules: PhaseRules) -> Outcome:
    _clear_way_home(state, view, inputs, rules)
    if not fits_gripper(state, view):
        if view.goal.kind == "place":
            return "", Reason(kind=Kind.NOTHING_HELD)
        return ("", Reason(kind=Kind.HELD_ALREADY)) if view.goal.kind == "pick" else NOTHING
    if state.start_over:
        state.start_over = not _stowed(view, rules.parameters) and view.time - state.since < rules.parameters.patience
        return "", Reason(kind=Kind.STARTS_OVER)
    speed = float(inputs.observation.twist[0])
    duration = rules.timing.transit_duration(_way(view, inputs, rules), speed, view.time_to_range)
    if duration is None or view.time_to_range > rules.parameters.patience:
        return NOTHING
    if not state.holding and not _open_enough(view, rules):
        return "", Reason(kind=Kind.GRIPPER_NOT_OPEN, subject="gripper")
    enter(state, Phase.TRANSIT, view.time)
    return NOTHING


def _clear_way_home(state: ManipulatorState, view: View, inputs: ArmInputs, rules: PhaseRules) -> None:
    """Let a hand on its way home pass over furniture that is higher than where it was."""
    p = rules.parameters
    if math.hypot(view.p[0] - view.mount[0], view.p[1] - view.mount[1]) > p.retract_radius:
        home = np.array([view.mount[0], view.mount[1], view.p[2] - p.transit_clearance])
        top = rules.room.top_between(view.p, home, inputs.T_odom_world)
        state.clear_z = max(state.clear_z, top + p.transit_clearance)


def _open_enough(view: View, rules: PhaseRules) -> bool:
    """Test that the fingers are wider than the object by `open_room`, or open as far as they go."""
    p = rules.parameters
    return view.width >= min(view.goal.side + p.open_room, rules.profile.gripper.max_width - p.held_tolerance)


def _stowed(view: View, p: ArmParameters) -> bool:
    """Test that the hand is at the stow pose, and the arm is not turned or folded another way to hold it there."""
    near = math.hypot(view.p[0] - view.mount[0], view.p[1] - view.mount[1]) < 2.0 * p.stow_radius
    bent = np.abs(planar_joints(p.stow_radius, p.stow_height, p.stow_tilt) - view.q)[:5]
    return near and float(bent.max()) < p.bent


def _way(view: View, inputs: ArmInputs, rules: PhaseRules) -> float:
    """Distance [m] of the hand to the point at which it must be, base frame, when the target comes into range."""
    if not math.isfinite(view.time_to_range):
        return view.distance
    return _way_later(
        view.time_to_range, view.pose, inputs.plan_times, inputs.plan_poses, view.target, view.p, rules.mount,
        rules.parameters.hover_radius,
    )  # fmt: skip


@njit(cache=True)
def _way_later(
    ahead: float, pose: Array, plan_times: Array, plan_poses: Array, target: Array, p: Array, mount: Array,
    hover: float,
) -> float:  # fmt: skip
    """Distance [m] of the hand from its hover point, base frame, once the base is ``ahead`` [s] further on its plan."""
    there = _in_base(pose_at(ahead, pose, plan_times, plan_poses), target)
    away = there[:2] - mount[:2]
    share = min(1.0, hover / max(norm(away), 1e-6))
    there[0], there[1] = mount[0] + away[0] * share, mount[1] + away[1] * share
    return norm(there - _in_base(pose, p))


@njit(cache=True)
def _in_base(pose: Array, point: Array) -> Array:
    """A point in the frame of the base, shape (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    return np.array([c * dx + s * dy, -s * dx + c * dy, point[2]])


def _arrive(state: ManipulatorState, view: View, inputs: ArmInputs, rules: PhaseRules) -> Outcome:
    p = rules.parameters
    out = view.radius - rules.reach(view.goal.kind)
    if not fits_gripper(state, view) or (out > 0.0 and view.time_to_range > p.patience):
        _rest(state, view.time)
        return NOTHING
    state.top_between = rules.room.top_between(view.p, view.target, inputs.T_odom_world)
    if view.goal.kind == "pick":
        choose_yaw(state, view, inputs, rules)
    if state.no_room_since is not None:
        return _wait_without_room(state, view, p)
    if state.opening is not None and view.width > state.opening + p.held_tolerance:
        return _wait_for_opening(state, view, p)
    state.narrowing_since = None
    if out > 0.0 or view.distance > p.approach_distance:
        return NOTHING
    if view.slides(p):
        return "", Reason(kind=Kind.WAITS_FOR_GRIP, subject=view.goal.name)
    if view.goal.kind == "place":
        state.anchor = view.target.copy()
        enter(state, Phase.RELEASE, view.time)
    elif view.p[2] < view.target[2] + p.hover_height + p.reach_slack:
        unseen = _unseen_beside(state, view, p)
        if unseen:
            return "", Reason(kind=Kind.WAITS_FOR_SIGHT, subject=unseen)
        enter(state, Phase.FINAL, view.time)
    return NOTHING


def _unseen_beside(state: ManipulatorState, view: View, p: ArmParameters) -> str:
    """A neighbour of the goal that the camera has not seen yet and may see soon; "" when the hand waits no longer.

    Coming down at once, the hand could hit a neighbour that is not where it is believed.
    """
    since = view.time if state.in_range_since is None else state.in_range_since
    goal = view.goal
    if view.time - since > p.search_after or (goal.neighbours[:, 5] > 0.0).all():
        return ""
    return goal.neighbour_names[int(goal.neighbours[:, 5].argmin())]


def _wait_without_room(state: ManipulatorState, view: View, p: ArmParameters) -> Outcome:
    """Wait over an object that leaves no room for the fingers; give it up once it has been seen well enough.

    While the position of the furniture is uncertain, the hand waits until its patience ends.
    """
    if not view.seen(p) or view.goal.position_sd > 1.5 * p.close_sd or view.time_to_range > 0.0:
        state.no_room_since = math.inf
        return NOTHING
    since = view.time if state.no_room_since is None else min(state.no_room_since, view.time)
    state.no_room_since = since
    if view.time - since < p.search_after:
        return "", state.tight
    reason = state.tight
    _rest(state, view.time)
    return "no room", reason


def _wait_for_opening(state: ManipulatorState, view: View, p: ArmParameters) -> Outcome:
    """Wait for the fingers to close to the wanted opening; for this goal, give that up if they only open fully."""
    if state.narrowing_since is None or not view.sure(p):
        state.narrowing_since = view.time
    if view.time - state.narrowing_since > p.search_after:
        state.opens_fully, state.opening = True, None
    return "", Reason(kind=Kind.GRIPPER_TOO_WIDE, subject="gripper")


def choose_yaw(state: ManipulatorState, view: View, inputs: ArmInputs, rules: PhaseRules) -> None:
    """Choose the faces of the cube for the fingers, and keep them: a new choice each step would flip them in a swing.

    The natural yaw of the hand has joint 7 in its middle `mid_dwell` after arrival, when the base is about nearest. The
    faces nearest to it are taken, unless there is little room beside them and more beside the others. When neither pair
    leaves enough room, the fingers open only as far as this object needs.
    """
    goal, p = view.goal, rules.parameters
    ahead = view.time_to_range + p.mid_dwell
    natural = _azimuth_later(ahead, view.pose, inputs.plan_times, inputs.plan_poses, view.target, rules.mount)
    near = natural if state.yaw is None or view.time_to_range > p.yaw_time else state.yaw
    wide, narrow = rules.profile.gripper.max_width, goal.side + p.open_room + p.held_tolerance
    width = min(state.opening or wide, wide)
    state.yaw, room = rules.room.yaw(goal, near, natural, width, inputs.T_odom_world, inputs.observation.pose_sd)
    if room.what and narrow < width and not state.opens_fully:
        yaw, roomier = rules.room.yaw(goal, near, natural, narrow, inputs.T_odom_world, inputs.observation.pose_sd)
        if (roomier.closed, roomier.cost) < (room.closed, room.cost):
            state.yaw, room, state.opening = yaw, roomier, narrow
    state.tight = Reason(kind=Kind.NO_ROOM, subject=goal.name, other=room.what) if room.what else None
    if not room.blocked:
        state.no_room_since = None
    elif state.no_room_since is None or room.wanders:
        state.no_room_since = math.inf


@njit(cache=True)
def _azimuth_later(
    ahead: float, pose: Array, plan_times: Array, plan_poses: Array, target: Array, mount: Array
) -> float:
    """Direction [rad] of the target from the mount ``ahead`` [s] from now, in the odometry frame."""
    later = pose_at(ahead, pose, plan_times, plan_poses)
    local = _in_base(later, target)
    return math.atan2(local[1] - mount[1], local[0] - mount[0]) + later[2]


def _approach(state: ManipulatorState, view: View, rules: PhaseRules) -> Outcome:
    p = rules.parameters
    if view.radius > rules.reach("pick") + p.reach_slack or view.distance > 2.0 * p.approach_distance:
        enter(state, Phase.TRANSIT, view.time)
        return "", Reason(kind=Kind.OUT_OF_REACH, subject=view.goal.name)
    if state.since < view.slips_since and view.slides(p):  # else it came down since, from a base that stood
        _rise(state, view)
        return "", Reason(kind=Kind.WAITS_FOR_GRIP, subject=view.goal.name)
    if not view.seen(p):
        return "", Reason(kind=Kind.WAITS_FOR_SIGHT, subject=view.goal.name)
    if not view.sure(p):
        return "", _UNSURE
    if view.goal.position_sd > p.close_sd:
        sd = 1e3 * view.goal.position_sd
        return "", Reason(kind=Kind.IMPRECISE, subject=view.goal.name, value=sd, limit=1e3 * p.close_sd, unit="mm")
    point = grasp_point(view, height_over(view.p[None], view.R, view.width, view.goal), p)
    error = norm(view.p - point)
    still = norm(view.velocity) <= p.close_speed
    low = view.p[2] - view.target[2] <= p.highest_grasp + 0.5 * p.close_error  # else the pads squeeze it out
    if error <= p.close_error and low and still and tilt_of(view.R) <= p.close_tilt:
        state.anchor = point
        state.gripper = "close"
        state.side = view.goal.side
        enter(state, Phase.CLOSING, view.time)
    return NOTHING


def grasp_point(view: View, over: float, p: ArmParameters) -> Array:
    """Grasp point of the tool centre point: the cube's centre, or as much higher as finger tips and palm need.

    ``over`` [m]: `height_over` of the hand where it is.
    """
    x, y, z = view.R[2].tolist()
    low = p.tip_half_depth * abs(x) + (0.5 * view.width + p.tip_thickness) * abs(y) + p.tip_length * abs(z)
    rise = max(low + p.avoidance.fingers_d_s - 0.5 * view.goal.side, over - float(view.target[2]))
    return view.target + np.array([0.0, 0.0, min(max(rise, 0.0), p.highest_grasp)])


def _close(state: ManipulatorState, view: View, rules: PhaseRules) -> Outcome:
    p = rules.parameters
    if not view.sure(p):  # nothing is let go of before it is known what the fingers hold
        return "", _UNSURE
    elapsed = view.time - state.since
    closing_time = rules.profile.gripper.closing_time
    has_it = not view.gripper_moving and abs(view.width - state.side) <= p.held_tolerance
    if view.width < state.side - p.held_tolerance or elapsed > closing_time + p.longest_closing:
        return _miss(state, view, rules, Kind.CLOSED_ON_NOTHING)
    if not has_it and norm(view.p - state.anchor) > p.left_error:
        return _miss(state, view, rules, Kind.LEFT_OBJECT)
    if not has_it and math.hypot(*(state.anchor[:2] - view.target[:2])) > p.pushed_away:
        return _miss(state, view, rules, Kind.PUSHED_AWAY)
    if not view.gripper_moving and _firm(state, view, rules, elapsed):
        state.late = _lateness(state, view, rules)
        state.holding, state.reported = True, False
        state.anchor = view.p.copy()
        enter(state, Phase.LIFT, view.time)
    return NOTHING


def _firm(state: ManipulatorState, view: View, rules: PhaseRules, elapsed: float) -> bool:
    """Test that standing fingers hold the object: at its width, or, once closing is due, nearer to it than to open."""
    gripper, beyond = rules.profile.gripper, view.width - state.side
    late = elapsed >= gripper.closing_time - 0.5 * view.dt
    wide = state.opening or gripper.max_width
    return beyond <= rules.parameters.held_tolerance or (late and beyond < 0.5 * (wide - state.side))


def _miss(state: ManipulatorState, view: View, rules: PhaseRules, kind: Kind) -> Outcome:
    state.late = max(state.late, _lateness(state, view, rules))
    state.gripper = "open"
    _rise(state, view)
    return "missed", Reason(kind=kind)


def _lateness(state: ManipulatorState, view: View, rules: PhaseRules) -> float:
    """Time [s] by which this closing has taken longer than it should: the next one is expected to be as late."""
    over = view.time - state.since - rules.profile.gripper.closing_time
    return over if over > PERIOD else 0.0


def _left_to_close(state: ManipulatorState, elapsed: float, closing_time: float, p: ArmParameters) -> float:
    """Time [s] that a closing is still expected to need; the delay of late fingers is not known."""
    left = closing_time + state.late - elapsed
    return max(0.0, left) if left >= -PERIOD else max(p.late_for, -left)


def _lift(state: ManipulatorState, view: View, rules: PhaseRules) -> Outcome:
    p = rules.parameters
    risen = view.p[2] - state.anchor[2]
    outcome = ""
    if not state.reported and risen >= p.picked_height:
        outcome = _picked(state, p)
    elif risen >= 0.8 * p.lift_height:
        _rest(state, view.time)
    return outcome, None


def _release(state: ManipulatorState, view: View, rules: PhaseRules) -> Outcome:
    p, gripper = rules.parameters, rules.profile.gripper
    if state.released is None:
        if view.radius > rules.reach("place") + p.reach_slack:
            enter(state, Phase.TRANSIT, view.time)
            return "", Reason(kind=Kind.OUT_OF_REACH, subject=view.goal.name)
        strayed = math.hypot(*(view.p[:2] - state.anchor[:2])) > 2.0 * p.approach_distance
        fits = _in_square(state, view, rules, state.anchor) and _free(view, state.anchor, p)
        if strayed or not fits:  # the robot was pushed, the bin moved, or an object is seen there
            state.anchor = view.target.copy()
        if not view.sure(p):
            return "", _UNSURE
        if lands_inside(state, view, rules):
            state.gripper, state.released = "open", view.time
        return NOTHING
    if not view.sure(p) and view.width < state.side + p.held_tolerance:  # the hand may be elsewhere when it opens
        state.gripper, state.released = "close", None
        return "", _UNSURE
    over = view.time - state.released - gripper.opening_time - _falling_time(state.side, p) + 0.5 * view.dt
    open_now = view.width > state.side + p.held_tolerance and (not view.gripper_moving or over > p.search_after)
    if over >= 0.0 and open_now:
        if over < p.search_after and _on_a_pile(state, view, p):
            state.anchor[2] = view.target[2] + p.transit_clearance
            return NOTHING
        state.holding, state.reported, state.released = False, False, None
        state.clear_z = float(view.goal.position[2]) + p.transit_clearance
        enter(state, Phase.STOW, view.time)
        return "placed", None
    return NOTHING


def _falling_time(side: float, p: ArmParameters) -> float:
    """Time [s] that a released object takes to fall out of the fingers; a hand that leaves sooner would hit it."""
    return math.sqrt(2.0 * (0.5 * side + p.tip_length) / GRAVITY)


def lands_inside(state: ManipulatorState, view: View, rules: PhaseRules) -> bool:
    """Test that an object released now, with the hand's velocity, falls into the release square and has room."""
    p, goal = rules.parameters, view.goal
    over = view.p[2] - goal.position[2]
    if norm(view.velocity) > p.release_speed or not 0.5 * state.side + 0.015 <= over <= 0.12:
        return False
    fall = rules.profile.gripper.opening_time + math.sqrt(2.0 * (over + 0.1) / GRAVITY)
    land = view.p[:2] + view.velocity[:2] * fall
    return _in_square(state, view, rules, view.p) and _in_square(state, view, rules, land) and _free(view, land, p)


def _free(view: View, point: Array, p: ArmParameters) -> bool:
    """Test that an object that lands at (x, y) has room in the bin, or about as much as where there is most."""
    goal, there = view.goal, taken(view.goal, 0.5)
    most, room = (room_at(place, goal.position, goal.yaw, there) for place in (view.target, point))
    return room >= 0.0 or (most < 0.0 and room >= most - p.approach_distance)


def _on_a_pile(state: ManipulatorState, view: View, p: ArmParameters) -> bool:
    """Test that the hand is still so low that the released object, on top of others, may be between its fingers."""
    full = room_at(view.target, view.goal.position, view.goal.yaw, taken(view.goal, 0.5)) < 0.0
    return full and view.p[2] < view.target[2] + 0.5 * state.side + p.tip_length


def _in_square(state: ManipulatorState, view: View, rules: PhaseRules, point: Array) -> bool:
    """Test that the held object is within the release square when its centre is at a point (x, y, ...)."""
    goal = view.goal
    half = goal.release_half_width - 0.5 * state.side - 0.5 * rules.parameters.release_margin
    frame = np.array([goal.position[0], goal.position[1], goal.yaw])
    return bool(np.abs(to_frame(frame, point[:2])).max() <= half)


def _retry(state: ManipulatorState, view: View, rules: PhaseRules) -> Outcome:
    p = rules.parameters
    risen = view.p[2] - state.anchor[2] >= 0.8 * p.hover_height or view.time - state.since > p.search_after
    if not risen:
        return "", Reason(kind=Kind.OPENS_AGAIN, subject=view.goal.name)
    if view.goal.kind != "pick" or state.start_over:
        _rest(state, view.time)
    elif not view.gripper_moving and _open_enough(view, rules):
        enter(state, Phase.TRANSIT, view.time)
    return "", Reason(kind=Kind.OPENS_AGAIN, subject=view.goal.name)


def engaged(state: ManipulatorState) -> bool:
    """Test that the base must keep the target in reach."""
    return (
        state.phase in (Phase.FINAL, Phase.CLOSING, Phase.RELEASE)
        or (state.phase == Phase.RETRY and not state.leaves)
        or (state.phase == Phase.LIFT and not state.reported)
    )


def fingers_at_work(state: ManipulatorState) -> bool:
    """Test that the fingers close, lift an object (until the pick is reported) or release one."""
    lifting = state.phase == Phase.LIFT and not state.reported
    return state.phase == Phase.CLOSING or lifting or state.released is not None


def dwell(state: ManipulatorState, view: View, rules: PhaseRules) -> float:
    """Time [s] in reach that the job still needs."""
    p, gripper = rules.parameters, rules.profile.gripper
    elapsed = view.time - state.since
    lift = p.lift_time
    if view.goal.kind == "place":
        away = gripper.opening_time + _falling_time(state.side, p)
        if state.released is not None:
            return max(0.0, away - (view.time - state.released))
        settle = max(0.05, p.place_settle_time - elapsed) if state.phase == Phase.RELEASE else p.place_settle_time
        return settle + away
    if view.goal.kind != "pick":
        return 0.0
    if state.phase == Phase.LIFT:
        return 0.0 if state.reported else lift
    if state.phase == Phase.CLOSING:
        return _left_to_close(state, elapsed, gripper.closing_time, p) + lift
    settle = max(0.05, p.settle_time - elapsed) if state.phase == Phase.FINAL else p.settle_time
    return settle + gripper.closing_time + lift + state.late
