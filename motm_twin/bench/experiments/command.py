"""`motm-twin bench exp1 --methods all --trials 50`: run experiments by name and print what they say."""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console

from motm_twin.bench.experiments.catalogue import EXPERIMENTS, experiment
from motm_twin.bench.experiments.pool import BACKENDS
from motm_twin.bench.experiments.run import Results, run
from motm_twin.bench.experiments.store import Store
from motm_twin.bench.experiments.summary import published_beside, reasons_table, rows, summary_table, write_summary
from motm_twin.bench.machine import machine

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def add_options(parser: argparse.ArgumentParser) -> None:
    """What only experiments have; each of these makes a name an experiment instead of a group with goals."""
    parser.add_argument("--methods", nargs="+", default=None, metavar="METHOD", help="names, or all, or ablations")
    parser.add_argument("--trials", type=int, default=None, help="random arrangements (default: the ten published)")
    parser.add_argument("--changes", nargs="+", default=None, metavar="FIELD=VALUE", help="of the resolved scene")
    parser.add_argument("--backend", choices=BACKENDS, default=None, help="loky: this machine; ray: a cluster")
    parser.add_argument("--address", default=None, help="of the Ray cluster, or auto")
    parser.add_argument("--retry-failed", action="store_true", help="run trials again that were without success")


def wanted(options: argparse.Namespace) -> bool:
    """Was anything asked for that only experiments have?"""
    return options.retry_failed or any(
        value is not None
        for value in (options.methods, options.trials, options.changes, options.backend, options.address)
    )


def bench_experiments(names: list[str], options: argparse.Namespace, console: Console) -> int:
    """Run, print a table each, write the summaries; the exit code.

    0 when all trials succeeded, 1 when not, 2 for bad input, 130 after Ctrl-C.
    """
    try:
        changes = changes_of(options.changes or ())
        chosen = [experiment(name, options.methods or (), options.trials).changed(changes) for name in names]
        for each in chosen:
            console.print(f"[bold]{each.name}[/bold]: {each.title}, {len(each.specs)} trials")
        results = run(
            chosen,
            out=options.out,
            workers=options.workers,
            backend=options.backend or BACKENDS[0],
            address=options.address,
            console=console,
            retry_failed=options.retry_failed,
        )
    except ValueError as error:  # of the arguments: what goes wrong in a trial is in its result
        console.print(f"motm-twin: {error}", style="red", markup=False)
        return BAD_INPUT
    except KeyboardInterrupt:
        kept = sum(len(Store(options.out / name).read()) for name in names)
        text = f"\nstopped; {kept} finished trials are in {options.out}: the same command goes on from there"
        console.print(text, markup=False)
        return INTERRUPTED
    for name in names:
        show(name, results, options.out, console)
    whole = sum(map(len, results.trials.values()))
    where = f"{results.computed} trials run now, {whole - results.computed} known; {options.workers} processes"
    console.print(f"{where}; {machine()}", markup=False)
    succeeded = all(result["success"] for these in results.trials.values() for result in these)
    return OK if succeeded else FAILED


def changes_of(given: Iterable[str]) -> dict[str, Any]:
    """Changes of a scene from texts ``field=value``, the value as JSON or plain. Raises ValueError."""
    changes = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"change {text!r}: write FIELD=VALUE, as noise.lidar_range_sd=0.05")
        try:
            changes[name] = msgspec.json.decode(value)
        except msgspec.DecodeError:
            changes[name] = value
    return changes


def show(name: str, results: Results, out: Path, console: Console) -> None:
    """The table of one experiment, and where its files are."""
    found, beside = rows(results.of(name)), published_beside(results.of(name))
    console.print(f"\n[bold]{EXPERIMENTS[name].title}[/bold]")
    console.print(summary_table(found, beside))
    if (why := reasons_table(results.of(name))) is not None:
        console.print(why)
    target = write_summary(found, beside, out / name)
    console.print(f"written to {target}; the trials are in {out / name}", markup=False)
