"""Speed limits of the whole arm towards mapped furniture, the robot's own base and what the lidar sees, as QP rows."""

import math

import numpy as np

from motm_twin.control.arm_view import ManipulatorState, View
from motm_twin.control.furniture import (
    BODIES,
    FINGERS,
    HAND_BODY,
    HELD,
    MAX_ROWS,
    IntArray,
    Solids,
    arm_balls,
    body_distances,
    damper_rows,
    mapped_solids,
    own_body,
    placed,
    solid_bounds,
)
from motm_twin.control.parameters import AvoidanceParameters
from motm_twin.control.seen_rows import seen_rows
from motm_twin.control.types import ArmObstacles
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld

_OWN_ROWS = 8
SEEN = 1_000_000  # what rows of seen obstacles are named by begins here
_DEEP = -0.10  # [m/s] no row of furniture asks for a faster retreat than this
_TOUCHING = ("final", "closing", "lift", "retry")  # phases in which the fingers are at the supporting surface


class FurnitureRows:
    """The mapped furniture and the arm's balls as arrays, and the rows of one step."""

    def __init__(self, known: KnownWorld, parameters: AvoidanceParameters) -> None:
        """Furniture of the pre-made map and the robot's own base."""
        self.parameters = parameters
        self.solids = mapped_solids(known)
        self.own = own_body(known)
        self._bounds = solid_bounds(self.solids)
        self._own_bounds = solid_bounds(self.own)
        self._balls = arm_balls()
        arm = known.robot.arm
        self._mount = np.array([arm.mount_x, arm.mount_y, arm.mount_z])

    def rows(
        self, view: View, state: ManipulatorState, T_odom_world: Array, seen: ArmObstacles
    ) -> tuple[Array, Array, IntArray]:
        """Rows over (v, w, arm), shape (k, 9), their bounds [m/s], shape (k,), and what `name` names them by."""
        held = state.side if state.holding else 0.0
        centre, radius = placed(self._balls, view.width, held)
        d_s, d_i = self._distances(state)
        parts = []
        if len(self.solids.names):
            turn = float(T_odom_world[2])
            c, s = math.cos(turn), math.sin(turn)
            dx, dy = view.mount[0] - T_odom_world[0], view.mount[1] - T_odom_world[1]
            mount = np.array([c * dx + s * dy, -s * dx + c * dy, view.pose[2] - turn])
            parts.append(
                self._side(view, centre, radius, d_s, d_i, mount, self.solids, self._bounds, turn, MAX_ROWS, own=False)
            )
        mount = np.array([self._mount[0], self._mount[1], 0.0])
        parts.append(
            self._side(
                view,
                centre,
                radius,
                d_s,
                d_i,
                mount,
                self.own,
                self._own_bounds,
                float(view.pose[2]),
                _OWN_ROWS,
                own=True,
            )
        )
        parts = [(rows, np.maximum(limits, _DEEP), which) for rows, limits, which in parts]
        if self.parameters.enabled and len(seen.points):
            rows, limits, bodies = seen_rows(view, self._balls, (centre, radius), seen, self._mount, self.parameters)
            parts.append((rows, limits, SEEN + bodies))
        rows, limits, which = (np.concatenate([part[k] for part in parts]) for k in range(3))
        return rows, limits, which

    def name(self, which: int) -> str:
        """Body and solid of a row."""
        solids = self.solids
        if which >= SEEN:
            return f"{BODIES[which - SEEN]} - lidar"
        if which < 0:
            solids, which = self.own, -1 - which
        body, solid = divmod(which, len(solids.names))
        return f"{BODIES[body]} - {solids.names[solid]}"

    def _side(
        self,
        view: View,
        centre: Array,
        radius: Array,
        d_s: Array,
        d_i: Array,
        mount: Array,
        solids: Solids,
        bounds: Array,
        turn: float,
        room: int,
        *,
        own: bool,
    ) -> tuple[Array, Array, IntArray]:
        distance, normal, ball = body_distances(
            view.T,
            self._balls.frame,
            centre,
            radius,
            self._balls.body,
            len(BODIES),
            d_i,
            mount,
            float(self._mount[2]),
            solids.first,
            solids.vertices,
            solids.radius,
            solids.z,
            bounds,
        )
        if own:
            distance[:HAND_BODY, 1] = np.inf  # elbow, forearm and wrist belong to the column
        rows, limits, which = damper_rows(
            view.T,
            self._balls.frame,
            centre,
            distance,
            normal,
            ball,
            d_s,
            d_i,
            self.parameters.xi,
            turn,
            view.pose,
            self._mount,
            room,
        )
        if own:
            rows[:, :2] = 0.0  # the base carries its own body along
        return rows, limits, -1 - which if own else which

    def _distances(self, state: ManipulatorState) -> tuple[Array, Array]:
        """d_s and d_i of each body: smaller for what is at the supporting surface during a grasp."""
        p = self.parameters
        d_s, d_i = np.full(len(BODIES), p.furniture_d_s), np.full(len(BODIES), p.furniture_d_i)
        if state.phase in _TOUCHING:
            d_s[FINGERS], d_i[FINGERS] = p.fingers_d_s, p.fingers_d_i
            d_s[HELD], d_i[HELD] = -p.fingers_d_i, p.fingers_d_s
        return d_s, d_i
