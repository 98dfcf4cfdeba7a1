"""A placement rule of your own: straight lines instead of paths.

The paper finds the time to every candidate base pose, and from it to the next target, along paths round obstacles. Are
the paths worth it? This rule takes the same candidates and the time of a straight drive with its turns.

On the open floor of exp1 they hardly are: straight lines took 0.4 s longer, 95 % interval [-1.4, 2.1], four random
arrangements. Among the boxes of exp1a it was 5.1 s [-8.2, 18.3] in three: too few to tell.

python examples/own_placement_rule.py                                      # one trial by it, and one by the paper's
motm-twin run exp1 --method examples/own_placement_rule.py:STRAIGHT
motm-twin bench exp1a --methods motm examples/own_placement_rule.py:STRAIGHT
"""

import math

import numpy as np

from motm_twin.methods.method import BaseChoices, Method
from motm_twin.model.reason import own
from motm_twin.planning.candidates import ring
from motm_twin.planning.collision import body_of, clearances, field_of
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import Placement

LOYALTY = 0.3  # [s] another candidate must be this much better than the last choice


class StraightLines:
    """A `PlacementStrategy` (motm_twin/planning/types.py): one method, `place`."""

    def __init__(self, profile, parameters, graphs):
        self._profile, self._p = profile, parameters.placement
        self._body, self._reach = body_of(profile.footprint), ReachModel(profile, parameters.reach)
        self._paper = NextTargetPlacement(profile, parameters, graphs)  # where this rule has no answer
        self._goal = None  # what was chosen last: (name of the target, pose)

    def place(self, problem):
        """The candidates for this period's target, with their costs, and the choice."""
        target = problem.target
        found = None if target is None or target.kind == "drive" else self._candidates(problem, target)
        if found is None:  # a point to drive to, or no free candidate
            self._goal = None
            return self._paper.place(problem)
        radius, poses, why = found
        free = np.array([not text for text in why])
        to_it = np.where(free, self._straight(problem.pose, poses), math.inf)
        next_poses = self._next_poses(problem)
        onward = np.zeros(len(poses)) if next_poses is None else self._onward(poses, next_poses)
        cost = to_it + self._p.next_weight * onward
        chosen = int(np.argmin(cost - LOYALTY * self._was_chosen(target, poses)))
        self._goal = (target.name, poses[chosen].copy())
        return Placement(
            mode="ring",
            radius=radius,
            poses=poses,
            cost_current=to_it,
            cost_next=np.where(free, onward, math.inf),
            cost=cost,
            rejected=tuple(why),
            chosen=chosen,
            goal=poses[chosen],
            goal_has_heading=True,
            why=own(f"{to_it[chosen]:.1f} s straight to it and {onward[chosen]:.1f} s straight on to the next target"),
            next_goal=None if next_poses is None else next_poses[0],
            next_goals=next_poses,
        )

    def snapshot(self):
        """What is remembered between periods has to be copied and restored: branches, reruns and what-if need it."""
        return {"goal": self._goal, "paper": self._paper.snapshot()}

    def restore(self, state):
        """Go on from a snapshot."""
        self._goal = state["goal"]
        self._paper.restore(state["paper"])

    def _candidates(self, problem, target):
        """Radius, poses (n, 3) and reasons of the smallest ring that has a free candidate; None: no ring has."""
        field = field_of(problem.world)
        for radius in np.arange(self._p.radius_min, self._p.radius_max + 1e-9, self._p.radius_step):
            poses, _, _ = ring(target.position, radius, self._p.positions)
            room = clearances(poses, self._p.clearance, field, self._body) >= self._p.clearance
            reached = self._reach.reached_from(poses, target)
            why = np.where(room, np.where(reached, "", "arm cannot reach"), "collision").tolist()
            if "" in why:
                return float(radius), poses, why
        return None

    def _next_poses(self, problem):
        """The best poses for the next target, seen from this one, shape (k, 3); None without a next target."""
        target = problem.next_target
        found = None if target is None or target.kind == "drive" else self._candidates(problem, target)
        if found is None:
            return None
        _, poses, why = found
        poses = poses[[not text for text in why]]
        x, y = problem.target.position
        order = np.argsort(np.hypot(poses[:, 0] - x, poses[:, 1] - y), kind="stable")
        return poses[order[: self._p.next_goals]]

    def _onward(self, poses, next_poses):
        """Time [s] from each pose to the nearest pose for the next target, shape (n,)."""
        return np.array([self._straight(pose, next_poses).min() for pose in poses])

    def _straight(self, start, poses):
        """Time [s] to turn, drive straight and turn again from a pose (3,) to each of the poses (n, 3)."""
        limits = self._profile.base
        dx, dy = poses[:, 0] - start[0], poses[:, 1] - start[1]
        course, length = np.arctan2(dy, dx), np.hypot(dx, dy)
        turning = _angle(course - start[2]) + _angle(poses[:, 2] - course)
        ahead = turning / limits.yaw_rate + length / limits.forward_speed
        in_reverse = (2.0 * math.pi - turning) / limits.yaw_rate + length / limits.reverse_speed
        return np.minimum(ahead, in_reverse)

    def _was_chosen(self, target, poses):
        """1 where the last choice was, else 0, shape (n,)."""
        if self._goal is None or self._goal[0] != target.name:
            return np.zeros(len(poses))
        away = np.hypot(*(poses[:, :2] - self._goal[1][:2]).T) + _angle(poses[:, 2] - self._goal[1][2])
        return (away == away.min()) * (away < 0.2)


def _angle(difference):
    """Size [rad] of an angle, 0 to pi."""
    return np.abs((difference + math.pi) % (2.0 * math.pi) - math.pi)


def placement(materials, candidates):
    """This rule; the base controller stays that of the paper."""
    return StraightLines(materials.parts.known.robot, materials.parts.parameters, materials.graphs)


STRAIGHT = Method(
    name="straight_lines",
    title="straight lines",
    summary="Candidates are compared by straight drives instead of paths.",
    source="own",
    planner=BaseChoices(placement=placement),
)


if __name__ == "__main__":
    import sys

    from one_trial import main

    main([f"{sys.argv[0]}:STRAIGHT", *sys.argv[1:]])
