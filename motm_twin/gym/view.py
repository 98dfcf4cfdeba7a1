"""Knowledge of the robot between two periods, from which an agent chooses its action. No ground truth is in it."""

from dataclasses import dataclass

from motm_twin.control.arm.types import ArmGoal
from motm_twin.control.predictor import dwell_to_plan
from motm_twin.control.targets import odometry_to_world
from motm_twin.control.tick import Tick
from motm_twin.gym.actions import BaseAction
from motm_twin.model.geometry import Array
from motm_twin.model.motion import command_pose
from motm_twin.model.period import PERIOD
from motm_twin.model.plant import Observation
from motm_twin.planning.types import BaseProblem, Target
from motm_twin.twin import Twin


@dataclass(frozen=True, kw_only=True)
class AgentView:
    """The robot's knowledge at the end of a period, in the loop's own types."""

    observation: Observation
    tick: Tick | None  # of the last period; None after a reset
    pose: Array  # from which the next command acts (the lag of the base is compensated), world, shape (3,)
    twist: Array  # commanded last [m/s, rad/s], shape (2,)
    target: Target | None  # of the active task, world
    next_target: Target | None
    goal: ArmGoal  # what the hand has to do, odometry frame
    next_goal: ArmGoal
    engaged: bool
    dwell: float  # [s]
    time_to_range: float  # [s]

    def problem(self) -> BaseProblem:
        """The base's question as the loop asks it of a planner, on the map of the last period.

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
    """Knowledge of the robot now, after the period of this Tick."""
    loop, observation = twin.loop, twin.plant.observe()
    sequence, targets, twist = loop.sequence, loop.targets, loop.monitor.twist
    T_odom_world = odometry_to_world(observation)
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
