"""Growth of the control period with the size of the world: obstacles, beams, map, agents, candidates, targets, viewers.

The worlds are made from Experiment 1 and grow in one respect at a time. Every point is a whole run with the referee,
alone on one core, with compiled kernels. The period is measured from observation to command in processor time, so that
other load on the machine does not count.
"""

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.control.parameters import Parameters
from motm_twin.model.geometry import Array
from motm_twin.model.plant import PERIOD
from motm_twin.model.scene import Agent, Bin, Box, Pick, Place, Scene, SceneObject, Solid
from motm_twin.model.scene_file import load_scene
from motm_twin.perf import page
from motm_twin.perf.period import WARM_UP, one_core
from motm_twin.perf.processes import served
from motm_twin.perf.report import VERDICTS, grid, load_average, machine, save_picture, spread, write
from motm_twin.planning.parameters import PlacementParameters, PlanningParameters
from motm_twin.twin import Twin

WORK = (-3.0, -4.5, 8.0, 5.0)  # [m] x_min, y_min, x_max, y_max of the task: nothing is added there
APART = 0.9  # [m] between added pieces of furniture: the base fits through
SIZES = (0.5, 1.4)  # [m] of their sides
TABLE_TOP = 0.78  # [m]


def base_scene() -> Scene:
    """Experiment 1, trial 1."""
    return load_scene("exp1", "trial1")


def with_obstacles(scene: Scene, count: int, side: float) -> Scene:
    """A square map of this side [m] around the task with ``count`` pieces of furniture, all in the robot's map."""
    rng = np.random.default_rng([count, round(side)])
    x0, y0 = 0.5 * (WORK[0] + WORK[2]), 0.5 * (WORK[1] + WORK[3])
    bounds = (x0 - 0.5 * side, y0 - 0.5 * side, x0 + 0.5 * side, y0 + 0.5 * side)
    spots = _spots(bounds, count, rng)
    shapes = [
        Box(centre=spot, size=tuple(rng.uniform(*SIZES, 2).tolist()), yaw=float(rng.uniform(0.0, math.pi)))
        for spot in spots
    ]
    solids = tuple(
        Solid(name=f"desk_{k}", shape=shape, z_min=0.0, z_max=0.75, mapped=True, group=f"desk_{k}")
        for k, shape in enumerate(shapes)
    )
    return msgspec.structs.replace(scene, solids=scene.solids + solids, bounds=bounds)


def _spots(
    bounds: tuple[float, float, float, float], count: int, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """``count`` random cells of a grid over the map, clear of task and border; raises ValueError when there are fewer.

    They are spread over the map as on the floor of an office: few of many are near the robot, and none of few.
    """
    step = SIZES[1] * math.sqrt(2.0) + APART
    xs = np.arange(bounds[0] + step, bounds[2] - step, step)
    ys = np.arange(bounds[1] + step, bounds[3] - step, step)
    cells = _clear(xs, ys, step, step)
    if len(cells) < count:
        raise ValueError(f"{count} pieces of furniture do not fit: there is room for {len(cells)} on this map")
    chosen = rng.permutation(len(cells))[:count]
    return [cells[k] for k in chosen]


def _clear(xs: Array, ys: Array, aside_x: float, aside_y: float) -> list[tuple[float, float]]:
    """Points of a grid outside the area of the task grown by ``aside_x`` and ``aside_y`` [m]."""
    x_min, y_min, x_max, y_max = WORK[0] - aside_x, WORK[1] - aside_y, WORK[2] + aside_x, WORK[3] + aside_y
    return [(float(x), float(y)) for x in xs for y in ys if not (x_min < x < x_max and y_min < y < y_max)]


def with_beams(scene: Scene, beams: int) -> Scene:
    """The scene with a lidar of this many beams."""
    lidar = msgspec.structs.replace(scene.robot.lidar, beams=beams)
    return msgspec.structs.replace(scene, robot=msgspec.structs.replace(scene.robot, lidar=lidar))


def with_agents(scene: Scene, count: int) -> Scene:
    """A hall with ``count`` agents that drive around squares of 2 m beside and beyond the task."""
    hall = with_obstacles(scene, 0, 50.0)
    free = _clear(np.arange(-20.0, 24.0, 3.5), np.arange(-20.0, 21.0, 3.5), 1.5, 0.5)
    places = sorted(free, key=lambda at: math.hypot(at[0] - 2.5, at[1]))[:count]
    square = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    rounds = [tuple((x + dx, y + dy) for dx, dy in square) for x, y in places]
    agents = tuple(Agent(name=f"temi_{k}", start=(*way[0], 0.0), waypoints=way) for k, way in enumerate(rounds))
    return msgspec.structs.replace(hall, agents=agents)


def with_targets(scene: Scene, targets: int) -> Scene:
    """The scene with this many targets: half are cubes along both edges of the table, half the bins in turn."""
    cubes = targets // 2
    along = np.linspace(3.1, 5.3, math.ceil(cubes / 2)) if cubes > 1 else np.array([3.65])
    places = [(float(x), y) for x in along for y in (1.47, 2.07)][:cubes]
    objects = tuple(SceneObject(name=f"cube_{k}", position=(x, y, TABLE_TOP + 0.02)) for k, (x, y) in enumerate(places))
    bins: tuple[Bin, ...] = scene.bins
    tasks = tuple(
        task for k in range(cubes) for task in (Pick(object=f"cube_{k}"), Place(bin=bins[k % len(bins)].name))
    )
    return msgspec.structs.replace(scene, objects=objects, tasks=tasks)


NAME = "growth"
TITLE = "Growth: the period against the size of the world"
PICTURE = Path("docs/performance_growth.png")
QUICK_PERIODS = 20
OFFICE = 200.0  # [m] side of the floor with the obstacles
MINUTE = 1200  # periods; a point with many targets runs only the first minute, and says nothing about success
LIMIT = 2.0  # times the period of Experiment 1 that 1,000 obstacles on 200 m may take


@dataclasses.dataclass(frozen=True, kw_only=True)
class Point:
    """One world: its size in the swept respect, the scene, and planning parameters that differ from the shipped."""

    count: float
    make: Callable[[], Scene]
    planning: PlanningParameters | None = None
    periods: int | None = None  # None: to the end of the task


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sweep:
    """One respect in which the world grows."""

    name: str
    unit: str = ""
    points: tuple[Point, ...]


def _candidates(positions: int) -> PlanningParameters | None:
    """Planning parameters with this many candidate positions; None for the shipped number."""
    changed = PlanningParameters(placement=PlacementParameters(positions=positions))
    return None if changed == PlanningParameters() else changed


def _points(counts: Iterable[float], make: Callable[[Any], Scene], periods: int | None = None) -> tuple[Point, ...]:
    return tuple(Point(count=count, make=functools.partial(make, count), periods=periods) for count in counts)


def sweeps() -> tuple[Sweep, ...]:
    """All sweeps; the first point of the first is Experiment 1 as shipped."""
    shipped = Point(count=1, make=base_scene)
    floor = _points((50.0, 200.0), lambda side: with_obstacles(base_scene(), 10, side))
    crowded = _points((10, 100, 1000), lambda count: with_obstacles(base_scene(), count, OFFICE))
    many = tuple(Point(count=2 * n, make=base_scene, planning=_candidates(n)) for n in (36, 144, 576))
    targets = lambda count: with_targets(base_scene(), count)  # noqa: E731
    return (
        Sweep(name="shipped", points=(shipped,)),
        Sweep(name="obstacles on 200 m", points=crowded),
        Sweep(name="side of the map", unit="m", points=(Point(count=10, make=base_scene), *floor)),
        Sweep(name="lidar beams", points=_points((180, 721, 2880), lambda beams: with_beams(base_scene(), beams))),
        Sweep(name="agents", points=_points((1, 4, 16, 64), lambda count: with_agents(base_scene(), count))),
        Sweep(name="candidates", points=many),
        Sweep(name="targets", points=(*_points((2, 12), targets), *_points((50, 100), targets, MINUTE))),
    )


def measured(point: Point, *, most: int | None = None) -> dict[str, Any]:
    """Run a point: period and its stages [ms], real-time factor, and the outcome of the task."""
    scene = point.make()
    began = time.perf_counter()
    twin = Twin(scene, numbers=point.planning and Parameters(planning=point.planning), clock=time.thread_time)
    built = time.perf_counter() - began
    stages: dict[str, list[float]] = {}
    periods = most or point.periods
    began = time.perf_counter()
    for tick in twin.ticks():
        if twin.index > WARM_UP or most is not None:
            for stage, value in tick.stage_ms.items():
                stages.setdefault(stage, []).append(value)
        if twin.index == periods:
            break
    seconds = time.perf_counter() - began
    assert tick.truth is not None
    caused = sum(contact.caused_by_robot for contact in tick.truth.contacts)
    return {
        "count": point.count, "period_ms": spread(stages.pop("period")),
        "stages_ms": {stage: round(float(np.mean(values)), 3) for stage, values in stages.items()},
        "build_s": round(built, 2), "factor": round(twin.index * PERIOD / seconds, 2), "periods": twin.index,
        "time_s": round(tick.time, 2) if tick.done else None, "contacts": len(tick.truth.contacts),
        "contacts_caused_by_robot": caused,
        "success": bool(tick.success and not caused and not tick.truth.dropped) if tick.done else None,
    }  # fmt: skip


def bench_growth(out: Path, console: Console, *, quick: bool = False) -> bool:
    """Measure all sweeps, print, write ``out/growth.json`` and the picture; True when the goal for 1,000 is reached.

    Takes about 5 minutes; ``quick``: only the first two points of each sweep for a second, without a verdict.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    found: dict[str, list[dict[str, Any]]] = {}
    with one_core():
        measured(Point(count=0, make=base_scene), most=WARM_UP)
        for sweep in sweeps():
            points = sweep.points[:2] if quick else sweep.points
            for point in points:
                row = _again(point, found) or measured(point, most=QUICK_PERIODS if quick else None)
                found.setdefault(sweep.name, []).append(row)
                console.print(f"  {sweep.name} {point.count:g}: {_line(row)}", markup=False)
    if not quick:
        found[VIEWERS_NAME] = viewer_rows()
    units = {sweep.name: sweep.unit for sweep in sweeps()} | {VIEWERS_NAME: ""}
    load = load_average(console)
    console.print(growth_table(found, units))
    if quick:
        return True
    factor = found["obstacles on 200 m"][-1]["period_ms"]["p99"] / found["shipped"][0]["period_ms"]["p99"]
    reached = factor <= LIMIT
    line = f"1,000 obstacles on {OFFICE:g} m: p99 is {factor:.2f} x that of exp1, at most {LIMIT:g} x"
    console.print(f"{line}: {VERDICTS[reached]}")
    write(out / f"{NAME}.json", {"machine": machine(), "load_average": load, "sweeps": found, "times_exp1": factor})
    plot(found, units, PICTURE)
    console.print(f"written to {out / NAME}.json and {PICTURE}")
    return reached


def _again(point: Point, found: dict[str, list[dict[str, Any]]]) -> dict[str, Any] | None:
    """Values of the shipped Experiment 1 when this point is equal to it; else None."""
    if "shipped" not in found or point.planning is not None or point.make() != base_scene():
        return None
    return {**found["shipped"][0], "count": point.count}


def _line(row: dict[str, Any]) -> str:
    times = " / ".join(f"{value:.1f}" for value in row["period_ms"].values())
    done = "" if row["success"] is None else (", done" if row["success"] else ", NOT done")
    return f"period {times} ms, {row['factor']:.1f} x real time{done}"


def growth_table(found: dict[str, list[dict[str, Any]]], units: dict[str, str]) -> Table:
    """One row per world."""
    table = grid("what", "how much", "p50 ms", "p99 ms", "max ms", "map", "place", "plan", "arm", "x real", "done")
    for name, rows in found.items():
        for row in rows:
            stages = [f"{row['stages_ms'].get(stage, np.nan):.2f}" for stage in ("map", "place", "plan", "arm")]
            done = {True: "yes", False: "NO", None: "-"}[row["success"]]
            times = [f"{value:.1f}" for value in row["period_ms"].values()]
            table.add_row(name, f"{row['count']:g} {units[name]}", *times, *stages, f"{row['factor']:.1f}", done)
    return table


def plot(found: dict[str, list[dict[str, Any]]], units: dict[str, str], target: Path) -> None:
    """One log-log panel per sweep: p50 and p99 of the period [ms] against the count, with linear growth to compare."""
    from matplotlib.figure import Figure

    names = [name for name, rows in found.items() if len(rows) > 1]
    columns = 3
    lines = math.ceil(len(names) / columns)
    figure = Figure(figsize=(11, 3.2 * lines))
    axes = figure.subplots(lines, columns, squeeze=False)
    for axis in axes.flat[len(names) :]:
        axis.set_axis_off()
    for axis, name in zip(axes.flat, names, strict=False):
        rows = [row for row in found[name] if row["count"] > 0]  # a logarithmic axis has no 0
        counts = [row["count"] for row in rows]
        for part, style in (("p50", "o-"), ("p99", "s-")):
            axis.plot(counts, [row["period_ms"][part] for row in rows], style, label=part)
        first = rows[0]["period_ms"]["p99"]
        axis.plot(counts, [first * count / counts[0] for count in counts], ":", color="grey", label="linear")
        axis.axhline(1e3 * PERIOD, color="firebrick", linewidth=0.8)
        axis.set(xscale="log", yscale="log", ylim=(1.0, 200.0), title=name)
        axis.set_xlabel(f"[{units[name]}]" if units[name] else "")
        axis.set_xticks(counts, [f"{count:g}" for count in counts], minor=False)
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8)
    for row in axes:
        row[0].set_ylabel("period [ms]")
    save_picture(figure, target)


VIEWERS = (0, 1, 5, 20)
VIEWER_SECONDS = 20.0  # of the run, for each number of viewers
VIEWERS_NAME = "viewers"


def viewer_rows() -> list[dict[str, Any]]:
    """Serve Experiment 1 and read its page with `VIEWERS` websocket clients; one row for each number."""
    rows = []
    with served("exp1") as twin:
        page.periods(twin, 3.0, 0)  # warm
        for viewers in VIEWERS:
            times, rate = page.periods(twin, VIEWER_SECONDS, viewers)
            row = {"count": viewers, "period_ms": spread(times), "stages_ms": {}}
            rows.append({**row, "kb_per_s_each": round(rate / 1000.0, 1), "factor": 1.0, "success": None})
    return rows
