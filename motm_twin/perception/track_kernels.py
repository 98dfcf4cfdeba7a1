"""Kernels of the tracker: scan points off the furniture, their segments, and the Kalman filter of a track."""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.perception.discs import fitted_circle, front_circle, is_behind, seen_width

BEAMS_LOST = 3  # beams from one point of a segment to the next, at most: a few may have no return


@njit(cache=True)
def ends_off_furniture(ranges, directions, origin, reach, distance, corner, resolution, explained):
    """Ends (n, 2) [m] of beams on the map and farther than ``explained`` [m] from furniture; and these beams (n,).

    Beams of ``reach`` [m] and more are left out. ``distance``: grid of distances to furniture [m]; its first cell
    begins at ``corner`` (x, y) [m].
    """
    ends, beams, count = np.empty((ranges.shape[0], 2)), np.empty(ranges.shape[0], np.int64), 0
    least = np.float32(explained)
    for k in range(ranges.shape[0]):
        if ranges[k] < reach:  # false for nan
            x, y = origin[0] + ranges[k] * directions[k, 0], origin[1] + ranges[k] * directions[k, 1]
            row, column = math.floor((y - corner[1]) / resolution), math.floor((x - corner[0]) / resolution)
            if 0 <= row < distance.shape[0] and 0 <= column < distance.shape[1] and distance[row, column] > least:
                ends[count, 0], ends[count, 1], beams[count] = x, y, k
                count += 1
    return ends[:count].copy(), beams[:count].copy()


@njit(cache=True)
def segments(points: Array, beams: NDArray[np.int64], reach: Array, gap: float) -> NDArray[np.int64]:
    """First point of each segment, and the number of all points (n, 2), which are in order of beams (n,); (k + 1,).

    Neighbours in a segment are at most ``gap`` [m] apart, twice that at a range (``reach``, (n,)) of 8 m.
    """
    n, count = points.shape[0], 1
    cuts = np.zeros(n + 1, np.int64)
    for i in range(1, n):
        apart = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        if apart > gap * (1.0 + reach[i] / 8.0) or beams[i] - beams[i - 1] > BEAMS_LOST:
            cuts[count] = i
            count += 1
    if n:
        cuts[count] = n
        count += 1
    return cuts[:count].copy()


@njit(cache=True)
def share_out(points, beams, ranges, sensor, owner, cuts, tracks, limits):
    """Assign a whole segment to the only track with points in it, if it may be one body: changes ``owner`` (n,).

    ``cuts``: see `segments`; ``tracks``: their number; ``limits``: a gap, and half the largest width of one body [m].
    Returns masks of tracks that are alone in their segments, and of tracks partly hidden; shape (tracks,) both.
    """
    gap, width = limits
    alone, partly = np.ones(tracks, np.bool_), np.zeros(tracks, np.bool_)
    for s in range(cuts.shape[0] - 1):
        start, end = cuts[s], cuts[s + 1]
        only, several = -1, False
        for i in range(start, end):
            if owner[i] >= 0:
                several = several or (only >= 0 and owner[i] != only)
                only = owner[i]
        if only < 0:
            continue
        one = not several and seen_width(points[start:end], sensor) <= width
        hidden = goes_on_hidden(beams[start:end], ranges, gap)
        for i in range(start, end):
            if one:
                owner[i] = only
            elif owner[i] >= 0:
                alone[owner[i]] = False
            if hidden and owner[i] >= 0:
                partly[owner[i]] = True
    return alone, partly


@njit(cache=True)
def keep_one_body(points, sensor, owner, cuts, tracks, width):
    """Reduce a track wider than one body to its segment with the most points: changes ``owner``.

    ``width``: half the largest width of a body [m]. Returns a mask of the tracks that have lost points, (tracks,).
    """
    lost = np.zeros(tracks, np.bool_)
    for k in range(tracks):
        own = owner == k
        if not own.any() or seen_width(points[own], sensor) <= width:
            continue
        best, most, count = -1, 0, 0
        for s in range(cuts.shape[0] - 1):
            of_this = own[cuts[s] : cuts[s + 1]].sum()
            count += of_this > 0
            if of_this > most:
                best, most = s, of_this
        if count < 2:
            continue
        lost[k] = True
        for i in range(points.shape[0]):
            if own[i] and not cuts[best] <= i < cuts[best + 1]:
                owner[i] = -1
    return lost


@njit(cache=True)
def goes_on_hidden(beams: NDArray[np.int64], ranges: Array, gap: float) -> bool:
    """True when a segment (its beams in order) ends at something nearer by ``gap`` [m], on one of its sides."""
    for end, step in ((0, -1), (beams.shape[0] - 1, 1)):
        for k in range(1, BEAMS_LOST + 1):
            other = beams[end] + k * step
            if 0 <= other < ranges.shape[0] and ranges[other] < ranges[beams[end]] - gap:
                return True
    return False


@njit(cache=True)
def is_hidden(ranges: Array, directions: Array, middle: Array, radius: float) -> bool:
    """True when at most half of the beams towards a disc reach it; ``middle`` (2,) [m] from the sensor.

    A nan beam may have ended anywhere.
    """
    x, y = middle[0], middle[1]
    away, towards, before = math.hypot(x, y), 0, 0
    if away <= radius:
        return False
    for k in range(ranges.shape[0]):
        ahead, across = directions[k, 0], directions[k, 1]
        if abs(ahead * y - across * x) < radius and ahead * x + across * y > 0.0:
            towards += 1
            before += not ranges[k] >= away - radius
    return before >= 0.5 * towards


@njit(cache=True)
def correct(state, covariance, own, sensor, radius, alone, partly, sizes):
    """Correct a track with its points (n, 2): changes ``state`` (4,) and ``covariance`` (4, 4).

    ``alone``: nothing else is in its segment; ``partly``: something nearer hides one side of it. ``sizes``: least
    and greatest radius [m], share by which a radius shrinks, noise of a centre [m]. Returns the radius [m], and the
    distance of the farthest point from the centre, less the noise [m].
    """
    least, most, shrinks, noise = sizes
    middle = fitted_circle(own, state[:2], radius)
    if alone:
        fitting = min(max(seen_width(own, sensor), radius if partly else least), most)
        radius += (0.5 if fitting > radius else shrinks) * (fitting - radius)
        before, middle = middle, fitted_circle(own, state[:2], radius)
        for axis in range(2):
            state[axis] += middle[axis] - before[axis]  # more of it is seen: this is no motion
    if is_behind(own, middle, sensor, radius):
        before, middle = middle, front_circle(own, sensor, radius)
        for axis in range(2):
            state[axis] += middle[axis] - before[axis]
    _update(state, covariance, middle, noise**2)
    covers = 0.0
    for i in range(own.shape[0]):
        covers = max(covers, math.hypot(own[i, 0] - state[0], own[i, 1] - state[1]))
    return radius, covers - noise


@njit(cache=True)
def predict(state: Array, covariance: Array, dt: float, density: float) -> None:
    """Predict a track over dt [s], with white-noise acceleration of this density [m^2/s^3]."""
    for axis in range(2):
        state[axis] += dt * state[2 + axis]
    for axis in range(2):
        i, k = axis, 2 + axis
        pp, pv, vv = covariance[i, i], covariance[i, k], covariance[k, k]
        covariance[i, i] = pp + 2.0 * dt * pv + dt * dt * vv + density * dt**3 / 3.0
        covariance[i, k] = pv + dt * vv + density * dt * dt / 2.0
        covariance[k, i] = covariance[i, k]
        covariance[k, k] = vv + density * dt


@njit(cache=True)
def _update(state: Array, covariance: Array, middle: Array, variance: float) -> None:
    """Correct a track with a measured centre (2,) of this variance [m^2]; both axes are independent."""
    for axis in range(2):
        i, k = axis, 2 + axis
        pp, pv = covariance[i, i], covariance[i, k]
        gain_p, gain_v = pp / (pp + variance), pv / (pp + variance)
        off = middle[axis] - state[i]
        state[i] += gain_p * off
        state[k] += gain_v * off
        covariance[k, k] -= gain_v * pv
        covariance[i, k] = pv * (1.0 - gain_p)
        covariance[k, i] = covariance[i, k]
        covariance[i, i] = pp * (1.0 - gain_p)


@njit(cache=True)
def passed(points, origin, first, step, ranges, margin, turn):
    """Number of points (n, 2) [m] that all beams of a scan near them passed, by at least ``margin`` [m].

    ``turn`` [rad]: bearings of points may be off by this, and by the margin. ``first``, ``step`` [rad]: bearing of the
    first beam, and step to the next; a nan beam passes nothing.
    """
    count, beams = 0, ranges.shape[0]
    for i in range(points.shape[0]):
        x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
        away = max(math.sqrt(x * x + y * y), margin)
        ahead = (math.atan2(y, x) - first) / step
        half = (turn + margin / away) / step
        free = True
        for k in range(math.floor(ahead - half), math.ceil(ahead + half) + 1):
            beam = k % round(2.0 * math.pi / step)
            free = free and beam < beams and ranges[beam] > away + margin
        count += free
    return count
