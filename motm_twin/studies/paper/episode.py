"""One trial of Experiment 2 in detail: gripper distance (Sec. V), cutting in (Sec. VIII-1), photographs of the page.

For the photographs a served twin is stepped to four moments of the trial.
"""

import io
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke
from PIL import Image

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import STEPS, Pause, Reset, Step
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.targets import world_in_odometry
from motm_twin.control.tick import TaskState, Tick
from motm_twin.measures import Measures
from motm_twin.measures.agents import CUT_DISTANCE, CUT_TIME, base_gap, body_of
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.kinematics import Frankie
from motm_twin.model.plant import PERIOD, Truth
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.perf.page_reader import browser
from motm_twin.perf.processes import act, now, served, wait_for
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies.paper import drawing
from motm_twin.studies.paper.data import command_of
from motm_twin.studies.paper.drawing import Drawn, Missing, Part
from motm_twin.studies.spec import TrialSpec, job_of, method_of
from motm_twin.ui.scene.cameras import FIELD_OF_VIEW, overview

DIGITS = 4


class Moment(msgspec.Struct, frozen=True):
    """One period of an episode. World frame, metres, radians, seconds."""

    time: float
    pose: tuple[float, float, float]
    task: str  # kind and name of the active task
    phase: str  # of the arm
    distance: float | None  # from the gripper's centre to the nearest seen obstacle; None: no obstacle is seen
    static: bool  # that obstacle counts as static, not as dynamic
    agents: tuple[tuple[str, float, float, float], ...]  # ground truth: name, x, y, yaw
    plan: tuple[tuple[float, float, float], ...]  # the local plan
    path: tuple[tuple[float, float], ...]  # the global path
    goal: tuple[float, float]  # of the base
    target: tuple[float, float] | None  # true position of the object or bin of the active task


class Episode(msgspec.Struct, frozen=True):
    """A whole trial."""

    spec: TrialSpec
    source: str
    moments: tuple[Moment, ...]
    result: dict[str, Any]
    measures: dict[str, Any]  # report of `Measures`: stretches below d_s, cut-ins, and others


class Watcher:
    """Collects moments from Ticks."""

    def __init__(self, scene: Scene) -> None:
        self.moments: list[Moment] = []
        self._frankie = Frankie(scene.robot)
        self._bins = {item.name: item.centre for item in scene.bins}

    def __call__(self, tick: Tick) -> None:
        """Append the moment of a Tick."""
        assert tick.truth is not None
        distance, static = self._nearest(tick)
        active = tick.tasks[tick.task_index] if tick.task_index < len(tick.tasks) else None
        self.moments.append(
            Moment(
                time=round(tick.time, DIGITS), pose=_rounded(tick.truth.pose),
                task=f"{active.kind} {active.target}" if active else "", phase=tick.arm[-1].phase, distance=distance,
                static=static,
                agents=tuple((each.name, *_rounded((*each.position[:2], each.yaw))) for each in tick.truth.agents),
                plan=tuple(_rounded(pose[:3]) for pose in tick.plan.local_poses),
                path=tuple(_rounded(point) for point in tick.plan.global_path), goal=_rounded(tick.placement.goal[:2]),
                target=self._target(tick.truth, active),
            )
        )  # fmt: skip

    def _nearest(self, tick: Tick) -> tuple[float | None, bool]:
        """Horizontal distance from the gripper to the nearest seen obstacle, and True when that is static."""
        if not len(tick.map.seen_points):
            return None, False
        points = from_frame(world_in_odometry(tick.observation), tick.map.seen_points)
        hand = self._frankie.tcp_pose(tick.observation.odometry, tick.observation.q)[0][:2]
        distance = np.hypot(*(points - hand).T)
        nearest = int(np.argmin(distance))
        return round(float(distance[nearest]), DIGITS), bool(tick.map.seen_static[nearest])

    def _target(self, truth: Truth, task: TaskState | None) -> tuple[float, float] | None:
        if task is not None and task.kind == "place":
            return self._bins.get(task.target)
        found = [each.position[:2] for each in truth.objects if task is not None and each.name == task.target]
        return _rounded(found[0]) if found else None


def watch_trial(spec: TrialSpec, folder: Path, source: str) -> Episode:
    """The episode of a trial: stored by ``source``, or else by the current source, or else run now and stored.

    ``source``: of the trial. An episode of the current source may differ from the trial when the sources differ.
    """
    from motm_twin.trial import run_scene  # imports the whole twin: only when a trial is run

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
    drawing.write_json(partial, msgspec.to_builtins(episode))
    partial.replace(file)  # no reader ever finds half a file
    return episode


def _rounded(values: Any) -> Any:
    return tuple(round(float(value), DIGITS) for value in values)


SHOWN = 2.0  # [m] upper end of the distance axis
DEEP_RED = "#C1121F"  # red as in the paper's figure; `drawing.RED` looks like orange beside `drawing.ORANGE`
JUMP = 0.10  # [m] a larger change of the distance in one period means that another obstacle is the nearest


def draw_distance(episode: Episode) -> Drawn:
    """The distance over time, without a line while no obstacle is seen."""
    p = AvoidanceParameters()
    distance = np.array([math.nan if each.distance is None else each.distance for each in episode.moments])
    close = episode.measures["below_d_s"]
    seen = int(np.isfinite(distance).sum())
    excess = ("approach_excess_mps", "advance_excess_mps")
    return Drawn(
        caption=(
            f"Experiment 2 with four Temis, seed {episode.spec.seed}. As the robot itself sees it: horizontally, from "
            "the gripper's centre to the cells that the lidar found outside the map. "
            f"{_gaps(distance)} Triangles: stretches in which the referee's true distance is below d_s ({len(close)}), "
            "with their causes in the table."
        ),
        command=command_of(episode.spec),
        n=f"one trial, {len(episode.moments)} periods, in {seen} of them an obstacle is seen",
        rows=[
            {"time_s": each.time, "distance_m": each.distance, "static": each.static, "task": each.task,
             "phase": each.phase}
            for each in episode.moments
        ],
        facts={
            "d_s": p.d_s, "d_i": p.d_i, "xi": p.xi, "stretches_below_d_s": close,
            **{name: episode.measures[name] for name in excess},
        },
        cells=[_stretch(each) for each in close],
        figure=_distance_figure(episode, distance, p),
        notes=[_line(episode)],
    )  # fmt: skip


def _distance_figure(episode: Episode, distance: Array, p: AvoidanceParameters) -> Figure:
    """The distance as a line, broken at jumps, over the two regions of Sec. V."""
    time = np.array([each.time for each in episode.moments])
    jumps = np.flatnonzero(np.abs(np.diff(distance)) > JUMP) + 1
    below, influence = f"below $d_s$ = {p.d_s} m", f"region of influence, below $d_i$ = {p.d_i} m"
    with drawing.styled():
        fig = drawing.figure(drawing.TWO_COLUMNS, 56.0)
        axes = fig.add_subplot()
        axes.axhspan(0.0, p.d_s, facecolor=DEEP_RED, alpha=0.8, hatch="////", edgecolor="white", lw=0.0, label=below)
        axes.axhspan(p.d_s, p.d_i, facecolor=drawing.ORANGE, alpha=0.35, lw=0.0, label=influence)
        shown, effects = np.insert(distance, jumps, math.nan), [Stroke(linewidth=2.6, foreground="white"), Normal()]
        axes.plot(  # its white edge separates it from the red, also in greyscale
            np.insert(time, jumps, time[jumps]), shown, "-", color=drawing.BLUE, lw=1.1, label="distance",
            path_effects=effects,
        )  # fmt: skip
        for stretch in episode.measures["below_d_s"]:
            at = stretch["time"] + 0.5 * stretch["duration_s"]
            axes.plot(at, 0.03, "^", mfc=drawing.BLACK, mec="white", mew=0.6, ms=5, clip_on=False, zorder=3)
        axes.set_xlim(0.0, float(time[-1]))
        axes.set_ylim(0.0, SHOWN)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("distance [m]")
        fig.legend(loc="outside upper center", ncols=3)
    return fig


def _stretch(each: dict[str, Any]) -> dict[str, str]:
    """A stretch below d_s as a row of the table."""
    return {
        "From [s]": f"{each['time']:.2f}",
        "For [s]": f"{each['duration_s']:.2f}",
        "Least distance [m]": f"{each['min_m']:.2f}",
        "To": each["other"],
        "Gripper moved there [m]": f"{each['gripper_moved_m']:.2f}",
        "It moved here [m]": f"{each['other_moved_m']:.2f}",
        "Cause": each["cause"] + (", beside what stands: its d_s gives way" if each["static"] else ""),
    }


def _gaps(distance: Array) -> str:
    """The caption's explanation of gaps in the line."""
    above, none = float(np.mean(distance > SHOWN)), float(np.mean(np.isnan(distance)))
    note = f"Distances above {SHOWN:g} m are cut off ({100 * above:.0f} % of the time)"
    note += f", and where no obstacle is seen there is no line ({100 * none:.0f} %)" if none else ""
    return note + f"; the line is broken where it jumps by more than {JUMP} m, because another one comes into view."


def _line(episode: Episode) -> str:
    """A sentence on the largest excesses over the damper line."""
    most, forward = episode.measures["approach_excess_mps"], episode.measures["advance_excess_mps"]
    if most is None:
        return "The gripper was never below d_i of anything that moves."
    return (
        f"Below d_i of what moves, the gripper's own true approach speed (over 50 ms) was at most {most:.3f} m/s above "
        f"the damper line, and at most {forward:.3f} m/s above it or above 0 where it asks to retreat."
    )


BEFORE_S = 1.0  # [s] from the moment shown to the cut-in
HISTORY_S, HISTORY_STEP_S = 3.0, 0.75  # [s] of the Temi's past positions, and between two of them
PLAN_STEP = 3  # every third node of the plan is drawn
RADIUS = 0.25  # [m] of a Temi, only for drawing and gaps


def draw_cutting_in(before: Episode, after: Episode) -> Part:
    """One second before the closest cut-in of a trial, and the same Temi and task with a method that predicts."""
    found = before.measures["cut_ins"]
    if not found:
        return Missing(
            larger=True,
            reason="in none of the completed trials of motm in Experiment 2 the robot cut in front of anybody; the one "
            f"that was recorded has seed {before.spec.seed}",
        )
    cut = min(found, key=lambda each: each.get("least_gap_m", each["gap_m"]))
    crossing = round(cut["time"] / PERIOD)
    meeting, gap = _meeting(after, cut["agent"], before.moments[crossing].task)
    here, there = (before.moments[_earlier(crossing)], after.moments[_earlier(meeting)])
    cuts, later = len(found), len(after.measures["cut_ins"])
    return Drawn(
        caption=(
            f"Experiment 2, seed {before.spec.seed}. Left: {before.spec.method} at {here.time:.2f} s. Nothing is "
            f"predicted: the plan leads in front of the Temi, which at {cut['time']:.2f} s would touch the robot in "
            f"{cut['gap_m']:.2f} m and {cut['gap_s']:.1f} s. Right: {after.spec.method}, which predicts, on the same "
            f"task at {there.time:.2f} s, a second before it is nearest to the same Temi, {gap:.2f} m from outline to "
            "outline. A cut-in: by its own motion, not by the agent's turning, the base gets in front of "
            f"an agent that drives, within {CUT_DISTANCE:g} m and {CUT_TIME:g} s of being touched while they close. "
            f"The left trial has {cuts}; no completed one of this method has more. The right one has {later}."
        ),
        command=f"{command_of(before.spec)}; {command_of(after.spec)}",
        n=f"two trials, {cuts} and {later} cut-ins",
        rows=[
            {"method": each.spec.method, "time_s": one["time"], **{k: v for k, v in one.items() if k != "time"}}
            for each in (before, after)
            for one in each.measures["cut_ins"]
        ],
        facts={
            "shown": {"time_s": here.time, "agent": cut["agent"]},
            "pose": here.pose,
            "plan": here.plan,
            "agents": here.agents,
            "after": {"time_s": there.time, "gap_m": gap, "pose": there.pose, "plan": there.plan},
        },
        figure=_cutting_in_figure(before, after, cut, crossing, meeting),
    )


def _earlier(index: int) -> int:
    """Index of the period `BEFORE_S` before this one, at least 0."""
    return max(0, index - round(BEFORE_S / PERIOD))


def _meeting(episode: Episode, agent: str, task: str) -> tuple[int, float]:
    """Index of the period of a task in which the base is nearest to an agent, and the gap [m] of the outlines then."""
    scene = load_scene(episode.spec.scene, episode.spec.variant, episode.spec.seed)
    body = body_of(scene.robot.footprint)
    gaps = np.full(len(episode.moments), math.inf)
    for index, moment in enumerate(episode.moments):
        if moment.task == task:
            ((x, y),) = (each[1:3] for each in moment.agents if each[0] == agent)
            gaps[index] = base_gap(body, moment.pose, x, y, RADIUS)
    return int(np.argmin(gaps)), float(gaps.min())


def _cutting_in_figure(before: Episode, after: Episode, cut: dict[str, Any], crossing: int, meeting: int) -> Figure:
    """Robot, plan and Temi one second before the cut-in, and one second before the same meeting with prediction."""
    pairs = [(each, _earlier(index), index) for each, index in ((before, crossing), (after, meeting))]
    x, y = _window([each.moments[index] for each, *periods in pairs for index in periods], cut["agent"])
    with drawing.styled():
        fig = drawing.figure(drawing.TWO_COLUMNS, 100.0)
        panels = fig.subplots(1, 2, sharey=True)
        for axes, (each, index, then) in zip(panels, pairs, strict=True):
            _meet(axes, each, cut["agent"], index, then)
            drawing.metres(axes, x, y)
            axes.set_title(f"{each.spec.method}, {each.moments[index].time:.2f} s", loc="left")
        panels[0].add_patch(_swept(before, crossing, cut))
        panels[1].set_ylabel("")
        panels[0].plot([], [], "o", mfc=drawing.ORANGE, mec="black", label="Temi (transparent: its last 3 s)")
        panels[0].plot([], [], "s", mfc=drawing.BLUE, mec="black", label="Frankie (transparent: its plan)")
        panels[0].plot([], [], "x", color="black", mew=1.8, ls="", label="Frankie 1 s later: the cut-in, the meeting")
        panels[0].plot(
            [], [], "-", color=drawing.ORANGE, lw=1.0, label="what the Temi then sweeps before it touches it"
        )
        fig.legend(loc="outside lower center", ncols=2)
    return fig


def _meet(axes: Axes, episode: Episode, agent: str, index: int, then: int) -> None:
    """Draw an episode in period ``index``: plan, robot, the agent's past; the robot's outline in period ``then``."""
    here, there = episode.moments[index], episode.moments[then]
    scene = load_scene(episode.spec.scene, episode.spec.variant, episode.spec.seed)
    drawing.setting(axes, scene)
    if here.target is not None:
        drawing.cubes(axes, [here.target], "#C00000", 14.0)
    drawing.path(axes, np.array(here.path), "#E3000F", width=1.2)
    for pose in here.plan[PLAN_STEP::PLAN_STEP]:
        drawing.robot(axes, np.array(pose), scene.robot.footprint, alpha=0.25)
    drawing.robot(axes, np.array(here.pose), scene.robot.footprint)
    for k, each in enumerate(here.agents):
        chosen = each[0] == agent
        for step in range(round(HISTORY_S / HISTORY_STEP_S), 0, -1) if chosen else ():
            past = episode.moments[max(0, index - round(step * HISTORY_STEP_S / PERIOD))].agents[k]
            drawing.temi(axes, past[1], past[2], RADIUS, colour=drawing.ORANGE, alpha=0.5 - 0.09 * step)
        drawing.temi(axes, each[1], each[2], RADIUS, colour=drawing.ORANGE if chosen else "#DDDDDD")
    drawing.robot(axes, np.array(there.pose), scene.robot.footprint, fill=False)
    axes.plot(there.pose[0], there.pose[1], "x", color="black", ms=7, mew=1.8, zorder=9)


def _swept(episode: Episode, crossing: int, cut: dict[str, Any]) -> Polygon:
    """The area that the Temi sweeps from its position at the cut-in until it would touch the robot."""
    (at,), (then,) = (
        [np.array(each[1:3]) for each in episode.moments[index].agents if each[0] == cut["agent"]]
        for index in (crossing, crossing + 1)
    )
    along = (then - at) / np.hypot(*(then - at))
    side, end = RADIUS * np.array([-along[1], along[0]]), (RADIUS + cut["gap_m"]) * along
    corners = [at + side, at + end + side, at + end - side, at - side]
    return Polygon(corners, facecolor="none", edgecolor=drawing.ORANGE, lw=1.0, ls="-", zorder=8)


def _window(moments: list[Moment], agent: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """x and y ranges of a square around robot, agent and target in these moments."""
    points = [point for each in moments for point in (each.pose[:2], each.target) if point is not None]
    points += [each[1:3] for moment in moments for each in moment.agents if each[0] == agent]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    half = max(1.5, 0.5 * float((high - low).max()) + 0.8)
    x, y = 0.5 * (low + high)
    return (x - half, x + half), (y - half, y + half)


SHOTS_BEFORE_S = (3.0, 1.0, 0.0, -2.0)  # [s] of the photographs before the moment at which the gripper is nearest
PAGE_SIZE = (1920, 1200)  # [px] of the page
PICTURE_SIZE = (800, 600)  # [px] of each picture, around the robot's positions
ONLY_SCENE = "* { visibility: hidden !important } canvas { visibility: visible !important }"  # no panel, no notes
MIDDLE = 0.6  # [m] half of the robot's height
SETTLED_MS = 4000  # [ms] until the page shows everything of a paused twin
ANSWER = 600.0  # [s] to compute some minutes of the run on a busy machine


def photographed(episode: Episode) -> list[int]:
    """Periods to photograph: around the one in which the carrying gripper is nearest to a dynamic obstacle."""
    near = [_nearness(each) for each in episode.moments]
    middle = int(np.argmin(near))
    last = len(episode.moments) - 1
    return sorted({min(last, max(1, middle - round(before / PERIOD))) for before in SHOTS_BEFORE_S})


def _nearness(moment: Moment) -> float:
    if moment.distance is None or moment.static or not moment.task.startswith("place"):
        return np.inf
    return moment.distance


def draw_snapshots(episode: Episode) -> Part:
    """Four photographs in a figure, or the reason why there are none."""
    if not np.isfinite(min(_nearness(each) for each in episode.moments)):
        reason = f"in the example trial (seed {episode.spec.seed}) no Temi came near the gripper with an object in it"
        return Missing(reason=reason, larger=True)
    if episode.source != made_with()[SOURCE]:
        return Missing(reason=f"the trial is of another source ({episode.source}), which this page cannot serve")
    chosen = photographed(episode)
    try:
        pictures = _photographs(episode, chosen)
    except (RuntimeError, TimeoutError, OSError) as error:
        return Missing(reason=f"the page could not be photographed: {error}")
    with drawing.styled():
        fig = drawing.figure(drawing.TWO_COLUMNS, 5.0 + drawing.TWO_COLUMNS * PICTURE_SIZE[1] / PICTURE_SIZE[0])
        axes = fig.subplots(2, 2).flat
        for panel, picture, index, letter in zip(axes, pictures, chosen, "abcd", strict=False):
            panel.imshow(picture)
            panel.set_axis_off()
            panel.set_title(f"({letter}) {episode.moments[index].time:.2f} s", loc="left", pad=2.0)
    return Drawn(
        caption=(
            f"Experiment 2, seed {episode.spec.seed}, on the served page in Chromium: grid, candidates, paths and "
            "the local plan as fading robots; panel and notes are hidden. The twin was stepped to these moments; "
            "nothing is posed."
        ),
        command=command_of(episode.spec, "serve") + " --expansions-only",
        n="one trial",
        rows=[
            {"time_s": each.time, "distance_m": each.distance, "task": each.task}
            for each in (episode.moments[k] for k in chosen)
        ],
        figure=fig,
    )


def _photographs(episode: Episode, chosen: list[int]) -> list[Any]:
    """Pictures of the scene at these periods."""
    spec = episode.spec
    options = ("--variant", str(spec.variant), "--seed", str(spec.seed), "--method", spec.method)
    with browser() as page, served(spec.scene, *options, "--expansions-only") as twin:
        _rewind(twin.client)
        _step_to(twin.client, min(chosen))  # before the page is opened, which needs processor time, too
        page.page.set_viewport_size({"width": PAGE_SIZE[0], "height": PAGE_SIZE[1]})
        page.load(twin.url)
        page.page.add_style_tag(content=ONLY_SCENE)
        box = page.page.locator("canvas").first.bounding_box()
        left, top = _corner(twin.client, box, [episode.moments[index] for index in chosen])
        pictures = []
        for index in chosen:
            _step_to(twin.client, index)
            page.page.mouse.move(2, 2)
            page.page.wait_for_timeout(SETTLED_MS)
            shot = page.page.screenshot(timeout=60_000)
            whole = Image.open(io.BytesIO(shot)).convert("RGB")
            pictures.append(np.asarray(whole.crop((left, top, left + PICTURE_SIZE[0], top + PICTURE_SIZE[1]))))
        return pictures


def _corner(client: TwinClient, box: Any, shown: list[Moment]) -> tuple[int, int]:
    """Left and top [px] of a picture centred on the robot's mean position in these moments, in the page's overview.

    ``box``: position and size [px] of the scene on the page.
    """
    wide, high = box["width"], box["height"]
    scene = client.scene()
    assert scene is not None  # the page has drawn it
    eye, look_at = overview(scene, wide / high, below=0.0)
    forward = (look_at - eye) / np.linalg.norm(look_at - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    x, y = np.mean([each.pose[:2] for each in shown], axis=0)
    ray = np.array([x, y, MIDDLE]) - eye
    focal = 0.5 * high / np.tan(FIELD_OF_VIEW / 2)
    across = 0.5 * wide + focal * (ray @ right) / (ray @ forward)
    down = 0.5 * high - focal * (ray @ np.cross(right, forward)) / (ray @ forward)
    left, top = (
        np.clip(middle - 0.5 * cut, 0, size - cut)
        for middle, cut, size in zip((across, down), PICTURE_SIZE, (wide, high), strict=True)
    )
    return round(box["x"] + float(left)), round(box["y"] + float(top))


def _rewind(client: TwinClient) -> None:
    """Pause the run and reset it to its start."""
    wait_for(lambda: client.command(Pause()).ok, ANSWER, "wheel")
    act(client, Reset())
    wait_for(lambda: now(client).index == 0, ANSWER, "start")


def _step_to(client: TwinClient, index: int) -> None:
    """Step the paused twin to this period."""
    here = now(client).index
    while here < index:
        steps = min(index - here, int(STEPS.high))
        here += steps
        act(client, Step(count=steps))
        wait_for(lambda here=here: now(client).index == here, ANSWER, f"period {here}")
