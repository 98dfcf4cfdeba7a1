"""Statistics of samples, each with its 95 % interval, and with them the summary of an experiment's trials.

Intervals of means are Student's t; `bootstrap` is for statistics without a formula, and is seeded, so that it gives the
same interval every time. The summary has one row per scene, method and setting, beside the published times.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from rich.table import Table
from rich.text import Text
from scipy import stats

from motm_twin.measures.references import Published, published
from motm_twin.methods.registry import MOTM
from motm_twin.model.geometry import Array
from motm_twin.perf.report import grid
from motm_twin.studies.catalogue import reasons, row_of

K = TypeVar("K")
CONFIDENCE = 0.95
RESAMPLES = 10_000
SEED = 20260101  # of the bootstrap: any fixed number


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """A value with its interval; both ends are nan when the sample is too small."""

    value: float
    low: float
    high: float
    n: int

    def text(self, decimals: int = 1, *, scale: float = 1.0, sign: str = "", unit: str = "") -> str:
        """Text for a table: "85.6 [84.9, 86.3]"; "-" for no value. ``sign`` "+": also on values >= 0."""
        if not math.isfinite(self.value):
            return "-"
        value, low, high = (f"{scale * each:{sign}.{decimals}f}" for each in (self.value, self.low, self.high))
        known = math.isfinite(self.low) and math.isfinite(self.high)
        return f"{value} [{low}, {high}]{unit}" if known else value + unit


def mean(values: Iterable[float], confidence: float = CONFIDENCE) -> Estimate:
    """Mean with Student's t interval: m -+ t_{n-1} s / sqrt(n)."""
    sample = _sample(values)
    n = len(sample)
    centre = float(sample.mean()) if n else math.nan
    if n < 2:
        return Estimate(value=centre, low=math.nan, high=math.nan, n=n)
    half = float(stats.t.ppf(0.5 + 0.5 * confidence, n - 1)) * float(sample.std(ddof=1)) / math.sqrt(n)
    return Estimate(value=centre, low=centre - half, high=centre + half, n=n)


def median(values: Iterable[float]) -> Estimate:
    """Median with its bootstrap interval."""
    return bootstrap(values, lambda samples: np.median(samples, axis=-1))


def bootstrap(values: Iterable[float], statistic: Callable[[Array], Array], *, resamples: int = RESAMPLES) -> Estimate:
    """Any statistic with its percentile bootstrap interval.

    ``statistic`` takes samples of shape (..., n) and returns shape (...).
    """
    sample = _sample(values)
    n = len(sample)
    value = float(statistic(sample)) if n else math.nan
    if n < 2:
        return Estimate(value=value, low=math.nan, high=math.nan, n=n)
    drawn = np.random.default_rng(SEED).integers(0, n, size=(resamples, n))
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(statistic(sample[drawn]), [tail, 1.0 - tail])
    return Estimate(value=value, low=float(low), high=float(high), n=n)


def paired_difference(ours: Mapping[K, float], others: Mapping[K, float]) -> Estimate:
    """Mean of ours - others over the keys (variant and seed) that both have, with Student's t interval."""
    return mean([ours[key] - others[key] for key in ours if key in others])


def paired_ratio(ours: Mapping[K, float], others: Mapping[K, float]) -> Estimate:
    """Mean relative change ours / others - 1 over the keys that both have, with Student's t interval."""
    return mean([ours[key] / others[key] - 1.0 for key in ours if key in others])


def proportion(successes: int, n: int, confidence: float = CONFIDENCE) -> Estimate:
    """k of n with the exact interval of Clopper and Pearson: quantiles of beta(k, n - k + 1) and beta(k + 1, n - k).

    Raises ValueError unless 0 <= successes <= n.
    """
    if not 0 <= successes <= n:
        raise ValueError(f"{successes} of {n}: successes are from 0 to the number of trials")
    if n == 0:
        return Estimate(value=math.nan, low=math.nan, high=math.nan, n=0)
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if successes == 0 else float(stats.beta.ppf(tail, successes, n - successes + 1))
    high = 1.0 if successes == n else float(stats.beta.ppf(1.0 - tail, successes + 1, n - successes))
    return Estimate(value=successes / n, low=low, high=high, n=n)


def _sample(values: Iterable[float]) -> Array:
    sample = np.asarray(list(values) if not isinstance(values, Sequence) else values, dtype=float)
    if not np.isfinite(sample).all():
        raise ValueError("a sample has a value that is not finite: leave out what was not measured, and say so")
    return sample


Result = dict[str, Any]
APPROACH = 0.02  # [m/s] approach speed of a contact point that counts as driving into the other
COMPLETED = "Completed: every object placed (picked, where that is all), contacts or not."
TOUCHED = "A time got with contacts that the robot caused compares with nothing."
CAPTION = (
    "Times are means over the trials that were completed, with 95 % intervals (Student's t); differences are paired by "
    f"arrangement and seed, over those that both completed. {COMPLETED} {TOUCHED} Success: completed, nothing left "
    "dropped, and no contact that the robot caused; with Clopper and Pearson's interval. 'driven into': contacts in "
    "which the robot moved into the other."
)


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Trials of one scene, method and setting together."""

    scene: str
    method: str
    setting: str  # parameters and changes, "" for none
    trials: int
    success: Estimate
    placed: int
    places: int
    contacts: int
    caused: int  # contacts caused by the robot
    driven_into: int
    time: Estimate  # [s]
    median: Estimate  # [s]
    to_motm: Estimate | None  # [s] difference to motm of the same scene, as shipped; None for motm itself
    to_exp1: Estimate | None  # relative to the same trials of exp1; None for exp1


def rows(results: Sequence[Result]) -> list[Row]:
    """One row per scene, method and setting, in the order of the results."""
    groups: dict[tuple[str, str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((row_of(result["scene"]), result["method"], setting(result)), []).append(result)
    return [_row(name, these, groups) for name, these in groups.items()]


def setting(result: Result) -> str:
    """Parameters and changes in one text: "next_weight=2"."""
    return ", ".join(f"{name}={_value(value)}" for name, value in {**result["parameters"], **result["changes"]}.items())


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else json.dumps(value)


def _row(name: tuple[str, str, str], results: list[Result], groups: dict[tuple[str, str, str], list[Result]]) -> Row:
    scene, method, of = name
    times = _times(results)
    reference = (scene, MOTM.name, "")
    alone = ("exp1", method, of)
    return Row(
        scene=scene,
        method=method,
        setting=of,
        trials=len(results),
        success=proportion(sum(result["success"] for result in results), len(results)),
        placed=sum(result["places_done"] for result in results),
        places=sum(result["places_total"] for result in results),
        contacts=touches(results),
        caused=caused(results),
        driven_into=drove_into(results),
        time=mean(times.values()),
        median=median(times.values()),
        to_motm=paired_difference(times, _times(groups[reference]))
        if name != reference and reference in groups
        else None,
        to_exp1=paired_ratio(_by_seed(results), _by_seed(groups[alone]))
        if scene != "exp1" and alone in groups
        else None,
    )


def completed(result: Result) -> bool:
    """True when all objects are in their bins (or grasped, if that is the task): the time covers the whole task.

    Contacts are counted separately, and success requires more. Every time shown is
    that of a completed trial, in `bench` and in the report.
    """
    kind = "place" if result["places_total"] else "pick"
    return 0 < result[f"{kind}s_total"] <= result[f"{kind}s_done"]


def touches(results: Iterable[Result]) -> int:
    """Number of all contacts, caused by the robot or not."""
    return sum(len(result["contacts"]) for result in results)


def caused(results: list[Result]) -> int:
    """Number of contacts that the robot caused."""
    return sum(hit["caused_by_robot"] for result in results for hit in result["contacts"])


def drove_into(results: list[Result]) -> int:
    """Number of contacts in which our robot moved into the other, or that it caused."""
    hits = (contact for result in results for contact in result["contacts"])
    return sum(hit["caused_by_robot"] or hit["closing_speed"] > APPROACH for hit in hits)


def _times(results: list[Result]) -> dict[tuple[str, int], float]:
    """Times [s] of completed trials by variant and seed; a trial that gave up early is not fast."""
    return {(result["variant"], result["seed"]): result["time_s"] for result in results if completed(result)}


def _by_seed(results: list[Result]) -> dict[int, float]:
    """The same by seed only: variants of different scenes have different names."""
    return {result["seed"]: result["time_s"] for result in results if completed(result)}


def summary_table(found: Sequence[Row], beside: Sequence[Published] = ()) -> Table:
    """Rows, then the published times, marked as such."""
    printed = [_cells(row) for row in found]
    several = len({row.scene for row in found}) > 1
    used = [name for name in (printed[0] if printed else ()) if any(cells[name] for cells in printed)]
    shown = [name for name in used if several or name != "scene"]
    table = grid(*shown, texts=("scene", "method", "setting"), caption=CAPTION, caption_justify="left")
    for row, cells in zip(found, printed, strict=True):
        table.add_row(*(cells[name] for name in shown), style=None if row.success.value == 1.0 else "yellow")
    for entry in beside:
        cells = {
            "method": f"{entry.what} (published: {entry.source})",
            "success": entry.success,
            "time s": f"{entry.seconds:.1f}",
        }
        table.add_row(*(cells.get(name, "") for name in shown), style="dim")
    return table


def reasons_table(results: Sequence[Result]) -> Table | None:
    """Table of the reasons of trials without success; None when all succeeded."""
    found = reasons(results)
    if not found:
        return None
    table = grid("trials", "reason", "first in", texts=("reason", "first in"))
    for reason, count, first in found:
        table.add_row(str(count), Text(reason), Text(first))
    return table


def _cells(row: Row) -> dict[str, str]:
    """Cells of a row by column; a column that is empty in all rows is left out."""
    done = round(row.success.value * row.trials)
    interval = f"[{100 * row.success.low:.0f}, {100 * row.success.high:.0f}] %"
    return {
        "scene": row.scene,
        "method": row.method,
        "setting": row.setting,
        "trials": str(row.trials),
        "success": f"{done}/{row.trials} {interval}",
        "placed": f"{row.placed}/{row.places}",
        "contacts": str(row.contacts),
        "caused": str(row.caused),
        "driven into": str(row.driven_into),
        "time s": row.time.text(),
        "median s": f"{row.median.value:.1f}" if math.isfinite(row.median.value) else "-",
        "to motm s": "" if row.to_motm is None else row.to_motm.text(sign="+"),
        "to exp1": "" if row.to_exp1 is None else row.to_exp1.text(scale=100.0, sign="+", unit=" %"),
    }


def published_beside(results: Sequence[Result]) -> list[Published]:
    """Published times for comparison with these trials, each once."""
    pairs = dict.fromkeys((result["scene"], result["variant"]) for result in results)
    variants: dict[str, list[str]] = {}
    for scene, variant in pairs:
        variants.setdefault(scene, []).append(variant)
    found = [
        entry
        for scene, names in variants.items()
        for entry in published(scene, names[0] if len(names) == 1 else "")  # several trials: not the time of trial 1
    ]
    return list(dict.fromkeys(found))


def write_summary(found: Sequence[Row], beside: Sequence[Published], folder: Path) -> Path:
    """Write the rows as JSON, nan as null; the path of the file."""
    target = folder / "summary.json"
    whole = {"rows": found, "published": [entry._asdict() for entry in beside], "caption": CAPTION}
    target.write_bytes(msgspec.json.format(msgspec.json.encode(whole), indent=2) + b"\n")
    return target
