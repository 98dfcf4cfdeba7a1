"""The bodies of the arm as balls, solids at their true height, and the distances between them."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.arm_kernels import (
    CAPSULE_FRAMES,
    CAPSULE_LINKS,
    CAPSULE_P0,
    CAPSULE_P1,
    CAPSULE_RADII,
    HAND,
    HAND_LENGTH,
    TCP,
)
from motm_twin.model.compiler import njit
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld, known_solids
from motm_twin.model.scene import Box, Cylinder, Prism

IntArray = NDArray[np.int64]
# Hand and fingers are two bodies each: the nearest ball of a single body changes from side to side, and a wedged hand
# would turn back and forth between the two sides, faster than its joints can brake.
BODIES = ("elbow", "forearm", "wrist", "hand", "hand", "fingers", "fingers", "held object")
HAND_BODY, FINGERS, HELD = 3, 5, 7  # the first of each
_BODY_OF_LINK = {
    "panda_link3": 0,
    "panda_link4": 0,
    "panda_link5": 1,
    "panda_link6": 2,
    "panda_link7": 2,
    "panda_hand": 3,
    "panda_leftfinger": 5,
    "panda_rightfinger": 6,
}
_SPACING = 0.04  # [m] between balls along a capsule
_FINGER = (  # balls: x across, y from the pad outwards, z beyond the hand, radius [m]
    (0.0, 0.0146, 0.0660, 0.0118),
    (0.0, 0.0146, 0.0774, 0.0118),
    (0.0, 0.006, 0.1024, 0.010),
    *((x, y, 0.1094, 0.003) for x in (-0.0075, 0.0075) for y in (0.003, 0.0138)),  # the lowest when it is tilted
)
_IN_CORNER = 0.5 - 0.25 / math.sqrt(3.0)  # offset at which a ball of radius 0.25 touches the corner
_HELD = (  # balls of a cube of side 1, from the tool centre point: x, y, z, radius
    *((x, y, _IN_CORNER, 0.25) for x in (-_IN_CORNER, _IN_CORNER) for y in (-_IN_CORNER, _IN_CORNER)),  # its lower end
    (0.0, 0.0, 0.0, 0.72),  # its edges
)
PALM = (0.104, 0.0320, 0.0374)  # half width, half depth, bottom over the tool centre point [m]
_PALM_BALLS, _PALM_RADIUS, _CORNER_RADIUS = 10, 0.0274, 0.010  # in a row, and at its corners [m]
_COLUMN_RADIUS, _COLUMN_TOP = 0.10, 0.42  # [m] the arm's own column, top above the mount
_FLOOR = 3.0  # [m] side of the floor round the robot
COLUMN = 1  # index of the arm's column in the robot's own solids: elbow, forearm and wrist belong to it
_Entry = tuple[str, Box | Cylinder | Prism, float, float]  # name, shape, bottom and top [m]
_ROUNDING = 1e-9  # [m] more than the rounding error of distances
_ROUNDED_UP = 1.0 + 1e-9  # factor that is more than the rounding error of a square


class Solids(NamedTuple):
    """Solids as arrays: polygons (vertices first[i] to first[i + 1]) or discs (radius > 0), between two heights."""

    first: IntArray  # shape (n + 1,)
    vertices: Array  # [m], shape (m, 2); a disc has one, its centre
    radius: Array  # [m] of discs, 0 for polygons, shape (n,)
    z: Array  # bottom and top [m], shape (n, 2)
    bounds: Array  # x, x, y, y, z, z [m] of the axis-aligned box of each, shape (n, 6)


@dataclass(frozen=True)
class NamedSolids:
    """Solids and their names."""

    names: tuple[str, ...]
    solids: Solids


class Balls(NamedTuple):
    """Balls that cover the arm's capsules."""

    frame: IntArray  # index into ARM_FRAMES, shape (n,)
    centre: Array  # [m] in that frame, shape (n, 3)
    radius: Array  # [m], shape (n,)
    body: IntArray  # index into BODIES, shape (n,)


def mapped_solids(known: KnownWorld) -> NamedSolids:
    """Mapped furniture and bins, world frame."""
    return _arrays(
        [(solid.group or solid.name, solid.shape, solid.z_min, solid.z_max) for solid in known_solids(known)]
    )


def own_body(known: KnownWorld, *, floor: bool = False) -> NamedSolids:
    """The base body and the arm's column, base frame; with ``floor``, also the floor round the robot."""
    foot, arm = known.robot.footprint, known.robot.arm
    base = Box(centre=(foot.offset_x, 0.0), size=(foot.length, foot.width))
    column = Cylinder(centre=(arm.mount_x, arm.mount_y), radius=_COLUMN_RADIUS)
    entries: list[_Entry] = [
        ("own base", base, 0.0, foot.height),
        ("own column", column, foot.height, arm.mount_z + _COLUMN_TOP),
    ]
    if floor:
        entries.append(("floor", Box(centre=(0.0, 0.0), size=(_FLOOR, _FLOOR)), -1.0, 0.0))
    return _arrays(entries)


def arm_balls() -> Balls:
    """Balls of elbow, forearm, wrist, hand and fingers; fingers and the held object are placed at run time."""
    frames, centres, radii, bodies = [], [], [], []
    for link, frame, p0, p1, radius in zip(
        CAPSULE_LINKS, CAPSULE_FRAMES, CAPSULE_P0, CAPSULE_P1, CAPSULE_RADII, strict=True
    ):
        body = _BODY_OF_LINK.get(link)
        if body is None or FINGERS <= body < HELD or (body == HAND_BODY and p0[2] > 0.04):
            continue  # the fingers follow the gripper's width, and the palm is flat
        count = 1 + math.ceil(norm(p1 - p0) / _SPACING)
        for part in np.linspace(0.0, 1.0, count):
            frames.append(frame)
            centres.append(p0 + part * (p1 - p0))
            radii.append(radius)
            bodies.append(body + (body == HAND_BODY and centres[-1][1] > 0.0))
    for x, y, z, radius in _palm():
        frames.append(HAND)
        centres.append(np.array([x, y, z]))
        radii.append(radius)
        bodies.append(HAND_BODY + (y > 0.0))
    for side in (1.0, -1.0):
        for x, y, z, radius in _FINGER:
            frames.append(HAND)
            centres.append(np.array([x, side * y, z]))
            radii.append(radius)
            bodies.append(FINGERS if side > 0.0 else FINGERS + 1)
    for _ in _HELD:
        frames.append(TCP)
        centres.append(np.zeros(3))
        radii.append(0.0)
        bodies.append(HELD)
    return Balls(np.array(frames), np.array(centres), np.array(radii), np.array(bodies))


def _palm() -> list[tuple[float, float, float, float]]:
    """Balls of the palm, hand frame: a row along it and one at each lower corner; x, y, z, radius [m]."""
    half, depth, over = PALM
    row, bottom = half - _PALM_RADIUS, HAND_LENGTH - over
    x, y = depth - _CORNER_RADIUS, half - _CORNER_RADIUS
    corners = ((x, y), (x, -y), (-x, y), (-x, -y))
    return [
        *((0.0, float(at), bottom - _PALM_RADIUS, _PALM_RADIUS) for at in np.linspace(-row, row, _PALM_BALLS)),
        *((*corner, bottom - _CORNER_RADIUS, _CORNER_RADIUS) for corner in corners),
    ]


@njit(cache=True)
def placed(balls: Balls, width: float, held_side: float) -> Balls:
    """The balls with the fingers at the gripper's width and the held cube; a ball of radius 0 is not there."""
    centre, radius = balls.centre.copy(), balls.radius.copy()
    tips, held = len(_FINGER), len(radius) - len(_HELD)
    for k in range(tips):
        centre[held - 2 * tips + k, 1] += 0.5 * width
        centre[held - tips + k, 1] -= 0.5 * width
    for k in range(len(_HELD)):
        for axis in range(3):
            centre[held + k, axis] = _HELD[k][axis] * held_side
        radius[held + k] = _HELD[k][3] * held_side
    return Balls(balls.frame, centre, radius, balls.body)


@njit(cache=True)
def solid_distance(x: float, y: float, z: float, k: int, solids: Solids) -> tuple[float, float, float, float]:
    """Signed distance [m] of a point to solid k, and the unit vector away from the solid."""
    d, nx, ny = _plane_distance(x, y, k, solids)
    below, above = solids.z[k, 0] - z, z - solids.z[k, 1]
    dz, nz = (above, 1.0) if above >= below else (below, -1.0)
    if d > 0.0 and dz > 0.0:
        total = math.hypot(d, dz)
        return total, nx * d / total, ny * d / total, nz * dz / total
    if d > dz:
        return d, nx, ny, 0.0
    return dz, 0.0, 0.0, nz


@njit(cache=True)
def _plane_distance(x: float, y: float, k: int, solids: Solids) -> tuple[float, float, float]:
    vertices, radius = solids.vertices, solids.radius
    start, end = solids.first[k], solids.first[k + 1]
    if radius[k] > 0.0:
        dx, dy = x - vertices[start, 0], y - vertices[start, 1]
        r = math.hypot(dx, dy)
        if r < 1e-9:
            return -radius[k], 1.0, 0.0
        return r - radius[k], dx / r, dy / r
    best = np.inf
    nx, ny = 1.0, 0.0
    inside = False
    j = end - 1
    for i in range(start, end):
        ax, ay, bx, by = vertices[j, 0], vertices[j, 1], vertices[i, 0], vertices[i, 1]
        ex, ey = bx - ax, by - ay
        length = ex * ex + ey * ey
        t = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / length)) if length > 0.0 else 0.0
        dx, dy = x - (ax + t * ex), y - (ay + t * ey)
        d = math.hypot(dx, dy) if dx * dx + dy * dy < best * best * _ROUNDED_UP else best
        if d < best:
            best = d
            if d > 1e-9:
                nx, ny = dx / d, dy / d
            else:
                root = math.sqrt(length)
                nx, ny = ey / root, -ex / root
                best = 0.0
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * ex:
            inside = not inside
        j = i
    if inside:
        return -best, -nx, -ny
    return best, nx, ny


@njit(cache=True)
def _near_solid(x: float, y: float, z: float, reach: float, k: int, bounds: Array) -> bool:
    return (
        bounds[k, 0] - reach < x < bounds[k, 1] + reach
        and bounds[k, 2] - reach < y < bounds[k, 3] + reach
        and bounds[k, 4] - reach < z < bounds[k, 5] + reach
    )


@njit(cache=True)
def _overlap(low: Array, high: Array, k: int, bounds: Array) -> bool:
    """Test that the box between two corners (3,) meets that of solid k."""
    for axis in range(3):
        if low[axis] >= bounds[k, 2 * axis + 1] or high[axis] <= bounds[k, 2 * axis]:
            return False
    return True


@njit(cache=True)
def _ball_centres(T: Array, balls: Balls, d_i: Array, at_mount: Array) -> tuple[Array, Array, Array]:
    """Centres (n, 3) of the balls in the frame of the solids, and the corners of the box in which solids matter."""
    frame, centre, ball_radius, body = balls.frame, balls.centre, balls.radius, balls.body
    at, low, high = np.empty((frame.shape[0], 3)), np.full(3, np.inf), np.full(3, -np.inf)
    c, s = math.cos(at_mount[3]), math.sin(at_mount[3])
    for i in range(frame.shape[0]):
        if ball_radius[i] <= 0.0:
            continue
        f, reach = frame[i], d_i[body[i]] + ball_radius[i] + _ROUNDING
        px = T[f, 0, 3] + T[f, 0, 0] * centre[i, 0] + T[f, 0, 1] * centre[i, 1] + T[f, 0, 2] * centre[i, 2]
        py = T[f, 1, 3] + T[f, 1, 0] * centre[i, 0] + T[f, 1, 1] * centre[i, 1] + T[f, 1, 2] * centre[i, 2]
        pz = T[f, 2, 3] + T[f, 2, 0] * centre[i, 0] + T[f, 2, 1] * centre[i, 1] + T[f, 2, 2] * centre[i, 2]
        at[i, 0] = at_mount[0] + c * px - s * py
        at[i, 1] = at_mount[1] + s * px + c * py
        at[i, 2] = at_mount[2] + pz
        for axis in range(3):
            low[axis] = min(low[axis], at[i, axis] - reach)
            high[axis] = max(high[axis], at[i, axis] + reach)
    return at, low, high


@njit(cache=True)
def body_distances(
    T: Array, balls: Balls, d_i: Array, at_mount: Array, solids: Solids, column: int
) -> tuple[Array, Array, IntArray]:
    """Nearest ball of each body to each solid closer than d_i; elbow, forearm and wrist ignore the solid ``column``.

    ``at_mount``: x, y, z [m] and heading of the mount in the frame of the solids, shape (4,). Returns distances
    (bodies, n), inf when further; directions away from the solid in the solids' frame (bodies, n, 3); index of the
    ball.
    """
    bodies, count_of = d_i.shape[0], solids.z.shape[0]
    distance = np.full((bodies, count_of), np.inf)
    normal = np.zeros((bodies, count_of, 3))
    ball = np.zeros((bodies, count_of), dtype=np.int64)
    at, low, high = _ball_centres(T, balls, d_i, at_mount)
    near = np.empty(count_of, dtype=np.int64)
    count = 0
    for k in range(count_of):
        if _overlap(low, high, k, solids.bounds):
            near[count] = k
            count += 1
    if count == 0:
        return distance, normal, ball
    for i in range(balls.frame.shape[0]):
        own = balls.radius[i]
        if own <= 0.0:
            continue
        b, x, y, z = balls.body[i], at[i, 0], at[i, 1], at[i, 2]
        for n in range(count):
            k = near[n]
            if k == column and b < HAND_BODY:
                continue
            reach = min(d_i[b], distance[b, k]) + own + _ROUNDING  # solids further off change nothing
            if not _near_solid(x, y, z, reach, k, solids.bounds):
                continue
            d, nx, ny, nz = solid_distance(x, y, z, k, solids)
            d -= own
            if d < d_i[b] and d < distance[b, k]:
                distance[b, k] = d
                normal[b, k, 0], normal[b, k, 1], normal[b, k, 2] = nx, ny, nz
                ball[b, k] = i
    return distance, normal, ball


def _arrays(entries: list[_Entry]) -> NamedSolids:
    first, vertices, radius, heights, bounds = [0], [], [], [], []
    for _, shape, low, high in entries:
        if isinstance(shape, Cylinder):
            vertices.append(shape.centre)
            radius.append(shape.radius)
        elif isinstance(shape, Box):
            vertices += _corners(shape)
            radius.append(0.0)
        else:
            vertices += list(shape.corners)
            radius.append(0.0)
        corners = np.array(vertices[first[-1] :], dtype=float)
        (x, y), (x_max, y_max) = corners.min(axis=0) - radius[-1], corners.max(axis=0) + radius[-1]
        first.append(len(vertices))
        heights.append((low, high))
        bounds.append((x, x_max, y, y_max, low, high))
    solids = Solids(
        first=np.array(first, dtype=np.int64),
        vertices=np.array(vertices, dtype=float).reshape(-1, 2),
        radius=np.array(radius, dtype=float),
        z=np.array(heights, dtype=float).reshape(-1, 2),
        bounds=np.array(bounds, dtype=float).reshape(-1, 6),
    )
    return NamedSolids(tuple(entry[0] for entry in entries), solids)


def _corners(box: Box) -> list[tuple[float, float]]:
    c, s = math.cos(box.yaw), math.sin(box.yaw)
    a, b = 0.5 * box.size[0], 0.5 * box.size[1]
    return [
        (box.centre[0] + c * x - s * y, box.centre[1] + s * x + c * y) for x, y in ((-a, -b), (a, -b), (a, b), (-a, b))
    ]
