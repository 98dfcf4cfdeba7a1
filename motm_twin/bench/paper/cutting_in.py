"""The tendency to cut in front of who moves (Paper, Sec. VIII-1), from a recorded episode."""

from typing import Any

import numpy as np
from matplotlib.patches import Polygon

from motm_twin.bench.measures.cut_ins import CUT_DISTANCE, CUT_TIME
from motm_twin.bench.paper import ground
from motm_twin.bench.paper.data import command_of
from motm_twin.bench.paper.episode import Episode, Moment
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.style import BLUE, ONE_COLUMN, ORANGE, figure, styled
from motm_twin.model.scene_file import load_scene

NAME, TITLE = "cutting_in", "Cutting in front of a moving obstacle"
BEFORE_S = 1.0  # [s] the moment shown is before the cut-in
PERIOD = 0.05  # [s]
HISTORY_S, HISTORY_STEP_S = 3.0, 0.75  # [s] of the Temi's way
PLAN_STEP = 3  # every third node of the plan
RADIUS = 0.25  # [m] of a Temi, for its outline only


def draw(episode: Episode) -> Part:
    """The closest cut-in of the episode, a second before it."""
    found = episode.measures["cut_ins"]
    if not found:
        return Missing(
            name=NAME,
            title=TITLE,
            larger=True,
            reason="in none of the completed trials of motm in Experiment 2 the robot cut in front of anybody; the one "
            f"that was recorded has seed {episode.spec.seed}",
        )
    cut = min(found, key=lambda each: each.get("least_gap_m", each["gap_m"]))
    crossing = round(cut["time"] / PERIOD)
    index = max(0, crossing - round(BEFORE_S / PERIOD))
    here = episode.moments[index]
    scene = load_scene(episode.spec.scene, episode.spec.variant, episode.spec.seed)
    with styled():
        fig = figure(ONE_COLUMN, 78.0)
        axes = fig.add_subplot()
        ground.setting(axes, scene)
        if here.target is not None:
            ground.cubes(axes, [here.target], "#C00000", 14.0)
        ground.path(axes, np.array(here.path), "#E3000F", width=1.2)
        for pose in here.plan[PLAN_STEP::PLAN_STEP]:
            ground.robot(axes, np.array(pose), scene.robot.footprint, alpha=0.25)
        ground.robot(axes, np.array(here.pose), scene.robot.footprint)
        for k, agent in enumerate(here.agents):
            chosen = agent[0] == cut["agent"]
            steps = range(round(HISTORY_S / HISTORY_STEP_S), 0, -1) if chosen else range(0)
            for step in steps:
                past = episode.moments[max(0, index - round(step * HISTORY_STEP_S / PERIOD))].agents[k]
                ground.temi(axes, past[1], past[2], RADIUS, colour=ORANGE, alpha=0.5 - 0.09 * step)
            ground.temi(axes, agent[1], agent[2], RADIUS, colour=ORANGE if chosen else "#DDDDDD")
        there = episode.moments[crossing]
        ground.robot(axes, np.array(there.pose), scene.robot.footprint, fill=False)
        axes.add_patch(_swept(episode, crossing, cut))
        axes.plot(there.pose[0], there.pose[1], "x", color="black", ms=7, mew=1.8, zorder=9)
        ground.metres(axes, *_window(here, there, cut["agent"]))
        axes.plot([], [], "o", mfc=ORANGE, mec="black", label="Temi (transparent: its last 3 s)")
        axes.plot([], [], "s", mfc=BLUE, mec="black", label="Frankie (transparent: its plan)")
        axes.plot([], [], "x", color="black", mew=1.8, ls="", label="Frankie 1 s later, when the cut-in begins")
        axes.plot([], [], "-", color=ORANGE, lw=1.0, label="what the Temi then sweeps before it would touch it")
        fig.legend(loc="outside lower center", ncols=1)
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            f"Experiment 2, seed {episode.spec.seed}, at {here.time:.2f} s. Nothing is predicted: the plan leads in "
            f"front of the Temi, which at {cut['time']:.2f} s would touch the robot within {cut['gap_m']:.2f} m and "
            f"{cut['gap_s']:.1f} s. A cut-in: by its own motion, not by the agent's turning, the base gets in front of "
            f"an agent that drives, within {CUT_DISTANCE:g} m and {CUT_TIME:g} s of being touched while they close. "
            f"This trial has {len(found)}; no completed one has more."
        ),
        command=command_of(episode.spec),
        n=f"one trial, {len(found)} cut-ins",
        rows=[
            {"time_s": each["time"], **{name: value for name, value in each.items() if name != "time"}}
            for each in found
        ],
        facts={
            "shown": {"time_s": here.time, "agent": cut["agent"]},
            "pose": here.pose,
            "plan": here.plan,
            "agents": here.agents,
        },
        figure=fig,
    )


def _swept(episode: Episode, crossing: int, cut: dict[str, Any]) -> Polygon:
    """The way of the Temi from where it is at the cut-in until it would touch the robot."""
    (at,), (then,) = (
        [np.array(each[1:3]) for each in episode.moments[index].agents if each[0] == cut["agent"]]
        for index in (crossing, crossing + 1)
    )
    along = (then - at) / np.hypot(*(then - at))
    side, end = RADIUS * np.array([-along[1], along[0]]), (RADIUS + cut["gap_m"]) * along
    corners = [at + side, at + end + side, at + end - side, at - side]
    return Polygon(corners, facecolor="none", edgecolor=ORANGE, lw=1.0, ls="-", zorder=8)


def _window(here: Moment, crossing: Moment, agent: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """A square round robot, Temi and crossing."""
    points = [here.pose[:2], crossing.pose[:2], *(each[1:3] for each in here.agents if each[0] == agent)]
    if here.target is not None:
        points.append(here.target)
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    half = max(1.5, 0.5 * float((high - low).max()) + 0.8)
    x, y = 0.5 * (low + high)
    return (x - half, x + half), (y - half, y + half)
