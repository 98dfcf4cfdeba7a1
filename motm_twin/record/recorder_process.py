"""The recorder as a program: ``python -m motm_twin.record.recorder_process --out run.mcap``."""

import argparse
import sys

from motm_twin.bus.connection import LOOPBACK, open_member
from motm_twin.bus.keys import DEFAULT_PORT, DEFAULT_TWIN
from motm_twin.bus.processes import Reporter, leave, stop_event
from motm_twin.client.discover import NoTwin, require_answer
from motm_twin.exit_codes import BAD_INPUT, FAILED, OK
from motm_twin.record.recorder import Recorder, RecordingFailed
from motm_twin.sessions.session import SessionError

LISTENS = 1.0  # [s] at most until the twin knows that it is recorded; what came meanwhile is recorded too


def main() -> None:
    """Record until a signal, the end of the parent, or the time that was given."""
    options = _options()
    report, stop = Reporter(options.report), stop_event(options.report is not None)
    try:
        session = open_member(options.endpoint, wait=options.wait, stop=stop)
        if options.answer is not None:
            require_answer(session, options.twin, options.endpoint, within=options.answer)
        recorder = Recorder(session, options.twin, options.out)
    except (SessionError, NoTwin, TimeoutError, ValueError) as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    recorder.listens(LISTENS)
    report("recording", **recorder.summary)
    try:
        recorder.run(stop, seconds=options.seconds)
    except RecordingFailed as error:
        print(f"record: the recording has stopped: {error}; the robot goes on", file=sys.stderr)
        report("failed", text=str(error), **recorder.summary)
        leave(FAILED)
        return
    report("recorded", **recorder.summary)
    session.close()
    leave(OK)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m motm_twin.record.recorder_process", description=__doc__)
    parser.add_argument("--endpoint", default=f"tcp/{LOOPBACK}:{DEFAULT_PORT}", help="where the twin server listens")
    parser.add_argument("--twin", default=DEFAULT_TWIN, help="name in the keys")
    parser.add_argument("--out", required=True, help="file to be written; it must not exist")
    parser.add_argument("--seconds", type=float, help="time to record; without it until a signal")
    parser.add_argument("--wait", type=float, default=30.0, help="time to wait for the server")
    parser.add_argument("--answer", type=float, help="refuse when the twin does not answer within this time")
    parser.add_argument("--report", type=int, help=argparse.SUPPRESS)
    return parser.parse_args(sys.argv[1:])


if __name__ == "__main__":
    main()
