"""What a citation of the numbers needs: version, source, seeds, parameters, machine, and the numbers."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from motm_twin.bench.paper import data, goals
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.origin import COMMAND, NOT_RECORDED, Origin, now
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.results_table import group_of
from motm_twin.control.tuning import PARAMETERS
from motm_twin.methods.registry import METHODS
from motm_twin.record.made_with import SOURCE

VERSION = "motm-twin"  # of this package, in what a trial was made with


def record(store: Store, origin: Origin, command: str, parts: Sequence[Part]) -> dict[str, Any]:
    """``results.json``: everything but the figures. ``origin``: of the trials; ``command``: that draws them now."""
    everything = store.all()
    return {
        "project": "motm_twin",
        "version": origin.made_with.get(VERSION, NOT_RECORDED),
        "source": origin.made_with[SOURCE],
        "sources_of_trials": list(origin.sources),
        "made_with": origin.made_with,
        "machine": origin.machine,
        "plan": origin.plan,
        "command": origin.command,
        "drawn": {"written": datetime.now(UTC).isoformat(timespec="seconds"), COMMAND: command, **now()},
        "trials": len(everything),
        "without_success": [_failed(name, result) for name, result in everything if not result["success"]],
        "experiments": {name: _experiment(results) for name, results in store.trials.items()},
        "parameters": {each.name: each.default for each in PARAMETERS},
        "methods": {name: dict(method.parameters) for name, method in METHODS.items()},
        "numbers": [dict(zip(goals.HEADER, row, strict=True)) for row in goals.table(store)],
        "parts": {part.name: _part(part) for part in parts},
    }


def _experiment(results: Sequence[Result]) -> dict[str, Any]:
    """All trials of an experiment; a mean is within one group of the results table, or within one setting."""
    methods = list(dict.fromkeys(result["method"] for result in results))
    return {
        "trials": len(results),
        "scenes": sorted({f"{result['scene']}/{result['variant']}" for result in results}),
        "seeds": sorted({int(result["seed"]) for result in results}),
        "methods": {name: _method([each for each in results if each["method"] == name]) for name in methods},
    }


def _method(results: list[Result]) -> dict[str, Any]:
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(group_of(result), []).append(result)
    alone = _time(results) if len(groups) == 1 else {}
    return {**_counts(results), **alone, "groups": {name: _counts(each) | _time(each) for name, each in groups.items()}}


def _counts(results: list[Result]) -> dict[str, Any]:
    placed, wanted = data.placed(results)
    return {
        "trials": len(results), "completed": sum(map(data.completed, results)),
        "success": sum(bool(result["success"]) for result in results),
        "placed": placed, "wanted": wanted, "contacts_caused": data.contacts(results),
        "contacts": data.touches(results),
    }  # fmt: skip


def _time(results: list[Result]) -> dict[str, float]:
    time = data.mean_time(results)
    return {"mean_s": time.value, "low_s": time.low, "high_s": time.high}


def _failed(name: str, result: Result) -> dict[str, Any]:
    return {
        "experiment": name,
        **{key: result[key] for key in ("scene", "variant", "seed", "method", "parameters", "changes", "reason")},
    }


def _part(part: Part) -> dict[str, Any]:
    if isinstance(part, Missing):
        return {"missing": part.reason, "command": part.command}
    assert isinstance(part, Drawn)
    return {"title": part.title, "n": part.n, "command": part.command, "data": f"figures/{part.name}.csv"}
