"""A shipped method as an expert in the environment: its action for the next step.

For imitation, as a baseline, and to check that the environment is the same task.
"""

import numpy as np
from numpy.typing import NDArray

from motm_twin.control.arm.types import ArmInputs, ArmObstacles
from motm_twin.control.method import ArmParts, PlannerParts
from motm_twin.control.predictor import followed
from motm_twin.control.targets import odometry_to_world
from motm_twin.control.tuning import tuned
from motm_twin.gym.actions import check_fits
from motm_twin.gym.env import MotmEnv
from motm_twin.gym.observation import AgentView
from motm_twin.methods.registry import find_method
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.plant import PERIOD
from motm_twin.model.profile import DQ_MAX
from motm_twin.planning.types import BasePlan, SearchBudget


class Expert:
    """A method that chooses actions from the robot's knowledge. For one episode: make a new one after every reset."""

    def __init__(self, env: MotmEnv, method: str = "motm") -> None:
        """Make an expert for ``env.unwrapped``, after its `reset`. ValueError for a method that cannot act in it."""
        chosen = find_method(method)
        check_fits(chosen, whole_body=env.whole_body)
        numbers = tuned(chosen.parameters)
        self._env, self._known = env, env.twin.loop.known
        parts = PlannerParts(known=self._known, parameters=numbers.planning, movers=numbers.movers)
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
    """Inputs of an arm step, for a step that is as long as a period."""
    assert view.tick is not None
    T_odom_world, world = odometry_to_world(view.observation), view.tick.map
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
