"""Scan matching: the localised pose, corrected by the mapped furniture in sight.

Localisation is some centimetres off (`model.scene.USUAL_NOISE`), enough for a finger to hit a table's edge. Mapped
furniture shows the error in every sweep. A Kalman filter keeps the correction: each sweep measures it from point to
line (Censi, *An ICP variant using a point-to-line metric*, ICRA 2008), and with nothing mapped in sight it fades.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import msgspec
import numpy as np

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array, compose, inverse, wrap_angle
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import Observation, Scan
from motm_twin.perception.sweeps import REACH, seen_edges

QUICK = 0.3  # share of the error's variance that changes as quickly as `correlation` says; the rest drifts
HEADING = 0.5  # [rad/m] ratio of localisation's error of heading to that of position, both 1 sd


class MatchSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of the match of scan and map."""

    position_sd: Annotated[
        float, Number("m", OWN, "sd of localisation per axis; its error fades over `correlation`")
    ] = 0.02
    correlation: Annotated[
        float,
        Number("s", OWN, "time over which the error of localisation fades: the quick part of this project's noise"),
    ] = 5.0
    beam_sd: Annotated[
        float,
        Number("m", OWN, "sd of a beam: neighbours err alike; off by this and 3 sd of the pose, it met something else"),
    ] = 0.04


@dataclass
class MatchState:
    """The correction, and the inputs of its last update."""

    offset: Array = field(default_factory=lambda: np.zeros(3))  # to be added to localised poses [m, m, rad]
    covariance: Array | None = None  # of the offset, shape (3, 3); None: nothing was matched yet
    pose: Array | None = None  # as reported last; odometry likewise
    odometry: Array | None = None
    time: float = 0.0  # [s]
    stamp: float | None = None  # of the newest sweep that was matched


def follow(state: MatchState, now: Observation, settings: MatchSettings) -> None:
    """Let the correction fade; when localisation leaps away from odometry, its covariance returns to the prior."""
    prior = _prior(settings)
    if state.pose is None or state.odometry is None or state.covariance is None:
        state.covariance = np.diag(prior * prior)
    else:
        keep = math.exp(-max(now.time - state.time, 0.0) / settings.correlation)
        leap = np.abs(compose(inverse(state.pose), now.pose) - compose(inverse(state.odometry), now.odometry))
        known = 0.0 if (leap > prior).any() else keep * keep
        state.offset = keep * state.offset
        fresh = 1.0 if known == 0.0 else QUICK * (1.0 - known)
        state.covariance = known * state.covariance + fresh * np.diag(prior * prior)
    state.pose, state.odometry, state.time = now.pose, now.odometry, now.time


def match(state: MatchState, scan: Scan, segments: Array, settings: MatchSettings) -> None:
    """Measure the correction with a new sweep; ``segments`` (s, 4) [m] are those of `sweeps.map_segments`."""
    if scan.stamp == state.stamp or state.covariance is None or not len(segments):
        return
    state.stamp = scan.stamp
    state.offset, state.covariance = _measured(
        state.offset, state.covariance, scan.pose, scan.ranges, scan.angle_min, scan.angle_step, scan.origin,
        segments, min(REACH, scan.range_max), settings.beam_sd,
    )  # fmt: skip


def corrected(state: MatchState, pose: Array) -> Array:
    """A localised pose (3,) with the present correction."""
    pose = pose + state.offset
    pose[2] = wrap_angle(float(pose[2]))
    return pose


def sd(state: MatchState) -> float:
    """Error of the position on the map, 1 sd [m] along the less certain axis."""
    return 0.0 if state.covariance is None else math.sqrt(max(state.covariance[0, 0], state.covariance[1, 1]))


def _prior(settings: MatchSettings) -> Array:
    return np.array([settings.position_sd, settings.position_sd, HEADING * settings.position_sd])


@njit(cache=True)
def _measured(
    offset: Array, covariance: Array, localised: Array, ranges: Array, angle_min: float, step: float, origin: Array,
    segments: Array, reach: float, sd: float,
) -> tuple[Array, Array]:  # fmt: skip
    """The correction (3,) and its covariance (3, 3) after a sweep; a beam belongs to the map line it should meet.

    Beams count less the further they end from their line (Tukey's weights), and not at all beyond the error of the
    pose: an unmapped box before furniture must not be taken for furniture.
    """
    pose = localised + offset
    expected, edges, _ = seen_edges(pose, origin, angle_min, step, ranges.shape[0], segments, reach)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    arm_x, arm_y = c * origin[0] - s * origin[1], s * origin[0] + c * origin[1]
    H, g = _inverse(covariance), np.zeros(3)
    row = np.zeros(3)
    for i in range(ranges.shape[0]):
        k = edges[i]
        if k < 0 or not math.isfinite(ranges[i]) or not math.isfinite(expected[i]):
            continue
        angle = pose[2] + angle_min + i * step
        lever_x, lever_y = arm_x + ranges[i] * math.cos(angle), arm_y + ranges[i] * math.sin(angle)
        ax, ay = pose[0] + lever_x - segments[k, 0], pose[1] + lever_y - segments[k, 1]
        ex, ey = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
        squared = ex * ex + ey * ey
        along = ax * ex + ay * ey
        if squared <= 0.0 or along < 0.0 or along > squared:
            continue
        length = math.sqrt(squared)
        nx, ny = ey / length, -ex / length
        error = ax * nx + ay * ny
        row[0], row[1], row[2] = nx, ny, ny * lever_x - nx * lever_y
        variance = 0.0
        for a in range(3):
            for b in range(3):
                variance += row[a] * covariance[a, b] * row[b]
        gate = sd + 3.0 * math.sqrt(variance)
        if abs(error) >= gate:
            continue
        share = 1.0 - (error / gate) * (error / gate)
        weight = share * share / (sd * sd)
        for a in range(3):
            g[a] -= weight * error * row[a]
            for b in range(3):
                H[a, b] += weight * row[a] * row[b]
    after = _inverse(H)
    moved = offset.copy()
    for a in range(3):
        for b in range(3):
            moved[a] += after[a, b] * g[b]
    return moved, after


@njit(cache=True)
def _inverse(m: Array) -> Array:
    """Inverse of a symmetric positive definite matrix (3, 3), by its cofactors."""
    out = np.empty((3, 3))
    out[0, 0] = m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2]
    out[1, 1] = m[0, 0] * m[2, 2] - m[0, 2] * m[0, 2]
    out[2, 2] = m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]
    out[0, 1] = m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]
    out[0, 2] = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    out[1, 2] = m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    return out / (m[0, 0] * out[0, 0] + m[0, 1] * out[0, 1] + m[0, 2] * out[0, 2])
