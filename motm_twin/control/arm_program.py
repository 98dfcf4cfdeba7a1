"""The quadratic program of one arm step, filled in by one kernel: speed limits, cost, rows of the hand, bounds."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.control.arm_view import ManipulatorState, View
from motm_twin.control.furniture import IntArray
from motm_twin.control.parameters import ArmParameters
from motm_twin.control.qp import Program
from motm_twin.control.qp_rows import SLACK, anchor, fill_program, weights
from motm_twin.control.slate import SIZE, Record, Slate
from motm_twin.control.speed_limits import SpeedLimits, fill_rows
from motm_twin.control.types import ArmInputs
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld

_SLACKS = SLACK.start, SLACK.stop - SLACK.start
_SWINGING = ("stow", "carry", "transit")
AT_SUPPORT = ("final", "closing", "lift", "retry")  # phases in which the fingers are at the supporting surface


class Rows(NamedTuple):
    """What the inequality rows of one step are."""

    count: int
    which: IntArray  # what `SpeedLimits.names` calls them, in the first ``count``
    tightest: int  # of the gripper's obstacles the one that limits it most: 1 static, 0 moving, -1 none is near
    allowed: float  # [m/s] its damper line, inf when none is near


class ArmProgram:
    """min 1/2 x'Px + c'x: track v_B, small arm rates, manipulability, little slack; s.t. the hand's velocity."""

    def __init__(self, known: KnownWorld, parameters: ArmParameters) -> None:
        """Programs of one robot among its mapped furniture."""
        p = parameters
        self._limits = SpeedLimits(known, p.avoidance)
        self.names = self._limits.names
        self._blind = p.avoidance.blind
        self._lag = known.robot.arm.velocity_lag
        self._weights = {swinging: weights(p.qp, swinging=swinging) for swinging in (False, True)}
        room = self._limits.room
        self._G, self._h, self._which = np.empty((room, SIZE)), np.empty(room), np.empty(room, dtype=np.int64)
        self._arrays = (self._G, self._h, self._which, *self._limits.arrays)

    def fill(
        self, slate: Slate, view: View, state: ManipulatorState, inputs: ArmInputs, relaxing: Array
    ) -> tuple[Program, Rows]:
        """The program of one step, valid until the next, for the hand's velocity on the slate.

        ``relaxing`` [m], shape (t, 2): grasps for which static obstacles give way. The commands that the state
        remembers are kept near what the robot does, should somebody else have commanded it.
        """
        swinging = state.phase in _SWINGING
        slate.blind[0] = self._blind if inputs.observation.ahead > 0.0 else 0.0
        cost = self._weights[swinging]
        count, tightest, allowed = _fill(
            slate.record, inputs.obstacles.points, inputs.obstacles.static, relaxing, state.twist, state.rates, cost,
            view.manipulability, view.beta, inputs.dt, self._lag, view.width, state.side if state.holding else 0.0,
            state.phase in AT_SUPPORT, swinging, *self._arrays,
        )  # fmt: skip
        program = Program(
            P=cost, c=slate.c, A=slate.A, b=slate.b, G=self._G[:count], h=self._h[:count], lower=slate.lower,
            upper=slate.upper, slack=_SLACKS,
        )  # fmt: skip
        return program, Rows(count, self._which, tightest, allowed)


@njit(cache=True)
def _fill(
    slate: Record, points: Array, static: NDArray[np.bool_], relaxing: Array, twist: Array, rates: Array, cost: Array,
    dexterity: float, beta: float, dt: float, lag: float, width: float, held: float, touching: bool, swinging: bool,
    G: Array, h: Array, which: IntArray,
    first: IntArray, vertices: Array, radius: Array, z: Array, bounds: Array,
    own_first: IntArray, own_vertices: Array, own_radius: Array, own_z: Array, own_bounds: Array,
    frame: IntArray, centre: Array, ball_radius: Array, body: IntArray,
) -> tuple[int, int, float]:  # fmt: skip
    """`anchor`, `fill_rows` and `fill_program`; returns what `fill_rows` does."""
    anchor(slate, twist, rates, dt, lag)
    found = fill_rows(
        slate, points, static, relaxing, width, held, touching, swinging, beta, G, h, which,
        first, vertices, radius, z, bounds, own_first, own_vertices, own_radius, own_z, own_bounds,
        frame, centre, ball_radius, body,
    )  # fmt: skip
    fill_program(slate, twist, rates, cost, dexterity, beta, dt, swinging)
    return found
