"""Measures of a trial from its Ticks: time by part, smoothness, and the report of all of them."""

import math
from typing import Any

import numpy as np

from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.arm.types import Phase
from motm_twin.control.tick import Tick
from motm_twin.measures.agents import Encounters
from motm_twin.measures.gripper import GripperObstacles
from motm_twin.measures.interval import STANDS, Interval, Sampler
from motm_twin.measures.people import AmongPeople
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Scene

AT_LIMIT = 0.95  # share of the speed limit from which the base drives at it
TURNING = math.radians(10.0)  # [rad/s] from which a base that is slower than that is turning
AT_REST = (Phase.STOW, Phase.CARRY)  # phases in which the arm has nothing to do
PHASES = ("driving", "waiting_for_arm", "stationary", "closing")
PARTS = ("at_limit", "below_limit", "turning", "reversing", "waiting_for_arm", "evading", "standing")


def waits_for_arm(interval: Interval) -> bool:
    """The base stands, and the arm is at work or the target is in its reach."""
    step = interval.tick.arm[-1]
    return not interval.moving and (step.phase not in AT_REST or interval.tick.plan.time_to_range == 0.0)


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
        dt, steps = interval.dt, interval.tick.arm
        share = sum(step.phase == Phase.CLOSING for step in steps) / len(steps)  # in which the fingers were closing
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
        speeds = [speed for speed, _ in self._closing]
        mean = sum(speed * seconds for speed, seconds in self._closing) / sum(seconds for _, seconds in self._closing)
        return {"mean": round(mean, 4), "min": round(min(speeds), 4), "max": round(max(speeds), 4)}


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


class Measures:
    """Add every Tick of a trial in order; the report is JSON: numbers, texts, lists and mappings."""

    def __init__(self, scene: Scene, avoidance: AvoidanceParameters) -> None:
        """``avoidance``: of the method's arm, for d_s and the damper line."""
        self._sampler = Sampler(scene)
        self._split = TimeSplit(scene.robot.base.forward_speed)
        self._encounters = Encounters(scene.robot.footprint)
        self._people = AmongPeople(scene)
        self._gripper = GripperObstacles(scene, avoidance)
        self._smoothness = Smoothness()
        self._legs: dict[int, dict[str, float]] = {}  # task: seconds of each part
        self._paths: dict[int, float] = {}  # task: [m]
        self._last: Tick | None = None

    def add(self, tick: Tick) -> None:
        """Take the next Tick into account."""
        self._last = tick
        interval = self._sampler.interval(tick)
        if interval is not None:
            self._encounters.add(interval)
            self._people.add(interval, waits_for_arm=waits_for_arm(interval))
            part = self._split.add(interval, evading=self._encounters.evading)
            self._gripper.add(interval)
            self._smoothness.add(interval)
            index = interval.tick.task_index
            self._legs.setdefault(index, dict.fromkeys(PARTS, 0.0))[part] += interval.dt
            self._paths[index] = self._paths.get(index, 0.0) + interval.path

    def report(self) -> dict[str, Any]:
        """Everything measured; times [s] of both splits and of the legs add up to the time of the last Tick."""
        tasks = self._last.tasks if self._last is not None else ()
        names = [(task.kind, task.target) for task in tasks] + [("done", "")]
        legs = [
            {
                "index": index, "task": names[index][0], "target": names[index][1],
                "time_s": round(sum(parts.values()), 4), "path_m": round(self._paths[index], 4),
                "parts_s": {part: round(seconds, 4) for part, seconds in parts.items() if seconds},
            }
            for index, parts in sorted(self._legs.items())
        ]  # fmt: skip
        return {
            **self._split.report(), **self._encounters.report(), "among_people": self._people.report(),
            **self._gripper.report(), **self._smoothness.report(),
            "retries": sum(max(0, task.attempts - 1) for task in tasks), "legs": legs,
        }  # fmt: skip
