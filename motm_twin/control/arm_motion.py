"""The velocity that the hand should have in each phase: reference, recomputed every step from where the hand is."""

import math
from dataclasses import dataclass

import numpy as np

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
from motm_twin.control.parameters import ArmParameters
from motm_twin.control.types import ArmInputs
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.kinematics import HAND, TCP

_EASE = 1.5  # a transit of T seconds goes at gain EASE / T: it begins briskly and arrives softly
_RADIAL, _VERTICAL, _ANGULAR = 0.9, 0.5, 3.0  # [m/s], [m/s], [rad/s] largest
_FOOT_RADIUS = 0.26  # [m] from the mount within which the hand is over the base
_FUNNEL = 2.5  # height above the grasp point per metre of horizontal error
_SURE = 0.004  # [m] of horizontal error that does not keep the hand up
_TILT_ROOM = 1.5  # [rad/m] of tilt that the arm, folded at the stow pose, gains when the hand moves out
_TURN_BY, _TURN_TIME = 0.3, 0.7  # [s] before arrival by which the hand is turned to the object, and for how long
_BESIDE = 0.5  # [rad] of azimuth from the target beyond which the arm swings in its own plane
_FAR = 0.8  # [m] no tilt for more radius than this before arrival
_OVER = 0.15  # [m] horizontal distance within which a transit sinks to the hover height
_HAND_CLEAR = 0.35  # [m] radius beyond which a retracting hand keeps its height


@dataclass(frozen=True)
class Motion:
    """What the hand should do now."""

    velocity: Array  # nu: linear [m/s], angular [rad/s], odometry frame, shape (6,)
    reference: Array  # desired tool centre point, shape (3,)


@dataclass(frozen=True)
class _Swing:
    """A point in polar coordinates about the mount, how it moves there, and how soon to be there."""

    radius: float
    azimuth: float
    z: float
    radius_rate: float = 0.0
    azimuth_rate: float = 0.0
    gain: float = 8.0  # [1/s]
    azimuth_gain: float = 8.0  # [1/s]


def hand_motion(state: ManipulatorState, view: View, inputs: ArmInputs, mount: Array, p: ArmParameters) -> Motion:
    """Reference and velocity of the hand for the phase of this step; ``mount`` [m] in the base frame."""
    if state.phase in ("stow", "carry"):
        return _swing(_stowed(state, view, p), _stow_rotation(view, p), view, mount, p, planar=1.0)
    if state.phase == "transit":
        planar = _planar_share(view)
        rotation = _transit_rotation(state, view, p, planar)
        return _swing(_inbound(state, view, inputs, mount, p), rotation, view, mount, p, planar=planar)
    rotation = _rotation(state, view, p)
    if state.phase == "final":
        return _fixed(_final_point(state, view, p), rotation, view, p)
    if state.phase == "retry":
        return _fixed(view.target + np.array([0.0, 0.0, p.hover_height]), rotation, view, p)
    point = state.anchor.copy()
    if state.phase == "lift":
        point[2] += p.lift_height
    return _fixed(point, rotation, view, p, fastest=p.hold_speed if state.phase == "closing" else _RADIAL)


def _fixed(point: Array, rotation: Array, view: View, p: ArmParameters, *, fastest: float = _RADIAL) -> Motion:
    """Closed loop on a point that stands in the odometry frame."""
    linear = capped(p.k_P * (point - view.p), fastest)
    linear[2] = min(max(linear[2], -_VERTICAL), _VERTICAL)
    return Motion(np.concatenate([linear, _turn(rotation, view, p)]), point)


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


def _swing(swing: _Swing, rotation: Array, view: View, mount: Array, p: ArmParameters, *, planar: float) -> Motion:
    """Towards a point by radius, azimuth and height, relative to the moving base.

    ``planar`` 1: the hand turns with its azimuth, as the whole arm does about joint 1.
    """
    radius, azimuth = _hand_polar(view, mount)
    radial = swing.gain * (swing.radius - radius) + swing.radius_rate
    turning = swing.azimuth_gain * (swing.azimuth - azimuth) + swing.azimuth_rate
    turning = min(max(turning, -p.hand_yaw_rate), p.hand_yaw_rate)
    speed = math.hypot(radial, radius * turning)
    scale = min(1.0, p.hand_speed / max(speed, 1e-9))
    radial, turning = scale * radial, scale * turning
    angle = azimuth + view.pose[2]
    c, s = math.cos(angle), math.sin(angle)
    across = radius * turning
    linear = carried_velocity(view.p, view.pose, view.twist)
    linear += np.array([c * radial - s * across, s * radial + c * across, 0.0])
    linear[2] = min(max(p.k_transit * (swing.z - view.p[2]), -_VERTICAL), _VERTICAL)
    angular = _turn(rotation, view, p)
    angular[2] += planar * (view.twist[1] + turning)
    return Motion(np.concatenate([linear, angular]), from_polar(swing.radius, swing.azimuth, swing.z, view.pose, mount))


def _stowed(state: ManipulatorState, view: View, p: ArmParameters) -> _Swing:
    """Gripper, object and elbow inside the footprint, turned a little towards the target."""
    azimuth = 0.0 if view.goal.kind == "none" else min(max(view.azimuth, -p.stow_azimuth), p.stow_azimuth)
    z = view.mount[2] + p.stow_height
    if math.hypot(view.p[0] - view.mount[0], view.p[1] - view.mount[1]) > _HAND_CLEAR:
        z = max(z, state.clear_z)
    return _Swing(p.stow_radius, azimuth, z, gain=p.k_transit, azimuth_gain=p.k_transit)


def _inbound(state: ManipulatorState, view: View, inputs: ArmInputs, mount: Array, p: ArmParameters) -> _Swing:
    """The hover point, at the limited radius on the line from the mount, where the base will be on arrival.

    The hand turns towards it first and reaches out last: an arm stretched out early meets more obstacles, and a hand
    held up by one on its way out would slide along it, away from its target.
    """
    remaining = view.time_to_range if math.isfinite(view.time_to_range) else p.abandon_time
    pose = pose_at(remaining, view.pose, inputs.plan_times, inputs.plan_poses)
    radius, azimuth = polar(view.target, pose, mount)
    gain = p.k_transit if remaining <= 0.0 else min(p.k_transit, _EASE / remaining)
    radius_rate, azimuth_rate = _apparent_motion(view, radius, azimuth) if remaining <= 0.0 else (0.0, 0.0)
    over = p.transit_clearance
    if view.distance < _OVER:
        over = p.hover_height if view.goal.kind == "pick" else 0.0
    elif view.goal.kind == "place":
        over = 0.04
    z = view.target[2] + over
    hover = reach_radius(z - view.mount[2], _largest_tilt(view, p), p.hover_stretch)
    if radius > hover:
        radius, radius_rate = hover, 0.0
    early = max(0.0, remaining - p.extension_lead) * p.extension_speed
    if early > 0.0:
        radius, radius_rate = (
            max(radius - early, p.swing_radius),
            p.extension_speed if radius - early > p.swing_radius else 0.0,
        )
    now, heading = _hand_polar(view, mount)
    turned = (p.withdrawal_azimuth - abs(azimuth - heading)) / (p.withdrawal_azimuth - p.extension_azimuth)
    turned = min(max(turned, 0.0), 1.0)
    if radius > p.swing_radius and turned < 1.0:
        radius, radius_rate = p.swing_radius + turned * (radius - p.swing_radius), turned * radius_rate
    if view.p[2] < z - 0.03 and now < _FOOT_RADIUS + 0.02:  # first up, then out
        radius, radius_rate = min(radius, _FOOT_RADIUS), 0.0
    return _Swing(max(radius, p.swing_radius), azimuth, z, radius_rate, azimuth_rate, p.k_transit, gain)


def _hand_polar(view: View, mount: Array) -> tuple[float, float]:
    """Radius and azimuth of the hand about the mount, the azimuth counted on from joint 1: it may pass half a turn.

    Joint 1 does not turn all round, so a hand that is there has to go back the way it came.
    """
    radius, azimuth = polar(view.p, view.pose, mount)
    return radius, float(view.q[0]) + math.remainder(azimuth - float(view.q[0]), 2.0 * math.pi)


def _apparent_motion(view: View, radius: float, azimuth: float) -> tuple[float, float]:
    """Radial speed and azimuth rate of the standing target, as the moving base sees it."""
    away = -carried_velocity(view.target, view.pose, view.twist)
    angle = azimuth + view.pose[2]
    c, s = math.cos(angle), math.sin(angle)
    return c * away[0] + s * away[1], (c * away[1] - s * away[0]) / max(radius, 0.1)


def _turn(rotation: Array, view: View, p: ArmParameters) -> Array:
    return capped(p.k_orientation * rotation_error(view.R, rotation), _ANGULAR)


def _stow_rotation(view: View, p: ArmParameters) -> Array:
    outward = _outward(view, view.p)
    return tool_rotation(outward, p.stow_tilt, outward)


def _planar_share(view: View) -> float:
    """1 as long as the arm should swing in one plane, 0 when the hand must be turned to the object."""
    soon = min(max((view.time_to_range - _TURN_BY) / _TURN_TIME, 0.0), 1.0)
    beside = abs(wrap_angle(_outward(view, view.target) - _outward(view, view.p)))
    return max(soon, min(max((beside - _BESIDE) / _BESIDE, 0.0), 1.0))


def _transit_rotation(state: ManipulatorState, view: View, p: ArmParameters, planar: float) -> Array:
    """In the arm's own plane at first, at last as over the object; tilted so that the camera looks ahead for it."""
    own, outward = _outward(view, view.p), _outward(view, view.target)
    near = math.hypot(view.p[0] - view.mount[0], view.p[1] - view.mount[1])
    tilt = tilt_for(min(view.radius, _FAR), view.p[2] - view.mount[2], p.grasp_stretch, _largest_tilt(view, p))
    if view.goal.kind == "pick":
        tilt = max(tilt, _look_tilt(view, outward, p))
    tilt = min(tilt, p.stow_tilt + _TILT_ROOM * max(0.0, near - p.stow_radius))
    outward += planar * wrap_angle(own - outward)
    wanted = state.yaw if state.yaw is not None and view.goal.kind == "pick" else own
    return tool_rotation(wanted + planar * wrap_angle(own - wanted), tilt, outward)


def _rotation(state: ManipulatorState, view: View, p: ArmParameters) -> Array:
    """Down over the object, tilted outwards where the reach needs it."""
    point = view.target if state.phase in ("final", "retry") else state.anchor
    outward = _outward(view, point)
    radius = math.hypot(point[0] - view.mount[0], point[1] - view.mount[1])
    tilt = tilt_for(radius, view.p[2] - view.mount[2], p.grasp_stretch, _largest_tilt(view, p))
    yaw = state.yaw if state.yaw is not None and state.phase != "release" else _outward(view, view.p)
    return tool_rotation(yaw, tilt, outward)


def _largest_tilt(view: View, p: ArmParameters) -> float:
    return p.place_tilt if view.goal.kind == "place" else p.pick_tilt


def _look_tilt(view: View, outward: float, p: ArmParameters) -> float:
    """Tilt that brings the object into the view cone of the palm camera."""
    eye = view.p - float(np.linalg.norm(view.T[TCP, :3, 3] - view.T[HAND, :3, 3])) * view.R[:, 2]
    ahead = (view.target[0] - eye[0]) * math.cos(outward) + (view.target[1] - eye[1]) * math.sin(outward)
    down = max(eye[2] - view.target[2], 0.05)
    return min(max(math.atan2(ahead, down) - p.look_cone, 0.0), p.look_tilt)


def _outward(view: View, point: Array) -> float:
    return math.atan2(point[1] - view.mount[1], point[0] - view.mount[0])
