"""Check for a blind sector of the lidar: some beams get no return from mapped furniture that other beams see.

A blind sector turns with the robot; furniture that was taken away is missing from every direction. So beams without an
expected return are in doubt, and they are blind once other beams have seen the same place. A beam near the end of some
furniture is not judged, as it may pass beside it when the pose is a little off. Beams in doubt and blind beams are
ignored: the space there is unknown, not free. They are trusted again when they return something, or have missed nothing
for a while, which is longer each time.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import Scan
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.finding import HALF, Finding
from motm_twin.perception.scan import BLIND_ANGLE
from motm_twin.perception.sweeps import GONE_AFTER, REACH, seen_edges

NEVER = -math.inf  # [s]


class SectorSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the check of single beams."""

    rest: Annotated[
        float,
        Number(
            "s", OWN, "time without a miss, times how often it was blind, after which a blind sector is trusted again"
        ),
    ] = 5.0
    bin: Annotated[float, Number("m", OWN, "length of a furniture outline that is remembered as one place")] = 0.1
    margin: Annotated[
        float, Number("m", OWN, "range error, more by `share`, up to which a return is of the mapped edge")
    ] = 0.15
    share: Annotated[float, Number("", OWN, "range error, as a share of the range, that is added to `margin`")] = 0.03
    proofs: Annotated[int, Number("", OWN, "beams that prove a sector blind, or that it sees again")] = 3


@dataclass
class SectorState:
    """Memory of the check: one entry per beam, or per bin of the map's outlines."""

    unseen: NDArray[np.bool_]  # beams that are not trusted now
    doubted: Array  # stamp [s] since which each beam has missed furniture; nan: it is trusted
    proved: NDArray[np.bool_]  # beams that have missed furniture that others have seen since
    blind: NDArray[np.bool_]  # beams of a sector with enough proved beams
    times: NDArray[np.int64]  # how often each beam was found blind
    miss: Array  # stamp [s] of the newest miss of each beam
    returned: Array  # stamp [s] of the newest return of each beam
    gone: NDArray[np.bool_]  # bins of furniture that is no longer there
    missed: NDArray[np.int64]  # beam that missed each bin last, until the bin is seen; -1: none
    missing: Array  # stamp [s] since which each bin is missed; nan: it was seen since

    @classmethod
    def of(cls, beams: int, bins: int) -> "SectorState":
        """Initial state: all beams are trusted."""
        return cls(
            unseen=np.zeros(beams, bool),
            doubted=np.full(beams, math.nan),
            proved=np.zeros(beams, bool),
            blind=np.zeros(beams, bool),
            times=np.zeros(beams, np.int64),
            miss=np.full(beams, NEVER),
            returned=np.full(beams, NEVER),
            gone=np.zeros(bins, bool),
            missed=np.full(bins, -1),
            missing=np.full(bins, math.nan),
        )

    def move_to(self, bins: int) -> None:
        """Switch to another map with this number of bins: keep the blind beams, forget the bins that they missed."""
        fresh = SectorState.of(0, bins)
        self.gone, self.missed, self.missing = fresh.gone, fresh.missed, fresh.missing


class Outline(msgspec.Struct, frozen=True, eq=False):
    """Edges of the mapped furniture, cut into bins."""

    segments: Array  # shape (s, 4) [m]
    first: NDArray[np.int64]  # first bin of each edge, and the number of all bins; shape (s + 1,)

    @classmethod
    def of(cls, segments: Array, width: float) -> "Outline":
        """Cut the segments (s, 4) [m] into bins at most ``width`` [m] wide."""
        lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
        counts = np.maximum(1, np.ceil(lengths / width)).astype(np.int64)
        return cls(segments, np.concatenate(([0], np.cumsum(counts))))


def check_sector(
    state: SectorState, scan: Scan, pose: Array | None, outline: Outline, settings: SectorSettings
) -> tuple[Scan, Finding | None]:
    """The sweep with nan for beams that are not trusted, and the finding; the same sweep and None if all are trusted.

    ``pose`` (3,): base pose of the sweep; None: it is in doubt, and the memory of the beams does not change.
    """
    if pose is not None and len(outline.segments):
        _look(state, scan, pose, outline, settings)
    unseen = state.unseen
    if not unseen.any():
        return scan, None
    wide = math.degrees(abs(scan.angle_step)) * int(unseen.sum())
    why = Reason(kind=Kind.SCAN_SECTOR, subject="lidar", value=wide, limit=math.degrees(BLIND_ANGLE), unit="deg")
    finding = Finding(reason=why, base=HALF if state.blind.any() else 1.0)
    ranges = np.where(unseen, np.nan, scan.ranges)
    return msgspec.structs.replace(scan, ranges=ranges, blind=unseen.copy()), finding


def _look(state: SectorState, scan: Scan, pose: Array, outline: Outline, settings: SectorSettings) -> None:
    """Compare a sweep with the map, and update the beams that are not trusted."""
    reach = min(REACH, scan.range_max)
    expected = seen_edges(pose, scan.origin, scan.angle_min, scan.angle_step, len(scan.ranges), outline.segments, reach)
    sure = _surely_met(expected[0], expected[1], abs(scan.angle_step), settings.margin)
    run = max(settings.proofs, math.ceil(BLIND_ANGLE / abs(scan.angle_step)))
    limits = (GONE_AFTER, settings.rest, settings.margin, settings.share, run, settings.proofs)
    state.unseen = _follow(
        (state.doubted, state.proved, state.blind, state.times, state.miss, state.returned),
        (state.gone, state.missed, state.missing),
        scan.ranges, (*expected, sure), outline.first, scan.stamp, limits,
    )  # fmt: skip


@njit(cache=True)
def _surely_met(ranges: Array, edge: NDArray[np.int64], step: float, margin: float) -> NDArray[np.bool_]:
    """Mask of beams that meet furniture even if the pose is off by a margin [m] across them, shape (n,).

    ``ranges`` and ``edge`` are those of `seen_edges`; ``step`` [rad] between beams.
    """
    count = ranges.shape[0]
    result = edge >= 0
    for i in range(count):
        if edge[i] < 0:
            continue
        aside = int(math.ceil(math.atan2(margin, ranges[i]) / step))
        for k in range(max(0, i - aside), min(count, i + aside + 1)):
            if edge[k] < 0:
                result[i] = False
                break
    return result


@njit(cache=True)
def _follow(state, places, returns, expected, first, stamp, limits):
    """Update the memory with one sweep; returns a mask of the beams that are not trusted now, shape (n,).

    ``expected``: mapped furniture that each beam meets, from `seen_edges` and `_surely_met`.
    """
    ranges, edge, along, sure = expected
    doubted, proved, blind, _, miss, returned = state
    gone, missed, missing = places
    doubt, rest, margin, share, run, proofs = limits
    count = returns.shape[0]
    place = np.full(count, -1, np.int64)
    misses = np.zeros(count, np.bool_)
    for i in range(count):
        if math.isfinite(returns[i]):
            returned[i] = stamp
        if edge[i] < 0:
            continue
        bins = first[edge[i] + 1] - first[edge[i]]
        place[i] = first[edge[i]] + min(bins - 1, int(along[i] * bins))
        error = returns[i] - ranges[i]
        if abs(error) <= margin + share * ranges[i]:
            gone[place[i]], missing[place[i]] = False, np.nan
            if missed[place[i]] >= 0:
                proved[missed[place[i]]] = True
                missed[place[i]] = -1
        elif math.isfinite(error) and error > 0.0:
            gone[place[i]] = True  # something behind it is seen
        misses[i] = returns[i] == np.inf and sure[i] and not gone[place[i]]
    begin = 0
    while begin < count:
        end = begin
        while end < count and misses[end]:
            end += 1
        if end - begin >= run:
            for i in range(begin, end):
                k = place[i]
                missed[k], miss[i] = i, stamp
                if math.isnan(doubted[i]):
                    doubted[i], proved[i] = stamp, False
                if math.isnan(missing[k]):
                    missing[k] = stamp
                if not blind[i] and stamp - missing[k] > doubt:
                    gone[k], missed[k] = True, -1
        begin = max(end, begin + 1)
    unseen = np.zeros(count, np.bool_)
    begin = np.int64(0)
    while begin < count:
        end = begin
        while end < count and not math.isnan(doubted[end]):
            end += 1
        if end > begin:
            _judge(state, missed, begin, end, stamp, (doubt, rest, proofs), unseen)
        begin = max(end, begin + 1)
    return unseen


@njit(cache=True)
def _judge(state, missed, begin, end, stamp, limits, unseen):
    """Judge a run of doubted beams: it sees again, is blind (with silent neighbours), or is trusted after a while."""
    doubted, proved, blind, times, miss, returned = state
    doubt, rest, proofs = limits
    known = blind[begin:end].any()
    rested = stamp - miss[begin:end].max() > rest * max(1, times[begin:end].max())
    if (returned[begin:end] == stamp).sum() >= proofs or (known and rested):
        doubted[begin:end] = np.nan
        blind[begin:end] = False
        for k in range(missed.shape[0]):
            if begin <= missed[k] < end:
                missed[k] = -1
        return
    unseen[begin:end] = True
    if known or proved[begin:end].sum() >= proofs:
        times[begin:end] = max(1, times[begin:end].max() + (not known))
        blind[begin:end] = True
        since = doubted[begin:end].min()
        while begin > 0 and returned[begin - 1] < since:
            begin -= 1
        while end < doubted.shape[0] and returned[end] < since:
            end += 1
        unseen[begin:end] = True
    else:
        for i in range(begin, end):
            if stamp - doubted[i] > doubt:
                doubted[i] = np.nan
