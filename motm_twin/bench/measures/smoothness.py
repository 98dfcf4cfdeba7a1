"""Quality of motion: what the arm feels of the base, and whether the base zigzags."""

import math
from typing import Any

import numpy as np

from motm_twin.bench.measures.interval import Interval
from motm_twin.model.geometry import Array

STEADY = math.radians(1.0)  # [rad/s] of yaw rate that has no sign


class Smoothness:
    """Acceleration at the foot of the arm, and sign changes of the yaw rate per metre of path.

    The acceleration is that of the true position of the arm's foot in the plane, over two periods (100 ms).
    Yaw rates below 1 deg/s have no sign: a change is from more than that on one side to more than that on the other.
    """

    def __init__(self) -> None:
        self._velocity: Array | None = None
        self._dt = 0.0
        self._accelerations: list[float] = []
        self._sign = 0
        self._changes = 0
        self._path = 0.0

    def add(self, interval: Interval) -> None:
        """Take an interval into account."""
        velocity = (interval.end.mount - interval.start.mount) / interval.dt
        if self._velocity is not None:
            between = 0.5 * (interval.dt + self._dt)
            self._accelerations.append(float(np.hypot(*(velocity - self._velocity))) / between)
        self._velocity, self._dt = velocity, interval.dt
        self._path += interval.path
        w = interval.twist[1]
        if abs(w) > STEADY:
            sign = int(math.copysign(1, w))
            self._changes += self._sign == -sign
            self._sign = sign

    def report(self) -> dict[str, Any]:
        """Largest and p99 acceleration [m/s^2], sign changes per metre [1/m]; None where nothing was driven."""
        felt = self._accelerations
        return {
            "arm_base_acceleration_mps2": {
                "max": round(max(felt), 4) if felt else None,
                "p99": round(float(np.percentile(felt, 99)), 4) if felt else None,
            },
            "yaw_sign_changes": self._changes,
            "yaw_sign_changes_per_m": round(self._changes / self._path, 4) if self._path > 0.0 else None,
        }
