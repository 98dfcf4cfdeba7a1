"""Every number of the arm side, with its symbol, unit and source."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.joint_limits import WRIST_MIN

DEG = math.pi / 180.0
Numbers = NDArray[np.void]  # one record of what `numbers` gives: a kernel reads `p[0].k_P`, and has one argument of it


def numbers(parameters: msgspec.Struct) -> Numbers:
    """The numbers and switches of parameters by their names, as a record that kernels can read, shape (1,)."""
    values = {name: getattr(parameters, name) for name in parameters.__struct_fields__}
    values = {name: value for name, value in values.items() if isinstance(value, (bool, int, float))}
    fields = [(name, np.int64 if isinstance(value, int) else np.float64) for name, value in values.items()]
    record = np.array([tuple(values.values())], dtype=fields)
    record.setflags(write=False)
    return record


class QpParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Weights and bounds of the redundancy-resolution QP."""

    solver: str = "daqp"  # daqp | osqp (eps 1e-5, polishing: the paper's solver, for comparison)
    base_weight: float = 1.0e5  # deviation from v_B: the base obeys its planner
    rate_weight: float = 0.01  # k_a, arm rates (MotM)
    twist_rate_weight: float = 0.3  # of joints 3 and 5: the other five reach every pose of a hand that points down
    swing_twist_rate_weight: float = 5.0  # rather slower than twisted
    linear_slack_weight: float = 1.0e3
    tilt_slack_weight: float = 3.0  # angular slack is far cheaper than linear: tilt keeps the object in reach
    yaw_slack_weight: float = 30.0
    swing_linear_slack_weight: float = 100.0  # on the way nothing must be met exactly: rather slower than tilted
    swing_tilt_slack_weight: float = 30.0
    swing_yaw_slack_weight: float = 5.0
    elbow_limit: float = -0.52  # [rad] joint 4: beyond -0.467 the elbow would bend the other way and lock
    wrist_limit: float = WRIST_MIN  # [rad] joint 6
    posture_gain: float = 2.0  # [1/s] of joints 1, 3 and 5 to an arm in one plane, through the hand's azimuth
    swing_posture_gain: float = 8.0  # [1/s] the same while swinging: the elbow stays over the base
    posture_rate: float = 0.5  # [rad/s] largest of it, so that the hand stands still on the object
    swing_posture_rate: float = 2.0  # [rad/s]
    free_weight: float = 0.01  # of the hand's velocity when the arm returns to the stow pose by its joints
    free_gain: float = 1.5  # [1/s] of that return
    manipulability_weight: float = 0.005  # of the gradient of m; more twists the arm out of its plane
    elastic_weight: float = 1.0e4  # obstacle rows give way rather than leave no answer, and only then
    damper_gain: float = 2.2  # eta [rad/s], joint-limit damper
    damper_start: float = 0.25  # rho_i [rad]
    damper_stop: float = 0.02  # rho_s [rad]
    residual: float = 1.0e-5  # largest accepted violation of any row
    stop_time: float = 0.05  # [s] of the damped stop: one control period


class AvoidanceParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Speed limits towards obstacles: `xi (d - d_s) / (d_i - d_s)`."""

    enabled: bool = True
    xi: float = 0.6  # [m/s], Paper, Sec. V
    d_s: float = 0.25  # [m], Paper, Sec. V
    d_i: float = 0.6  # [m], Paper, Sec. V
    lead: float = 0.5  # [m] by which the line goes on beyond d_i: no hand brakes from 1 m/s at once
    moving_margin: float = 0.035  # [m] that a moving one may be nearer than the middle of its cell: half its diagonal
    static_margin: float = 0.05  # [m] a static obstacle's d_s is the target's distance to it less this, at most d_s
    sectors: int = 12  # directions round the gripper, each limited by its nearest static point
    moving_sectors: int = 36  # the same of moving ones: the row of a point 10 deg aside lets a passing hand come near
    link_d_s: float = 0.05  # [m] elbow, forearm and wrist from a moving obstacle: beyond the paper, which has one point
    link_d_i: float = 0.35  # [m]
    static_link_d_s: float = 0.02  # [m] the same from a static one: the arm stays on its side of it
    static_link_d_i: float = 0.12  # [m]
    furniture_d_s: float = 0.02  # [m] mapped furniture at its true height, whole arm
    swing_d_s: float = 0.035  # [m] the same on the way: localisation may be off by more than 0.02 m
    furniture_d_i: float = 0.12  # [m]
    furniture_lead: float = 0.1  # [m] by which the line goes on beyond d_i: a hand at 1 m/s does not brake at once
    fingers_d_s: float = 0.006  # [m] fingers over the surface that carries the object
    fingers_d_i: float = 0.05  # [m]
    blind: float = 0.15  # [s] over a link: what is left alone acts on, and then its joints come to rest, in such a time


class ArmParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Arm reference, grasp and release."""

    k_A: float = 0.5  # MotM transit rule: duration = distance / (v_B k_A)
    transit_base_speed: float = 0.5  # [m/s] v_B of the rule is at least this: a turning base soon drives again
    hand_speed: float = 0.9  # [m/s] of the hand relative to the base in transit
    hand_yaw_rate: float = 1.8  # [rad/s] of the hand about the mount
    k_P: float = 12.0  # [1/s] final approach
    swing_radius: float = 0.25  # [m] from the mount at which the hand swings before it is stretched out
    extension_lead: float = 0.4  # [s] before arrival at which the hand is stretched out to the hover point
    extension_speed: float = 0.5  # [m/s] at which it is stretched out
    extension_azimuth: float = 0.3  # [rad] of azimuth error up to which it may be stretched out fully
    withdrawal_azimuth: float = 0.55  # [rad] from which on it is not stretched out at all
    k_transit: float = 8.0  # [1/s] largest gain in transit
    k_orientation: float = 6.0  # [1/s]
    approach_distance: float = 0.10  # [m] d_T, the final approach begins (MotM)
    hover_height: float = 0.06  # [m] of the tool centre point above the centre of the object
    transit_clearance: float = 0.08  # [m] the same while swinging
    hover_stretch: float = 0.69  # [m] joint 6 from the shoulder while waiting for the object; 0.719 is a straight elbow
    grasp_stretch: float = 0.69  # [m] beyond which the tool tilts
    pick_reach: float = 0.80  # [m] from the mount at which a grasp begins (tilt up to pick_tilt)
    place_reach: float = 0.84  # [m] the same for a release
    reach_slack: float = 0.05  # [m] beyond that before it is broken off
    pick_tilt: float = 16.0 * DEG  # largest outwards
    place_tilt: float = 25.0 * DEG
    look_tilt: float = 30.0 * DEG  # largest in transit, so that the palm camera sees the object early
    look_cone: float = 30.0 * DEG  # the object is kept this near to the optical axis
    close_error: float = 0.005  # [m] at which the gripper closes
    close_speed: float = 0.025  # [m/s] of the hand over the object at which it closes
    hold_speed: float = 0.012  # [m/s] of corrections while it closes: the grasp rule allows 0.03 m/s
    close_yaw: float = 8.0 * DEG
    close_tilt: float = 20.0 * DEG
    seen_within: float = 0.5  # [s] nothing is grasped that was not seen this recently
    sure_age: float = 0.1  # [s] nothing is gripped or let go on what the robot said longer ago
    close_sd: float = 0.008  # [m] position uncertainty at which the gripper may close
    descend_sd: float = 0.012  # [m] and at which it may descend
    search_after: float = 1.0  # [s] without a sight of the object after which the hand rises to see more
    search_rise: float = 0.25  # [m]
    search_speed: float = 0.15  # [m/s]
    settle_time: float = 0.34  # [s] measured: hover to error < 5 mm
    held_tolerance: float = 0.004  # [m] finger width below side by this: nothing is held
    tip_length: float = 0.009  # [m] of the fingers beyond the tool centre point
    tip_thickness: float = 0.017  # [m] of a finger behind its pad
    tip_half_depth: float = 0.0105  # [m] across
    tip_clearance: float = 0.006  # [m] over the supporting surface
    highest_grasp: float = 0.008  # [m] above the centre of the object, when tilted finger tips need it
    lift_time: float = 0.15  # [s] until the object is clear of its support
    lift_height: float = 0.10  # [m]
    picked_height: float = 0.03  # [m] the next target may come from here on
    release_height: float = 0.055  # [m] of the object's centre above the rim
    place_settle_time: float = 0.3  # [s] from the edge of reach to the release
    release_margin: float = 0.035  # [m] kept inside the release square
    release_speed: float = 0.25  # [m/s] of the hand in the world
    stow_radius: float = 0.12  # [m] from the mount
    stow_height: float = 0.50  # [m] above the mount
    stow_azimuth: float = 0.45  # [rad] largest turn towards the target while stowed: elbow inside the footprint
    stow_tilt: float = 15.0 * DEG
    stuck_time: float = 3.0  # [s] on the way to the stow pose after which the arm returns by its joints
    patience: float = 6.0  # [s] with the target in range and nothing achieved before the arm starts over
    abandon_time: float = 6.0  # [s] time to range beyond which a transit is given up for the stow pose
    qp: QpParameters = QpParameters()
    avoidance: AvoidanceParameters = AvoidanceParameters()
