"""Base placement on all rings at once, loyal to its choice.

The paper takes the smallest ring that has a viable candidate, however long the way to that one is. Between boxes, what
is left of the smallest ring may be on the other side of the table, while a little further out there is room right here.
"""

import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.planning.collision import clearances
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.placement import (
    SAME_HEADING,
    SAME_PLACE,
    Candidates,
    NextTargetPlacement,
    joined,
    ring,
)
from motm_twin.planning.rejections import Here, rejections
from motm_twin.planning.types import Target

KEEP_CLEARANCE = 0.0  # [m] of the chosen pose: a cell at the edge of what the lidar sees comes and goes


class WidePlacement(NextTargetPlacement):
    """C_i = C_iC + 1.05 C_iN over 36 x 2 candidates on every ring of 0.6 to 0.8 m."""

    def _evaluate(
        self, target: Target, here: Here, from_robot: Table, to_next: Table | None
    ) -> tuple[Candidates, Array, Array]:
        if target.kind != "drive":
            candidates = self._every_ring(target, here)
            current, onward = self._costs(candidates, here.graph, from_robot, to_next)
            if np.isfinite(current).any():
                return candidates, current, onward
        return super()._evaluate(target, here, from_robot, to_next)

    def _every_ring(self, target: Target, here: Here) -> Candidates:
        p = self._parameters.placement
        found: Candidates | None = None
        for radius in self._radii:
            pose, place, place_of = ring(target.position, radius, p.positions)
            reached = self._reach.reached_from(pose, target)
            rejected = self._unless_chosen(rejections(pose, p.clearance, here), target, pose, here)
            rejected = [why or ("" if ok else "arm cannot reach") for why, ok in zip(rejected, reached, strict=True)]
            candidates = Candidates("ring", float(radius), pose, place, place_of, rejected)
            found = candidates if found is None else joined(found, candidates)
        assert found is not None
        return found

    def _unless_chosen(self, rejected: list[str], target: Target, pose: Array, here: Here) -> list[str]:
        """The reasons without that of the pose chosen before, as long as it is free at all."""
        goal = self._state.goal
        if goal is None or self._state.target != (target.kind, target.name):
            return rejected
        for i in np.flatnonzero(np.hypot(pose[:, 0] - goal[0], pose[:, 1] - goal[1]) <= SAME_PLACE):
            swing = abs(math.remainder(pose[i, 2] - goal[2], 2.0 * math.pi))
            if rejected[i] and swing <= SAME_HEADING:
                free = clearances(pose[i : i + 1], 1.0, here.field, here.body)[0]
                rejected[i] = rejected[i] if free < KEEP_CLEARANCE else ""
        return rejected
