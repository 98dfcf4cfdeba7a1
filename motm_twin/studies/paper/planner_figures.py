"""Figures of the planner: Bezier path (Sec. III-E), global path with cost of rotation (Sec. III-B)."""

import math
from itertools import pairwise

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.profile import DEG, Footprint
from motm_twin.planning.bezier import bezier_curve, curve_length, curve_time
from motm_twin.planning.global_path import GraphCache, goal_table, path_to_goal, rates_of, shortest_path
from motm_twin.planning.parameters import StaaParameters, growth
from motm_twin.planning.rtr import path_rtr, turn
from motm_twin.studies.paper import ground
from motm_twin.studies.paper.ground import FirstPeriod, first_period
from motm_twin.studies.paper.part import Drawn
from motm_twin.studies.paper.style import BLACK, BLUE, GREY, ONE_COLUMN, RED, figure, styled

BEZIER_START = np.array([0.0, 0.0, -30.0 * DEG])  # the poses of the paper's figure: Rotate 30 deg,
BEZIER_GOAL = np.array([4.0, 0.0, 90.0 * DEG])  # Translate 4 m, Rotate 90 deg
SPEED, TURN = 0.5, 100.0 * DEG  # [m/s], [rad/s] of the paper's figure
SAMPLES = 400  # of the curve that is measured; the search uses 16
PUBLISHED = {"distance_m": 4.0, "bezier_length_m": 4.35, "bezier_time_s": 8.7, "path_rtr_s": 9.2}


def numbers() -> dict[str, float]:
    """Lengths [m] and times [s] of the two ways between the poses."""
    offset = StaaParameters().bezier_offset
    curve = bezier_curve(BEZIER_START, BEZIER_GOAL, offset=offset, samples=SAMPLES)
    straight = np.array([BEZIER_START[:2], BEZIER_GOAL[:2]])
    return {
        "distance_m": float(math.dist(BEZIER_START[:2], BEZIER_GOAL[:2])),
        "bezier_length_m": float(curve_length(curve)),
        "bezier_time_s": float(curve_time(curve, BEZIER_START[2], BEZIER_GOAL[2], SPEED, TURN)),
        "path_rtr_s": path_rtr(straight, BEZIER_START[2], BEZIER_GOAL[2], v_f=SPEED, v_r=0.5 * SPEED, w_max=TURN),
        "offset": offset,
    }


def draw_bezier() -> Drawn:
    """Both ways from pose to pose, and what they take."""
    found = numbers()
    curve = bezier_curve(BEZIER_START, BEZIER_GOAL, offset=found["offset"], samples=SAMPLES)
    reach = found["offset"] * found["distance_m"]
    first = BEZIER_START[:2] + reach * np.array([math.cos(BEZIER_START[2]), math.sin(BEZIER_START[2])])
    second = BEZIER_GOAL[:2] - reach * np.array([math.cos(BEZIER_GOAL[2]), math.sin(BEZIER_GOAL[2])])
    with styled():
        fig = figure(ONE_COLUMN, 41.0)
        axes = fig.add_subplot()
        axes.plot([0, 4], [0, 0], "--", color=RED, lw=1.6, zorder=3)
        axes.plot(curve[:, 0], curve[:, 1], "-", color=BLUE, lw=2.0, zorder=4)
        for pose, point in ((BEZIER_START, first), (BEZIER_GOAL, second)):
            axes.plot(*zip(pose[:2], point, strict=True), ":", color=GREY, lw=1.0)
            axes.plot(*point, "D", color="white", mec=GREY, ms=4.5, zorder=6)
            ground.robot(axes, pose, Footprint(), colour="#BBD7EA")
        rtr = f"PathRTR: 30°, {found['distance_m']:.0f} m, 90°: {found['path_rtr_s']:.1f} s"
        bezier = f"Bézier: {found['bezier_length_m']:.2f} m, {found['bezier_time_s']:.1f} s"
        axes.text(2.0, 0.1, rtr, color=RED, ha="center", fontsize=7.5)
        axes.text(2.1, -0.86, bezier, color=BLUE, ha="center", va="top", fontsize=7.5)
        ground.metres(axes, (-0.55, 4.55), (-1.25, 0.55))
    rows = [{"quantity": name, "here": round(found[name], 4), "published": value} for name, value in PUBLISHED.items()]
    return Drawn(
        name="bezier",
        title="Bézier path and PathRTR between the same two poses",
        caption=(
            f"The poses of the paper's figure at {SPEED} m/s and 100°/s. Diamonds: the control points, at "
            f"{100 * found['offset']:.0f} % of the distance in front of the start and behind the goal."
        ),
        n="no trial: computed by the planner's own functions",
        rows=rows,
        facts={**found, "curve": curve},
        figure=fig,
    )


PATH_START = np.array([4.05, 0.75, 10.0 * DEG])  # in front of the table, the heading away from the nearer end
PATH_GOAL = np.array([4.2, 2.70, 180.0 * DEG])  # behind it: the base pose of a grasp from its far edge
PATH_RED, PATH_YELLOW = "#E3000F", "#FFE600"


def paths(here: FirstPeriod) -> dict[str, Array]:
    """Both global paths, shape (m, 2) [m]: with the cost of rotation, and the shortest."""
    limits = here.scene.robot.base
    graph = GraphCache().graph(here.world, growth(here.scene.robot.footprint, StaaParameters()))
    with_rotation = path_to_goal(graph, goal_table(graph, PATH_GOAL, rates_of(limits)), PATH_START)[0]
    return {"with rotation cost": with_rotation, "without (STAA*)": shortest_path(graph, PATH_START, PATH_GOAL, limits)}


def measured(path: Array, here: FirstPeriod) -> dict[str, float]:
    """Length [m], turning [deg] and PathRTR [s] of a path from start to goal pose, driven forwards."""
    limits = here.scene.robot.base
    steps = np.diff(path, axis=0)
    headings = [float(PATH_START[2]), *(math.atan2(dy, dx) for dx, dy in steps), float(PATH_GOAL[2])]
    turning = sum(turn(before, after) for before, after in pairwise(headings))
    time = path_rtr(
        path, PATH_START[2], PATH_GOAL[2], v_f=limits.forward_speed, v_r=limits.reverse_speed, w_max=limits.yaw_rate
    )
    return {
        "length_m": float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
        "turning_deg": math.degrees(turning),
        "path_rtr_s": time,
    }


def _sentence(text: str) -> str:
    """The same at the beginning of a sentence; STAA* stays as it is written."""
    return text[:1].upper() + text[1:]


def draw_global_path() -> Drawn:
    """Both paths between the same poses round the table of Experiment 1."""
    here = first_period("exp1", "trial1")
    found = paths(here)
    looks = {
        "with rotation cost": (PATH_RED, "-", 2.4, "white"),
        "without (STAA*)": (PATH_YELLOW, (0, (4, 2)), 2.2, BLACK),
    }
    with styled():
        fig = figure(ONE_COLUMN, 66.0)
        axes = fig.add_subplot()
        grid = ground.occupancy(axes, here.world)
        for name, (colour, line, width, casing) in looks.items():
            ground.path(axes, found[name], colour, style=line, width=width, casing=casing, label=name)
        ground.robot(axes, PATH_START, here.scene.robot.footprint, colour="white")
        ground.robot(axes, PATH_GOAL, here.scene.robot.footprint, colour="white", alpha=0.75)
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
        facts={"start": PATH_START, "goal": PATH_GOAL, "paths": found},
        figure=fig,
    )
