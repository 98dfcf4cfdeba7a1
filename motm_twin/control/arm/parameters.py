"""Every number of the arm side, with its symbol, unit and source."""

from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.number import MOTM, OWN, ROBOT, Number, Slider, paper
from motm_twin.model.profile import DEG

Numbers = NDArray[np.void]  # one record, from `numbers`: a single argument, of which a kernel reads `p[0].k_P`


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

    solver: Annotated[str, Number("", OWN, "daqp, or osqp (eps 1e-5, polishing), which the paper uses")] = "daqp"
    base_weight: Annotated[float, Number("", OWN, "deviation from v_B: the base obeys its planner")] = 1.0e5
    rate_weight: Annotated[float, Number("", MOTM, "of the rates of the arm", symbol="k_a")] = 0.01
    twist_rate_weight: Annotated[
        float, Number("", OWN, "of joints 3 and 5: the other five reach every pose of a hand that points down")
    ] = 0.3
    swing_twist_rate_weight: Annotated[float, Number("", OWN, "rather slower than twisted")] = 5.0
    linear_slack_weight: Annotated[float, Number("", OWN, "of the position of the hand")] = 1.0e3
    tilt_slack_weight: Annotated[
        float, Number("", OWN, "far cheaper than linear slack: tilt keeps the object in reach")
    ] = 3.0
    yaw_slack_weight: Annotated[float, Number("", OWN, "of its turn about the vertical")] = 30.0
    swing_linear_slack_weight: Annotated[
        float, Number("", OWN, "on the way nothing must be met exactly: rather slower than tilted")
    ] = 100.0
    swing_tilt_slack_weight: Annotated[float, Number("", OWN, "as tilt_slack_weight, while swinging")] = 30.0
    swing_yaw_slack_weight: Annotated[float, Number("", OWN, "as yaw_slack_weight, while swinging")] = 5.0
    elbow_limit: Annotated[
        float, Number("rad", OWN, "joint 4: beyond -0.467 the elbow would bend the other way and lock")
    ] = -0.52
    posture_gain: Annotated[
        float, Number("1/s", OWN, "of joints 1, 3 and 5 to an arm in one plane, through the hand's azimuth")
    ] = 2.0
    swing_posture: Annotated[float, Number("", OWN, "times that gain and rate while swinging: elbow over the base")] = (
        4.0
    )
    posture_rate: Annotated[
        float, Number("rad/s", OWN, "largest of it, so that the hand stands still on the object")
    ] = 0.5
    free_weight: Annotated[
        float, Number("", OWN, "of the hand's velocity when the arm returns to the stow pose by its joints")
    ] = 0.01
    free_gain: Annotated[float, Number("1/s", OWN, "of that return")] = 1.5
    manipulability_weight: Annotated[
        float, Number("", OWN, "of the gradient of m; more twists the arm out of its plane")
    ] = 0.005
    elastic_weight: Annotated[
        float, Number("", OWN, "obstacle rows give way rather than leave no answer, and only then")
    ] = 1.0e4
    damper_gain: Annotated[float, Number("rad/s", OWN, "of the joint-limit damper", symbol="eta")] = 2.2
    damper_start: Annotated[
        float, Number("rad", OWN, "from a limit, at which a joint begins to slow", symbol="rho_i")
    ] = 0.25
    damper_stop: Annotated[float, Number("rad", OWN, "from a limit, at which it stands", symbol="rho_s")] = 0.02
    residual: Annotated[float, Number("", OWN, "largest accepted violation of any row")] = 1.0e-5
    gives_way: Annotated[float, Number("m/s", OWN, "by which rows of furniture give way before that is a fault")] = 0.02


class AvoidanceParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Speed limits towards obstacles: `xi (d - d_s) / (d_i - d_s)`."""

    enabled: Annotated[bool, Number("", paper("V"), "the gripper slows towards what the lidar sees outside the map"),
        Slider("Arm avoidance", "Obstacle avoidance",
            "Limits the gripper's speed towards obstacles that the lidar sees and the map does not have.", paper=True,
            name="arm_avoidance")] = True  # fmt: skip
    xi: Annotated[float, Number("m/s", paper("V"), "speed that is allowed at d_i", symbol="xi"),
        Slider("Approach speed", "Obstacle avoidance", "Speed allowed towards an obstacle at the distance d_i.",
            (0.1, 1.5, 0.05), paper=0.6)] = 0.6  # fmt: skip
    d_s: Annotated[float, Number("m", paper("V"), "no nearer than this", symbol="d_s"),
        Slider("Stop distance", "Obstacle avoidance", "The gripper comes no nearer to an obstacle than this.",
            (0.05, 0.35, 0.01), paper=0.25)] = 0.25  # fmt: skip
    d_i: Annotated[float, Number("m", paper("V"), "from here on", symbol="d_i"),
        Slider("Influence distance", "Obstacle avoidance",
            "Obstacles farther from the gripper than this do not slow it.", (0.4, 1.2, 0.05),
            paper=0.6)] = 0.6  # fmt: skip
    prediction: Annotated[float,
        Number("s", OWN, "the arm also keeps from where moving ones will be: one that comes nearer is left sooner"),
        Slider("Prediction for the arm", "Obstacle avoidance",
            "The arm also keeps away from where moving obstacles will be after this time.", (0.0, 1.0, 0.1),
            paper=0.0, name="arm_prediction")] = 0.0  # fmt: skip
    lead: Annotated[
        float, Number("m", OWN, "by which the line goes on beyond d_i: no hand brakes from 1 m/s at once")
    ] = 0.5
    moving_margin: Annotated[
        float, Number("m", OWN, "that a moving one may be nearer than the middle of its cell: half its diagonal")
    ] = 0.035
    static_margin: Annotated[
        float, Number("m", OWN, "a static obstacle's d_s is the target's distance to it less this, at most d_s")
    ] = 0.05
    sectors: Annotated[
        int, Number("", OWN, "directions round the gripper, each limited by its nearest static point")
    ] = 12
    moving_sectors: Annotated[
        int, Number("", OWN, "the same of moving ones: the row of a point 10 deg aside lets a passing hand come near")
    ] = 36
    link_d_s: Annotated[float,
        Number("m", OWN, "elbow, forearm and wrist from a moving obstacle: beyond the paper, which has one point"),
        Slider("Stop distance of the links", "Obstacle avoidance",
            "Distance that elbow, forearm and wrist keep from moving obstacles; the paper limits only the gripper.",
            (0.02, 0.15, 0.01))] = 0.05  # fmt: skip
    link_d_i: Annotated[float, Number("m", OWN, "from which on a link is slowed")] = 0.35
    furniture_d_s: Annotated[float, Number("m", OWN, "from furniture, and 2 sd of the robot's place on the map"),
        Slider("Clearance of the arm", "Safety",
            "Distance that the whole arm keeps from mapped furniture, except for the fingers at a grasp.",
            (0.004, 0.04, 0.004))] = 0.008  # fmt: skip
    furniture_d_i: Annotated[float, Number("m", OWN, "from which on the arm is slowed")] = 0.12
    furniture_lead: Annotated[
        float, Number("m", OWN, "by which the line goes on beyond d_i: a hand at 1 m/s does not brake at once")
    ] = 0.1
    fingers_d_s: Annotated[float, Number("m", OWN, "fingers over the surface that carries the object")] = 0.006
    fingers_d_i: Annotated[float, Number("m", OWN, "the same of the fingers")] = 0.05
    objects_kept: Annotated[
        float, Number("m", OWN, "that other objects keep from the fingers: how well they are known")
    ] = 0.003
    easy_furniture: Annotated[
        float, Number("m", OWN, "of room to furniture that costs nothing when faces are chosen: localisation")
    ] = 0.03
    easy_objects: Annotated[float, Number("m", OWN, "the same to other objects: camera")] = 0.008
    tight_turn: Annotated[
        float, Number("rad", OWN, "of turning that a pair of faces with no room to spare is worth")
    ] = 2.0
    tight_slope: Annotated[float, Number("rad/m", OWN, "of turning that each metre less than no room is worth")] = 100.0
    blind: Annotated[
        float,
        Number("s", OWN, "over a link: what is left alone acts on, and then its joints come to rest, in such a time"),
    ] = 0.15


class ArmParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Arm reference, grasp and release."""

    k_A: Annotated[float, Number("", MOTM, "transit rule: duration = distance / (v_B k_A)", symbol="k_A"),
        Slider("Start of the reach", "Arm",
            "The hand sets off when distance / (base speed k_A) equals the time until the target is in reach.",
            (0.25, 1.0, 0.05))] = 0.5  # fmt: skip
    transit_base_speed: Annotated[
        float, Number("m/s", OWN, "v_B of the transit rule is at least this: a turning base soon drives again")
    ] = 0.5
    k_P: Annotated[float, Number("1/s", MOTM, "of the final approach", symbol="k_P"),
        Slider("Gain of the final approach", "Arm", "How quickly the hand closes the last distance to the grasp.",
            (3.0, 15.0, 0.5))] = 12.0  # fmt: skip
    approach_distance: Annotated[float,
        Number("m", MOTM, "of hand and target, at which the final approach begins", symbol="d_T"),
        Slider("Final approach from", "Arm", "Distance between hand and target at which the final approach begins.",
            (0.06, 0.2, 0.01))] = 0.10  # fmt: skip
    hand_speed: Annotated[float, Number("m/s", OWN, "of the hand relative to the base in transit"),
        Slider("Speed of the hand", "Arm", "Top speed of the hand, relative to the base, on its way to the target.",
            (0.3, 1.2, 0.05))] = 0.9  # fmt: skip
    hand_yaw_rate: Annotated[float, Number("rad/s", OWN, "of the hand about the mount")] = 1.8
    hover_height: Annotated[float, Number("m", OWN, "of the tool centre point above the centre of the object"),
        Slider("Hover height", "Arm",
            "Height of the hand above the object until that is below the fingers and seen well.",
            (0.05, 0.12, 0.01))] = 0.06  # fmt: skip
    extension_lead: Annotated[float,
        Number("s", OWN, "before arrival at which the hand is stretched out to the hover point"),
        Slider("Stretch out before arrival", "Arm",
            "How early the arm is fully stretched out; the earlier, the more obstacles it meets.",
            (0.0, 1.5, 0.1))] = 0.4  # fmt: skip
    swing_radius: Annotated[
        float, Number("m", OWN, "from the mount at which the hand swings before it is stretched out")
    ] = 0.25
    extension_azimuth: Annotated[
        float, Number("rad", OWN, "of azimuth error up to which it may be stretched out fully")
    ] = 0.3
    withdrawal_azimuth: Annotated[float, Number("rad", OWN, "from which on it is not stretched out at all")] = 0.55
    k_transit: Annotated[float, Number("1/s", OWN, "largest gain in transit")] = 8.0
    k_orientation: Annotated[float, Number("1/s", OWN, "of the hand to its orientation")] = 6.0
    transit_clearance: Annotated[float, Number("m", OWN, "the same while swinging")] = 0.08
    stretch: Annotated[
        float, Number("m", OWN, "joint 6 from the shoulder, beyond which the tool tilts; 0.719 is a straight elbow")
    ] = 0.69
    pick_reach: Annotated[
        float, Number("m", OWN, "from the mount at which a grasp begins; sooner it tilts for no more")
    ] = 0.80
    place_reach: Annotated[float, Number("m", OWN, "the same for a release")] = 0.84
    reach_slack: Annotated[float, Number("m", OWN, "beyond either before it is broken off; or of height")] = 0.05
    pick_tilt: Annotated[float, Number("rad", OWN, "largest outwards at a grasp")] = 16.0 * DEG
    place_tilt: Annotated[float, Number("rad", OWN, "the same for a release")] = 25.0 * DEG
    look_tilt: Annotated[
        float, Number("rad", OWN, "largest in transit, so that the palm camera sees the object early")
    ] = 30.0 * DEG
    look_cone: Annotated[float, Number("rad", OWN, "the object is kept this near to the optical axis")] = 30.0 * DEG
    close_error: Annotated[float, Number("m", OWN, "at which the gripper closes")] = 0.005
    close_speed: Annotated[float, Number("m/s", OWN, "of the hand over the object at which it closes")] = 0.025
    hold_speed: Annotated[
        float, Number("m/s", OWN, "of corrections while it closes: the strict grasp rule allows 0.03 m/s")
    ] = 0.012
    close_tilt: Annotated[float, Number("rad", OWN, "of the hand at which it closes")] = 20.0 * DEG
    seen_within: Annotated[float, Number("s", OWN, "nothing is grasped that was not seen this recently")] = 0.5
    sure_age: Annotated[float, Number("s", OWN, "nothing is gripped or let go on what the robot said longer ago")] = 0.1
    close_sd: Annotated[
        float, Number("m", OWN, "of a place at which the gripper closes; at half as much more it descends")
    ] = 0.008
    search_after: Annotated[
        float, Number("s", OWN, "without sight of the object: the hand rises; without room: it is left alone")
    ] = 1.0
    search_rise: Annotated[float, Number("m", OWN, "by which it rises")] = 0.25
    search_speed: Annotated[float, Number("m/s", OWN, "with which it rises")] = 0.15
    settle_time: Annotated[float, Number("s", OWN, "measured: from hover to an error below 5 mm")] = 0.34
    held_tolerance: Annotated[float, Number("m", OWN, "finger width below side by this: nothing is held")] = 0.004
    tip_length: Annotated[float, Number("m", ROBOT, "of the fingers beyond the tool centre point")] = 0.009
    tip_thickness: Annotated[float, Number("m", ROBOT, "of a finger behind its pad")] = 0.017
    tip_half_depth: Annotated[float, Number("m", ROBOT, "of a finger, across")] = 0.0105
    highest_grasp: Annotated[
        float, Number("m", OWN, "above the centre of the object, when tilted finger tips need it")
    ] = 0.008
    lift_time: Annotated[float, Number("s", OWN, "until the object is clear of its support")] = 0.15
    lift_height: Annotated[float, Number("m", OWN, "of the hand above the grasp")] = 0.10
    picked_height: Annotated[float, Number("m", OWN, "the next target may come from here on")] = 0.03
    release_height: Annotated[float, Number("m", OWN, "of the object's centre above the rim")] = 0.055
    place_settle_time: Annotated[float, Number("s", OWN, "from the edge of reach to the release")] = 0.3
    release_margin: Annotated[
        float, Number("m", OWN, "kept inside the release square; half of it where the object lands: maps are 4 cm off")
    ] = 0.055
    release_speed: Annotated[float, Number("m/s", OWN, "of the hand in the world")] = 0.25
    stow_radius: Annotated[float, Number("m", OWN, "from the mount")] = 0.12
    stow_height: Annotated[float, Number("m", OWN, "above the mount")] = 0.50
    stow_azimuth: Annotated[
        float, Number("rad", OWN, "largest turn towards the target while stowed: elbow inside the footprint")
    ] = 0.45
    stow_tilt: Annotated[float, Number("rad", OWN, "of the hand at the stow pose")] = 15.0 * DEG
    stuck_time: Annotated[
        float, Number("s", OWN, "on the way to the stow pose after which the arm returns by its joints")
    ] = 3.0
    patience: Annotated[
        float, Number("s", OWN, "in range, nothing achieved: the arm starts over; or before range: it waits")
    ] = 6.0
    vertical_speed: Annotated[float, Number("m/s", OWN, "largest, of the hand up or down, or stretched out")] = 0.5
    turning_rate: Annotated[float, Number("rad/s", OWN, "largest, of the hand to its orientation")] = 3.0
    ease: Annotated[
        float, Number("", OWN, "a transit of T seconds goes at gain ease / T: it begins briskly and arrives softly")
    ] = 1.5
    foot_radius: Annotated[
        float, Number("m", OWN, "from the mount, within which the hand is over the base: first up, then out")
    ] = 0.26
    funnel_slope: Annotated[float, Number("", OWN, "height above the grasp point per metre of horizontal error")] = 2.5
    funnel_radius: Annotated[float, Number("m", OWN, "horizontal error that does not keep the hand up")] = 0.004
    tilt_room: Annotated[
        float, Number("rad/m", OWN, "of tilt that an arm folded at the stow pose gains when the hand moves out")
    ] = 1.5
    turn_by: Annotated[float, Number("s", OWN, "before arrival, by which the hand has turned to the object")] = 0.3
    plane_azimuth: Annotated[
        float, Number("rad", OWN, "from the target, beyond which the arm swings in its own plane")
    ] = 0.5
    rim_clearance: Annotated[float, Number("m", OWN, "that an object is carried higher than it is released")] = 0.04
    sink_distance: Annotated[
        float, Number("m", OWN, "horizontal, within which a transit sinks to the hover height")
    ] = 0.15
    neighbours: Annotated[
        float, Number("m", OWN, "from where an object was taken, within which it is carried over the others")
    ] = 0.6
    retract_radius: Annotated[float, Number("m", OWN, "beyond which a retracting hand keeps its height")] = 0.35
    preferred_radius: Annotated[float, Number("m", OWN, "from the mount, at which the arm is most at ease")] = 0.60
    hover_radius: Annotated[float, Number("m", OWN, "from the mount, about where a hand waits for its target")] = 0.75
    yaw_time: Annotated[float, Number("s", OWN, "before arrival, at which faces are settled and the hand turns")] = 1.0
    mid_dwell: Annotated[float, Number("s", OWN, "after arrival, when the base is about nearest")] = 0.6
    open_room: Annotated[float, Number("m", OWN, "wider than the object, at which the fingers are open enough")] = 0.015
    left_error: Annotated[float, Number("m", OWN, "by which the hand may leave the object while it closes")] = 0.02
    pushed_away: Annotated[float, Number("m", OWN, "by which an object seen away from the fingers ends a closing")] = (
        0.03
    )
    longest_closing: Annotated[float, Number("s", OWN, "beyond the closing time, after which a closing has failed")] = (
        30.0
    )
    late_for: Annotated[float, Number("s", OWN, "that late fingers are expected to need still, at least")] = 1.0
    bent: Annotated[
        float, Number("rad", OWN, "of a joint from the stow pose, beyond which the arm is folded another way")
    ] = 0.8
    stowed_error: Annotated[
        float, Number("rad", OWN, "of joints 2 to 5, at which an arm that returns by its joints is stowed")
    ] = 0.25
    overlap_depth: Annotated[
        float,
        Number("m", OWN, "by which a seen cell must reach into the arm: beside a post the forearm comes within half"),
    ] = 0.05
    overlap_stands: Annotated[
        float,
        Number(
            "s",
            OWN,
            "before an arm in an obstacle goes to its stow pose: who put it there may take it away; unseen "
            "for a fifth of that, it has been",
        ),
    ] = 10.0
    overlap_speed: Annotated[
        float, Number("m/s", OWN, "of the hand on that way: a touch at this speed does no harm")
    ] = 0.1
    qp: QpParameters = QpParameters()
    avoidance: AvoidanceParameters = AvoidanceParameters()
