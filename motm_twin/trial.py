"""One headless trial: run a scene to its end and report it in numbers."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from motm_twin.completion import Completion
from motm_twin.control.arm.types import Phase
from motm_twin.control.method import Method
from motm_twin.control.parameters import Parameters
from motm_twin.control.sequence import name_of
from motm_twin.control.tick import Tick
from motm_twin.measures import Measures
from motm_twin.measures.agents import base_gap, body_of
from motm_twin.measures.reference_tour import reference_tour
from motm_twin.methods.registry import FAST
from motm_twin.model.edits import ParameterValue
from motm_twin.model.plant import ExternalPlant
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.program import freeze_setup
from motm_twin.twin import Twin
from motm_twin.warm_up import compile_kernels, parts_of, program_clock

ENCOUNTER = 1.0  # [m] between base and agent at which an encounter begins
PARTED = 1.2  # [m] and at which it has ended
ROBOT_WAIT = 120.0  # [s] of wall time for an external robot to come: it may compile first


@dataclass
class Tally:
    """Sums over the Ticks of a trial."""

    path_length: float = 0.0
    closing_speed: list[float] = field(default_factory=list)
    period_ms: list[float] = field(default_factory=list)
    last_pose: Any = None
    encounters: int = 0
    meeting: set[str] = field(default_factory=set)

    def add(self, tick: Tick) -> None:
        """Take one Tick into account."""
        assert tick.truth is not None
        pose = tick.truth.pose
        if self.last_pose is not None:
            self.path_length += float(np.hypot(*(pose[:2] - self.last_pose[:2])))
        self.last_pose = pose.copy()
        closing = sum(step.phase == Phase.CLOSING for step in tick.arm)
        self.closing_speed += [abs(float(tick.observation.twist[0]))] * closing
        self.period_ms.append(tick.stage_ms["period"])

    def meet(self, tick: Tick, footprint: Footprint) -> None:
        """Count encounters: an agent comes within 1 m of the base; it must part before it counts again."""
        assert tick.truth is not None
        body = body_of(footprint)
        for agent in tick.truth.agents:
            gap = base_gap(body, tick.truth.pose, agent.position[0], agent.position[1], 0.5 * agent.size[0])
            if gap < ENCOUNTER and agent.name not in self.meeting:
                self.meeting.add(agent.name)
                self.encounters += 1
            elif gap > PARTED:
                self.meeting.discard(agent.name)


def run_trial(scene: str, variant: str | None = None, seed: int | None = None, method: Method = FAST) -> dict[str, Any]:
    """Load and run a scene; the dictionary that `motm-twin run --json` prints."""
    return run_scene(load_scene(scene, variant, seed), method=method)


def run_scene(
    scene: Scene,
    on_tick: Callable[[Tick], None] | None = None,
    plant: ExternalPlant | None = None,
    method: Method = FAST,
    parameters: dict[str, ParameterValue] | None = None,
    numbers: Parameters | None = None,
) -> dict[str, Any]:
    """Run a scene to the end of its task list or its time limit; ``plant``: an external robot.

    ``parameters``: of `control.tuning`, on top of the method's, and those on top of ``numbers``.
    """
    compile_kernels(parts_of(method.parameters, agents=bool(scene.agents)))
    twin = Twin(
        scene, method=method, parameters=parameters, numbers=numbers, clock=program_clock,
        plant=plant,
    )  # fmt: skip
    freeze_setup()
    if plant is not None:
        _wait_for(plant)
    tally, measures = Tally(), Measures(scene, twin.loop.manipulator.parameters.avoidance)
    began = program_clock()
    finish = Completion()
    while True:
        tick = twin.advance()
        tally.add(tick)
        tally.meet(tick, scene.robot.footprint)
        measures.add(tick)
        if on_tick is not None:
            on_tick(tick)
        finish.add(tick)
        if finish.over or tick.time >= scene.time_limit:
            break
    seconds = program_clock() - began
    tour, _ = reference_tour(scene)
    measured = measures.report()
    for leg in measured["legs"]:
        leg["reference_m"] = _finite(float(tour[leg["index"]])) if leg["index"] < len(tour) else 0.0
    return {**report(twin, tick, tally, seconds, float(tour.sum())), "measures": measured}


def _wait_for(robot: ExternalPlant) -> None:
    """Wait for a robot; raises TimeoutError when none comes."""
    deadline = time.monotonic() + ROBOT_WAIT
    while not robot.ready():
        if time.monotonic() > deadline:
            raise TimeoutError(robot.text())
        time.sleep(0.05)


def report(twin: Twin, tick: Tick, tally: Tally, seconds: float, tour: float) -> dict[str, Any]:
    """The trial in numbers, from its last Tick and tally; ``tour`` [m]: length of the reference tour."""
    scene, truth, sequence = twin.scene, tick.truth, twin.loop.sequence
    assert truth is not None
    places_total = _count(tick, "place")
    caused = [contact for contact in truth.contacts if contact.caused_by_robot]
    held = sum(body.state == "held" for body in truth.objects)
    kept = _count(tick, "pick") - places_total  # a scene may end with an object in the gripper
    completed = tick.success and truth.places == places_total and held >= kept and not truth.dropped
    p50, p99 = np.percentile(tally.period_ms, [50, 99])
    attempts = sum(task.attempts for task in tick.tasks if task.kind == "pick")
    return {
        "scene": scene.name,
        "method": twin.method.name,
        "variant": scene.variant,
        "seed": scene.seed,
        "success": bool(completed and not caused),
        "time_s": round(tick.time, 3),
        "reference_tour_s": round(tour / scene.robot.base.forward_speed, 2),
        "picks_done": truth.picks,
        "picks_attempted": attempts,
        "picks_total": _count(tick, "pick"),
        "places_done": truth.places,
        "places_total": places_total,
        "drops": truth.drops,
        "dropped": list(truth.dropped),
        "contacts": [msgspec.to_builtins(contact) for contact in truth.contacts],
        "contacts_caused_by_robot": len(caused),
        "cut_ins": [msgspec.to_builtins(cut_in) for cut_in in truth.cut_ins],
        "min_base_clearance_m": _finite(truth.min_base_clearance),
        "min_arm_clearance_m": _finite(truth.min_arm_clearance),
        "min_ee_obstacle_m": _finite(truth.min_ee_obstacle),
        "path_length_m": round(tally.path_length, 3),
        "mean_closing_base_speed_mps": round(float(np.mean(tally.closing_speed)), 4) if tally.closing_speed else None,
        "encounters": tally.encounters,
        "plant_faults": list(truth.plant_faults),
        **({} if truth.physics is None else {"physics": msgspec.to_builtins(truth.physics)}),
        "reason": failure(twin, tick, completed, len(caused), sequence.failures),
        "tick_ms": {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(max(tally.period_ms), 3)},
        "realtime_factor": round(tick.time / seconds, 2),
        "state_hash": twin.state_hash(),
    }


def failure(twin: Twin, tick: Tick, completed: bool, caused: int, failures: tuple[str, ...]) -> str:
    """Reason why a trial did not succeed, in one sentence; '' when it did."""
    if failures:
        return "; ".join(failures)
    if not tick.done:
        task = twin.loop.sequence.active
        doing = f"{tick.tasks[tick.task_index].kind} {name_of(task)}" if task is not None else "the last task"
        why = tick.stop_reason or tick.arm[-1].reason or tick.plan.reason
        return f"time limit {twin.scene.time_limit:.0f} s reached during {doing}" + (f": {why}" if why else "")
    if not completed:
        truth, places = tick.truth, _count(tick, "place")
        if truth is not None and truth.dropped:
            return f"dropped, and not picked up and placed again: {', '.join(truth.dropped)}"
        if truth is not None and truth.places == places:
            return "the referee sees nothing in the gripper, and the robot believes to hold an object"
        return "the referee counts fewer objects in their bins than the robot believes to have placed"
    if caused:
        return f"{caused} contact(s) caused by the robot"
    return ""


def _count(tick: Tick, kind: str) -> int:
    """Tasks of a kind in the list as it is now."""
    return sum(task.kind == kind for task in tick.tasks)


def _finite(value: float) -> float | None:
    """The number, or None for infinity, which JSON lacks: nothing was near."""
    return round(value, 4) if np.isfinite(value) else None
