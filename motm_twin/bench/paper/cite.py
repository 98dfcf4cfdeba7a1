"""What a citation of the numbers needs: version, source, seeds, parameters, machine, and the numbers."""

import importlib.metadata
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from motm_twin.bench.machine import machine
from motm_twin.bench.paper import data, goals
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.control.tuning import PARAMETERS
from motm_twin.methods.registry import METHODS
from motm_twin.record.made_with import SOURCE, made_with


def record(store: Store, plan: str, command: str, sources: Sequence[str], parts: Sequence[Part]) -> dict[str, Any]:
    """``results.json``: everything but the figures."""
    everything = store.all()
    return {
        "project": "motm_twin",
        "version": version(),
        "source": made_with()[SOURCE],
        "sources_of_trials": list(sources),
        "made_with": made_with(),
        "machine": machine(),
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command,
        "plan": plan,
        "trials": len(everything),
        "without_success": [_failed(name, result) for name, result in everything if not result["success"]],
        "experiments": {name: _experiment(results) for name, results in store.trials.items()},
        "parameters": {each.name: each.default for each in PARAMETERS},
        "methods": {name: dict(method.parameters) for name, method in METHODS.items()},
        "numbers": [dict(zip(goals.HEADER, row, strict=True)) for row in goals.table(store)],
        "parts": {part.name: _part(part) for part in parts},
    }


def version() -> str:
    """Of this package."""
    try:
        return importlib.metadata.version("motm-twin")
    except importlib.metadata.PackageNotFoundError:
        return "not installed as a package"


def _experiment(results: Sequence[Result]) -> dict[str, Any]:
    methods = list(dict.fromkeys(result["method"] for result in results))
    return {
        "trials": len(results),
        "scenes": sorted({f"{result['scene']}/{result['variant']}" for result in results}),
        "seeds": sorted({int(result["seed"]) for result in results}),
        "methods": {name: _method([each for each in results if each["method"] == name]) for name in methods},
    }


def _method(results: list[Result]) -> dict[str, Any]:
    time, (placed, wanted) = data.mean_time(results), data.placed(results)
    return {
        "trials": len(results), "completed": time.n, "mean_s": time.value, "low_s": time.low, "high_s": time.high,
        "placed": placed, "wanted": wanted, "contacts_caused": data.contacts(results),
    }  # fmt: skip


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
