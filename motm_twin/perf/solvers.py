"""The solvers of the arm's quadratic program: programs of one run given to each, and one run with each."""

import time
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.control.arm import controller, qp
from motm_twin.control.arm.parameters import ArmParameters, QpParameters
from motm_twin.control.arm.qp import SOLVERS, Program
from motm_twin.control.parameters import Parameters
from motm_twin.model.scene_file import load_scene
from motm_twin.perf.period import one_core
from motm_twin.perf.report import grid, load_average, machine, write
from motm_twin.twin import Twin

NAME = "solvers"
TITLE = "QP solvers: the programs of one run, and one run with each"
SCENE, VARIANT = "exp1", "trial3"
EVERY = 10  # of the programs of the run
QUICK_PERIODS = 20


def bench_solvers(out: Path, console: Console, *, quick: bool = False) -> bool:
    """Compare, print, write ``out/solvers.json``; True when each solver completes the task. ``quick``: 1 s of it."""
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    most = QUICK_PERIODS if quick else None
    programs: list[Program] = []
    with one_core():
        runs = {solver: _run(solver, programs if solver == SOLVERS[0] else None, most) for solver in SOLVERS}
        rows = {solver: {**_solved(solver, programs[::EVERY]), **runs[solver]} for solver in SOLVERS}
    console.print(_table(rows, len(programs[::EVERY])))
    load = load_average(console)
    write(out / f"{NAME}.json", {"machine": machine(), "load_average": load, "programs": len(programs), "rows": rows})
    return all(row["success"] or row["cut_off"] for row in rows.values())


def _run(solver: str, programs: list[Program] | None, most: int | None) -> dict[str, Any]:
    """One run with a solver, cut off after ``most`` periods; its programs are added to the list."""
    twin = Twin(load_scene(SCENE, VARIANT), numbers=Parameters(arm=ArmParameters(qp=QpParameters(solver=solver))))
    solve, stopped = controller.solve, 0

    def kept(program: Program, **named: Any) -> Any:
        nonlocal stopped
        if programs is not None:
            programs.append(deepcopy(program))  # the next step writes over its arrays
        answer = solve(program, **named)
        stopped += bool(answer.reason)
        return answer

    controller.solve = kept
    try:
        while True:
            tick = twin.advance()
            if tick.done or tick.time >= twin.scene.time_limit or twin.index == most:
                break
    finally:
        controller.solve = solve
    cut_off = twin.index == most and not tick.done
    return {"task_s": round(tick.time, 2), "success": tick.success, "cut_off": cut_off, "not_solved": stopped}


def _solved(solver: str, programs: list[Program]) -> dict[str, Any]:
    """Time [us] and residual of each program with a solver, and how far the answers are from DAQP's."""
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
