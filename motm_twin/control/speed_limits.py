"""Speed limits of the whole arm towards mapped furniture, the robot's own base and what the lidar sees, as QP rows."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.control.arm_avoidance import lidar_limits
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
from motm_twin.control.parameters import AvoidanceParameters, Numbers, numbers
from motm_twin.control.qp_rows import FURNITURE_ELASTIC, LIDAR_ELASTIC, SIZE, elastic_rows
from motm_twin.control.seen_rows import seen_rows
from motm_twin.control.types import ArmInputs
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld

_OWN_ROWS = 8
_DEEP = -0.10  # [m/s] no row of furniture asks for a faster retreat than this
_TOUCHING = ("final", "closing", "lift", "retry")  # phases in which the fingers are at the supporting surface
_LIDAR = ("lidar moving", "lidar static")  # rows of the gripper
_OWN_SOLIDS, _COLUMN = 2, 1  # base and column: elbow, forearm and wrist belong to the column
_SEEN = len(_LIDAR)  # where the names of rows of seen obstacles begin: one per body
_OWN = _SEEN + len(BODIES)  # and those of the robot's own base, and of furniture: body by body, solid by solid
_MAPPED = _OWN + len(BODIES) * _OWN_SOLIDS


class Rows(NamedTuple):
    """Inequality rows of one step: G x <= h."""

    G: Array  # shape (k, 17)
    h: Array  # shape (k,)
    which: IntArray  # what `SpeedLimits.names` calls the rows, shape (k,)
    tightest: int  # of the gripper's obstacles the one that limits it most: 1 static, 0 moving, -1 none is near
    allowed: float  # [m/s] its damper line, inf when none is near


class SpeedLimits:
    """The mapped furniture and the arm's balls as arrays, and the rows of one step."""

    def __init__(self, known: KnownWorld, parameters: AvoidanceParameters) -> None:
        """Furniture of the pre-made map and the robot's own base."""
        mapped, own = mapped_solids(known), own_body(known)
        assert len(own.names) == _OWN_SOLIDS
        self.names = (
            *_LIDAR,
            *(f"{body} - lidar" for body in BODIES),
            *(f"{body} - {solid}" for solids in (own, mapped) for body in BODIES for solid in solids.names),
        )
        self._arrays: tuple[Any, ...] = (*_arrays(mapped), *_arrays(own), *arm_balls(), numbers(parameters))
        self._room = parameters.sectors + parameters.moving_sectors + MAX_ROWS + _OWN_ROWS + 2 * HAND_BODY
        arm = known.robot.arm
        self._mount = np.array([arm.mount_x, arm.mount_y, arm.mount_z])

    def rows(self, view: View, state: ManipulatorState, inputs: ArmInputs, relaxing: Array) -> Rows:
        """Rows of one step; ``relaxing`` [m], shape (t, 2): grasps for which static obstacles give way."""
        G, h, which = np.empty((self._room, SIZE)), np.empty(self._room), np.empty(self._room, dtype=np.int64)
        count, tightest, allowed = _fill_rows(
            view.T, view.J, view.p, view.pose, view.mount, self._mount, inputs.T_odom_world, view.measured,
            inputs.obstacles.points, inputs.obstacles.static, relaxing, view.width,
            state.side if state.holding else 0.0, state.phase in _TOUCHING, view.beta, G, h, which, *self._arrays,
        )  # fmt: skip
        return Rows(G[:count], h[:count], which[:count], tightest, allowed)


def _arrays(solids: Solids) -> tuple[IntArray, Array, Array, Array, Array]:
    return solids.first, solids.vertices, solids.radius, solids.z, solid_bounds(solids)


@njit(cache=True)
def _fill_rows(
    T: Array, J: Array, p: Array, pose: Array, mount: Array, base_mount: Array, T_odom_world: Array, measured: Array,
    points: Array, static: NDArray[np.bool_], relaxing: Array,
    width: float, held: float, touching: bool, beta: float, G: Array, h: Array, which: IntArray,
    first: IntArray, vertices: Array, radius: Array, z: Array, bounds: Array,
    own_first: IntArray, own_vertices: Array, own_radius: Array, own_z: Array, own_bounds: Array,
    frame: IntArray, centre: Array, ball_radius: Array, body: IntArray,
    avoidance: Numbers,
) -> tuple[int, int, float]:  # fmt: skip
    """Fill in rows of gripper, mapped furniture, own base and seen obstacles; returns how many, and the tightest.

    ``mount`` [m] is in the odometry frame, ``base_mount`` in the base.
    """
    a = avoidance[0]
    centre, ball_radius = placed(centre, ball_radius, width, held)
    d_s, d_i = _distances(avoidance, touching)
    rows, limits = np.empty((len(h), 9)), np.empty(len(h))

    gripper = lidar_limits(p, points, static, relaxing, avoidance)
    count = nearby = len(gripper.allowed)
    if nearby:
        normal = np.zeros((nearby, 3))
        normal[:, :2] = gripper.normal
        rows[:nearby], limits[:nearby] = normal @ J[:3], gripper.allowed
        for k in range(nearby):
            which[k] = 1 if gripper.static[k] else 0
    if z.shape[0]:
        turn = T_odom_world[2]
        c, s = math.cos(turn), math.sin(turn)
        dx, dy = mount[0] - T_odom_world[0], mount[1] - T_odom_world[1]
        there = np.array([c * dx + s * dy, -s * dx + c * dy, pose[2] - turn])
        distance, away, ball = body_distances(
            T, frame, centre, ball_radius, body, len(BODIES), d_i, there, base_mount[2],
            first, vertices, radius, z, bounds, np.int64(-1),
        )  # fmt: skip
        new, most, names = damper_rows(T, frame, centre, distance, away, ball, d_s, d_i, a.xi, turn, pose, base_mount)
        count = _added(rows, limits, which, count, new[:MAX_ROWS], most[:MAX_ROWS], _MAPPED + names, _DEEP)
    there = np.array([base_mount[0], base_mount[1], 0.0])
    distance, away, ball = body_distances(
        T, frame, centre, ball_radius, body, len(BODIES), d_i, there, base_mount[2],
        own_first, own_vertices, own_radius, own_z, own_bounds, np.int64(_COLUMN),
    )  # fmt: skip
    new, most, names = damper_rows(T, frame, centre, distance, away, ball, d_s, d_i, a.xi, pose[2], pose, base_mount)
    new[:, :2] = 0.0  # the base carries its own body along
    seen = count = _added(rows, limits, which, count, new[:_OWN_ROWS], most[:_OWN_ROWS], _OWN + names, _DEEP)
    if a.enabled and points.shape[0]:
        for standing in (False, True):
            new, most, names = seen_rows(
                T, frame, centre, ball_radius, body, points, static, standing, mount, pose, base_mount, avoidance
            )
            count = _added(rows, limits, which, count, new, most, _SEEN + names, -np.inf)

    G[:count], h[:count] = elastic_rows(rows[:count], limits[:count], nearby, beta, measured)
    for k in range(seen, count):  # these give way together with the gripper's lidar rows:
        G[k, FURNITURE_ELASTIC], G[k, LIDAR_ELASTIC] = 0.0, -1.0  # mapped furniture must not give way for them
    if nearby == 0:
        return count, -1, np.inf
    tightest = np.argmin(gripper.allowed)
    return count, which[tightest], gripper.allowed[tightest]


@njit(cache=True)
def _added(
    rows: Array, limits: Array, which: IntArray, count: int, new: Array, most: Array, names: IntArray, deepest: float
) -> int:
    """Append rows with limits of at least ``deepest`` [m/s] to the first ``count`` ones; returns how many there are."""
    for k in range(len(most)):
        rows[count + k], limits[count + k], which[count + k] = new[k], max(most[k], deepest), names[k]
    return count + len(most)


@njit(cache=True)
def _distances(avoidance: Numbers, touching: bool) -> tuple[Array, Array]:
    """d_s and d_i of each body [m], shape (6,): smaller for what is at the supporting surface during a grasp."""
    a = avoidance[0]
    d_s, d_i = np.full(len(BODIES), a.furniture_d_s), np.full(len(BODIES), a.furniture_d_i)
    if touching:
        d_s[FINGERS], d_i[FINGERS] = a.fingers_d_s, a.fingers_d_i
        d_s[HELD], d_i[HELD] = -a.fingers_d_i, a.fingers_d_s
    return d_s, d_i
