"""Figures of planning: experiment layouts, base placement (Sec. IV), Bezier path (III-E), rotation cost (III-B)."""

import functools
import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from motm_twin.methods.registry import MOTM
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld, known_world
from motm_twin.model.profile import DEG, Footprint
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_document, load_scene
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.bezier import bezier_curve, curve_length, curve_time
from motm_twin.planning.global_path import GraphCache, goal_table, path_to_goal, rates_of, shortest_path
from motm_twin.planning.parameters import PlanningParameters, StaaParameters, growth
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.rtr import path_rtr, turn
from motm_twin.planning.types import BaseProblem, Placement, Target
from motm_twin.studies.paper import drawing
from motm_twin.studies.paper.drawing import (
    BLACK,
    BLUE,
    COST,
    GREY,
    ONE_COLUMN,
    RED,
    TWO_COLUMNS,
    Drawn,
    figure,
    styled,
)
from motm_twin.twin import Twin

ABOVE = (0.0, 0.08, "center", "bottom")  # a slot's name: offset [m] and alignment
RIGHT, LEFT = (0.1, 0.02, "left", "center_baseline"), (-0.1, 0.02, "right", "center_baseline")
BESIDE = {"L": RIGHT, "F1": RIGHT, "R": LEFT, "F5": LEFT}  # others above: most are on the table


class FirstPeriod(NamedTuple):
    """A scene, the robot's knowledge of it, and its map in the first period."""

    scene: Scene
    known: KnownWorld
    world: WorldMap


@functools.cache
def first_period(scene: str, variant: str) -> FirstPeriod:
    """The first period of a scene."""
    loaded = load_scene(scene, variant)
    return FirstPeriod(loaded, known_world(loaded), Twin(loaded, method=MOTM).advance().map)


def slots() -> dict[str, tuple[float, float]]:
    """Name and position [m] of the twelve slots for objects, from the shipped scene."""
    nodes = load_document("exp1").root.value["slots"].value
    pairs = {name: [float(each.value) for each in node.value["at"].value] for name, node in nodes.items()}
    return {name: (x, y) for name, (x, y) in pairs.items()}


def draw_layout() -> Drawn:
    """Floor plan of the experiments with dimensions."""
    scene = load_scene("exp1a", "trial1")
    places = slots()
    boxes = [solid for solid in scene.solids if not solid.mapped]
    with styled():
        fig = figure(ONE_COLUMN, 69.0)
        axes = fig.add_subplot()
        drawing.setting(axes, scene)
        drawing.cubes(axes, list(places.values()), "#C00000", 10.0)
        for name, (x, y) in places.items():
            dx, dy, ha, va = BESIDE.get(name, ABOVE)
            axes.text(x + dx, y + dy, name, fontsize=7, ha=ha, va=va, zorder=9)
        for item in scene.bins:
            axes.text(*item.centre, item.name[-1], ha="center", va="center", fontsize=8, weight="bold", zorder=9)
        start = scene.start
        drawing.robot(axes, start, scene.robot.footprint)  # type: ignore[arg-type]
        boxed = (("1a", *box.shape.centre) for box in boxes)  # type: ignore[union-attr]
        for text, x, y in (("start", 0.0, -0.45), ("cabinet", 0.335, -1.55), *boxed):
            axes.text(x, y, text, ha="center", va="center", fontsize=7, zorder=9)
        _measures(axes)
        drawing.metres(axes, (-1.0, 6.4), (-2.1, 3.1))
    shown = [
        *(("slot", name, at) for name, at in places.items()),
        *(("drop", each.name, each.centre) for each in scene.bins),
        *(("box of 1a", box.name, box.shape.centre) for box in boxes),  # type: ignore[union-attr]
        ("start", "robot", start),
    ]
    return Drawn(
        caption=(
            "Six of the twelve object positions (squares) are filled in each trial and delivered alternately to drop "
            "locations 1 and 2. Hatched yellow: the two boxes of Experiment 1a, which the robot's map does not have. "
            "In Experiment 2 the Temis drive round the object table."
        ),
        n="no trial: drawn from the shipped scenes",
        rows=[{"what": what, "name": name, "x_m": at[0], "y_m": at[1]} for what, name, at in shown],
        figure=fig,
    )


def _measures(axes) -> None:
    """Dimensions of the table, and its distance from the start."""
    look = {"arrowstyle": "<->", "color": BLACK, "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
    for a, b, text, dx, dy in (
        ((3.0, 2.55), (5.4, 2.55), "object table, 2.4 m", 0.0, 0.16),
        ((5.6, 1.37), (5.6, 2.17), "0.8 m", 0.40, 0.0),
        ((0.0, 0.75), (3.0, 0.75), "3 m", 0.0, 0.12),
        ((5.0, 0.0), (5.0, 1.37), "1.37 m", 0.47, 0.0),
    ):
        axes.annotate("", b, a, arrowprops=look, zorder=8)
        x, y = 0.5 * (a[0] + b[0]) + dx, 0.5 * (a[1] + b[1]) + dy
        axes.text(x, y, text, ha="center", va="center", fontsize=7)
    axes.plot([0, 5.2], [0, 0], ":", color="#999999", lw=0.6, zorder=0)
    axes.plot([0, 0], [0.4, 0.85], ":", color="#999999", lw=0.6, zorder=0)


ROBOT = np.array([3.3, 3.1, -10.0 * DEG])  # on its way to the table
OBJECT = "B5"
MAP_RED, CYAN = "#E3000F", "#00C8D7"


def placed(here: FirstPeriod, drop: str) -> tuple[Placement, tuple[Array, Array]]:
    """Candidates for the object with this drop location as the next target, and both paths of the chosen one."""
    strategy = NextTargetPlacement(here.scene.robot, PlanningParameters())
    bins = {item.name: item.centre for item in here.scene.bins}
    problem = BaseProblem(
        time=0.0,
        world=here.world,
        pose=ROBOT,
        twist=np.zeros(2),
        target=Target(kind="pick", name=OBJECT, position=np.array(slots()[OBJECT]), dwell=1.3),
        next_target=Target(kind="place", name=drop, position=np.array(bins[drop]), dwell=0.5),
        engaged=False,
    )
    placement = strategy.place(problem)
    paths = strategy.paths(placement.chosen)
    assert paths is not None  # there is always a path to the cheapest candidate
    return placement, paths


def draw_placement() -> Drawn:
    """Candidates, brighter green for lower cost; path to the best one in red, on to the next target in cyan."""
    here = first_period("exp1", "trial1")
    found = {drop: placed(here, drop) for drop in ("drop1", "drop2")}
    rows = []
    with styled():
        fig = figure(TWO_COLUMNS, 62.0)
        for k, (drop, (placement, paths)) in enumerate(found.items()):
            axes = fig.add_subplot(1, 2, k + 1)
            drawing.setting(axes, here.scene)
            drawing.path(axes, paths[0], MAP_RED)
            drawing.path(axes, paths[1], CYAN, style=(0, (5, 1.5)), casing="#004A52")
            viable = np.isfinite(placement.cost)
            # both headings of a position are drawn, a little apart
            at = placement.poses[:, :2] + 0.045 * np.column_stack(
                (np.cos(placement.poses[:, 2]), np.sin(placement.poses[:, 2]))
            )
            axes.scatter(*at[~viable].T, s=5, c="#999999", linewidths=0, zorder=7)
            spheres = axes.scatter(
                *at[viable].T, s=20, c=placement.cost[viable], cmap=COST, edgecolors="black",
                linewidths=0.3, zorder=8,
            )  # fmt: skip
            drawing.robot(axes, ROBOT, here.scene.robot.footprint)
            drawing.robot(axes, placement.goal, here.scene.robot.footprint, fill=False, alpha=0.8)
            drawing.cubes(axes, [slots()[OBJECT]], "#C00000", 14.0)
            target = next(item.centre for item in here.scene.bins if item.name == drop)
            axes.plot(*target, "k*", ms=7, zorder=9)
            axes.set_title(f"next target: drop location {drop[-1]}")
            drawing.metres(axes, (-0.7, 6.5), (-2.0, 3.6))
            fig.colorbar(spheres, ax=axes, label=r"cost $C_i$ [s]", shrink=0.8, pad=0.01)
            rows += _rows(drop, placement)
    return Drawn(
        caption=(
            f"72 candidates round {OBJECT}; small and grey: rejected. Solid red: path to the best candidate; dashed "
            "cyan: from it to the next target (star). "
            + " ".join(
                f"{drop}: C = {placement.cost[placement.chosen]:.1f} s at {placement.radius:.2f} m."
                for drop, (placement, _) in found.items()
            )
        ),
        n="no trial: one decision of the shipped placement for each drop location",
        rows=rows,
        facts={
            "robot": ROBOT,
            "chosen": {drop: placement.poses[placement.chosen] for drop, (placement, _) in found.items()},
            "paths": {drop: {"to": paths[0], "on": paths[1]} for drop, (_, paths) in found.items()},
        },
        figure=fig,
    )  # fmt: skip


def _rows(drop: str, placement: Placement) -> list[dict]:
    return [
        {"next_target": drop,
         **{name: round(float(value), 4) for name, value in zip(("x_m", "y_m", "heading_rad"), pose, strict=True)},
         **{f"{name}_s": float(getattr(placement, name)[i]) for name in ("cost_current", "cost_next", "cost")},
         "rejected": placement.rejected[i], "chosen": i == placement.chosen}
        for i, pose in enumerate(placement.poses)
    ]  # fmt: skip


BEZIER_START = np.array([0.0, 0.0, -30.0 * DEG])  # the poses of the paper's figure: Rotate 30 deg,
BEZIER_GOAL = np.array([4.0, 0.0, 90.0 * DEG])  # Translate 4 m, Rotate 90 deg
SPEED, TURN = 0.5, 100.0 * DEG  # [m/s], [rad/s] of the paper's figure
SAMPLES = 400  # points of the measured curve; the search uses 16
PUBLISHED = {"distance_m": 4.0, "bezier_length_m": 4.35, "bezier_time_s": 8.7, "path_rtr_s": 9.2}


def numbers() -> dict[str, float]:
    """Lengths [m] and times [s] of the two paths between the poses."""
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
    """Both paths between the poses with their times."""
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
            drawing.robot(axes, pose, Footprint(), colour="#BBD7EA")
        rtr = f"PathRTR: 30°, {found['distance_m']:.0f} m, 90°: {found['path_rtr_s']:.1f} s"
        bezier = f"Bézier: {found['bezier_length_m']:.2f} m, {found['bezier_time_s']:.1f} s"
        axes.text(2.0, 0.1, rtr, color=RED, ha="center", fontsize=7.5)
        axes.text(2.1, -0.86, bezier, color=BLUE, ha="center", va="top", fontsize=7.5)
        drawing.metres(axes, (-0.55, 4.55), (-1.25, 0.55))
    rows = [{"quantity": name, "here": round(found[name], 4), "published": value} for name, value in PUBLISHED.items()]
    return Drawn(
        caption=(
            f"The poses of the paper's figure at {SPEED} m/s and 100°/s. Diamonds: the control points, at "
            f"{100 * found['offset']:.0f} % of the distance in front of the start and behind the goal."
        ),
        n="no trial: computed by the planner's own functions",
        rows=rows,
        facts={**found, "curve": curve},
        figure=fig,
    )


PATH_START = np.array([4.05, 0.75, 10.0 * DEG])  # in front of the table, heading away from the nearer end
PATH_GOAL = np.array([4.2, 2.70, 180.0 * DEG])  # behind the table: the base pose of a grasp from the far edge
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


def draw_global_path() -> Drawn:
    """Both paths between the same poses around the table of Experiment 1."""
    here = first_period("exp1", "trial1")
    found = paths(here)
    looks = {
        "with rotation cost": (PATH_RED, "-", 2.4, "white"),
        "without (STAA*)": (PATH_YELLOW, (0, (4, 2)), 2.2, BLACK),
    }
    with styled():
        fig = figure(ONE_COLUMN, 66.0)
        axes = fig.add_subplot()
        grid = drawing.occupancy(axes, here.world)
        for name, (colour, line, width, casing) in looks.items():
            drawing.path(axes, found[name], colour, style=line, width=width, casing=casing, label=name)
        drawing.robot(axes, PATH_START, here.scene.robot.footprint, colour="white")
        drawing.robot(axes, PATH_GOAL, here.scene.robot.footprint, colour="white", alpha=0.75)
        axes.text(4.6, 0.3, "start", fontsize=7, zorder=9)
        axes.text(4.05, 3.15, "goal", fontsize=7, zorder=9)
        drawing.metres(axes, (2.0, 6.4), (0.0, 3.55))
        bar = fig.colorbar(grid, ax=axes, shrink=0.75, ticks=[0.0, 0.5, 1.0])
        bar.ax.set_yticklabels(["free", "0.5", "occupied"])
        fig.legend(loc="outside upper center", ncols=2)
    rows = [{"path": name, **measured(path, here)} for name, path in found.items()]
    return Drawn(
        caption=(
            "Red, solid: the cheapest path by PathRTR. Yellow, dashed: the shortest one, as unmodified STAA* has it. "
            "The colour of the ground is the proximity grid at STAA*'s own inflation of 0.6 m. "
            + " ".join(
                f"{row['path'][:1].upper()}{row['path'][1:]}: {row['length_m']:.2f} m, "
                f"{row['turning_deg']:.0f}° of turning, PathRTR {row['path_rtr_s']:.1f} s."
                for row in rows
            )
        ),
        n="no trial: the planner's own search on the map of exp1/trial1",
        rows=rows,
        facts={"start": PATH_START, "goal": PATH_GOAL, "paths": found},
        figure=fig,
    )
