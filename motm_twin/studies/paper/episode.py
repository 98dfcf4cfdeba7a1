"""One trial, watched: what the gripper is near to, what it does about it, and who passes in front of whom."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.targets import odometry_to_world
from motm_twin.control.tick import Tick
from motm_twin.measures import Measures
from motm_twin.model.geometry import from_frame
from motm_twin.model.kinematics import Frankie
from motm_twin.model.scene import Scene
from motm_twin.sessions.made_with import SOURCE, made_with
from motm_twin.studies.paper.part import write_json
from motm_twin.studies.spec import TrialSpec, job_of, method_of

DIGITS = 4


class Moment(msgspec.Struct, frozen=True):
    """One period of an episode. World frame, metres, radians, seconds."""

    time: float
    pose: tuple[float, float, float]
    task: str  # kind and name of the active task
    phase: str  # of the arm
    distance: float | None  # gripper centre to the nearest seen obstacle; None: none is seen
    static: bool  # that obstacle counts as standing, not as one that may move
    agents: tuple[tuple[str, float, float, float], ...]  # name, x, y, yaw: the truth
    plan: tuple[tuple[float, float, float], ...]  # the local plan
    path: tuple[tuple[float, float], ...]  # the global path
    goal: tuple[float, float]  # of the base
    target: tuple[float, float] | None  # where the job is


class Episode(msgspec.Struct, frozen=True):
    """A whole trial."""

    spec: TrialSpec
    source: str
    moments: tuple[Moment, ...]
    result: dict[str, Any]
    measures: dict[str, Any]  # of `measures`: stretches below d_s, cut-ins, and the rest


@dataclass
class Watcher:
    """Collects moments from Ticks."""

    scene: Scene
    moments: list[Moment] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._frankie = Frankie(self.scene.robot)
        self._bins = {item.name: item.centre for item in self.scene.bins}

    def __call__(self, tick: Tick) -> None:
        """Take one Tick into account."""
        assert tick.truth is not None
        distance, static = self._nearest(tick)
        active = tick.tasks[tick.task_index] if tick.task_index < len(tick.tasks) else None
        self.moments.append(
            Moment(
                time=round(tick.time, DIGITS),
                pose=_rounded(tick.truth.pose),
                task=f"{active.kind} {active.target}" if active else "",
                phase=tick.arm[-1].phase,
                distance=distance,
                static=static,
                agents=tuple((each.name, *_rounded((*each.position[:2], each.yaw))) for each in tick.truth.agents),
                plan=tuple(_rounded(pose[:3]) for pose in tick.plan.local_poses),
                path=tuple(_rounded(point) for point in tick.plan.global_path),
                goal=_rounded(tick.placement.goal[:2]),
                target=self._target(tick),
            )
        )

    def _nearest(self, tick: Tick) -> tuple[float | None, bool]:
        """Distance of the gripper to what is seen, and whether that stands: as the arm sees it, horizontally."""
        if not len(tick.map.seen_points):
            return None, False
        points = from_frame(odometry_to_world(tick.observation), tick.map.seen_points)
        hand = self._frankie.tcp_pose(tick.observation.odometry, tick.observation.q)[0][:2]
        distance = np.hypot(*(points - hand).T)
        nearest = int(np.argmin(distance))
        return round(float(distance[nearest]), DIGITS), bool(tick.map.seen_static[nearest])

    def _target(self, tick: Tick) -> tuple[float, float] | None:
        if tick.task_index >= len(tick.tasks):
            return None
        task = tick.tasks[tick.task_index]
        if task.kind == "place":
            return self._bins.get(task.target)
        assert tick.truth is not None
        found = [each.position[:2] for each in tick.truth.objects if each.name == task.target]
        return _rounded(found[0]) if found else None


def watch_trial(spec: TrialSpec, folder: Path, source: str) -> Episode:
    """The episode of a trial of motm as shipped: from the folder, as this or else the current source made it, or now.

    ``source``: of the trial. Where that is another one than now and left no episode, the episode is of another run.
    """
    from motm_twin.trial import run_scene  # the whole twin: only where a trial is run

    job, current = job_of(spec), made_with()[SOURCE]
    for each in dict.fromkeys((source, current)):
        file = folder / f"{job.key(each)}.json"
        if file.is_file():
            return msgspec.json.decode(file.read_bytes(), type=Episode)
    watcher, measures = Watcher(job.scene), Measures(job.scene, AvoidanceParameters())

    def on_tick(tick: Tick) -> None:
        watcher(tick)
        measures.add(tick)

    result = run_scene(job.scene, on_tick=on_tick, method=method_of(job), parameters=dict(spec.parameters))
    folder.mkdir(parents=True, exist_ok=True)
    episode = Episode(
        spec=spec, source=current, moments=tuple(watcher.moments), result=result, measures=measures.report()
    )
    partial = file.with_suffix(".partial")
    write_json(partial, msgspec.to_builtins(episode))
    partial.replace(file)  # a file is whole or not there
    return episode


def _rounded(values: Any) -> Any:
    return tuple(round(float(value), DIGITS) for value in values)
