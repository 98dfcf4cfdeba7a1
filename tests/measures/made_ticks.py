"""Ticks of made-up motions: what a base, its gripper and agents do is given as functions of time."""

import math

import msgspec
import numpy as np

from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.arm.types import ArmStep, ProgramStatus
from motm_twin.control.tick import TaskState, Tick
from motm_twin.measures import Measures
from motm_twin.model.kinematics import Frankie
from motm_twin.model.plant import Actuation, BodyTruth, Observation, Truth
from motm_twin.model.scene import Agent
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.types import BasePlan, empty_path

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
    """The report of a run of so many seconds; ``pose(t)`` of the base, ``agents``: name to position(t)."""
    agents = agents or {}
    made = tuple(Agent(name=name, start=(*at(0.0), 0.0), radius=RADIUS) for name, at in agents.items())
    start = tuple(map(float, pose(0.0)))
    scene = msgspec.structs.replace(load_scene("exp1"), start=start, agents=made)
    measures = Measures(scene, AvoidanceParameters())
    for index in range(round(seconds / PERIOD) + 1):
        measures.add(_tick(index, pose, agents, phase, in_reach, task))
    return measures.report()


def _tick(index, pose, agents, phase, in_reach, task):
    t = round(index * PERIOD, 9)
    return Tick(
        index=index, time=t, observation=_observation(t, pose(t)), map=None, tasks=TASKS, task_index=task(t),
        beliefs=(), placement=None, plan=_plan(0.0 if in_reach(t) else math.inf), arm=(_arm(t, phase(t)),) * 5,
        why=None, events=(), edits=(), stage_ms={}, truth=_truth(t + PERIOD, pose, agents), done=False,
        success=False,
    )  # fmt: skip


def _observation(t, pose):
    zeros = np.zeros(2)
    return Observation(
        time=t, pose=np.array(pose), odometry=np.array(pose), twist=zeros, q=Q, dq=np.zeros(7), gripper_width=0.08,
        gripper_moving=False, scan=None, detections=(),
    )  # fmt: skip


def _plan(time_to_range):
    zeros, none = np.zeros(3), empty_path()
    return BasePlan(
        acceleration=zeros[:2], status="goal", global_path=none, next_path=none, intermediate_goal=zeros,
        local_poses=np.zeros((0, 5)), local_times=np.zeros(0), bezier=none, expansions=1, cut_by_clock=False, t_h=1.0,
        k=1.0, time_to_range=time_to_range,
    )  # fmt: skip


def _arm(t, phase):
    return ArmStep(
        time=t, phase=phase, actuation=Actuation(twist=np.zeros(2), joint_velocity=np.zeros(7), gripper="open"),
        reference=np.zeros(3), error=0.0, tilt=0.0, slack=np.zeros(6), manipulability=0.1, active=(), limiter="",
        obstacle_distance=math.inf, allowed_approach=math.inf, program=ProgramStatus.SOLVED, holding=False,
        engaged=False, dwell=0.0, outcome="",
    )  # fmt: skip


def _truth(t, pose, agents):
    gripper = gripper_at(pose(t))
    bodies = tuple(
        BodyTruth(name=name, kind="temi", position=(*map(float, at(t)), 0.0), yaw=0.0, size=(0.5, 0.5, 1.0))
        for name, at in agents.items()
    )
    gaps = [max(0.0, math.dist(gripper, body.position[:2]) - RADIUS) for body in bodies]
    nearest = min(gaps, default=math.inf)
    return Truth(
        pose=np.array(pose(t), dtype=float), objects=(), agents=bodies, obstacles=(), contacts=(), picks=0, places=0,
        drops=0, min_base_clearance=math.inf, min_arm_clearance=math.inf, min_ee_obstacle=nearest, ee_obstacle=nearest,
        plant_faults=(),
    )  # fmt: skip
