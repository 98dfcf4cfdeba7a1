"""A base that knows the future of the agents: a reference for methods that have to predict it.

It searches motions of the base among the future places of the agents, with its true footprint, half a second at a time.
Only for agents that do not see the robot, since their future does not depend on it, and without other obstacles.
"""

import heapq
import math

import numpy as np

from motm_twin.control.method import BaseChoices, Materials, Method, Policies
from motm_twin.measures.agents import Body, base_gap, body_of
from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.plant import PERIOD
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import Scene
from motm_twin.perception.base_map import read_only
from motm_twin.planning.types import (
    BaseController,
    BasePlan,
    BaseProblem,
    Placement,
    PlanStatus,
    SearchBudget,
    bare_plan,
)

NAME = "oracle"
PIECE = 10  # periods of one acceleration
LOOKS = 2  # periods between two checks of the gaps
MARGIN = 0.06  # [m] kept from every agent, for errors of localisation and speed
INSIDE = 0.05  # [m] by which the end must be within the tolerance
MOST = 60_000  # nodes of a search
GREED = 1.2  # weight of the remaining straight line
CELL, TURN, SPEED, RATE = 0.2, math.pi / 8.0, 0.25, 0.45  # [m], [rad], [m/s], [rad/s] of a cell of equal states


@njit(cache=True)
def _key(state: Array, piece: int) -> int:
    """The cell of a state x, y, heading, v, w after ``piece`` pieces."""
    key = int(math.floor(state[0] / CELL)) + 512
    key = key * 1024 + int(math.floor(state[1] / CELL)) + 512
    key = key * 32 + int(math.floor(math.atan2(math.sin(state[2]), math.cos(state[2])) / TURN)) + 8
    key = key * 32 + int(math.floor(state[3] / SPEED + 0.5)) + 16
    key = key * 32 + int(math.floor(state[4] / RATE + 0.5)) + 16
    return key * 256 + piece


@njit(cache=True)
def _piece(
    state: Array, push: tuple[float, float], limits: Array, body: Body, tracks: Array, radii: Array, least: Array,
    goal: Array,
) -> tuple[bool, bool]:  # fmt: skip
    """Move a state on by one piece; True if it is free, True if it reached the goal. ``tracks``: shape (t, n, 2)."""
    free, there = True, False
    for k in range(PIECE):
        v, w = state[3], state[4]
        state[3] = min(limits[0], max(-limits[1], v + push[0] * PERIOD))
        state[4] = min(limits[2], max(-limits[2], w + push[1] * PERIOD))
        ahead = state[2] + 0.25 * (w + state[4]) * PERIOD
        state[0] += 0.5 * (v + state[3]) * PERIOD * math.cos(ahead)
        state[1] += 0.5 * (v + state[3]) * PERIOD * math.sin(ahead)
        state[2] += 0.5 * (w + state[4]) * PERIOD
        there = there or math.hypot(state[0] - goal[0], state[1] - goal[1]) <= goal[2]
        if k % LOOKS == LOOKS - 1:
            at = min(k + 1, tracks.shape[0] - 1)
            for i in range(radii.shape[0]):
                gap = base_gap(body, state[:3], tracks[at, i, 0], tracks[at, i, 1], radii[i])
                free = free and gap >= least[i]
        if there:
            break
    return free, there


@njit(cache=True)
def search(
    start: Array, goal: Array, tracks: Array, radii: Array, body: Body, limits: Array, least: Array
) -> tuple[Array, bool]:
    """Accelerations of the pieces that lead to the goal, shape (p, 2); True if they reach it.

    ``start``: x, y, heading, v, w; ``goal``: x, y, tolerance; ``tracks``: positions of the agents from now on, period
    by period, shape (t, n, 2); ``limits``: forward and reverse speed, yaw rate, and both accelerations; ``least`` [m]:
    gap to keep to each agent. If the goal is not reached: the pieces that come nearest.
    """
    states, pushes = np.empty((MOST, 5)), np.zeros((MOST, 2))
    parents, pieces = np.full(MOST, -1, dtype=np.int64), np.zeros(MOST, dtype=np.int64)
    states[0] = start
    left = max(0.0, math.hypot(start[0] - goal[0], start[1] - goal[1]) - goal[2]) / limits[0]
    heap = [(GREED * left, 0)]
    seen = {_key(states[0], 0): True}
    count, best, best_left, found = 1, 0, np.inf, False
    while len(heap) > 0 and count < MOST - 9 and not found:
        _, node = heapq.heappop(heap)
        piece = pieces[node]
        now = min(piece * PIECE, tracks.shape[0] - 1)
        for i in range(9):
            push = ((1.0 - i // 3) * limits[3], (i % 3 - 1.0) * limits[4])
            states[count] = states[node]
            free, there = _piece(states[count], push, limits, body, tracks[now:], radii, least, goal)
            if not free:
                continue
            key = _key(states[count], piece + 1)
            if key in seen and not there:
                continue
            seen[key] = True
            parents[count], pieces[count] = node, piece + 1
            pushes[count] = push
            away = math.hypot(states[count, 0] - goal[0], states[count, 1] - goal[1])
            left = max(0.0, away - goal[2]) / limits[0]
            if left < best_left:
                best, best_left = count, left
            heapq.heappush(heap, ((piece + 1) * PIECE * PERIOD + GREED * left, count))
            count += 1
            if there:
                best, found = count - 1, True
                break
    way = np.empty((pieces[best], 2))
    while parents[best] >= 0:
        way[pieces[best] - 1] = pushes[best]
        best = parents[best]
    return way, found


class OracleController:
    """Follows a plan for one piece, then searches again. Only for benchmarks: it is not part of a twin's state."""

    def __init__(self, robot: RobotProfile, tracks: Array, radii: Array) -> None:
        """``tracks``: positions of all agents at every period of the run, the first at its start, shape (t, n, 2)."""
        base = robot.base
        self._limits = np.array(
            [base.forward_speed, base.reverse_speed, base.yaw_rate, base.linear_acceleration, base.yaw_acceleration]
        )
        self._body, self._tracks, self._radii = body_of(robot.footprint), tracks, radii
        self._late = round(base.velocity_lag / PERIOD)  # periods by which the base lags behind its plan
        self._push, self._left = np.zeros(2), 0

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """This period's acceleration; ``budget`` is unused."""
        target, most = problem.target, self._limits[3:]
        if target is None:
            push, why = np.clip(-problem.twist / problem.period, -most, most), Reason(kind=Kind.NOTHING_TO_DO)
            return bare_plan(problem, push, PlanStatus.IDLE, why)
        if self._left == 0:
            goal = np.array([*target.position, target.tolerance - INSIDE])
            self._push, self._left = self._search(problem, goal), PIECE
        self._left -= 1
        after = problem.twist + self._push * problem.period
        after = np.clip(after, [-self._limits[1], -self._limits[2]], [self._limits[0], self._limits[2]])
        return bare_plan(problem, (after - problem.twist) / problem.period, PlanStatus.GOAL, None)

    def _search(self, problem: BaseProblem, goal: Array) -> Array:
        """Acceleration of the next piece, shape (2,); braking when there is none."""
        now = min(round(problem.time / PERIOD) + self._late, len(self._tracks) - 1)
        ahead = np.ascontiguousarray(self._tracks[now:])
        around = zip(ahead[0], self._radii, strict=True)
        gaps = [base_gap(self._body, problem.pose, place[0], place[1], radius) for place, radius in around]
        least = np.minimum(MARGIN, gaps)
        start = np.array([*problem.pose, *problem.twist])
        way, _ = search(start, goal, ahead, self._radii, self._body, self._limits, least)
        if len(way):
            return way[0]
        most = self._limits[3:]
        return np.clip(-problem.twist / (PIECE * PERIOD), -most, most)


def require_known_future(scene: Scene) -> None:
    """Raise ValueError for a scene whose agents may react to the robot, or that has other obstacles."""
    if any(agent.sees_robot and agent.behaviour != "blind" for agent in scene.agents):
        raise ValueError(f"{scene.name}: the oracle needs agents that do not see the robot, as in circle_invisible")
    if scene.solids or (scene.robot.has_arm and any(type(task).__name__ != "DriveTo" for task in scene.tasks)):
        raise ValueError(f"{scene.name}: the oracle only drives, where nothing but agents is in the way")


def oracle(scene: Scene, tracks: Array) -> Method:
    """The method that knows these tracks of the agents of a scene, shape (t, n, 2)."""
    places = read_only(np.ascontiguousarray(tracks))
    radii = np.array([agent.radius for agent in scene.agents])

    def controller(materials: Materials, policies: Policies) -> BaseController:
        return OracleController(materials.parts.known.robot, places, radii)

    return Method(
        name=NAME,
        title="Oracle",
        summary="Knows where all agents will be.",
        source="own",
        planner=BaseChoices(controller=controller),
    )
