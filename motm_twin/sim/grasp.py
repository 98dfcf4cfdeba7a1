"""Grasp rule, and cubes pushed by fingers and by each other. Quasi-static: by geometry only."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from motm_twin.model.exact import dot, times, transposed_times
from motm_twin.model.geometry import Array, rectangle, to_frame
from motm_twin.model.scene import GRASP_RULES
from motm_twin.sim.kernels import polygon_distance
from motm_twin.sim.objects import SUPPORT_SLACK, ObjectState
from motm_twin.sim.solids import Solids

# The strict rule (this project's choice): each must hold during the whole closing time
OFFSET_PER_AXIS = 0.015  # [m] of the cube's centre from the tool centre point, along each axis of the hand
YAW_MISFIT = math.radians(15.0)  # between the closing axis and the nearest face normal of the cube
RELATIVE_SPEED = 0.03  # [m/s] between tool centre point and cube
TILT = math.radians(30.0)  # of the tool axis from straight down

# The other rule, `SWEPT`, is fitted to the sweep of ``motm-twin bench grasp_rule``: grasps that contact dynamics hold,
# with a margin. The cube must be between the fingers when they begin to close; they align and centre it. A single pad
# that pushes beside the cube's centre, or at a corner, turns the cube away: the moment of such a push is its path times
# its lever arm.
SWEPT, STRICT = GRASP_RULES
FLAT = 0.002  # [m] from the cube's centre, up to which a pad pushes without turning it
LEVER = 0.0005  # [m] smallest lever arm: that of a push within `FLAT`
LEVER_PER_TURN = 0.012  # [m/rad] additional lever arm of a cube that is not parallel to the pads
BOTH_TOUCH = 0.04  # [s] before the firm hold: from then on the cube moves with the hand
MOST_ALONG = 0.027  # [m] largest offset of a held cube along the pads, when both touch it
MOST_MOMENT = 5e-4  # [m^2] allowed for a cube in the middle of the pads
STEEP = 4  # power of the offset along the pads, with which the allowed moment falls to 0 at `MOST_ALONG`
HIGH = 0.015  # [m] largest offset of the cube's centre from the tool centre point along the tool axis

EDGE = 0.003  # [m] of cube under a descending fingertip beyond which the tip does not slide off
FROM_ABOVE = 2e-4  # [m] of tolerance between a finger's depth below a cube's top and its descent in this substep

PUSH_PER_STEP = 0.005  # [m] by which a finger shifts a cube within one substep, at most
QUARTER_TURN = 0.5 * math.pi

# Finger boxes in the frame of the hand: inner face from the pad plane outwards, half depth along x, z from, z to [m]
PAD_HALF_DEPTH = 0.0105  # [m]
FINGER_BOXES = ((0.0, 0.0168, PAD_HALF_DEPTH, 0.0884, 0.1124), (0.0028, 0.0264, 0.011, 0.0584, 0.0884))
NEARBY = 0.12  # [m] from the tool centre point; beyond, no finger reaches a cube


def yaw_misfit(rotation: Array, item: ObjectState) -> float:
    """Signed turn [rad] that would align the cube with the closing axis (y of the hand), in [-45, 45] deg."""
    axis = math.atan2(rotation[1, 1], rotation[0, 1])
    return math.remainder(axis - item.yaw, QUARTER_TURN)


def violation(tcp: Array, rotation: Array, item: ObjectState) -> str:
    """The violated geometric part of the grasp rule: 'offset' | 'yaw' | 'tilt', '' for none."""
    offset = transposed_times(rotation, item.position - tcp)
    if np.max(np.abs(offset)) > OFFSET_PER_AXIS:
        return "offset"
    if rotation[2, 2] > -math.cos(TILT):
        return "tilt"
    if abs(yaw_misfit(rotation, item)) > YAW_MISFIT:
        return "yaw"
    return ""


def swept_violation(tcp: Array, rotation: Array, item: ObjectState, width: float) -> str:
    """The violated part of the rule `SWEPT` while pads ``width`` [m] apart close; names as in `violation`."""
    offset = transposed_times(rotation, item.position - tcp)
    room = 0.5 * max(width - item.side, 0.0) + OFFSET_PER_AXIS  # pads that meet an edge push the cube
    if abs(offset[1]) > room or abs(offset[2]) > HIGH or abs(offset[0]) > NEARBY:
        return "offset"
    return "tilt" if rotation[2, 2] > -math.cos(TILT) else ""


def moment_of_push(way: float, along: float, misfit: float) -> float:
    """Moment [m^2] of one pad's push over ``way`` [m] on a cube offset by ``along`` [m], turned by ``misfit`` [rad]."""
    return way * (max(abs(along) - FLAT, 0.0) + LEVER + LEVER_PER_TURN * abs(misfit))


def slips_out(along: float, moment: float) -> bool:
    """True when pads lose a cube this far [m] along them after pushes of this moment [m^2], by the rule `SWEPT`."""
    share = min(abs(along) / MOST_ALONG, 1.0)
    return moment >= MOST_MOMENT * (1.0 - share**STEEP)


def width_across(side: float, misfit: float) -> float:
    """Room [m] that a cube turned by misfit [rad] takes along the closing axis."""
    return side * (math.cos(misfit) + abs(math.sin(misfit)))


def between_pads(tcp: Array, rotation: Array, item: ObjectState) -> bool:
    """True when the pads overlap the cube along their plane, so that they touch it when they close."""
    reach = PAD_HALF_DEPTH + 0.5 * width_across(item.side, yaw_misfit(rotation, item))
    return abs(dot(rotation[:, 0], item.position - tcp)) < reach


def centre_between_pads(tcp: Array, rotation: Array, item: ObjectState, width: float) -> None:
    """Pads ``width`` [m] apart turn and shift the cube between them; it stays on its support."""
    misfit = yaw_misfit(rotation, item)
    ratio = min(math.sqrt(2.0), max(1.0, width / item.side))
    largest = 0.25 * math.pi - math.acos(ratio / math.sqrt(2.0))
    if abs(misfit) > largest:
        turn = math.copysign(abs(misfit) - largest, misfit)
        item.turn_to(item.yaw + turn)
        misfit -= turn
    room = max(0.0, 0.5 * (width - width_across(item.side, misfit)))
    offset = dot(rotation[:, 1], item.position - tcp)
    if abs(offset) > room:
        shift = math.copysign(abs(offset) - room, -offset)
        item.position = item.position + shift * np.array([rotation[0, 1], rotation[1, 1], 0.0])


def near(tcp: Sequence[float], position: Array) -> bool:
    """True when a finger may reach a cube at this position [m], shape (3,)."""
    x, y, z = position.tolist()
    return max(abs(x - tcp[0]), abs(y - tcp[1]), abs(z - tcp[2])) <= NEARBY


def push(rotation: Array, hand: Array, item: ObjectState, width: float) -> bool:
    """Shift a cube on its support out of the way of the fingers; True when it was touched.

    By geometry only, at most `PUSH_PER_STEP` in a substep. A cube squeezed by both pads slips out along x of the hand.
    """
    local = transposed_times(rotation, item.position - hand)
    overlaps = [out for out, _ in _overlaps(rotation, local, item, width)]
    if not overlaps:
        return False
    shift = sum(overlaps, np.zeros(2))
    if len(overlaps) > 1:
        shift = np.array([math.copysign(PUSH_PER_STEP, local[0]), 0.0])
    length = math.hypot(shift[0], shift[1])
    if length > PUSH_PER_STEP:
        shift *= PUSH_PER_STEP / length
    world = times(rotation[:, :2], shift)
    item.position = item.position + np.array([world[0], world[1], 0.0])
    return True


def under(rotation: Array, hand: Array, item: ObjectState, width: float, *, sunk: float) -> bool:
    """True when a finger stands on a cube after descending ``sunk`` [m] in this substep (inf: it stood already)."""
    local = transposed_times(rotation, item.position - hand)
    for out, deep in _overlaps(rotation, local, item, width):
        if deep < sunk + FROM_ABOVE and (sunk == math.inf or math.hypot(out[0], out[1]) > EDGE):
            return True
    return False


def _overlaps(rotation: Array, local: Array, item: ObjectState, width: float) -> Iterator[tuple[Array, float]]:
    """Per finger that overlaps a cube at ``local`` in the hand: shift (2,) that parts them, depth below the top."""
    face = transposed_times(rotation, item.rotation[:, 0])
    face = face[:2] / math.hypot(face[0], face[1])
    for side in (1.0, -1.0):
        for inner, outer, half_x, z_from, z_to in FINGER_BOXES:
            if not z_from < local[2] + 0.5 * item.side or not local[2] - 0.5 * item.side < z_to:
                continue
            centre = np.array([0.0, side * 0.5 * (width + inner + outer)])
            out = separation(local[:2] - centre, half_x, 0.5 * (outer - inner), 0.5 * item.side, face)
            if out is not None:
                yield out, z_to - float(local[2]) + 0.5 * item.side
                break


def separation(offset: Array, half_x: float, half_y: float, half: float, face: Array) -> Array | None:
    """Shortest shift that moves a square off a rectangle about the origin; None when they are apart.

    ``face`` is a unit normal of the square, shape (2,).
    """
    best, way = math.inf, None
    c, s = float(face[0]), float(face[1])
    reach = half * (abs(c) + abs(s))
    for axis, extent in (
        ((1.0, 0.0), half_x + reach),
        ((0.0, 1.0), half_y + reach),
        ((c, s), half + half_x * abs(c) + half_y * abs(s)),
        ((-s, c), half + half_x * abs(s) + half_y * abs(c)),
    ):
        along = float(offset[0] * axis[0] + offset[1] * axis[1])
        depth = extent - abs(along)
        if depth <= 0.0:
            return None
        if depth < best:
            best, way = depth, math.copysign(depth, along) * np.array(axis)
    return way


_LEVEL = 0.1  # [m] between the centres of cubes that may touch each other
_MOST = 40  # most cubes moved by one push: more are wedged
_ROUNDING = 1e-9  # [m] smaller overlaps count as none
_CONTACT = 1e-4  # [m] by which touching cubes may overlap


def make_room(item: ObjectState, objects: Sequence[ObjectState], solids: Solids) -> list[ObjectState] | None:
    """Push aside cubes that a shifted cube overlaps, recursively; returns the moved ones, or None if furniture blocks.

    In that case only the shifted cube has moved.
    """
    lying = [other for other in objects if other.state in ("resting", "dropped")]
    level = [other for other in lying if abs(other.position[2] - item.position[2]) < _LEVEL]
    before = {other.name: other.position for other in level}
    moved, queue = [item], [item]
    while queue and len(moved) < _MOST:
        mover = queue.pop(0)
        for other in level:
            if other is mover or other is item:
                continue
            if abs(other.position[2] - mover.position[2]) >= 0.5 * (other.side + mover.side) - SUPPORT_SLACK:
                continue
            shift = _aside(other, mover)
            if shift is not None:
                other.position = other.position + np.array([shift[0], shift[1], 0.0])
                queue.append(other)
                moved.append(other)
    if not queue and not any(_in_solid(one, solids) for one in moved):
        return moved
    for other in level:
        if other is not item:
            other.position = before[other.name]
    return None


def _aside(item: ObjectState, mover: ObjectState) -> Array | None:
    """The shortest shift (2,) [m] that moves one cube off another; None when they are apart."""
    offset = transposed_times(mover.rotation, item.position - mover.position)
    face = transposed_times(mover.rotation, item.rotation[:, 0])
    half = 0.5 * mover.side - _CONTACT
    out = separation(offset[:2], half, half, 0.5 * item.side, face[:2] / math.hypot(face[0], face[1]))
    if out is None or math.hypot(out[0], out[1]) < _ROUNDING:
        return None
    return times(mover.rotation[:2, :2], out)


def _in_solid(item: ObjectState, solids: Solids) -> bool:
    """True when the cube overlaps furniture beside it."""
    half, low, high = 0.5 * item.side - _CONTACT, item.bottom + SUPPORT_SLACK, item.bottom + item.side - SUPPORT_SLACK
    frame = np.array([item.position[0], item.position[1], item.yaw])
    points = rectangle(frame, (2.0 * half, 2.0 * half))
    for i in np.flatnonzero((solids.z[:, 0] < high) & (solids.z[:, 1] > low)):
        first, last = int(solids.first[i]), int(solids.first[i + 1])
        if any(polygon_distance(x, y, solids.corners, first, last) == 0.0 for x, y in points.tolist()):
            return True
        local = to_frame(frame, solids.corners[first:last])
        if bool((np.abs(local).max(axis=1) < half).any()):
            return True
    for i in np.flatnonzero((solids.disc_z[:, 0] < high) & (solids.disc_z[:, 1] > low)):
        x, y, radius = solids.discs[i].tolist()
        local = to_frame(frame, np.array([x, y]))
        if math.hypot(*np.maximum(np.abs(local) - half, 0.0).tolist()) < radius:
            return True
    return False
