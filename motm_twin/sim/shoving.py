"""Cubes that are pushed push each other, and stop at furniture. Quasi-static: by geometry only."""

import math
from collections.abc import Sequence

import numpy as np

from motm_twin.model.exact import times, transposed_times
from motm_twin.model.geometry import Array, from_frame, to_frame
from motm_twin.sim.grasp import separation
from motm_twin.sim.kernels import polygon_distance
from motm_twin.sim.objects import SUPPORT_SLACK, ObjectState
from motm_twin.sim.solids import Solids

_LEVEL = 0.1  # [m] between the centres of cubes that may touch each other
_MOST = 40  # cubes moved by one push: more of them are wedged
_ROUNDING = 1e-9  # [m] of overlap that is none
_CONTACT = 1e-4  # [m] by which what touches may overlap


def make_room(item: ObjectState, objects: Sequence[ObjectState], solids: Solids) -> list[ObjectState] | None:
    """Push aside what a shifted cube would overlap, and so on; what was moved, or None when furniture is in the way.

    Then nothing but the cube has been moved.
    """
    level = [other for other in objects if _pushable(other) and abs(other.position[2] - item.position[2]) < _LEVEL]
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


def _pushable(item: ObjectState) -> bool:
    return item.state in ("resting", "dropped")


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
    """The cube overlaps furniture beside it."""
    half, low, high = 0.5 * item.side - _CONTACT, item.bottom + SUPPORT_SLACK, item.bottom + item.side - SUPPORT_SLACK
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    points = from_frame(np.array([item.position[0], item.position[1], item.yaw]), corners)
    for i in np.flatnonzero((solids.z[:, 0] < high) & (solids.z[:, 1] > low)):
        first, last = int(solids.first[i]), int(solids.first[i + 1])
        if any(polygon_distance(x, y, solids.corners, first, last) == 0.0 for x, y in points.tolist()):
            return True
        local = to_frame(np.array([item.position[0], item.position[1], item.yaw]), solids.corners[first:last])
        if bool((np.abs(local).max(axis=1) < half).any()):
            return True
    for i in np.flatnonzero((solids.disc_z[:, 0] < high) & (solids.disc_z[:, 1] > low)):
        x, y, radius = solids.discs[i].tolist()
        local = to_frame(np.array([item.position[0], item.position[1], item.yaw]), np.array([x, y]))
        if math.hypot(*np.maximum(np.abs(local) - half, 0.0).tolist()) < radius:
            return True
    return False
