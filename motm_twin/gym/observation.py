"""Observations of an agent, from the robot's knowledge, and an expert: a shipped method that acts on that knowledge.

Observations are float32 boxes and small discrete numbers, see docs/gym.md. The expert chooses the action of the next
step: for imitation, as a baseline, and to check that the environment is the same task as the loop's.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from motm_twin.control.arm.types import ArmGoal, ArmInputs, ArmObstacles, ArmStep, Phase
from motm_twin.control.method import ArmParts, PlannerParts
from motm_twin.control.predictor import dwell_to_plan, followed
from motm_twin.control.targets import world_in_odometry
from motm_twin.control.tick import Tick
from motm_twin.control.tuning import tuned
from motm_twin.gym.actions import BaseAction, check_fits
from motm_twin.methods.registry import find_method
from motm_twin.model.arm_kernels import TCP, fk_arm
from motm_twin.model.geometry import Array, from_frame, to_frame
from motm_twin.model.motion import command_pose
from motm_twin.model.plant import PERIOD, Observation, Scan
from motm_twin.model.profile import DQ_MAX, Q_MAX, Q_MIN, RobotProfile
from motm_twin.planning.types import BasePlan, BaseProblem, SearchBudget, Target
from motm_twin.twin import Twin


@dataclass(frozen=True, kw_only=True)
class AgentView:
    """The robot's knowledge at the end of a period, in the loop's own types."""

    observation: Observation
    tick: Tick | None  # of the last period; None after a reset
    pose: Array  # pose at which the next command acts (the lag of the base is compensated), world, shape (3,)
    twist: Array  # last command [m/s, rad/s], shape (2,)
    target: Target | None  # of the active task, world
    next_target: Target | None
    goal: ArmGoal  # of the hand for the active task, odometry frame
    next_goal: ArmGoal
    engaged: bool
    dwell: float  # [s]
    time_to_range: float  # [s]

    def problem(self) -> BaseProblem:
        """The planning problem of the base, as the loop hands it to a planner, on the map of the last period.

        Raises RuntimeError after a reset: there is no map before the first period.
        """
        if self.tick is None:
            raise RuntimeError("there is no map before the first step: step once, with an action of zeros")
        return BaseProblem(
            time=self.observation.time,
            world=self.tick.map,
            pose=self.pose,
            twist=self.twist,
            target=self.target,
            next_target=self.next_target,
            engaged=self.engaged,
            period=PERIOD,
        )


def view_of(twin: Twin, tick: Tick | None) -> AgentView:
    """The robot's present knowledge, after the period of this Tick."""
    loop, observation = twin.loop, twin.loop.believed()
    sequence, targets, twist = loop.sequence, loop.targets, loop.monitor.twist
    T_odom_world = world_in_odometry(observation)
    lag = loop.known.robot.base.velocity_lag
    pose = command_pose(observation.pose, observation.twist, lag)
    dwell = dwell_to_plan(None if tick is None or tick.arm[-1].outcome else tick.arm[-1].dwell, loop.engaged, lag)
    target = targets.base_target(sequence.active, observation, dwell)
    controller = loop.planner.controller
    assert isinstance(controller, BaseAction)
    times, poses = controller.forecast.motion(pose, twist, controller.twist)
    return AgentView(
        observation=observation,
        tick=tick,
        pose=pose,
        twist=twist,
        target=target,
        next_target=targets.base_target(sequence.following, observation, None),
        goal=targets.arm_goal(sequence.active, sequence.held, observation, T_odom_world),
        next_goal=targets.arm_goal(sequence.following, "", observation, T_odom_world),
        engaged=loop.engaged,
        dwell=0.0 if target is None else target.dwell,
        time_to_range=controller.forecast.time_to_range(times, poses, target),
    )


try:
    import gymnasium
except ImportError as error:
    raise ImportError(
        f"motm_twin.gym needs Gymnasium, which is not installed: {sys.executable} -m pip install 'gymnasium>=1.0'"
    ) from error

spaces = gymnasium.spaces
TASKS = ("none", "pick", "place", "drive")
PHASES = tuple(Phase)
FAR = 50.0  # [m] at which positions are clipped
LATE = 60.0  # [s] at which times are clipped
SPEED_ROOM = 1.5  # bounds of measured speeds, as a multiple of the robot's limits: room for noise and lag

Observed = dict[str, Any]


class Now(NamedTuple):
    """Inputs of one observation."""

    view: AgentView
    seen: Observation
    arm: ArmStep | None  # of the last period
    limit: float  # [s] of the episode
    tasks: int


class ObservationReader:
    """Turns the robot's knowledge into arrays of fixed shapes."""

    def __init__(self, robot: RobotProfile, beams: int) -> None:
        """``beams``: number of equal sectors round the base; the nearest return of each is observed."""
        if beams < 1:
            raise ValueError(f"{beams} lidar beams: at least one is needed")
        self._robot, self._beams = robot, beams
        arm = robot.arm
        self._mount = np.array([arm.mount_x, arm.mount_y, arm.mount_z])
        self._sectors: tuple[Any, NDArray[np.int64], NDArray[np.int64]] | None = None  # of the last scan's angles
        self.range_max = robot.lidar.range_max
        self._entries = self._table()
        self.space = spaces.Dict({name: space for name, (space, _) in self._entries.items()})

    def read(self, view: AgentView, *, limit: float, tasks: int) -> Observed:
        """The observation; ``limit`` [s] of the episode, ``tasks``: length of the task list."""
        now = Now(view, view.observation, None if view.tick is None else view.tick.arm[-1], limit, tasks)
        return {name: _fitted(space, self._entries[name][1](now)) for name, space in self.space.spaces.items()}

    def _ranges(self, scan: Scan | None) -> Array:
        """The nearest return [m] of every sector, from straight behind counter-clockwise.

        Beams that the loop ignores (`CheckedScan`), such as nan, are no returns.
        """
        ranges = np.full(self._beams, self._robot.lidar.range_max)
        if scan is not None:
            sectors, starts = self._sectors_of(scan)
            returns = np.where(scan.ranges >= scan.range_min, scan.ranges, np.inf)
            ranges[sectors] = np.minimum(np.minimum.reduceat(returns, starts), ranges[sectors])
        return ranges

    def _sectors_of(self, scan: Scan) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sectors that a scan covers, and the first beam of each."""
        kind = (len(scan.ranges), scan.angle_min, scan.angle_step)
        if self._sectors is None or self._sectors[0] != kind:
            angles = scan.angle_min + scan.angle_step * np.arange(len(scan.ranges))
            share = (angles + math.pi) / (2.0 * math.pi)
            sector = np.clip(np.floor(share * self._beams).astype(np.int64), 0, self._beams - 1)
            self._sectors = (kind, *np.unique(sector, return_index=True))
        return self._sectors[1:]

    def _table(self) -> dict[str, tuple[spaces.Space, Callable[["Now"], Any]]]:
        """Space and value of every entry."""
        base, lidar, mount = self._robot.base, self._robot.lidar, self._mount
        fastest = SPEED_ROOM * np.array([base.full_speed, base.yaw_rate])
        point, unit, times = _box([-FAR, -FAR, 0.0], [FAR, FAR, 5.0]), _box([0.0], [1.0]), _box([0.0], [LATE])
        yes_or_no, task = spaces.Discrete(2), spaces.Discrete(len(TASKS))
        sectors = _box([0.0] * self._beams, [lidar.range_max] * self._beams)
        return {
            "pose": (_box([-FAR, -FAR, -1.0, -1.0], [FAR, FAR, 1.0, 1.0]), _pose),
            "twist": (_box(-fastest, fastest), lambda now: now.seen.twist),
            "command": (_box(-fastest, fastest), lambda now: now.view.twist),
            "task": (task, lambda now: _task(now.view.target)),
            "target": (point, lambda now: _place(now.view.target, now.view.goal, now.seen)),
            "target_turn": (_box([-1.0, -1.0], [1.0, 1.0]), lambda now: _turn(now.view.goal, now.seen.odometry)),
            "target_sd": (unit, lambda now: now.view.goal.position_sd),
            "next_task": (task, lambda now: _task(now.view.next_target)),
            "next_target": (point, lambda now: _place(now.view.next_target, now.view.next_goal, now.seen)),
            "time_to_range": (times, lambda now: now.view.time_to_range),
            "dwell": (times, lambda now: now.view.dwell),
            "lidar": (sectors, lambda now: self._ranges(now.seen.scan)),
            "joints": (_box(Q_MIN - 0.1, Q_MAX + 0.1), lambda now: now.seen.q),
            "joint_rates": (_box(-SPEED_ROOM * DQ_MAX, SPEED_ROOM * DQ_MAX), lambda now: now.seen.dq),
            "hand": (_box([-2.0, -2.0, -0.5], [2.0, 2.0, 2.0]), lambda now: mount + fk_arm(now.seen.q)[TCP, :3, 3]),
            "gripper": (_box([0.0], [0.1]), lambda now: now.seen.gripper_width),
            "phase": (spaces.Discrete(len(PHASES)), lambda now: PHASES.index(now.arm.phase if now.arm else Phase.STOW)),
            "engaged": (yes_or_no, lambda now: now.view.engaged),
            "holding": (yes_or_no, lambda now: now.arm is not None and now.arm.holding),
            "time_left": (unit, lambda now: 1.0 - now.seen.time / now.limit),
            "progress": (unit, _progress),
        }


def _fitted(space: spaces.Space, value: Any) -> Any:
    """The value as float32, clipped to the bounds of a box, or as an integer of a discrete space."""
    if not isinstance(space, spaces.Box):
        return np.int64(value)
    return np.clip(np.atleast_1d(np.asarray(value, dtype=np.float32)), space.low, space.high)


def _pose(now: Now) -> tuple[float, ...]:
    x, y, heading = now.seen.pose
    return x, y, math.cos(heading), math.sin(heading)


def _progress(now: Now) -> float:
    tick = now.view.tick
    done = 0 if tick is None else sum(task.status in ("done", "failed") for task in tick.tasks)
    return done / max(1, now.tasks)


def _box(low: Any, high: Any) -> spaces.Box:
    return spaces.Box(np.asarray(low, dtype=np.float32), np.asarray(high, dtype=np.float32), dtype=np.float32)


def _task(target: Target | None) -> int:
    return TASKS.index("none" if target is None else target.kind)


def _place(target: Target | None, goal: ArmGoal, now: Observation) -> Array:
    """Position of a target in the base frame, z above the floor [m], shape (3,); zeros without one."""
    if goal.kind != "none":
        return to_frame(now.odometry, goal.position)
    if target is None:
        return np.zeros(3)
    return np.array([*to_frame(now.pose, target.position), 0.0])


def _turn(goal: ArmGoal, odometry: Array) -> tuple[float, float]:
    """Cosine and sine of four times the yaw of a cube or bin in the base frame: the same after a quarter turn."""
    if goal.kind == "none":
        return 0.0, 0.0
    yaw = 4.0 * (goal.yaw - float(odometry[2]))
    return math.cos(yaw), math.sin(yaw)


class Acting(Protocol):
    """The parts of `MotmEnv` that an expert needs."""

    whole_body: bool
    twin: Twin
    view: AgentView
    action_space: Any


class Expert:
    """A method that chooses actions from the robot's knowledge. For one episode: make a new one after every reset."""

    def __init__(self, env: Acting, method: str = "motm") -> None:
        """Make an expert for ``env.unwrapped``, after its `reset`. Raises ValueError for an unfit method."""
        chosen = find_method(method)
        check_fits(chosen, whole_body=env.whole_body)
        numbers = tuned(chosen.parameters)
        self._env, self._known = env, env.twin.loop.known
        parts = PlannerParts(known=self._known, parameters=numbers.planning, tracks=numbers.tracks)
        self._planner = chosen.planner(parts)
        self._arm = chosen.arm(ArmParts(known=self._known, parameters=numbers.arm))

    def action(self) -> NDArray[np.float32]:
        """The action for the next step; zeros for the first one, before which there is no map."""
        space = self._env.action_space
        assert space.shape is not None
        action, view = np.zeros(space.shape), self._env.view
        if view.tick is None:
            return action.astype(np.float32)
        problem = view.problem()
        _, plan = self._planner.plan(problem, SearchBudget())
        twist = problem.twist + plan.acceleration * PERIOD
        if len(action) > 2:
            step = self._arm.step(_inputs(view, plan, twist, self._known.robot.base.velocity_lag))
            twist = step.actuation.twist
            action[2:9] = step.actuation.joint_velocity / DQ_MAX
            action[9] = 1.0 if step.actuation.gripper == "close" else -1.0
        base = self._known.robot.base
        speed = base.forward_speed if twist[0] > 0.0 else base.reverse_speed
        action[:2] = float(twist[0]) / speed if speed > 0.0 else 0.0, float(twist[1]) / base.yaw_rate
        return np.clip(action, -1.0, 1.0).astype(np.float32)


def _inputs(view: AgentView, plan: BasePlan, twist: Array, lag: float) -> ArmInputs:
    """Inputs of an arm step that lasts one period."""
    assert view.tick is not None
    T_odom_world, world = world_in_odometry(view.observation), view.tick.map
    poses = np.array(plan.local_poses, dtype=float)
    poses[:, :2] = from_frame(T_odom_world, poses[:, :2])
    poses[:, 2] += T_odom_world[2]
    time_to_range, plan_times = followed(plan, lag)
    return ArmInputs(
        observation=view.observation,
        dt=PERIOD,
        goal=view.goal,
        base_twist=twist,
        time_to_range=time_to_range,
        plan_times=plan_times,
        plan_poses=poses,
        obstacles=ArmObstacles.of(world, T_odom_world),
        T_odom_world=T_odom_world,
    )
