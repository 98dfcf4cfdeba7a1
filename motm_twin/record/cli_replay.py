"""`motm-twin replay`: run a saved session again and compare, bit for bit."""

import json
import sys
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console

from motm_twin.record.replay import Rerun, rerun, updated
from motm_twin.record.session import Session, SessionError, load_session, save_session

OK, DIFFERENT = 0, 1


def replay(file: str, *, update: bool = False, report: str | None = None) -> int:
    """Rerun a session file; the exit code: 0 equal (or updated), 1 different or without a hash to compare with.

    ``update`` writes the new hash into the file; ``report``: file of the JSON report, '-' for standard output. Raises
    SessionError for a file that cannot be used.
    """
    session = load_session(file)
    try:
        again = rerun(session)
    except SessionError as error:
        raise SessionError(error.problem, file=file) from error
    if report != "-":
        _print(session, again)
    if update:
        save_session(updated(session, again), file)
        if report != "-":
            Console(highlight=False).print(f"{file} was written with this run's state.", markup=False)
    if report is not None:
        write_json({"file": file, "updated": update, **msgspec.to_builtins(again)}, report)
    return OK if again.ok or update else DIFFERENT


def write_json(report: dict[str, Any], target: str) -> None:
    """Write a report to a file, or to standard output with '-'. Raises SessionError when it cannot be written."""
    text = json.dumps(report, indent=2)
    if target == "-":
        print(text)
        return
    try:
        Path(target).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise SessionError(f"cannot be written: {error.strerror or error}", file=target) from error


def explain(again: Rerun) -> str:
    """Why the states differ, as far as it can be told; "" when they are equal."""
    if again.ok:
        return ""
    made = "; made with other versions: " + ", ".join(again.differences) if again.differences else ""
    return f"recorded {again.recorded_hash or 'nothing'}, now {again.state_hash}; {again.first_sign}{made}"


def _print(session: Session, again: Rerun) -> None:
    console = Console(file=sys.stdout, highlight=False, soft_wrap=True)
    scene = session.scene
    name = f"{scene.name} / {scene.variant}, seed {scene.seed}" + (f": {session.title}" if session.title else "")
    console.print(name, style="bold", markup=False)
    console.print(
        f"{again.periods} periods, {again.periods / 20:.2f} s, {len(session.edits)} edits, "
        f"{len(session.cuts)} searches cut by the clock"
    )
    if again.ok:
        console.print(f"[green]equal[/green] bit for bit: state {again.state_hash[:12]}")
        return
    if not again.recorded_hash:
        console.print("[yellow]not compared[/yellow]: ", end="")
        console.print(f"{again.first_sign}; this run ends in state {again.state_hash[:12]}", markup=False)
        return
    console.print("[red]different[/red]: ", end="")
    console.print(explain(again), markup=False)
