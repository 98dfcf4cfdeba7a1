"""Geometry of the hand: hover points, tilt and yaw.

Horizontal positions of the hand are polar about the arm mount, in the base frame: radius [m] and azimuth [rad]. The
hand swings in these coordinates, so it never crosses the arm's own column.
"""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.arm_kernels import ELBOW_OFFSET, LOWER, SHOULDER, TOOL, UPPER, WRIST
from motm_twin.model.compiler import njit
from motm_twin.model.exact import hypot, norm, product, wrap_angle
from motm_twin.model.geometry import Array

QUARTER = math.pi / 2.0
_UPPER, _LOWER = math.hypot(UPPER, ELBOW_OFFSET), math.hypot(LOWER, ELBOW_OFFSET)  # [m] shoulder, elbow, joint 6
STRAIGHT = _UPPER + _LOWER  # [m] joint 6 from the shoulder, elbow straight
ELBOW = -math.atan(ELBOW_OFFSET / UPPER) - math.atan(ELBOW_OFFSET / LOWER)  # [rad] joint 4, straight; no limit near


@njit(cache=True)
def mount_point(pose: Array, mount: Array) -> Array:
    """Position of the arm mount in the frame of the base pose [m], shape (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([pose[0] + c * mount[0] - s * mount[1], pose[1] + s * mount[0] + c * mount[1], mount[2]])


@njit(cache=True)
def polar(point: Array, pose: Array, mount: Array) -> tuple[float, float]:
    """Radius and azimuth of a point about the mount, azimuth in the base frame."""
    m = mount_point(pose, mount)
    dx, dy = point[0] - m[0], point[1] - m[1]
    return hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - pose[2])


@njit(cache=True)
def from_polar(radius: float, azimuth: float, z: float, pose: Array, mount: Array) -> Array:
    """The point at radius, azimuth (base frame) and height z, in the frame of the base pose, shape (3,)."""
    m = mount_point(pose, mount)
    angle = azimuth + pose[2]
    return np.array([m[0] + radius * math.cos(angle), m[1] + radius * math.sin(angle), z])


@njit(cache=True)
def stretch(radius: float, height: float, tilt: float) -> float:
    """Distance [m] of joint 6 from the shoulder with the tool centre point at radius and height [m] over the mount.

    The tool is tilted outwards by ``tilt`` and the arm stands in one plane. The elbow allows `STRAIGHT` at most.
    """
    c, s = math.cos(tilt), math.sin(tilt)
    return hypot(radius - TOOL * s - WRIST * c, height + TOOL * c - WRIST * s - SHOULDER)


@njit(cache=True)
def reach_radius(height: float, tilt: float, longest: float) -> float:
    """Radius [m] from the mount at which `stretch` is ``longest``; 0 when the height alone is too much."""
    c, s = math.cos(tilt), math.sin(tilt)
    z = height + TOOL * c - WRIST * s - SHOULDER
    return max(0.0, TOOL * s + WRIST * c + math.sqrt(max(0.0, longest * longest - z * z)))


def reach_height(radius: float, tilt: float, longest: float) -> float:
    """Greatest height [m] over the mount at which `stretch` is at most ``longest``; if none, that of a level reach."""
    c, s = math.cos(tilt), math.sin(tilt)
    out = radius - TOOL * s - WRIST * c
    return SHOULDER + WRIST * s - TOOL * c + math.sqrt(max(0.0, longest * longest - out * out))


def planar_joints(radius: float, height: float, tilt: float) -> Array:
    """Joints [rad] of an arm in one plane at azimuth 0: tool centre point at radius and height [m], tilted outwards.

    Elbow up and behind. ValueError when the point is out of reach.
    """
    c, s = math.cos(tilt), math.sin(tilt)
    x, z = radius - TOOL * s - WRIST * c, height + TOOL * c - WRIST * s - SHOULDER
    upper, lower = _UPPER, _LOWER
    cosine = (upper**2 + lower**2 - x * x - z * z) / (2.0 * upper * lower)
    if abs(cosine) > 1.0:
        raise ValueError(f"radius {radius} m, height {height} m over the mount: out of reach of the arm")
    inner = math.acos(cosine)
    q4 = ELBOW - (math.pi - inner)
    first = math.atan2(x, z) - math.atan2(lower * math.sin(inner), upper - lower * math.cos(inner))
    q2 = first - math.atan(ELBOW_OFFSET / UPPER)
    q6 = tilt + q2 - q4
    return np.array([0.0, q2, 0.0, q4, 0.0, q6, math.pi / 4.0])


@njit(cache=True)
def tilt_for(radius: float, height: float, longest: float, largest: float) -> float:
    """Least outward tilt [rad], at most ``largest``, with which radius and height [m] are within ``longest``."""
    if stretch(radius, height, 0.0) <= longest:
        return 0.0
    low, high = 0.0, largest
    for _ in range(12):
        middle = 0.5 * (low + high)
        if stretch(radius, height, middle) <= longest:
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def pose_at(time: float, now: Array, times: Array, poses: Array) -> Array:
    """Base pose that the local plan predicts after ``time`` [s], linear between its nodes; shape (3,)."""
    previous_time, previous = 0.0, now[:3].copy()
    if time <= 0.0:
        return previous
    for k in range(len(times)):
        node = poses[k, :3].copy()
        if times[k] >= time:
            part = (time - previous_time) / max(times[k] - previous_time, 1e-6)
            pose = previous + part * (node - previous)
            pose[2] = wrap_angle(previous[2] + part * wrap_angle(node[2] - previous[2]))
            return pose
        previous_time, previous = times[k], node
    return previous


def cube_yaw(yaw: float, near: float) -> float:
    """The yaw among yaw + k 90 deg that is nearest to ``near``; not wrapped, so that it stays continuous."""
    return near + math.remainder(yaw - near, QUARTER)


@njit(cache=True)
def tool_rotation(yaw: float, tilt: float, outward: float) -> Array:
    """Hand pointing down with x axis at ``yaw``, then tilted by ``tilt`` so that it points to azimuth ``outward``."""
    cy, sy = math.cos(yaw), math.sin(yaw)
    down = np.array([[cy, sy, 0.0], [sy, -cy, 0.0], [0.0, 0.0, -1.0]])
    ax, ay = math.sin(outward), -math.cos(outward)
    c, s = math.cos(tilt), math.sin(tilt)
    t = 1.0 - c
    turn = np.array(
        [[c + ax * ax * t, ax * ay * t, ay * s], [ax * ay * t, c + ay * ay * t, -ax * s], [-ay * s, ax * s, c]]
    )
    return product(turn, down)


@njit(cache=True)
def rotation_error(R: Array, R_desired: Array) -> Array:
    """Rotation vector that turns R into R_desired, in their common frame [rad], shape (3,)."""
    E = product(R_desired, R.T)
    v = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
    sine = 0.5 * math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    cosine = 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if sine < 1e-9:
        return 0.5 * v
    return v * (0.5 * angle / sine)


@njit(cache=True)
def tilt_of(R: Array) -> float:
    """Angle of the tool axis from straight down [rad]."""
    return math.acos(min(1.0, max(-1.0, -R[2, 2])))


def hand_yaw(R: Array) -> float:
    """Yaw of the hand that `tool_rotation` was given, whatever the tilt [rad]."""
    return math.atan2(R[1, 0] + R[0, 1], R[0, 0] - R[1, 1])


@njit(cache=True)
def carried_velocity(point: Array, pose: Array, twist: Array) -> Array:
    """Velocity of a point fixed to the moving base [m/s], shape (3,)."""
    v, w = twist
    return np.array(
        [v * math.cos(pose[2]) - w * (point[1] - pose[1]), v * math.sin(pose[2]) + w * (point[0] - pose[0]), 0.0]
    )


@njit(cache=True)
def capped(vector: Array, limit: float) -> Array:
    """The vector, shortened to at most ``limit``."""
    length = norm(vector)
    return vector if length <= limit else vector * (limit / length)


_HEAVY = 1e4  # cost of missing room, against that of the same distance: the least missing room comes first


@njit(cache=True)
def release_point(centre: Array, yaw: float, half: float, mount: Array, radii: Array, taken: Array) -> Array:
    """The point of the release square that the arm reaches best and that is free, or as free as any in reach.

    ``radii`` (2,) [m] from the mount: the one preferred, and the reach. ``taken``: squares round the objects in the
    bin, along its axes, that no other centre may enter: x, y, half side [m], shape (n, 3).
    """
    away = centre[:2] - mount[:2]
    distance = norm(away)
    desired = -away * max(0.0, 1.0 - radii[0] / max(distance, 1e-6))
    c, s = math.cos(yaw), math.sin(yaw)
    x = min(max(c * desired[0] + s * desired[1], -half), half)
    y = min(max(-s * desired[0] + c * desired[1], -half), half)
    if taken.shape[0]:
        origin = np.array([-c * away[0] - s * away[1], s * away[0] - c * away[1]])
        x, y = _freest(x, y, half, origin, radii[1], _along(centre, c, s, taken))
    return np.array([centre[0] + c * x - s * y, centre[1] + s * x + c * y])


@njit(cache=True)
def room_at(point: Array, centre: Array, yaw: float, taken: Array) -> float:
    """Room [m] of a point (x, y, ...) beside objects in a bin; negative: as much is missing; inf: no object."""
    c, s = math.cos(yaw), math.sin(yaw)
    dx, dy = point[0] - centre[0], point[1] - centre[1]
    return _room(c * dx + s * dy, -s * dx + c * dy, _along(centre, c, s, taken))


@njit(cache=True)
def _along(centre: Array, c: float, s: float, taken: Array) -> Array:
    """The squares ``taken`` in the frame of the bin's centre and axes."""
    there = taken.copy()
    for i in range(there.shape[0]):
        dx, dy = taken[i, 0] - centre[0], taken[i, 1] - centre[1]
        there[i, 0], there[i, 1] = c * dx + s * dy, -s * dx + c * dy
    return there


@njit(cache=True)
def _room(x: float, y: float, there: Array) -> float:
    room = math.inf
    for i in range(there.shape[0]):
        room = min(room, max(abs(x - there[i, 0]), abs(y - there[i, 1])) - there[i, 2])
    return room


@njit(cache=True)
def _freest(x: float, y: float, half: float, mount: Array, reach: float, there: Array) -> tuple[float, float]:
    """The free point of a square nearest to (x, y); each coordinate is the given one, an edge, or beside an object."""
    reach = max(reach, hypot(x - mount[0], y - mount[1])) + 1e-9
    count = there.shape[0]
    xs, ys = np.empty(3 + 2 * count), np.empty(3 + 2 * count)
    xs[:3], ys[:3] = (x, -half, half), (y, -half, half)
    for i in range(count):
        for k in range(2):
            off = (2 * k - 1) * (there[i, 2] + 1e-9)
            xs[3 + 2 * i + k] = min(max(there[i, 0] + off, -half), half)
            ys[3 + 2 * i + k] = min(max(there[i, 1] + off, -half), half)
    best, bx, by = math.inf, x, y
    for u in xs:
        for v in ys:
            if hypot(u - mount[0], v - mount[1]) > reach:
                continue
            cost = hypot(u - x, v - y) + _HEAVY * max(0.0, -_room(u, v, there))
            if cost < best:
                best, bx, by = cost, u, v
    return bx, by


@njit(cache=True)
def nearest_distance(gripper: Array, points: Array) -> float:
    """Horizontal distance [m] of the gripper centre to the nearest seen point, inf when there is none."""
    nearest = math.inf
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - gripper[0], points[i, 1] - gripper[1]
        nearest = min(nearest, dx * dx + dy * dy)
    return math.sqrt(nearest)


@njit(cache=True)
def nearest_static(gripper: Array, points: Array, static: NDArray[np.bool_]) -> float:
    """`nearest_distance` to static points only."""
    nearest = math.inf
    for i in range(points.shape[0]):
        if static[i]:
            nearest = min(nearest, math.hypot(points[i, 0] - gripper[0], points[i, 1] - gripper[1]))
    return nearest
