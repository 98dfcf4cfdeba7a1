"""A what-if, with other parameters than recorded: both runs of a session, in two processes at once.

As a program, ``python -m motm_twin.record.what_if FILE --set next_weight=0 --from 12.5`` writes JSON lines: samples
``{"run", "time", "pose", "q", "gripper"}`` of the runs "as it was" and "changed", and for each a last line
``{"run", "done": true, "time_s", "picks", "places", "contacts", "all_contacts", "path_length", "success", "reason",
"skipped", "forecast_from_s"}``: the time is a forecast from that time on, where the recording ends or the change
begins; null when the run ended as recorded. What cannot be run gives one line ``{"error"}`` and exit code 2. The
program ends with whoever started it: when its standard input is a pipe that closes, or nobody reads its output.
"""

import argparse
import multiprocessing
import os
import stat
import sys
import threading
import traceback
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait

import msgspec

from motm_twin.exit_codes import BAD_INPUT, FAILED, OK
from motm_twin.interrupts import deaf
from motm_twin.methods.registry import find_method
from motm_twin.model.names import MethodError
from motm_twin.record.what_if_run import (
    AS_IT_WAS,
    CHANGED,
    Changes,
    Outcome,
    Sample,
    parse_changes,
    run_one,
    start_period,
)
from motm_twin.sessions.session import Session, SessionError, decode_session, encode_session, load_session
from motm_twin.warm_up import compile_kernels

NICE = 10  # the live twin comes first
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class _Broken(msgspec.Struct, frozen=True, kw_only=True):
    """Why a run ended before its Outcome."""

    run: str
    error: str
    bad_input: bool


class RunBroke(RuntimeError):
    """A process of a what-if died or met an error of the program."""


Line = Sample | Outcome


def compare(session: Session, changes: Changes, start: int, method: str | None = None) -> Iterator[Line]:
    """The lines of both runs as they come; ``start`` is the period from which the changes apply.

    ``method``: FILE.py:NAME of a user's, for a session that was made with it.

    Raises SessionError when the session cannot be run, RunBroke when a process died. Ends its processes in any case.
    """
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    compile_kernels()
    context = multiprocessing.get_context("spawn")
    data, readers, processes = encode_session(session), {}, []
    try:
        for name, values in ((AS_IT_WAS, {}), (CHANGED, changes)):
            read, write = context.Pipe(duplex=False)
            process = context.Process(
                target=_work, args=(data, values, start, name, method, write), daemon=True, name=name
            )
            with deaf():
                process.start()
            write.close()
            readers[read] = name
            processes.append(process)
        yield from _lines(readers)
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.join()
        for read in readers:
            read.close()


def _lines(readers: dict[Connection, str]) -> Iterator[Line]:
    open_readers = dict(readers)
    while open_readers:
        for read in wait(list(open_readers)):
            assert isinstance(read, Connection)
            try:
                line = read.recv()
            except EOFError:
                raise RunBroke(f"the run {open_readers[read]!r} ended before it was done") from None
            if isinstance(line, _Broken):
                raise (
                    SessionError(line.error)
                    if line.bad_input
                    else RunBroke(f"the run {line.run!r} broke: {line.error}")
                )
            yield line
            if isinstance(line, Outcome):
                del open_readers[read]


def _work(data: bytes, changes: Changes, start: int, name: str, method: str | None, write: Connection) -> None:
    """One run, in its own process, which ends with its parent."""
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    os.nice(NICE)
    try:
        own = None if method is None else find_method(method)
        for line in run_one(decode_session(data), changes=changes, start=start, method=own):
            write.send(line)
    except (SessionError, MethodError) as error:
        write.send(_Broken(run=name, error=str(error), bad_input=True))
    except BrokenPipeError:
        return
    except Exception as error:
        traceback.print_exc()
        write.send(_Broken(run=name, error=f"{type(error).__name__}: {error}", bad_input=False))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(FAILED)


def stream(file: str, changes: list[str], seconds: float, method: str | None = None) -> int:
    """Write the JSON lines of both runs to standard output; the exit code."""
    _end_with_input()
    try:
        session = load_session(file)
        values, start = parse_changes(changes), start_period(session, seconds)
        for line in compare(session, values, start, method):
            _print(line)
    except SessionError as error:
        _print({"error": str(error)})
        return BAD_INPUT
    except RunBroke as error:
        _print({"error": str(error)})
        return FAILED
    return OK


def _print(line: Line | dict[str, str]) -> None:
    try:
        sys.stdout.buffer.write(msgspec.json.encode(line) + b"\n")
        sys.stdout.buffer.flush()
    except BrokenPipeError:  # nobody reads any more; the processes of the runs end with this one
        os._exit(OK)


def _end_with_input() -> None:
    """End when standard input closes, if it is a pipe or socket of the parent."""
    try:
        mode = os.fstat(0).st_mode
    except OSError:
        return
    if not (stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)):
        return

    def watch() -> None:
        while os.read(0, 1024):
            continue
        os._exit(OK)

    threading.Thread(target=watch, name="standard input", daemon=True).start()


def main() -> None:
    """Entry point of ``python -m motm_twin.record.what_if``."""
    parser = argparse.ArgumentParser(prog="python -m motm_twin.record.what_if", description=__doc__)
    parser.add_argument("file", metavar="FILE", help="a saved session")
    parser.add_argument("--set", dest="changes", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--from", dest="seconds", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--method", metavar="FILE.py:NAME", help="of the session, when it is not shipped")
    parser.add_argument("--stream", action="store_true", help="write JSON lines (always done)")
    options = parser.parse_args()
    sys.exit(stream(options.file, options.changes, options.seconds, options.method))


if __name__ == "__main__":
    main()
