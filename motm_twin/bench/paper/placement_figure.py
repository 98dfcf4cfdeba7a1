"""Two examples of base placement (Paper, Sec. IV): one object, two drop locations, and the choice differs."""

import numpy as np

from motm_twin.bench.paper import ground
from motm_twin.bench.paper.layout_figure import slots
from motm_twin.bench.paper.part import Drawn
from motm_twin.bench.paper.standing import Standing, standing
from motm_twin.bench.paper.style import COST, TWO_COLUMNS, figure, styled
from motm_twin.model.geometry import Array
from motm_twin.planning.parameters import DEG, PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.types import BaseProblem, Placement, Target

ROBOT = np.array([3.3, 3.1, -10.0 * DEG])  # on its way to the table
OBJECT = "B5"
RED, CYAN = "#E3000F", "#00C8D7"


def placed(here: Standing, drop: str) -> tuple[Placement, tuple[Array, Array]]:
    """The candidates for the object with a drop location as the next target, and both paths of the chosen one."""
    strategy = NextTargetPlacement(here.scene.robot, PlanningParameters())
    bins = {item.name: item.centre for item in here.scene.bins}
    problem = BaseProblem(
        time=0.0,
        world=here.world,
        pose=ROBOT,
        twist=np.zeros(2),
        target=Target(kind="pick", name=OBJECT, position=_cube(), dwell=1.3),
        next_target=Target(kind="place", name=drop, position=np.array(bins[drop]), dwell=0.5),
        engaged=False,
    )
    placement = strategy.place(problem)
    paths = strategy.paths(placement.chosen)
    assert paths is not None  # there is always a way to the cheapest candidate
    return placement, paths


def _cube() -> Array:
    """Where the cube of the slot lies, shape (2,)."""
    return np.array(slots()[OBJECT])


def draw() -> Drawn:
    """Candidates as spheres, brighter green for lower cost; red to the best one, cyan on to the next target."""
    here = standing("exp1", "trial1")
    found = {drop: placed(here, drop) for drop in ("drop1", "drop2")}
    rows = []
    with styled():
        fig = figure(TWO_COLUMNS, 62.0)
        for k, (drop, (placement, paths)) in enumerate(found.items()):
            axes = fig.add_subplot(1, 2, k + 1)
            ground.setting(axes, here.scene)
            ground.path(axes, paths[0], RED)
            ground.path(axes, paths[1], CYAN, style=(0, (5, 1.5)), casing="#004A52")
            viable = np.isfinite(placement.cost)
            # both headings of a position are drawn, a little apart on the circle
            at = placement.poses[:, :2] + 0.045 * np.column_stack(
                (np.cos(placement.poses[:, 2]), np.sin(placement.poses[:, 2]))
            )
            axes.scatter(*at[~viable].T, s=5, c="#999999", linewidths=0, zorder=7)
            spheres = axes.scatter(
                *at[viable].T, s=20, c=placement.cost[viable], cmap=COST, edgecolors="black",
                linewidths=0.3, zorder=8,
            )  # fmt: skip
            ground.robot(axes, ROBOT, here.scene.robot.footprint)
            ground.robot(axes, placement.goal, here.scene.robot.footprint, fill=False, alpha=0.8)
            ground.cubes(axes, [_cube()], "#C00000", 14.0)
            target = next(item.centre for item in here.scene.bins if item.name == drop)
            axes.plot(*target, "k*", ms=7, zorder=9)
            axes.set_title(f"next target: drop location {drop[-1]}")
            ground.metres(axes, (-0.7, 6.5), (-2.0, 3.6))
            fig.colorbar(spheres, ax=axes, label=r"cost $C_i$ [s]", shrink=0.8, pad=0.01)
            rows += _rows(drop, placement)
    return Drawn(
        name="base_placement",
        title="Base placement for one object and two drop locations",
        caption=(
            f"72 candidates round {OBJECT}; small and grey: rejected. Solid red: path to the best candidate; dashed "
            "cyan: "
            "from it to the next target (star). "
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
        {
            "next_target": drop,
            "x_m": round(float(pose[0]), 4),
            "y_m": round(float(pose[1]), 4),
            "heading_rad": round(float(pose[2]), 4),
            "cost_current_s": float(placement.cost_current[i]),
            "cost_next_s": float(placement.cost_next[i]),
            "cost_s": float(placement.cost[i]),
            "rejected": placement.rejected[i],
            "chosen": i == placement.chosen,
        }
        for i, pose in enumerate(placement.poses)
    ]
