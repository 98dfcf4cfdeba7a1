"""Base placement on all rings at once, loyal to its choice, that waits beside what will move on.

The paper takes the smallest ring that has a viable candidate, however long the way to that one is. Between boxes, what
is left of the smallest ring may be on the other side of the table, while a little further out there is room right here.
There the base must pass more slowly, which counts.
Where no ring has one, it goes to the free place that is closest to the target, be it on the other side of the table;
when all that is in the way is something that moves, the candidates behind it will be free again.
"""

import functools
import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.profile import RobotProfile
from motm_twin.perception.still_map import StillMap
from motm_twin.planning.collision import clearances
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.global_path import GraphCache, costs_on, poses_at
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import (
    SAME_HEADING,
    SAME_PLACE,
    Candidates,
    NextTargetPlacement,
    joined,
)
from motm_twin.planning.rejections import Here, rejections
from motm_twin.planning.rings import rings
from motm_twin.planning.types import Target

BESIDE = 2.5  # [m] from the target within which a place to wait is looked for; round a table it is more,
BESIDE_ROUND = 2.0  # [m] and beyond the circle about a base that is larger than Frankie
PLACES = 72  # to wait at that are kept, the best: as many as candidates on a ring
KEEP_CLEARANCE = 0.0  # [m] of the chosen pose: a cell at the edge of what the lidar sees comes and goes


class WidePlacement(NextTargetPlacement):
    """C_i = C_iC + 1.05 C_iN over 36 x 2 candidates on every ring of 0.6 to 0.8 m.

    Beside what moves, C_iN is the way from a free place to a candidate of the same target that is taken now.
    """

    def __init__(
        self,
        profile: RobotProfile,
        parameters: PlanningParameters,
        graphs: GraphCache | None = None,
        still: StillMap | None = None,
    ) -> None:
        """``still``: gives the map without what moves; None: nothing is waited for."""
        super().__init__(profile, parameters, graphs)
        self._still, self._still_graphs = still, GraphCache()
        self._top_speed = profile.base.forward_speed
        self._waits = False

    def _evaluate(
        self, target: Target, here: Here, from_robot: Table, to_next: Table | None
    ) -> tuple[Candidates, Array, Array]:
        self._waits = False
        if target.kind == "drive":
            return super()._evaluate(target, here, from_robot, to_next)
        candidates = self._every_ring(target, here)
        current, onward = self._costs(candidates, here.graph, from_robot, to_next)
        if np.isfinite(current).any():
            return candidates, current + self._slowed(candidates, target), onward
        beside = self._beside(target, here, from_robot)
        self._waits = beside is not None
        return beside or super()._evaluate(target, here, from_robot, to_next)

    def _slowed(self, candidates: Candidates, target: Target) -> Array:
        """Seconds by which the base passes each later than at full speed, to stay in reach as long as the job takes.

        On the tangent at r it has the target within reach R over 2 sqrt(R^2 - r^2). Shape (m,).
        """
        p = self._parameters.reach
        reach = p.r_max(target.kind) - p.plan_slack
        r = np.hypot(*(candidates.place[candidates.place_of] - target.position[:2]).T)
        chord = 2.0 * np.sqrt(np.maximum(0.0, reach**2 - r**2))
        return np.maximum(target.dwell, chord / p.passing_speed(self._top_speed)) - chord / self._top_speed

    def _beside(self, target: Target, here: Here, from_robot: Table) -> tuple[Candidates, Array, Array] | None:
        """Free places, the way to each, and from it to a candidate that is free but for what moves; None: none is."""
        world = here.world if self._still is None else self._still.of(here.world)
        if world is here.world:
            return None
        graph = self._still_graphs.graph(world, self._room.growth)
        there = Here(world, self._still_graphs.field(world), here.body, graph, here.pose)
        wanted = self._every_ring(target, there)
        pose = wanted.pose[wanted.viable()]
        for room in self._rooms(here):
            places = list(self._closest(target, here, room, max(BESIDE, self._body.reach + BESIDE_ROUND)))
            if places:
                break
        if not len(pose) or not places:
            return None
        free = functools.reduce(joined, places)
        table = self._still_graphs.table(graph, pose[np.lexsort((pose[:, 1], pose[:, 0]))], self._rates)
        current, _ = self._costs(free, here.graph, from_robot, None)
        onward = costs_on(graph, table, poses_at(graph, free.pose, free.place, free.place_of))
        best = np.argsort(current + self._parameters.placement.next_weight * onward, kind="stable")[:PLACES]
        best = np.sort(best[np.isfinite(current[best] + onward[best])])
        if not len(best):
            return None
        used, place_of = np.unique(free.place_of[best], return_inverse=True)
        radius = float(np.hypot(*(free.place[used] - target.position[:2]).T).min())
        kept = Candidates("closest", radius, free.pose[best], free.place[used], place_of, [""] * len(best))
        return kept, current[best], onward[best]

    def _why(
        self, candidates: Candidates, chosen: int, current: Array, onward: Array, target: Target, here: Here
    ) -> str:
        if not self._waits:
            return super()._why(candidates, chosen, current, onward, target, here)
        return (
            f"what moves leaves no free candidate of {target.name}: driving to a free place beside it, "
            f"{onward[chosen]:.1f} s from one"
        )

    def _every_ring(self, target: Target, here: Here) -> Candidates:
        p = self._parameters.placement
        pose, place, place_of = rings(target.position, self._radii, p.positions)
        rejected = self._unless_chosen(rejections(pose, p.clearance, here), target, pose, here)
        for i in np.flatnonzero(~self._reach.reached_from(pose, target)).tolist():
            rejected[i] = rejected[i] or "arm cannot reach"
        return Candidates("ring", float(self._radii[0]), pose, place, place_of, rejected)

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
