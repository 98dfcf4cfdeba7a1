"""Room for the open hand beside an object: the faces that the fingers can take.

The fingers come straight down on two faces of a cube, the palm over them, and go up again the same way. Until the hand
is turned, they stay high enough over the cube to hit nothing. Both pairs of faces are candidates.
Mapped furniture and bins must leave the distances that the arm keeps from them, other objects the width of the fingers.
Lack of room is a cost; a pair of faces without room is not taken.
"""

import math
from typing import NamedTuple

import numpy as np

from motm_twin.control.arm.bodies import (
    FINGERS,
    HAND_BODY,
    HELD,
    PALM,
    Balls,
    Solids,
    arm_balls,
    mapped_solids,
    placed,
    solid_distance,
)
from motm_twin.control.arm.geometry import QUARTER, cube_yaw, hand_yaw, tool_rotation
from motm_twin.control.arm.limits import YIELDS
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.arm.types import ArmGoal
from motm_twin.model.arm_kernels import HAND, HAND_LENGTH
from motm_twin.model.compiler import njit
from motm_twin.model.exact import hypot
from motm_twin.model.geometry import Array, to_frame
from motm_twin.model.known import KnownWorld

REACH = 0.16  # [m] from the centre of an object: no part of the hand is further off
_TEST_HEIGHTS = (0.0, 0.05, 0.10)  # [m] above the grasp at which furniture is looked for: hover and lift are no higher
_HIGHER = 0.01  # [m] by which the top of an object may be higher than the camera estimates
BLOCKED = 100.0  # [rad] cost of a pair without room: more than any turning
_BEFORE = 0.05  # [m] before the target at which the way over furniture ends: there the hand comes down
ASIDE = 0.05  # [m] from the middle of the hand, within which its fingers are
_STEP = 0.02  # [m] between samples of that way
_HIGHEST = 0.25  # [m] above the target: the hand does not get over higher furniture
_SUPPORT_SLACK = 0.01  # [m] above the object's lower face; furniture no higher than this is its support
_PARTS = (  # of the hand: middle beyond the pad and half width along the closing axis, half depth, bottom over the tool
    (0.0084, 0.0084, 0.0105, -0.0090),
    (0.0146, 0.0118, 0.0110, 0.0150),
)
_BESIDE = 0.003  # [m] that fingers keep from objects as they come down: for the camera, and a hand that still turns
_SURE = 0.01  # [m] 1 sd of localisation: a robot that is less sure may find room in some seconds
_UNDER_PALM = 0.003  # [m] between a tilted palm and the object's top: error of the camera
_LEVEL = 0.1  # least cosine of a hand's tilt that is considered: beyond, the hand lies on its side
_MOST_OVER_MIDDLE = 0.008  # [m]: the pads still hold the object, whatever the error of the camera


class Room(NamedTuple):
    """Room beside a grasp of two faces."""

    cost: float  # as an equivalent turn [rad]; `BLOCKED` and more when there is no room
    what: str  # the nearest solid or object, if it is nearer than the distance to be kept; else ""
    blocked: bool  # it is so near that a hand that tilts or moves a little does not get by; known for sure
    wanders: bool  # its position relies on an uncertain localisation, which may change within seconds

    @property
    def closed(self) -> bool:
        """True when there is no room, whatever localisation says."""
        return self.blocked and not self.wanders


class GraspRoom:
    """Room for the hand among mapped furniture; its balls are those of the arm's speed limits."""

    def __init__(self, known: KnownWorld, parameters: AvoidanceParameters) -> None:
        """Furniture and bins of the pre-made map."""
        self._mapped, self._parameters = mapped_solids(known), parameters
        self._balls = arm_balls()

    def yaw(
        self, goal: ArmGoal, near: float, natural: float, width: float, T_odom_world: Array, sd: float
    ) -> tuple[float, Room]:
        """Hand yaw [rad], odometry frame, for the cheaper of the two pairs of faces, and the room beside it.

        A pair that surely has no room comes last: the other pair may gain room when localisation changes.
        ``near``: yaw that costs no turning; the other faces are taken from the side of the ``natural`` one, where
        joint 7 is in its middle. ``width`` [m] of the open gripper, ``sd`` [m] of the robot's place on the map.
        """
        first = cube_yaw(goal.yaw, near)
        other = first + math.copysign(QUARTER, math.remainder(natural - first, 2.0 * math.pi))
        rooms = [self.room(goal, yaw, width, T_odom_world, sd) for yaw in (first, other)]
        pairs = list(zip((first, other), rooms, strict=True))
        return min(pairs, key=lambda pair: (pair[1].closed, abs(pair[0] - near) + pair[1].cost))

    def room(self, goal: ArmGoal, yaw: float, width: float, T_odom_world: Array, sd: float) -> Room:
        """Room for the hand over the object with this yaw [rad], odometry frame."""
        balls = placed(self._balls, width, 0.0)
        place = np.array([*to_frame(T_odom_world, goal.position), yaw - float(T_odom_world[2])])
        p = self._parameters
        keep = np.array([p.furniture_d_s, p.fingers_d_s]) + sd
        solid, k = _furniture_room(place, goal.side, balls, keep, self._mapped.solids)
        item, j = _object_room(goal.position, yaw, width, goal.neighbours)
        item -= p.objects_kept
        rooms = ((solid, p.easy_furniture), (item, p.easy_objects))
        cost = sum(p.tight_turn * min(1.0, max(0.0, 1.0 - room / easy)) for room, easy in rooms)
        if min(solid, item) >= 0.0:
            return Room(cost, "", False, False)
        cost -= p.tight_slope * min(solid, item)
        if item < 0.0:
            return Room(cost + BLOCKED, goal.neighbour_names[j], bool(goal.neighbours[j, 5] > 0.0), False)
        blocked = solid < -YIELDS * p.furniture_d_s - sd
        return Room(cost + BLOCKED * blocked, self._mapped.names[k], blocked, sd > _SURE)

    def top_between(self, position: Array, target: Array, T_odom_world: Array) -> float:
        """Highest top [m] of furniture above the target's height on the line from a position to it, (3,); -inf: none.

        Furniture beside the target itself is ignored, since the hand comes down there, and so is furniture that is too
        high to pass over, unless the hand is above it now.
        """
        return _top_between(to_frame(T_odom_world, position), to_frame(T_odom_world, target), self._mapped.solids)


@njit(cache=True)
def _top_between(position: Array, target: Array, solids: Solids) -> float:
    """`GraspRoom.top_between`; ``position`` and ``target``: x, y, z [m], world."""
    x, y = position[0], position[1]
    top, bounds = -np.inf, solids.bounds
    length = hypot(target[0] - x, target[1] - y)
    if length <= _BEFORE:
        return top
    steps = int(math.ceil((length - _BEFORE) / _STEP))
    for k in range(solids.z.shape[0]):
        high = solids.z[k, 1]
        if not max(top, target[2]) < high < max(target[2] + _HIGHEST, position[2]):
            continue
        if bounds[k, 0] - ASIDE > max(x, target[0]) or bounds[k, 1] + ASIDE < min(x, target[0]):
            continue
        if bounds[k, 2] - ASIDE > max(y, target[1]) or bounds[k, 3] + ASIDE < min(y, target[1]):
            continue
        for i in range(steps + 1 if high < target[2] + _HIGHEST else 1):
            part = i / steps * (length - _BEFORE) / length
            at_x, at_y = x + part * (target[0] - x), y + part * (target[1] - y)
            if solid_distance(at_x, at_y, 0.5 * (solids.z[k, 0] + high), k, solids)[0] < ASIDE:
                top = high
                break
    return top


@njit(cache=True)
def _furniture_room(place: Array, side: float, balls: Balls, keep: Array, solids: Solids) -> tuple[float, int]:
    """Least room [m] of the hand to furniture beyond the distances kept (2,), and its index; inf and -1: none is near.

    ``place`` (4,): the object's x, y, z [m] and the hand's yaw [rad], world.
    """
    R = tool_rotation(place[3], 0.0, 0.0)
    best, which = np.inf, -1
    z, bounds, centre = solids.z, solids.bounds, balls.centre
    for k in range(z.shape[0]):
        if z[k, 1] <= place[2] - 0.5 * side + _SUPPORT_SLACK or z[k, 0] > place[2] + 0.5:
            continue
        if not (bounds[k, 0] - REACH < place[0] < bounds[k, 1] + REACH):
            continue
        if not (bounds[k, 2] - REACH < place[1] < bounds[k, 3] + REACH):
            continue
        for i in range(centre.shape[0]):
            body = balls.body[i]
            if body < HAND_BODY or body >= HELD or balls.frame[i] != HAND or balls.radius[i] <= 0.0:
                continue
            x = place[0] + R[0, 0] * centre[i, 0] + R[0, 1] * centre[i, 1]
            y = place[1] + R[1, 0] * centre[i, 0] + R[1, 1] * centre[i, 1]
            for up in _TEST_HEIGHTS:
                height = place[2] + HAND_LENGTH - centre[i, 2] + up
                d, _, _, _ = solid_distance(x, y, height, k, solids)
                d -= balls.radius[i] + (keep[1] if body >= FINGERS else keep[0])
                if d < best:
                    best, which = d, k
    return best, which


@njit(cache=True)
def _object_room(position: Array, yaw: float, width: float, neighbours: Array) -> tuple[float, int]:
    """Least room [m] of the open hand to other objects (n, 6): x, y, z, yaw, side, seen; and the index; inf, -1: none.

    Position and yaw of the hand are in their frame.
    """
    nearest, who = np.inf, -1
    for n in range(neighbours.shape[0]):
        gap = _object_gap(position, yaw, width, neighbours[n])
        if gap < nearest:
            nearest, who = gap, n
    return nearest, who


def over_middle(side: float, tilt: float) -> float:
    """Height [m] over an object's middle at which the fingers take it, so that a palm tilted [rad] clears its top."""
    return min(max(corner(side, math.cos(tilt)) + _UNDER_PALM - PALM[2], 0.0), _MOST_OVER_MIDDLE)


@njit(cache=True)
def corner(side: float, level: float) -> float:
    """Height [m] of the highest corner of a cube over its middle; ``level``: cosine of its tilt."""
    return 0.5 * side * (level + math.sqrt(2.0) * math.sqrt(max(0.0, 1.0 - level * level)))


def height_over(places: Array, R: Array, width: float, goal: ArmGoal) -> float:
    """Height [m] of the tool centre point below which the open hand, at any of the places, would be in an object.

    -inf: there is none. ``places`` (k, 3) and rotation ``R`` (3, 3) of the hand in the frame of the goal. The goal's
    own object counts for the fingers, others that were seen for the palm, too, which is lower on one side when the
    hand is tilted.
    """
    own = np.array([[*goal.position, goal.yaw, goal.side, 1.0]])
    return _highest(places, hand_yaw(R), R[:, 2].copy(), (width, 0.0), np.concatenate((own, goal.neighbours)))


def height_across(places: Array, R: Array, width: float, held: float, goal: ArmGoal, *, own: bool) -> float:
    """`height_over` for the others seen in reach, and the goal's ``own`` object; ``held``: side [m] of a held one."""
    first = np.array([[*goal.position, goal.yaw, goal.side, float(own)]])
    return _highest(places, hand_yaw(R), R[:, 2].copy(), (width, held), np.concatenate((first, goal.others)))


@njit(cache=True)
def _highest(places: Array, yaw: float, axis: Array, grip: tuple[float, float], items: Array) -> float:
    """The highest `_height_over` of the places (k, 3)."""
    height = -np.inf
    for k in range(places.shape[0]):
        height = max(height, _height_over(places[k], yaw, axis, grip, items))
    return height


@njit(cache=True)
def _height_over(position: Array, yaw: float, axis: Array, grip: tuple[float, float], items: Array) -> float:
    """`height_over` of one place (3,), objects (n, 6), the goal's own first; ``axis`` (3,): that of the tool.

    ``grip``: width of the gripper and side of the held object [m].
    """
    width, held = grip
    low, height = np.array([position[0], position[1], -np.inf]), -np.inf  # so low that every part counts
    palm = low - PALM[2] * axis
    across = math.sin(yaw) * axis[0] - math.cos(yaw) * axis[1]
    sink = (0.5 * width + 2.0 * _PARTS[0][0]) * abs(across)  # [m] of the lower finger
    for n in range(items.shape[0]):
        item = items[n]
        top = item[2] + 0.5 * item[4] + _HIGHER
        if item[5] == 0.0:
            continue
        if held > 0.0 and _part_gap(low, yaw, 0.0, 0.5 * held, 0.5 * held, item) < _BESIDE:
            height = max(height, top + corner(held, -axis[2]))
        if _fingers_gap(low, yaw, across, width, item) < _BESIDE:
            height = max(height, top - _PARTS[0][3] + sink)
        elif n > 0 and _part_gap(palm, yaw, 0.0, PALM[0], PALM[1], item) < _BESIDE:
            height = max(height, top - _underside(position, yaw, axis, item))
    return height


@njit(cache=True)
def _underside(position: Array, yaw: float, axis: Array, item: Array) -> float:
    """Height [m] of the palm over the tool centre point where it is lowest over an item, of a tool along ``axis``."""
    c, s = math.cos(yaw), math.sin(yaw)
    edge = PALM[0] * abs(s * axis[0] - c * axis[1]) + PALM[1] * abs(c * axis[0] + s * axis[1])
    near = axis[0] * (item[0] - position[0]) + axis[1] * (item[1] - position[1])
    near -= math.sqrt(0.5) * item[4] * hypot(axis[0], axis[1])  # its corner
    return (PALM[2] + max(near, -edge)) / max(-axis[2], _LEVEL)


@njit(cache=True)
def _object_gap(position: Array, yaw: float, width: float, item: Array) -> float:
    """Gap [m] between the open hand over a position and an upright cube; negative: they overlap seen from above."""
    gap = _fingers_gap(position, yaw, 0.0, width, item)
    if item[2] + 0.5 * item[4] + _HIGHER > position[2] + PALM[2] + _MOST_OVER_MIDDLE:
        gap = min(gap, _part_gap(position, yaw, 0.0, PALM[0], PALM[1], item))
    return gap


@njit(cache=True)
def _fingers_gap(position: Array, yaw: float, across: float, width: float, item: Array) -> float:
    """`_object_gap` of the fingers alone, by their lower ends.

    ``across``: sine of the tilt along the closing axis. It brings the lower finger nearer to the middle.
    """
    gap, level = np.inf, math.sqrt(max(0.0, 1.0 - across * across))
    top = item[2] + 0.5 * item[4] + _HIGHER
    for middle, half, depth, bottom in _PARTS:
        if top > position[2] + bottom:
            for sign in (1.0, -1.0):
                out = sign * level * (0.5 * width + middle) - bottom * across
                gap = min(gap, _part_gap(position, yaw, out, half, depth, item))
    return gap


@njit(cache=True)
def _part_gap(position: Array, yaw: float, out: float, half: float, depth: float, item: Array) -> float:
    """Gap [m] of one part, ``out`` [m] along the closing axis from the middle of the hand; inf: far away."""
    dx, dy = item[0] - position[0], item[1] - position[1]
    if hypot(dx, dy) > REACH + item[4]:
        return np.inf
    c, s = math.cos(yaw), math.sin(yaw)
    along, across = c * dx + s * dy, s * dx - c * dy  # along the hand's x and y axes; the fingers close along y
    return _square_gap(along, across - out, depth, half, item[3] - yaw, 0.5 * item[4])


@njit(cache=True)
def _square_gap(x: float, y: float, half_x: float, half_y: float, turn: float, half: float) -> float:
    """Gap [m] between a rectangle about the origin and a square at (x, y), turned; at corners an underestimate."""
    c, s = abs(math.cos(turn)), abs(math.sin(turn))
    reach = half * (c + s)
    best = max(abs(x) - half_x - reach, abs(y) - half_y - reach)
    co, si = math.cos(turn), -math.sin(turn)  # the hand's y points to the other side: turns count the other way
    for ax, ay in ((co, si), (-si, co)):
        extent = half + half_x * abs(ax) + half_y * abs(ay)
        best = max(best, abs(x * ax + y * ay) - extent)
    return best
