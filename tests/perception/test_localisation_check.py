"""Which of localisation, odometry and scan is right."""

import math

import numpy as np
import pytest

from motm_twin.model.motion import drive
from motm_twin.model.plant import Observation, Scan
from motm_twin.model.profile import BaseLimits
from motm_twin.perception.localisation_check import (
    LocalisationSettings,
    LocalisationState,
    correct,
    finding,
    limit_of,
    slips_since,
    vote,
)
from motm_twin.perception.sweeps import expected_ranges

DT, BEAMS = 0.01, 361
STEP = 2.0 * math.pi / (BEAMS - 1)
BASE, SETTINGS = BaseLimits(), LocalisationSettings()
ROOM = np.array([[-4.0, -3.0, 5.0, -3.0], [5.0, -3.0, 5.0, 3.0], [5.0, 3.0, -4.0, 3.0], [-4.0, 3.0, -4.0, -3.0]])
EMPTY = np.zeros((0, 4))


class Robot:
    """Drives straight on at 0.3 m/s; true pose, localised pose and odometry may differ."""

    def __init__(self, segments=ROOM):
        self.state, self.segments = LocalisationState(), segments
        self.true, self.odometry, self.error, self.time = np.zeros(3), np.zeros(3), np.zeros(3), 0.0
        self.found = []

    def step(self, count, *, drift=(0.0, 0.0, 0.0), grip=1.0, v=0.3):
        for _ in range(count):
            self.time += DT
            self.true = drive(self.true, grip * v, 0.0, DT)
            self.odometry = drive(self.odometry, v, 0.0, DT)
            self.error = self.error + DT * np.array(drift)
            now = Observation(
                time=self.time, pose=self.true + self.error, odometry=self.odometry, twist=np.array([v, 0.0]),
                q=np.zeros(7), dq=np.zeros(7), gripper_width=0.08, gripper_moving=False, scan=None, detections=(),
            )  # fmt: skip
            self.believed = correct(self.state, now, BASE, SETTINGS)
            if round(self.time / DT) % 5 == 0:
                ranges = expected_ranges(self.true, np.zeros(2), -math.pi, STEP, BEAMS, ROOM, 15.0)
                scan = Scan(
                    stamp=self.time, ranges=ranges, angle_min=-math.pi, angle_step=STEP, origin=np.zeros(2),
                    range_min=0.05, range_max=15.0, pose=now.pose,
                )  # fmt: skip
                vote(self.state, scan, now, self.segments, SETTINGS)
            one = finding(self.state, SETTINGS, limit_of(BASE, SETTINGS))
            self.found.append("" if one is None else one.kind)
            self.now = now
        return self

    def kinds(self):
        return set(self.found) - {""}


def test_a_healthy_robot_gets_its_own_observation_back():
    robot = Robot().step(300)
    assert robot.believed is robot.now and robot.kinds() == set()


@pytest.mark.parametrize("jump", [(0.3, 0.0), (0.0, -0.3), (0.1, 0.1), (-0.7, 0.7)])
def test_a_jump_of_localisation_is_named_within_a_moment_survived_and_forgiven(jump):
    robot = Robot().step(100)
    robot.error = np.array([*jump, 0.0])
    robot.step(30)
    assert robot.found[-1] == "pose_off"
    robot.step(100)
    assert math.dist(robot.believed.pose[:2].tolist(), robot.true[:2].tolist()) < 0.03
    robot.error = np.zeros(3)
    robot.step(50)
    assert robot.found[-1] == "" and robot.believed is robot.now


def test_localisation_that_drifts_off_is_named():
    robot = Robot().step(100).step(95, drift=(0.0, 0.1, 0.0))
    assert robot.found[-1] == "pose_off"
    assert abs(robot.believed.pose[1]) < 0.06


def test_a_push_is_believed_said_and_over():
    robot = Robot().step(100)
    robot.true = robot.true + np.array([0.0, 0.3, 0.2])
    robot.step(20)
    assert robot.found[-1] == "pushed"
    assert robot.believed is robot.now
    robot.step(200)
    assert robot.found[-1] == ""


@pytest.mark.parametrize("segments", [ROOM, EMPTY])
def test_wheels_that_slip_are_named_and_odometry_follows_localisation_meanwhile(segments):
    robot = Robot(segments).step(100)
    assert slips_since(robot.state) == -math.inf
    robot.step(120, grip=0.4)
    assert robot.found[-1] == "slip"
    assert 1.0 < slips_since(robot.state) < robot.time
    before = robot.believed.odometry.copy()
    robot.step(50, grip=0.4)
    assert robot.believed.odometry[0] - before[0] == pytest.approx(0.5 * 0.4 * 0.3, abs=0.005)
    robot.step(800)
    assert robot.found[-1] == ""
    assert slips_since(robot.state) == -math.inf


def test_odometry_that_leaps_is_left_out():
    robot = Robot().step(100)
    before = robot.believed.odometry.copy()
    robot.odometry = robot.odometry + np.array([0.2, -0.2, 0.0])
    robot.step(1)
    assert robot.found[-1] == "odometry_off"
    assert math.dist(robot.believed.odometry[:2].tolist(), before[:2].tolist()) < 0.01
    robot.step(300)
    assert robot.found[-1] == ""
    assert robot.kinds() == {"odometry_off"}


def test_a_push_where_nothing_is_mapped_is_believed_too():
    robot = Robot(EMPTY).step(100)
    robot.true = robot.true + np.array([0.2, 0.2, 0.0])
    robot.step(100)
    assert robot.believed is robot.now and robot.kinds() == {"pushed"}


@pytest.mark.parametrize("sd", [0.01, 0.02])
def test_usual_noise_of_localisation_raises_nothing(sd):
    rng, robot, keep = np.random.default_rng(1), Robot(), math.exp(-DT / 5.0)
    for _ in range(3000):
        robot.error = keep * robot.error + math.sqrt(1 - keep**2) * sd * np.array([*rng.standard_normal(2), 0.0])
        robot.step(1, v=0.001)
    assert robot.kinds() == set()
