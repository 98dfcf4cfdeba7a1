"""Driving by hand: a twist that a person or program gives replaces the plan of the base for a moment.

The twist is limited to what the base can do, and to speeds from which the base can stop clear of all obstacles in the
map. The monitor checks every command as usual, but relies on plans that avoid obstacles: alone it would not stop a
driver who keeps pushing towards one.
"""

import math
from dataclasses import dataclass

import numpy as np

from motm_twin.model.edits import Drive
from motm_twin.model.geometry import Array
from motm_twin.model.motion import drive
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.collision import body_of, clearance, field_of
from motm_twin.planning.parameters import StaaParameters
from motm_twin.planning.types import BasePlan, BaseProblem, PlanStatus

SHARES = (1.0, 0.75, 0.5, 0.25, 0.1)  # of the twist, tried in this order
HOLD = 0.3  # [s] that one twist lasts; then the robot goes on with its tasks


@dataclass
class ByHandState:
    """The twist that was given last."""

    v: float = 0.0  # [m/s]
    w: float = 0.0  # [rad/s]
    left: int = 0  # periods


class ByHand(Stateful[ByHandState]):
    """Remembers the twist that was given, until `HOLD` has passed."""

    def __init__(self, profile: RobotProfile, period: float, margin: float = StaaParameters().margin) -> None:
        """``period`` [s] of control; ``margin`` [m] to keep from obstacles, as plans do."""
        self._limits, self._hold, self._body = profile.base, round(HOLD / period), body_of(profile.footprint)
        self.margin = margin
        self._state = ByHandState()

    def take(self, edit: Drive) -> None:
        """Accept a twist, for the period that begins now and those after it until `HOLD` has passed."""
        self._state = ByHandState(v=edit.v, w=edit.w, left=self._hold)

    def plan(self, problem: BaseProblem) -> BasePlan | None:
        """The plan of this period while somebody drives; None when nobody does."""
        state = self._state
        if state.left <= 0:
            return None
        state.left -= 1
        b = self._limits
        desired = np.array(
            [min(max(state.v, -b.reverse_speed), b.forward_speed), min(max(state.w, -b.yaw_rate), b.yaw_rate)]
        )
        share, room = self._free_share(problem, desired)
        slowed = "" if share == 1.0 else "slowed"
        return BasePlan(
            acceleration=self._towards(problem, share * desired),
            status=PlanStatus.BY_HAND,
            why=Reason(kind=Kind.BY_HAND, other=slowed, value=max(room, 0.0), unit="m"),
            intermediate_goal=np.full(3, math.nan),
            local_poses=np.zeros((0, 5)),
            local_times=np.zeros(0),
            t_h=math.inf,
            time_to_range=math.inf,
        )

    def _towards(self, problem: BaseProblem, twist: Array) -> Array:
        most = np.array([self._limits.linear_acceleration, self._limits.yaw_acceleration])
        return np.clip((twist - problem.twist) / problem.period, -most, most)

    def _free_share(self, problem: BaseProblem, desired: Array) -> tuple[float, float]:
        """Largest share of a twist after which the base can still stop clear of all obstacles; present clearance [m].

        A base nearer than the margin to an obstacle may do anything that brings it no nearer.
        """
        field, b, dt = field_of(problem.world), self._limits, problem.period
        x, y, heading = problem.pose
        room = float(clearance(x, y, heading, 1.0, field, self._body))
        for share in SHARES:
            v, w = problem.twist + self._towards(problem, share * desired) * dt
            x, y, heading = drive(problem.pose, 0.5 * (v + problem.twist[0]), 0.5 * (w + problem.twist[1]), dt)
            a_max, b_max = b.linear_acceleration, b.yaw_acceleration
            left = stopping_clearance(x, y, heading, v, w, a_max, b_max, self.margin, field, self._body)
            if left >= min(self.margin, room):
                return share, room
        return 0.0, room
