"""Task times against numbers to reach: `fast` is judged, and the paper's method stands beside it.

The paper's experiments, a faster robot, and scenes that the code was not tuned on. Every trial is an experiment's
(`studies.run`), kept on disk and resumed after Ctrl-C.
"""

import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.measures.measures import PARTS
from motm_twin.methods.registry import FAST, MOTM
from motm_twin.perf.report import Wanted, enough, grid, machine, wanted_rows, wanted_table, write_report
from motm_twin.studies import statistics
from motm_twin.studies.catalogue import experiment
from motm_twin.studies.groups import drove_into
from motm_twin.studies.run import Result, Results, run_or_stop
from motm_twin.studies.spec import Experiment

NAME = "task"
TITLE = "How long the task takes: the paper's experiments, a quicker robot, and scenes that the code was not made for"
METHODS = (FAST.name, MOTM.name)  # the first is judged
RANDOM = 50  # seeds of the random arrangements
GENERATED = 200  # scenes


def _completed_share(key: str, what: str, least: float) -> Wanted:
    return Wanted(key=key, name=f"{what}, completed", unit="%", least=least, best=100.0, more=True, decimals=1)


WANTED = (
    Wanted(key="exp1", name="exp1, ten trials, mean", unit="s", least=88.0, best=80.0, decimals=1),
    Wanted(key="exp1a", name="exp1a, ten trials, mean", unit="s", least=97.0, best=88.0, decimals=1),
    Wanted(key="random", name="exp1, random arrangements, mean", unit="s", least=88.0, best=80.0, decimals=1),
    Wanted(key="four", name="exp2, four Temis, over exp1 by seed", unit="%", least=20.0, best=12.0, decimals=1),
    Wanted(key="one", name="exp2, one Temi, over exp1 by seed", unit="%", least=4.0, best=2.0, decimals=1),
    Wanted(
        key="closing", name="exp1, base speed while the fingers close", unit="m/s", least=0.3, best=0.4, more=True,
        decimals=3,
    ),
    Wanted(key="quick", name="quick robot, time by reference tour", unit="", least=1.7, best=1.5),
    _completed_share("further", "further scenes", 100.0),
    _completed_share("generated", "generated scenes", 99.0),
    _completed_share("paper", "the paper's experiments", 100.0),
    Wanted(key="contacts", name="contacts (exp2: driven into)", unit="", least=0.0, best=0.0, decimals=0),
)  # fmt: skip


def experiments(share: float) -> dict[str, Experiment]:
    """The experiments by the folder that they are kept in; ``share`` of the random seeds and generated scenes."""
    random, generated = math.ceil(RANDOM * share), math.ceil(GENERATED * share)
    trials = dict.fromkeys(("exp1", "exp1a", "exp1_random", "exp2", "one_temi", "quick_robot", "further_scenes"))
    trials |= dict.fromkeys(("exp1_random", "exp2", "one_temi"), random) | {"generated": generated}
    wanted = {name: experiment(name.removesuffix("_random"), METHODS, count) for name, count in trials.items()}
    return {name: Experiment(name, each.title, each.specs) for name, each in wanted.items()}


def bench_task(out: Path, share: float, workers: int, console: Console) -> bool:
    """Run, print, write ``out/task.json``; True when `fast` reaches everything that is wanted at least.

    About 900 trials with a share of 1: reckoned at two hours of one core.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    chosen = experiments(share)
    results = run_or_stop(chosen.values(), out=out / NAME, workers=workers, console=console)
    if results is None:
        return False
    columns = {method: values(results, method) for method in METHODS}
    console.print(wanted_table(WANTED, columns))
    spent = {method: parts(results, method) for method in METHODS}
    console.print(parts_table(spent))
    for method in METHODS:
        for result in _without_success(results, method):
            what = f"{result['scene']}/{result['variant']} seed {result['seed']} {method}: {result['reason']}"
            console.print(f"  not completed: {what}", style="yellow", markup=False)
    reached = all(enough(row, columns[METHODS[0]][row.key], row.least) for row in WANTED)
    rounded = {method: {key: round(value, 4) for key, value in column.items()} for method, column in columns.items()}
    rows = wanted_rows(WANTED, rounded)
    counts = {name: len(each.specs) // len(METHODS) for name, each in chosen.items()}
    target = write_report(out, NAME, TITLE, reached=reached, trials=counts, rows=rows, parts=spent)
    console.print(f"{machine()}, {workers} processes; written to {target}")
    return reached


def values(results: Results, method: str) -> dict[str, float]:
    """Every number of `WANTED` for one method. A mean time is nan unless all trials were completed."""
    of = {name: results.of(name, method=method) for name in results.trials}
    ten, quick = of["exp1"], of["quick_robot"]
    paper = [result for name in ("exp1", "exp1a", "exp1_random", "exp2", "one_temi") for result in of[name]]
    every = [result for these in of.values() for result in these]
    return {
        "exp1": _mean_time(ten), "exp1a": _mean_time(of["exp1a"]), "random": _mean_time(of["exp1_random"]),
        "four": _over_exp1(of["exp2"]), "one": _over_exp1(of["one_temi"]),
        "closing": float(np.mean([result["mean_closing_base_speed_mps"] or 0.0 for result in ten])),
        "quick": _mean_time(quick, lambda result: result["time_s"] / result["reference_tour_s"]),
        "further": _completed(of["further_scenes"]), "generated": _completed(of["generated"]),
        "paper": _completed(paper), "contacts": float(sum(map(_hits, every))),
    }  # fmt: skip


def parts(results: Results, method: str) -> dict[str, dict[str, float]]:
    """Time by part and smoothness of each experiment: means of the completed trials, largest of the largest.

    Seconds by `measures.PARTS`; path and reference tour [m]; acceleration of the arm's foot [m/s^2]; changes of
    turning per metre.
    """
    found = {}
    for name in results.trials:
        done = [each["measures"] | {"path": each["path_length_m"]} for each in results.of(name, method=method)
                if each["success"] and each.get("measures")]  # fmt: skip
        if not done:
            continue
        felt = [each["arm_base_acceleration_mps2"] for each in done]
        found[name] = {
            **{part: float(np.mean([each["parts_s"][part] for each in done])) for part in PARTS},
            "path_m": float(np.mean([each["path"] for each in done])),
            "reference_m": float(np.mean([sum(leg["reference_m"] or 0.0 for leg in each["legs"]) for each in done])),
            "felt_p99": float(np.mean([each["p99"] for each in felt])),
            "felt_max": float(max(each["max"] for each in felt)),
            "turns_per_m": float(np.mean([each["yaw_sign_changes_per_m"] for each in done])),
        }
    return found


def parts_table(spent: dict[str, dict[str, dict[str, float]]]) -> Table:
    """`parts` of every method, a row for each experiment."""
    names = [*(part.replace("_", " ") for part in PARTS), "path m", "tour m", "m/s2 p99", "max", "turns/m"]
    texts = ("mean seconds of", "method")
    table = grid(*texts, *names, texts=texts)
    for method, by_experiment in spent.items():
        for name, values_ in by_experiment.items():
            *seconds, felt_p99, felt_max, turns = values_.values()
            table.add_row(
                name, method, *(f"{value:.1f}" for value in seconds), f"{felt_p99:.2f}", f"{felt_max:.2f}",
                f"{turns:.2f}",
            )  # fmt: skip
    return table


def _mean_time(results: list[Result], time: Callable[[Result], float] = lambda result: result["time_s"]) -> float:
    return float(np.mean(list(map(time, results)))) if all(result["success"] for result in results) else math.nan


def _over_exp1(results: Iterable[Result]) -> float:
    """By how much [%] the trials with Temis take longer than those without, by seed."""
    times: dict[str, dict[int, float]] = {"exp1": {}, "exp2": {}}
    for result in results:
        if not result["success"]:
            return math.nan
        times[result["scene"]][result["seed"]] = result["time_s"]
    return 100.0 * statistics.paired_ratio(times["exp2"], times["exp1"]).value


def _hits(result: Result) -> int:
    """Contacts that count: in Experiment 2 those that the robot drove into, elsewhere every one."""
    return drove_into([result]) if result["scene"] == "exp2" else len(result["contacts"])


def _completed(results: list[Result]) -> float:
    return 100.0 * sum(result["success"] for result in results) / len(results)


def _without_success(results: Results, method: str) -> list[Result]:
    """Each once: the arrangements of Experiment 1 are in several experiments."""
    found = {
        (result["scene"], result["variant"], result["seed"]): result
        for name in results.trials
        for result in results.of(name, method=method)
        if not result["success"]
    }
    return list(found.values())
