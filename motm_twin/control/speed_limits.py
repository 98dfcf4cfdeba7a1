"""Speed limits of the whole arm towards mapped furniture, the robot's own base and what the lidar sees, as QP rows."""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.control.arm_avoidance import lidar_limits
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
from motm_twin.control.parameters import AvoidanceParameters, Numbers
from motm_twin.control.qp_rows import elastic_rows
from motm_twin.control.seen_rows import seen_rows
from motm_twin.control.slate import Record
from motm_twin.model.exact import product
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld

_OWN_ROWS = 12
_DEEP = -0.10  # [m/s] no row of furniture asks for a faster retreat than this
_LIDAR = ("lidar moving", "lidar static", "lidar height")  # rows of the gripper
_HEIGHT = 2  # of them the one that keeps it from sinking; it gives way like furniture, not like the other two
_OWN_SOLIDS, _COLUMN = 2, 1  # base and column: elbow, forearm and wrist belong to the column
_SEEN = len(_LIDAR)  # where the names of rows of seen obstacles begin: one per body
_OWN = _SEEN + len(BODIES)  # and those of the robot's own base, and of furniture: body by body, solid by solid
_MAPPED = _OWN + len(BODIES) * _OWN_SOLIDS


class SpeedLimits:
    """The mapped furniture and the arm's balls as arrays, as `fill_rows` has them, and the names of rows.

    ``room``: the most rows that one step can have.
    """

    def __init__(self, known: KnownWorld, parameters: AvoidanceParameters) -> None:
        """Furniture of the pre-made map and the robot's own base."""
        mapped, own = mapped_solids(known), own_body(known)
        assert len(own.names) == _OWN_SOLIDS
        self.names = (
            *_LIDAR,
            *(f"{body} - lidar" for body in BODIES),
            *(f"{body} - {solid}" for solids in (own, mapped) for body in BODIES for solid in solids.names),
        )
        self.arrays: tuple[Any, ...] = (*_arrays(mapped), *_arrays(own), *arm_balls())
        self.room = parameters.sectors + parameters.moving_sectors + 1 + MAX_ROWS + _OWN_ROWS + 2 * HAND_BODY


def _arrays(solids: Solids) -> tuple[IntArray, Array, Array, Array, Array]:
    return solids.first, solids.vertices, solids.radius, solids.z, solid_bounds(solids)


@njit(cache=True)
def fill_rows(
    slate: Record, points: Array, static: NDArray[np.bool_], relaxing: Array, width: float, held: float,
    touching: bool, swinging: bool, beta: float, G: Array, h: Array, which: IntArray,
    first: IntArray, vertices: Array, radius: Array, z: Array, bounds: Array,
    own_first: IntArray, own_vertices: Array, own_radius: Array, own_z: Array, own_bounds: Array,
    frame: IntArray, centre: Array, ball_radius: Array, body: IntArray,
) -> tuple[int, int, float]:  # fmt: skip
    """Fill in rows G x <= h of gripper, mapped furniture, own base and seen obstacles, shapes (k, 17) and (k,).

    ``relaxing`` [m], shape (t, 2): grasps for which static obstacles give way. ``which`` (k,): index of each row into
    `SpeedLimits.names`. Returns how many there are; of the gripper's obstacles the one that limits it most, 1 static, 0
    moving, -1 none is near; and its damper line [m/s], inf when none is near.
    """
    s = slate[0]
    avoidance = s.avoidance
    a = avoidance[0]
    centre, ball_radius = placed(centre, ball_radius, width, held)
    d_s, d_i = _distances(avoidance, touching, swinging, s.blind[0])

    gripper = lidar_limits(s.p, points, static, relaxing, avoidance)
    count = nearby = len(gripper.allowed)
    if nearby:
        normal = np.zeros((nearby, 3))
        normal[:, :2] = gripper.normal
        G[:nearby, :9], h[:nearby] = product(normal, s.J[:3]), gripper.allowed
        for k in range(nearby):
            which[k] = 1 if gripper.static[k] else 0
        if gripper.allowed.min() < 0.0:  # how tall it is nobody knows: the hand may be over it
            G[count, :9], h[count], which[count] = -s.J[2], 0.0, _HEIGHT
            count += 1
    if z.shape[0]:
        turn = s.T_odom_world[2]
        c, sine = math.cos(turn), math.sin(turn)
        dx, dy = s.mount[0] - s.T_odom_world[0], s.mount[1] - s.T_odom_world[1]
        there = np.array([c * dx + sine * dy, -sine * dx + c * dy, s.pose[2] - turn])
        distance, away, ball = body_distances(
            s.T, frame, centre, ball_radius, body, len(BODIES), d_i + a.furniture_lead, there, s.base_mount[2],
            first, vertices, radius, z, bounds, np.int64(-1),
        )  # fmt: skip
        new, most, names = damper_rows(
            s.T, frame, centre, distance, away, ball, d_s, d_i, a.xi, turn, s.pose, s.base_mount
        )
        count = _added(G, h, which, count, new[:MAX_ROWS], most[:MAX_ROWS], names, _MAPPED, _DEEP)
    there = np.array([s.base_mount[0], s.base_mount[1], 0.0])
    distance, away, ball = body_distances(
        s.T, frame, centre, ball_radius, body, len(BODIES), d_i, there, s.base_mount[2],
        own_first, own_vertices, own_radius, own_z, own_bounds, np.int64(_COLUMN),
    )  # fmt: skip
    new, most, names = damper_rows(
        s.T, frame, centre, distance, away, ball, d_s, d_i, a.xi, s.pose[2], s.pose, s.base_mount
    )
    new[:, :2] = 0.0  # the base carries its own body along
    seen = count = _added(G, h, which, count, new[:_OWN_ROWS], most[:_OWN_ROWS], names, _OWN, _DEEP)
    if a.enabled and points.shape[0]:
        for standing in (False, True):
            new, most, names = seen_rows(
                s.T, frame, centre, ball_radius, body, points, static, standing, s.mount, s.pose, s.base_mount,
                avoidance,
            )  # fmt: skip
            count = _added(G, h, which, count, new, most, names, _SEEN, -np.inf)

    elastic_rows(G[:count], h[:count], nearby, seen, beta, s.measured)
    if nearby == 0:
        return count, -1, np.inf
    tightest = np.argmin(gripper.allowed)
    return count, which[tightest], gripper.allowed[tightest]


@njit(cache=True)
def _added(
    G: Array, h: Array, which: IntArray, count: int, new: Array, most: Array, names: IntArray, first: int,
    deepest: float,
) -> int:  # fmt: skip
    """Append rows with limits of at least ``deepest`` [m/s], named from ``first`` on; returns how many there are."""
    for k in range(len(most)):
        G[count + k, :9], h[count + k], which[count + k] = new[k], max(most[k], deepest), first + names[k]
    return count + len(most)


@njit(cache=True)
def _distances(avoidance: Numbers, touching: bool, swinging: bool, blind: float) -> tuple[Array, Array]:
    """d_s and d_i of each body [m], shape (8,): on the way larger, at the supporting surface during a grasp smaller.

    An arm that goes on for ``blind`` [s] when it is left alone is slower: it shall come to d_s at most.
    """
    a = avoidance[0]
    d_s, d_i = np.full(len(BODIES), a.swing_d_s if swinging else a.furniture_d_s), np.full(len(BODIES), a.furniture_d_i)
    if touching:
        d_s[FINGERS:HELD], d_i[FINGERS:HELD] = a.fingers_d_s, a.fingers_d_i
        d_s[HELD], d_i[HELD] = -a.fingers_d_i, a.fingers_d_s
    return d_s, np.maximum(d_i, d_s + a.xi * blind)
