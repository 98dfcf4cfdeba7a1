"""Where the time of a trial went, in two splits that both add up to it."""

import math
from typing import Any

from motm_twin.bench.measures.interval import STANDS, Interval

AT_LIMIT = 0.95  # share of the speed limit from which the base drives at it
TURNING = math.radians(10.0)  # [rad/s] from which a base that is slower than that is turning
AT_REST = ("stow", "carry")  # phases in which the arm has nothing to do
PHASES = ("driving", "waiting_for_arm", "stationary", "closing")
PARTS = ("at_limit", "below_limit", "turning", "reversing", "waiting_for_arm", "evading", "standing")


def waits_for_arm(interval: Interval) -> bool:
    """The base stands, and the arm is at work or the target is in its reach."""
    step = interval.tick.arm[-1]
    return not interval.moving and (step.phase not in AT_REST or interval.tick.plan.time_to_range == 0.0)


def closing_share(interval: Interval) -> float:
    """Part of the interval in which the fingers were closing on an object."""
    steps = interval.tick.arm
    return sum(step.phase == "closing" for step in steps) / len(steps)


def part_of(interval: Interval, v_f: float, *, evading: bool) -> str:
    """The one of `PARTS` that an interval belongs to; ``v_f`` [m/s] is the speed limit.

    In this order: evading (an evasive manoeuvre is under way, see `encounters`), waiting for the arm, standing,
    reversing, at the limit (forward with at least 95 % of it; a curve at full speed costs its length only), turning
    (slower, with at least 10 deg/s), below the limit.
    """
    v, w = interval.twist
    if evading:
        return "evading"
    if not interval.moving:
        return "waiting_for_arm" if waits_for_arm(interval) else "standing"
    if v < -STANDS:
        return "reversing"
    if v >= AT_LIMIT * v_f:
        return "at_limit"
    return "turning" if abs(w) >= TURNING else "below_limit"


class TimeSplit:
    """Adds up both splits, and the speed of the base while the fingers close."""

    def __init__(self, v_f: float) -> None:
        self._v_f = v_f
        self._phases: dict[str, float] = dict.fromkeys(PHASES, 0.0)
        self._parts: dict[str, float] = dict.fromkeys(PARTS, 0.0)
        self._moving = self._whole = 0.0
        self._closing: list[tuple[float, float]] = []  # speed [m/s], for how long [s]

    def add(self, interval: Interval, *, evading: bool) -> str:
        """Take an interval into account; the one of `PARTS` that it belongs to."""
        dt, share = interval.dt, closing_share(interval)
        self._whole += dt
        self._moving += dt * interval.moving
        self._phases["closing"] += share * dt
        rest = "driving" if interval.moving else "waiting_for_arm" if waits_for_arm(interval) else "stationary"
        self._phases[rest] += (1.0 - share) * dt
        part = part_of(interval, self._v_f, evading=evading)
        self._parts[part] += dt
        if share:
            self._closing.append((abs(interval.twist[0]), share * dt))
        return part

    def report(self) -> dict[str, Any]:
        """Both splits [s], base speed while closing [m/s], share of the time with the base moving."""
        return {
            "phases_s": {name: round(seconds, 4) for name, seconds in self._phases.items()},
            "parts_s": {name: round(seconds, 4) for name, seconds in self._parts.items()},
            "closing_base_speed_mps": self._closing_speed(),
            "moving_share": round(self._moving / self._whole, 4) if self._whole else None,
        }

    def _closing_speed(self) -> dict[str, float] | None:
        if not self._closing:
            return None
        whole = sum(seconds for _, seconds in self._closing)
        speeds = [speed for speed, _ in self._closing]
        mean = sum(speed * seconds for speed, seconds in self._closing) / whole
        return {"mean": round(mean, 4), "min": round(min(speeds), 4), "max": round(max(speeds), 4)}
