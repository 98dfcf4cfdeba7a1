"""Candidates on all rings at once, the chosen one kept while it is free at all, and places to wait.

The paper takes the smallest ring that has a viable candidate, however long the way to it. Between boxes, the free part
of the smallest ring may be on the other side of the table, while a slightly larger ring has room near the base. There
the base must pass the target more slowly, which is part of the cost.
Where no ring has a viable candidate, the paper drives to the free place closest to the target, even on the other side
of the table. Candidates that only dynamic obstacles block will be free again: the base waits near those.
"""

import functools
import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.perception.still_map import StaticMap
from motm_twin.planning.candidates import (
    Candidates,
    Judged,
    Survey,
    closest_places,
    costs_of,
    joined,
    rings,
    smallest_ring,
    waiting_rooms,
)
from motm_twin.planning.collision import clearances
from motm_twin.planning.global_path import GraphCache, costs_on, poses_at
from motm_twin.planning.rejections import Here, Rejection, rejections
from motm_twin.planning.types import Mode, Target


class EveryRing:
    """A rule of candidates: 36 x 2 on every ring of 0.6 to 0.8 m; where none is viable, places to wait."""

    def __init__(self, still: StaticMap | None = None) -> None:
        """``still``: gives the map without dynamic obstacles; None: the base waits for none."""
        self._still, self._graphs = still, GraphCache()

    def __call__(self, target: Target, survey: Survey) -> Judged:
        """The candidates of a target and their costs."""
        if target.kind == "drive":
            return smallest_ring(target, survey)
        judged = costs_of(every_ring(target, survey), survey)
        if np.isfinite(judged.current).any():
            return judged._replace(current=judged.current + passing_more_slowly(judged.candidates, target, survey))
        return self._beside(target, survey) or smallest_ring(target, survey)

    def _beside(self, target: Target, survey: Survey) -> Judged | None:
        """Free places to wait near candidates that only dynamic obstacles block, with costs to each and on, or None."""
        model, here = survey.model, survey.here
        world = here.world if self._still is None else self._still.of(here.world)
        if world is here.world:
            return None
        graph = self._graphs.graph(world, survey.room.growth)
        there = Here(world, self._graphs.field(world), here.body, graph, here.eye)
        rings = every_ring(target, survey._replace(here=there))
        pose = rings.pose[rings.viable()]
        for room in waiting_rooms(survey):
            places = list(closest_places(target, survey, room, model.body.reach + model.placement.beside_round))
            if places:
                break
        if not len(pose) or not places:
            return None
        free = functools.reduce(joined, places)
        table = self._graphs.table(graph, pose[np.lexsort((pose[:, 1], pose[:, 0]))], model.rates)
        current = costs_of(free, survey._replace(to_next=None)).current
        onward = costs_on(graph, table, poses_at(graph, free.pose, free.place, free.place_of))
        best = np.argsort(current + model.placement.next_weight * onward, kind="stable")[: model.placement.ring_poses]
        best = np.sort(best[np.isfinite(current[best] + onward[best])])
        if not len(best):
            return None
        used, place_of = np.unique(free.place_of[best], return_inverse=True)
        radius = float(np.hypot(*(free.place[used] - target.position[:2]).T).min())
        kept = Candidates(Mode.CLOSEST, radius, free.pose[best], free.place[used], place_of, [""] * len(best))
        return Judged(kept, current[best], onward[best], waits=True)


def every_ring(target: Target, survey: Survey) -> Candidates:
    """The candidates of all rings; the pose chosen before need only be free, without the clearance of others."""
    model = survey.model
    pose, place, place_of = rings(target.position, model.radii, model.placement.positions)
    rejected = _unless_chosen(rejections(pose, survey.room.clearance, survey.here), target, pose, survey)
    for i in np.flatnonzero(~model.reach.reached_from(pose, target)).tolist():
        rejected[i] = rejected[i] or Rejection.NO_REACH
    return Candidates(Mode.RING, float(model.radii[0]), pose, place, place_of, rejected)


def passing_more_slowly(candidates: Candidates, target: Target, survey: Survey) -> Array:
    """Time [s] lost against full speed by passing each candidate slowly enough for the job, shape (m,).

    On the tangent at radius r the base has the target within reach R over 2 sqrt(R^2 - r^2) [m].
    """
    p, top_speed = survey.model.parameters.reach, survey.model.profile.base.forward_speed
    reach = survey.model.reach.r_max(target) - p.plan_slack
    r = np.hypot(*(candidates.place[candidates.place_of] - target.position[:2]).T)
    chord = 2.0 * np.sqrt(np.maximum(0.0, reach**2 - r**2))
    return np.maximum(target.dwell, chord / p.passing_speed(top_speed)) - chord / top_speed


def _unless_chosen(rejected: list[str], target: Target, pose: Array, survey: Survey) -> list[str]:
    """The reasons, cleared for the pose chosen before as long as that is free at all: occupied cells flicker."""
    goal, here, p = survey.last.goal, survey.here, survey.model.placement
    if goal is None or not survey.last.of(target):
        return rejected
    for i in np.flatnonzero(np.hypot(pose[:, 0] - goal[0], pose[:, 1] - goal[1]) <= p.same_place):
        swing = abs(math.remainder(pose[i, 2] - goal[2], 2.0 * math.pi))
        if rejected[i] and swing <= p.same_heading:
            free = clearances(pose[i : i + 1], 1.0, here.field, here.body)[0]
            rejected[i] = rejected[i] if free < 0.0 else ""
    return rejected
