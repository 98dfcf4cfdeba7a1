"""Desired velocity of the hand in each phase: a reference, recomputed every step from the pose of the hand."""

import math
from typing import NamedTuple

import numpy as np

from motm_twin.control.arm.bodies import PALM
from motm_twin.control.arm.geometry import (
    capped,
    carried_velocity,
    from_polar,
    polar,
    pose_at,
    reach_height,
    reach_radius,
    rotation_error,
    tilt_for,
    tilt_of,
    tool_rotation,
)
from motm_twin.control.arm.grasp_room import height_across, height_over
from motm_twin.control.arm.parameters import ArmParameters, Numbers
from motm_twin.control.arm.phases import grasp_point
from motm_twin.control.arm.types import ArmInputs, Phase
from motm_twin.control.arm.view import Arm, ManipulatorState, View
from motm_twin.model.arm_kernels import HAND, TCP
from motm_twin.model.compiler import njit
from motm_twin.model.exact import hypot, norm, wrap_angle
from motm_twin.model.geometry import Array

_HOME, _OUT, _FIXED = 0, 1, 2
_GOALS = ("none", "pick", "place")
_NONE, _PICK, _PLACE = 0, 1, 2
_SWINGS = {
    Phase.STOW: _HOME,
    Phase.CARRY: _HOME,
    Phase.TRANSIT: _OUT,
}  # phases in which the hand swings about the mount
_LOW = 0.01  # [m] above the least height over the goal: a hand below that counts as one that crosses objects
_SHARES = np.array([[0.0], [0.5], [1.0]])  # of the way to the target at which objects are looked for
_AHEAD = np.linspace(0.0, 0.4, 11)  # [m] of the way to the target at which other objects are looked for
_ANCHORED = (Phase.CLOSING, Phase.LIFT, Phase.RELEASE)  # phases in which the hand keeps to a point chosen before


class Motion(NamedTuple):
    """Desired position of the hand, and its velocity towards it."""

    reference: Array  # desired tool centre point, odometry frame [m], shape (3,)
    error: float  # [m] of the tool centre point from there
    velocity: Array  # nu: linear [m/s], angular [rad/s], odometry frame, shape (6,)
    crosses: bool = False  # the hand crosses objects, whose tops it must clear


class _Swing(NamedTuple):
    """A point in polar coordinates about the mount, its motion, and the gains to reach it."""

    radius: float
    azimuth: float
    z: float
    radius_rate: float
    azimuth_rate: float
    gain: float  # [1/s]
    azimuth_gain: float  # [1/s]


class _Way(NamedTuple):
    """Guidance of the hand in this phase."""

    kind: int  # home, out to the target, or to the reference as it is
    over: Array  # [m] point at which the hand works, shape (3,)
    plan_times: Array
    plan_poses: Array
    radius: float
    azimuth: float
    distance: float
    time_to_range: float
    goal: int  # index into `_GOALS`
    clear_z: float
    top_between: float
    over_objects: float  # [m] least height of the tool centre point on its way, over objects
    anchor: Array
    yaw: float  # [rad], nan: outward from the mount
    fastest: float  # [m/s]


def hand_motion(
    state: ManipulatorState, view: View, inputs: ArmInputs, parameters: ArmParameters, numbers: Numbers
) -> Motion:
    """Reference and velocity of the hand for the phase of this step; ``numbers`` of the same parameters."""
    phase = state.phase
    kind = _SWINGS.get(phase, _FIXED)
    reference = _point(state, view, parameters) if kind == _FIXED else np.empty(3)
    yaw = math.nan if state.yaw is None or phase == Phase.RELEASE else state.yaw
    over, clear_z = _over_others(state, view, parameters), state.clear_z
    if view.goal.kind == "pick" and view.distance < parameters.neighbours:  # a pick that is broken off
        clear_z = max(clear_z, view.target[2] + parameters.transit_clearance)
    over_goal = _over_goal(state, view, parameters)
    way = _Way(
        kind, state.anchor if phase in _ANCHORED else view.target, inputs.plan_times, inputs.plan_poses,
        view.radius, view.azimuth, view.distance, view.time_to_range, _GOALS.index(view.goal.kind), clear_z,
        state.top_between, max(over, over_goal), state.anchor, yaw,
        parameters.hold_speed if phase == Phase.CLOSING else parameters.hand_speed,
    )  # fmt: skip
    error, velocity = _motion(view.arm, way, numbers, reference)
    crosses = over > -math.inf or view.p[2] < over_goal + _LOW
    return Motion(reference, error, velocity, crosses)


def _over_others(state: ManipulatorState, view: View, p: ArmParameters) -> float:
    """Least height [m] of a swinging hand, over the objects that it crosses; -inf: none.

    On its way these are all but its goal; on its way back the goal of a pick counts, too.
    """
    goal, out = view.goal, state.phase == Phase.TRANSIT
    back = goal.kind == "pick" and not out
    if state.phase not in _SWINGS or not (back or len(goal.others)):
        return -math.inf
    ahead = _AHEAD
    if goal.kind == "place" and out:
        ahead = _AHEAD[_AHEAD < view.distance - p.sink_distance]
    end = view.target if out else view.mount
    way = end - view.p
    places = view.p + np.minimum(ahead / max(hypot(way[0], way[1]), 1e-9), 1.0)[:, None] * way
    return height_across(places, view.R, view.width, state.side if state.holding else 0.0, goal, own=back)


def _over_goal(state: ManipulatorState, view: View, p: ArmParameters) -> float:
    """Least height [m] of a hand that comes to a pick, over the object and its neighbours; -inf far from it."""
    if state.phase != Phase.TRANSIT or view.goal.kind != "pick" or view.distance > 2.0 * p.sink_distance:
        return -math.inf
    return height_over(view.p + _SHARES * (view.target - view.p), view.R, view.width, view.goal)


@njit(cache=True)
def _motion(arm: Arm, way: _Way, parameters: Numbers, reference: Array) -> tuple[float, Array]:
    """Error and velocity; fills in the reference of a swing.

    One kernel for all phases, so that no phase begins by loading one.
    """
    velocity = np.empty(6)
    if way.kind == _FIXED:
        _fixed(arm, way, reference, parameters, velocity)
        return norm(reference - arm.p), velocity
    if way.kind == _HOME:
        planar, rotation = 1.0, _stow_rotation(arm.p, arm.mount, parameters)
        swing = _stowed(arm, way, parameters)
    else:
        planar = _planar_share(arm, way.time_to_range, parameters)
        rotation = _transit_rotation(arm, way, planar, parameters)
        beside = hypot(arm.p[0] - way.anchor[0], arm.p[1] - way.anchor[1]) < parameters[0].neighbours
        swing = _transit_swing(arm, way, way.clear_z if beside else -math.inf, parameters)
    _swing(swing, rotation, arm, planar, parameters, velocity, reference)
    return norm(reference - arm.p), velocity


def _point(state: ManipulatorState, view: View, p: ArmParameters) -> Array:
    """The point in the odometry frame that the hand keeps to, shape (3,)."""
    if state.phase == Phase.FINAL:
        return _final_point(state, view, p)
    point = state.anchor.copy()
    if state.phase in (Phase.LIFT, Phase.RETRY):  # straight up: the object, and those beside it, are low
        point[2] += p.lift_height if state.phase == Phase.LIFT else p.hover_height
    return point


def _final_point(state: ManipulatorState, view: View, p: ArmParameters) -> Array:
    """The grasp point, raised while the hand is not centred over the object or the object is not seen well enough.

    The hand also stays above neighbouring objects that it would touch, and higher by the drop of its palm's edge when
    it is tilted too much to close. It rises while it waits to see the object, for a wider view, as far as it can
    look straight down.
    """
    over = height_over(view.p[None], view.R, view.width, view.goal)
    point, seen = grasp_point(view, over, p), view.seen(p)
    if not seen or view.goal.position_sd > 1.5 * p.close_sd:
        point[2] = view.target[2] + p.hover_height
        if not seen:
            waited = max(0.0, view.time - state.since - p.search_after)
            highest = view.mount[2] + reach_height(view.radius, p.pick_tilt, p.stretch)
            rise = min(p.search_rise, p.search_speed * waited)
            point[2] = max(point[2], min(point[2] + rise, highest))
        return point
    point[2] += min(max((view.distance - p.funnel_radius) * p.funnel_slope, 0.0), p.hover_height)
    point[2] += palm_drop(view.R, p.close_tilt)
    point[2] = max(point[2], over)
    return point


@njit(cache=True)
def _fixed(arm: Arm, way: _Way, point: Array, parameters: Numbers, velocity: Array) -> None:
    """Proportional control towards a fixed point in the odometry frame, with the hand oriented for ``way.over``.

    The hand points down, tilted outwards only as far as the reach requires.
    """
    n, p, mount = parameters[0], arm.p, arm.mount
    linear = capped(n.k_P * (point - p), way.fastest)
    linear[2] = min(max(linear[2], -n.vertical_speed), n.vertical_speed)
    outward = _outward(mount, way.over)
    radius = hypot(way.over[0] - mount[0], way.over[1] - mount[1])
    tilt = tilt_for(radius, p[2] - mount[2], n.stretch, _largest_tilt(way.goal == _PLACE, parameters))
    rotation = tool_rotation(_outward(mount, p) if math.isnan(way.yaw) else way.yaw, tilt, outward)
    _fill(velocity, linear, _turn(rotation, arm.R, parameters))


@njit(cache=True)
def _fill(velocity: Array, linear: Array, angular: Array) -> None:
    for k in range(3):
        velocity[k], velocity[3 + k] = linear[k], angular[k]


@njit(cache=True)
def _stowed(arm: Arm, way: _Way, parameters: Numbers) -> _Swing:
    """Swing to the stow pose: gripper, object and elbow inside the footprint, turned a little towards any target."""
    n, p, mount = parameters[0], arm.p, arm.mount
    azimuth = 0.0 if way.goal == _NONE else min(max(way.azimuth, -n.stow_azimuth), n.stow_azimuth)
    clear = max(way.clear_z + palm_drop(arm.R, n.close_tilt), way.over_objects)
    z = mount[2] + n.stow_height
    if hypot(p[0] - mount[0], p[1] - mount[1]) > n.retract_radius:
        z = max(z, clear)
    swing = _Swing(n.stow_radius, azimuth, max(z, way.over_objects), 0.0, 0.0, n.k_transit, n.k_transit)
    return _first_up(swing, clear, arm, n.pick_tilt, parameters)


@njit(cache=True)
def palm_drop(R: Array, upright: float) -> float:
    """Length [m] by which the edge of the palm is lower than in a hand tilted by ``upright`` [rad]."""
    return PALM[0] * math.sin(max(tilt_of(R) - upright, 0.0))


@njit(cache=True)
def _stow_rotation(p: Array, mount: Array, parameters: Numbers) -> Array:
    outward = _outward(mount, p)
    return tool_rotation(outward, parameters[0].stow_tilt, outward)


@njit(cache=True)
def _swing(
    swing: _Swing, rotation: Array, arm: Arm, planar: float, parameters: Numbers, velocity: Array, reference: Array
) -> None:
    """Fill in the velocity towards a point by radius, azimuth and height, relative to the moving base.

    ``planar`` 1: the hand turns with its azimuth, as the whole arm does about joint 1.
    """
    p, pose, twist, base_mount = arm.p, arm.pose, arm.expected, arm.base_mount
    n = parameters[0]
    radius, azimuth = _hand_polar(p, arm.q, pose, base_mount)
    radial = swing.gain * (swing.radius - radius) + swing.radius_rate
    turning = swing.azimuth_gain * (swing.azimuth - azimuth) + swing.azimuth_rate
    turning = min(max(turning, -n.hand_yaw_rate), n.hand_yaw_rate)
    speed = hypot(radial, radius * turning)
    scale = min(1.0, n.hand_speed / max(speed, 1e-9))
    radial, turning = scale * radial, scale * turning
    angle = azimuth + pose[2]
    c, s = math.cos(angle), math.sin(angle)
    across = radius * turning
    linear = carried_velocity(p, pose, twist)
    linear += np.array([c * radial - s * across, s * radial + c * across, 0.0])
    linear[2] = min(max(n.k_transit * (swing.z - p[2]), -n.vertical_speed), n.vertical_speed)
    angular = _turn(rotation, arm.R, parameters)
    angular[2] += planar * (twist[1] + turning)
    _fill(velocity, linear, angular)
    point = from_polar(swing.radius, swing.azimuth, swing.z, pose, base_mount)
    reference[0], reference[1], reference[2] = point[0], point[1], point[2]


@njit(cache=True)
def _transit_swing(arm: Arm, way: _Way, lowest: float, parameters: Numbers) -> _Swing:
    """Swing to the hover point: at a limited radius, in the direction that the target will have when it is in range.

    The hand turns towards it first and reaches out last: an arm stretched out early meets more obstacles, and a hand
    held up by one on its way out would slide along it, away from its target.
    """
    n, target, pose, mount = parameters[0], arm.target, arm.pose, arm.mount
    pick, place, distance = way.goal == _PICK, way.goal == _PLACE, way.distance
    remaining = way.time_to_range if math.isfinite(way.time_to_range) else n.patience
    radius, azimuth = polar(target, pose_at(remaining, pose, way.plan_times, way.plan_poses), arm.base_mount)
    gain = n.k_transit if remaining <= 0.0 else min(n.k_transit, n.ease / remaining)
    radius_rate, azimuth_rate = 0.0, 0.0
    if remaining <= 0.0:
        radius_rate, azimuth_rate = _apparent_motion(target, pose, arm.expected, radius, azimuth)
    over = n.transit_clearance
    if distance < n.sink_distance:
        over = n.hover_height if pick else 0.0
    elif place:
        over = n.rim_clearance
    z = target[2] + over
    if place and distance >= n.sink_distance:
        z = max(z, lowest)  # clears objects beside the pick place, so that none is swept off the table
    z = max(z, way.top_between + n.transit_clearance, way.over_objects)
    hover = reach_radius(z - mount[2], _largest_tilt(place, parameters), n.stretch)
    if radius > hover:
        radius, radius_rate = hover, 0.0
    early = max(0.0, remaining - n.extension_lead) * n.vertical_speed
    if early > 0.0:
        radius_rate = n.vertical_speed if radius - early > n.swing_radius else 0.0
        radius = max(radius - early, n.swing_radius)
    now, heading = _hand_polar(arm.p, arm.q, pose, arm.base_mount)
    turned = (n.withdrawal_azimuth - abs(azimuth - heading)) / (n.withdrawal_azimuth - n.extension_azimuth)
    turned = min(max(turned, 0.0), 1.0)
    if radius > n.swing_radius and turned < 1.0:
        radius, radius_rate = n.swing_radius + turned * (radius - n.swing_radius), turned * radius_rate
    if arm.p[2] < z - 0.03 and now < n.foot_radius + 0.02:  # first up, then out
        radius, radius_rate = min(radius, n.foot_radius), 0.0
    elif early > 0.0 and radius < now:  # the edge of the palm clears objects, too
        z += palm_drop(arm.R, n.close_tilt)
    if arm.p[2] < way.top_between + 0.5 * n.transit_clearance:  # first up, then over furniture
        radius, radius_rate = min(radius, now), 0.0
    swing = _Swing(max(radius, n.swing_radius), azimuth, z, radius_rate, azimuth_rate, n.k_transit, gain)
    return _first_up(swing, z, arm, _largest_tilt(place, parameters), parameters)


@njit(cache=True)
def _first_up(swing: _Swing, level: float, arm: Arm, tilt: float, parameters: Numbers) -> _Swing:
    """The swing of a hand that is out and lower than ``level`` [m]: it rises before it goes on or back.

    If all is asked for at once, the arm falls short, and the hand loses height and tilt.
    """
    n, height = parameters[0], arm.p[2]
    now, heading = _hand_polar(arm.p, arm.q, arm.pose, arm.base_mount)
    if now < n.foot_radius + 0.02:
        return swing
    climb = min(max((level - 0.015 - height) / 0.03, 0.0), 1.0)
    upright = min(now, reach_radius(height - arm.mount[2], tilt, n.stretch))
    return _Swing(
        swing.radius + climb * (upright - swing.radius), swing.azimuth + climb * (heading - swing.azimuth), swing.z,
        (1.0 - climb) * swing.radius_rate, (1.0 - climb) * swing.azimuth_rate, swing.gain, swing.azimuth_gain,
    )  # fmt: skip


@njit(cache=True)
def _hand_polar(p: Array, q: Array, pose: Array, base_mount: Array) -> tuple[float, float]:
    """Radius and azimuth of the hand about the mount, the azimuth continuous with joint 1: it may pass half a turn.

    Joint 1 does not turn all round, so a hand that is there has to go back the way it came.
    """
    radius, azimuth = polar(p, pose, base_mount)
    return radius, q[0] + math.remainder(azimuth - q[0], 2.0 * math.pi)


@njit(cache=True)
def _apparent_motion(target: Array, pose: Array, twist: Array, radius: float, azimuth: float) -> tuple[float, float]:
    """Radial speed and azimuth rate of the standing target, as the moving base sees it."""
    away = -carried_velocity(target, pose, twist)
    angle = azimuth + pose[2]
    c, s = math.cos(angle), math.sin(angle)
    return c * away[0] + s * away[1], (c * away[1] - s * away[0]) / max(radius, 0.1)


@njit(cache=True)
def _turn(rotation: Array, R: Array, parameters: Numbers) -> Array:
    return capped(parameters[0].k_orientation * rotation_error(R, rotation), parameters[0].turning_rate)


@njit(cache=True)
def _planar_share(arm: Arm, time_to_range: float, parameters: Numbers) -> float:
    """1 as long as the arm should swing in one plane, 0 when the hand must be turned to the object."""
    n = parameters[0]
    soon = min(max((time_to_range - n.turn_by) / (n.yaw_time - n.turn_by), 0.0), 1.0)
    beside = abs(wrap_angle(_outward(arm.mount, arm.target) - _outward(arm.mount, arm.p)))
    return max(soon, min(max((beside - n.plane_azimuth) / n.plane_azimuth, 0.0), 1.0))


@njit(cache=True)
def _transit_rotation(arm: Arm, way: _Way, planar: float, parameters: Numbers) -> Array:
    """Hand rotation in transit: first in the arm's plane, finally as at the grasp; tilted so the camera sees ahead."""
    n, p, mount, pick = parameters[0], arm.p, arm.mount, way.goal == _PICK
    own, outward = _outward(mount, p), _outward(mount, arm.target)
    near = hypot(p[0] - mount[0], p[1] - mount[1])
    largest = _largest_tilt(way.goal == _PLACE, parameters)
    tilt = tilt_for(min(way.radius, n.pick_reach), p[2] - mount[2], n.stretch, largest)
    if pick:
        tilt = max(tilt, _look_tilt(arm, outward, parameters))
    tilt = min(tilt, n.stow_tilt + n.tilt_room * max(0.0, near - n.stow_radius))
    outward += planar * wrap_angle(own - outward)
    desired = way.yaw if pick and not math.isnan(way.yaw) else own
    return tool_rotation(desired + planar * wrap_angle(own - desired), tilt, outward)


@njit(cache=True)
def _largest_tilt(place: bool, parameters: Numbers) -> float:
    return parameters[0].place_tilt if place else parameters[0].pick_tilt


@njit(cache=True)
def _look_tilt(arm: Arm, outward: float, parameters: Numbers) -> float:
    """Tilt that brings the object into the view cone of the palm camera."""
    n, T, target = parameters[0], arm.T, arm.target
    eye = arm.p - norm(T[TCP, :3, 3] - T[HAND, :3, 3]) * arm.R[:, 2]
    ahead = (target[0] - eye[0]) * math.cos(outward) + (target[1] - eye[1]) * math.sin(outward)
    down = max(eye[2] - target[2], 0.05)
    return min(max(math.atan2(ahead, down) - n.look_cone, 0.0), n.look_tilt)


@njit(cache=True)
def _outward(mount: Array, point: Array) -> float:
    return math.atan2(point[1] - mount[1], point[0] - mount[0])
