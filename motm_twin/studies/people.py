"""`motm-twin bench people | tracker`: the robot among Temis and persons, and its tracks of them against the truth.

With the same seed, agents take the same paths unless something deflects them. So the effect of the robot on them is the
difference to a run in which they do not see it: contacts in the kinematic plant stop nobody.

Tracks (`perception/tracks.py`) are judged by CLEAR MOT (Bernardin and Stiefelhagen, 2008) with `motmetrics` (extra
"people"): MOTA counts misses, false positives and changes of identity, MOTP [m] is the mean distance of pairs
matched within 0.5 m. The truth of a scan is the agents within the map and 8 m of the lidar that move at 0.1 m/s or
more, and on which at least five beams end. Other agents are ignored: a track matched with one that stands, or is hardly
seen, does not count.
"""

import math
import time
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.optimize import linear_sum_assignment

from motm_twin.control.method import Method
from motm_twin.control.tick import Tick
from motm_twin.measures.interval import Interval, Sampler
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.names import hint
from motm_twin.model.plant import PERIOD, Scan, Truth
from motm_twin.model.scene import AGENT_MOVES, Scene
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.tracks import IDENTITY, VX, VY
from motm_twin.perf.period import timed
from motm_twin.perf.report import Sheet, load_average, machine, number, spread, write_report
from motm_twin.plants import make_plant, require_orca
from motm_twin.studies.oracle import NAME as ORACLE
from motm_twin.studies.oracle import oracle, require_known_future
from motm_twin.studies.pool import Kept, printed_outcomes
from motm_twin.studies.spec import Job, TrialSpec, jobs_of
from motm_twin.studies.statistics import proportion
from motm_twin.trial import run_scene
from motm_twin.twin import Twin

NAME = "people"
TITLE = "Among people: CrowdNav's circle and square, corridor, doorway, one who turns, a group, DynaBARN, Experiment 2"
TRIALS = 10
SEEDED = "{}"  # stands for the seed in a scene's name
Result = dict[str, Any]
Row = dict[str, tuple[float, float]]  # of each agent: position [m]
Track = dict[str, Array]  # of each agent: positions after every period [m], shape (n, 2)
WHO = ("robot", "agent", "both", "nobody")  # the one that made way


class Situation(msgspec.Struct, frozen=True):
    """A scene, or scenes made from seeds, with changes as in `TrialSpec`."""

    scene: str
    variant: str | None = None
    changes: dict[str, Any] = {}

    def spec(self, seed: int, method: str) -> TrialSpec:
        """The trial of a seed."""
        scene = self.scene.replace(SEEDED, str(seed))
        return TrialSpec(scene, self.variant, seed, method, changes=dict(self.changes))


QUICK = {"agents.*.speed": 0.8}
SITUATIONS: dict[str, Situation] = {
    **{f"{shape}{end}": Situation(f"{shape}:{{}}", variant)
       for shape in ("circle", "square") for end, variant in (("", "visible"), ("_invisible", "invisible"))},
    **{f"circle_{behaviour}": Situation("circle:{}", "visible", {"agents.*.behaviour": behaviour})
       for behaviour in ("social_force", "yield", "blind")},
    **{name: Situation("people", name) for name in ("corridor", "doorway", "turns", "group", "crossing")},
    **{f"dynabarn_{level}": Situation("dynabarn:{}", level) for level in ("easy", "medium", "hard")},
    "exp2": Situation("exp2", "random"),
    "exp2_blind": Situation("exp2", "blind"),
    "exp2_quick": Situation("exp2", "random", QUICK),
    "exp2_blind_quick": Situation("exp2", "blind", QUICK),
}  # fmt: skip


class Case(msgspec.Struct, frozen=True, kw_only=True):
    """One run."""

    situation: str
    job: Job  # for the oracle its spec names another method
    method: str


def cases(situations: Sequence[str], methods: Sequence[str], trials: int, first: int = 0) -> list[Case]:
    """All methods on seeds from the first on, of every situation.

    Raises ValueError (SceneError, MethodError) for unknown names.
    """
    for name in situations:
        if name not in SITUATIONS:
            raise ValueError(f"there is no situation {name!r}; {hint(name, SITUATIONS)}")
    if trials < 1 or first < 0:
        raise ValueError(f"{trials} trials from seed {first} on: at least 1 is needed, and no seed is below 0")
    named = [(name, seed, method) for name in situations for seed in range(first, first + trials) for method in methods]
    known = ((name, seed, FAST.name if method == ORACLE else method) for name, seed, method in named)
    jobs = jobs_of(SITUATIONS[name].spec(seed, method) for name, seed, method in known)
    for job, (_, _, method) in zip(jobs, named, strict=True):
        require_orca(job.scene)
        if method == ORACLE:
            require_known_future(job.scene)
    return [Case(situation=name, job=job, method=method) for (name, _, method), job in zip(named, jobs, strict=True)]


def meet(case: Case) -> Result:
    """Run one case: its measures, and the effect of the robot on the agents."""
    scene, rows = case.job.scene, []

    def on_tick(tick: Tick) -> None:
        assert tick.truth is not None
        rows.append(positions(tick.truth))

    report = run_scene(scene, on_tick=on_tick, method=method_of(case))
    measures, contacts = report["measures"], report["contacts"]
    people = measures["among_people"]
    return {
        "situation": case.situation, "method": case.method, "seed": scene.seed,
        "success": bool(report["success"] and not contacts), "time_s": report["time_s"],
        "placed": report["places_done"], "to_place": report["places_total"], "contacts": len(contacts),
        "contacts_base_moved_towards": sum(contact["base_moved_towards"] for contact in contacts),
        "contacts_caused_by_robot": report["contacts_caused_by_robot"], "cut_ins": len(measures["cut_ins"]),
        "near_misses": len(measures["near_misses"]),
        **{key: value for key, value in people.items() if key != "conflicts"},
        "made_way": {who: sum(one["made_way"] == who for one in people["conflicts"]) for who in WHO},
        **imposed(tracks(rows), alone(scene, len(rows))), "path_length_m": report["path_length_m"],
        "reason": report["reason"] or (f"contact with {contacts[0]['other']}" if contacts else ""),
        "state_hash": report["state_hash"],
    }  # fmt: skip


def method_of(case: Case) -> Method:
    """The method of a case; the oracle gets the future of the agents."""
    if case.method != ORACLE:
        return find_method(case.method)
    scene = case.job.scene
    later = alone(scene, round(scene.time_limit / PERIOD))
    start = np.array([agent.start[:2] for agent in scene.agents])
    return oracle(scene, np.concatenate([start[None], np.stack(list(later.values()), axis=1)]))


def positions(truth: Truth) -> Row:
    """Positions of all agents [m] by name."""
    return {body.name: body.position[:2] for body in truth.agents}


def tracks(rows: Sequence[Row]) -> Track:
    """One track for each agent, from its positions after every period."""
    return {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}


def alone(scene: Scene, periods: int) -> Track:
    """Tracks of the agents over ``periods`` periods if they do not see the robot."""
    agents = tuple(msgspec.structs.replace(agent, sees_robot=False) for agent in scene.agents)
    plant, rows = make_plant(msgspec.structs.replace(scene, agents=agents)), []
    for _ in range(periods):
        plant.step(PERIOD)
        rows.append(positions(plant.truth()))
    return tracks(rows)


def imposed(with_robot: Track, without: Track) -> dict[str, float]:
    """Effect of the robot on the agents, as means: additional path and change of velocity, and deviation.

    Change of velocity [m/s] is the sum of its steps from period to period; deviation [m] the mean distance between the
    two tracks at the same time.
    """
    found = {"imposed_path_m": [], "imposed_velocity_change_mps": [], "imposed_deviation_m": []}
    for name, track in with_robot.items():
        steps, before = np.diff(track, axis=0), np.diff(without[name], axis=0)
        found["imposed_path_m"].append(_length(steps) - _length(before))
        changes = (_length(np.diff(way, axis=0)) / PERIOD for way in (steps, before))
        found["imposed_velocity_change_mps"].append(next(changes) - next(changes))
        found["imposed_deviation_m"].append(float(np.hypot(*(track - without[name]).T).mean()))
    return {key: round(float(np.mean(values)), 4) if values else 0.0 for key, values in found.items()}


def _length(steps: Array) -> float:
    return float(np.hypot(*steps.T).sum())


def bench_people(
    situations: Sequence[str], methods: Sequence[str], trials: int | None, workers: int, out: Path, console: Console,
    first: int = 0,
) -> bool:  # fmt: skip
    """Run all cases without a stored result, print the table, write ``out/people.json``; True when all succeeded.

    Raises ValueError (SceneError, MethodError) for unknown names, and without the extra that a situation needs.
    """
    runs = cases(situations or tuple(SITUATIONS), methods or (FAST.name,), TRIALS if trials is None else trials, first)
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    results = printed_outcomes(
        meet, runs, workers, console, Kept(out / f"{NAME}.jsonl"),
        lambda case: f"{case.situation} seed {case.job.scene.seed} {case.method}",
        lambda one: f"{one['time_s']:.1f} s" if one["success"] else f"NO: {one['reason']}",
    )  # fmt: skip
    rows = summaries(results)
    console.print(SHEET.table(rows))
    target = write_report(out, NAME, TITLE, rows=results, whole=rows, load_average=load_average(console))
    console.print(f"{machine()}, {workers} processes; written to {target}", markup=False)
    return len(results) == len(runs) and all(result["success"] for result in results)


def summaries(results: Sequence[Result]) -> list[Result]:
    """One row for each situation and method: shares, sums, means, and least values."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result["situation"], result["method"]), []).append(result)
    return [_summary(situation, method, of) for (situation, method), of in groups.items()]


SUMS = ("contacts", "contacts_base_moved_towards", "contacts_caused_by_robot", "cut_ins", "near_misses")
MEANS = ("discomfort_s", "freezing_s", "imposed_path_m", "imposed_velocity_change_mps", "imposed_deviation_m")
LEAST = ("least_gap_m", "least_time_to_collision_s")


def _summary(situation: str, method: str, of: Sequence[Result]) -> Result:
    good = [one["time_s"] for one in of if one["success"]]
    share = proportion(len(good), len(of))
    to_place = sum(one["to_place"] for one in of)
    return {
        "situation": situation,
        "method": method,
        "trials": len(of),
        "success_percent": round(100.0 * len(good) / len(of), 1),
        "success_interval_percent": [round(100.0 * share.low, 1), round(100.0 * share.high, 1)],
        "placed_percent": round(100.0 * sum(one["placed"] for one in of) / to_place, 1) if to_place else None,
        "time_s": round(float(np.mean(good)), 2) if good else None,
        **{key: sum(one[key] for one in of) for key in SUMS},
        **{key: round(float(np.mean([one[key] for one in of])), 3) for key in MEANS},
        **{key: min((one[key] for one in of if one[key] is not None), default=None) for key in LEAST},
        "made_way": {who: sum(one["made_way"][who] for one in of) for who in WHO},
    }


SHEET = Sheet(  # of the summaries
    head=(
        "situation", "method", "n", "ok %", "time s", "hits", "towards", "caused", "cut-ins", "near", "gap m", "ttc s",
        "uneasy s", "path m", "dv m/s", "off m", "way r/a/b/n", "frozen s", "placed %",
    ),
    texts=("situation", "method"),
    cells=lambda row: (
        row["situation"], row["method"], str(row["trials"]), f"{row['success_percent']:g}", number(row["time_s"], 1),
        *(str(row[key]) for key in SUMS), number(row["least_gap_m"], 2), number(row["least_time_to_collision_s"], 2),
        f"{row['discomfort_s']:.2f}", f"{row['imposed_path_m']:.2f}", f"{row['imposed_velocity_change_mps']:.2f}",
        f"{row['imposed_deviation_m']:.2f}", "/".join(map(str, row["made_way"].values())),
        f"{row['freezing_s']:.1f}", number(row["placed_percent"], 1),
    ),
)  # fmt: skip


TRACKER = "tracker"
TRACKER_TITLE = "Tracks of dynamic obstacles against the truth: MOTA, MOTP, changes of identity, time per scan"
TRACKED = ("exp2", "circle", "circle_invisible", "square", "corridor", "crossing")  # by default
TRACKER_RUNS = 2
GATE = 0.5  # [m] within which a track is matched with an agent
WARM_UP = 20  # scans that are not timed
LEAST_BEAMS = 5  # on an agent that can be tracked: seven hit a radius of 0.25 m at 8 m
ON_BODY = 0.06  # [m] between beam end and outline: 3 sd of a range, and an agent's motion in half a scan
COUNTS = ("num_objects", "num_misses", "num_false_positives", "num_switches", "num_fragmentations")


def require_motmetrics() -> None:
    """Raise ValueError if motmetrics is not installed."""
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
    """True when an agent belongs to the truth of the scan at the start of an interval."""
    start, scan, body = interval.start, interval.tick.observation.scan, interval.start.agents[name]
    x_min, y_min, x_max, y_max = scene.bounds
    inside = x_min <= body[0] <= x_max and y_min <= body[1] <= y_max
    near = math.hypot(body[0] - start.pose[0], body[1] - start.pose[1]) <= MapSettings().lidar_reach
    moves = math.hypot(*interval.velocity(name)) >= AGENT_MOVES
    return inside and near and moves and scan is not None and beams_on(scan, start.pose, body) >= LEAST_BEAMS


def matched(these: Array, those: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Index pairs within the gate of points (n, 2) and (m, 2): most pairs, then least distance."""
    distances = np.hypot(*(these[:, None] - those[None]).transpose(2, 0, 1))
    rows, columns = linear_sum_assignment(np.where(distances <= GATE, distances, 1e3))
    good = distances[rows, columns] <= GATE
    return rows[good], columns[good]


class Score:
    """Compares the tracks of every scan with the truth."""

    def __init__(self, scene: Scene) -> None:
        """``scene``: the scene with the agents. Raises ValueError if motmetrics is not installed."""
        require_motmetrics()
        self._metrics: Any = import_module("motmetrics")
        self._scene, self._sampler = scene, Sampler(scene)
        self._known = self._metrics.MOTAccumulator(auto_id=True)
        self._numbers = {agent.name: number for number, agent in enumerate(scene.agents)}
        self.speed_errors: list[float] = []  # [m/s] of the velocities of matched tracks

    def add(self, tick: Tick) -> None:
        """Take the next Tick into account: it gives the motion by which the Tick before is judged."""
        interval = self._sampler.interval(tick)
        if interval is not None:
            self._judge(interval)

    def _judge(self, interval: Interval) -> None:
        start, world = interval.start, interval.tick.map
        names = [name for name in start.agents if can_be_tracked(self._scene, interval, name)]
        tracks = world.tracks
        everybody, every = list(start.agents), np.array([body[:2] for body in start.agents.values()]).reshape(-1, 2)
        pairs = zip(*matched(every, tracks[:, :2]), strict=True)
        ignored = [column for row, column in pairs if everybody[row] not in names]  # tracks of agents outside the truth
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


def bench_tracker(situations: Sequence[str], trials: int | None, workers: int, out: Path, console: Console) -> bool:
    """Score the tracker, print the table, write ``out/tracker.json``; False when a run was lost.

    Raises ValueError (SceneError) for unknown names, and without the extra.
    """
    require_motmetrics()
    runs = cases(situations or TRACKED, (FAST.name,), TRACKER_RUNS if trials is None else trials)
    console.print(f"\n[bold]{TRACKER}[/bold]: {TRACKER_TITLE}")
    results = printed_outcomes(
        follow, runs, workers, console, Kept(out / f"{TRACKER}.jsonl"),
        lambda case: f"{case.situation} seed {case.job.scene.seed}",
        lambda one: f"MOTA {one['mota']:.3f}",
    )  # fmt: skip
    order = dict.fromkeys(one["situation"] for one in results)
    rows = [_tracker_summary(name, [one for one in results if one["situation"] == name]) for name in order]
    rows += [_tracker_summary("all", results)] if results else []
    console.print(TRACKER_SHEET.table(rows))
    target = write_report(
        out, TRACKER, TRACKER_TITLE, rows=[{**one, "scan_ms": spread(one["scan_ms"])} for one in results], whole=rows,
        load_average=load_average(console),
    )  # fmt: skip
    console.print(f"{machine()}, {workers} processes; written to {target}", markup=False)
    return len(results) == len(runs)


def _tracker_summary(name: str, of: Sequence[Result]) -> Result:
    """All scans of some runs together: MOTA from their sums, MOTP weighted by matches."""
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


TRACKER_SHEET = Sheet(  # of the summaries
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
