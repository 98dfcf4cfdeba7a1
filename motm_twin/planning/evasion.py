"""Moving out of the way of dynamic obstacles that are about to meet the base.

A dynamic obstacle is expected to go straight on at its measured velocity for a few seconds. The room that it is given
grows with time, as does the error of that prediction. Where the plan of the period enters this room, or the base stands
in it, the motion that best stays out of it is driven instead: one of 25 twists for a second, then one of 25 again.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from motm_twin.model.geometry import Array, frozen
from motm_twin.model.known import KnownWorld
from motm_twin.model.motion import kernel, step
from motm_twin.model.passive_safety import BRAKES_BOTH, NO_ARM, Stop, met_in_stop, stop_of
from motm_twin.model.profile import BaseLimits
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful
from motm_twin.perception.still_map import StaticMap
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.collision import Body, Field, clearance, field_of
from motm_twin.planning.encounters import STEP, encounters, near
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.prediction import GOES, SPREAD, gap_to_point
from motm_twin.planning.types import BasePlan, BaseProblem, Encounter, PlanStatus

LOOKS, LOOKED = 3, 15  # steps between two tests of the stop, and the last step that is tested
UNSAFE = 0.3  # [s] cost of a state that is not passively safe


class Room(NamedTuple):
    """Room left to dynamic obstacles, which grows with time."""

    now: float  # [m]
    grows: float  # [m/s]


@dataclass
class EvasionState:
    """State between periods."""

    out_of_way: bool = False  # the last plan was an evasion


class Evasion(Protocol):
    """A policy for dynamic obstacles that come too near."""

    def instead(self, problem: BaseProblem, plan: BasePlan, body: Body, limits: BaseLimits) -> BasePlan:
        """The plan that is driven."""
        ...


class StandsItsGround:
    """No evasion: dynamic obstacles are obstacles at their present place (Paper)."""

    def instead(self, problem: BaseProblem, plan: BasePlan, body: Body, limits: BaseLimits) -> BasePlan:
        """The plan as it is."""
        return plan


class MakesWay(Stateful[EvasionState]):
    """Evades dynamic obstacles that would meet the base."""

    def __init__(self, known: KnownWorld, parameters: PlanningParameters | None = None) -> None:
        parameters = parameters or PlanningParameters()
        self._p, self._staa = parameters.evasion, parameters.staa
        self._still = StaticMap(known)  # only its distances are read: nothing is remembered
        self._stop = stop_of(known.robot, self._p.room)
        self._state = EvasionState()

    def instead(self, problem: BaseProblem, plan: BasePlan, body: Body, limits: BaseLimits) -> BasePlan:
        """The plan, or a motion out of the way of dynamic obstacles where that is clearly better."""
        p, state = self._p, self._state
        movers = problem.world.tracks
        movers = movers[np.hypot(movers[:, 2], movers[:, 3]) >= GOES]
        out_of_way, state.out_of_way = state.out_of_way, False
        if not len(movers) + len(problem.yielding) or plan.status in (PlanStatus.BY_HAND, PlanStatus.ESCAPING):
            return plan
        here = np.array([*problem.pose, *problem.twist], dtype=np.float64)
        planned = sampled(plan, here, p.horizon)
        nearby = near(np.concatenate((movers, problem.yielding)), here, p.horizon, limits.forward_speed, body)
        plan = _with_encounters(plan, planned, nearby, body)
        movers = near(movers, here, p.horizon, limits.forward_speed, body)
        if not len(movers):
            return plan
        around = Around(movers, Room(p.room, SPREAD.along), self._stop, body)
        met = meeting(planned, around)
        least = p.engaged if problem.engaged else p.stays_out if out_of_way else p.least
        if met <= least:
            return plan
        states, best = planned.copy(), np.empty_like(planned)
        reach = Limits(
            limits.linear_acceleration,
            limits.yaw_acceleration,
            round(p.first / STEP),
            p.travel,
            self._staa.margin,
            self._staa.margin_floor,
        )
        states[0] = here
        stands = field_of(self._still.of(problem.world))
        cost = best_evasion(twists(limits), around, reach, stands, states, best)
        if cost >= met - p.gain:
            return plan
        state.out_of_way = True
        return _with_encounters(evading(plan, best, movers), best, nearby, body, plan.encounters)


def _with_encounters(
    plan: BasePlan, states: Array, movers: Array, body: Body, evaded: tuple[Encounter, ...] = ()
) -> BasePlan:
    """The plan with its encounters with movers (k, 7) on states (n, 5) every `STEP`."""
    found = encounters(states, movers, body, evaded)
    return msgspec.structs.replace(plan, encounters=found, courtesy=sum(other.courtesy for other in found))


def sampled(plan: BasePlan, here: Array, horizon: float) -> Array:
    """Poses and twists of a plan every `STEP` until the horizon [s], shape (n, 5); beyond its end the base stands."""
    times = np.arange(0.0, horizon + 0.5 * STEP, STEP)
    if len(plan.local_poses) < 2:
        return np.repeat(here[None], len(times), axis=0)
    columns = plan.local_poses.copy()
    columns[:, 2] = np.unwrap(columns[:, 2])
    return np.column_stack([np.interp(times, plan.local_times, column) for column in columns.T])


def twists(limits: BaseLimits) -> Array:
    """Twists (v, w) that are tried, shape (25, 2) or less."""
    speeds = [0.0, 0.5 * limits.forward_speed, limits.forward_speed]
    speeds += [-0.5 * limits.reverse_speed, -limits.reverse_speed] if limits.reverse_speed > 0.0 else []
    turning = [0.0, 0.3 * limits.yaw_rate, -0.3 * limits.yaw_rate, 0.8 * limits.yaw_rate, -0.8 * limits.yaw_rate]
    return np.array([(v, w) for v in speeds for w in turning])


def evading(plan: BasePlan, states: Array, movers: Array) -> BasePlan:
    """The plan that drives these states (n, 5)."""
    nearest = movers[np.argmin(np.hypot(movers[:, 0] - states[0, 0], movers[:, 1] - states[0, 1]))]
    speed = float(math.hypot(nearest[2], nearest[3]))
    return msgspec.structs.replace(
        plan,
        status=PlanStatus.ESCAPING,
        why=Reason(kind=Kind.MAKES_WAY, subject="base", value=speed, unit="m/s"),
        acceleration=frozen((states[1, 3:] - states[0, 3:]) / STEP),
        local_poses=frozen(states),
        local_times=frozen(np.arange(len(states)) * STEP),
        local_to_go=frozen(np.zeros(0)),
        time_to_range=math.inf if plan.time_to_range > 0.0 else 0.0,
    )


class Around(NamedTuple):
    """Surroundings that motions are judged by."""

    movers: Array  # tracks, (k, 7)
    room: Room
    stop: Stop
    body: Body
    arm: Array = NO_ARM  # the arm is left out


class Limits(NamedTuple):
    """Limits of the motions that are tried."""

    linear: float  # [m/s^2]
    turning: float  # [rad/s^2]
    first: int  # steps of the first of the two twists
    travel: float  # cost of the distance driven [s/m]
    clearance: float  # [m] from static obstacles
    floor: float  # [m] the same, for a base that is nearer already


@kernel
def risk(x: float, y: float, heading: float, time: float, around: Around) -> float:
    """Largest share of its room that a mover loses to the footprint after a time [s]: 0 outside it, 1 on touching."""
    c, s = math.cos(heading), math.sin(heading)
    movers, body = around.movers, around.body
    wide, most = around.room.now + around.room.grows * time, 0.0
    for k in range(movers.shape[0]):
        px, py = movers[k, 0] + time * movers[k, 2], movers[k, 1] + time * movers[k, 3]
        most = max(most, (wide - gap_to_point(x, y, c, s, px, py, body) + movers[k, 4]) / wide)
    return most


@kernel
def meeting(states: Array, around: Around) -> float:
    """Time [s] that states (n, 5) every `STEP` spend in the room of the movers, weighted by `risk`.

    States from which the base could not stop in time count too.
    """
    total = 0.0
    for i in range(1, states.shape[0]):
        total += STEP * risk(states[i, 0], states[i, 1], states[i, 2], i * STEP, around) + unsafe(i, states[i], around)
    return total


@kernel
def unsafe(i: int, state: Array, around: Around) -> float:
    """Cost [s] of a state (5,) after i steps if the base could not stop from it before it meets a mover."""
    if i % LOOKS != 0 or i > LOOKED:
        return 0.0
    here = (state[0], state[1], state[2], state[3], state[4])
    met = met_in_stop(here, (state[3], state[4]), BRAKES_BOTH, i * STEP, around.movers, around.arm, around.stop)
    return UNSAFE if met >= 0 else 0.0


@kernel
def best_evasion(tried: Array, around: Around, reach: Limits, field: Field, states: Array, best: Array) -> float:
    """Fill in the states (n, 5) of the cheapest motion by two of the twists (m, 2) in turn; cost, inf: none is free.

    ``states``: buffer for a motion; its first row is the start. The base can stop at the end of the motion. One that
    starts within ``reach.clearance`` of a static obstacle may come as near to it as ``reach.floor`` while it leaves.
    """
    last = best.shape[0] - 1
    first = min(last, reach.first)
    root = clearance(states[0, 0], states[0, 1], states[0, 2], 1.0, field, around.body)
    allowed = reach.clearance if root >= reach.clearance else min(reach.floor, root - 0.001)
    lowest = math.inf
    for i in range(tried.shape[0]):
        start = _driven(states, np.int64(0), first, tried[i], (0.0, lowest, allowed), around, reach, field)
        if start >= lowest:
            continue
        for k in range(tried.shape[0]):
            cost = _driven(states, first, last, tried[k], (start, lowest, allowed), around, reach, field)
            if cost >= lowest or not _can_stop(states[last], allowed, around, reach, field):
                continue
            lowest = cost
            for j in range(best.shape[0]):
                for m in range(5):
                    best[j, m] = states[j, m]
    return lowest


@kernel
def _can_stop(state: Array, allowed: float, around: Around, reach: Limits, field: Field) -> bool:
    x, y, heading, v, w = state[0], state[1], state[2], state[3], state[4]
    left = stopping_clearance(x, y, heading, v, w, reach.linear, reach.turning, allowed, field, around.body)
    return left >= allowed


@kernel
def _driven(
    states: Array, begin: int, end: int, twist: Array, costs: tuple[float, float, float], around: Around, reach: Limits,
    field: Field,
) -> float:  # fmt: skip
    """Fill in the states after ``begin`` up to ``end`` of a base that takes up a twist; the cost of the whole motion.

    ``costs``: the cost so far, the cost from which on a motion is useless, and the clearance to keep [m]. The result is
    inf for a motion that is not free or costs too much.
    """
    cost, limit, allowed = costs
    for i in range(begin, end):
        x, y, heading, v, w = states[i, 0], states[i, 1], states[i, 2], states[i, 3], states[i, 4]
        v_end = v + min(reach.linear * STEP, max(-reach.linear * STEP, twist[0] - v))
        w_end = w + min(reach.turning * STEP, max(-reach.turning * STEP, twist[1] - w))
        x, y, heading = step(x, y, heading, v, w, v_end, w_end, STEP)
        states[i + 1, 0], states[i + 1, 1], states[i + 1, 2], states[i + 1, 3], states[i + 1, 4] = (
            x, y, heading, v_end, w_end,
        )  # fmt: skip
        cost += STEP * risk(x, y, heading, (i + 1) * STEP, around) + reach.travel * abs(v_end) * STEP
        cost += unsafe(i + 1, states[i + 1], around)
        if cost >= limit or clearance(x, y, heading, 0.25, field, around.body) < allowed:
            return math.inf
    return cost
