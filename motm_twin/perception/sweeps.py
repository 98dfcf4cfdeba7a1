"""Checks of lidar sweeps for a frozen, blind or noisy lidar, and the fit of a sweep to the map."""

import math
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.exact import hypot
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import Scan
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.finding import HALF, Finding
from motm_twin.perception.footprints import outline

REACH = 6.0  # [m] mapped furniture further away may be missed by thin beams
GONE_AFTER = 3.0  # [s] after which furniture or returns that no beam has seen since are believed to be gone


class SweepSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the checks of sweeps."""

    moved: Annotated[
        float,
        Number("m, rad", OWN, "motion of the robot after which a sweep of a lidar without noise must have changed"),
    ] = 0.03
    few: Annotated[
        float,
        Number(
            "",
            OWN,
            "share of beams: if more contradict the motion, the lidar is frozen; if fewer of those expected return, "
            "blind",
        ),
    ] = 0.2
    noise: Annotated[
        float, Number("m", OWN, "scatter of ranges from which a lidar counts as noisy: it never repeats a sweep")
    ] = 0.002
    expected: Annotated[
        int, Number("", OWN, "beams with mapped furniture in sight from which the map says that something must return")
    ] = 5
    seen: Annotated[
        float, Number("", OWN, "share of all beams that must have returned before, so that their loss is noticed")
    ] = 0.02
    wide: Annotated[
        float, Number("", OWN, "lost share of all beams that counts as many: nobody takes away so much at once")
    ] = 0.25
    things: Annotated[
        int, Number("", OWN, "lost runs of beams that count as many: nobody takes away so many obstacles at once")
    ] = 3
    all_taken_away: Annotated[float, Number("s", OWN, "time after which many lost returns are believed to be gone")] = (
        20.0
    )
    slow_scatter: Annotated[
        float,
        Number(
            "m", OWN, "scatter of ranges that slows the base: margins bear 3 sd of 1 cm; three times as much stops it"
        ),
    ] = 0.04
    triples: Annotated[
        int, Number("", OWN, "least triples of neighbouring returns from which scatter is estimated")
    ] = 30


@dataclass
class SweepState:
    """Memory of the checks of sweeps."""

    ranges: Array | None = None  # of the newest sweep
    stamp: float | None = None
    same: int = 0  # number of identical sweeps before it
    odometry: Array | None = None  # when the first of them came, shape (3,)
    noisy: bool = False
    scatter: float = 0.0  # [m]
    returning: int = 0  # beams that return now, or did before they vanished
    things: int = 0  # runs of neighbouring beams among them
    vanished: float | None = None  # [s] stamp at which they vanished; None: they did not


def map_segments(known: KnownWorld) -> Array:
    """Edges of the mapped furniture that the lidar can see, shape (s, 4) [m]: x, y, x, y."""
    z = known.robot.lidar.z
    edges = [np.zeros((0, 4))]
    for solid in known.solids:
        if solid.z_min <= z <= solid.z_max and solid.z_min < known.robot.top:
            corners = outline(solid.shape)
            edges.append(np.hstack([corners, np.roll(corners, -1, axis=0)]))
    return np.ascontiguousarray(np.vstack(edges))


def check_sweep(
    state: SweepState, scan: Scan, pose: Array, odometry: Array, segments: Array, settings: SweepSettings
) -> Finding | None:
    """The worst finding of a new sweep; None for a good one. ``pose`` (3,): that of the sweep; ``odometry`` (3,)."""
    frozen = _frozen(state, scan, odometry, settings)
    if frozen is None:
        state.scatter = scatter(scan.ranges, settings.triples)
        state.noisy = state.noisy or state.scatter > settings.noise
    state.ranges, state.stamp = scan.ranges, scan.stamp
    return frozen or _blind(state, scan, pose, segments, settings) or _noisy(state, settings)


def _frozen(state: SweepState, scan: Scan, odometry: Array, settings: SweepSettings) -> Finding | None:
    """Finding for a repeated sweep: noise never repeats, and without noise ranges must change as the robot moves."""
    before = state.ranges
    returning = int(np.isfinite(scan.ranges).sum())
    if before is None or returning < settings.expected or not np.array_equal(before, scan.ranges, equal_nan=True):
        state.same, state.odometry = 0, odometry.copy()
        return None
    state.same += 1
    assert state.odometry is not None
    way = math.hypot(*(odometry[:2] - state.odometry[:2]).tolist())
    turn = abs(math.remainder(float(odometry[2] - state.odometry[2]), 2.0 * math.pi))
    moved = way > settings.moved or turn > settings.moved
    if not (state.noisy and state.same > 1) and not (moved and unmoved(scan, state.odometry, odometry) > settings.few):
        return None
    why = Reason(kind=Kind.SCAN_FROZEN, subject="lidar", value=state.same + 1, limit=1, unit="identical sweeps")
    return Finding(reason=why, base=0.0)


def unmoved(scan: Scan, before: Array, now: Array) -> float:
    """Share of the returning beams that contradict the motion between two odometry poses (3,)."""
    return _unmoved(scan.ranges, scan.angle_min, scan.angle_step, scan.origin, before, now)


def _blind(state: SweepState, scan: Scan, pose: Array, segments: Array, settings: SweepSettings) -> Finding | None:
    """Finding for missing returns: none where the map has furniture, or all vanished at once."""
    ranges = scan.ranges
    returning = int(np.isfinite(ranges).sum())
    expected = 0
    if returning < settings.wide * len(ranges) and len(segments):
        reach = min(REACH, scan.range_max)
        sensed = expected_ranges(pose, scan.origin, scan.angle_min, scan.angle_step, len(ranges), segments, reach)
        expected = int(np.isfinite(sensed).sum())
    if expected >= settings.expected and returning <= settings.few * expected:
        why = Reason(kind=Kind.SCAN_BLIND, subject="lidar", value=returning, limit=expected, unit="beams")
        return Finding(reason=why, base=0.0)
    return _vanished(state, scan, returning, settings)


def _vanished(state: SweepState, scan: Scan, returning: int, settings: SweepSettings) -> Finding | None:
    before = state.returning
    if state.vanished is None:
        gone = before >= max(settings.expected, settings.seen * len(scan.ranges)) and returning <= 0.1 * before
        if not gone:
            state.returning, state.things = returning, _runs(scan.ranges)
            return None
        state.vanished = scan.stamp
    many = before >= settings.wide * len(scan.ranges) or state.things >= settings.things
    patience = settings.all_taken_away if many else GONE_AFTER
    if returning > settings.few * before or scan.stamp - state.vanished > patience:
        state.vanished, state.returning, state.things = None, returning, _runs(scan.ranges)
        return None
    why = Reason(kind=Kind.SCAN_BLIND, subject="lidar", value=returning, limit=before, unit="beams")
    return Finding(reason=why, base=0.0)


def _noisy(state: SweepState, settings: SweepSettings) -> Finding | None:
    if state.scatter <= settings.slow_scatter:
        return None
    stop = state.scatter > 3.0 * settings.slow_scatter
    limit = (3.0 if stop else 1.0) * settings.slow_scatter
    why = Reason(kind=Kind.SCAN_NOISY, subject="lidar", value=state.scatter, limit=limit, unit="m")
    return Finding(reason=why, base=0.0 if stop else HALF)


@njit(cache=True)
def _runs(ranges: Array) -> int:
    """Number of runs of neighbouring beams that return."""
    count = 0
    inside = False
    for value in ranges:
        returns = math.isfinite(value)
        if returns and not inside:
            count += 1
        inside = returns
    return count


@njit(cache=True)
def scatter(ranges: Array, least: int) -> float:
    """Standard deviation [m] of a range about the line through its neighbours; 0 with fewer than ``least`` triples.

    Second differences of independent noise have sqrt(6) times its sd; the median is not affected by edges and corners.
    """
    found = np.empty(max(ranges.shape[0] - 2, 0))
    count = 0
    for i in range(ranges.shape[0] - 2):
        a, b, c = ranges[i], ranges[i + 1], ranges[i + 2]
        if math.isfinite(a) and math.isfinite(b) and math.isfinite(c):
            found[count] = abs(a - 2.0 * b + c)
            count += 1
    return np.median(found[:count]) * 1.4826 / math.sqrt(6.0) if count >= least else 0.0


@njit(cache=True)
def expected_ranges(
    pose: Array, origin: Array, angle_min: float, step: float, count: int, segments: Array, reach: float
) -> Array:
    """Ranges [m] of the beams from a base pose (3,) to the nearest segment (s, 4); inf beyond reach. Shape (count,)."""
    return seen_edges(pose, origin, angle_min, step, count, segments, reach)[0]


@njit(cache=True)
def seen_edges(
    pose: Array, origin: Array, angle_min: float, step: float, count: int, segments: Array, reach: float
) -> tuple[Array, NDArray[np.int64], Array]:
    """Range [m] of each beam to the nearest segment (s, 4), its index, and the position on it (0 to 1).

    Beyond reach: inf, -1, 0.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ox, oy = pose[0] + c * origin[0] - s * origin[1], pose[1] + s * origin[0] + c * origin[1]
    ranges, edge, where = np.full(count, np.inf), np.full(count, -1, np.int64), np.zeros(count)
    near = np.empty(segments.shape[0], np.int64)
    kept = 0
    for k in range(segments.shape[0]):
        half_x, half_y = 0.5 * (segments[k, 2] - segments[k, 0]), 0.5 * (segments[k, 3] - segments[k, 1])
        if hypot(segments[k, 0] + half_x - ox, segments[k, 1] + half_y - oy) <= reach + hypot(half_x, half_y):
            near[kept] = k
            kept += 1
    for i in range(count):
        angle = pose[2] + angle_min + i * step
        dx, dy = math.cos(angle), math.sin(angle)
        for j in range(kept):
            k = near[j]
            ax, ay = segments[k, 0] - ox, segments[k, 1] - oy
            ex, ey = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
            det = ex * dy - ey * dx
            if det == 0.0:
                continue
            r = (ex * ay - ey * ax) / det
            along = (dx * ay - dy * ax) / det
            if 0.0 <= r < ranges[i] and 0.0 <= along <= 1.0 and r <= reach:
                ranges[i], edge[i], where[i] = r, k, along
    return ranges, edge, where


@njit(cache=True)
def map_fit(
    pose: Array, ranges: Array, angle_min: float, step: float, origin: Array, segments: Array, reach: float, sd: float
) -> tuple[int, float]:
    """Number of beams that should meet mapped furniture from a pose (3,), and their fit: mean of exp(-(error / sd)^2).

    A beam that ends over 1 m before the map meets something else, and is left out.
    """
    sensed = expected_ranges(pose, origin, angle_min, step, ranges.shape[0], segments, reach)
    count = 0
    total = 0.0
    for i in range(ranges.shape[0]):
        if not math.isfinite(sensed[i]) or math.isnan(ranges[i]) or ranges[i] < sensed[i] - 1.0:
            continue
        error = min(ranges[i], reach) - sensed[i]
        count += 1
        total += math.exp(-(error / sd) * (error / sd))
    return count, total / max(count, 1)


@njit(cache=True)
def _unmoved(ranges: Array, angle_min: float, step: float, origin: Array, before: Array, now: Array) -> float:
    c, s, back_c, back_s = math.cos(before[2]), math.sin(before[2]), math.cos(now[2]), math.sin(now[2])
    way = hypot(now[0] - before[0], now[1] - before[1]) + 0.5 * abs(now[2] - before[2])
    seen = 0
    other = 0
    count = ranges.shape[0]
    for i in range(count):
        if not math.isfinite(ranges[i]):
            continue
        angle = angle_min + i * step
        px, py = origin[0] + ranges[i] * math.cos(angle), origin[1] + ranges[i] * math.sin(angle)
        dx, dy = before[0] + c * px - s * py - now[0], before[1] + s * px + c * py - now[1]
        qx, qy = back_c * dx + back_s * dy - origin[0], -back_s * dx + back_c * dy - origin[1]
        k = int(math.floor((math.atan2(qy, qx) - angle_min) / step))
        if k < 1 or k > count - 3:
            continue
        seen += 1
        low, high = np.inf, -np.inf
        for j in range(k - 1, k + 3):
            low, high = min(low, ranges[j]), max(high, ranges[j])
        distance = hypot(qx, qy)
        if distance < low - 0.2 * way or distance > high + 0.2 * way:
            other += 1
    return other / max(seen, 1)
