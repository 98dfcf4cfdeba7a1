"""Check of lidar scans: only a scan that has passed it may change the map."""

import math
from dataclasses import dataclass

import numpy as np

from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.plant import Scan
from motm_twin.model.profile import Lidar
from motm_twin.model.reason import Kind, Reason

BAD_SHARE = 0.05  # share of beams that may be nan or negative (one always may): with more, the lidar is failing
BLIND_ANGLE = math.radians(5.0)  # [rad] of neighbouring bad beams: a wider gap would hide a leg 1 m away
MAX_AGE = 0.5  # [s] older scans would draw obstacles where they no longer are
POSE_SIZE = 3
_CHECKED = object()


@dataclass(frozen=True, eq=False)
class RefusedScan:
    """A scan that must not be used, for a reason."""

    reason: Reason


class CheckedScan:
    """A scan in the world frame whose every number was checked; built only by `check_scan`."""

    __slots__ = ("angle_min", "angle_step", "directions", "mount", "origin", "pose", "range_max", "ranges", "stamp")

    def __init__(self, token: object, scan: Scan) -> None:
        if token is not _CHECKED:
            raise TypeError("a CheckedScan is made by check_scan only: unchecked numbers must not reach the map")
        self.stamp: float = scan.stamp
        self.pose: Array = scan.pose
        self.mount: Array = scan.origin  # of the sensor in the base frame
        self.origin: Array = from_frame(scan.pose, scan.origin)
        self.angle_min, self.angle_step = scan.angle_min, scan.angle_step
        bearings = scan.pose[2] + scan.angle_min + scan.angle_step * np.arange(len(scan.ranges))
        self.directions: Array = np.empty((len(bearings), 2))
        self.directions[:, 0], self.directions[:, 1] = np.cos(bearings), np.sin(bearings)
        self.ranges: Array = np.where(scan.ranges >= scan.range_min, scan.ranges, np.nan)  # nan: not known
        self.range_max: float = scan.range_max


def check_scan(scan: Scan, lidar: Lidar, now: float) -> CheckedScan | RefusedScan:
    """The scan, checked against the lidar of the profile at time now [s]; or the reason why it is refused.

    A beam below ``range_min`` is left out; one beyond ``range_max`` (or inf) means "nothing up to there". A few beams
    that are nan or negative are left out, too; with many of them the whole scan is refused.
    """
    reason = _numbers_wrong(scan) or _shape_wrong(scan, lidar) or _time_wrong(scan, now)
    if reason:
        return RefusedScan(Reason(kind=Kind.SCAN_BAD, subject=reason))
    return CheckedScan(_CHECKED, scan)


def _numbers_wrong(scan: Scan) -> str:
    header = (scan.stamp, scan.angle_min, scan.angle_step, scan.range_min, scan.range_max)
    if not all(math.isfinite(value) for value in header):
        return "its stamp, angles or range limits are not finite"
    if scan.pose.shape != (POSE_SIZE,) or not _finite(scan.pose):
        return f"its pose {scan.pose} is not three finite numbers"
    if scan.origin.shape != (2,) or not _finite(scan.origin):
        return f"its sensor position {scan.origin} is not two finite numbers"
    return _beams_wrong(scan)


def _beams_wrong(scan: Scan) -> str:
    """Reason if too many beams, in total or adjacent, are nan or negative, known blind ones aside; "" if not."""
    ranges, step = scan.ranges, scan.angle_step
    bad = ~(ranges >= 0.0)  # true for nan
    if scan.blind is not None and scan.blind.shape == bad.shape:
        bad &= ~scan.blind
    count = int(bad.sum())
    if count <= 1:
        return ""
    most = max(1, int(BAD_SHARE * bad.size))
    if count > most:
        return f"{count} of {bad.size} ranges are nan or negative, at most {most} may be"
    if abs(step) * (bad.size + 0.5) >= 2.0 * math.pi:  # all round: its last beam is beside its first
        bad = np.roll(bad, -int(bad.argmin()))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], bad, [False])).astype(np.int8)))
    longest = int((edges[1::2] - edges[::2]).max())
    if longest > 1 and longest * abs(step) > BLIND_ANGLE:
        wide = math.degrees(longest * step)
        return f"{longest} neighbouring ranges are nan or negative, over {wide:.0f} deg"
    return ""


def _finite(numbers: Array) -> bool:
    """Test that each of a few numbers (n,) is finite."""
    return all(math.isfinite(value) for value in numbers.tolist())


def _shape_wrong(scan: Scan, lidar: Lidar) -> str:
    if scan.ranges.shape != (lidar.beams,):
        return f"{scan.ranges.shape} ranges, the profile's lidar has {lidar.beams} beams"
    if not 0.0 <= scan.range_min < scan.range_max:
        return f"range limits {scan.range_min} to {scan.range_max} m"
    if not 0.0 < scan.angle_step * (lidar.beams - 1) <= 2.0 * math.pi + 1e-6:
        return f"an angle step of {scan.angle_step} rad does not fit {lidar.beams} beams"
    return ""


def _time_wrong(scan: Scan, now: float) -> str:
    if scan.stamp > now + 1e-6:
        return f"its stamp {scan.stamp:.3f} s is later than now, {now:.3f} s"
    if now - scan.stamp > MAX_AGE:
        return f"it is {now - scan.stamp:.2f} s old, more than {MAX_AGE} s"
    return ""
