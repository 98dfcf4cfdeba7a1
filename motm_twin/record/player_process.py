"""A recording as a program: ``python -m motm_twin.record.player_process run.mcap --port 7447``."""

import argparse
import sys

from motm_twin.bus.connection import PortTaken
from motm_twin.bus.keys import DEFAULT_PORT, DEFAULT_TWIN
from motm_twin.bus.processes import Reporter, leave, stop_event
from motm_twin.exit_codes import BAD_INPUT
from motm_twin.record.player_server import PlayerServer
from motm_twin.sessions.session import SessionError

WATCH = 0.1  # [s] between looks at the state for the report


def main() -> None:
    """Play until a signal or the end of the parent."""
    options = _options()
    report, stop = Reporter(options.report), stop_event(options.report is not None)
    try:
        server = PlayerServer(
            options.file,
            twin=options.twin,
            port=options.port,
            speed=options.speed,
            loop=options.loop,
            playing=not options.paused,
            open_bus=options.open_bus,
        )
    except (SessionError, PortTaken, ValueError) as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    report("listening", endpoint=server.endpoint)
    server.start()
    said = ""
    while not stop.wait(WATCH):
        status = server.player.status()
        if status.state != said:
            said = status.state
            report("state", state=said, text=status.text or status.plant_text)
    server.close()
    leave(0)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m motm_twin.record.player_process", description=__doc__)
    parser.add_argument("file")
    parser.add_argument("--port", type=int, default=DEFAULT_PORT, help="TCP port of Zenoh, 0 takes any free one")
    parser.add_argument("--twin", default=DEFAULT_TWIN, help="name in the keys")
    parser.add_argument("--speed", type=float, default=1.0, help="1 as it was, 1/8 to 8")
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--paused", action="store_true", help="do not play at the start")
    parser.add_argument("--open-bus", action="store_true", help="anybody on this machine is let in")
    parser.add_argument("--report", type=int, help=argparse.SUPPRESS)
    return parser.parse_args(sys.argv[1:])


if __name__ == "__main__":
    main()
