"""One headless trial: run a scene to its end and report it in numbers; `motm_twin.run` and its `Result`."""

import html
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from motm_twin.control.arm.types import Phase
from motm_twin.control.method import Method
from motm_twin.control.parameters import Parameters
from motm_twin.control.sequence import name_of
from motm_twin.control.tick import Completion, Tick
from motm_twin.measures import Measures
from motm_twin.measures.agents import base_gap, body_of
from motm_twin.measures.interval import finite
from motm_twin.measures.references import reference_tour
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.edits import ParameterValue
from motm_twin.model.geometry import Array
from motm_twin.model.plant import ExternalPlant
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.program import freeze_setup
from motm_twin.twin import Twin
from motm_twin.warm_up import compile_kernels, parts_of, program_clock

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENCOUNTER = 1.0  # [m] between base and agent at which an encounter begins
PARTED = 1.2  # [m] between base and agent at which it has ended
ROBOT_WAIT = 120.0  # [s] of wall time for an external robot to connect: it may compile first


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
        """Add one Tick."""
        assert tick.truth is not None
        pose = tick.truth.pose
        if self.last_pose is not None:
            self.path_length += float(np.hypot(*(pose[:2] - self.last_pose[:2])))
        self.last_pose = pose.copy()
        closing = sum(step.phase == Phase.CLOSING for step in tick.arm)
        self.closing_speed += [abs(float(tick.observation.twist[0]))] * closing
        self.period_ms.append(tick.stage_ms["period"])

    def meet(self, tick: Tick, footprint: Footprint) -> None:
        """Count encounters: an agent comes within `ENCOUNTER` of the base; beyond `PARTED` it can count again."""
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
    """Load and run a scene; returns the dictionary that `motm-twin run --json` prints."""
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

    ``parameters``: of `control.tuning`; they override the method's, which override ``numbers``.
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
        leg["reference_m"] = finite(float(tour[leg["index"]]), 4) if leg["index"] < len(tour) else 0.0
    return {**report(twin, tick, tally, seconds, float(tour.sum())), "measures": measured}


def _wait_for(robot: ExternalPlant) -> None:
    """Wait for an external robot; raises TimeoutError when none connects."""
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
        "min_base_clearance_m": finite(truth.min_base_clearance, 4),
        "min_arm_clearance_m": finite(truth.min_arm_clearance, 4),
        "min_ee_obstacle_m": finite(truth.min_ee_obstacle, 4),
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
    return objection(tick, completed, caused)


def objection(tick: Tick, completed: bool, caused: int) -> str:
    """Reason why ground truth contradicts a success that the robot believes in; "" for none.

    ``caused``: number of contacts caused by the robot.
    """
    if not completed:
        truth, places = tick.truth, _count(tick, "place")
        if truth is not None and truth.dropped:
            return f"dropped, and not picked up and placed again: {', '.join(truth.dropped)}"
        if truth is not None and truth.places == places:
            return "the referee sees nothing in the gripper, and the robot believes to hold an object"
        return f"the referee does not find in their bins what the robot believes to have placed{_astray(tick)}"
    if caused:
        return f"{caused} contact(s) caused by the robot"
    return ""


def _astray(tick: Tick) -> str:
    """': pin is not in tray' for each object that is not in the bin of its last place task."""
    assert tick.truth is not None
    bins: dict[str, str] = {}
    held = ""
    for task in tick.tasks:
        if task.status == "done" and task.kind in ("pick", "place"):
            if task.kind == "pick":
                held = task.target
            elif held:
                bins[held] = task.target
    states = {one.name: one.state for one in tick.truth.objects}
    wrong = [f"{name} is not in {place}" for name, place in bins.items() if states.get(name) != f"binned:{place}"]
    return f": {', '.join(wrong)}" if wrong else ""


def _count(tick: Tick, kind: str) -> int:
    """Number of tasks of a kind in the current task list."""
    return sum(task.kind == kind for task in tick.tasks)


class Track(NamedTuple):
    """Motion of the robot, one row per control period."""

    time: Array  # [s], shape (n,)
    pose: Array  # true pose of the base: x, y [m], heading [rad]; shape (n, 3)
    twist: Array  # of the base, as reported: [m/s], [rad/s]; shape (n, 2)
    joints: Array  # [rad], shape (n, 7)
    task: Array  # index in the task list, shape (n,)


class Result(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Outcome of one trial: `success`, `time_s`, `placed`, `contacts`, `plot()`, and more.

    ``report`` is the dictionary that `motm-twin run --json` prints, ``track`` the motion of the robot.
    """

    scene: Scene
    report: dict[str, Any]
    track: Track
    figure: Any = msgspec.field(default=None)  # data of `plot`

    @property
    def success(self) -> bool:
        """True if every task is done, no object lies where it was dropped, and the robot caused no contact."""
        return bool(self.report["success"])

    @property
    def reason(self) -> str:
        """Reason why the trial failed, in one sentence; "" if it succeeded."""
        return str(self.report["reason"])

    @property
    def time_s(self) -> float:
        """Simulated time of the trial [s]."""
        return float(self.report["time_s"])

    @property
    def placed(self) -> tuple[int, int]:
        """Number of objects in their bins, and number of objects that should be there."""
        return int(self.report["places_done"]), int(self.report["places_total"])

    @property
    def contacts(self) -> list[dict[str, Any]]:
        """Contacts that the referee detected, each with `caused_by_robot`."""
        return list(self.report["contacts"])

    @property
    def state_hash(self) -> str:
        """Hash of the final state, equal for equal scenes, seeds, commands and versions."""
        return str(self.report["state_hash"])

    def plot(self, file: str | Path | None = None) -> "Figure":
        """Draw speed along the path, and the time of each leg beside the reference tour; ``file``: also save it there.

        The suffix of ``file`` chooses the format: .png, .svg, .pdf.
        """
        return self.figure.draw(self.report, None if file is None else Path(file))

    def __repr__(self) -> str:
        """The trial in one line."""
        return f"<Result {self._headline()}>"

    def _headline(self) -> str:
        report, (done, total) = self.report, self.placed
        name = "/".join(part for part in (report["scene"], report["variant"]) if part)
        caused = report["contacts_caused_by_robot"]
        text = (
            f"{name} seed {report['seed']}, {report['method']}: {self.time_s:.2f} s, {done} of {total} placed, "
            f"{len(self.contacts)} contacts ({caused} caused by the robot)"
        )
        return text + ("" if self.success else f"; no success: {self.reason}")

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        rows = [
            (f"{leg['index'] + 1}", leg["task"], leg["target"], f"{leg['time_s']:.2f} s")
            for leg in self.report["measures"]["legs"]
            if leg["task"] != "done"
        ]
        head = "".join(f"<th>{name}</th>" for name in ("", "task", "target", "time"))
        body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
        return f"<p>{html.escape(self._headline())}</p><table><tr>{head}</tr>{body}</table>"


def run(
    scene: str | Path | Scene = "exp1", *, variant: str | None = None, seed: int | None = None,
    method: str | Method = "fast", parameters: Mapping[str, ParameterValue] | None = None,
    on_tick: Callable[[Tick], None] | None = None,
) -> Result:  # fmt: skip
    """Run a scene headless, as fast as the processor allows.

    Args:
        scene: Name of a shipped scene, path of a scene file, or a `Scene` from `load_scene`.
        variant: Named variant of the scene; None: its default. Not together with a `Scene`.
        seed: Seed of noise and random arrangements; None: the scene's. Not together with a `Scene`.
        method: Name of a method, ``FILE.py:NAME`` of your own, or a `Method`.
        parameters: Values by name, on top of the method's; docs/zenoh.md lists them.
        on_tick: Called with the Tick of every period.

    Raises:
        SceneError: The scene, variant or seed cannot be used.
        MethodError: There is no such method.
        ValueError: A parameter is unknown or out of range.
    """
    if isinstance(scene, Scene):
        if variant is not None or seed is not None:
            raise ValueError("a Scene has its variant and seed already: give them to load_scene instead")
        loaded = scene
    else:
        loaded = load_scene(str(scene), variant, seed)
    from motm_twin.studies.speed_plot import SpeedFigure  # loads matplotlib

    figure, rows = SpeedFigure(loaded), _Rows()

    def take(tick: Tick) -> None:
        rows.add(tick)
        figure.add(tick)
        if on_tick is not None:
            on_tick(tick)

    chosen = find_method(method) if isinstance(method, str) else method
    report = run_scene(loaded, on_tick=take, method=chosen, parameters=dict(parameters or {}))
    return Result(scene=loaded, report=report, track=rows.track(), figure=figure)


class _Rows:
    """Rows of the track, period by period."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, Array, Array, Array, int]] = []

    def add(self, tick: Tick) -> None:
        assert tick.truth is not None
        seen = tick.observation
        self.rows.append((tick.time, tick.truth.pose, seen.twist, seen.q, tick.task_index))

    def track(self) -> Track:
        return Track(*(np.array(column) for column in zip(*self.rows, strict=True)))
