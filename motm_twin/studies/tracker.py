"""`motm-twin bench tracker`: tracks and movers of the map against the simulator's truth, by the field's metrics.

CLEAR MOT (Bernardin and Stiefelhagen, 2008) by `motmetrics` (extra "people"): MOTA counts misses, false positives and
changes of identity, MOTP [m] is the mean distance of what was matched within 0.5 m.

Truth of a scan are the agents within the map and 8 m of the lidar that move at 0.1 m/s or more, on which five beams end
or more. Other agents are ignored: what is matched with one that stands, or is hardly seen, counts neither way.
"""

import math
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.optimize import linear_sum_assignment

from motm_twin.control.tick import Tick
from motm_twin.measures.agents import AGENT_MOVES
from motm_twin.measures.interval import Interval, Sample, Sampler
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.plant import Scan
from motm_twin.model.scene import Scene
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.tracks import IDENTITY
from motm_twin.perception.world_map import WorldMap
from motm_twin.perf.report import grid, load_average, machine, number, spread, write_report
from motm_twin.studies.people import Case, cases
from motm_twin.studies.pool import Lost, local_pool, outcomes
from motm_twin.twin import Twin

NAME = "tracker"
TITLE = "Tracks and movers of the map against the truth: MOTA, MOTP, changes of identity, time per scan"
SITUATIONS = ("exp2", "circle", "circle_invisible", "square", "corridor", "crossing")  # unless said
TRIALS = 2
ALL = "all"
GATE = 0.5  # [m] within which an obstacle of the map is matched with an agent
LEAST_BEAMS = 5  # that end on an agent which can be tracked: 0.25 m of radius at 8 m have seven
ON_BODY = 0.06  # [m] of the end of a beam from the outline: 3 sd of a range, and what an agent moves in half a scan
COUNTS = ("num_objects", "num_misses", "num_false_positives", "num_switches", "num_fragmentations")
Result = dict[str, Any]


def require_motmetrics() -> None:
    """Raise ValueError without motmetrics."""
    if find_spec("motmetrics") is None:
        raise ValueError('bench tracker needs motmetrics: pip install "motm_twin[people]"')


def beams_on(scan: Scan, pose: Array, body: tuple[float, float, float]) -> int:
    """Beams of a scan from a true pose (3,) that end on the outline of a disc x, y, radius [m]."""
    seen = np.isfinite(scan.ranges)
    angles = scan.angle_min + scan.angle_step * np.flatnonzero(seen)
    ends = scan.origin + scan.ranges[seen, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    x, y, radius = body
    off = np.abs(np.hypot(*(from_frame(pose, ends) - (x, y)).T) - radius)
    return int(np.count_nonzero(off <= ON_BODY))


def can_be_tracked(scene: Scene, interval: Interval, name: str) -> bool:
    """An agent belongs to the truth of the scan at the start of an interval."""
    start, scan, body = interval.start, interval.tick.observation.scan, interval.start.agents[name]
    x_min, y_min, x_max, y_max = scene.bounds
    inside = x_min <= body[0] <= x_max and y_min <= body[1] <= y_max
    near = math.hypot(body[0] - start.pose[0], body[1] - start.pose[1]) <= MapSettings().lidar_reach
    moves = math.hypot(*interval.velocity(name)) >= AGENT_MOVES
    return inside and near and moves and scan is not None and beams_on(scan, start.pose, body) >= LEAST_BEAMS


Found = tuple[Array, NDArray[np.int64]]  # x, y [m] and velocity [m/s] of obstacles, shape (k, 4), and their numbers


class Tracks:
    """The tracks of a map."""

    part, verb = "tracks", "update"  # of the loop, and of that part: what makes them

    def of(self, world: WorldMap) -> Found:
        """Places, velocities and numbers."""
        return world.tracks[:, :4], world.tracks[:, IDENTITY].astype(np.int64)


class Movers:
    """The movers of a map, which have no numbers: each goes on as the nearest within 0.5 m of where it was."""

    part, verb = "movers", "sort"

    def __init__(self) -> None:
        """Nothing is known yet."""
        self._known: dict[int, Array] = {}
        self._next = 0

    def of(self, world: WorldMap) -> Found:
        """Places, velocities and numbers."""
        movers, numbers = world.movers, np.full(len(world.movers), -1, dtype=np.int64)
        known = list(self._known)
        rows, columns = matched(np.array([self._known[one] for one in known]).reshape(-1, 2), movers[:, :2])
        numbers[columns] = np.array(known, dtype=np.int64)[rows]
        for index in np.flatnonzero(numbers < 0):
            numbers[index], self._next = self._next, self._next + 1
        self._known = {int(one): mover[:2] for one, mover in zip(numbers, movers, strict=True)}
        return movers[:, :4], numbers


TRACKERS: dict[str, type[Tracks] | type[Movers]] = {"tracks": Tracks, "movers": Movers}


def matched(these: Array, those: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs within the gate, by index, of points (n, 2) and (m, 2): most pairs, then least distance."""
    distances = np.hypot(*(these[:, None] - those[None]).transpose(2, 0, 1))
    rows, columns = linear_sum_assignment(np.where(distances <= GATE, distances, 1e3))
    good = distances[rows, columns] <= GATE
    return rows[good], columns[good]


class Score:
    """Compares the obstacles of every scan with the truth."""

    def __init__(self, scene: Scene, tracker: Tracks | Movers) -> None:
        """The scene with the agents, and whose obstacles are scored. Raises ValueError without motmetrics."""
        require_motmetrics()
        self._metrics: Any = import_module("motmetrics")
        self._scene, self._sampler, self._tracker = scene, Sampler(scene), tracker
        self._known = self._metrics.MOTAccumulator(auto_id=True)
        self._numbers = {agent.name: number for number, agent in enumerate(scene.agents)}
        self.speed_errors: list[float] = []  # [m/s] of velocities of what was matched

    def add(self, tick: Tick) -> None:
        """Take the next Tick into account: the one before is judged, whose motion is known now."""
        interval = self._sampler.interval(tick)
        if interval is not None:
            self._judge(interval)

    def _judge(self, interval: Interval) -> None:
        start, world = interval.start, interval.tick.map
        names = [name for name in start.agents if can_be_tracked(self._scene, interval, name)]
        movers, numbers = self._tracker.of(world)
        kept = self._without_ignored(start, names, movers)
        places = np.array([start.agents[name][:2] for name in names]).reshape(-1, 2)
        distances = np.hypot(*(places[:, None] - movers[None, kept, :2]).transpose(2, 0, 1))
        distances[distances > GATE] = np.nan
        self._known.update([self._numbers[name] for name in names], numbers[kept].tolist(), distances)
        for row, column in zip(*matched(places, movers[kept, :2]), strict=True):
            off = movers[kept][column, 2:4] - interval.velocity(names[row])
            self.speed_errors.append(float(np.hypot(*off)))

    @staticmethod
    def _without_ignored(start: Sample, names: Sequence[str], movers: Array) -> NDArray[np.int64]:
        """Movers that are not those of agents outside the truth, by index."""
        everybody = list(start.agents)
        places = np.array([start.agents[name][:2] for name in everybody]).reshape(-1, 2)
        rows, columns = matched(places, movers[:, :2])
        ignored = [column for row, column in zip(rows, columns, strict=True) if everybody[row] not in names]
        return np.setdiff1d(np.arange(len(movers)), ignored)

    def report(self) -> Result:
        """MOTA, MOTP [m], IDF1 and counts of the scans so far."""
        names = ["num_frames", "mota", "motp", "idf1", *COUNTS]
        found = self._metrics.metrics.create().compute(self._known, metrics=names, return_dataframe=False)
        return {name: float(value) for name, value in found.items()}


class Timed:
    """A part of which every call of one verb is timed, by processor time."""

    def __init__(self, part: Any, verb: str) -> None:
        """The part of a loop, which it takes the place of."""
        self._part, self.ms = part, []
        setattr(self, verb, self._timed(getattr(part, verb)))

    def _timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            began = time.thread_time()
            found = call(*arguments)
            self.ms.append(1e3 * (time.thread_time() - began))
            return found

        return timed

    def __getattr__(self, name: str) -> Any:
        return getattr(self._part, name)


def follow(case: Case) -> list[Result]:
    """Run one case and score its trackers."""
    scene = case.job.scene
    twin = Twin(scene, method=find_method(case.job.spec.method))
    trackers = {name: kind() for name, kind in TRACKERS.items()}
    scores = {name: Score(scene, tracker) for name, tracker in trackers.items()}
    timed = {name: Timed(getattr(twin.loop, one.part), one.verb) for name, one in trackers.items()}
    for name, one in trackers.items():
        setattr(twin.loop, one.part, timed[name])
    while True:
        tick = twin.advance()
        for score in scores.values():
            score.add(tick)
        if tick.done or tick.time >= scene.time_limit:
            break
    return [
        {
            "situation": case.situation,
            "seed": scene.seed,
            "tracker": name,
            **score.report(),
            "speed_error_mps": float(np.mean(score.speed_errors)) if score.speed_errors else None,
            "scan_ms": timed[name].ms[WARM_UP:] or timed[name].ms,
        }
        for name, score in scores.items()
    ]


WARM_UP = 20  # scans that are not timed


def bench_tracker(situations: Sequence[str], trials: int | None, workers: int, out: Path, console: Console) -> bool:
    """Score the tracker, print the table, write ``out/tracker.json``; False when a run was lost.

    Raises ValueError (SceneError) for names that are none, and without the extra.
    """
    require_motmetrics()
    runs = cases(situations or SITUATIONS, (FAST.name,), TRIALS if trials is None else trials)
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    results: list[Result] = []
    for done, (index, outcome) in enumerate(outcomes(follow, runs, local_pool(workers)), 1):
        about = f"  {done}/{len(runs)} {runs[index].situation} seed {runs[index].job.scene.seed}"
        if isinstance(outcome, Lost):
            console.print(f"{about}: lost, {outcome.reason}", style="red", markup=False)
            continue
        results += outcome
        said = ", ".join(f"{one['tracker']} {one['mota']:.3f}" for one in outcome)
        console.print(f"{about}: MOTA {said}", markup=False)
    order = list(dict.fromkeys(case.situation for case in runs))
    results.sort(key=lambda one: (order.index(one["situation"]), one["seed"]))
    rows = [_summary(name, tracker, results) for tracker in TRACKERS for name in (*order, ALL)]
    console.print(table(rows))
    target = write_report(
        out, NAME, TITLE, rows=[{**one, "scan_ms": spread(one["scan_ms"])} for one in results], whole=rows,
        load_average=load_average(console),
    )  # fmt: skip
    console.print(f"{machine()}, {workers} processes; written to {target}", markup=False)
    return len(results) == len(runs) * len(TRACKERS)


def _summary(name: str, tracker: str, results: Sequence[Result]) -> Result:
    """All scans of a situation together: MOTA of their sums, MOTP by matches."""
    of = [one for one in results if one["tracker"] == tracker and name in (ALL, one["situation"])]
    sums = {key: sum(one[key] for one in of) for key in (*COUNTS, "num_frames")}
    matches = [one["num_objects"] - one["num_misses"] for one in of]
    wrong = sums["num_misses"] + sums["num_false_positives"] + sums["num_switches"]
    speeds = [one["speed_error_mps"] for one in of if one["speed_error_mps"] is not None]
    weighted = sum(one["motp"] * count for one, count in zip(of, matches, strict=True) if count)
    return {
        "situation": name,
        "tracker": tracker,
        "runs": len(of),
        **sums,
        "mota": 1.0 - wrong / sums["num_objects"] if sums["num_objects"] else None,
        "motp": weighted / sum(matches) if sum(matches) else None,
        "speed_error_mps": float(np.mean(speeds)) if speeds else None,
        "scan_ms": spread([value for one in of for value in one["scan_ms"]]),
    }


def table(rows: Sequence[Result]) -> Table:
    """The summaries as they are printed."""
    names = (
        "situation", "tracker", "runs", "scans", "seen", "MOTA", "MOTP m", "misses", "false", "switches", "fragments",
        "dv m/s", "p50 ms", "p99", "max",
    )  # fmt: skip
    made = grid(*names, texts=names[:2])
    for row in rows:
        made.add_row(
            row["situation"], row["tracker"], str(row["runs"]), f"{row['num_frames']:.0f}", f"{row['num_objects']:.0f}",
            number(row["mota"], 3), number(row["motp"], 3), f"{row['num_misses']:.0f}",
            f"{row['num_false_positives']:.0f}", f"{row['num_switches']:.0f}", f"{row['num_fragmentations']:.0f}",
            number(row["speed_error_mps"], 3), *(f"{value:.2f}" for value in row["scan_ms"].values()),
        )  # fmt: skip
    return made
