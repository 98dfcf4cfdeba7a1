"""`motm-twin bench tracker`: tracks (`perception/tracks.py`) against the simulator's truth, by the field's metrics.

CLEAR MOT (Bernardin and Stiefelhagen, 2008) by `motmetrics` (extra "people"): MOTA counts misses, false positives and
changes of identity, MOTP [m] is the mean distance of what was matched within 0.5 m.

Truth of a scan are the agents within the map and 8 m of the lidar that move at 0.1 m/s or more, on which five beams end
or more. Other agents are ignored: what is matched with one that stands, or is hardly seen, counts neither way.
"""

import math
import time
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.optimize import linear_sum_assignment

from motm_twin.control.tick import Tick
from motm_twin.measures.interval import Interval, Sampler
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.plant import Scan
from motm_twin.model.scene import AGENT_MOVES, Scene
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.tracks import IDENTITY, VX, VY
from motm_twin.perf.period import timed
from motm_twin.perf.report import Sheet, load_average, machine, number, spread, write_report
from motm_twin.studies.people import Case, cases
from motm_twin.studies.pool import told_outcomes
from motm_twin.twin import Twin

NAME = "tracker"
TITLE = "Tracks of dynamic obstacles against the truth: MOTA, MOTP, changes of identity, time per scan"
SITUATIONS = ("exp2", "circle", "circle_invisible", "square", "corridor", "crossing")  # unless said
TRIALS = 2
GATE = 0.5  # [m] within which a track is matched with an agent
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


def matched(these: Array, those: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs within the gate, by index, of points (n, 2) and (m, 2): most pairs, then least distance."""
    distances = np.hypot(*(these[:, None] - those[None]).transpose(2, 0, 1))
    rows, columns = linear_sum_assignment(np.where(distances <= GATE, distances, 1e3))
    good = distances[rows, columns] <= GATE
    return rows[good], columns[good]


class Score:
    """Compares the tracks of every scan with the truth."""

    def __init__(self, scene: Scene) -> None:
        """The scene with the agents. Raises ValueError without motmetrics."""
        require_motmetrics()
        self._metrics: Any = import_module("motmetrics")
        self._scene, self._sampler = scene, Sampler(scene)
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
        tracks = world.tracks
        everybody, every = list(start.agents), np.array([body[:2] for body in start.agents.values()]).reshape(-1, 2)
        pairs = zip(*matched(every, tracks[:, :2]), strict=True)
        ignored = [column for row, column in pairs if everybody[row] not in names]  # of agents outside the truth
        kept = np.setdiff1d(np.arange(len(tracks)), ignored)
        places = np.array([start.agents[name][:2] for name in names]).reshape(-1, 2)
        distances = np.hypot(*(places[:, None] - tracks[None, kept, :2]).transpose(2, 0, 1))
        distances[distances > GATE] = np.nan
        self._known.update([self._numbers[name] for name in names], tracks[kept, IDENTITY].tolist(), distances)
        for row, column in zip(*matched(places, tracks[kept, :2]), strict=True):
            off = tracks[kept][column, VX : VY + 1] - interval.velocity(names[row])
            self.speed_errors.append(float(np.hypot(*off)))

    def report(self) -> Result:
        """MOTA, MOTP [m], IDF1 and counts of the scans so far."""
        names = ["num_frames", "mota", "motp", "idf1", *COUNTS]
        found = self._metrics.metrics.create().compute(self._known, metrics=names, return_dataframe=False)
        return {name: float(value) for name, value in found.items()}


def follow(case: Case) -> Result:
    """Run one case and score its tracker."""
    scene = case.job.scene
    twin, score = Twin(scene, method=find_method(case.job.spec.method)), Score(scene)
    scan_ms: list[float] = []
    tracks: Any = twin.loop.tracks
    tracks.update = timed(tracks.update, time.thread_time, lambda spent: scan_ms.append(1e3 * spent))
    for tick in twin.ticks():
        score.add(tick)
    return {
        "situation": case.situation,
        "seed": scene.seed,
        **score.report(),
        "speed_error_mps": float(np.mean(score.speed_errors)) if score.speed_errors else None,
        "scan_ms": scan_ms[WARM_UP:] or scan_ms,
    }


WARM_UP = 20  # scans that are not timed


def bench_tracker(situations: Sequence[str], trials: int | None, workers: int, out: Path, console: Console) -> bool:
    """Score the tracker, print the table, write ``out/tracker.json``; False when a run was lost.

    Raises ValueError (SceneError) for names that are none, and without the extra.
    """
    require_motmetrics()
    runs = cases(situations or SITUATIONS, (FAST.name,), TRIALS if trials is None else trials)
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    results = told_outcomes(
        follow, runs, workers, console,
        lambda case: f"{case.situation} seed {case.job.scene.seed}",
        lambda one: f"MOTA {one['mota']:.3f}",
    )  # fmt: skip
    order = dict.fromkeys(one["situation"] for one in results)
    rows = [_summary(name, [one for one in results if one["situation"] == name]) for name in order]
    rows += [_summary("all", results)] if results else []
    console.print(SHEET.table(rows))
    target = write_report(
        out, NAME, TITLE, rows=[{**one, "scan_ms": spread(one["scan_ms"])} for one in results], whole=rows,
        load_average=load_average(console),
    )  # fmt: skip
    console.print(f"{machine()}, {workers} processes; written to {target}", markup=False)
    return len(results) == len(runs)


def _summary(name: str, of: Sequence[Result]) -> Result:
    """All scans of some runs together: MOTA of their sums, MOTP by matches."""
    sums = {key: sum(one[key] for one in of) for key in (*COUNTS, "num_frames")}
    matches = [one["num_objects"] - one["num_misses"] for one in of]
    wrong = sums["num_misses"] + sums["num_false_positives"] + sums["num_switches"]
    speeds = [one["speed_error_mps"] for one in of if one["speed_error_mps"] is not None]
    weighted = sum(one["motp"] * count for one, count in zip(of, matches, strict=True) if count)
    return {
        "situation": name,
        "runs": len(of),
        **sums,
        "mota": 1.0 - wrong / sums["num_objects"] if sums["num_objects"] else None,
        "motp": weighted / sum(matches) if sum(matches) else None,
        "speed_error_mps": float(np.mean(speeds)) if speeds else None,
        "scan_ms": spread([value for one in of for value in one["scan_ms"]]),
    }


SHEET = Sheet(  # of the summaries
    head=(
        "situation", "runs", "scans", "seen", "MOTA", "MOTP m", "misses", "false", "switches", "fragments", "dv m/s",
        "p50 ms", "p99", "max",
    ),
    cells=lambda row: (
        row["situation"], str(row["runs"]), f"{row['num_frames']:.0f}", f"{row['num_objects']:.0f}",
        number(row["mota"], 3), number(row["motp"], 3), *(f"{row[name]:.0f}" for name in COUNTS[1:]),
        number(row["speed_error_mps"], 3), *(f"{value:.2f}" for value in row["scan_ms"].values()),
    ),
)  # fmt: skip
