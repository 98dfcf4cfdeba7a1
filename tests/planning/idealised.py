"""A light harness: unicycle with limits, known furniture, and an arm that only needs time in reach."""

import dataclasses
import math
import sys
import time as wall

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
DROPS = {"1": (4.25, -1.29), "2": (0.1, 2.13)}
COLUMNS = (3.1, 3.65, 4.2, 4.75, 5.3)
SLOTS = (
    {f"F{i + 1}": (x, 1.47) for i, x in enumerate(COLUMNS)}
    | {f"B{i + 1}": (x, 2.07) for i, x in enumerate(COLUMNS)}
    | {"L": (3.1, 1.77), "R": (5.3, 1.77)}
)
TRIALS = {
    1: "F1 F5 B3 F2 L F3", 2: "F5 B2 F1 R B4 B3", 3: "B5 F4 L B1 F5 B2", 4: "B2 R F5 B3 B4 F3", 5: "F4 R F3 F5 F2 B3",
    6: "L B1 F5 R F1 B4", 7: "B4 B1 R B5 F1 F3", 8: "F5 L F1 R F2 F3", 9: "F5 B3 F3 B2 F1 F4", 10: "B3 B1 F4 B5 F3 B2",
}  # fmt: skip


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


@dataclasses.dataclass
class Result:
    """What a run achieved."""

    finished: bool
    time: float
    clearance: float
    contacts: int
    turning: float
    length: float
    switches: int
    closing_speed: float
    expansions: list[int]
    milliseconds: list[float]
    dry: int
    modes: set[str]
    lost: int
    poses: np.ndarray


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


def tasks_of(
    slots: list[str], *, first_drop: str = "1", shift: np.ndarray | None = None
) -> list[tuple[str, str, tuple]]:
    """Pick and place in turn: (kind, name, position)."""
    order = ("1", "2") if first_drop == "1" else ("2", "1")
    tasks = []
    for i, slot in enumerate(slots):
        position = np.array(SLOTS[slot]) + (0.0 if shift is None else shift[i])
        tasks.append(("pick", slot, tuple(position)))
        tasks.append(("place", f"drop {order[i % 2]}", DROPS[order[i % 2]]))
    return tasks


def run(
    tasks: list,
    *,
    boxes: bool = False,
    parameters: PlanningParameters | None = None,
    expansions: int = 400,
    limit: float = 160.0,
    profile: RobotProfile | None = None,
    planner: BasePlanner | None = None,
    noise: int | None = None,
    trace: bool = False,
) -> Result:
    """Drive until all tasks are done."""
    profile = profile or RobotProfile()
    parameters = parameters or PlanningParameters()
    planner = planner or BasePlanner(profile, parameters)
    shapes = polygons(boxes=boxes)
    world = world_of(shapes)
    area = shapely.union_all([shapely.Polygon(p) for p in shapes])
    half_l, half_w = profile.footprint.length / 2, profile.footprint.width / 2
    rng = np.random.default_rng(noise) if noise is not None else None
    error = np.zeros(3)
    pose, twist = np.zeros(3), np.zeros(2)
    model = planner.controller.reach
    index, hold, now = 0, 0.0, 0.0
    result = Result(False, 0.0, 10.0, 0, 0.0, 0.0, 0, 0.0, [], [], 0, set(), 0, np.zeros((0, 3)))
    closing, track, touching, before = [], [], False, None
    while now < limit:
        kind, name, position = tasks[index]
        full = parameters.reach.dwell(kind)
        target = Target(kind=kind, name=name, position=np.array(position), dwell=full - hold)
        following = None
        if index + 1 < len(tasks):
            k, n, p = tasks[index + 1]
            following = Target(kind=k, name=n, position=np.array(p), dwell=parameters.reach.dwell(k))
        if rng is not None:
            error = 0.99 * error + math.sqrt(1 - 0.99**2) * rng.normal(0.0, (0.01, 0.01, math.radians(0.5)))
        problem = BaseProblem(
            time=now, world=world, pose=pose + error, twist=twist, target=target, next_target=following,
            engaged=hold > (0.5 if kind == "pick" else 0.3), period=PERIOD,
        )  # fmt: skip
        start = wall.thread_time()
        placement, plan = planner.plan(problem, SearchBudget(expansions=expansions))
        result.milliseconds.append(1e3 * (wall.thread_time() - start))
        result.expansions.append(plan.expansions)
        result.dry += plan.status == "braking"
        result.modes.add(placement.mode)
        if before is not None and before[0] == index and np.hypot(*(placement.goal - before[1])[:2]) > 0.05:
            result.switches += 1
        before = (index, placement.goal)
        if trace:
            print(
                f"{now:6.2f} {name:7s} {placement.mode:5s} {pose.round(2)} {twist.round(2)}"
                f" goal {placement.goal.round(2)}"
                f" {plan.status:8s} n={plan.expansions} a={plan.acceleration.round(2)} hold={hold:.2f}"
                f" range={plan.time_to_range:.2f} th={plan.t_h:.2f} {plan.reason}"
            )
        new_pose, twist = step_unicycle(pose, twist, plan.acceleration, PERIOD)
        assert -profile.base.reverse_speed - 1e-6 <= twist[0] <= profile.base.forward_speed + 1e-6
        assert abs(twist[1]) <= profile.base.yaw_rate + 1e-6
        result.length += math.hypot(*(new_pose - pose)[:2])
        result.turning += abs(new_pose[2] - pose[2])
        pose = new_pose
        now += PERIOD
        track.append(pose)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        corners = np.array([(half_l, half_w), (-half_l, half_w), (-half_l, -half_w), (half_l, -half_w)])
        body = shapely.Polygon(corners @ np.array([[c, s], [-s, c]]) + pose[:2])
        free = body.distance(area)
        result.clearance = min(result.clearance, free)
        if free <= 0.0 and not touching:
            result.contacts += 1
        touching = free <= 0.0
        reached = model.contains(pose, twist, target)
        result.lost += hold > 0.3 and not reached
        hold = hold + PERIOD if reached else 0.0
        if kind == "pick" and hold > 0.5:
            closing.append(abs(twist[0]))
        if hold >= full - 1e-9:
            index, hold = index + 1, 0.0
            if index == len(tasks):
                result.finished = True
                break
    result.time = now
    result.closing_speed = float(np.mean(closing)) if closing else 0.0
    result.poses = np.array(track)
    return result


def report(name: str, r: Result) -> None:
    """One line."""
    ms, ex = np.array(r.milliseconds), np.array(r.expansions)
    print(
        f"{name:12s} {'ok ' if r.finished else 'NOT'} {r.time:6.2f} s  clear {r.clearance:.3f}  contacts {r.contacts}"
        f"  turn {r.turning:5.1f}  L {r.length:5.1f}  sw {r.switches:3d}  close {r.closing_speed:.2f}"
        f"  exp {ex.mean():5.0f}  ms {np.median(ms):5.2f}/{np.percentile(ms, 99):5.2f}"
        f"  dry {r.dry} lost {r.lost} {sorted(r.modes)}",
        flush=True,
    )


def experiment(parameters: PlanningParameters | None = None, **how: object) -> list[Result]:
    """The ten published trials."""
    results = []
    first = how.pop("first_drop", "1")
    only = how.pop("trials", TRIALS.keys())
    for trial in only:
        r = run(tasks_of(TRIALS[trial].split(), first_drop=first), parameters=parameters, **how)
        report(f"trial {trial}", r)
        results.append(r)
    summary(results)
    return results


def summary(results: list[Result]) -> None:
    """Means over runs."""
    print(
        f"MEAN {np.mean([r.time for r in results]):.2f} s, finished {sum(r.finished for r in results)}/{len(results)},"
        f" contacts {sum(r.contacts for r in results)}, clearance {min(r.clearance for r in results):.3f},"
        f" turning {np.mean([r.turning for r in results]):.1f},"
        f" closing {np.mean([r.closing_speed for r in results]):.2f},"
        f" ms {np.median(np.concatenate([r.milliseconds for r in results])):.2f}"
        f"/{np.percentile(np.concatenate([r.milliseconds for r in results]), 99):.2f}",
        flush=True,
    )


if __name__ == "__main__":
    options = dict(argument.split("=") for argument in sys.argv[1:])
    mode = options.get("mode", "exp1")
    expansions = int(options.get("n", 400))
    if mode == "random":
        found = []
        for seed in range(int(options.get("seeds", 20))):
            rng = np.random.default_rng([seed, 7])
            slots = list(rng.permutation(sorted(SLOTS))[:6])
            shift = rng.uniform(-0.03, 0.03, (6, 2)) if "shift" in options else None
            found.append(run(tasks_of(slots, shift=shift), boxes="boxes" in options, expansions=expansions))
            report(f"seed {seed}", found[-1])
        summary(found)
    elif mode == "trace":
        trial = int(options.get("trial", 1))
        r = run(
            tasks_of(TRIALS[trial].split()), boxes="boxes" in options, trace=True, limit=float(options.get("t", 20))
        )
        report("trace", r)
    else:
        experiment(
            boxes=mode == "exp1a", first_drop=options.get("drop", "1"), expansions=expansions,
            noise=int(options["noise"]) if "noise" in options else None,
            trials=[int(t) for t in options["trials"].split(",")] if "trials" in options else TRIALS.keys(),
        )  # fmt: skip
