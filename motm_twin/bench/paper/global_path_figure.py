"""Global path with and without the cost of rotation (Paper, Sec. III-B): red and yellow on the occupancy colours."""

import math
from itertools import pairwise

import numpy as np

from motm_twin.bench.paper import ground
from motm_twin.bench.paper.part import Drawn
from motm_twin.bench.paper.standing import Standing, standing
from motm_twin.bench.paper.style import BLACK, ONE_COLUMN, figure, styled
from motm_twin.model.geometry import Array
from motm_twin.planning.global_path import GraphCache, goal_table, path_to_goal, rates_of, shortest_path
from motm_twin.planning.parameters import DEG, StaaParameters, growth
from motm_twin.planning.rtr import path_rtr, turn

START = np.array([4.05, 0.75, 10.0 * DEG])  # in front of the table, the heading away from the nearer end
GOAL = np.array([4.2, 2.70, 180.0 * DEG])  # behind it: the base pose of a grasp from its far edge
RED, YELLOW = "#E3000F", "#FFE600"


def paths(here: Standing) -> dict[str, Array]:
    """Both global paths, shape (m, 2) [m]: with the cost of rotation, and the shortest."""
    limits = here.scene.robot.base
    graph = GraphCache().graph(here.world, growth(here.scene.robot.footprint, StaaParameters()))
    with_rotation = path_to_goal(graph, goal_table(graph, GOAL, rates_of(limits)), START)[0]
    return {"with rotation cost": with_rotation, "without (STAA*)": shortest_path(graph, START, GOAL, limits)}


def measured(path: Array, here: Standing) -> dict[str, float]:
    """Length [m], turning [deg] and PathRTR [s] of a path from start to goal pose, driven forwards."""
    limits = here.scene.robot.base
    steps = np.diff(path, axis=0)
    headings = [float(START[2]), *(math.atan2(dy, dx) for dx, dy in steps), float(GOAL[2])]
    turning = sum(turn(before, after) for before, after in pairwise(headings))
    time = path_rtr(path, START[2], GOAL[2], v_f=limits.forward_speed, v_r=limits.reverse_speed, w_max=limits.yaw_rate)
    return {
        "length_m": float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
        "turning_deg": math.degrees(turning),
        "path_rtr_s": time,
    }


def _sentence(text: str) -> str:
    """The same at the beginning of a sentence; STAA* stays as it is written."""
    return text[:1].upper() + text[1:]


def draw() -> Drawn:
    """Both paths between the same poses round the table of Experiment 1."""
    here = standing("exp1", "trial1")
    found = paths(here)
    looks = {"with rotation cost": (RED, "-", 2.4, "white"), "without (STAA*)": (YELLOW, (0, (4, 2)), 2.2, BLACK)}
    with styled():
        fig = figure(ONE_COLUMN, 66.0)
        axes = fig.add_subplot()
        grid = ground.occupancy(axes, here.world)
        for name, (colour, line, width, casing) in looks.items():
            ground.path(axes, found[name], colour, style=line, width=width, casing=casing, label=name)
        ground.robot(axes, START, here.scene.robot.footprint, colour="white")
        ground.robot(axes, GOAL, here.scene.robot.footprint, colour="white", alpha=0.75)
        axes.text(4.6, 0.3, "start", fontsize=7, zorder=9)
        axes.text(4.05, 3.15, "goal", fontsize=7, zorder=9)
        ground.metres(axes, (2.0, 6.4), (0.0, 3.55))
        bar = fig.colorbar(grid, ax=axes, shrink=0.75, ticks=[0.0, 0.5, 1.0])
        bar.ax.set_yticklabels(["free", "0.5", "occupied"])
        fig.legend(loc="outside upper center", ncols=2)
    rows = [{"path": name, **measured(path, here)} for name, path in found.items()]
    return Drawn(
        name="global_path",
        title="Global path with and without the cost of rotation",
        caption=(
            "Red, solid: the cheapest path by PathRTR. Yellow, dashed: the shortest one, as unmodified STAA* has it. "
            "The colour of the ground is the proximity grid at STAA*'s own inflation of 0.6 m. "
            + " ".join(
                f"{_sentence(row['path'])}: {row['length_m']:.2f} m, {row['turning_deg']:.0f}° of turning, "
                f"PathRTR {row['path_rtr_s']:.1f} s."
                for row in rows
            )
        ),
        n="no trial: the planner's own search on the map of exp1/trial1",
        rows=rows,
        facts={"start": START, "goal": GOAL, "paths": found},
        figure=fig,
    )
