"""Worlds that grow in one respect: made from Experiment 1, with its table, its bins and its task in the middle."""

import math

import msgspec
import numpy as np

from motm_twin.model.scene import Agent, Bin, Box, Pick, Place, Scene, SceneObject, Solid
from motm_twin.model.scene_file import load_scene

WORK = (-3.0, -4.5, 8.0, 5.0)  # [m] x_min, y_min, x_max, y_max of the task: nothing is added there
APART = 0.9  # [m] between pieces of furniture that are added: the base passes
SIZES = (0.5, 1.4)  # [m] of their sides
TABLE_TOP = 0.78  # [m]


def base_scene() -> Scene:
    """Experiment 1, trial 1."""
    return load_scene("exp1", "trial1")


def with_obstacles(scene: Scene, count: int, side: float) -> Scene:
    """A square map of that side [m] round the task, with so many pieces of furniture on it, all in the robot's map."""
    rng = np.random.default_rng([count, round(side)])
    x0, y0 = 0.5 * (WORK[0] + WORK[2]), 0.5 * (WORK[1] + WORK[3])
    bounds = (x0 - 0.5 * side, y0 - 0.5 * side, x0 + 0.5 * side, y0 + 0.5 * side)
    spots = _spots(bounds, count, rng)
    solids = tuple(
        Solid(
            name=f"desk_{k}",
            shape=Box(centre=(x, y), size=tuple(rng.uniform(*SIZES, 2).tolist()), yaw=float(rng.uniform(0.0, math.pi))),
            z_min=0.0,
            z_max=0.75,
            mapped=True,
            group=f"desk_{k}",
        )
        for k, (x, y) in enumerate(spots)
    )
    return msgspec.structs.replace(scene, solids=scene.solids + solids, bounds=bounds)


def _spots(
    bounds: tuple[float, float, float, float], count: int, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """So many cells of a grid over the map that are clear of the task and of the border; raises when there are fewer.

    They are spread over the map, as on the floor of an office: few of many are near the robot, and none of few.
    """
    step = SIZES[1] * math.sqrt(2.0) + APART
    xs = np.arange(bounds[0] + step, bounds[2] - step, step)
    ys = np.arange(bounds[1] + step, bounds[3] - step, step)
    cells = [
        (float(x), float(y))
        for x in xs
        for y in ys
        if not (WORK[0] - step < x < WORK[2] + step and WORK[1] - step < y < WORK[3] + step)
    ]
    if len(cells) < count:
        raise ValueError(f"{count} pieces of furniture do not fit: there is room for {len(cells)} on this map")
    chosen = rng.permutation(len(cells))[:count]
    return [cells[k] for k in chosen]


def with_beams(scene: Scene, beams: int) -> Scene:
    """A lidar of so many beams."""
    lidar = msgspec.structs.replace(scene.robot.lidar, beams=beams)
    return msgspec.structs.replace(scene, robot=msgspec.structs.replace(scene.robot, lidar=lidar))


def with_agents(scene: Scene, count: int) -> Scene:
    """A hall with so many agents that drive round squares of 2 m beside the task and beyond it."""
    hall = with_obstacles(scene, 0, 50.0)
    places = sorted(
        (
            (float(x), float(y))
            for x in np.arange(-20.0, 24.0, 3.5)
            for y in np.arange(-20.0, 21.0, 3.5)
            if not (WORK[0] - 1.5 < x < WORK[2] + 1.5 and WORK[1] - 0.5 < y < WORK[3] + 0.5)
        ),
        key=lambda at: math.hypot(at[0] - 2.5, at[1]),
    )[:count]
    agents = tuple(
        Agent(
            name=f"temi_{k}",
            start=(x - 1.0, y - 1.0, 0.0),
            waypoints=((x - 1.0, y - 1.0), (x + 1.0, y - 1.0), (x + 1.0, y + 1.0), (x - 1.0, y + 1.0)),
        )
        for k, (x, y) in enumerate(places)
    )
    return msgspec.structs.replace(hall, agents=agents)


def with_targets(scene: Scene, targets: int) -> Scene:
    """So many targets: half of them cubes along both edges of the table, the others the bins in turn."""
    cubes = targets // 2
    along = np.linspace(3.1, 5.3, math.ceil(cubes / 2)) if cubes > 1 else np.array([3.65])
    places = [(float(x), y) for x in along for y in (1.47, 2.07)][:cubes]
    objects = tuple(SceneObject(name=f"cube_{k}", position=(x, y, TABLE_TOP + 0.02)) for k, (x, y) in enumerate(places))
    bins: tuple[Bin, ...] = scene.bins
    tasks = tuple(
        task for k in range(cubes) for task in (Pick(object=f"cube_{k}"), Place(bin=bins[k % len(bins)].name))
    )
    return msgspec.structs.replace(scene, objects=objects, tasks=tasks)
