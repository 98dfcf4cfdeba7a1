"""A base controller of your own: pure pursuit of the global path, and a stop at the goal until the arm is done.

python examples/own_base_controller.py                              # one trial by it, and one by the paper's
motm-twin run exp1 --method examples/own_base_controller.py:PURSUIT
"""

import itertools
import math

import numpy as np

from motm_twin.methods.method import Method, PlannerParts
from motm_twin.model.reason import own
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.collision import body_of, field_of
from motm_twin.planning.global_path import GraphCache, shortest_path
from motm_twin.planning.parameters import growth
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import BasePlan, empty_path

LOOK_AHEAD = 0.45  # [m] along the path
MARGIN = 0.05  # [m] kept from everything
CLOSE = 0.05  # [m] from the goal: there
TURN_GAIN = 2.5  # [1/s]


class Pursuit:
    """A `BaseController` (motm_twin/planning/types.py): one method, `plan`. It remembers nothing between periods."""

    def __init__(self, profile, parameters, graphs):
        self._limits, self._body = profile.base, body_of(profile.footprint)
        self._reach, self._growth = ReachModel(profile, parameters.reach), growth(profile.footprint, parameters.staa)
        self._graphs = graphs

    def plan(self, problem, placement, budget):
        """This period's acceleration, and what the arm and the page read of a plan."""
        if problem.target is None or placement.chosen < 0:
            return self._plan(problem, np.zeros(2), "idle", placement.why, empty_path())
        graph = self._graphs.graph(problem.world, self._growth)
        path = shortest_path(graph, problem.pose, placement.goal, self._limits)
        wanted = self._pursue(problem.pose, path)
        for share in (1.0, 0.5, 0.25, 0.0):  # of the speed, as much as it can stop from
            slower = np.array([share * wanted[0], wanted[1] * max(share, 0.5)])
            if self._room(problem, slower) >= MARGIN:
                return self._plan(problem, slower, "goal", None, path)
        turned_back = np.array([-0.1, 0.0])
        return self._plan(problem, turned_back, "braking", own("too near to something: backing out"), path)

    def _pursue(self, pose, path):
        """Twist (2,) towards a point ahead on the path; slower in turns and before the end."""
        steps = np.hypot(*np.diff(path, axis=0).T)
        left = float(steps.sum())
        if left < CLOSE:
            return np.zeros(2)
        along = np.concatenate(([0.0], np.cumsum(steps)))
        ahead = min(LOOK_AHEAD, left)
        x, y = (np.interp(ahead, along, path[:, k]) for k in (0, 1))
        error = math.remainder(math.atan2(y - pose[1], x - pose[0]) - pose[2], 2.0 * math.pi)
        limits = self._limits
        speed = min(limits.forward_speed, math.sqrt(limits.linear_acceleration * left)) * max(0.0, math.cos(error)) ** 2
        return np.array([speed, np.clip(TURN_GAIN * error, -limits.yaw_rate, limits.yaw_rate)])

    def _acceleration(self, problem, wanted):
        most = np.array([self._limits.linear_acceleration, self._limits.yaw_acceleration])
        return np.clip((wanted - problem.twist) / problem.period, -most, most)

    def _room(self, problem, wanted):
        """Clearance [m] that is left when the base takes this twist for a period and then brakes to rest."""
        v, w = problem.twist + self._acceleration(problem, wanted) * problem.period
        x, y, heading = problem.pose
        x, y, heading = x + v * 0.05 * math.cos(heading), y + v * 0.05 * math.sin(heading), heading + w * 0.05
        a, b = self._limits.linear_acceleration, self._limits.yaw_acceleration
        return stopping_clearance(x, y, heading, v, w, a, b, MARGIN, field_of(problem.world), self._body)

    def _time_to_range(self, problem, path):
        """Time [s] until the target is in reach of the arm: 0 when it is. With it the arm decides when to leave."""
        if problem.target is None:
            return math.inf
        if self._reach.contains(problem.pose, problem.twist, problem.target):
            return 0.0
        time = 0.0
        for here, there in itertools.pairwise(path):
            length = math.hypot(*(there - here))
            heading = math.atan2(*(there - here)[::-1])
            for s in np.arange(0.0, length, 0.05):
                pose = np.array([*(here + s / length * (there - here)), heading])
                if time + s > 0.0 and self._reach.contains(pose, np.zeros(2), problem.target):
                    return (time + s) / self._limits.forward_speed
            time += length
        return max(0.1, time / self._limits.forward_speed)

    def _plan(self, problem, wanted, status, why, path):
        time_to_range = self._time_to_range(problem, path)
        return BasePlan(
            acceleration=self._acceleration(problem, wanted),
            status=status,
            why=why,
            global_path=path,
            intermediate_goal=problem.pose,
            local_poses=np.array([[*problem.pose, *problem.twist]]),
            local_times=np.zeros(1),
            t_h=0.0,
            time_to_range=time_to_range,
        )


def planner(parts: PlannerParts) -> BasePlanner:
    """The placement of the paper, and this controller."""
    graphs = parts.graphs or GraphCache()
    pursuit = Pursuit(parts.known.robot, parts.parameters, graphs)
    return BasePlanner(parts.known.robot, parts.parameters, controller=pursuit, graphs=graphs)


PURSUIT = Method(
    name="pursuit",
    title="pure pursuit",
    summary="Follows the global path to the candidate, and stands there until the arm is done.",
    source="own",
    planner=planner,
)


if __name__ == "__main__":
    import sys

    from one_trial import main

    main([f"{sys.argv[0]}:PURSUIT", *sys.argv[1:]])
