"""One trial in a worker: run it, keep what a clock measured apart, and keep a session of what went wrong."""

import time
import traceback
from pathlib import Path
from typing import Any

import msgspec

from motm_twin.control.tick import Tick
from motm_twin.control.tuning import parameter
from motm_twin.methods.registry import find_method
from motm_twin.perf.report import machine
from motm_twin.sessions.made_with import SOURCE, made_with
from motm_twin.sessions.session import Session
from motm_twin.studies.spec import Job, method_of, with_numbers

WALL = ("tick_ms", "realtime_factor")  # measured by a clock: differ from run to run
PERIODS_PER_S = 20
MACHINE = "machine"  # key of where a trial was run, beside what it was made with


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a trial as a worker sends it."""

    result: dict[str, Any]
    made_with: dict[str, str]  # what the worker ran it with
    session: Session | None  # of a trial without success

    @property
    def source(self) -> str:
        """Hash of the source that the worker had."""
        return self.made_with[SOURCE]


def run_job(job: Job) -> Outcome:
    """Run a trial to its end; never raises for what goes wrong inside it."""
    from motm_twin.trial import run_scene  # the whole twin: only where a trial is run

    periods = 0

    def on_tick(tick: Tick) -> None:
        nonlocal periods
        periods = tick.index + 1

    began = time.perf_counter()
    try:
        numbers = with_numbers(find_method(job.spec.method), job.spec.numbers) if job.spec.numbers else None
        result = run_scene(
            job.scene, on_tick=on_tick, method=method_of(job), parameters=dict(job.spec.parameters), numbers=numbers
        )
    except Exception as error:  # whatever broke in one trial, the others are still worth a table
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        result = broken(job, reason, time_s=periods / PERIODS_PER_S)
    result = parted(job, result, time.perf_counter() - began)
    repeats = not job.spec.numbers  # a session has no others than named parameters
    session = None if result["success"] or not repeats else session_of(job, periods, result.get("state_hash", ""))
    return Outcome(result=result, made_with={**made_with(), MACHINE: machine()}, session=session)


def given_up(job: Job, reason: str, source: str) -> Outcome:
    """The outcome of a trial whose process died: its session is as long as the scene allows, without a hash."""
    periods = round(job.scene.time_limit * PERIODS_PER_S)
    return Outcome(
        result=parted(job, broken(job, reason), 0.0),
        made_with={**made_with(), SOURCE: source, MACHINE: machine()},
        session=None if job.spec.numbers else session_of(job, periods, ""),
    )


def parted(job: Job, result: dict[str, Any], seconds: float) -> dict[str, Any]:
    """A result with its spec, and what a clock measured in a part of its own."""
    rest = {key: value for key, value in result.items() if key not in WALL}
    wall = {key: result[key] for key in WALL if key in result}
    spec = job.spec
    given = {"parameters": dict(spec.parameters), "changes": dict(spec.changes), "numbers": dict(spec.numbers)}
    return {**rest, "method": spec.method, **given, "wall": {**wall, "seconds": round(seconds, 3)}}


def session_of(job: Job, periods: int, state_hash: str) -> Session:
    """A session with which `motm-twin rerun` repeats the trial."""
    method = method_of(job)
    start = {**method.parameters, **job.spec.parameters}
    return Session(
        title=f"{job.scene.title}, {job.spec.method}",
        scene=job.scene,
        method=method.name,
        parameters={name: value for name, value in start.items() if value != parameter(name).default},
        periods=periods,
        state_hash=state_hash,
    )


def broken(job: Job, reason: str, *, time_s: float = 0.0) -> dict[str, Any]:
    """The result of a trial that gave none."""
    picks = sum(type(task).__name__ == "Pick" for task in job.scene.tasks)
    return {
        "scene": job.scene.name,
        "variant": job.scene.variant,
        "seed": job.scene.seed,
        "success": False,
        "time_s": time_s,
        "reference_tour_s": None,
        "picks_done": 0,
        "picks_attempted": 0,
        "picks_total": picks,
        "places_done": 0,
        "places_total": picks,
        "drops": 0,
        "dropped": [],
        "contacts": [],
        "contacts_caused_by_robot": 0,
        "cut_ins": [],
        "min_base_clearance_m": None,
        "min_arm_clearance_m": None,
        "min_ee_obstacle_m": None,
        "path_length_m": 0.0,
        "mean_closing_base_speed_mps": None,
        "encounters": 0,
        "plant_faults": [],
        "reason": reason,
        "state_hash": "",
        "measures": None,
    }
