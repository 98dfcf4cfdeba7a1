"""Temis, persons and other dynamic obstacles on endless rounds of waypoints. Deterministic.

Behaviours: `yield` and `blind` drive as a Temi does; those in `WALKS` move in any direction and choose simultaneously.
Agents added by a person stand still until they are sent to a point.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.scene import Agent, Point
from motm_twin.model.state import LATER
from motm_twin.sim.agent_kernels import bearing_to, look_about, steer, way_round
from motm_twin.sim.crowd import (
    DECISION_STEPS,
    NO_ROBOT,
    Crowd,
    RobotShadow,
    orca,
    preferred_velocity,
    social_force,
    walk,
)
from motm_twin.sim.kernels import clearance
from motm_twin.sim.solids import Solids

WALKS: dict[str, Callable[[Crowd], Array]] = {"orca": orca, "social_force": social_force}

MARGIN = 0.10  # [m] kept from everything ahead
ROBOT_KEEP = 0.2  # [m] kept from the robot in addition
MARGIN_ROUND = 0.07  # [m] the same on a detour, which is searched with a larger margin
MARGINS_SEARCHED = (0.16, 0.10)  # [m] a detour is searched with the first margin, else with the second
MARGINS_WALKED = (0.40, 0.10)  # [m] the same for a walking agent: others and walls push it aside
EXPECT = (0.0, 0.4, 0.8)  # [s] ahead at which other agents are predicted
LOOK_AHEAD = 1.2  # [m]
ARRIVED = 0.15  # [m] distance at which a waypoint is reached
AT_REST = 0.03  # [m] the same for a point where the agent stops
PATH_STEP, PATH_STEP_WALKED = 0.15, 0.4  # [m] distance at which a point of a detour is reached
PATIENCE = 2.5  # [s] of waiting before the first detour; +0.7 s per agent, so that two do not mirror each other
STAGGER = 0.7  # [s]
GIVE_UP = 15.0  # [s] of waiting after which an agent gives up the point it was sent to
AGAIN = 1.5  # [s] between further attempts
GRID = 0.1  # [m] cell size of the search for a detour
WINDOW = 3.0  # [m] half width of the searched area about the agent
FACING = 0.5  # [rad] heading error up to which a standing agent is waiting, not turning
CREEP = 0.03  # [m/s] below which an agent that wants to drive counts as waiting
STUCK = 0.1  # share of its speed below which a walking agent counts as waiting
_NO_DISCS = np.zeros((0, 4))


@dataclass
class AgentState:
    """One agent."""

    agent: Agent
    rank: int  # among all agents: staggers their detours
    pose: Array  # x, y, heading, shape (3,)
    v: float = 0.0  # [m/s]
    w: float = 0.0  # [rad/s]
    waypoint: int = 0
    free: float = math.inf  # [m] ahead
    gap: float = math.inf  # [m] to the nearest obstacle on any side, at the last look
    waiting: float = 0.0  # [s]
    next_attempt: float = 0.0  # [s] waiting time at which a detour is searched
    detour: Array = field(default_factory=lambda: np.zeros((0, 2)))  # points of a detour still to pass
    squeezing: bool = False  # the detour was found only close to the robot
    added: bool = False  # by a person
    held: bool = False  # by a person
    frozen: bool = False
    errand: Point | None = None  # point to which a person sent it
    mode: str = "standing"  # standing | driving | waiting | going round | held | frozen | sliding
    wanted: Point | None = field(default=None, metadata=LATER)  # velocity [m/s] chosen by a walking agent
    pausing: float = field(default=0.0, metadata=LATER)  # [s] left of its pause at a waypoint

    @property
    def points(self) -> tuple[Point, ...]:
        """Points to drive to: its errand, else its waypoints."""
        return self.agent.waypoints if self.errand is None else (self.errand,)

    @property
    def walks(self) -> bool:
        """True for an agent that moves in any direction."""
        return self.agent.behaviour in WALKS

    @property
    def stays(self) -> bool:
        """True for an agent that stops at its goal: its only point, or a waypoint with a pause."""
        return len(self.points) == 1 or self.agent.pause > 0.0

    def velocity(self, slides: Mapping[str, Point]) -> Point:
        """Velocity [m/s]; that of a throw while it slides."""
        heading = float(self.pose[2])
        return slides.get(self.agent.name) or (self.v * math.cos(heading), self.v * math.sin(heading))

    def stop(self) -> None:
        """Stand still at once; it drives on only after the next look."""
        self.v = self.w = self.free = self.gap = self.waiting = 0.0
        self.next_attempt = PATIENCE + STAGGER * self.rank
        self.detour = np.zeros((0, 2))
        self.wanted, self.pausing = None, 0.0


def start_agent(agent: Agent, rank: int, *, added: bool) -> AgentState:
    """An agent at its start."""
    pose = np.array(agent.start, dtype=float)
    return AgentState(agent=agent, rank=rank, pose=pose, next_attempt=PATIENCE + STAGGER * rank, added=added)


class _Sight(NamedTuple):
    """All that agents see: each other now and predicted, the robot, obstacles, and velocities [m/s] of throws."""

    discs: Array
    expected: Array
    robot: RobotShadow
    obstacles: Solids
    slides: Mapping[str, Point]


class Agents:
    """Moves all agents."""

    def __init__(self, dt: float) -> None:
        """Substeps of dt [s]."""
        self.dt = dt
        # compile now, not at the first encounter
        nothing = np.zeros((0, 2)), np.zeros(1, dtype=np.int64), np.zeros((0, 3))
        way_round(np.zeros(2), np.ones(2), 0.1, GRID, GRID, *nothing)
        look_about(np.zeros(3), 0.1, MARGIN, MARGIN, LOOK_AHEAD, *nothing, np.zeros((1, 1, 3)), 0, *nothing)

    @staticmethod
    def discs(states: Sequence[AgentState]) -> Array:
        """x, y, radius, height of all agents [m], shape (n, 4)."""
        if not states:
            return _NO_DISCS
        return np.array([(*s.pose[:2].tolist(), s.agent.radius, s.agent.height) for s in states])

    def step(
        self, states: list[AgentState], look: bool, robot: RobotShadow, obstacles: Solids, slides: Mapping[str, Point]
    ) -> None:
        """One substep; on a ``look`` the agents see the robot's shadow, the obstacles and each other.

        ``slides``: velocities [m/s] of agents that slide because a person threw them.
        """
        discs, expected = (self.discs(states), self._expected(states, slides)) if look else (_NO_DISCS, _NO_DISCS)
        sight = _Sight(discs, expected, robot, obstacles, slides)
        for behaviour in WALKS if look else ():
            if any(state.agent.behaviour == behaviour for state in states):
                self._choose(states, behaviour, sight)
        for i, state in enumerate(states):
            if state.held or state.frozen or state.agent.name in slides:
                state.mode = "held" if state.held else "sliding" if state.agent.name in slides else "frozen"
                state.v, state.w, state.waiting = 0.0, 0.0, 0.0
            elif not state.points or state.pausing > 0.0:
                state.pausing = max(0.0, state.pausing - self.dt)
                self._stand(state)
            else:
                seen = sight if state.agent.sees_robot else sight._replace(robot=NO_ROBOT)
                if look and state.walks:
                    self._wait(state, i, seen)
                elif look and state.agent.behaviour == "yield":
                    self._look(state, i, seen)
                (self._walk if state.walks else self._drive)(state)

    @staticmethod
    def _expected(states: Sequence[AgentState], slides: Mapping[str, Point]) -> Array:
        """Discs of all agents now and predicted, shape (n, times, 3)."""
        expected = []
        for state in states:
            x, y, heading = state.pose.tolist()
            slide, c, s = slides.get(state.agent.name), math.cos(heading), math.sin(heading)
            for ahead in EXPECT:
                dx, dy = (slide[0] * ahead, slide[1] * ahead) if slide else (state.v * ahead * c, state.v * ahead * s)
                expected.append((x + dx, y + dy, state.agent.radius))
        return np.array(expected).reshape(-1, len(EXPECT), 3)

    def _stand(self, state: AgentState) -> None:
        """Brake while it still rolls; then stand."""
        state.mode = "standing"
        if state.v != 0.0 or state.w != 0.0:
            x, y = float(state.pose[0] + math.cos(state.pose[2])), float(state.pose[1] + math.sin(state.pose[2]))
            self._steer(state, (x, y), 0.0, 0.0, rounding=False)

    def _steer(self, state: AgentState, goal: Point, free: float, gap: float, *, rounding: bool) -> float:
        """Drive towards a point; returns the rest of ``free`` [m]."""
        speed, acceleration = state.agent.speed, state.agent.acceleration
        state.pose, state.v, state.w, left = steer(
            state.pose, state.v, state.w, *goal, speed, free, gap, rounding, self.dt, acceleration
        )
        return left

    def _choose(self, states: Sequence[AgentState], behaviour: str, sight: _Sight) -> None:
        """Choose the velocities of all agents with a walking behaviour."""
        preferred = np.zeros((len(states), 2))
        for i, state in enumerate(states):
            if state.walks and state.points and not (state.held or state.frozen or state.pausing):
                goal = self._goal(state)
                stays = state.stays and not len(state.detour)
                preferred[i] = preferred_velocity(state.pose[:2], goal, state.agent.speed, stays=stays)
        crowd = Crowd(
            positions=np.array([state.pose[:2] for state in states]),
            velocities=np.array([state.velocity(sight.slides) for state in states]),
            radii=np.array([state.agent.radius for state in states]),
            preferred=preferred,
            speeds=np.array([state.agent.speed for state in states]),
            sees_robot=np.array([state.agent.sees_robot for state in states]),
            robot=sight.robot,
            obstacles=sight.obstacles,
        )
        for state, velocity in zip(states, WALKS[behaviour](crowd).tolist(), strict=True):
            if state.agent.behaviour == behaviour:
                state.wanted = (velocity[0], velocity[1])

    def _walk(self, state: AgentState) -> None:
        """Walk on with the chosen velocity."""
        wanted = np.array(state.wanted or (0.0, 0.0))
        state.pose, state.v = walk(state.pose, state.v, wanted, state.agent.acceleration, self.dt)
        state.w = 0.0
        if state.waiting > 0.0 and state.v <= STUCK * state.agent.speed:
            state.mode = "waiting"
        else:
            state.mode = "going round" if len(state.detour) else "driving"

    def _look(self, state: AgentState, own: int, sight: _Sight) -> None:
        """Check the space ahead and at the sides, and wait or search for a detour; ``own``: index among the agents."""
        agent, rounding = state.agent, len(state.detour) > 0
        margin = MARGIN_ROUND if rounding else MARGIN
        keep = margin if rounding and state.squeezing else margin + ROBOT_KEEP
        around = (*sight.obstacles.plan, sight.expected, own, *sight.robot.plan)
        state.free, state.gap = look_about(state.pose, agent.radius, margin, keep, LOOK_AHEAD, *around)
        self._wait(state, own, sight)

    def _wait(self, state: AgentState, own: int, sight: _Sight) -> None:
        """Measure for how long an agent is blocked; after a while, search for a detour or give up its errand."""
        x, y = self._goal(state)
        if state.walks:
            moves = state.v > STUCK * state.agent.speed
            wants = math.hypot(x - state.pose[0], y - state.pose[1]) > ARRIVED
        else:
            moves, wants = state.v > CREEP, abs(bearing_to(state.pose, x, y)) < FACING
        if moves or not wants:
            state.waiting = max(0.0, state.waiting - self.dt * DECISION_STEPS * moves)
            if state.waiting == 0.0:
                state.next_attempt = PATIENCE + STAGGER * state.rank
            return
        state.waiting += self.dt * DECISION_STEPS
        if state.errand is not None and state.waiting > GIVE_UP:
            state.errand = None
            state.stop()
            return
        if state.waiting < state.next_attempt:
            return
        state.next_attempt = state.waiting + AGAIN + STAGGER * state.rank
        self._search(state, np.delete(sight.discs[:, :3], own, axis=0), sight.robot, sight.obstacles)

    @staticmethod
    def _search(state: AgentState, others: Array, robot: RobotShadow, obstacles: Solids) -> None:
        """Take a detour to the next reachable waypoint, if there is one; try one well clear of the robot first.

        An errand is approached as closely as possible.
        """
        waypoints, sent = state.points, state.errand is not None
        first = np.append(obstacles.first, obstacles.first[-1] + 4) if robot.seen else obstacles.first
        margins = MARGINS_WALKED if state.walks else MARGINS_SEARCHED
        for margin, grown, squeezing in zip(margins, (ROBOT_KEEP, 0.0), (False, True), strict=True):
            corners = np.vstack([obstacles.corners, robot.base(grown)]) if robot.seen else obstacles.corners
            discs = np.vstack([obstacles.discs, robot.discs + np.array([0.0, 0.0, grown]), others])
            radius = state.agent.radius + margin
            for ahead in range(len(waypoints)):
                index = 0 if sent else (state.waypoint + ahead) % len(waypoints)
                goal = np.array(waypoints[index])
                if not sent and clearance(goal[0], goal[1], corners, first, discs) < radius:
                    continue
                path = way_round(state.pose[:2], goal, radius, GRID, WINDOW, corners, first, discs)
                if len(path) > 0:
                    state.detour, state.squeezing = path, squeezing
                    state.waypoint = state.waypoint if sent else index
                    return

    def _goal(self, state: AgentState) -> Point:
        """Point to drive to now; advances past reached points of a detour and waypoints."""
        waypoints = state.agent.waypoints
        x, y, _ = state.pose.tolist()
        while len(state.detour) > 0:
            next_x, next_y = state.detour[0].tolist()
            if math.hypot(next_x - x, next_y - y) > (PATH_STEP_WALKED if state.walks else PATH_STEP):
                return next_x, next_y
            state.detour = state.detour[1:]
        if state.errand is not None:
            if math.hypot(state.errand[0] - x, state.errand[1] - y) > (ARRIVED if waypoints else AT_REST):
                return state.errand
            state.errand = None
        if not waypoints:
            return x, y
        goal = waypoints[state.waypoint]
        if math.hypot(goal[0] - x, goal[1] - y) < ARRIVED:
            state.waypoint = (state.waypoint + 1) % len(waypoints)
            state.pausing = state.agent.pause
            goal = waypoints[state.waypoint]
        return goal

    def _drive(self, state: AgentState) -> None:
        agent, goal = state.agent, self._goal(state)
        if not state.points:  # arrived at the end of its errand
            self._stand(state)
            return
        yielding, rounding = agent.behaviour == "yield", len(state.detour) > 0
        free, gap = (state.free, state.gap) if yielding else (math.inf, math.inf)
        if state.errand is not None and not agent.waypoints:  # slow enough to stop there
            free = min(free, math.hypot(state.errand[0] - state.pose[0], state.errand[1] - state.pose[1]))
        left = self._steer(state, goal, free, gap, rounding=rounding)
        if yielding:
            state.free = left
        if state.waiting > 0.0 and state.v <= CREEP:
            state.mode = "waiting"
        else:
            state.mode = "going round" if rounding else "driving"
