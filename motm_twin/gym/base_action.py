"""The base as an agent commands it: a strategy for `planning.planner.BasePlanner` whose twist is set from outside."""

import math
from dataclasses import dataclass, field

import numpy as np

from motm_twin.control.by_hand import ByHand
from motm_twin.gym.forecast import Forecast
from motm_twin.model.edits import Drive
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.period import PERIOD
from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import Stateful
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.types import BasePlan, BaseProblem, Placement, SearchBudget, empty_path

STATUS = "agent"  # of the plan in the Tick


@dataclass
class BaseActionState:
    """What the agent asks for."""

    twist: Array = field(default_factory=lambda: np.zeros(2))  # [m/s, rad/s]


class BaseAction(Stateful[BaseActionState]):
    """A `BaseController` that drives as it was told last, within the accelerations of the base."""

    def __init__(self, profile: RobotProfile, parameters: PlanningParameters, *, guard: bool = False) -> None:
        """``guard``: slowed so that it can stop clear of whatever the map shows, as when a person drives."""
        self._guard = ByHand(profile, PERIOD) if guard else None
        self._limits = profile.base
        self.forecast = Forecast(profile, parameters)
        self._state = BaseActionState()

    @property
    def twist(self) -> Array:
        """The twist that is asked for, shape (2,) [m/s, rad/s]."""
        return self._state.twist.copy()

    def take(self, twist: Array) -> None:
        """Drive like this from the next period on, shape (2,) [m/s, rad/s]."""
        self._state.twist = np.array(twist, dtype=float)

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """The acceleration towards the twist that is asked for; what the arm reads of a plan is forecast from it."""
        del placement, budget  # there is nothing to search
        wanted = self._state.twist
        acceleration, reason = self._acceleration(problem)
        times, poses = self.forecast.motion(problem.pose, problem.twist, wanted)
        return BasePlan(
            acceleration=frozen(acceleration),
            status=STATUS,
            reason=reason,
            global_path=empty_path(),
            next_path=empty_path(),
            intermediate_goal=frozen(np.full(3, math.nan)),
            local_poses=frozen(poses),
            local_times=frozen(times),
            bezier=empty_path(),
            expansions=0,
            cut_by_clock=False,
            t_h=math.inf,
            k=1.0,
            time_to_range=self.forecast.time_to_range(times, poses, problem.target, engaged=problem.engaged),
        )

    def _acceleration(self, problem: BaseProblem) -> tuple[Array, str]:
        """Towards the twist that is asked for, and why not all the way; shape (2,) [m/s^2, rad/s^2]."""
        v, w = (float(value) for value in self._state.twist)
        most = np.array([self._limits.linear_acceleration, self._limits.yaw_acceleration])
        asked = np.clip(((v, w) - problem.twist) / problem.period, -most, most)
        if self._guard is None:
            return asked, ""
        self._guard.take(Drive(v=v, w=w))
        guarded = self._guard.plan(problem)
        assert guarded is not None  # it was told right now
        slowed = not np.allclose(guarded.acceleration, asked)
        return guarded.acceleration, "slowed: it could not stop clear of what the map shows" if slowed else ""


class NoPlacement:
    """A `PlacementStrategy` that leaves it to the agent where the base stands."""

    def place(self, problem: BaseProblem) -> Placement:
        """No candidates; the goal is where the base is."""
        none = frozen(np.zeros(0))
        return Placement(
            mode="none",
            radius=0.0,
            poses=frozen(np.zeros((0, 3))),
            cost_current=none,
            cost_next=none,
            cost=none,
            rejected=(),
            chosen=-1,
            goal=frozen(problem.pose),
            goal_has_heading=False,
            reason="an agent drives the base",
            next_goal=None,
        )
