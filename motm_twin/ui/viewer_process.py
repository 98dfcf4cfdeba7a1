"""The viewer as a program: ``python -m motm_twin.ui.viewer_process --endpoint tcp/127.0.0.1:7447 --port 8080``."""

import argparse
import logging
import os
import sys
import threading

from motm_twin.bus.client import TwinClient
from motm_twin.bus.connection import LOOPBACK
from motm_twin.bus.keys import DEFAULT_PORT, DEFAULT_TWIN
from motm_twin.bus.processes import Reporter, leave, stop_event
from motm_twin.exit_codes import BAD_INPUT
from motm_twin.memory import freeze_setup, share_arenas
from motm_twin.ui.crowd import VISITORS
from motm_twin.ui.guard import open_page, page_url
from motm_twin.ui.page_token import VARIABLE, chosen_token
from motm_twin.ui.viewer import Viewer

NICENESS = 5  # drawing yields to control


def main() -> None:
    """Run until a signal or the end of the parent."""
    options = _options()
    report, stop = Reporter(options.report), stop_event(options.report is not None)
    given = os.environ.pop(VARIABLE, None) or None  # no child of this program needs it
    os.nice(NICENESS)
    share_arenas()
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)  # a browser that hangs up is no news
    try:
        token = chosen_token(None if options.no_token else given, none=options.no_token)
        server = open_page(options.host, options.port, token, options.name, visitors=options.visitors)
        client = TwinClient(options.endpoint, options.twin)
    except (OSError, ValueError) as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    viewer = Viewer(server, client, None if options.own_method is None else tuple(options.own_method))
    drawing = threading.Thread(target=viewer.run, name="viewer", daemon=True)
    drawing.start()
    freeze_setup()
    report("page", url=page_url(options.host, server.get_port(), token), port=server.get_port())
    stop.wait()
    viewer.stop()
    drawing.join(0.5)
    server.stop()
    client.close()
    leave(0)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m motm_twin.ui.viewer_process", description=__doc__)
    parser.add_argument("--endpoint", default=f"tcp/{LOOPBACK}:{DEFAULT_PORT}", help="where the twin server listens")
    parser.add_argument("--twin", default=DEFAULT_TWIN, help="name in the keys")
    parser.add_argument("--host", default=LOOPBACK, help="address of the page")
    parser.add_argument("--no-token", action="store_true", help="anybody on this machine may look and drive")
    parser.add_argument("--name", action="append", default=[], help="further name under which browsers may ask")
    parser.add_argument("--port", type=int, default=8080, help="TCP port of the page, 0 takes any free one")
    parser.add_argument("--visitors", type=int, default=VISITORS, help="pages that may be open at once")
    parser.add_argument("--own-method", nargs=2, metavar=("NAME", "FILE.py:NAME"), help="method that is not shipped")
    parser.add_argument("--report", type=int, help=argparse.SUPPRESS)
    return parser.parse_args(sys.argv[1:])


if __name__ == "__main__":
    main()
