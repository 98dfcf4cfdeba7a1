"""Cost of a control period by stage, alone on one core; the QP solvers compared; the search as an anytime algorithm.

The last measures task time against the search's limit of expansions, and against a limit of processor time. Results in
``out/anytime.json`` are not measured again if they are of the same method and sources.
"""

import gc
import itertools
import json
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.control.arm import controller, qp
from motm_twin.control.arm.parameters import ArmParameters, QpParameters
from motm_twin.control.arm.qp import SOLVERS, Program
from motm_twin.control.method import Method
from motm_twin.control.parameters import Parameters
from motm_twin.methods.registry import FAST, MOTM
from motm_twin.model.plant import PERIOD
from motm_twin.model.scene import DriveTo, Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.perf import report
from motm_twin.perf.report import Wanted, grid, load_average, machine, save_picture, spread, write
from motm_twin.planning.types import SearchBudget
from motm_twin.server_process import SEARCH_SECONDS
from motm_twin.sessions.session import made_with
from motm_twin.twin import Twin

NAME = "period_cost"
TITLE = "What a period costs, alone on one core, kernels compiled"
METHODS = (FAST, MOTM)  # the first, the default method, is judged
SCENES = (("exp1", "trial1"), ("exp2", "random"))
STAGES = ("map", "place", "plan", "arm", "monitor", "period")
CLOCKS = {"": time.perf_counter, ", processor": time.thread_time}  # by the suffix of the method's name
WARM_UP = 60  # periods that are not counted
SOAK = 1000.0  # [s] of simulated time in which memory must stay flat
EARLY = 0.1  # share of that time after which memory is compared
MARGIN_MB = 2.0  # [MB] by which the allocator may grow in steps


WANTED = (
    *(Wanted(key=f"{scene} {part}", name=f"{scene}, period {part}", unit="ms", least=least, best=best)
      for scene in ("exp1", "exp2")
      for part, least, best in (("p50", 6.0, 3.0), ("p99", 15.0, 8.0), ("max", 30.0, 15.0))),
    *(Wanted(key=f"{scene} arm", name=f"{scene}, arm step p99", unit="ms", least=0.3, best=0.1, decimals=3)
      for scene in ("exp1", "exp2")),
    *(Wanted(key=f"{scene} factor", name=f"{scene}, simulated / real time", unit="x", least=7.0, best=15.0, more=True,
             decimals=1)
      for scene in ("exp1", "exp2")),
    Wanted(key="memory", name="memory gained in a long run", unit="MB", least=MARGIN_MB, best=MARGIN_MB, decimals=1),
    Wanted(key="start", name="start of `run` to first period", unit="s", least=2.0, best=1.2),
)  # fmt: skip


@dataclass
class Measured:
    """Times of one run with compiled kernels."""

    stages: dict[str, list[float]] = field(default_factory=lambda: {stage: [] for stage in STAGES})  # [ms] per period
    arm_steps: list[float] = field(default_factory=list)  # [ms] kinematics, QP and monitor
    factor: float = 0.0  # simulated / real time, referee included
    state_hash: str = ""

    def table(self) -> dict[str, dict[str, float]]:
        """p50, p99 and largest [ms] per stage."""
        return {stage: spread(times) for stage, times in (*self.stages.items(), ("arm step", self.arm_steps))}


def measured(
    scene: Scene,
    *,
    method: Method = FAST,
    periods: int | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Measured:
    """Run a scene to its end, or for ``periods``, with every stage and arm step timed by ``clock`` [s]."""
    twin = Twin(scene, method=method, clock=clock)
    found = Measured()
    steps = _timed_steps(twin, clock)
    began = time.perf_counter()
    for tick in twin.ticks():
        if twin.index > WARM_UP or periods is not None:
            for stage in STAGES:
                found.stages[stage].append(tick.stage_ms[stage])
            found.arm_steps += steps
        steps.clear()
        if twin.index == periods:
            break
    found.factor = twin.index * PERIOD / (time.perf_counter() - began)
    found.state_hash = twin.state_hash()
    return found


def _timed_steps(twin: Twin, clock: Callable[[], float]) -> list[float]:
    """A list to which every later arm step appends the time [ms] of the step and the monitor."""
    steps: list[float] = []
    loop = twin.loop

    def add(spent: float) -> None:
        steps[-1] += 1e3 * spent

    loop.manipulator.step = timed(loop.manipulator.step, clock, lambda spent: steps.append(1e3 * spent))  # type: ignore[method-assign]
    loop.monitor.check = timed(loop.monitor.check, clock, add)  # type: ignore[method-assign]
    return steps


def timed(call: Callable[..., Any], clock: Callable[[], float], note: Callable[[float], None]) -> Callable[..., Any]:
    """Wrap a function so that ``note`` gets the time [s] of each call."""

    def around(*given: Any, **named: Any) -> Any:
        began = clock()
        answer = call(*given, **named)
        note(clock() - began)
        return answer

    return around


STARTING = """
import time
from motm_twin import cli  # as the command does
from motm_twin.model.scene_file import load_scene
from motm_twin.trial import Twin

Twin(load_scene("exp1"), clock=time.perf_counter).advance()
print("first period", flush=True)
"""


def start_seconds() -> float:
    """Wall time [s] from the start of a process that acts as `motm-twin run exp1` does to its first period."""
    began = time.perf_counter()
    command = [sys.executable, "-c", STARTING]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:  # noqa: S603 - our own program
        assert process.stdout is not None
        line = process.stdout.readline()
        seconds = time.perf_counter() - began
    if not line:
        raise RuntimeError(f"the first period was not reached: exit code {process.returncode}")
    return seconds


def memory_gained(seconds: float) -> dict[str, float]:
    """Resident memory [MB] and allocated blocks gained from a tenth of this simulated time [s] to its end.

    The run is Experiment 2 with its six cubes, followed by endless rounds of the room between the Temis.
    """
    twin = Twin(round_for_ever(load_scene("exp2", "random")))
    early = _advanced(twin, EARLY * seconds)
    late = _advanced(twin, seconds)
    gained = {"megabytes": round(late[0] - early[0], 2), "blocks": late[1] - early[1]}
    return {**gained, "at_first_mb": round(early[0], 1), "simulated_s": seconds}


def round_for_ever(scene: Scene) -> Scene:
    """The scene with 50 rounds of drives to corners of the room after its own tasks."""
    corners = ((2.2, -0.4), (5.6, 0.2), (2.0, 0.6), (0.8, -0.6))
    tasks = tuple(DriveTo(point=corner, heading=None, tolerance=0.3) for corner in corners) * 50
    return msgspec.structs.replace(scene, tasks=scene.tasks + tasks)


def _advanced(twin: Twin, until: float) -> tuple[float, int]:
    """Resident memory [MB] and allocated blocks at that simulated time [s]."""
    while twin.index * PERIOD < until:
        twin.advance()
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20, sys.getallocatedblocks()


@contextmanager
def one_core() -> Iterator[int]:
    """Context in which this process runs only on the last of its cores, whose number it gives."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    try:
        yield max(cores)
    finally:
        os.sched_setaffinity(0, cores)


def bench_period(out: Path, share: float, console: Console) -> bool:
    """Measure, print, write ``out/period_cost.json``; True when the first of `METHODS` reaches every least number.

    Takes about ten minutes. ``share``: of the simulated time for the measurement of memory.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    columns: dict[str, dict[str, float]] = {method.name + clock: {} for method in METHODS for clock in CLOCKS}
    stages: dict[str, dict[str, dict[str, float]]] = {}
    with one_core() as core:
        for method, (scene, variant) in itertools.product(METHODS, SCENES):
            stages[f"{scene} {method.name}"] = _scene_values(scene, variant, method, columns, console)
        judged = columns[METHODS[0].name]
        start_seconds()
        judged["start"] = start_seconds()
        memory = memory_gained(SOAK * share)
        judged["memory"] = memory["megabytes"]
    console.print(stage_table(stages))
    console.print(report.wanted_table(WANTED, columns))
    reached = all(report.enough(row, judged[row.key], row.least) for row in WANTED)
    report.write_report(
        out, NAME, TITLE, core=core, reached=reached, rows=report.wanted_rows(WANTED, columns), stages_ms=stages,
        memory=memory, load_average=load_average(console),
    )  # fmt: skip
    return reached


def _scene_values(
    scene: str, variant: str, method: Method, columns: dict[str, dict[str, float]], console: Console
) -> dict[str, dict[str, float]]:
    """Fill the columns with a scene's values in wall and processor time; returns its stages in processor time."""
    loaded = load_scene(scene, variant)
    measured(loaded, method=method)  # may compile
    table = {}
    for name, clock in CLOCKS.items():
        run, found = measured(loaded, method=method, clock=clock), columns[method.name + name]
        table = run.table()
        found |= {f"{scene} {part}": table["period"][part] for part in ("p50", "p99", "max")}
        found[f"{scene} arm"] = table["arm step"]["p99"]
        if clock is time.perf_counter:  # the factor of every run is in wall time
            found[f"{scene} factor"] = run.factor
        summary = f"{scene}/{variant} {method.name}: {len(run.arm_steps)} arm steps, {run.factor:.1f} x"
        console.print(f"  {summary}", markup=False)
    return table


def stage_table(stages: dict[str, dict[str, dict[str, float]]]) -> Table:
    """Table of every stage of a period and one of its arm steps, as p50 / p99 / max [ms]."""
    names = ("stage, ms (p50 / p99 / max)", *stages)
    table = grid(*names, texts=names)
    for stage in next(iter(stages.values())):
        cells = (" / ".join(f"{value:.2f}" for value in stages[scene][stage].values()) for scene in stages)
        table.add_row(stage, *cells)
    return table


SOLVERS_NAME = "solvers"
SOLVERS_TITLE = "QP solvers: the programs of one run, and one run with each"
SCENE, VARIANT = "exp1", "trial3"
EVERY = 10  # every tenth program of the run is solved by each solver
QUICK_PERIODS = 20


def bench_solvers(out: Path, console: Console, *, quick: bool = False) -> bool:
    """Compare, print, write ``out/solvers.json``; True when each solver completes the task. ``quick``: 1 s of it."""
    console.print(f"\n[bold]{SOLVERS_NAME}[/bold]: {SOLVERS_TITLE}")
    most = QUICK_PERIODS if quick else None
    programs: list[Program] = []
    with one_core():
        runs = {solver: _run(solver, programs if solver == SOLVERS[0] else None, most) for solver in SOLVERS}
        rows = {solver: {**_solved(solver, programs[::EVERY]), **runs[solver]} for solver in SOLVERS}
    console.print(_table(rows, len(programs[::EVERY])))
    found = {"machine": machine(), "load_average": load_average(console), "programs": len(programs), "rows": rows}
    write(out / f"{SOLVERS_NAME}.json", found)
    return all(row["success"] or row["cut_off"] for row in rows.values())


def _run(solver: str, programs: list[Program] | None, most: int | None) -> dict[str, Any]:
    """Outcome of one run with a solver, cut off after ``most`` periods; its programs go to ``programs``."""
    twin = Twin(load_scene(SCENE, VARIANT), numbers=Parameters(arm=ArmParameters(qp=QpParameters(solver=solver))))
    solve, stopped = controller.solve, 0

    def kept(program: Program, **named: Any) -> Any:
        nonlocal stopped
        if programs is not None:
            programs.append(deepcopy(program))  # the next step overwrites its arrays
        answer = solve(program, **named)
        stopped += bool(answer.reason)
        return answer

    controller.solve = kept
    try:
        (tick,) = deque(itertools.islice(twin.ticks(), most), maxlen=1)
    finally:
        controller.solve = solve
    cut_off = twin.index == most and not tick.done
    return {"task_s": round(tick.time, 2), "success": tick.success, "cut_off": cut_off, "not_solved": stopped}


def _solved(solver: str, programs: list[Program]) -> dict[str, Any]:
    """Times [us] of a solver on the programs, its largest residual, and its largest difference from DAQP's rates."""
    times, residuals, off = [], [], []
    for program in programs:
        began = time.perf_counter()
        answer = qp.solve(program, solver=solver, residual=1.0)
        times.append(1e6 * (time.perf_counter() - began))
        if not answer.reason:
            residuals.append(qp.violation(program, answer.x))
            exact = qp.solve(program, solver=SOLVERS[0], residual=1.0).x
            off.append(float(np.abs(answer.x[:9] - exact[:9]).max()))
    return {
        "p50_us": round(float(np.percentile(times, 50)), 1),
        "p99_us": round(float(np.percentile(times, 99)), 1),
        "residual": max(residuals, default=float("nan")),
        "off": max(off, default=float("nan")),
    }


def _table(rows: dict[str, dict[str, Any]], count: int) -> Table:
    names = ("p50 us", "p99 us", "residual", "rates off by", "task s", "done", "not solved")
    table = grid(f"{count} programs", *names, texts=())
    for solver, row in rows.items():
        done = "yes" if row["success"] else "cut off" if row["cut_off"] else "NO"
        table.add_row(
            solver, f"{row['p50_us']:.0f}", f"{row['p99_us']:.0f}", f"{row['residual']:.1e}", f"{row['off']:.1e}",
            f"{row['task_s']:.1f}", done, str(row["not_solved"]),
        )  # fmt: skip
    return table


ANYTIME = "anytime"
ANYTIME_TITLE = "Anytime: task time over the expansions and over the time that the search may take"
TRIALS = ("exp1 trial1", "exp1 trial3", "exp1 trial8", "exp1a trial1")  # not Experiment 2: its times depend on chance
EXPANSIONS = (50, 100, 200, 300, 500, 1000, 2000)
SECONDS = (0.001, 0.002, 0.005, 0.010, 0.020, 0.040)  # [s] with up to 2,000 expansions; `serve` uses 0.020
PICTURE = Path("docs/performance_anytime.png")
Curve = dict[str, dict[str, Any]]  # results by limit, then by trial


def bench_anytime(out: Path, console: Console, *, quick: bool = False) -> bool:
    """Measure both curves, print, write ``out/anytime.json`` and the picture. Takes about 8 minutes.

    ``quick``: one trial with 50 expansions, and no picture. There is no number to reach; True when all trials end.
    """
    console.print(f"\n[bold]{ANYTIME}[/bold]: {ANYTIME_TITLE}")
    trials, limits = (TRIALS[:1], EXPANSIONS[:1]) if quick else (TRIALS, EXPANSIONS)
    kept = out / f"{ANYTIME}.json"
    found = json.loads(kept.read_text()) if kept.exists() else {}
    ours = {"method": FAST.name, **made_with()}
    by_count, by_time = (found[name] if found.get("of") == ours else {} for name in ("expansions", "seconds"))

    def keep() -> None:
        write(kept, {"machine": machine(), "of": ours, "expansions": by_count, "seconds": by_time})

    with one_core():
        _curve(by_count, trials, limits, lambda limit: SearchBudget(expansions=int(limit)), console, keep)
        if not quick:
            most = EXPANSIONS[-1]
            _curve(by_time, trials, SECONDS, lambda t: SearchBudget(expansions=most, seconds=t), console, keep)
    console.print(curve_table("expansions", by_count))
    if by_time:
        console.print(curve_table("seconds", by_time))
    load_average(console)
    if not quick:
        plot(by_count, by_time, PICTURE)
    return all(row["success"] for curve in (by_count, by_time) for point in curve.values() for row in point.values())


def _curve(
    curve: Curve, trials: Sequence[str], limits: Sequence[float], budget: Callable[[float], SearchBudget],
    console: Console, keep: Callable[[], None],
) -> None:  # fmt: skip
    """Measure the missing points of a curve."""
    for limit in limits:
        point = curve.setdefault(f"{limit:g}", {})
        for trial in trials:
            if trial not in point:
                point[trial] = _timed_trial(trial, budget(limit))
                keep()
        times = ", ".join(f"{row['time_s']:.1f}" for row in point.values())
        console.print(f"  {limit:g}: {times} s", markup=False)


def _timed_trial(trial: str, budget: SearchBudget) -> dict[str, Any]:
    """Success and task time [s] of one trial with a limit of the search."""
    scene, variant = trial.split()
    twin = Twin(load_scene(scene, variant), method=FAST, budget=budget, clock=time.thread_time)
    (last,) = deque(twin.ticks(), maxlen=1)
    return {"success": last.success, "time_s": round(last.time, 2)}


def curve_table(name: str, curve: Curve) -> Table:
    """Table of the task time [s] of every trial and the mean, by limit."""
    table = grid(name, *next(iter(curve.values())), "mean s", texts=())
    for limit, point in curve.items():
        times = [row["time_s"] if row["success"] else float("nan") for row in point.values()]
        table.add_row(limit, *(f"{seconds:.1f}" for seconds in times), f"{np.mean(times):.1f}")
    return table


def plot(by_count: Curve, by_time: Curve, target: Path) -> None:
    """Plot both curves: every trial and the mean."""
    from matplotlib.figure import Figure

    shipped = SearchBudget().expansions
    curves = [(by_count, 1.0, "expansions"), (by_time, 1e3, "time limit of the search [ms]")][: 2 if by_time else 1]
    figure = Figure(figsize=(5 * len(curves), 4))
    axes = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    for axis, (curve, scale, label) in zip(axes, curves, strict=True):
        limits = [scale * float(limit) for limit in curve]
        for trial in TRIALS:
            axis.plot(limits, [point[trial]["time_s"] for point in curve.values()], ".-", alpha=0.5, label=trial)
        mean = [np.mean([row["time_s"] for row in point.values()]) for point in curve.values()]
        axis.plot(limits, mean, "ko-", label="mean")
        axis.set(xscale="log", xlabel=label)
        axis.set_xticks(limits, [f"{limit:g}" for limit in limits])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].axvline(shipped, color="firebrick", linewidth=0.8, label=f"shipped: {shipped}")
    if by_time:
        axes[-1].axvline(1e3 * SEARCH_SECONDS, color="firebrick", linewidth=0.8)
        axes[-1].set_title(f"red: `serve` and its {1e3 * SEARCH_SECONDS:g} ms", fontsize=8, loc="right")
    axes[0].set_ylabel("task time [s]")
    axes[0].legend(fontsize=7, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, borderaxespad=0.2)
    save_picture(figure, target)
