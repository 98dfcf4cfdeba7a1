"""Speed limits of elbow, forearm and wrist towards what the lidar sees outside the map, as rows of the QP.

The paper limits one point, the gripper's centre. That is not enough beside a person or a Temi: while the hand is over
the table, the elbow swings out behind it. As in the paper, whatever the lidar sees counts as tall.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.control.furniture import HAND_BODY, IntArray, damper_rows
from motm_twin.control.parameters import Numbers
from motm_twin.model.geometry import Array

_REACH = 1.2  # [m] from the mount: no part of the arm is further out
_HALF_CELL = 0.025  # [m] a seen point is the centre of a map cell


@njit(cache=True)
def seen_rows(
    T: Array, frame: IntArray, centre: Array, ball_radius: Array, body: IntArray,
    points: Array, static: NDArray[np.bool_], standing: bool, mount: Array, pose: Array, base_mount: Array,
    avoidance: Numbers,
) -> tuple[Array, Array, IntArray]:  # fmt: skip
    """Rows over (v, w, arm), shape (k, 9), their bounds [m/s], shape (k,), and the body of each.

    Of the static points, if ``standing``, which are not approached further, or of the moving ones, which are retreated
    from. ``mount`` is in the odometry frame, ``base_mount`` in the base.
    """
    a = avoidance[0]
    d_s, d_i = (a.static_link_d_s, a.static_link_d_i) if standing else (a.link_d_s, a.link_d_i)
    near = np.empty(points.shape)
    count = 0
    for k in range(points.shape[0]):
        dx, dy = points[k, 0] - mount[0], points[k, 1] - mount[1]
        if static[k] == standing and dx * dx + dy * dy < _REACH * _REACH:
            near[count, 0], near[count, 1] = points[k, 0], points[k, 1]
            count += 1
    if count == 0:
        return np.empty((0, 9)), np.empty(0), np.empty(0, dtype=np.int64)
    distance, normal, ball = seen_distances(
        T, frame, centre, ball_radius, body, HAND_BODY, d_i, near[:count], mount, pose[2]
    )
    rows, limits, which = damper_rows(
        T, frame, centre, distance, normal, ball, np.full(HAND_BODY, d_s), np.full(HAND_BODY, d_i), a.xi, 0.0, pose,
        base_mount,
    )  # fmt: skip
    if standing:
        for k in range(len(limits)):
            limits[k] = max(limits[k], 0.0)
    return rows, limits, which


@njit(cache=True)
def seen_distances(
    T: Array,
    frame: IntArray,
    centre: Array,
    ball_radius: Array,
    body: IntArray,
    bodies: int,
    d_i: float,
    points: Array,
    mount: Array,
    heading: float,
) -> tuple[Array, Array, IntArray]:
    """Horizontal distance of the nearest ball of each of the first `bodies` to the nearest point, when below d_i.

    Shapes (bodies, 1), (bodies, 1, 3) away from the point, and (bodies, 1) index of the ball; odometry frame.
    """
    distance = np.full((bodies, 1), np.inf)
    normal = np.zeros((bodies, 1, 3))
    ball = np.zeros((bodies, 1), dtype=np.int64)
    c, s = math.cos(heading), math.sin(heading)
    for i in range(frame.shape[0]):
        b = body[i]
        if b >= bodies or ball_radius[i] <= 0.0:
            continue
        f = frame[i]
        px = T[f, 0, 3] + T[f, 0, 0] * centre[i, 0] + T[f, 0, 1] * centre[i, 1] + T[f, 0, 2] * centre[i, 2]
        py = T[f, 1, 3] + T[f, 1, 0] * centre[i, 0] + T[f, 1, 1] * centre[i, 1] + T[f, 1, 2] * centre[i, 2]
        x, y = mount[0] + c * px - s * py, mount[1] + s * px + c * py
        own = ball_radius[i] + _HALF_CELL
        least = max(0.0, min(d_i, distance[b, 0]) + own) ** 2
        for k in range(points.shape[0]):
            dx, dy = x - points[k, 0], y - points[k, 1]
            square = dx * dx + dy * dy
            if square < least and square > 1e-12:
                least, length = square, math.sqrt(square)
                distance[b, 0] = length - own
                normal[b, 0, 0], normal[b, 0, 1] = dx / length, dy / length
                ball[b, 0] = i
    return distance, normal, ball
