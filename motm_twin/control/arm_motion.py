"""The velocity that the hand should have in each phase: reference, recomputed every step from where the hand is."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from motm_twin.control.arm_phases import grasp_point
from motm_twin.control.arm_reference import (
    capped,
    carried_velocity,
    from_polar,
    polar,
    pose_at,
    reach_radius,
    rotation_error,
    tilt_for,
    tool_rotation,
)
from motm_twin.control.arm_view import ManipulatorState, View
from motm_twin.control.parameters import ArmParameters, Numbers
from motm_twin.control.slate import Record, Slate
from motm_twin.control.types import ArmInputs
from motm_twin.model.exact import hypot, norm, wrap_angle
from motm_twin.model.geometry import Array
from motm_twin.model.kinematics import HAND, TCP

_HOME, _OUT, _FIXED = 0, 1, 2
_SWINGS = {"stow": _HOME, "carry": _HOME, "transit": _OUT}  # phases in which the hand swings about the mount
_ANCHORED = ("closing", "lift", "release")  # phases in which it keeps to a point chosen before
_EASE = 1.5  # a transit of T seconds goes at gain EASE / T: it begins briskly and arrives softly
_RADIAL, _VERTICAL, _ANGULAR = 0.9, 0.5, 3.0  # [m/s], [m/s], [rad/s] largest
_FOOT_RADIUS = 0.26  # [m] from the mount within which the hand is over the base
_FUNNEL = 2.5  # height above the grasp point per metre of horizontal error
_SURE = 0.004  # [m] of horizontal error that does not keep the hand up
_TILT_ROOM = 1.5  # [rad/m] of tilt that the arm, folded at the stow pose, gains when the hand moves out
_TURN_BY, _TURN_TIME = 0.3, 0.7  # [s] before arrival by which the hand is turned to the object, and for how long
_BESIDE = 0.5  # [rad] of azimuth from the target beyond which the arm swings in its own plane
_FAR = 0.8  # [m] no tilt for more radius than this before arrival
OVER_RIM = 0.04  # [m] that an object is carried higher than it is released
OVER = 0.15  # [m] horizontal distance within which a transit sinks to the hover height
_NEIGHBOURS = 0.6  # [m] from where an object was taken within which it is carried over the others
_HAND_CLEAR = 0.35  # [m] radius beyond which a retracting hand keeps its height


class Motion(NamedTuple):
    """Where the hand should be now. Its velocity towards it is on the slate."""

    reference: Array  # desired tool centre point, odometry frame [m], shape (3,)
    error: float  # [m] of the tool centre point from there


class _Swing(NamedTuple):
    """A point in polar coordinates about the mount, how it moves there, and how soon to be there."""

    radius: float
    azimuth: float
    z: float
    radius_rate: float
    azimuth_rate: float
    gain: float  # [1/s]
    azimuth_gain: float  # [1/s]


def hand_motion(
    state: ManipulatorState, view: View, inputs: ArmInputs, slate: Slate, parameters: ArmParameters
) -> Motion:
    """Reference and, on the slate, velocity of the hand for the phase of this step."""
    phase, goal = state.phase, view.goal.kind
    way = _SWINGS.get(phase, _FIXED)
    reference = _point(state, view, parameters) if way == _FIXED else np.empty(3)
    error = _fill_motion(
        slate.record, way, state.anchor if phase in _ANCHORED else view.target, inputs.plan_times, inputs.plan_poses,
        view.radius, view.azimuth, view.distance, view.time_to_range, goal == "none", goal == "pick", goal == "place",
        state.clear_z, state.anchor, math.nan if state.yaw is None or phase == "release" else state.yaw,
        parameters.hold_speed if phase == "closing" else _RADIAL, reference,
    )  # fmt: skip
    return Motion(reference, error)


@njit(cache=True)
def _fill_motion(
    slate: Record, way: int, over: Array, plan_times: Array, plan_poses: Array, radius: float, azimuth: float,
    distance: float, time_to_range: float, idle: bool, pick: bool, place: bool, clear_z: float, anchor: Array,
    yaw: float, fastest: float, reference: Array,
) -> float:  # fmt: skip
    """Fill in velocity and reference, return the error; ``way``: home, out to the target, or to the reference as it is.

    One kernel of all phases, so that none of them begins with a kernel that has to be loaded first.
    """
    s = slate[0]
    parameters = s.arm_numbers
    if way == _FIXED:
        _fixed(s.p, s.R, s.mount, reference, over, yaw, fastest, place, parameters, s.velocity)
        return norm(reference - s.p)
    if way == _HOME:
        planar, rotation = 1.0, _stow_rotation(s.p, s.mount, parameters)
        swing = _stowed(s.p, s.mount, azimuth, idle, clear_z, parameters)
    else:
        planar = _planar_share(s.p, s.mount, s.target, time_to_range)
        rotation = _transit_rotation(s.p, s.R, s.T, s.mount, s.target, radius, pick, place, yaw, planar, parameters)
        swing = _inbound(
            s.p, s.q, s.pose, s.twist, s.mount, s.base_mount, s.target, plan_times, plan_poses, distance,
            time_to_range, pick, place,
            clear_z if hypot(s.p[0] - anchor[0], s.p[1] - anchor[1]) < _NEIGHBOURS else -math.inf, parameters,
        )  # fmt: skip
    _swing(swing, rotation, s.p, s.q, s.R, s.pose, s.twist, s.base_mount, planar, parameters, s.velocity, reference)
    return norm(reference - s.p)


def _point(state: ManipulatorState, view: View, p: ArmParameters) -> Array:
    """The point in the odometry frame that the hand keeps to, shape (3,)."""
    if state.phase == "final":
        return _final_point(state, view, p)
    if state.phase == "retry":
        return view.target + np.array([0.0, 0.0, p.hover_height])
    point = state.anchor.copy()
    if state.phase == "lift":
        point[2] += p.lift_height
    return point


def _final_point(state: ManipulatorState, view: View, p: ArmParameters) -> Array:
    """The grasp point, or above it as long as the object is not below the fingers or not seen well enough.

    A hand that has waited for a sight of the object rises: from higher up the camera sees more of what is around.
    """
    point = grasp_point(view, p)
    seen = view.seen(p)
    if not seen or view.goal.position_sd > p.descend_sd:
        point[2] = view.target[2] + p.hover_height
        if not seen:
            waited = max(0.0, view.time - state.since - p.search_after)
            point[2] += min(p.search_rise, p.search_speed * waited)
        return point
    point[2] += min(max((view.distance - _SURE) * _FUNNEL, 0.0), p.hover_height)
    return point


@njit(cache=True)
def _fixed(
    p: Array, R: Array, mount: Array, point: Array, over: Array, yaw: float, fastest: float, place: bool,
    parameters: Numbers, velocity: Array,
) -> None:  # fmt: skip
    """Closed loop on a point that stands in the odometry frame; the hand is turned as ``over`` what it works at.

    Down over the object, tilted outwards where the reach needs it; ``yaw`` [rad] nan: it stays as the arm has it.
    """
    n = parameters[0]
    linear = capped(n.k_P * (point - p), fastest)
    linear[2] = min(max(linear[2], -_VERTICAL), _VERTICAL)
    outward = _outward(mount, over)
    radius = hypot(over[0] - mount[0], over[1] - mount[1])
    tilt = tilt_for(radius, p[2] - mount[2], n.grasp_stretch, _largest_tilt(place, parameters))
    rotation = tool_rotation(_outward(mount, p) if math.isnan(yaw) else yaw, tilt, outward)
    velocity[:3], velocity[3:] = linear, _turn(rotation, R, parameters)


@njit(cache=True)
def _stowed(p: Array, mount: Array, azimuth: float, idle: bool, clear_z: float, parameters: Numbers) -> _Swing:
    """Gripper, object and elbow inside the footprint, turned a little towards the target, unless there is none."""
    n = parameters[0]
    azimuth = 0.0 if idle else min(max(azimuth, -n.stow_azimuth), n.stow_azimuth)
    z = mount[2] + n.stow_height
    if hypot(p[0] - mount[0], p[1] - mount[1]) > _HAND_CLEAR:
        z = max(z, clear_z)
    return _Swing(n.stow_radius, azimuth, z, 0.0, 0.0, n.k_transit, n.k_transit)


@njit(cache=True)
def _stow_rotation(p: Array, mount: Array, parameters: Numbers) -> Array:
    outward = _outward(mount, p)
    return tool_rotation(outward, parameters[0].stow_tilt, outward)


@njit(cache=True)
def _swing(
    swing: _Swing, rotation: Array, p: Array, q: Array, R: Array, pose: Array, twist: Array, base_mount: Array,
    planar: float, parameters: Numbers, velocity: Array, reference: Array,
) -> None:  # fmt: skip
    """Towards a point by radius, azimuth and height, relative to the moving base.

    ``planar`` 1: the hand turns with its azimuth, as the whole arm does about joint 1.
    """
    n = parameters[0]
    radius, azimuth = _hand_polar(p, q, pose, base_mount)
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
    linear[2] = min(max(n.k_transit * (swing.z - p[2]), -_VERTICAL), _VERTICAL)
    angular = _turn(rotation, R, parameters)
    angular[2] += planar * (twist[1] + turning)
    velocity[:3], velocity[3:] = linear, angular
    reference[:] = from_polar(swing.radius, swing.azimuth, swing.z, pose, base_mount)


@njit(cache=True)
def _inbound(
    p: Array, q: Array, pose: Array, twist: Array, mount: Array, base_mount: Array, target: Array, plan_times: Array,
    plan_poses: Array, distance: float, time_to_range: float, pick: bool, place: bool, lowest: float,
    parameters: Numbers,
) -> _Swing:  # fmt: skip
    """The hover point, at the limited radius on the line from the mount, where the base will be on arrival.

    The hand turns towards it first and reaches out last: an arm stretched out early meets more obstacles, and a hand
    held up by one on its way out would slide along it, away from its target.
    """
    n = parameters[0]
    remaining = time_to_range if math.isfinite(time_to_range) else n.abandon_time
    radius, azimuth = polar(target, pose_at(remaining, pose, plan_times, plan_poses), base_mount)
    gain = n.k_transit if remaining <= 0.0 else min(n.k_transit, _EASE / remaining)
    radius_rate, azimuth_rate = 0.0, 0.0
    if remaining <= 0.0:
        radius_rate, azimuth_rate = _apparent_motion(target, pose, twist, radius, azimuth)
    over = n.transit_clearance
    if distance < OVER:
        over = n.hover_height if pick else 0.0
    elif place:
        over = OVER_RIM
    z = target[2] + over
    if place and distance >= OVER:
        z = max(z, lowest)  # what stands beside where the object was taken from is not swept off the table
    hover = reach_radius(z - mount[2], _largest_tilt(place, parameters), n.hover_stretch)
    if radius > hover:
        radius, radius_rate = hover, 0.0
    early = max(0.0, remaining - n.extension_lead) * n.extension_speed
    if early > 0.0:
        radius_rate = n.extension_speed if radius - early > n.swing_radius else 0.0
        radius = max(radius - early, n.swing_radius)
    now, heading = _hand_polar(p, q, pose, base_mount)
    turned = (n.withdrawal_azimuth - abs(azimuth - heading)) / (n.withdrawal_azimuth - n.extension_azimuth)
    turned = min(max(turned, 0.0), 1.0)
    if radius > n.swing_radius and turned < 1.0:
        radius, radius_rate = n.swing_radius + turned * (radius - n.swing_radius), turned * radius_rate
    if p[2] < z - 0.03 and now < _FOOT_RADIUS + 0.02:  # first up, then out
        radius, radius_rate = min(radius, _FOOT_RADIUS), 0.0
    return _Swing(max(radius, n.swing_radius), azimuth, z, radius_rate, azimuth_rate, n.k_transit, gain)


@njit(cache=True)
def _hand_polar(p: Array, q: Array, pose: Array, base_mount: Array) -> tuple[float, float]:
    """Radius and azimuth of the hand about the mount, the azimuth counted on from joint 1: it may pass half a turn.

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
    return capped(parameters[0].k_orientation * rotation_error(R, rotation), _ANGULAR)


@njit(cache=True)
def _planar_share(p: Array, mount: Array, target: Array, time_to_range: float) -> float:
    """1 as long as the arm should swing in one plane, 0 when the hand must be turned to the object."""
    soon = min(max((time_to_range - _TURN_BY) / _TURN_TIME, 0.0), 1.0)
    beside = abs(wrap_angle(_outward(mount, target) - _outward(mount, p)))
    return max(soon, min(max((beside - _BESIDE) / _BESIDE, 0.0), 1.0))


@njit(cache=True)
def _transit_rotation(
    p: Array, R: Array, T: Array, mount: Array, target: Array, radius: float, pick: bool, place: bool, yaw: float,
    planar: float, parameters: Numbers,
) -> Array:  # fmt: skip
    """In the arm's own plane at first, at last as over the object; tilted so that the camera looks ahead for it."""
    n = parameters[0]
    own, outward = _outward(mount, p), _outward(mount, target)
    near = hypot(p[0] - mount[0], p[1] - mount[1])
    tilt = tilt_for(min(radius, _FAR), p[2] - mount[2], n.grasp_stretch, _largest_tilt(place, parameters))
    if pick:
        tilt = max(tilt, _look_tilt(p, R, T, target, outward, parameters))
    tilt = min(tilt, n.stow_tilt + _TILT_ROOM * max(0.0, near - n.stow_radius))
    outward += planar * wrap_angle(own - outward)
    wanted = yaw if pick and not math.isnan(yaw) else own
    return tool_rotation(wanted + planar * wrap_angle(own - wanted), tilt, outward)


@njit(cache=True)
def _largest_tilt(place: bool, parameters: Numbers) -> float:
    return parameters[0].place_tilt if place else parameters[0].pick_tilt


@njit(cache=True)
def _look_tilt(p: Array, R: Array, T: Array, target: Array, outward: float, parameters: Numbers) -> float:
    """Tilt that brings the object into the view cone of the palm camera."""
    n = parameters[0]
    eye = p - norm(T[TCP, :3, 3] - T[HAND, :3, 3]) * R[:, 2]
    ahead = (target[0] - eye[0]) * math.cos(outward) + (target[1] - eye[1]) * math.sin(outward)
    down = max(eye[2] - target[2], 0.05)
    return min(max(math.atan2(ahead, down) - n.look_cone, 0.0), n.look_tilt)


@njit(cache=True)
def _outward(mount: Array, point: Array) -> float:
    return math.atan2(point[1] - mount[1], point[0] - mount[0])
