"""A unicycle, the known furniture of Experiment 1, and an arm that only needs time in reach."""

import math

import msgspec
import numpy as np
import shapely

from motm_twin.model.profile import RobotProfile
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.types import BaseProblem, SearchBudget, Target

PERIOD = 0.05
FURNITURE = (
    ("rect", 3.0, 1.37, 5.4, 2.17),
    ("rect", -0.48, 1.63, 0.29, 2.81),
    ("rect", -0.6, -1.7, 1.27, -1.405),
)
ROUND_TABLE = (4.27, -1.44, 0.365)
BOXES = ((2.7, 1.7), (3.9, 0.96))
SLOT, DROP = (3.65, 1.47), (4.25, -1.29)  # [m] F2, and the first bin


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    """Corners, counter-clockwise."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


def polygons(*, boxes: bool = False) -> tuple[np.ndarray, ...]:
    """Furniture of Experiment 1, and the boxes of 1a."""
    angle = np.arange(16) * (2 * math.pi / 16)
    x, y, r = ROUND_TABLE
    shapes = [rectangle(*f[1:]) for f in FURNITURE]
    shapes.append(np.column_stack((x + r * np.cos(angle), y + r * np.sin(angle))))
    if boxes:
        shapes += [rectangle(x - 0.25, y - 0.25, x + 0.25, y + 0.25) for x, y in BOXES]
    return tuple(shapes)


def world_of(
    shapes: tuple[np.ndarray, ...],
    bounds: tuple[float, float, float, float] = (-2.5, -3.6, 7.4, 4.4),
    cell: float = 0.05,
) -> WorldMap:
    """A map with exact distances to the polygons."""
    nx, ny = round((bounds[2] - bounds[0]) / cell), round((bounds[3] - bounds[1]) / cell)
    x, y = np.meshgrid(bounds[0] + cell * (np.arange(nx) + 0.5), bounds[1] + cell * (np.arange(ny) + 0.5))
    distance = np.full(x.shape, 10.0)
    if shapes:
        area = shapely.union_all([shapely.Polygon(p) for p in shapes])
        shapely.prepare(area)
        distance = shapely.distance(shapely.points(x, y), area)
    return WorldMap(
        stamp=0.0,
        resolution=cell,
        origin=np.array(bounds[:2]),
        occupied=(distance <= 0.0).astype(np.uint8),
        distance=distance.astype(np.float32),
        proximity=np.clip(1.0 - distance / 0.58, 0.0, 1.0).astype(np.float32),
        polygons=shapes,
        seen_points=np.zeros((0, 2)),
        seen_static=np.zeros(0, dtype=bool),
    )


def step_unicycle(pose: np.ndarray, twist: np.ndarray, acceleration: np.ndarray, dt: float) -> tuple:
    """Exact enough: ten small arcs of constant acceleration."""
    x, y, h = pose
    v, w = twist
    n = 10
    for _ in range(n):
        vm, wm = v + acceleration[0] * dt / n / 2, w + acceleration[1] * dt / n / 2
        x += vm * dt / n * math.cos(h + wm * dt / n / 2)
        y += vm * dt / n * math.sin(h + wm * dt / n / 2)
        h += wm * dt / n
        v, w = v + acceleration[0] * dt / n, w + acceleration[1] * dt / n
    return np.array([x, y, h]), np.array([v, w])


def exact_clearance(pose: np.ndarray, area: shapely.Geometry) -> float:
    """Distance of the rectangle to the polygons."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    corners = np.array([(0.35, 0.25), (-0.35, 0.25), (-0.35, -0.25), (0.35, -0.25)])
    return float(shapely.Polygon(corners @ np.array([[c, s], [-s, c]]) + pose[:2]).distance(area))


def deliver(limit: float) -> tuple[bool, bool, set[str]]:
    """Pick at F2 between the boxes, then place: whether it was done and touched nothing, and modes of placement."""
    planner, shapes = BasePlanner(RobotProfile()), polygons(boxes=True)
    world, area = world_of(shapes), shapely.union_all([shapely.Polygon(p) for p in shapes])
    targets = [
        Target(kind=kind, name=kind, position=np.array(position), dwell=PlanningParameters().reach.dwell(kind))
        for kind, position in (("pick", SLOT), ("place", DROP))
    ]
    pose, twist, held, free, modes = np.zeros(3), np.zeros(2), 0.0, True, set()
    for k in range(round(limit / PERIOD)):
        whole = targets[0].dwell
        problem = BaseProblem(
            time=k * PERIOD, world=world, pose=pose, twist=twist,
            target=msgspec.structs.replace(targets[0], dwell=whole - held), next_target=next(iter(targets[1:]), None),
            engaged=held > (0.5 if targets[0].kind == "pick" else 0.3), period=PERIOD,
        )  # fmt: skip
        placement, plan = planner.plan(problem, SearchBudget(expansions=300))
        modes.add(placement.mode)
        pose, twist = step_unicycle(pose, twist, plan.acceleration, PERIOD)
        free &= exact_clearance(pose, area) > 0.0
        held = held + PERIOD if planner.controller.reach.contains(pose, twist, targets[0]) else 0.0
        if held >= whole - 1e-9:
            targets, held = targets[1:], 0.0
            if not targets:
                return True, free, modes
    return False, free, modes
