"""The monitor: limits, scan age and the stop in time."""

import math
from typing import NamedTuple

import msgspec
import numpy as np
import pytest

from motm_twin.control.monitor import Monitor, MonitorParameters, points_in_stop, stopping_poses
from motm_twin.control.self_check import Trust
from motm_twin.model.motion import lag_share
from motm_twin.model.passive_safety import BRAKES_BOTH, HOLDS_TURN, NO_ARM, braked, met_in_stop, overhang, stop_of
from motm_twin.model.plant import Actuation, Observation, Scan
from motm_twin.model.profile import DQ_MAX, RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.floor import FRESH, STALE, UNSEEN, Floor
from motm_twin.perception.world_map import WorldMap
from motm_twin.sim.mechanics import Base
from motm_twin.sim.plant_state import BaseState
from motm_twin.sim.responsibility import MOVES

DT = 0.01
BEAMS = 541


def observation(time=1.0, stamp=1.0, wall=math.inf, pose=(0.0, 0.0, 0.0), twist=(0.0, 0.0)):
    """A robot at rest in front of a wall at x = `wall` [m]."""
    step = math.radians(270.0) / (BEAMS - 1)
    angles = -math.radians(135.0) + step * np.arange(BEAMS)
    with np.errstate(divide="ignore"):
        ranges = np.where(np.cos(angles) > 0.05, (wall - 0.3) / np.cos(angles), math.inf)
    scan = Scan(
        stamp=stamp,
        ranges=ranges,
        angle_min=angles[0],
        angle_step=step,
        origin=np.array([0.3, 0.0]),
        range_min=0.05,
        range_max=15.0,
        pose=np.zeros(3),
    )
    return Observation(
        time=time,
        pose=np.array(pose),
        odometry=np.zeros(3),
        twist=np.array(twist),
        q=np.zeros(7),
        dq=np.zeros(7),
        gripper_width=0.08,
        gripper_moving=False,
        scan=scan,
        detections=(),
    )


def scan_of_wall(pose, wall, stamp):
    """Scan from a pose of a wall at x = `wall` [m] in the world, all round."""
    angles = np.linspace(-math.pi, math.pi, 1081)
    with np.errstate(divide="ignore"):
        ahead = np.cos(angles + pose[2])
        ranges = np.where(ahead > 0.05, (wall - pose[0]) / ahead, math.inf)
    return Scan(
        stamp=stamp, ranges=ranges, angle_min=angles[0], angle_step=angles[1] - angles[0], origin=np.zeros(2),
        range_min=0.05, range_max=15.0, pose=pose.copy(),
    )  # fmt: skip


def asking(v=0.0, w=0.0, rates=None):
    rates = np.zeros(7) if rates is None else rates
    return Actuation(twist=np.array([v, w]), joint_velocity=rates, gripper="open")


def check(monitor, actuation, seen):
    return monitor.check(actuation, seen, DT, scan_stamp=seen.scan.stamp if seen.scan is not None else None)


def stopped_by(points, v, w, holds=BRAKES_BOTH, twist=(0.0, 0.0)):
    """Number of points that a base of 0.7 m by 0.5 m meets that brakes from this command, at the measured twist."""
    stop = stop_of(RobotProfile(), 0.0)._replace(half_length=0.35, half_width=0.25, offset=0.0)
    return points_in_stop(points, stopping_poses(np.array(twist), np.array([v, w]), holds, stop), stop, 0.01)


def speed_up(monitor, seen, v, w, periods=400):
    for _ in range(periods):
        verdict = check(monitor, asking(v, w), seen)
    return verdict


def test_a_good_actuation_passes_unchanged():
    verdict = check(Monitor(RobotProfile()), asking(0.004, 0.01), observation())
    assert verdict.reason == ""
    assert np.allclose(verdict.actuation.twist, [0.004, 0.01])


def test_speed_and_acceleration_never_exceed_the_profile():
    profile = RobotProfile()
    monitor = Monitor(profile)
    last = np.zeros(2)
    for _ in range(300):
        twist = check(monitor, asking(9.0, -9.0), observation()).actuation.twist
        assert abs(twist[0] - last[0]) <= profile.base.linear_acceleration * DT + 1e-12
        assert abs(twist[1] - last[1]) <= profile.base.yaw_acceleration * DT + 1e-12
        last = twist
    assert np.allclose(last, [profile.base.forward_speed, -profile.base.yaw_rate])


def test_joint_rates_are_clipped_to_their_limits():
    verdict = check(Monitor(RobotProfile()), asking(rates=np.full(7, 99.0)), observation())
    assert np.all(verdict.actuation.joint_velocity <= DQ_MAX)


@pytest.mark.parametrize(("age", "word"), [(0.10, ""), (0.20, "slowed"), (0.35, "stopped")])
def test_an_old_scan_slows_and_then_stops_the_base(age, word):
    monitor = Monitor(RobotProfile())
    speed_up(monitor, observation(), 0.5, 0.0)
    verdict = speed_up(monitor, observation(time=1.0, stamp=1.0 - age), 0.5, 0.0)
    assert verdict.reason.startswith(word)
    assert verdict.actuation.twist[0] == pytest.approx({"": 0.5, "slowed": 0.25, "stopped": 0.0}[word])


def test_a_wall_within_the_stopping_distance_brakes():
    monitor = Monitor(RobotProfile())
    speed_up(monitor, observation(), 0.5, 0.0)
    stopping = 0.5 * 0.1 + 0.5**2 / (2 * 0.5)
    free = check(monitor, asking(0.5), observation(wall=0.35 + stopping + 0.10))
    assert free.reason == ""
    near = check(monitor, asking(0.5), observation(wall=0.35 + stopping - 0.05))
    assert "braking" in near.reason
    assert near.actuation.twist[0] < 0.5


def test_a_stop_is_reckoned_from_the_speed_that_is_measured():
    """A slower command came out free while the base still turned: braking came and went, and it stopped too late."""
    told = (0.2, 0.0)
    far = np.array([[0.35 + 0.2 * 0.1 + 0.2**2 + 0.02, y] for y in (-0.1, 0.0, 0.1)])
    assert stopped_by(far, *told) == 0
    assert stopped_by(far, *told, twist=(0.3, 0.0)) == 3
    assert stopped_by(far, *told, twist=(-0.3, 0.0)) == 0


@pytest.mark.parametrize("wall", [0.39, 0.40, 0.41, 0.42])
@pytest.mark.parametrize("turn", [0.7, 1.0, 1.2])
def test_a_base_that_turns_beside_a_wall_stops_with_its_corner_off_it(wall, turn):
    """Scans come every 50 ms, the monitor looks every 10 ms: their points stood still in the frame of the base."""
    robot, seen = RobotProfile(), None
    monitor, base, state = Monitor(robot), Base(robot.base, DT), BaseState(pose=np.array([0.0, 0.0, 0.5 * math.pi]))
    half = np.array([[0.5 * robot.footprint.length, side * 0.5 * robot.footprint.width] for side in (-1.0, 1.0)])
    gaps = []
    for k in range(400):
        if k % 5 == 0:
            seen = scan_of_wall(state.pose, wall, k * DT)
        now = observation(time=k * DT, pose=state.pose, twist=(state.v, state.w))
        told = check(monitor, asking(0.0, turn), msgspec.structs.replace(now, scan=seen)).actuation.twist
        base.step(state, told)
        corners = np.concatenate((half, -half)) @ [math.cos(state.pose[2]), -math.sin(state.pose[2])]
        gaps.append(wall - corners.max())
    assert told[1] == 0.0
    assert min(gaps) > 0.003


def test_backing_away_from_a_wall_that_touches_is_allowed():
    monitor = Monitor(RobotProfile())
    verdict = speed_up(monitor, observation(wall=0.355), -0.2, 0.0)
    assert verdict.reason == ""
    assert verdict.actuation.twist[0] == pytest.approx(-0.2)


def test_a_base_that_overlaps_a_wall_may_only_leave_it():
    """Points inside the footprint were left out: the base drove on into what it touched."""
    for wall in (0.345, 0.30, 0.10):
        ahead = speed_up(Monitor(RobotProfile()), observation(wall=wall), 0.1, 0.0)
        assert np.all(ahead.actuation.twist == 0.0)
        assert "inside the base" in ahead.reason
        back = speed_up(Monitor(RobotProfile()), observation(wall=wall), -0.1, 0.0)
        assert back.actuation.twist[0] == pytest.approx(-0.1)
        assert back.reason == ""


def test_a_base_does_not_creep_into_a_wall_that_is_inside_its_margin():
    monitor = Monitor(RobotProfile())
    verdict = speed_up(monitor, observation(wall=0.355), 0.0005, 0.0)
    assert verdict.actuation.twist[0] == 0.0


def test_a_base_that_stands_in_a_corner_of_two_walls_stands_and_says_so():
    points = np.array([[0.30, 0.0], [0.31, 0.1], [-0.30, 0.0], [-0.31, 0.1]])
    for v, w in ((0.1, 0.0), (-0.1, 0.0)):
        assert stopped_by(points, v, w) >= 2


def test_numbers_that_are_not_finite_stop_the_robot():
    verdict = check(Monitor(RobotProfile()), asking(0.1), observation(pose=(math.nan, 0.0, 0.0)))
    assert "not finite" in verdict.reason
    assert np.all(verdict.actuation.joint_velocity == 0.0)
    assert np.all(verdict.actuation.twist == 0.0)


def test_a_base_that_turns_away_from_a_post_may_keep_turning_while_it_brakes():
    """Braking the turn as well drove into the post that the base was turning away from."""
    points = np.array([[0.58, -0.10], [0.60, -0.10], [0.60, -0.08]])
    assert stopped_by(points, 0.45, 0.9) == 3
    assert stopped_by(points, 0.45, 0.9, HOLDS_TURN) == 0


@pytest.mark.parametrize("holds", [BRAKES_BOTH, HOLDS_TURN])
def test_a_base_that_turns_on_the_spot_sees_what_its_corner_sweeps(holds):
    """To hold the turn until the base goes no further was free: a base that only turns goes nowhere."""
    points = np.array([[0.36, 0.23], [0.36, 0.22], [0.36, 0.21]])
    assert stopped_by(points, 0.0, -1.2, holds) > 0


def test_without_a_scan_that_was_found_good_the_base_stands():
    monitor = Monitor(RobotProfile())
    verdict = monitor.check(asking(0.5), observation(), DT, scan_stamp=None)
    assert verdict.reason == "stopped: no usable lidar scan has arrived yet"
    assert not verdict.actuation.twist.any()


def floor_of(rear):
    """Floor of which the lidar has seen everything but what is behind its rear: that is ``rear``."""
    seen = np.full((60, 60), FRESH, np.uint8)
    seen[:, :23] = rear
    return Floor(corner=(-1.5, -1.5), resolution=0.05, seen=seen)


def world_with(floor=None, tracks=()):
    """A map of which only floor and tracks count."""
    rows = np.array([(*track, 0.03, 1.0) for track in tracks]).reshape(-1, 7)
    nothing = np.zeros((1, 1))
    return WorldMap(
        stamp=1.0, resolution=0.05, origin=np.zeros(2), occupied=nothing.astype(np.uint8), distance=nothing,
        proximity=nothing, polygons=(), seen_points=np.zeros((0, 2)), seen_static=np.zeros(0, bool), floor=floor,
        tracks=rows,
    )  # fmt: skip


def driven(v, rear):
    """Verdict of a monitor that was asked for this speed for two seconds, on such floor."""
    monitor = Monitor(RobotProfile())
    for _ in range(200):
        verdict = monitor.check(asking(v), observation(), DT, scan_stamp=1.0, world=world_with(floor_of(rear)))
    return verdict


def test_the_base_does_not_back_over_floor_that_was_never_seen():
    """Unknown floor counted as free: a base with a lidar in front backed into what no beam had met."""
    verdict = driven(-0.25, UNSEEN)
    assert verdict.actuation.twist[0] == 0.0
    assert "never seen" in verdict.reason
    assert driven(0.25, UNSEEN).actuation.twist[0] == 0.25


def test_the_base_creeps_over_floor_that_was_not_seen_lately():
    verdict = driven(-0.25, STALE)
    assert verdict.actuation.twist[0] == pytest.approx(-0.1)
    assert "lately" in verdict.reason
    assert driven(-0.25, FRESH).actuation.twist[0] == -0.25


def meet(x, y, vx, vy, *, v=0.5, w=0.0, seconds=6.0, passive=True):
    """A base that is told v, w all the time, and a disc of 0.25 m: is the base moving towards it when they touch?"""
    robot = RobotProfile()
    monitor = Monitor(robot, MonitorParameters(passive_safety=passive))
    base, state = Base(robot.base, DT), BaseState(pose=np.zeros(3))
    disc, said = np.array([x, y]), []
    for _ in range(round(seconds / DT)):
        world = world_with(tracks=[(*disc, vx, vy, 0.25)])
        seen = observation(pose=state.pose, twist=(state.v, state.w))
        verdict = monitor.check(asking(v, w), seen, DT, scan_stamp=1.0, world=world)
        said.append(verdict.reason)
        disc = disc + DT * np.array([vx, vy])
        before = _gap(state.pose, disc, robot.footprint)
        base.step(state, verdict.actuation.twist)
        gap = _gap(state.pose, disc, robot.footprint)
        if gap < 0.25:
            return "towards" if gap < before - MOVES * DT else "hit", said
    return "free", said


def _gap(pose, point, body):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = point - pose[:2]
    along = abs(c * dx + s * dy - body.offset_x) - 0.5 * body.length
    across = abs(c * dy - s * dx) - 0.5 * body.width
    return math.hypot(max(along, 0.0), max(across, 0.0))


@pytest.mark.parametrize("v", [0.5, -0.25])
@pytest.mark.parametrize("speed", [0.4, 0.8, 1.2])
@pytest.mark.parametrize("bearing", range(0, 360, 30))
def test_a_base_never_moves_towards_somebody_who_does_not_stop(v, speed, bearing):
    """They meet 1.5 m ahead of the base, whatever side they come from."""
    angle = math.radians(bearing)
    velocity = -speed * np.array([math.cos(angle), math.sin(angle)])
    start = np.array([math.copysign(1.5, v), 0.0]) - 1.5 / abs(v) * velocity
    assert meet(*start, *velocity, v=v)[0] != "towards"


@pytest.mark.parametrize("turn", [-1.2, 1.2])
@pytest.mark.parametrize("speed", [0.3, 0.6])
@pytest.mark.parametrize("aside", [-0.5, -0.25, 0.25, 0.5])
@pytest.mark.parametrize("bearing", range(0, 360, 45))
def test_a_base_that_turns_on_the_spot_moves_towards_nobody(turn, speed, aside, bearing):
    """Somebody passes or touches the corners of a base that turns."""
    angle = math.radians(bearing)
    ahead, side = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    assert meet(*(aside * side - 2.0 * speed * ahead), *(speed * ahead), v=0.0, w=turn, seconds=4.0)[0] != "towards"


@pytest.mark.parametrize("turn", [-1.0, 1.0])
@pytest.mark.parametrize("speed", [0.3, 0.5])
@pytest.mark.parametrize("ahead", [0.7, 0.8, 0.9])
@pytest.mark.parametrize("bearing", range(-60, 75, 15))
def test_a_base_that_backs_away_and_turns_goes_on_backing_away(turn, speed, ahead, bearing):
    """Both were braked, and somebody who followed caught up with a side that still turned towards him."""
    angle = math.radians(180 + bearing)
    assert meet(ahead, 0.0, speed * math.cos(angle), speed * math.sin(angle), v=-0.22, w=turn)[0] != "towards"


@pytest.mark.parametrize(
    ("v", "room", "behind", "holds"),
    [(0.22, 1.0, FRESH, True), (0.22, 0.15, FRESH, False), (-0.22, 1.0, FRESH, True), (-0.22, 1.0, UNSEEN, False)],
)
def test_a_stop_holds_the_speed_only_where_there_is_room_on_seen_floor(v, room, behind, holds):
    """It was driven without a look at walls and floor on that way: a base that backs away may reach them."""
    monitor = Monitor(RobotProfile(), MonitorParameters(passive_safety=True))
    seen = observation(wall=0.35 + room, twist=(v, 1.0))
    assert monitor._has_room_to_hold_speed(world_with(floor_of(behind)), seen) == holds


@pytest.mark.parametrize(("y", "turns_on"), [(-0.25, True), (0.8, False)])
def test_a_stop_that_was_free_is_kept_to_when_somebody_turns(y, turns_on):
    """Of two stops that were both met the one that brakes the turn was driven, whatever had been free before."""
    monitor = Monitor(RobotProfile(), MonitorParameters(passive_safety=True))
    monitor.begin_from(np.array([0.5, 0.8]))
    for there, free in (((1.0, y, 0.0, 0.0, 0.25), True), ((0.75, 0.0, -0.4, 0.0, 0.25), False)):
        seen, world = observation(twist=(0.5, 0.8)), world_with(tracks=[there])
        verdict = monitor.check(asking(0.5, 0.8), seen, DT, scan_stamp=1.0, world=world)
        assert (verdict.reason == "") == free
    v, w = verdict.actuation.twist
    assert v < 0.5
    assert (w == 0.8) == turns_on


@pytest.mark.parametrize("lag", [0.0, 0.05, 0.1, 0.3])
@pytest.mark.parametrize("dt", [0.01, 0.05])
@pytest.mark.parametrize("v", [0.5, -0.2, 0.03])
def test_a_base_with_a_lag_stands_as_soon_as_it_can_and_creeps_no_further(lag, dt, v):
    """It crept on for three lags after its command was zero."""
    base = Base(msgspec.structs.replace(RobotProfile().base, velocity_lag=lag), dt)
    state, told, speeds = BaseState(pose=np.zeros(3), v=v), v, []
    for _ in range(round((abs(v) / 0.5 + 1.5 * lag + 3.0 * dt) / dt)):
        told = braked(told, state.v, 0.5 * dt, math.inf, lag_share(lag, dt))
        base.step(state, np.array([told, 0.0]))
        speeds.append(state.v * math.copysign(1.0, v))
    assert abs(state.v) < 0.002
    assert min(speeds) > -0.002
    assert braked(0.0, v, 0.5 * dt, 0.0, lag_share(lag, dt)) == 0.0  # that cannot go back


@pytest.mark.parametrize("known", [0.2, 0.5])
@pytest.mark.parametrize("twist", [(0.36, -0.4), (0.5, 0.0), (-0.2, 0.8)])
def test_a_base_that_was_found_late_stops_as_fast_as_its_limits_allow(twist, known):
    """Its command fell along the ramp of the limits, which a base with half a second of lag cannot follow."""
    base = RobotProfile().base
    late, why = late_stop(twist, known)
    ramp, _ = late_stop(twist, 0.0)
    ideal = np.array(twist) ** 2 / (2.0 * np.array([base.linear_acceleration, base.yaw_acceleration]))
    assert why.startswith("stopped")
    assert np.all(np.abs(late.way) < np.abs(ramp.way) + 1e-9)
    if known == 0.5:
        assert np.all(np.abs(late.way) < ideal + 0.06 * np.abs(twist) + 1e-9)
    assert np.all(late.back < 0.005)


def test_a_base_whose_lag_ends_while_it_stops_does_not_drive_the_other_way():
    stop, _ = late_stop((0.36, -0.4), 0.5, lag=0.0)
    assert np.all(stop.back < [0.5 * DT + 0.002, 1.8 * DT + 0.002])


def test_a_base_whose_lag_has_ended_goes_on_from_zero():
    """Its command had gone beyond zero; a ramp from there would drive it the other way first."""
    profile = RobotProfile()
    monitor = Monitor(profile)
    monitor.begin_from(np.array([0.3, 0.0]))
    seen = observation(twist=(0.2, 0.0))
    late = Reason(kind=Kind.BASE_LATE, subject="wheels", value=0.5, limit=0.1, unit="s")
    trust = Trust(base=0.0, reason=Reason(kind=Kind.STOPPED, subject="wheels", cause=late), lag=0.5)
    braking = monitor.check(asking(0.3), seen, DT, scan_stamp=seen.scan.stamp, trust=trust)
    assert braking.actuation.twist[0] < -0.05
    assert check(monitor, asking(0.3), seen).actuation.twist[0] > 0.0


class LateStop(NamedTuple):
    way: np.ndarray  # driven forward [m] and turned [rad]
    back: np.ndarray  # largest speeds [m/s, rad/s] against the motion


def late_stop(twist, known, lag=0.5):
    """Stop of a base with a lag [s] more than its profile has, of which the monitor knows some."""
    profile, sign = RobotProfile(), np.sign(twist)
    monitor, base = Monitor(profile), Base(profile.base, DT)
    monitor.begin_from(np.array(twist))
    state, way, back = BaseState(pose=np.zeros(3), v=twist[0], w=twist[1]), np.zeros(2), np.zeros(2)
    late = Reason(kind=Kind.BASE_LATE, subject="wheels", value=known, limit=0.1, unit="s")
    trust = Trust(base=0.0, reason=Reason(kind=Kind.STOPPED, subject="wheels", cause=late), lag=known)
    for _ in range(round(4.0 / DT)):
        seen = observation(twist=(state.v, state.w))
        verdict = monitor.check(asking(*twist), seen, DT, scan_stamp=seen.scan.stamp, trust=trust)
        base.step(state, verdict.actuation.twist, more_lag=lag)
        way += DT * np.array([state.v, state.w])
        back = np.maximum(back, -sign * [state.v, state.w])
    assert np.all(np.abs([state.v, state.w]) < 0.005)
    return LateStop(way, back), verdict.reason


def test_the_hand_counts_where_it_reaches_over_the_footprint():
    """Only the footprint did, and the hand was moved against a Temi."""
    robot = RobotProfile()
    stop, mount = stop_of(robot, 0.08), (robot.arm.mount_x, robot.arm.mount_y)
    ahead = overhang(np.array([0.0, 0.8, 0.0, -1.2, 0.0, 2.0, 0.8]), mount, stop)
    folded = overhang(np.array([0.0, -1.2, 0.0, -2.9, 0.0, 1.8, 0.8]), mount, stop)
    tip = ahead[:, 0].max()
    assert tip > 0.6 > folded[:, 0].max(initial=0.0)
    somebody = np.array([[tip + 0.35, 0.0, 0.0, 0.0, 0.25]])
    moves = ((0.0, 0.0, 0.0, 0.3, 0.0), (0.3, 0.0), BRAKES_BOTH, 0.0, somebody)
    assert met_in_stop(*moves, ahead, stop) == 0
    assert met_in_stop(*moves, NO_ARM, stop) == -1


def test_without_passive_safety_it_does():
    assert meet(1.5, -1.2, 0.0, 0.4, passive=False)[0] == "towards"


def test_it_says_why_it_brakes():
    result, said = meet(1.5, -1.2, 0.0, 0.4)
    assert result != "towards"
    assert any("would meet the base" in reason for reason in said)
