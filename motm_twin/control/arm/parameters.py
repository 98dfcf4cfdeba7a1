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

    solver: Annotated[str, Number("", OWN, "QP solver: daqp, or osqp (eps 1e-5, polishing), which the paper uses")] = (
        "daqp"
    )
    base_weight: Annotated[
        float, Number("", OWN, "weight of the base twist's deviation from v_B: the base obeys its planner")
    ] = 1.0e5
    rate_weight: Annotated[float, Number("", MOTM, "weight of the arm's joint rates", symbol="k_a")] = 0.01
    twist_rate_weight: Annotated[
        float,
        Number(
            "", OWN, "weight of the rates of joints 3 and 5: the other five reach every pose of a hand that points down"
        ),
    ] = 0.3
    swing_twist_rate_weight: Annotated[
        float, Number("", OWN, "weight of the rates of joints 3 and 5 while swinging: rather slower than twisted")
    ] = 5.0
    linear_slack_weight: Annotated[float, Number("", OWN, "weight of slack in the hand's linear velocity")] = 1.0e3
    tilt_slack_weight: Annotated[
        float,
        Number(
            "",
            OWN,
            "weight of slack in the hand's tilt rate; far cheaper than linear slack: tilt keeps the object in reach",
        ),
    ] = 3.0
    yaw_slack_weight: Annotated[float, Number("", OWN, "weight of slack in the hand's yaw rate")] = 30.0
    swing_linear_slack_weight: Annotated[
        float,
        Number(
            "", OWN, "linear_slack_weight while swinging, when nothing must be met exactly: rather slower than tilted"
        ),
    ] = 100.0
    swing_tilt_slack_weight: Annotated[float, Number("", OWN, "tilt_slack_weight while swinging")] = 30.0
    swing_yaw_slack_weight: Annotated[float, Number("", OWN, "yaw_slack_weight while swinging")] = 5.0
    elbow_limit: Annotated[
        float, Number("rad", OWN, "upper limit of joint 4: above -0.467 the elbow would bend the other way and lock")
    ] = -0.52
    posture_gain: Annotated[
        float,
        Number(
            "1/s", OWN, "gain of the posture task: joints 1, 3 and 5 to an arm in one plane, through the hand's azimuth"
        ),
    ] = 2.0
    swing_posture: Annotated[
        float, Number("", OWN, "factor on posture_gain and posture_rate while swinging: elbow over the base")
    ] = 4.0
    posture_rate: Annotated[
        float,
        Number("rad/s", OWN, "largest joint rate of the posture task, so that the hand stands still on the object"),
    ] = 0.5
    free_weight: Annotated[
        float, Number("", OWN, "weight of slack in the hand's velocity during a joint-space return to the stow pose")
    ] = 0.01
    free_gain: Annotated[float, Number("1/s", OWN, "joint gain of a joint-space return to the stow pose")] = 1.5
    manipulability_weight: Annotated[
        float, Number("", OWN, "weight of the gradient of manipulability; more twists the arm out of its plane")
    ] = 0.005
    elastic_weight: Annotated[
        float,
        Number("", OWN, "price of elastic obstacle rows: they give way rather than leave no answer, and only then"),
    ] = 1.0e4
    damper_gain: Annotated[
        float, Number("rad/s", OWN, "joint rate that the joint-limit damper allows at rho_i", symbol="eta")
    ] = 2.2
    damper_start: Annotated[
        float, Number("rad", OWN, "distance from its limit at which a joint begins to slow", symbol="rho_i")
    ] = 0.25
    damper_stop: Annotated[
        float, Number("rad", OWN, "distance from its limit at which a joint stands", symbol="rho_s")
    ] = 0.02
    residual: Annotated[float, Number("", OWN, "largest accepted violation of any row by the answer of the solver")] = (
        1.0e-5
    )
    gives_way: Annotated[
        float, Number("m/s", OWN, "speed by which rows of furniture give way before that is a fault")
    ] = 0.02


class AvoidanceParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Speed limits towards obstacles: `xi (d - d_s) / (d_i - d_s)`."""

    enabled: Annotated[bool,
        Number("", paper("V"), "the gripper slows towards obstacles that the lidar sees outside the map"),
        Slider("Arm avoidance", "Obstacle avoidance",
            "Limits the gripper's speed towards obstacles that the lidar sees and the map does not have.", paper=True,
            name="arm_avoidance")] = True  # fmt: skip
    xi: Annotated[float, Number("m/s", paper("V"), "approach speed that is allowed at d_i", symbol="xi"),
        Slider("Approach speed", "Obstacle avoidance", "Speed allowed towards an obstacle at the distance d_i.",
            (0.1, 1.5, 0.05), paper=0.6)] = 0.6  # fmt: skip
    d_s: Annotated[float,
        Number("m", paper("V"), "stop distance: the gripper comes no nearer to an obstacle", symbol="d_s"),
        Slider("Stop distance", "Obstacle avoidance", "The gripper comes no nearer to an obstacle than this.",
            (0.05, 0.35, 0.01), paper=0.25)] = 0.25  # fmt: skip
    d_i: Annotated[float,
        Number("m", paper("V"), "influence distance: from here on, an obstacle slows the gripper", symbol="d_i"),
        Slider("Influence distance", "Obstacle avoidance",
            "Obstacles farther from the gripper than this do not slow it.", (0.4, 1.2, 0.05),
            paper=0.6)] = 0.6  # fmt: skip
    prediction: Annotated[float,
        Number("s", OWN, "time for which moving obstacles are predicted for the arm: it leaves a coming one sooner"),
        Slider("Prediction for the arm", "Obstacle avoidance",
            "The arm also keeps away from where moving obstacles will be after this time.", (0.0, 1.0, 0.1),
            paper=0.0, name="arm_prediction")] = 0.0  # fmt: skip
    lead: Annotated[
        float,
        Number("m", OWN, "distance beyond d_i at which the speed limit begins: no hand brakes from 1 m/s at once"),
    ] = 0.5
    moving_margin: Annotated[
        float, Number("m", OWN, "taken off the distance to the cell of a moving obstacle: half a cell's diagonal")
    ] = 0.035
    static_margin: Annotated[
        float, Number("m", OWN, "a static obstacle's d_s is the target's distance to it less this, at most d_s")
    ] = 0.05
    sectors: Annotated[
        int, Number("", OWN, "directions round the gripper, each limited by its nearest static point")
    ] = 12
    moving_sectors: Annotated[
        int,
        Number(
            "", OWN, "directions round the gripper, for moving points: a row 10 deg aside lets a passing hand come near"
        ),
    ] = 36
    link_d_s: Annotated[float,
        Number("m", OWN, "stop distance of elbow, forearm and wrist from moving obstacles; the paper has one point"),
        Slider("Stop distance of the links", "Obstacle avoidance",
            "Distance that elbow, forearm and wrist keep from moving obstacles; the paper limits only the gripper.",
            (0.02, 0.15, 0.01))] = 0.05  # fmt: skip
    link_d_i: Annotated[
        float, Number("m", OWN, "influence distance of elbow, forearm and wrist from moving obstacles")
    ] = 0.35
    furniture_d_s: Annotated[float,
        Number("m", OWN, "stop distance of the arm from furniture, plus 2 sd of the robot's place on the map"),
        Slider("Clearance of the arm", "Safety",
            "Distance that the whole arm keeps from mapped furniture, except for the fingers at a grasp.",
            (0.004, 0.04, 0.004))] = 0.008  # fmt: skip
    furniture_d_i: Annotated[float, Number("m", OWN, "influence distance of the arm from furniture")] = 0.12
    furniture_lead: Annotated[
        float,
        Number(
            "m", OWN, "distance beyond furniture_d_i at which the limit begins: a hand at 1 m/s does not brake at once"
        ),
    ] = 0.1
    fingers_d_s: Annotated[
        float, Number("m", OWN, "stop distance of the fingers from the surface that carries the object, at a grasp")
    ] = 0.006
    fingers_d_i: Annotated[
        float,
        Number("m", OWN, "influence distance of the fingers from the surface that carries the object, at a grasp"),
    ] = 0.05
    objects_kept: Annotated[
        float, Number("m", OWN, "clearance of the fingers from other objects: how well they are known")
    ] = 0.003
    easy_furniture: Annotated[
        float, Number("m", OWN, "room to furniture from which a grasp costs nothing: error of localisation")
    ] = 0.03
    easy_objects: Annotated[
        float, Number("m", OWN, "room to other objects from which a grasp costs nothing: error of the camera")
    ] = 0.008
    tight_turn: Annotated[float, Number("rad", OWN, "cost of a grasp with no room to spare, as a turn of the hand")] = (
        2.0
    )
    tight_slope: Annotated[
        float, Number("rad/m", OWN, "cost of a grasp per metre of missing room, as a turn of the hand")
    ] = 100.0
    blind: Annotated[
        float, Number("s", OWN, "over a delayed link: time in which an uncommanded arm comes to rest, short of d_s")
    ] = 0.15


class ArmParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Arm reference, grasp and release."""

    k_A: Annotated[float, Number("", MOTM, "transit rule: duration of a transit = distance / (v_B k_A)", symbol="k_A"),
        Slider("Start of the reach", "Arm",
            "The hand sets off when distance / (base speed k_A) equals the time until the target is in reach.",
            (0.25, 1.0, 0.05))] = 0.5  # fmt: skip
    transit_base_speed: Annotated[
        float, Number("m/s", OWN, "least v_B in the transit rule: a turning base soon drives again")
    ] = 0.5
    k_P: Annotated[float, Number("1/s", MOTM, "position gain of the hand in the final approach", symbol="k_P"),
        Slider("Gain of the final approach", "Arm", "How quickly the hand closes the last distance to the grasp.",
            (3.0, 15.0, 0.5))] = 12.0  # fmt: skip
    approach_distance: Annotated[float,
        Number("m", MOTM, "horizontal distance of hand and target at which the final approach begins", symbol="d_T"),
        Slider("Final approach from", "Arm", "Distance between hand and target at which the final approach begins.",
            (0.06, 0.2, 0.01))] = 0.10  # fmt: skip
    hand_speed: Annotated[float, Number("m/s", OWN, "largest speed of the hand relative to the base in transit"),
        Slider("Speed of the hand", "Arm", "Top speed of the hand, relative to the base, on its way to the target.",
            (0.3, 1.2, 0.05))] = 0.9  # fmt: skip
    hand_yaw_rate: Annotated[float, Number("rad/s", OWN, "largest rate of the hand's azimuth about the mount")] = 1.8
    hover_height: Annotated[float,
        Number("m", OWN, "height of the tool centre point above the object's centre while hovering"),
        Slider("Hover height", "Arm",
            "Height of the hand above the object until that is below the fingers and seen well.",
            (0.05, 0.12, 0.01))] = 0.06  # fmt: skip
    extension_lead: Annotated[float,
        Number("s", OWN, "time before arrival at which the hand is stretched out to the hover point"),
        Slider("Stretch out before arrival", "Arm",
            "How early the arm is fully stretched out; the earlier, the more obstacles it meets.",
            (0.0, 1.5, 0.1))] = 0.4  # fmt: skip
    swing_radius: Annotated[
        float, Number("m", OWN, "distance from the mount at which the hand swings before it is stretched out")
    ] = 0.25
    extension_azimuth: Annotated[
        float, Number("rad", OWN, "azimuth error up to which the hand may be stretched out fully")
    ] = 0.3
    withdrawal_azimuth: Annotated[
        float, Number("rad", OWN, "azimuth error from which the hand is not stretched out at all")
    ] = 0.55
    k_transit: Annotated[float, Number("1/s", OWN, "largest position gain of the hand in transit")] = 8.0
    k_orientation: Annotated[float, Number("1/s", OWN, "gain of the hand's orientation")] = 6.0
    transit_clearance: Annotated[
        float, Number("m", OWN, "height of the tool centre point above objects and furniture in transit")
    ] = 0.08
    stretch: Annotated[
        float,
        Number(
            "m", OWN, "distance of joint 6 from the shoulder beyond which the tool tilts; 0.719 is a straight elbow"
        ),
    ] = 0.69
    pick_reach: Annotated[
        float, Number("m", OWN, "distance from the mount at which a grasp begins; the hand tilts for no larger one")
    ] = 0.80
    place_reach: Annotated[float, Number("m", OWN, "distance from the mount at which a release begins")] = 0.84
    reach_slack: Annotated[
        float,
        Number(
            "m",
            OWN,
            "excess over pick_reach or place_reach that breaks the job off, or over hover_height for the descent",
        ),
    ] = 0.05
    pick_tilt: Annotated[float, Number("rad", OWN, "largest outward tilt of the hand at a grasp")] = 16.0 * DEG
    place_tilt: Annotated[float, Number("rad", OWN, "largest outward tilt of the hand at a release")] = 25.0 * DEG
    look_tilt: Annotated[
        float, Number("rad", OWN, "largest tilt of the hand in transit, so that the palm camera sees the object early")
    ] = 30.0 * DEG
    look_cone: Annotated[
        float, Number("rad", OWN, "angle from the camera's axis within which the object is kept in transit")
    ] = 30.0 * DEG
    close_error: Annotated[float, Number("m", OWN, "position error of the hand at which the gripper closes")] = 0.005
    close_speed: Annotated[
        float, Number("m/s", OWN, "speed of the hand over the object at which the gripper closes")
    ] = 0.025
    hold_speed: Annotated[
        float,
        Number(
            "m/s", OWN, "largest speed of corrections while the gripper closes: the strict grasp rule allows 0.03 m/s"
        ),
    ] = 0.012
    close_tilt: Annotated[float, Number("rad", OWN, "tilt of the hand at which the gripper closes")] = 20.0 * DEG
    seen_within: Annotated[float, Number("s", OWN, "nothing is grasped that was not seen this recently")] = 0.5
    sure_age: Annotated[
        float, Number("s", OWN, "age of the robot's report from which nothing is gripped or let go")
    ] = 0.1
    close_sd: Annotated[
        float,
        Number(
            "m", OWN, "sd of the object's position at which the gripper closes; at half as much more the hand descends"
        ),
    ] = 0.008
    search_after: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time without sight of the object before the hand rises; without room, before the object is left alone",
        ),
    ] = 1.0
    search_rise: Annotated[float, Number("m", OWN, "height by which the hand rises to find an object")] = 0.25
    search_speed: Annotated[float, Number("m/s", OWN, "speed with which the hand rises to find an object")] = 0.15
    settle_time: Annotated[float, Number("s", OWN, "measured time from hover to a hand error below 5 mm")] = 0.34
    held_tolerance: Annotated[
        float, Number("m", OWN, "nothing is held when the finger width is below the object's side by this")
    ] = 0.004
    tip_length: Annotated[float, Number("m", ROBOT, "length of the fingers beyond the tool centre point")] = 0.009
    tip_thickness: Annotated[float, Number("m", ROBOT, "thickness of a finger behind its pad")] = 0.017
    tip_half_depth: Annotated[float, Number("m", ROBOT, "half the depth of a finger, across its closing direction")] = (
        0.0105
    )
    highest_grasp: Annotated[
        float, Number("m", OWN, "largest height of a grasp above the object's centre, when tilted finger tips need it")
    ] = 0.008
    lift_time: Annotated[float, Number("s", OWN, "time of a lift until the object is clear of its support")] = 0.15
    lift_height: Annotated[float, Number("m", OWN, "height of the hand above the grasp at the end of a lift")] = 0.10
    picked_height: Annotated[float, Number("m", OWN, "height of a lift from which the next target may come")] = 0.03
    release_height: Annotated[float, Number("m", OWN, "height of the object's centre above the rim at a release")] = (
        0.055
    )
    place_settle_time: Annotated[float, Number("s", OWN, "time from the edge of reach to the release")] = 0.3
    release_margin: Annotated[
        float,
        Number("m", OWN, "margin inside the release square; half of it where the object lands: maps are 4 cm off"),
    ] = 0.055
    release_speed: Annotated[float, Number("m/s", OWN, "largest speed of the hand in the world at a release")] = 0.25
    stow_radius: Annotated[float, Number("m", OWN, "distance of the stowed hand from the mount")] = 0.12
    stow_height: Annotated[float, Number("m", OWN, "height of the stowed hand above the mount")] = 0.50
    stow_azimuth: Annotated[
        float, Number("rad", OWN, "largest turn of the stowed arm towards the target: elbow inside the footprint")
    ] = 0.45
    stow_tilt: Annotated[float, Number("rad", OWN, "tilt of the stowed hand")] = 15.0 * DEG
    stuck_time: Annotated[
        float, Number("s", OWN, "time on the way to the stow pose after which the arm returns in joint space")
    ] = 3.0
    patience: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time in range without a result before the arm starts over; longest time to range for setting off",
        ),
    ] = 6.0
    vertical_speed: Annotated[float, Number("m/s", OWN, "largest speed of the hand up, down, or stretching out")] = 0.5
    turning_rate: Annotated[float, Number("rad/s", OWN, "largest rate at which the hand turns to its orientation")] = (
        3.0
    )
    ease: Annotated[
        float, Number("", OWN, "a transit of T seconds goes at gain ease / T: it begins briskly and arrives softly")
    ] = 1.5
    foot_radius: Annotated[
        float, Number("m", OWN, "distance from the mount within which the hand is over the base: first up, then out")
    ] = 0.26
    funnel_slope: Annotated[
        float, Number("", OWN, "height of the descending hand above the grasp point, per metre of horizontal error")
    ] = 2.5
    funnel_radius: Annotated[float, Number("m", OWN, "horizontal error with which the hand may descend fully")] = 0.004
    tilt_room: Annotated[
        float, Number("rad/m", OWN, "tilt allowed per metre beyond the stow radius: a folded arm has no room to tilt")
    ] = 1.5
    turn_by: Annotated[float, Number("s", OWN, "time before arrival by which the hand has turned to the object")] = 0.3
    plane_azimuth: Annotated[
        float, Number("rad", OWN, "azimuth of the hand from the target beyond which the arm swings in its own plane")
    ] = 0.5
    rim_clearance: Annotated[
        float, Number("m", OWN, "height above the point of release at which an object is carried")
    ] = 0.04
    sink_distance: Annotated[
        float, Number("m", OWN, "horizontal distance from the target within which the hand sinks to the hover height")
    ] = 0.15
    neighbours: Annotated[
        float, Number("m", OWN, "distance from its pick place within which an object is carried over the others")
    ] = 0.6
    retract_radius: Annotated[
        float, Number("m", OWN, "distance from the mount beyond which a retracting hand keeps its height")
    ] = 0.35
    preferred_radius: Annotated[
        float, Number("m", OWN, "distance from the mount at which the arm is most at ease, for the release point")
    ] = 0.60
    hover_radius: Annotated[
        float, Number("m", OWN, "distance from the mount at which a hand usually waits for its target")
    ] = 0.75
    yaw_time: Annotated[
        float, Number("s", OWN, "time before arrival at which faces are settled and the hand turns to them")
    ] = 1.0
    mid_dwell: Annotated[
        float, Number("s", OWN, "time after arrival at which the base is about nearest, for the choice of faces")
    ] = 0.6
    open_room: Annotated[float, Number("m", OWN, "the fingers are open enough when wider than the object by this")] = (
        0.015
    )
    left_error: Annotated[
        float, Number("m", OWN, "distance of the hand from the grasp point at which a closing has left the object")
    ] = 0.02
    pushed_away: Annotated[
        float, Number("m", OWN, "distance of the seen object from the grasp point that ends a closing")
    ] = 0.03
    longest_closing: Annotated[
        float, Number("s", OWN, "time beyond the gripper's closing time after which a closing has failed")
    ] = 30.0
    late_for: Annotated[float, Number("s", OWN, "least time that late fingers are expected to need still")] = 1.0
    bent: Annotated[
        float, Number("rad", OWN, "deviation of a joint from the stow pose beyond which the arm is folded another way")
    ] = 0.8
    stowed_error: Annotated[
        float, Number("rad", OWN, "error of joints 2 to 5 at which a joint-space return has stowed the arm")
    ] = 0.25
    overlap_depth: Annotated[
        float,
        Number(
            "m", OWN, "depth of a seen cell in the arm that is an overlap: beside a post the forearm comes within half"
        ),
    ] = 0.05
    overlap_stands: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time before an arm in an obstacle goes to its stow pose: who put it there may take it away; unseen for "
            "a fifth of that, it is gone",
        ),
    ] = 10.0
    overlap_speed: Annotated[
        float, Number("m/s", OWN, "speed of the hand on its way out of an obstacle: a touch at this speed does no harm")
    ] = 0.1
    qp: QpParameters = QpParameters()
    avoidance: AvoidanceParameters = AvoidanceParameters()
