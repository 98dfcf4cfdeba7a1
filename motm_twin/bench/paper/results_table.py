"""The results table (Paper, Table I) for all methods, with the published rows marked as published."""

from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.published import TABLE_I

NAME, TITLE = "results", "Task times and success"
HEADER = ("Experiment", "Method", "Task time, mean [95 % CI] [s]", "Median [s]", "Objects placed", "Trials", "Contacts")
COMMAND = "motm-twin paper --only results"
ALL_PUBLISHED = "1, published arrangements"
GROUPS = (
    ("exp1", "1, trial 1", lambda results: [each for each in data.ten(results) if each["variant"] == "trial1"]),
    ("exp1", ALL_PUBLISHED, data.ten),
    ("exp1", "1, random", data.random),
    ("exp1a", "1a, published arrangements", data.ten),
    ("exp1a", "1a, random", data.random),
    ("exp2", "2, four Temis", data.random),
    ("exp2", "2, one Temi", lambda results: [each for each in results if each["variant"] == "one_temi"]),
)


def draw(store: Store) -> Part:
    """One row per experiment and method; a group of one trial twice is not shown twice."""
    rows, cells, marked = [], [], []
    for published in TABLE_I:
        marked.append(len(rows))
        rows.append(
            {"experiment": published.experiment, "method": published.method, "published": True,
             "mean_s": published.seconds, "placed": published.success, "source": published.source}
        )  # fmt: skip
        cells.append(
            (published.experiment, f"{published.method} (published)", f"{published.seconds:.1f}", "-",
             published.success or "not given", "-", "not given")
        )  # fmt: skip
    measured = 0
    for experiment, name, choose in GROUPS:
        for method in store.methods(experiment):
            results = choose(store.of(experiment, method=method))
            if results and not (name == ALL_PUBLISHED and len(results) == 1):  # trial 1 has its row already
                measured += len(results)
                rows.append(_row(name, method, results))
                cells.append(_cells(name, method, results))
    if not measured:
        return Missing(name=NAME, title=TITLE, reason="no trial of Experiments 1, 1a or 2 was run", command=COMMAND)
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            "Times are means over the trials in which every object was placed, contacts or not, with Student's 95 % "
            "interval; "
            "medians with a bootstrap interval are in the CSV. Contacts: those that the robot caused, counted by the "
            "referee. Shaded rows are published numbers, not measured here."
        ),
        command=COMMAND,
        n=f"{len(store.of('exp1')) + len(store.of('exp1a')) + len(store.of('exp2'))} trials; of each row in its column",
        rows=rows,
        header=HEADER,
        cells=cells,
        marked=marked,
    )


def _row(name: str, method: str, results: list[Result]) -> dict:
    time, median = data.mean_time(results), data.statistics.median(list(data.times(results).values()))
    share, (placed, wanted) = data.delivered(results), data.placed(results)
    return {
        "experiment": name, "method": method, "published": False, "mean_s": time.value, "mean_low_s": time.low,
        "mean_high_s": time.high, "median_s": median.value, "median_low_s": median.low, "median_high_s": median.high,
        "trials": len(results), "completed": time.n, "placed": f"{placed}/{wanted}", "placed_share": share.value,
        "placed_low": share.low, "placed_high": share.high, "contacts": data.contacts(results),
    }  # fmt: skip


def _cells(name: str, method: str, results: list[Result]) -> tuple[str, ...]:
    time, median = data.mean_time(results), data.statistics.median(list(data.times(results).values()))
    placed, wanted = data.placed(results)
    share = data.delivered(results)
    done = f"{len(results)}" if time.n == len(results) else f"{time.n} of {len(results)} completed"
    return (
        name,
        data.title(method),
        time.text(1),
        "-" if not median.n else f"{median.value:.1f}",
        f"{placed}/{wanted} [{100 * share.low:.0f}, {100 * share.high:.0f}] %",
        done,
        str(data.contacts(results)),
    )
