"""`motm-twin rerun`: compute a saved session or a recording again and compare, bit for bit."""

import msgspec
from rich.console import Console

from motm_twin.cli.outputs import refuse_unwritable, write_json
from motm_twin.control.method import Method
from motm_twin.methods.registry import find_method
from motm_twin.model.names import scene_name
from motm_twin.model.period import PERIOD
from motm_twin.program import FAILED, OK, plain_console
from motm_twin.record.recording import load_recording
from motm_twin.record.replay import Rerun, RunReport, rerun, rerun_run, updated
from motm_twin.sessions.session import Session, SessionError, load_session, save_session


def rerun_file(file: str, *, update: bool = False, report: str | None = None, method: str | None = None) -> int:
    """Rerun a session or a recording; the exit code: 0 equal (or updated), 1 different, or a session without a hash.

    ``update`` writes the new hash into the file; ``report``: file of the JSON report, '-' for standard output;
    ``method``: FILE.py:NAME of a user's, for what was made with it. Raises SessionError for a file that cannot be used,
    such as a recording of which no run can be computed, MethodError for such a method.
    """
    refuse_unwritable(report)
    own = None if method is None else find_method(method)
    if file.endswith(".mcap"):
        if update:
            raise SessionError("--update is for saved sessions: a recording stays as it was", file=file)
        return _rerun_recording(file, report, own)
    session = load_session(file)
    try:
        again = rerun(session, own)
    except SessionError as error:
        raise SessionError(error.problem, file=file) from error
    if report != "-":
        _print(session, again)
    if update:
        save_session(updated(session, again), file)
        if report != "-":
            plain_console().print(f"{file} was written with this run's state.", markup=False)
    if report is not None:
        write_json({"file": file, "updated": update, **msgspec.to_builtins(again)}, report)
    return OK if again.ok or update else FAILED


class NotComputed(msgspec.Struct, frozen=True, kw_only=True):
    """A run that cannot be compared: neither equal nor different."""

    run: int
    text: str  # why


def _rerun_recording(file: str, report: str | None, own: Method | None) -> int:
    """Every run of a recording that can be computed. Raises SessionError when none can."""
    recording = load_recording(file)
    console = plain_console()
    if not recording.runs:
        raise SessionError("holds no period of a twin: `motm-twin info` tells what is in it", file=file)
    found: list[RunReport] = []
    left: list[NotComputed] = []
    for run in recording.runs:
        try:
            found.append(rerun_run(recording, run, own))
        except SessionError as error:
            left.append(NotComputed(run=run.key[1], text=error.problem))
            continue
        if report != "-":
            _print_run(console, found[-1])
    if not found:
        reasons = "; ".join(f"run {run.run}: {run.text}" for run in left)
        raise SessionError(f"no run in it can be computed again: {reasons}", file=file)
    ok = all(run.ok for run in found)
    if report != "-":
        for run in left:
            console.print(f"run {run.run}", style="bold", markup=False)
            console.print("[yellow]not computed[/yellow], which is no difference: ", end="")
            console.print(run.text, markup=False)
        if not recording.health.complete:
            text = f"the file is not complete ({recording.health.text}): only what is whole in it could be compared"
            console.print(text, markup=False)
    if report is not None:
        parts = {"complete": recording.health.complete, "text": recording.health.text}
        runs = {"runs": msgspec.to_builtins(found), "not_computed": msgspec.to_builtins(left)}
        write_json({"file": file, "ok": ok, **parts, **runs}, report)
    return OK if ok else FAILED


def _print_run(console: Console, run: RunReport) -> None:
    console.print(f"run {run.run}: {run.scene}", style="bold", markup=False)
    if run.text:
        console.print("[yellow]note[/yellow]: ", end="")
        console.print(run.text, markup=False)
    if run.ok:
        compared = f"{run.compared} of {run.periods} periods and {run.hashes} states compared"
        console.print(f"[green]equal[/green] bit for bit: {compared}; ends in state {run.state_hash[:12]}")
        return
    console.print(f"[red]different[/red] first in period {run.period} ({run.period * PERIOD:.2f} s):")
    for line in run.fields:
        console.print(f"  {line}", markup=False)
    for line in run.differences:
        console.print(f"  also different: {line}", markup=False)


def explain(again: Rerun) -> str:
    """Likely reasons why the states differ; "" when they are equal."""
    if again.ok:
        return ""
    made = "; also different: " + ", ".join(again.differences) if again.differences else ""
    return f"recorded {again.recorded_hash or 'nothing'}, now {again.state_hash}; {again.first_sign}{made}"


def _print(session: Session, again: Rerun) -> None:
    console = plain_console()
    scene = session.scene
    name = f"{scene_name(scene.name, scene.variant)}, seed {scene.seed}" + (
        f": {session.title}" if session.title else ""
    )
    console.print(name, style="bold", markup=False)
    console.print(
        f"method {session.method}, time {again.time_s:.2f} s, {again.periods} periods ({again.periods * PERIOD:.2f} s "
        f"of recording), {len(session.edits)} edits, {len(session.cuts)} searches cut by the clock",
        markup=False,
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
