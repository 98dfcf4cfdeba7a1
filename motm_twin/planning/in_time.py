"""Candidates in time: each is judged by the dynamic obstacles expected there on arrival, not by those there now.

A candidate that will be free on arrival costs nothing more; one that will be taken costs the time until it is free
again. So the base waits for a place that is free soon when that is cheaper than the next best one. The paths to the
cheapest candidates also cost the delays by dynamic obstacles that cross them when the base gets there: of two ways
round a table the base takes the clear one.
"""

import math

import numpy as np

from motm_twin.model.exact import angle_of, turn_between
from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.planning.candidates import Judged, Rule, Survey
from motm_twin.planning.collision import Body
from motm_twin.planning.global_path import path_to_goal
from motm_twin.planning.kernels import length_of
from motm_twin.planning.prediction import LONGEST, SPREAD, WAIT_STEP, Spread, moved_on, probability_taken
from motm_twin.planning.types import Target

SAMPLE = 0.25  # [m] between samples of a path
SIDES = 12  # sectors round a target; one path to each is sampled


class InTime:
    """A rule of candidates: those of another rule, plus the cost of waiting for dynamic obstacles."""

    def __init__(self, rule: Rule, lag: float) -> None:
        """``lag`` [s]: delay with which the base follows its plan."""
        self._rule, self._lag = rule, lag

    def __call__(self, target: Target, survey: Survey) -> Judged:
        """The candidates of a target, their costs with waiting, and the time to wait for each."""
        judged = self._rule(target, survey)
        others, viable = moved_on(survey.here.world.tracks, self._lag), np.isfinite(judged.current)
        if not len(others) or judged.waits or not viable.any():
            return judged
        body = survey.model.body
        waiting, doubt = np.zeros(len(viable)), np.zeros(len(viable))
        dwell = target.dwell if target.kind != "drive" else 0.0
        poses, arrival = np.ascontiguousarray(judged.candidates.pose), judged.current
        p = survey.model.parameters.foresight
        fill_waits(poses, arrival, (dwell, p.taken), others, SPREAD, body, waiting, doubt)
        among = waiting + p.doubt * doubt
        # Predictions flicker, and people may change their way: the place chosen before is charged less.
        among -= np.minimum(among, 0.5 * p.doubt * _chosen_before(target, survey, poses))
        current = judged.current + among
        onward = survey.model.placement.next_weight * np.where(viable, judged.onward, 0.0)
        _add_delays(current, onward, poses, target, survey, others)
        return judged._replace(current=current, waiting=waiting)


def _chosen_before(target: Target, survey: Survey, poses: Array) -> Array:
    """1 for the poses (m, 3) that are the choice of the last period, else 0; shape (m,)."""
    goal, p = survey.last.goal, survey.model.placement
    if goal is None or not survey.last.of(target):
        return np.zeros(len(poses))
    near = np.hypot(poses[:, 0] - goal[0], poses[:, 1] - goal[1]) <= p.same_place
    return np.where(near & (turn_between(poses[:, 2], goal[2]) <= p.same_heading), 1.0, 0.0)


def _add_delays(current: Array, onward: Array, poses: Array, target: Target, survey: Survey, others: Array) -> None:
    """Add to the costs (m,) the delays by dynamic obstacles: in each sector, that on the path to its cheapest pose."""
    speed = survey.model.profile.base.forward_speed
    offset = poses[:, :2] - target.position[:2]
    side = np.floor(angle_of(offset[:, 1], offset[:, 0]) * (0.5 * SIDES / math.pi)).astype(np.int64)
    for one in np.unique(side[np.isfinite(current)]).tolist():
        members = np.flatnonzero((side == one) & np.isfinite(current))
        pose = poses[members[np.argmin(current[members] + onward[members])]]
        path = path_to_goal(survey.here.graph, survey.from_robot, pose + np.array([0.0, 0.0, math.pi]))[0][::-1]
        current[members] += delay_along(path, speed, others, survey.model.body)


def delay_along(path: Array, speed: float, others: Array, body: Body) -> float:
    """Time [s] lost to dynamic obstacles (k, 7) on a path (n, 2) when the base gets to them at a speed [m/s].

    Each costs the time that it needs to clear the path, times the largest probability that it is in the way.
    """
    steps = np.hypot(*np.diff(path, axis=0).T) if len(path) > 1 else np.zeros(0)
    length = np.concatenate(([0.0], np.cumsum(steps)))
    if length[-1] < SAMPLE:
        return 0.0
    at = np.arange(SAMPLE, min(length[-1], LONGEST * speed), SAMPLE)
    places = np.column_stack([np.interp(at, length, column) for column in path.T])
    leg = np.minimum(np.searchsorted(length, at), len(steps)) - 1
    way = np.diff(path, axis=0)[leg] / np.maximum(steps[leg], 1e-9)[:, None]
    return _delay(places, way, at / speed, others, SPREAD, body)


@kernel
def _delay(places: Array, way: Array, times: Array, others: Array, spread: Spread, body: Body) -> float:
    total = 0.0
    for k in range(others.shape[0]):
        most = 0.0
        for i in range(places.shape[0]):
            x, y, c, s = places[i, 0], places[i, 1], way[i, 0], way[i, 1]
            most = max(most, probability_taken(x, y, c, s, times[i], others[k], spread, body))
        clears = 2.0 * (others[k, 4] + body.inner) / max(length_of(others[k, 2], others[k, 3]), 0.1)
        total += most * min(clears, LONGEST)
    return total


@kernel
def fill_waits(
    poses: Array, arrival: Array, asked: tuple[float, float], others: Array, spread: Spread, body: Body,
    waiting: Array, doubt: Array,
) -> None:  # fmt: skip
    """Fill in the time [s] after arrival until each pose (m, 3) is free, and the probability that it is taken then.

    ``asked``: the time [s] for which a pose is needed, and the probability from which on it counts as taken.
    """
    dwell, taken = asked
    for i in range(poses.shape[0]):
        if not math.isfinite(arrival[i]):
            continue
        x, y, c, s = poses[i, 0], poses[i, 1], math.cos(poses[i, 2]), math.sin(poses[i, 2])
        while True:
            begins, most = arrival[i] + waiting[i], 0.0
            for part in range(3):
                free = 1.0
                for k in range(others.shape[0]):
                    free *= 1.0 - probability_taken(x, y, c, s, begins + 0.5 * part * dwell, others[k], spread, body)
                most = max(most, 1.0 - free)
            doubt[i] = most
            if most < taken or waiting[i] >= LONGEST:
                break
            waiting[i] += WAIT_STEP
