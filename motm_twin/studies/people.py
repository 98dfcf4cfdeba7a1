"""`motm-twin bench people`: the robot among Temis and persons, by situation and method.

Agents go the same ways with the same seed as long as nobody makes them change, so what the robot imposes on them is the
difference to a run in which they do not see it: contacts of the kinematic plant stop nobody.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console

from motm_twin.control.method import Method
from motm_twin.control.tick import Tick
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.geometry import Array
from motm_twin.model.names import hint
from motm_twin.model.plant import PERIOD, Truth
from motm_twin.model.scene import Scene
from motm_twin.perf.report import Sheet, load_average, machine, number, write_report
from motm_twin.plants import make_plant, require_people
from motm_twin.studies.oracle import NAME as ORACLE
from motm_twin.studies.oracle import oracle, require_known_future
from motm_twin.studies.pool import told_outcomes
from motm_twin.studies.spec import Job, TrialSpec, jobs_of
from motm_twin.studies.statistics import proportion
from motm_twin.trial import run_scene

NAME = "people"
TITLE = "Among people: CrowdNav's circle and square, corridor, doorway, one who turns, a group, DynaBARN, Experiment 2"
TRIALS = 10
SEEDED = "{}"  # stands for the seed in a scene's name
Result = dict[str, Any]
Row = dict[str, tuple[float, float]]  # of each agent: position [m]
Track = dict[str, Array]  # of each agent: positions after every period [m], shape (n, 2)
WHO = ("robot", "agent", "both", "nobody")  # made way


class Situation(msgspec.Struct, frozen=True):
    """A scene, or scenes from seeds, with changes of `TrialSpec`."""

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
    job: Job  # for the oracle with another method
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
        require_people(job.scene)
        if method == ORACLE:
            require_known_future(job.scene)
    return [Case(situation=name, job=job, method=method) for (name, _, method), job in zip(named, jobs, strict=True)]


def meet(case: Case) -> Result:
    """Run one case: its measures, and what the robot imposes on the agents."""
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
    """The method; the oracle is told the future of the agents."""
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
    """Tracks of the agents that do not see the robot, over so many periods."""
    agents = tuple(msgspec.structs.replace(agent, sees_robot=False) for agent in scene.agents)
    plant, rows = make_plant(msgspec.structs.replace(scene, agents=agents)), []
    for _ in range(periods):
        plant.step(PERIOD)
        rows.append(positions(plant.truth()))
    return tracks(rows)


def imposed(with_robot: Track, without: Track) -> dict[str, float]:
    """Mean over the agents of what the robot made of their ways: more path, more change of velocity, and how far off.

    Change of velocity [m/s] is the sum of its steps from period to period; deviation [m] the mean distance between the
    two ways at the same time.
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
    """Run all cases, print the table, write ``out/people.json``; True when all succeeded.

    Raises ValueError (SceneError, MethodError) for names that are none, and without the extra that a situation needs.
    """
    runs = cases(situations or tuple(SITUATIONS), methods or (FAST.name,), TRIALS if trials is None else trials, first)
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    results = told_outcomes(
        meet, runs, workers, console,
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
