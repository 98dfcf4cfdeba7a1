"""All measures of a trial, one reader of its Ticks."""

from typing import Any

from motm_twin.bench.measures.encounters import Encounters
from motm_twin.bench.measures.gripper import GripperObstacles
from motm_twin.bench.measures.interval import Interval, Sampler
from motm_twin.bench.measures.smoothness import Smoothness
from motm_twin.bench.measures.time_split import PARTS, TimeSplit
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.tick import Tick
from motm_twin.model.scene import Scene


class Measures:
    """Add every Tick of a trial in order; the report is JSON: numbers, texts, lists and mappings."""

    def __init__(self, scene: Scene, avoidance: AvoidanceParameters) -> None:
        """``avoidance``: of the method's arm, for d_s and the damper line."""
        self._sampler = Sampler(scene)
        self._split = TimeSplit(scene.robot.base.forward_speed)
        self._encounters = Encounters(scene.robot.footprint)
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
            part = self._split.add(interval, evading=self._encounters.evading)
            self._gripper.add(interval)
            self._smoothness.add(interval)
            self._leg(interval, part)

    def report(self) -> dict[str, Any]:
        """Everything measured; times [s] of both splits and of the legs add up to the time of the last Tick."""
        tasks = self._last.tasks if self._last is not None else ()
        names = [(task.kind, task.target) for task in tasks] + [("done", "")]
        legs = [
            {
                "index": index,
                "task": names[index][0],
                "target": names[index][1],
                "time_s": round(sum(parts.values()), 4),
                "path_m": round(self._paths[index], 4),
                "parts_s": {part: round(seconds, 4) for part, seconds in parts.items() if seconds},
            }
            for index, parts in sorted(self._legs.items())
        ]
        return {
            **self._split.report(),
            **self._encounters.report(),
            **self._gripper.report(),
            **self._smoothness.report(),
            "retries": sum(max(0, task.attempts - 1) for task in tasks),
            "legs": legs,
        }

    def _leg(self, interval: Interval, part: str) -> None:
        index = interval.tick.task_index
        leg = self._legs.setdefault(index, dict.fromkeys(PARTS, 0.0))
        leg[part] += interval.dt
        self._paths[index] = self._paths.get(index, 0.0) + interval.path
