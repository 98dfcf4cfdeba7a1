"""Memory of bodies in which the arm is, kept until beams have passed through their place.

The map forgets a cell that is not hit again: the lidar that sees only a corner of a body beside known furniture hits
it now and then. That is no reason to believe that the body is gone.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array, to_frame
from motm_twin.model.plant import Scan
from motm_twin.perception.clusters import label_cells
from motm_twin.perception.discs import front_of

_HALF_CELL = 0.025  # [m] a point is the centre of a map cell
_BEFORE, _BEHIND = 0.05, 0.04  # [m] from a point, between which a beam ends at it: noise of ranges, and of the cell
_GONE = 3  # scans in a row whose beams pass, after which a point is gone, as a cell of the map that was hit once
_JOINED = 3  # cells apart at most: points of one body


class Discs(NamedTuple):
    """Bodies as discs: what is seen is the front of something as deep as it is wide."""

    middle: Array  # [m], shape (n, 2)
    radius: Array  # [m], shape (n,)


NO_DISCS = Discs(np.zeros((0, 2)), np.zeros(0))


@dataclass
class Remembered:
    """Points seen, in the frame of odometry, and in how many scans in a row beams have passed through each."""

    points: Array  # [m], shape (n, 2)
    passed: NDArray[np.int64]  # shape (n,)
    stamp: float  # [s] of the newest scan that they were compared with


def remember(before: Remembered | None, points: Array, stamp: float) -> Remembered:
    """Memory with more points (m, 2); those that are nearer than half a cell to a known one add nothing."""
    if before is None:
        before = Remembered(np.zeros((0, 2)), np.zeros(0, np.int64), stamp)
    new = points[_unknown(before.points, np.ascontiguousarray(points))]
    passed = np.concatenate((before.passed, np.zeros(len(new), np.int64)))
    return Remembered(np.concatenate((before.points, new)), passed, before.stamp)


def looked_at_again(before: Remembered, scan: Scan | None, T_odom_world: Array) -> Remembered:
    """Memory after a scan: points through which the beams of several in a row passed are gone."""
    if scan is None or scan.stamp == before.stamp:
        return before
    at = to_frame(scan.pose, to_frame(T_odom_world, before.points)) - scan.origin
    passed = before.passed.copy()
    _count(at, scan.ranges, scan.angle_min, scan.angle_step, scan.range_min, passed)
    keep = passed < _GONE
    return Remembered(before.points[keep], passed[keep], scan.stamp)


def bodies(points: Array, viewpoint: Array) -> Discs:
    """The bodies that these points (n, 2) are the fronts of, as seen from a viewpoint (2,)."""
    if not len(points):
        return NO_DISCS
    _, first = np.unique(np.floor(points / (2.0 * _HALF_CELL)).astype(np.int32), axis=0, return_index=True)
    points = points[first]  # of several in one cell, one
    label, count = label_cells(np.floor(points / (2.0 * _HALF_CELL)).astype(np.int32), _JOINED)
    found = [front_of(points[label == k], viewpoint, 2.0 * _HALF_CELL) for k in range(count)]
    return Discs(np.array([middle for middle, _ in found]), np.array([radius for _, radius in found]))


@njit(cache=True)
def joined(points: Array, first: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Which points (n, 2) hang together with the ``first`` (n,) by steps of at most ``reach`` [m]."""
    found = first.copy()
    stack = np.flatnonzero(first)
    stack = np.concatenate((stack, np.empty(points.shape[0] - stack.shape[0], stack.dtype)))
    size = int(first.sum())
    while size:
        size -= 1
        i = stack[size]
        for j in range(points.shape[0]):
            dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
            if not found[j] and dx * dx + dy * dy < reach * reach:
                found[j] = True
                stack[size] = j
                size += 1
    return found


@njit(cache=True)
def _unknown(known: Array, points: Array) -> NDArray[np.bool_]:
    """Which points (m, 2) are not within half a cell of a known one (n, 2)."""
    new = np.ones(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        for k in range(known.shape[0]):
            if math.hypot(points[i, 0] - known[k, 0], points[i, 1] - known[k, 1]) < _HALF_CELL:
                new[i] = False
                break
    return new


@njit(cache=True)
def _count(
    at: Array, ranges: Array, angle_min: float, angle_step: float, range_min: float, passed: NDArray[np.int64]
) -> None:
    """Count scans in a row that passed, for points (n, 2) [m] from the sensor; hidden ones keep their count."""
    for i in range(at.shape[0]):
        away, bearing = math.hypot(at[i, 0], at[i, 1]), math.atan2(at[i, 1], at[i, 0])
        half = math.atan2(_HALF_CELL, away)
        first = max(0, math.ceil((bearing - half - angle_min) / angle_step))
        last = min(ranges.shape[0] - 1, math.floor((bearing + half - angle_min) / angle_step))
        through, hit = 0, 0
        for k in range(first, last + 1):
            if not ranges[k] > range_min:
                continue
            through += ranges[k] > away + _BEHIND
            hit += -_BEFORE <= ranges[k] - away <= _BEHIND
        if hit:
            passed[i] = 0
        elif through and through == last + 1 - first:
            passed[i] += 1
