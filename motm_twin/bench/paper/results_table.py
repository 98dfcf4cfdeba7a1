"""The results table (Paper, Table I) for all methods, with the published rows marked as published."""

from collections.abc import Callable

from motm_twin.bench.experiments import statistics
from motm_twin.bench.experiments.statistics import Estimate
from motm_twin.bench.experiments.summary import COMPLETED, TOUCHED, setting
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.published import TABLE_I

NAME, TITLE = "results", "Task times and success"
HEADER = (
    "Experiment",
    "Method",
    "Task time, mean [95 % CI] [s]",
    "Median [s]",
    "Trials completed",
    "Trials with success [95 % CI]",
    "Objects placed",
    "Contacts, caused",
)
TRIAL_1, ALL_PUBLISHED = "1, trial 1", "1, published arrangements"
Choose = Callable[[list[Result]], list[Result]]
GROUPS: tuple[tuple[str, str, Choose], ...] = (  # every trial is in one at most; means are taken within one
    ("exp1", ALL_PUBLISHED, data.ten),
    ("exp1", "1, random", data.random),
    ("exp1", "1, trial 1, other seeds", lambda all_: [r for r in all_ if r["variant"] == "trial1" and r["seed"] != 0]),
    ("exp1a", "1a, published arrangements", data.ten),
    ("exp1a", "1a, random", data.random),
    ("exp2", "2, four Temis", data.random),
    ("exp2", "2, one Temi", lambda results: [each for each in results if each["variant"] == "one_temi"]),
)


def grouped(store: Store) -> list[tuple[str, str, list[Result]]]:
    """Name, method and trials of every group that has any, in the order of `GROUPS`."""
    return [
        (name, method, results)
        for experiment, name, choose in GROUPS
        for method in store.methods(experiment)
        if (results := choose(store.of(experiment, method=method)))
    ]


def group_of(result: Result) -> str:
    """The name of the group of one trial, of whatever experiment: what differs in its setting is in another."""
    own = [name for scene, name, choose in GROUPS if scene == result["scene"] and choose([result])]
    name = own[0] if own else f"{result['scene']}, {result['variant']}"
    return ", ".join(filter(None, (name, setting(result))))


def first(results: list[Result]) -> list[Result]:
    """Trial 1 of the published arrangements, which the paper has a row of its own for."""
    return [each for each in data.ten(results) if each["variant"] == "trial1"]


def successes(results: list[Result]) -> Estimate:
    """Share of trials with success, as `run` says it, with the interval of Clopper and Pearson."""
    return statistics.proportion(sum(bool(result["success"]) for result in results), len(results))


def draw(store: Store) -> Part:
    """One row per group and method; trial 1 has its own besides, and no other where it is all there is."""
    rows, cells, marked = [], [], []
    for published in TABLE_I:
        marked.append(len(rows))
        rows.append(
            {"experiment": published.experiment, "method": published.method, "published": True,
             "mean_s": published.seconds, "placed": published.success, "source": published.source}
        )  # fmt: skip
        cells.append(
            (published.experiment, f"{published.method} (published)", f"{published.seconds:.1f}", "-", "-",
             "not given", published.success or "not given", "not given")
        )  # fmt: skip
    found = grouped(store)
    alone = [(TRIAL_1, method, first(results)) for name, method, results in found if name == ALL_PUBLISHED]
    more = [each for each in found if each[0] != ALL_PUBLISHED or each[2] != first(each[2])]
    for name, method, results in (*alone, *more):
        if results:
            rows.append(_row(name, method, results))
            cells.append(_cells(name, method, results))
    if not found:
        return Missing(name=NAME, title=TITLE, reason="no trial of Experiments 1, 1a or 2 was run")
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            "Times are means over the completed trials, with Student's 95 % interval; medians with a bootstrap "
            f"interval are in the CSV. {COMPLETED} Contacts: all that the referee counts, and of these those that the "
            "robot caused. "
            f"{TOUCHED} Success, as motm-twin run says it: completed, and no such contact; with Clopper and "
            "Pearson's interval over trials. The objects of a trial are not independent, so their share has none. "
            "Shaded rows are published numbers, not measured here."
        ),
        n=f"{sum(len(results) for *_, results in found)} trials; of each row in its column",
        rows=rows,
        header=HEADER,
        cells=cells,
        marked=marked,
    )


def _row(name: str, method: str, results: list[Result]) -> dict:
    time, median = data.mean_time(results), data.statistics.median(list(data.times(results).values()))
    share, (placed, wanted) = successes(results), data.placed(results)
    return {
        "experiment": name, "method": method, "published": False, "mean_s": time.value, "mean_low_s": time.low,
        "mean_high_s": time.high, "median_s": median.value, "median_low_s": median.low, "median_high_s": median.high,
        "trials": len(results), "completed": time.n, "success": share.value, "success_low": share.low,
        "success_high": share.high, "placed": f"{placed}/{wanted}", "contacts": data.contacts(results),
        "all_contacts": data.touches(results),
    }  # fmt: skip


def _cells(name: str, method: str, results: list[Result]) -> tuple[str, ...]:
    time, median = data.mean_time(results), data.statistics.median(list(data.times(results).values()))
    placed, wanted = data.placed(results)
    share = successes(results)
    return (
        name,
        data.title(method),
        time.text(1),
        "-" if not median.n else f"{median.value:.1f}",
        f"{time.n} of {len(results)}",
        f"{round(share.value * share.n)}/{share.n} [{100 * share.low:.0f}, {100 * share.high:.0f}] %",
        f"{placed}/{wanted}",
        f"{data.touches(results)}, {data.contacts(results)}",
    )
