"""Measures of made-up runs, of which everything is known, also among people, and of a real one."""

import functools
import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.tick import TaskState
from motm_twin.measures import Measures
from motm_twin.model.kinematics import Frankie
from motm_twin.model.plant import BodyTruth
from motm_twin.model.scene import Agent
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.tracks import TrackParameters
from motm_twin.trial import run_scene
from motm_twin.twin import Twin

PERIOD = 0.05  # [s]
Q = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.785])
RADIUS = 0.25  # [m] of agents
HALF_LENGTH = 0.35  # [m] of the base, from its centre to its front
TASKS = (
    TaskState(kind="pick", target="F1", status="done", attempts=3),
    TaskState(kind="place", target="drop1", status="done", attempts=1),
)
FRANKIE = Frankie(load_scene("exp1").robot)


def gripper_at(pose):
    """The gripper centre [m] with the arm as it always is here, shape (2,)."""
    return FRANKIE.tcp_pose(np.array(pose, dtype=float), Q)[0][:2]


def measured(seconds, pose, *, agents=None, phase=lambda t: "stow", in_reach=lambda t: False, task=lambda t: 0):
    """The report of a made-up run of so many seconds; ``pose(t)`` of the base, ``agents``: name to position(t)."""
    agents = agents or {}
    made = tuple(Agent(name=name, start=(*at(0.0), 0.0), radius=RADIUS) for name, at in agents.items())
    start = tuple(map(float, pose(0.0)))
    scene = replace(load_scene("exp1"), start=start, agents=made)
    measures = Measures(scene, AvoidanceParameters())
    for index in range(round(seconds / PERIOD) + 1):
        t = round(index * PERIOD, 9)
        like, at = first_tick(), np.array(pose(t), dtype=float)
        measures.add(replace(
            like, index=index, time=t, tasks=TASKS, task_index=task(t),
            observation=replace(like.observation, time=t, pose=at, odometry=at, q=Q),
            plan=replace(like.plan, time_to_range=0.0 if in_reach(t) else math.inf),
            arm=(replace(like.arm[-1], time=t, phase=phase(t)),) * 5, truth=truth(t + PERIOD, pose, agents),
        ))  # fmt: skip
    return measures.report()


@functools.cache
def first_tick():
    """A real one, whose motions are made up."""
    return Twin(load_scene("exp1")).advance()


def truth(t, pose, agents):
    bodies = tuple(
        BodyTruth(name=name, kind="temi", position=(*map(float, at(t)), 0.0), yaw=0.0, size=(0.5, 0.5, 1.0))
        for name, at in agents.items()
    )
    gaps = (max(0.0, math.dist(gripper_at(pose(t)), body.position[:2]) - RADIUS) for body in bodies)
    at, nearest = np.array(pose(t), dtype=float), min(gaps, default=math.inf)
    return replace(first_tick().truth, pose=at, agents=bodies, min_ee_obstacle=nearest, ee_obstacle=nearest)


TIME = 0.06  # [s] by which a boundary between two motions may be counted on the other side


def stands(t):
    return (0.0, 0.0, 0.0)


def straight(speed):
    return lambda t: (speed * t, 0.0, 0.0)


def pieces(*parts):
    """A pose over time from (seconds, v, w) one after another: v along the heading, turns on the spot only."""

    def pose(t):
        x = y = heading = 0.0
        for seconds, v, w in parts:
            spent = min(max(t, 0.0), seconds)
            x, y = x + v * spent * math.cos(heading), y + v * spent * math.sin(heading)
            heading += w * spent
            t -= seconds
        return (x, y, heading)

    return pose


def test_both_splits_put_every_second_where_it_belongs():
    motion = pieces((2.0, 0.5, 0.0), (1.0, 0.3, 0.0), (0.5, 0.0, 1.0), (1.0, -0.2, 0.0), (2.5, 0.0, 0.0))
    phase = lambda t: "closing" if 0.4 <= t < 1.2 else "final" if 4.5 <= t < 6.0 else "stow"  # noqa: E731
    found = measured(7.0, motion, phase=phase, task=lambda t: int(t >= 3.0))
    assert found["phases_s"] == pytest.approx(
        {"driving": 3.7, "closing": 0.8, "waiting_for_arm": 1.5, "stationary": 1.0}, abs=TIME
    )
    assert found["parts_s"] == pytest.approx(
        {
            "at_limit": 2.0, "below_limit": 1.0, "turning": 0.5, "reversing": 1.0, "waiting_for_arm": 1.5,
            "standing": 1.0, "evading": 0.0,
        },
        abs=TIME,
    )  # fmt: skip
    assert sum(found["phases_s"].values()) == pytest.approx(7.0, abs=1e-6)
    assert sum(found["parts_s"].values()) == pytest.approx(7.0, abs=1e-6)
    assert [leg["time_s"] for leg in found["legs"]] == pytest.approx([3.0, 4.0], abs=TIME)
    assert [leg["path_m"] for leg in found["legs"]] == pytest.approx([1.3, 0.2], abs=0.03)
    assert found["closing_base_speed_mps"] == {"mean": 0.5, "min": 0.5, "max": 0.5}
    assert found["moving_share"] == pytest.approx(4.5 / 7.0, abs=0.01)
    assert found["retries"] == 2


def test_a_base_that_stands_with_the_target_in_reach_waits_for_the_arm_also_before_it_leaves():
    found = measured(1.0, stands, in_reach=lambda t: t >= 0.5)
    assert found["phases_s"]["waiting_for_arm"] == pytest.approx(0.5, abs=TIME)
    assert found["phases_s"]["stationary"] == pytest.approx(0.5, abs=TIME)
    assert found["closing_base_speed_mps"] is None


def crossing(ahead, speed=0.5):
    """The base drives along y across the way of an agent on the x axis, ``ahead`` [m] of free way in front of it."""
    x = ahead + RADIUS + 0.25  # half of the base's width
    return lambda t: (x + 0.4 * 3.0, -1.5 + speed * t, math.pi / 2)


def temi(t):
    """Along x at 0.4 m/s; it has gone 1.2 m when the base of `crossing` is in front of it."""
    return (0.4 * t, 0.0)


def bent(start, speed, turns):
    """The way of an agent with this speed: its course [rad] is 0 before and after ``turns``: (from s, to s, rad)."""
    times = np.arange(0.0, 20.0, 0.01)
    course = sum(np.interp(times, (begin, end), (0.0, angle)) for begin, end, angle in turns) + np.zeros_like(times)
    x, y = (np.concatenate([[0.0], np.cumsum(0.01 * speed * part)])[:-1] for part in (np.cos(course), np.sin(course)))
    return lambda t: (start[0] + float(np.interp(t, times, x)), start[1] + float(np.interp(t, times, y)))


def slides_in(along, at=0.8):
    """The base gets in front of `temi` from the side, ``at`` [m] before it at first, with ``along`` [m/s] its way."""
    return lambda t: (RADIUS + HALF_LENGTH + at + along * t, -0.9 + 0.2 * t, 0.0)


PASSED = pieces((5.0, 0.3, 0.0), (6.0, 0.15, 0.0))
STOOD = pieces((3.0, 0.5, 0.0), (1.0, 0.0, 0.0), (3.0, 0.1, 0.0))
LATELY = bent((0.0, 0.0), 0.4, [(0.0, 0.01, -math.pi / 3), (0.6, 1.6, math.pi / 3)])
FRONT = RADIUS + HALF_LENGTH  # [m] between the centres when the base is ahead of an agent that touches it
CUT_INS = {  # seconds, base, agent, cut-ins
    "the base crosses close in front of it": (4.0, crossing(0.45), temi, 1),
    "far in front of it": (4.0, crossing(1.3), temi, 0),
    "close in front of one that stands": (4.0, crossing(0.45), lambda t: (1.2, 0.0), 0),
    "close in front of one that turned a moment ago": (
        4.0, lambda t: (LATELY(3.0)[0] + RADIUS + 0.7, LATELY(3.0)[1] - 1.5 + 0.5 * t, math.pi / 2), LATELY, 1),
    # Experiment 2, seed 2, `motm`, at 15.70 s: the Temi stood while the base passed in front of it
    "behind the base it drives off": (
        4.0, lambda t: (0.9, -1.5 + 0.5 * t, math.pi / 2), lambda t: (0.4 * max(0.0, t - 3.0), 0.0), 0),
    "it drives up to a base that stands": (2.0, lambda t: (FRONT + 1.0, 0.0, 0.0), temi, 0),
    "to one that drives ahead": (2.0, lambda t: (FRONT + 1.0 + 0.2 * t, 0.0, 0.0), temi, 0),
    # it had five seconds; that the base then leaves again across its way is no cut-in either
    "to one that came to stand in its way": (5.5, lambda t: (2.3, STOOD(t)[0] - 1.5, math.pi / 2), temi, 0),
    "from the side, slower than it follows": (4.0, slides_in(0.3, 0.6), temi, 1),
    "from the side, faster than it follows": (4.0, slides_in(0.5, 0.1), temi, 0),
    # Experiment 2, seed 0, `motm`, at 55.80 s: the base was 0.12 m/s faster along the course of the Temi
    "it turns in behind a base that leaves": (
        5.0, lambda t: (0.2 + 0.41 * t, 0.0, 0.0),
        bent((-0.9, 0.9), 0.3, [(0.0, 0.01, -math.pi / 2), (1.0, 2.5, math.pi / 2)]), 0),
    # it was two within 1.55 s: half a second outside was enough to count anew
    "a base that hovers at the border of its way": (
        9.0, lambda t: (FRONT + 0.55 + 0.35 * t, 0.55 + 0.15 * math.cos(math.pi * t), 0.0), temi, 1),
}  # fmt: skip


@pytest.mark.parametrize(("seconds", "base", "agent", "count"), CUT_INS.values(), ids=CUT_INS)
def test_crossing_close_in_front_of_a_moving_agent_is_a_cut_in(seconds, base, agent, count):
    found = measured(seconds, base, agents={"temi": agent})["cut_ins"]
    assert [cut["agent"] for cut in found] == ["temi"] * count


@pytest.mark.parametrize(
    ("seconds", "base", "agent"),
    [
        # the base drives across its way, but the way came to the base
        (4.0, straight(0.3), bent((0.6, 1.0), 0.4, [(1.0, 2.1, math.radians(-100.0))])),
        # without its turn after the base, which passed far ahead, it would have gone on behind it
        (10.5, lambda t: (PASSED(t)[0] - 1.2, 0.0, 0.0),
         bent((0.0, -4.2), 0.4, [(0.0, 0.01, math.pi / 2), (4.5, 6.5, -math.pi / 6)])),
    ],
)  # fmt: skip
def test_an_agent_that_turns_onto_a_base_is_not_cut_in_on_but_comes_close(seconds, base, agent):
    found = measured(seconds, base, agents={"temi": agent})
    assert found["cut_ins"] == []
    assert found["near_misses"]


def test_after_they_have_parted_a_second_crossing_counts_anew():
    def twice(t):
        x, y, heading = crossing(0.45)(min(t, 7.0))
        return (x, y, heading) if t < 7.0 else (x + 3.2, y - 0.5 * (t - 7.0), -heading)

    cuts = measured(14.0, twice, agents={"temi": temi})["cut_ins"]
    assert len(cuts) == 2
    assert cuts[1]["time"] - cuts[0]["time"] > 5.0


def test_a_cut_in_is_told_as_it_was_when_it_began_and_how_near_it_came():
    (cut,) = measured(4.0, crossing(0.3), agents={"temi": temi})["cut_ins"]
    assert cut["gap_m"] <= 0.6
    assert cut["gap_s"] == pytest.approx(cut["gap_m"] / 0.4, abs=0.01)
    assert cut["gap_s"] == pytest.approx(1.5, abs=0.13)  # a period of 50 ms at 0.4 m/s
    assert cut["least_gap_m"] < cut["gap_m"] - 0.1


def test_a_near_miss_is_a_small_gap_to_a_base_that_moves():
    beside = {"temi": lambda t: (1.0, 0.25 + RADIUS + 0.06)}
    found = measured(4.0, straight(0.5), agents=beside)["near_misses"]
    assert len(found) == 1
    assert found[0]["gap_m"] == pytest.approx(0.06, abs=1e-3)
    corner = 1.0 - math.sqrt((RADIUS + 0.10) ** 2 - (RADIUS + 0.06) ** 2)  # where the front left one is 0.10 m away
    assert found[0]["time"] == pytest.approx((corner - HALF_LENGTH) / 0.5, abs=0.06)
    assert measured(4.0, lambda t: (1.0, 0.0, 0.0), agents=beside)["near_misses"] == []


def test_braking_for_an_agent_is_an_evasive_manoeuvre_until_it_has_gone():
    def brakes(t):
        return (0.5 * min(t, 1.5) + 0.5 * max(0.0, t - 5.0), 0.0, 0.0)

    found = measured(8.0, brakes, agents={"temi": lambda t: (2.0, -1.5 + 0.5 * t)})  # through the way of the base
    (manoeuvre,) = found["evasive_manoeuvres"]
    assert manoeuvre["agent"] == "temi"
    assert manoeuvre["time"] == pytest.approx(1.5, abs=0.1)
    assert 1.0 < manoeuvre["duration_s"] < 4.5
    assert found["parts_s"]["evading"] == pytest.approx(manoeuvre["duration_s"], abs=0.1)
    assert found["parts_s"]["standing"] < 2.5


def test_driving_on_past_an_agent_that_is_no_danger_is_no_manoeuvre():
    found = measured(4.0, straight(0.5), agents={"temi": lambda t: (1.0 - 0.4 * t, 2.0)})
    assert found["evasive_manoeuvres"] == []
    assert found["parts_s"]["evading"] == 0.0


def test_who_came_nearer_is_the_cause_of_a_stretch_below_d_s():
    x, y = gripper_at((0.0, 0.0, 0.0))
    start = 0.8  # [m] from the gripper to the agent's edge
    agent = {"temi": lambda t: (x + RADIUS + start - 0.4 * min(t, 1.5), y)}
    found = measured(3.0, stands, agents=agent)
    (stretch,) = found["below_d_s"]
    assert stretch["cause"] == stretch["other"] == "temi"
    assert stretch["min_m"] == pytest.approx(0.2, abs=1e-3)
    assert stretch["time"] == pytest.approx((start - 0.25) / 0.4, abs=0.06)
    assert not stretch["static"]
    assert found["min_gripper_obstacle_m"] == pytest.approx(0.2, abs=1e-3)

    first = {"temi": lambda t: (x + RADIUS + start + 0.3 - 0.3 * min(t, 1.0), y)}  # then it stands
    found = measured(3.0, lambda t: (0.3 * min(t, 2.0), 0.0, 0.0), agents=first)
    assert [stretch["cause"] for stretch in found["below_d_s"]] == ["gripper"]


def test_the_excess_is_the_grippers_own_speed_over_the_damper_line():
    x, y = gripper_at((0.0, 0.0, 0.0))

    agents = {"temi": lambda t: (x + RADIUS + 0.95 - 0.4 * min(t, 1.0), y)}  # moved lately, then stands 0.55 m away

    def approach(t, sign=1.0):
        return (sign * 0.5 * max(0.0, t - 1.0), 0.0, 0.0)

    found = measured(1.5, approach, agents=agents)
    least = 0.55 - 0.5 * 0.5  # [m] at the end; the last mean distance is half a period before
    line = 0.6 * (least + 0.5 * 0.5 * 0.05 - 0.25) / (0.6 - 0.25)
    assert found["approach_excess_mps"] == pytest.approx(0.5 - line, abs=2e-3)
    assert found["advance_excess_mps"] == found["approach_excess_mps"]
    away = measured(1.5, lambda t: approach(t, -1.0), agents=agents)
    assert away["approach_excess_mps"] < 0.0


WAITS = TrackParameters().rests


@pytest.mark.parametrize(
    ("moves", "creeps", "approaches", "judged"),
    [
        (1.0, 0.0, 1.0 + 4.0, True),  # it has moved: after 3 s it is not static yet
        (1.0, 0.0, 1.0 + WAITS - 1.5, True),
        (1.0, 0.0, 1.0 + WAITS + 0.2, False),
        (1.0, 0.01, 1.0 + WAITS + 0.2, True),  # it creeps on with 1 cm/s
        (0.0, 0.0, 1.0, True),  # it has never moved, but has not been there for 3 s either
        (0.0, 0.0, 3.1, False),
    ],
)
def test_what_has_moved_is_static_when_it_is_for_the_loop(moves, creeps, approaches, judged):
    """The gripper drives at it for a second; with a rule of 3 s for everything the damper line did not count."""
    x, y = gripper_at((0.0, 0.0, 0.0))

    def agent(t):
        return (x + RADIUS + 0.9 + 0.3 * max(0.0, moves - t) + 0.001, y + creeps * t)

    found = measured(approaches + 1.0, lambda t: (0.5 * max(0.0, t - approaches), 0.0, 0.0), agents={"temi": agent})
    assert (found["approach_excess_mps"] is not None) == judged
    assert not judged or found["approach_excess_mps"] > 0.02


def test_what_the_arm_feels_is_the_acceleration_of_its_foot():
    found = measured(1.0, lambda t: (0.25 * t * t, 0.0, 0.0))
    assert found["arm_base_acceleration_mps2"] == pytest.approx({"max": 0.5, "p99": 0.5}, abs=1e-3)
    w, v = 1.0, 0.4
    circle = measured(2.0, lambda t: (v / w * math.sin(w * t), v / w * (1 - math.cos(w * t)), w * t))
    felt = w * math.hypot(v, 0.15 * w)  # centripetal, of a point 0.15 m ahead of the axle
    assert circle["arm_base_acceleration_mps2"]["max"] == pytest.approx(felt, rel=0.01)


def test_zigzag_is_counted_per_metre_and_a_curve_is_none():
    found = measured(4.0, lambda t: (0.5 * t, 0.0, 0.1 * math.sin(math.pi * t)))
    assert found["yaw_sign_changes"] == 4
    assert found["yaw_sign_changes_per_m"] == pytest.approx(2.0, abs=0.1)
    assert measured(2.0, lambda t: (np.sin(t), 1 - np.cos(t), t))["yaw_sign_changes"] == 0


def test_a_real_trial_has_measures_that_add_up():
    scene = load_scene(str(Path(__file__).parents[1] / "studies" / "half_a_metre.yaml"))
    result = run_scene(scene)
    found = result["measures"]
    for split in (found["phases_s"], found["parts_s"], {leg["task"]: leg["time_s"] for leg in found["legs"]}):
        assert sum(split.values()) == pytest.approx(result["time_s"], abs=1e-6)
    assert sum(leg["path_m"] for leg in found["legs"]) == pytest.approx(result["path_length_m"], abs=0.03)
    assert found["min_gripper_obstacle_m"] is None


def among(seconds, pose, agents, **more):
    return measured(seconds, pose, agents=agents, **more)["among_people"]


def test_distance_and_time_to_collision_are_those_of_two_who_meet_head_on():
    found = among(2.0, lambda t: (0.4 * t, 0.0, 0.0), {"a": lambda t: (4.0 - 0.6 * t, 0.0)})
    gap = 4.0 - 2.0 * 1.0 - HALF_LENGTH - RADIUS
    assert found["least_gap_m"] == pytest.approx(gap, abs=0.06)
    assert found["least_time_to_collision_s"] == pytest.approx(gap / 1.0, abs=0.11)
    assert found["discomfort_s"] == 0.0


def test_discomfort_is_the_time_within_20_cm():
    found = among(4.0, lambda t: (0.0, 0.0, 0.0), {"a": lambda t: (0.5 * t - 1.0, 0.25 + RADIUS + 0.1)})
    sideways = math.sqrt((RADIUS + 0.2) ** 2 - (RADIUS + 0.1) ** 2)
    assert found["discomfort_s"] == pytest.approx(2.0 * (HALF_LENGTH + sideways) / 0.5, abs=0.15)
    assert found["least_gap_m"] == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize(
    ("robot", "agent", "who"), [(1, 0, "robot"), (0, 1, "agent"), (1, 1, "both"), (0, 0, "nobody")]
)
def test_who_turns_aside_made_way(robot, agent, who):
    def base(t):  # turns left on a circle, or goes straight on
        return (math.sin(0.5 * t), 1.0 - math.cos(0.5 * t), 0.5 * t) if robot and t > 0.3 else (0.5 * t, 0.0, 0.0)

    def other(t):
        return 2.6 - 0.5 * t, -0.5 * agent * max(0.0, t - 0.3)

    found = among(2.5, base, {"a": other})
    first = found["conflicts"][0]
    assert first["made_way"] == who
    assert first["predicted_gap_m"] < 0.3
    assert (first["gained_by_robot_m"] > 0.05) == bool(robot)
    assert (first["gained_by_agent_m"] > 0.05) == bool(agent)


def test_two_who_pass_far_apart_have_no_conflict_and_no_time_to_collision():
    found = among(3.0, lambda t: (0.4 * t, 0.0, 0.0), {"a": lambda t: (3.0 - 0.4 * t, 2.0)})
    assert found["conflicts"] == []
    assert found["least_time_to_collision_s"] is None


def test_a_base_that_stands_freezes_but_not_while_it_waits_for_its_arm():
    still = (0.0, 0.0, 0.0)
    assert among(2.0, lambda t: still, {})["freezing_s"] == pytest.approx(2.0)
    assert among(2.0, lambda t: still, {}, in_reach=lambda t: True)["freezing_s"] == 0.0
    assert among(2.0, lambda t: (0.4 * t, 0.0, 0.0), {})["freezing_s"] == 0.0
