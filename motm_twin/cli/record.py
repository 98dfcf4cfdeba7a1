"""`motm-twin record | replay | rerun | what-if | info | recover`: recordings on the command line."""

import json as json_module
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import msgspec
import tyro
from rich.console import Console
from tyro.conf import Positional

from motm_twin.cli.settings import Changes, ReplaySettings
from motm_twin.processes import handled
from motm_twin.program import BAD_INPUT, FAILED, OK, plain_console
from motm_twin.sessions.session import SessionError

ANSWER = 5.0  # [s] in which the twin must answer once its server does
_File = Annotated[Positional[str], tyro.conf.arg(metavar="FILE")]
_Json = Annotated[str | None, tyro.conf.arg(name="json", metavar="FILE|-")]
_Method = Annotated[str | None, tyro.conf.arg(metavar="FILE.py:NAME")]
_Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]


def record(
    out: Annotated[Positional[str], tyro.conf.arg(metavar="FILE")],
    /,
    twin: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    endpoint: Annotated[str | None, tyro.conf.arg(metavar="ENDPOINT")] = None,
    seconds: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    wait: float = 30.0,
) -> int:
    """Record a running twin into an MCAP file, from another process, until Ctrl-C.

    Exit code 0: recorded; 1: the disk refused, what was written can be read; 2: bad input, or no twin answers.

    Args:
        out: New file, FILE.mcap.
        twin: Name of the twin in the Zenoh keys; without it, the only one that runs.
        endpoint: Address of its server; without it, that of MOTM_ZENOH_CONFIG, or the twin on this machine.
        seconds: Time to record [s], above 0; without it until Ctrl-C.
        wait: Time to wait for the server [s], when both --twin and --endpoint are given.
    """
    from motm_twin.client.discover import OPTIONS, NoTwin, find

    if not out.endswith(".mcap"):
        raise SessionError("a recording ends in .mcap: choose such a name", file=out)
    if seconds is not None and not seconds > 0.0:
        raise SessionError(f"--seconds {seconds:g}: give a time above 0, or leave it out to record until Ctrl-C")
    try:
        endpoint, twin = find(endpoint, twin, how=OPTIONS)
    except NoTwin as error:
        _tell_refused(str(error))
        return BAD_INPUT
    arguments = ["--twin", twin, "--endpoint", endpoint, "--out", out, "--wait", str(wait), "--answer", str(ANSWER)]
    arguments += [] if seconds is None else ["--seconds", str(seconds)]
    console = plain_console()
    command = [sys.executable, "-m", "motm_twin.record.recorder", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own module
    # Ctrl-C reaches the recorder as well, which ends by itself; SIGTERM is passed on.
    with handled(signal.SIG_IGN, signal.SIGINT), handled(lambda *_: process.terminate(), signal.SIGTERM):
        try:
            assert process.stdout is not None
            for line in process.stdout:
                with suppress(OSError):  # recording goes on even if the output is closed
                    _tell(console, json_module.loads(line))
            return process.wait()
        finally:
            if process.poll() is None:
                process.terminate()


def _tell(console: Console, event: dict) -> None:
    size = f"{event.get('bytes', 0) / 1e6:.1f} MB"
    match event["event"]:
        case "recording":
            console.print(f"recording to {event['file']} (Ctrl-C ends it)", markup=False)
        case "recorded":
            lost = f"; {event['lost_periods']} periods did not arrive" if event["lost_periods"] else ""
            console.print(f"recorded {event['file']}, {size}{lost}", markup=False)
        case "failed":
            text = f"the recording has stopped: {event['text']}; the {size} before can be read"
            plain_console(stderr=True).print(text, style="red", markup=False)
        case "refused":
            _tell_refused(event["text"])


def _tell_refused(text: str) -> None:
    console = plain_console(stderr=True)
    console.print(f"motm-twin record: {text}", style="red", markup=False)


def replay(settings: Annotated[ReplaySettings, tyro.conf.arg(name="")]) -> int:
    """Play a recording back in the page, and on Zenoh under the keys of a twin.

    Exit code 0: ended on request; 1: a process died again and again; 2: bad input.
    """
    from motm_twin.bus.commands import SPEED
    from motm_twin.cli.serve import serve_recording

    file, speed = settings.file, settings.speed
    if not file.endswith(".mcap"):
        raise SessionError("is no recording (.mcap); for a saved session use `motm-twin rerun`", file=file)
    if not Path(file).is_file():
        raise SessionError("there is no such file", file=file)
    if problem := SPEED.refusal("", speed):
        raise SessionError(f"--{problem}")
    return serve_recording(settings)


def rerun(file: _File, /, update: _Flag = False, json: _Json = None, method: _Method = None) -> int:
    """Compute a saved session or a recording again and compare it bit for bit.

    For a recording, this computes every run that it can, compares every period and state hash, and names the first
    period that differs. For every other run it gives the reason; that does not count as a difference.

    Exit code 0: equal, or updated; 1: different; 2: bad input, or nothing in the recording can be computed.

    Args:
        file: A saved session (.json) or a recording (.mcap).
        update: Show the difference, then write the new state into the session: the change of behaviour is intended.
        json: Write the report to a file, or to standard output with '-'.
        method: File of your own method, if the session or recording was made with one.
    """
    from motm_twin.cli.run import rerun_file

    return rerun_file(file, update=update, report=json, method=method)


def what_if(
    file: _File,
    /,
    changes: Changes = (),
    seconds: Annotated[float, tyro.conf.arg(name="from", metavar="SECONDS")] = 0.0,
    json: _Json = None,
    stream: _Flag = False,
    method: _Method = None,
) -> int:
    """Run a saved session as it was and with other parameters, both to the end of the task.

    Exit code 0: both were run; 1: one broke; 2: bad input.

    Args:
        file: A saved session.
        changes: Set a parameter (docs/zenoh.md lists them) to a value; may be repeated.
        seconds: Simulated time from which the changes hold; 0 for the whole run.
        json: Write the report to a file, or to standard output with '-'.
        stream: Instead, write the poses of both robots at 10 Hz and their outcomes as JSON lines.
        method: File of your own method, if the session was made with one.
    """
    from motm_twin.cli.run import what_if as compare

    return compare(file, list(changes), seconds=seconds, report=json, lines=stream, method=method)


def info(file: _File, /, json: _Json = None) -> int:
    """Describe a recording: duration, runs, topics with rates, and whether it is complete.

    Exit code 0: complete; 1: its end is missing or a part is broken; 2: bad input.

    Args:
        file: A recording (.mcap).
        json: Write the report to a file, or to standard output with '-'.
    """
    from motm_twin.program import write_json
    from motm_twin.record.recording import info as contents_of
    from motm_twin.record.recording import show

    found = contents_of(file)
    if json is not None:
        write_json(msgspec.to_builtins(found), json)
    if json != "-":
        show(found)
    return OK if found.complete else FAILED


def recover(file: _File, /, out: Annotated[str | None, tyro.conf.arg(aliases=("-o",), metavar="FILE")] = None) -> int:
    """Write a complete file, with its index, from a recording that was cut off, and read it back as a check.

    Exit code 0: recovered; 2: bad input, or the new file cannot be read.

    Args:
        file: A recording (.mcap).
        out: New file; FILE.recovered.mcap without it.
    """
    from motm_twin.record.mcap_file import recover as recover_file

    found = recover_file(file, out)
    left_out = [f"{found.lost_bytes} bytes of an unfinished end"] if found.lost_bytes else []
    if found.broken_chunks:
        left_out.append(f"{found.broken_chunks} broken {'chunk' if found.broken_chunks == 1 else 'chunks'}")
    plain_console().print(
        f"{found.file}: {found.messages} messages, {found.seconds:.1f} s, verified; "
        + f"left out: {' and '.join(left_out) or 'nothing'}"
        + (" (the file was complete already)" if found.was_complete else ""),
        markup=False,
    )
    return OK
